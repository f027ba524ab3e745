"""What the blocking and the asynchronous driver share: the servos they know, and what one can do with several.

The drivers themselves only differ in how they wait.
"""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from servobus.bus import several
from servobus.bus.by_servo import ByServo, Readings, pick
from servobus.bus.known_servos import KnownServos
from servobus.bus.protection import Protection
from servobus.bus.remembered import Remembered
from servobus.bus.servo import Servo
from servobus.core.arguments import check_bauds, check_mapping, one_or_several
from servobus.core.closed import Closed
from servobus.core.exchange import Exchange, Procedure
from servobus.core.framing import Framing, Packet
from servobus.core.ids import LAST_ID, check_id, check_ids
from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.registers import Register, register_name
from servobus.errors import (
    UsageError,
)
from servobus.families import registry
from servobus.families.base import Answers, Family, KnownServo, Model, StopOutcome
from servobus.families.record import SafeAction
from servobus.jobs.make_safe import let_go
from servobus.jobs.move import PlannedMove, cancel, has_ended, plan, plan_and_start, start_move, wait_arrival
from servobus.jobs.scan import (
    FoundServo,
    Models,
    ScanResult,
    Watcher,
    check_models,
    find,
    model_told,
    scan,
)
from servobus.jobs.torque import torque_on
from servobus.link.base import BaseLink
from servobus.link.link import Link
from servobus.link.ownership import LineOwnership, Turn, turn_for
from servobus.link.stats import Stats
from servobus.safety.safe_stop import SafeStop
from servobus.safety.watchdog import Watchdog
from servobus.transports.base import Transport

if TYPE_CHECKING:
    from servobus.safety.overload import Level, Thresholds

S = TypeVar("S", bound=Servo)

LOCK_TIMEOUT = 0.1
"""s that a stop waits for the line before it interrupts the job that has it."""
TAKEOVER_TIMEOUT = 0.4
"""s after which a stop goes ahead although the interrupted job has not ended: it may be stuck."""

POSITION_SPEED_LOAD = ("present_position", "present_speed", "present_load")
"""What a control cycle reads if nothing is said."""


class BaseBus(Closed, Generic[S]):
    """A port, and the servos known on it.

    `bauds` are the speeds to look for servos at, if not the factory speeds of the models. `echo` says
    whether the adapter gives back what it sends; None finds out. `safe_action` is that of all servos, "hold" if it
    is None; see `Servo.safe_action`. `models` says what servos are that cannot say it themselves; see `open`.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        bauds: tuple[int, ...] | None = None,
        echo: bool | None = None,
        safe_action: SafeAction | None = None,
        models: Models | None = None,
    ) -> None:
        self.models = check_models(models)
        """What servos are that cannot say it themselves: a model, or id -> model."""
        self.transport = transport
        self.remembered = Remembered(transport.lasting_name)
        """What is kept of the servos on this port that cannot say what they are."""
        self._port = self._shared(transport)
        """What the link talks through."""
        self._echo = echo
        self.line = LineOwnership()
        self._servos: KnownServos[S] = KnownServos(self._bind, self._guarded)
        self.link = self._new_link()
        self.safety = SafeStop(transport, self._known, self._take_over, safe_action)
        self.bauds = bauds
        self.survey = ScanResult()
        """What the last scan saw, what made no sense included."""
        self._protection: Protection[S] = Protection()
        self._close()

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

    def __getitem__(self, id: int | S) -> S:
        """Give the servo with this id. It must be known: found by a scan, by `find`, or named by `attach`.

        Raises UnknownName, which names the candidates, where two have this id; a servo itself is given back.
        """
        return pick(self._servos, id, remedy="; use scan(), find() or attach()")

    def __iter__(self) -> Iterator[S]:
        return iter(self._servos)

    def __len__(self) -> int:
        return len(self._servos)

    def __repr__(self) -> str:
        known = ", ".join(str(servo.target) for servo in self._servos) or "no servo known yet"
        return f"<{type(self).__name__} {self.transport.name}: {known}>"

    def __contains__(self, id: object) -> bool:
        return any(servo is id or servo.id == id for servo in self._servos)

    def attach(
        self,
        model: type[Model] | str,
        id: int,
        *,
        baud: int | None = None,
        answers: Answers | None = None,
        firmware: str = "",
    ) -> S:
        """Name a servo that is there, without asking it anything. `model` is a model or the name of one, "rx28".

        The known servo of this family and id is given back, with all that was noted of it; with another `baud` a second
        servo is made, for one port may carry both. One that is not known yet is assumed at `baud`, or at its factory
        speed. `answers` defaults to the model's factory setting. From now on it is of this model, whatever a scan takes
        it for. Raises BadValue for an id that no single servo can have, UnknownName if two servos could be meant.
        """
        kind: object = registry.model(model) if isinstance(model, str) else model
        if not (isinstance(kind, type) and issubclass(kind, Model)):
            raise UsageError(f"{kind!r:.60} is no model: attach() takes a model and an id, as in attach(RX28, 1)")
        return self._servos.attach(kind, id, baud, answers, firmware)

    def forget(self, servo: S | int) -> None:
        """Know this servo no more: it is in no result, and this bus does not make it safe. Sends nothing.

        Raises UsageError for one that this bus has set in motion or holds: switch its torque off or make it safe first.
        """
        gone = self[servo]
        self._servos.forget(gone)
        self._protection.forget(gone)

    # Finding servos

    @bus_method
    @urgent(Priority.SCAN)
    def scan(
        self,
        *,
        family: Family | str | None = None,
        bauds: int | Iterable[int] | None = None,
        ids: int | Iterable[int] = range(LAST_ID + 1),
        watch: Watcher | None = None,
    ) -> Procedure[list[S]]:
        """Look for servos, and look at each that is found. Moves nothing, changes nothing.

        `bauds` None means the factory speeds of all models. `watch` is called with a `ScanProgress` after each
        id. What answered without making sense is in `survey.troubles` afterwards, what says that it is of another model
        than `attach` gave in `survey.conflicts`. If it is broken off, by Ctrl-C
        or by what `watch` raises, those that were found so far are known. Servos that are known already stay the same
        objects.
        """
        survey = self.survey = ScanResult()
        wanted = check_ids(ids)
        try:
            yield from scan(self._families(family), self._speeds(bauds), wanted, watch, survey, self.identify)
            return (yield from self._servos.adopt_all(survey.found, survey))
        except BaseException:
            self._servos.adopt_found(survey)
            raise

    @bus_method
    def find(
        self, id: int, *, family: Family | str | None = None, bauds: int | Iterable[int] | None = None
    ) -> Procedure[S]:
        """Look for one servo.

        Raises NoReply, UnknownName if two servos have this id, BusError if its family has no table
        for a model that is not known.
        """
        check_id(id)
        found = yield from find(self._families(family), self._speeds(bauds), id, self.identify)
        (servo,) = yield from self._servos.adopt_all([found], self.survey)  # find gives known models only
        return servo

    def identify(self, family: Family, id: int, baud: int, number: int | None) -> type[Model] | None:
        """Tell the model of a servo that reports this number, as far as it can be known.

        What the servo says itself comes first, if such a model is known; then what `attach` gave, then `models`, and
        for one that says nothing what is remembered of it, see servobus.bus.remembered, or what it is known as here.
        Else its model is unknown: the generic one of its family, which has what all models share, or None if the family
        has no such model.
        """
        said = registry.identified(family, number)
        attached = self._servos.attached_model(family.name, id, baud)
        told = model_told(self.models, family, id)
        kept = self.remembered.model(family, id, number)
        before = None if number is not None else self._servos.model_at(family.name, id, baud)
        return said or attached or told or kept or before or registry.unknown(family, number)

    def adopt(self, found: FoundServo) -> S | None:
        """Know a servo that a scan has found, as it was seen then; None for a model that is not known here.

        One that is known at its id and speed already stays the same object. It stays of the model that `attach` gave.
        """
        return self._servos.adopt(found, self.survey)

    # Several at once

    @bus_method
    def read_all(
        self, register: Register[Any] | str, servos: Iterable[S | int] | S | int | None = None
    ) -> Procedure[Readings[S, Any]]:
        """Read one register of these servos (by default of all), by the name or alias that their models share.

        Servos whose models answer such are read by one request (BULK_READ of the MX series), others several at once
        where the line allows. Gives servo -> value of those that answered, which can be asked by id where that is
        unique; `lost` of it tells of the others: servo -> error. A register of one of the models stands for its name.
        Raises UnknownName for a model that has none of it, and the first error if no servo could be read.
        """
        return (yield from several.read(self._chosen(servos), register_name(register)))

    @bus_method
    def plan_move(
        self, goals: Mapping[Any, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[PlannedMove]:
        """Check a move of several servos, servo or id -> angle in rad, without moving any; see `move`."""
        return plan(self._goals(goals), time=time, speed=speed)

    @bus_method
    @urgent(Priority.MOTION)
    def start_planned(self, move: PlannedMove) -> Procedure[None]:
        """Start a move that was planned: all servos of a family at one speed with as few packets as it allows."""
        return start_move(move)

    @bus_method
    @urgent(Priority.MOTION)
    def start_move(
        self, goals: Mapping[Any, float], *, time: float | None = None, speed: float | None = None
    ) -> Procedure[PlannedMove]:
        """Plan a move, make sure that all servos have torque, and start it; see `move`."""
        return (yield from plan_and_start(self._goals(goals), time=time, speed=speed))

    @bus_method
    def wait_arrival(self, move: PlannedMove, timeout: float | None = None) -> Procedure[None]:
        """Wait until all servos of this move stand still near their goals.

        Raises MoveTimeout `timeout` s from now, or 2 s after it should have arrived; Stopped as soon as one of them
        does not come any more. See `Move.wait`.
        """
        return wait_arrival(move, timeout=timeout)

    @bus_method
    def has_ended(self, move: PlannedMove) -> Procedure[bool]:
        """Tell whether a move has ended; see `Move.done`."""
        return has_ended(move)

    @bus_method
    @urgent(Priority.STOP)
    def cancel(self, move: PlannedMove) -> Procedure[None]:
        """Stop all servos of a move where they are, unless it has ended; see `Move.cancel`."""
        return cancel(move)

    @bus_method
    @urgent(Priority.MOTION)
    def torque_on(
        self,
        servos: Iterable[S | int] | S | int | None = None,
        *,
        to_limit: bool = False,
        speed: float | None = None,
    ) -> Procedure[None]:
        """Switch the torque of these servos on (by default of all), each with goal := present position first.

        See `Servo.torque_on`. Where one fails the others have their turn all the same; then the first failure is
        raised.
        """
        yield from several.each(
            self._chosen(servos), lambda servo: torque_on(servo.target, to_limit=to_limit, speed=speed)
        )

    @bus_method
    @urgent(Priority.MOTION)
    def _take_hold(self, servos: Sequence[S], taken: list[S]) -> Procedure[None]:
        """Switch the torque of these servos on, as `torque_on`; those that had it off are put into `taken`."""
        return several.take_hold(servos, taken)

    @bus_method
    @urgent(Priority.MOTION)
    def _leave(self, servos: Sequence[S], taken: Sequence[S]) -> Procedure[None]:
        """Switch the torque of those that were taken off, and stop the others that are driven, each though others fail.

        Raises StopFailed.
        """
        return several.leave(servos, taken)

    @bus_method
    @urgent(Priority.MOTION)
    def torque_off(self, servos: Iterable[S | int] | S | int | None = None) -> Procedure[None]:
        """Switch the torque of these servos off (by default of all): of each, even if one fails.

        Then it raises the first failure.
        """
        yield from several.each(self._chosen(servos), lambda servo: let_go(servo.target))

    @bus_method
    @urgent(Priority.STOP)
    def stop(self, servos: Iterable[S | int] | S | int | None = None) -> Procedure[ByServo[S, StopOutcome]]:
        """Stop these servos (by default all that are known), each though others fail; see `Servo.stop`.

        Gives what was done with each. An id stands for all known servos that have it. Raises StopFailed, after all had
        their turn, if some may still move or are not known here.
        """
        return several.stop(self, self if servos is None else servos)

    @bus_method
    def protect(self, thresholds: "Thresholds | None" = None) -> "Procedure[ByServo[S, Level]]":
        """Look once how hot every known servo is and whether it is stuck, and act on it; servo -> level.

        To be called again and again, say every 0.1 s: a stall shows only over several looks. WARN is 10 °C below
        the limit set in the servo. At DERATE, 5 °C below it, it gets half its torque limit (RX-28), half its highest
        output (DRS-0602) or half its speed (LX-16A). At SAFE, at the limit or after 0.5 s of pushing without motion,
        its safe action runs, and commands of motion raise Stopped until a later look finds that it is over. All
        bounds can be set; they hold until others are given. See `servobus.Thresholds`. Raises UsageError for something
        else, and BadValue for bounds that make no sense. One that does not answer, or cannot be read, raises NoReply or
        UsageError after all others had their turn.
        """
        return self._protection.look(self._servos, thresholds)

    # Helpers

    def _no_attribute(self, name: str) -> str:
        return (
            f"{type(self).__name__} has no attribute {name!r} that can be set; to write a register: "
            "bus[id].write(RX28.goal_position, ...)"
        )

    def _no_such_attribute(self, name: str) -> str:
        return (
            f"{type(self).__name__} has no attribute {name!r}; to read a register: "
            'bus[id].read("present_position"), or of all servos bus.read_all("present_position")'
        )

    def _goals(self, goals: Mapping[Any, float]) -> dict[KnownServo, float]:
        """Give goals by servo. Raises UnknownName, or UsageError for a servo that is given two goals."""
        servos = {key: self[key] for key in check_mapping("goals", goals, "{1: 90 * deg}")}
        if len(set(servos.values())) < len(servos):
            raise UsageError("one of the servos is given two goals, by itself and by its id")
        return {servos[key].target: goal for key, goal in goals.items()}

    @abstractmethod
    def _bind(self, target: KnownServo, firmware: str) -> S:
        """Make this driver's own kind of servo."""

    def _chosen(self, servos: Iterable[S | int] | S | int | None) -> list[S]:
        """Give the servos that are meant, each by itself or by its id. Raises UnknownName."""
        if servos is None:
            return list(self)
        return [self[servo] for servo in one_or_several(servos, lambda thing: isinstance(thing, Servo))]

    def _families(self, family: Family | str | None) -> list[Family]:
        if family is None:
            return list(registry.FAMILIES.values())
        given: object = family
        if not isinstance(given, Family | str):
            raise UsageError(f"{given!r:.60} is no family: give its name, {registry.names(registry.FAMILIES)}")
        return [registry.family(family) if isinstance(family, str) else family]

    def _speeds(self, bauds: int | Iterable[int] | None) -> tuple[int, ...] | None:
        return self.bauds if bauds is None else check_bauds(bauds)

    def _known(self) -> list[S]:
        return list(self._servos)

    def _guarded(self, servo: S) -> None:
        """Have a servo ask this bus before it is set in motion, and tell it while it is, and of a new id."""
        servo.on_new_id = partial(self.remembered.move, servo.family)
        servo.permit.before_motion = partial(self.safety.about_to_move, servo)
        servo.permit.keep_alive = self.safety.keep_alive
        servo.permit.safe_action = self.safety.chosen

    # The line

    def _shared(self, transport: Transport) -> Transport:
        """Give what the link talks through, where this driver cannot wait for the port by itself."""
        return transport

    @contextmanager
    def _take_over(self, interrupt: bool) -> Iterator[tuple[BaseLink, LineOwnership, Turn]]:
        """Have the line for a stop: wait for what uses it, then make that fail, then go ahead all the same."""
        turn = turn_for(Priority.STOP)

        def supersede() -> None:
            self.link = self.link.supersede()

        try:
            self.line.take_over(turn, supersede, 0.0 if interrupt else LOCK_TIMEOUT, self._firm())
            # Not before: while the stop waited, the port may have been opened again, with a link of its own.
            yield self.link, self.line, turn
        finally:
            self.line.end(turn)

    def _firm(self) -> float:
        """Give how long a stop waits, in s, for a job that it has interrupted."""
        return TAKEOVER_TIMEOUT

    def _check_open(self) -> None:
        """Raise UsageError on a bus that was closed: a `with` block would begin without a port."""
        if self.safety.closed:
            raise UsageError(f"{self.transport.name} is closed; open it anew, or call reopen() first")

    def _new_link(self, stats: Stats | None = None) -> BaseLink:
        if self.transport.remote:
            from servobus.remote.link import remote_link  # noqa: PLC0415 - most ports belong to this process

            return remote_link(
                self.transport,
                heard=self._heard,
                alarmed=self._servos.alarmed,
                stats=stats,
                priority=self.line.priority,
                contended=lambda: self.line.contended,
            )
        return Link(
            self._port,
            echo=self._echo,
            heard=self._heard,
            fences=self._fences,
            alarmed=self._servos.alarmed,
            stats=stats,
            contended=lambda: self.line.contended,
        )

    def _reopened(self) -> None:
        """Begin anew on a port that was opened again: nothing of the old one can come any more."""
        self.link.supersede()
        self.link = self._new_link(self.link.stats)

    # What the link asks of us

    def _fences(self, framing: Framing, id: int) -> Sequence[Exchange[Any]]:
        known = (servo.family for servo in self._servos)
        families = (family for some in (known, registry.FAMILIES.values()) for family in some)
        return next(family for family in families if family.framing is framing).fences(id)

    def _heard(self, exchange: Exchange[Any], packet: Packet) -> None:
        """Keep the alarms of a reply with the servo that sent it, at the speed in use."""
        if exchange.alarms is None:
            return
        baud = self.transport.baud
        for servo in self._servos:
            if servo.id == packet.id and servo.baud == baud and servo.family.framing is exchange.framing:
                self._servos.note_alarms(servo, exchange.alarms(packet))
