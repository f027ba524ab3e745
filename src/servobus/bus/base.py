"""What the blocking and the asynchronous driver share: the servos they know, and what one can do with several.

The drivers themselves only differ in how they wait.
"""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from servobus.bus.servo import Servo
from servobus.core.exchange import Batch, Exchange, Procedure, SetBaud
from servobus.core.framing import Framing, Packet
from servobus.core.ids import LAST_ID, check_id
from servobus.core.operation import bus_method
from servobus.core.registers import Register
from servobus.core.values import frozen, replace
from servobus.errors import BusError, Restarted, UnknownName, UsageError
from servobus.families import registry
from servobus.families.base import Answers, Family, Model, ServoRef
from servobus.families.record import SafeAction
from servobus.jobs.look import verify
from servobus.jobs.move import PlannedMove, plan, require_torque, start_move, wait_arrival
from servobus.jobs.scan import FoundServo, ScanResult, Watcher, find, scan
from servobus.link.link import Link
from servobus.link.ownership import LineOwnership, Priority, Turn, turn_for
from servobus.link.stats import Stats
from servobus.safety.safe_stop import SafeStop
from servobus.safety.watchdog import Watchdog
from servobus.transports.base import Transport

if TYPE_CHECKING:
    from servobus.safety.overload import Level, Protection, Thresholds

S = TypeVar("S", bound=Servo)

LOCK_TIMEOUT = 0.1
"""s that a stop waits for the line before it interrupts the job that has it."""
TAKEOVER_TIMEOUT = 0.4
"""s after which a stop goes ahead although the interrupted job has not ended: it may be stuck."""

POSITION_SPEED_LOAD = ("present_position", "present_speed", "present_load")
"""What a control cycle reads if nothing is said."""


@frozen
class ReconnectReport:
    """Who is there after a port was opened again: ids. `restarted` are those of the present that lost their RAM."""

    present: tuple[int, ...]
    missing: tuple[int, ...]
    restarted: tuple[int, ...]


class Driver(Generic[S]):
    """A port, and the servos known on it.

    `bauds` are the speeds to look for servos at, if not the factory speed of each family. `echo` says
    whether the adapter gives back what it sends; None finds out. `safe_action` is that of all servos, "hold" if it
    is None; see `Servo.safe_action`.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        bauds: tuple[int, ...] | None = None,
        echo: bool | None = None,
        safe_action: SafeAction | None = None,
    ) -> None:
        self.transport = transport
        self._port = self._shared(transport)
        """What the link talks through."""
        self._echo = echo
        self._alarmed: set[S] = set()
        """Servos whose last reply had an alarm in it: as long as there is one, the link tells of every reply."""
        self.line = LineOwnership()
        self.link = self._new_link()
        self.safety = SafeStop(transport, self._known, self._take_over, safe_action)
        self.bauds = bauds
        self.survey = ScanResult()
        """What the last scan saw, what made no sense included."""
        self._servos: list[S] = []
        self._protections: dict[S, Protection] = {}

    @property
    def echo(self) -> bool | None:
        """Whether the adapter gives back what it sends; None as long as that is not known."""
        return self.link.echo

    @property
    def stats(self) -> Stats:
        """What happened on this bus, in numbers."""
        return self.link.stats

    # Safety

    @property
    def safe_action(self) -> SafeAction:
        """Safe action of all servos on this bus; setting it sets that of the known ones and of all still to be found.

        Raises UsageError if a known servo cannot do it. One that is found later and cannot is not moved.
        """
        return self.safety.action

    @safe_action.setter
    def safe_action(self, action: SafeAction) -> None:
        self.safety.action = action

    @property
    def watching(self) -> Watchdog | None:
        """The watchdog that `watch` has begun and nothing has ended; None if there is none."""
        return self.safety.watchdog

    def watch(self, timeout: float = 0.25, action: SafeAction | None = None) -> Watchdog:
        """Guard streamed motion: make the servos safe if nothing is heard of this program for `timeout` s.

        Each command of motion on this bus feeds the watchdog, waiting for a move does, and `feed()`. If none comes in
        time, a thread of its own runs `action`, or each servo's safe action, once, even while the program is stuck or
        another thread has the line. Then commands of motion raise Stopped until `reset()` or `stop()` of what is given
        here, and so does waiting for a move. Servos that this bus has not switched on or set in motion are left alone,
        and as long as there is none nothing trips.

        Real time is what counts; on a port with a virtual clock a watchdog is a UsageError.
        """
        return self.safety.watch(timeout, action)

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

        `baud` defaults to the family's factory speed, `answers` to the model's factory setting. A servo that is known
        already stays the same object, with all that was noted of it. Raises BadValue for an id that no single servo
        can have.
        """
        check_id(id)
        if answers is None:
            level = model.registers.get(model.aliases.get("answer_level", ""))
            answers = Answers.READS if level is None or level.default is None else Answers(level.default)
        baud = baud or model.family.default_baud
        old = next((old for old in self._servos if (old.id, old.family.name) == (id, model.family.name)), None)
        if old is not None and old.model is model:
            old.target = replace(old.target, answers=answers)
            old.baud, old.firmware = baud, firmware or old.firmware
            return old
        servo = self._bind(ServoRef(id, model, answers), baud, firmware)
        servo.notes.before_motion = partial(self.safety.about_to_move, servo)
        servo.notes.keep_alive = self.safety.keep_alive
        servo.notes.safe_action = self.safety.chosen
        if old is None:
            self._servos.append(servo)
        else:
            servo.notes.max_step, servo.notes.safe_action = old.notes.max_step, old.notes.safe_action
            self._servos[self._servos.index(old)] = servo
        return servo

    # Finding servos

    @bus_method
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
        survey = self.survey = ScanResult()
        servos: list[S] = []
        try:
            yield from scan(self._families(family), self._speeds(bauds), ids, watch, survey)
        finally:
            servos += [servo for found in survey.found if (servo := self.adopt(found)) is not None]
        return servos

    @bus_method
    def find(self, id: int, *, family: Family | str | None = None, bauds: Iterable[int] | None = None) -> Procedure[S]:
        """Look for one servo. Raises NoReply, or BusError if what answers is no model known here."""
        found = yield from find(self._families(family), self._speeds(bauds), id)
        servo = self.adopt(found)
        assert servo is not None  # find gives known models only
        return servo

    # Several at once

    @bus_method
    def read_all(self, name: str | Register[Any]) -> Procedure[dict[int, Any]]:
        """Read one register of every known servo, by the name or alias that their models share; id -> value.

        A register of one of the models stands for its name. Raises UnknownName for a model that has none of it.
        """
        values = {}
        name = name.name if isinstance(name, Register) else name
        for servo in self:
            register = servo.model.register(name)
            yield SetBaud(servo.baud)
            (raw,) = yield from servo.family.read(servo.target, [register])
            values[servo.id] = register.decode(raw)
        return values

    @bus_method
    def plan_move(
        self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[list[PlannedMove]]:
        """Check a move of several servos, id -> angle in rad, without moving any; see `move`."""
        return self._planned(goals, time, speed)

    @bus_method
    def start_planned(self, moves: list[PlannedMove]) -> Procedure[None]:
        """Start a move that was planned: one packet starts all servos of a family."""
        return self._start_planned(moves)

    @bus_method
    def start_move(
        self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[list[PlannedMove]]:
        """Plan a move, make sure that all servos have torque, and start it; see `move`."""
        moves = yield from self._planned(goals, time, speed)
        require_torque(moves)
        yield from self._start_planned(moves)
        return moves

    @bus_method
    def wait_arrival(self, moves: list[PlannedMove], timeout: float | None = None) -> Procedure[None]:
        """Wait until all servos of these moves stand still near their goals; see `wait_arrival`."""
        for course in moves:
            yield SetBaud(self[course.axes[0].target.id].baud)
            yield from wait_arrival(course, timeout=timeout)

    @bus_method
    def torque_on(self, servos: list[S]) -> Procedure[None]:
        """Switch the torque of these servos on, each with goal := present position first."""
        for servo in servos:
            yield SetBaud(servo.baud)
            servo.notes.mark_moving()
            yield from servo.family.torque(servo.target, on=True)

    @bus_method
    def torque_off(self, servos: list[S]) -> Procedure[None]:
        """Switch the torque of these servos off: of all, even if one fails; then tell of the first failure."""
        first: BusError | None = None
        for servo in servos:
            yield SetBaud(servo.baud)
            try:
                yield from servo.family.torque(servo.target, on=False)
                servo.notes.mark_idle()
            except BusError as error:
                first = first or error
        if first is not None:
            raise first

    @bus_method
    def protect(self, thresholds: "Thresholds | None" = None) -> "Procedure[dict[int, Level]]":
        """Look once how hot every known servo is and whether it is stuck, and act on it; id -> level.

        To be called again and again, say every 0.1 s: a stall shows only over several looks. WARN is 10 °C below
        the limit set in the servo. At DERATE, 5 °C below it, it gets half its torque limit (RX-28), half its highest
        output (DRS-0602) or half its speed (LX-16A). At SAFE, at the limit or after 0.5 s of pushing without motion,
        its safe action runs, and commands of motion raise Stopped until a later look finds that it is over. All
        bounds can be set, from the first call on; see `servobus.safety.overload.Thresholds`. One that does not answer,
        or cannot be read, raises NoReply or UsageError after all others had their turn.
        """
        from servobus.safety.overload import Thresholds, protect, protection  # noqa: PLC0415 - not everybody wants it

        levels = {}
        first: BusError | UsageError | None = None
        for servo in self:
            yield SetBaud(servo.baud)
            try:
                if servo not in self._protections:
                    self._protections[servo] = yield from protection(servo.target, thresholds or Thresholds())
                now = self.transport.now()
                guarding = self._protections[servo]
                levels[servo.id] = yield from protect(servo.target, guarding, now, servo.safe_action)
            except (BusError, UsageError) as error:
                first = first or error
        if first is not None:
            raise first
        return levels

    # Helpers

    def _planned(
        self, goals: Mapping[int, float], time: float | None, speed: float | None
    ) -> Procedure[list[PlannedMove]]:
        moves = []
        for group in self._groups(goals):
            yield SetBaud(group[0].baud)
            targets = {servo.target: goals[servo.id] for servo in group}
            moves.append((yield from plan(targets, time=time, speed=speed)))
        return moves

    def _start_planned(self, moves: list[PlannedMove]) -> Procedure[None]:
        for course in moves:
            yield SetBaud(self[course.axes[0].target.id].baud)
            yield from start_move(course)

    def _reunited(self) -> Procedure[ReconnectReport]:
        """Find out which of the known servos are there, and which of them have restarted."""
        present: list[S] = []
        for group in self._groups():
            yield SetBaud(group[0].baud)
            answers = yield Batch([servo.family.ping(servo.id) for servo in group])
            present += [servo for servo, answer in zip(group, answers, strict=True) if answer is None]
        restarted = []
        for servo in list(present):
            if servo.target.answers is Answers.NOTHING:
                continue  # it cannot be read
            yield SetBaud(servo.baud)
            try:
                yield from verify(servo.target)
            except Restarted:
                servo.state = None
                restarted.append(servo.id)
            except BusError:
                present.remove(servo)  # it answered, and then no more
        missing = tuple(servo.id for servo in self if servo not in present)
        return ReconnectReport(tuple(servo.id for servo in present), missing, tuple(restarted))

    @abstractmethod
    def _bind(self, target: ServoRef, baud: int, firmware: str) -> S:
        """Make this driver's own kind of servo."""

    def adopt(self, found: FoundServo) -> S | None:
        """Know a servo that a scan has found, as it was seen then; None for a model that is not known here."""
        if found.model is None:
            return None
        identity = found.identity
        servo = self.attach(
            found.model, found.id, baud=found.baud, answers=identity.answers, firmware=identity.firmware
        )
        servo.state = found.state
        self._note_alarms(servo, found.alarms)
        return servo

    def _chosen(self, ids: Iterable[int] | None) -> list[S]:
        return list(self) if ids is None else [self[id] for id in ids]

    def _groups(self, ids: Iterable[int] | None = None) -> list[list[S]]:
        """Sort servos by family and speed: one packet drives servos of one kind."""
        groups: dict[tuple[str, int], list[S]] = {}
        for servo in self._chosen(ids):
            groups.setdefault((servo.family.name, servo.baud), []).append(servo)
        return list(groups.values())

    def _families(self, family: Family | str | None) -> list[Family]:
        if family is None:
            return list(registry.FAMILIES.values())
        return [registry.family(family) if isinstance(family, str) else family]

    def _speeds(self, bauds: Iterable[int] | None) -> tuple[int, ...] | None:
        return self.bauds if bauds is None else tuple(bauds)

    def _known(self) -> list[S]:
        return list(self._servos)

    # The line

    def _shared(self, transport: Transport) -> Transport:
        """Give what the link talks through, where this driver cannot wait for the port by itself."""
        return transport

    @contextmanager
    def _take_over(self, interrupt: bool) -> Iterator[tuple[Link, LineOwnership, Turn]]:
        """Have the line for a stop: wait for what uses it, then make that fail, then go ahead all the same."""
        link, turn = self.link, turn_for(Priority.STOP)

        def supersede() -> None:
            nonlocal link
            link = link.supersede()

        try:
            self.line.take_over(turn, supersede, 0.0 if interrupt else LOCK_TIMEOUT, self._firm())
            yield link, self.line, turn
        finally:
            self.link = link
            self.line.end(turn)

    def _firm(self) -> float:
        """Give how long a stop waits, in s, for a job that it has interrupted."""
        return TAKEOVER_TIMEOUT

    def _new_link(self, stats: Stats | None = None) -> Link:
        return Link(
            self._port, echo=self._echo, heard=self._heard, fences=self._fences, alarmed=self._alarmed, stats=stats
        )

    def _reopened(self) -> None:
        """Begin anew on a port that was opened again: nothing of the old one can come any more."""
        self.link.supersede()
        self.link = self._new_link(self.link.stats)

    # What the link asks of us

    def _fences(self, framing: Framing, id: int) -> Sequence[Exchange[Any]]:
        return _FAMILY_OF[framing].fences(id)

    def _heard(self, exchange: Exchange[Any], packet: Packet) -> None:
        """Keep the alarms of a reply with the servo that sent it."""
        if exchange.alarms is None:
            return
        known = [servo for servo in self._servos if (servo.id, servo.family.framing) == (packet.id, exchange.framing)]
        # Where several servos have this id at different speeds, the line's speed tells which of them it is.
        for servo in known:
            if len(known) == 1 or servo.baud == self.transport.baud:
                self._note_alarms(servo, exchange.alarms(packet))

    def _note_alarms(self, servo: S, alarms: int) -> None:
        servo.note_alarms(alarms)
        (self._alarmed.add if alarms else self._alarmed.discard)(servo)


_FAMILY_OF = {family.framing: family for family in registry.FAMILIES.values()}
