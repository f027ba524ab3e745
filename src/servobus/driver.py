"""What the blocking and the asynchronous driver share: the servos they know, and what one can do with several.

The drivers themselves only differ in how they wait.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

from servobus import models, procedures
from servobus.errors import BusError, UnknownName
from servobus.exchange import Exchange, Procedure, SetBaud
from servobus.families.base import Answers, Family, Model, Target
from servobus.framing import Framing, Packet
from servobus.operation import Operation
from servobus.procedures import Course, Found, Survey, Watcher
from servobus.protocols.ids import LAST_ID, check_id
from servobus.servo import Servo
from servobus.stats import Stats
from servobus.transports.base import Transport
from servobus.volley import VolleyLink

S = TypeVar("S", bound=Servo)

POSITION_SPEED_LOAD = ("present_position", "present_speed", "present_load")
"""What a control cycle reads if nothing is said."""


class Driver(ABC, Generic[S]):
    """A port, and the servos known on it.

    `bauds` are the speeds to look for servos at, if not the factory speed of each family. `echo` says
    whether the adapter gives back what it sends; None finds out.
    """

    def __init__(self, transport: Transport, *, bauds: tuple[int, ...] | None = None, echo: bool | None = None) -> None:
        self.transport = transport
        self.link = VolleyLink(transport, echo=echo, heard=self._heard, markers=self._markers)
        self.bauds = bauds
        self.survey = Survey()
        """What the last scan saw, what made no sense included."""
        self._servos: list[S] = []

    @property
    def echo(self) -> bool | None:
        """Whether the adapter gives back what it sends; None as long as that is not known."""
        return self.link.echo

    @property
    def stats(self) -> Stats:
        """What happened on this bus, in numbers."""
        return self.link.stats

    # The servos known here

    def __getitem__(self, id: int) -> S:
        """Give the servo with this id. It must be known: found by a scan, by `find`, or named by `attach`."""
        matches = [servo for servo in self._servos if servo.id == id]
        if not matches:
            known = ", ".join(str(servo.id) for servo in self._servos) or "none"
            raise UnknownName(f"no servo with id {id} is known here (known: {known}); use scan(), find() or attach()")
        if len(matches) > 1:
            names = " and ".join(f"{servo.model.title} at {servo.baud}" for servo in matches)
            raise UnknownName(f"id {id} is not unique here: {names}; take it from the result of scan()")
        return matches[0]

    def __iter__(self) -> Iterator[S]:
        return iter(list(self._servos))

    def __len__(self) -> int:
        return len(self._servos)

    def __repr__(self) -> str:
        known = ", ".join(f"{servo.model.title} id {servo.id}" for servo in self._servos) or "no servo known yet"
        return f"<{type(self).__name__} {self.transport.name}: {known}>"

    def __contains__(self, id: object) -> bool:
        return any(servo.id == id for servo in self._servos)

    def attach(
        self,
        model: type[Model],
        id: int,
        *,
        baud: int | None = None,
        answers: Answers | None = None,
        firmware: str = "",
    ) -> S:
        """Name a servo that is there, without asking it anything.

        `baud` defaults to the family's factory speed, `answers` to the model's factory setting.
        Raises BadValue for an id that no single servo can have.
        """
        check_id(id)
        if answers is None:
            level = model.registers.get(model.aliases.get("answer_level", ""))
            answers = Answers.READS if level is None or level.default is None else Answers(level.default)
        servo = self._bind(Target(id, model, answers), baud or model.family.default_baud, firmware)
        for place, old in enumerate(self._servos):
            if (old.id, old.family.name) == (id, model.family.name):
                self._servos[place] = servo
                return servo
        self._servos.append(servo)
        return servo

    # Finding servos

    @Operation
    def scan(
        self,
        *,
        family: Family | str | None = None,
        bauds: Iterable[int] | None = None,
        ids: Iterable[int] = range(LAST_ID + 1),
        watch: Watcher | None = None,
    ) -> Procedure[list[S]]:
        """Look for servos, and look at each that is found. Moves nothing, changes nothing.

        `bauds` None means the factory speed of each family. `watch` is called with a `Progress` after each
        id. What answered without making sense is in `survey.troubles` afterwards. If it is broken off, by Ctrl-C
        or by what `watch` raises, those that were found so far are known.
        """
        survey = self.survey = Survey()
        servos: list[S] = []
        try:
            yield from procedures.scan(self._families(family), self._speeds(bauds), ids, watch, survey)
        finally:
            servos += [servo for found in survey.found if (servo := self.adopt(found)) is not None]
        return servos

    @Operation
    def find(self, id: int, *, family: Family | str | None = None, bauds: Iterable[int] | None = None) -> Procedure[S]:
        """Look for one servo. Raises NoReply, or BusError if what answers is no model known here."""
        found = yield from procedures.find(self._families(family), self._speeds(bauds), id)
        servo = self.adopt(found)
        assert servo is not None  # procedures.find gives known models only
        return servo

    # Several at once

    @Operation
    def read_all(self, name: str) -> Procedure[dict[int, Any]]:
        """Read one register of every known servo, by the name or alias that their models share; id -> value."""
        values = {}
        for servo in self:
            register = servo.model.register(name)
            yield SetBaud(servo.baud)
            (raw,) = yield from servo.family.read(servo.target, [register])
            values[servo.id] = register.decode(raw)
        return values

    @Operation
    def plan_move(
        self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[list[Course]]:
        """Check a move of several servos, id -> angle in rad, without moving any; see `move`."""
        return self._planned(goals, time, speed)

    @Operation
    def launch(self, courses: list[Course]) -> Procedure[None]:
        """Start a move that was planned: one packet starts all servos of a family."""
        return self._launched(courses)

    @Operation
    def start_move(
        self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[list[Course]]:
        """Plan a move, make sure that all servos have torque, and launch it; see `move`."""
        courses = yield from self._planned(goals, time, speed)
        procedures.require_torque(courses)
        yield from self._launched(courses)
        return courses

    @Operation
    def arrive(self, courses: list[Course], timeout: float | None = None) -> Procedure[None]:
        """Wait until all servos of these moves stand still near their goals. Raises MoveTimeout."""
        for course in courses:
            yield SetBaud(self[course.legs[0].target.id].baud)
            yield from procedures.arrive(course, timeout=timeout)

    @Operation
    def torque_on(self, servos: list[S]) -> Procedure[None]:
        """Switch the torque of these servos on, each with goal := present position first."""
        for servo in servos:
            yield SetBaud(servo.baud)
            yield from servo.family.torque(servo.target, on=True)

    @Operation
    def torque_off(self, servos: list[S]) -> Procedure[None]:
        """Switch the torque of these servos off: of all, even if one fails; then tell of the first failure."""
        first: BusError | None = None
        for servo in servos:
            yield SetBaud(servo.baud)
            try:
                yield from servo.family.torque(servo.target, on=False)
            except BusError as error:
                first = first or error
        if first is not None:
            raise first

    # Helpers

    def _planned(self, goals: Mapping[int, float], time: float | None, speed: float | None) -> Procedure[list[Course]]:
        courses = []
        for group in self._groups(goals):
            yield SetBaud(group[0].baud)
            targets = {servo.target: goals[servo.id] for servo in group}
            courses.append((yield from procedures.plan(targets, time=time, speed=speed)))
        return courses

    def _launched(self, courses: list[Course]) -> Procedure[None]:
        for course in courses:
            yield SetBaud(self[course.legs[0].target.id].baud)
            yield from course.legs[0].target.model.family.launch(course.legs)

    @abstractmethod
    def _bind(self, target: Target, baud: int, firmware: str) -> S:
        """Make this driver's own kind of servo."""

    def adopt(self, found: Found) -> S | None:
        """Know a servo that a scan has found, as it was seen then; None for a model that is not known here."""
        if found.model is None:
            return None
        identity = found.identity
        servo = self.attach(
            found.model, found.id, baud=found.baud, answers=identity.answers, firmware=identity.firmware
        )
        servo.state = found.state
        servo.note_alarms(found.alarms)
        return servo

    def _chosen(self, ids: Iterable[int] | None) -> list[S]:
        return list(self) if ids is None else [self[id] for id in ids]

    def _groups(self, ids: Iterable[int]) -> list[list[S]]:
        """Sort servos by family and speed: one packet drives servos of one kind."""
        groups: dict[tuple[str, int], list[S]] = {}
        for id in ids:
            groups.setdefault((self[id].family.name, self[id].baud), []).append(self[id])
        return list(groups.values())

    def _families(self, family: Family | str | None) -> list[Family]:
        if family is None:
            return list(models.FAMILIES.values())
        return [models.family(family) if isinstance(family, str) else family]

    def _speeds(self, bauds: Iterable[int] | None) -> tuple[int, ...] | None:
        return self.bauds if bauds is None else tuple(bauds)

    # What the link asks of us

    def _markers(self, framing: Framing, id: int) -> Sequence[Exchange[Any]]:
        return _FAMILY_OF[framing].markers(id)

    def _heard(self, exchange: Exchange[Any], packet: Packet) -> None:
        """Keep the alarms of a reply with the servo that sent it."""
        if exchange.alarms is None:
            return
        for servo in self._servos:
            if servo.id == packet.id and servo.family.framing is exchange.framing:
                servo.note_alarms(exchange.alarms(packet))


_FAMILY_OF = {family.framing: family for family in models.FAMILIES.values()}
