"""Torque off without looking for servos: told to every id, or to one, at every speed.

Servos of several families on one wire hear what is meant for the others, and bytes at another speed as garbage. What
one takes for the start of a packet makes it miss the next bytes, up to the length of its longest packet. So each
request goes behind so many bytes that are no start of any packet.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress

from servobus.core.exchange import Exchange, Pause, Procedure, SetBaud, told
from servobus.core.framing import BITS_PER_BYTE
from servobus.core.ids import BROADCAST
from servobus.families.base import Answers, Family, Model, ServoRef

LONGEST_FLUSH = 0.06
"""s of flush before one request at most. Assumption: a servo that waits for the rest of a packet
for longer has given up by the second round."""
FLUSH = b"\x00"
APART = 1.05
"""Ratio of two speeds that are told, at least: servos understand speeds that are 3 % off (RX-28 manual 3-4-1)."""


def by_speed(rounds: Sequence[tuple[Family, Sequence[int]]]) -> list[tuple[int, list[Family]]]:
    """Give each speed, the highest first, with the families that are told at it."""
    speeds: dict[int, list[Family]] = {}
    for family, bauds in rounds:
        for baud in bauds:
            speeds.setdefault(baud, []).append(family)
    return sorted(speeds.items(), key=lambda item: -item[0])


def everyone_off(
    baud: int,
    families: Sequence[Family],
    models: Mapping[str, Sequence[type[Model]]],
    id: int = BROADCAST,
    *,
    flush: float = LONGEST_FLUSH,
) -> Procedure[None]:
    """Tell servos at one speed to switch their torque off. Nothing answers, and nothing tells whether it was heard.

    models  name of a family -> models that its servos may be of
    id      servo that is told; all by default
    flush   s that may be spent before each request to make what was heard before it harmless
    """
    yield SetBaud(baud)
    for family in families:
        size = min(family.framing.max_size, int(flush * baud / BITS_PER_BYTE))
        # One request for each place at which models of this family have their torque.
        places = {model.register("torque_enable").place: model for model in models[family.name]}
        for model in places.values():
            off = family.put(ServoRef(id, model, Answers.READS), {model.register("torque_enable"): 0}, keep=False)
            for step in told(off):
                yield step.behind(FLUSH * size) if isinstance(step, Exchange) else step
    yield Pause(0)  # until the last of it has left


def spare_bauds(models: Iterable[type[Model]], bauds: Iterable[int]) -> list[int]:
    """Give speeds that servos of these models can be set to by hand, so that with those given all are understood."""
    covered = list(bauds)
    spare = []
    offered: set[int] = set()
    for row in filter(None, (model.optional("baud") for model in models)):
        for raw in range(row.limits[0], row.limits[1] + 1):
            with suppress(ValueError):  # a code without a meaning
                offered.add(int(row.decode(raw)))
    for baud in sorted(offered, reverse=True):
        if all(max(baud, other) / min(baud, other) >= APART for other in covered):
            covered.append(baud)
            spare.append(baud)
    return spare
