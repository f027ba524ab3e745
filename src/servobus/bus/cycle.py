"""A control cycle: goals out, readings in, for many servos at once and again and again.

    cycle = bus.cycle()
    print(cycle)                                    # what it will send, packet by packet
    for tick in cycle.every(0.01):
        seen = cycle.run({1: 90 * deg})
        print(seen[1]["present_position"], seen.lost)

Whatever does not change is made once: the questions, and where each value stands in the answers. Goals go out grouped,
and servos are read in blocks: by one request where their models answer such (BULK_READ of the MX series), else several
under way at once where the line allows.

A servo that does not answer is told in `lost`, and the others go on. It is asked again in the next cycle; if it is
silent then too, one of the silent is asked each RETRY, for silence costs time that the others need.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, TypeAlias, TypeVar

from servobus.bus.by_servo import Readings, name, pick
from servobus.bus.rate import Rate
from servobus.bus.servo import Servo
from servobus.core.arguments import check_mapping, one_or_several
from servobus.core.exchange import Batch, Exchange, Job, Now, Procedure, SetBaud, joined
from servobus.core.framing import BITS_PER_BYTE
from servobus.core.operation import Awaiting, Blocking, Priority, bus_method, urgent
from servobus.core.registers import Register, register_name
from servobus.core.units import finite, said, show
from servobus.core.values import frozen
from servobus.errors import BadValue, BusError, MotionError, NoReply, UnknownName, UsageError
from servobus.families.base import Family, MotionStatus, Reading, ServoRef
from servobus.families.motion import check_goal, no_torque
from servobus.jobs.move import keep_moving, raw_goal
from servobus.transports.base import Transport

T = TypeVar("T")

RETRY = 0.1
"""s between two questions to servos that stay silent."""


class Result(Readings[Servo, dict[str, Any]]):
    """What a cycle read: servo -> name -> value, in SI units. `lost` tells of the others: servo -> BusError."""

    def __init__(
        self, values: Mapping[Servo, dict[str, Any]], lost: Mapping[Servo, BusError], chain: Sequence[Servo]
    ) -> None:
        super().__init__(*({servo: one[servo] for servo in chain if servo in one} for one in (values, lost)))  # type: ignore[arg-type] # values, then errors
        self._chain = chain

    @property
    def diagnosis(self) -> str:
        """Say what the lost servos have in common; empty if none is lost."""
        ids = [servo.id for servo in self._chain]
        labels = {
            servo: servo.id if ids.count(servo.id) == 1 else f"{servo.id} ({name(servo)})" for servo in self._chain
        }
        return diagnose(list(labels.values()), [labels[servo] for servo in self.lost])


def diagnose(chain: Sequence[object], lost: Collection[object]) -> str:
    """Say where a chain of servos may be broken. `chain` are their ids in the order of the cable."""
    gone = [id for id in chain if id in lost]
    if not gone:
        return ""
    if len(gone) == len(chain):
        return "no servo answers: power, the adapter, or the cable to the first?"
    first = chain.index(gone[0])
    if len(gone) == 1:
        return f"id {gone[0]} alone does not answer: its plug or its power?"
    if gone == list(chain[first:]):
        before = chain[first - 1]
        return f"all after id {before} do not answer: cable or power between {before} and {gone[0]}?"
    ids = ", ".join(map(str, gone))
    return f"ids {ids} do not answer, others behind them do: their plugs, their power, or noise?"


class _Heard:
    """What one cycle hears, while it goes on."""

    def __init__(self) -> None:
        self.values: dict[Servo, dict[str, Any]] = {}
        self.lost: dict[Servo, BusError] = {}


@frozen
class _Value:
    """Where a value stands in a servo's answers, and what it means."""

    name: str
    answer: int
    part: slice
    unpack: Callable[[bytes], int]
    decode: Callable[[int], Any]


class _Part:
    """One servo's part in a cycle."""

    def __init__(self, servo: Servo, names: Sequence[str]) -> None:
        self.servo = servo
        self.target = servo.target
        rows = [_row(servo.target, name) for name in names]
        reading = servo.family.reading(servo.target, rows) if rows else Reading((), ())
        self.questions = reading.exchanges
        self.single = [question.no_retry() for question in self.questions]
        self.values = [
            _Value(name, answer, part, row.layout.unpacker(), row.decoder(self.target))
            for name, row, (answer, part, _) in zip(names, rows, reading.places, strict=True)
        ]
        self.motion_status: MotionStatus | None = None
        """What was read of it before its first goal."""
        self.modes = 0
        """What `ServoRecord.modes` was then."""
        self.position: float | None = None
        """Where it was in the last cycle, rad, if that was read."""

    def decode(self, answers: Sequence[bytes]) -> dict[str, Any]:
        """Give name -> value. Raises BadReading for what has no meaning."""
        seen = {}
        for value in self.values:
            seen[value.name] = value.decode(value.unpack(answers[value.answer][value.part]))
        self.position = seen.get("present_position")
        return seen


Question: TypeAlias = tuple[_Part, int, Exchange[bytes]]
"""Of whom something is asked, the number of the question among those to this servo, and the question."""


@frozen
class _Group:
    """Servos of one family and one speed."""

    family: Family
    baud: int
    parts: list[_Part]
    asked: list[Question]
    """What is asked of all of them."""


class Cycle:
    """A control cycle, prepared; see the head of this module.

    transport  the port
    servos     in the order of the cable, as far as that is known
    read       registers that all of them have, or their names
    write      ("goal_position",), or nothing
    time       s that the way to each goal takes, where the family has such a time (HerkuleX, LX-16A); 0 is as fast as
               possible. An RX-28 goes at its moving_speed, not at that of the last move

    Raises UnknownName for a register that a servo does not have, UsageError for a servo that cannot be read, BadValue
    for the time.
    """

    def __init__(
        self,
        transport: Transport,
        servos: Iterable[Servo],
        read: Iterable[Register[Any] | str] | Register[Any] | str,
        write: Iterable[Register[Any] | str] | Register[Any] | str,
        time: float,
    ) -> None:
        self.transport = transport
        self.servos = list(servos)
        self.read, self.write, self.time = _names(read), _names(write), time
        self._parts: dict[Servo, _Part] = {}
        self._silent: dict[Servo, BusError] = {}
        """Servos that did not answer last time; the one that waits longest for its turn is the first."""
        self._fresh: set[Servo] = set()
        """Those of them that have not been asked again yet."""
        self._next_try = 0.0
        self._prepare()

    def every(self, period: float) -> Rate:
        """Give turns at a fixed rate, `period` in s: `for tick in cycle.every(0.01)`; see `Rate`."""
        assert isinstance(self, Blocking | Awaiting)
        return Rate(self, self.transport.now, period)

    @bus_method
    @urgent(Priority.MOTION)
    def run(self, goals: Mapping[Any, float] | None = None) -> Procedure[Result]:
        """Send goals, servo or id -> angle in rad, and read all servos.

        All goals are checked before any is sent, `max_step` against what the last cycle read. Raises BadValue,
        UsageError for a servo in endless turn, TorqueOff where the torque is known to be off. Whether it is, and which
        limits are set, is read once, before the first goal. Goals feed the watchdog. Raises Stopped if nothing is to
        move now. Nothing is asked twice, unless of several that are asked together none answers: see `lost` of the
        result.
        """
        if any(part.servo.target is not part.target for part in self._parts.values()):
            self._prepare()  # another id, speed or way to answer
        heard = _Heard()
        raw = (yield from self._checked(goals, heard)) if goals else {}
        keep_moving(part.target for part in raw)
        for group in self._groups:
            yield SetBaud(group.baud)
            if sent := {part: goal for part, goal in raw.items() if part in group.parts}:
                yield from self._send(group, sent, heard)
            yield from self._ask(group, heard)
        return Result(heard.values, heard.lost, self.servos)

    def plan(self) -> str:
        """Say packet by packet what a cycle sends, how long that takes on the wire, and how often a second it can."""
        lines = []
        total = 0.0
        for group in self._groups:
            byte_time = BITS_PER_BYTE / group.baud
            out = back = 0
            rows = []
            for exchange in self._packets(group):
                sent, answered = len(exchange.request), exchange.reply_size
                out, back = out + sent, back + answered
                rows.append(
                    f"{sent:>6}{answered or '-':>6}{(sent + answered) * byte_time * 1e3:>8.2f}  {exchange.what}"
                )
            taken = byte_time * (max(out, back) if group.family.full_duplex else out + back)
            total += taken
            ways = ", both ways at once" if group.family.full_duplex else ""
            lines += [
                f"{group.family.title} at {group.baud}: {show(taken, 's')} of wire{ways}",
                f"{'out':>6}{'back':>6}{'ms':>8}",
                *rows,
            ]
        rate = f", at most {1 / total:.0f} a second" if total else ""
        return "\n".join([f"cycle of {len(self.servos)} servos: {total * 1e3:.2f} ms of wire{rate}", *lines])

    __str__ = plan

    # Preparing

    def _prepare(self) -> None:
        for servo in self.servos:
            for wanted in self.write:
                if _row(servo.target, wanted) is not servo.model.register("goal_position"):
                    raise UsageError(f"a cycle sends goal_position, not {wanted}; write_many() writes other registers")
        if not self.read and not self.write:
            raise UsageError("a cycle without registers to read or write does nothing")
        if twice := next((servo for servo in self.servos if self.servos.count(servo) > 1), None):
            raise UsageError(f"{twice.target} is named twice")
        old = self._parts
        self._parts = {servo: _Part(servo, self.read) for servo in self.servos}
        for servo, part in self._parts.items():
            if servo in old:
                part.motion_status, part.modes = old[servo].motion_status, old[servo].modes
        groups: dict[tuple[str, int], list[_Part]] = {}
        for part in self._parts.values():
            groups.setdefault((part.servo.family.name, part.servo.baud), []).append(part)
            longest = part.target.model.max_move_time
            longest = math.inf if longest is None else longest
            time = finite(self.time)
            if time is None or not 0 <= time <= longest:
                raise BadValue(f"{part.target}: a move cannot take {said(self.time)} s")
        self._groups = [
            _Group(parts[0].servo.family, parts[0].servo.baud, parts, _questions(parts)) for parts in groups.values()
        ]

    def _packets(self, group: _Group) -> list[Exchange[Any]]:
        goals: list[Exchange[Any]] = []
        if self.write:
            lowest: dict[ServoRef, int] = {
                part.target: part.target.model.register("goal_position").limits[0] for part in group.parts
            }
            goals += group.family.goals(lowest, self.time)
        packets = goals
        for _, turn in groupby(group.asked, key=lambda question: question[1]):
            questions = [question for *_, question in turn]
            groups = joined(questions)
            together = [part for one in groups for part in one.parts]
            packets += [*groups, *(question for question in questions if question not in together)]
        return packets

    # Goals

    def _checked(self, goals: Mapping[Any, float], heard: _Heard) -> Procedure[dict[_Part, int]]:
        """Give raw goals, less those of servos that do not answer."""
        if not self.write:
            raise UsageError('this cycle only reads; prepare it with write=("goal_position",)')
        raw: dict[_Part, int] = {}
        for key, angle in check_mapping("goals", goals, "{1: 90 * deg}").items():
            part = self._parts.get(key) or self._parts[pick(self._parts, key, where="in this cycle")]
            if part in raw:
                raise UsageError(f"{part.target} is given two goals, by itself and by its id")
            raw[part] = raw_goal(part.target, angle)
        for part in list(raw):
            try:
                modes = part.target.record.modes
                if part.motion_status is None or part.modes != modes:
                    yield SetBaud(part.servo.baud)
                    part.modes = modes
                    part.motion_status = yield from part.servo.family.motion_status(part.target)
                yield from self._check(part, part.motion_status, raw[part])
            except NoReply as error:
                heard.lost[part.servo] = error
                del raw[part]
        return raw

    def _check(self, part: _Part, motion_status: MotionStatus, raw: int) -> Procedure[None]:
        """Refuse a goal that this servo would not follow, or must not."""
        target, row = part.target, part.target.model.register("goal_position")
        record, permit, enable = target.record, target.permit, target.model.register("torque_enable")
        torque = motion_status.torque
        if enable in record.ram and not motion_status.shutdown:
            torque = target.model.family.torque_on(record.ram[enable])
        try:
            if record.restarted or not torque:
                raise no_torque(target, motion_status.shutdown)
            check_goal(target, motion_status, raw, step=False)
        except (MotionError, UsageError):
            part.motion_status = None  # another program, or the next call, may change it
            raise
        if record.lent:
            yield SetBaud(part.servo.baud)
            yield from target.model.family.give_back(target)
        if permit.max_step is not None:
            here = part.position
            if here is None:
                yield SetBaud(part.servo.baud)
                present = target.model.register("present_position")
                (found,) = yield from target.model.family.read(target, [present])
                here = present.decode(found)
            permit.check_step(str(target), abs(row.decode(raw) - here) * motion_status.shaft)

    def _send(self, group: _Group, goals: Mapping[_Part, int], heard: _Heard) -> Procedure[None]:
        raw: dict[ServoRef, int] = {part.target: goal for part, goal in goals.items()}
        for part, goal in goals.items():
            part.target.record.goal = goal
        try:
            yield from group.family.goals(raw, self.time)
        except BusError as error:  # the line was not quiet, or its echo broken
            heard.lost.update({part.servo: error for part in goals})

    # Readings

    def _ask(self, group: _Group, heard: _Heard) -> Procedure[None]:
        asked = group.asked
        if self._silent:
            asked = [question for question in asked if question[0].servo not in self._silent]
        # Where speeds change servos may have taken what others were told for the start of a packet.
        again = len(self._groups) > 1 and len({group.baud for group in self._groups}) > 1
        came = (yield Batch([question for *_, question in asked], again=again)) if asked else []
        answers: dict[_Part, list[Any]] = {}
        for (part, _, _), answer in zip(asked, came, strict=True):
            answers.setdefault(part, []).append(answer)
        if self._silent:
            yield from self._ask_silent(group, heard)
        for part, found in answers.items():
            self._take(part, found, heard)
        for servo, error in self._silent.items():
            if self._parts[servo] in group.parts:
                heard.lost[servo] = error

    def _ask_silent(self, group: _Group, heard: _Heard) -> Procedure[None]:
        """Ask those that were silent last time, until one still is: then the others wait for their turn."""
        due = (yield Now()) >= self._next_try
        for servo in list(self._silent):
            part = self._parts[servo]
            if part not in group.parts or not (due or servo in self._fresh):
                continue
            answers: list[Any] = []
            try:
                for question in part.single:
                    answers += [(yield question)]
            except BusError as error:
                answers = [error]
            del self._silent[servo]  # and to the end, if it still is silent
            self._take(part, answers, heard)
            if servo in self._silent:
                self._fresh.clear()
                self._next_try = (yield Now()) + RETRY
                return

    def _take(self, part: _Part, answers: Sequence[Any], heard: _Heard) -> None:
        """Put what a servo answered into the result."""
        error = next((answer for answer in answers if isinstance(answer, BusError)), None)
        if error is None:
            self._fresh.discard(part.servo)
            try:
                heard.values[part.servo] = part.decode(answers)
            except BusError as meaningless:
                heard.lost[part.servo] = meaningless
            return
        part.position = None
        self._silent[part.servo] = error
        self._fresh.add(part.servo)


class BusCycle(Blocking, Cycle):
    """A cycle on a blocking bus."""

    def __init__(self, bus: Blocking, *args: Any) -> None:
        self._bus = bus
        super().__init__(*args)

    def do(self, job: Job[T], *, priority: Priority = Priority.READ) -> T:
        result: T = self._bus.do(job, priority=priority)
        return result


class AsyncBusCycle(Awaiting, Cycle):
    """A cycle on an asynchronous bus: `await cycle.run(...)`, `async for tick in cycle.every(...)`."""

    def __init__(self, bus: Awaiting, *args: Any) -> None:
        self._bus = bus
        super().__init__(*args)

    async def do(self, job: Job[T], *, priority: Priority = Priority.READ) -> T:
        result: T = await self._bus.do(job, priority=priority)
        return result


def _questions(parts: Sequence[_Part]) -> list[Question]:
    """Give the first question to each servo, then the second to each, and so on: no servo is asked twice in a row."""
    most = max((len(part.questions) for part in parts), default=0)
    return [(part, n, part.questions[n]) for n in range(most) for part in parts if n < len(part.questions)]


def _names(registers: Iterable[Register[Any] | str] | Register[Any] | str) -> tuple[str, ...]:
    """Give the names of registers: one of a model stands for that of the same name on all."""
    several = one_or_several(registers, lambda thing: isinstance(thing, Register))
    return tuple(register_name(row) for row in several)


def _row(target: ServoRef, name: str) -> Register[Any]:
    try:
        return target.model.register(name)
    except UnknownName as error:
        raise UnknownName(f"{target}: {error}") from None
