"""Whose registers the bytes on a line are: what was said of the servos, and what they say themselves.

A value in a packet has a unit only once the model is known. Where it is not, bytes stay bytes at an address.
"""

from functools import lru_cache

from servobus.core.framing import Packet
from servobus.families.base import Family, Model
from servobus.families.explain import servo
from servobus.families.registry import first_model, identified, unknown

REPEATED = 1024
"""Packets whose explanation is kept: programs ask the same again and again."""


class Tables:
    """Puts packets into words, with the registers of the model that a servo is known to be.

    model  what all servos are said to be; else a servo is of the model that it was heard to report, and until then of
           none, unless all models of its family have the same registers
    """

    def __init__(self, model: type[Model] | None = None) -> None:
        self._said = model
        self._told: dict[tuple[str, int], type[Model] | None] = {}

    def know(self, family: Family, id: int, model: type[Model]) -> None:
        """Take it from somebody else of which model a servo is; what the servo says itself counts more."""
        self._told.setdefault((family.name, id), model)

    def of(self, family: Family, packet: Packet) -> type[Model] | None:
        """Give the model of the servos whose registers a packet is about; None where it is not known, or not one."""
        if self._said is not None:
            return self._said if self._said.family.name == family.name else None
        if family.one_table:
            return unknown(family) or first_model(family)
        if not self._told:
            return None
        models = set(self._of_each(family, packet))
        return models.pop() if len(models) == 1 else None

    def _of_each(self, family: Family, packet: Packet) -> tuple[type[Model] | None, ...]:
        return tuple(self._told.get((family.name, id)) for id in family.concerns(packet))

    def explain(self, family: Family, packet: Packet, request: Packet | None = None) -> str:
        """Say what a packet asks or, behind its request, answers."""
        if request is None and self._said is None and len(set(models := self._of_each(family, packet))) > 1:
            return family.explain_to_several(packet, models)
        return _explained(family, packet, request, self.of(family, packet))  # type: ignore[arg-type] # a class is hashable

    def answer(self, family: Family, packet: Packet, request: Packet) -> str:
        """Say what an answer says, and learn from it which model the servo is."""
        news = self._learn(family, packet, request)
        return self.explain(family, packet, request) + news

    def _learn(self, family: Family, packet: Packet, request: Packet) -> str:
        """Take note of a model number, and say what is new about it."""
        if self._said is not None or family.one_table:
            return ""
        number = family.told_number(packet, request)
        if number is None:
            return ""
        key, model = (family.name, packet.id), identified(family, number)
        if key in self._told and self._told[key] is model:
            return ""
        self._told[key] = model
        if model is None:
            return f"; {servo(packet.id)} is of model {number}, which is not known here: its registers stay bytes"
        return f"; {servo(packet.id)} is of model {model.title}: from here on its registers are shown"


@lru_cache(maxsize=REPEATED)
def _explained(family: Family, packet: Packet, request: Packet | None, model: type[Model] | None) -> str:
    return family.explain(packet, request, model)
