"""A control cycle: goals out, readings in, for many servos at once and again and again.

    cycle = bus.cycle()
    print(cycle)                                    # what it will send, packet by packet
    for tick in cycle.every(0.01):
        seen = cycle.run({1: 90 * deg})
        print(seen[1]["present_position"], seen.lost)

Whatever does not change is made once: the questions, and where each value stands in the answers. Goals go out grouped,
and servos are read in blocks, several under way at once where the line allows.

A servo that does not answer is told in `lost`, and the others go on. It is asked again in the next cycle; if it is
silent then too, one of the silent is asked each RETRY, for silence costs time that the others need.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus.rate import Rate
from servobus.bus.servo import Servo
from servobus.core.exchange import Batch, Exchange, Job, Procedure, SetBaud
from servobus.core.operation import Awaiting, Blocking, bus_method
from servobus.core.registers import Register
from servobus.core.units import show
from servobus.core.values import frozen
from servobus.errors import BadValue, BusError, NoReply, TorqueOff, UnknownName, UsageError
from servobus.families.base import Family, MotionStatus, Reading, ServoRef
from servobus.jobs.move import keep_moving, raw_goal
from servobus.link.line_clock import BITS_PER_BYTE
from servobus.transports.base import Transport

T = TypeVar("T")

RETRY = 0.25
"""s between two questions to servos that stay silent."""


class Result(dict[int, dict[str, Any]]):
    """What a cycle read: id -> name -> value, in SI units. `lost` tells of the others: id -> BusError."""

    def __init__(self, chain: Sequence[int]) -> None:
        super().__init__()
        self.lost: dict[int, BusError] = {}
        self._chain = chain

    @property
    def diagnosis(self) -> str:
        """Say what the lost servos have in common; empty if none is lost."""
        return diagnose(self._chain, self.lost)


def diagnose(chain: Sequence[int], lost: Collection[int]) -> str:
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


@frozen
class _Value:
    """Where a value stands in a servo's answers, and what it means."""

    name: str
    answer: int
    part: slice
    row: Register[Any]


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
            _Value(name, answer, part, row)
            for name, row, (answer, part, _) in zip(names, rows, reading.places, strict=True)
        ]
        self.motion_status: MotionStatus | None = None
        """What was read of it before its first goal."""
        self.position: float | None = None
        """Where it was in the last cycle, rad, if that was read."""

    def decode(self, answers: Sequence[bytes]) -> dict[str, Any]:
        """Give name -> value. Raises BusError for what has no meaning."""
        seen = {}
        for value in self.values:
            raw = value.row.layout.unpack(answers[value.answer][value.part])
            try:
                seen[value.name] = value.row.decode(raw)
            except ValueError:
                raise BusError(f"{self.target}: {value.row.name} is raw {raw}, which has no known meaning") from None
        self.position = seen.get("present_position")
        return seen


@frozen
class _Group:
    """Servos of one family and one speed."""

    family: Family
    baud: int
    parts: list[_Part]


class Cycle:
    """A control cycle, prepared; see the head of this module.

    transport  the port
    servos     in the order of the cable, as far as that is known
    read       names of registers that all of them have
    write      ("goal_position",), or nothing
    time       s that the way to each goal takes, where the family has such a time (HerkuleX, LX-16A); 0 is as fast as
               possible. An RX-28 goes at its moving_speed

    Raises UnknownName for a register that a servo does not have, UsageError for a servo that cannot be read, BadValue
    for the time.
    """

    def __init__(
        self, transport: Transport, servos: Iterable[Servo], read: Iterable[str], write: Iterable[str], time: float
    ) -> None:
        self.transport = transport
        self.servos = list(servos)
        self.read, self.write, self.time = tuple(read), tuple(write), time
        self._chain = [servo.id for servo in self.servos]
        self._silent: dict[int, BusError] = {}
        """Servos that did not answer last time; the one that waits longest for its turn is the first."""
        self._fresh: set[int] = set()
        """Those of them that have not been asked again yet."""
        self._next_try = 0.0
        self._prepare()

    def every(self, period: float) -> Rate:
        """Give turns at a fixed rate, `period` in s: `for tick in cycle.every(0.01)`; see `Rate`."""
        assert isinstance(self, Blocking | Awaiting)
        return Rate(self, self.transport, period)

    @bus_method
    def run(self, goals: Mapping[int, float] | None = None) -> Procedure[Result]:
        """Send goals, id -> angle in rad, and read all servos.

        All goals are checked before any is sent, `max_step` against what the last cycle read. Raises BadValue,
        UsageError for a servo in endless turn, TorqueOff where the torque is known to be off. Whether it is, and which
        limits are set, is read once, before the first goal. Goals feed the watch. Raises Stopped if nothing is to move
        now. Nothing is asked twice: see `lost` of the result.
        """
        if any(part.servo.target is not part.target for part in self._parts.values()):
            self._prepare()  # another id, speed or way to answer
        result = Result(self._chain)
        raw = (yield from self._checked(goals, result)) if goals else {}
        keep_moving(self._parts[id].target for id in raw)
        for group in self._groups:
            yield SetBaud(group.baud)
            if sent := {part.target: raw[id] for id in raw if (part := self._parts[id]) in group.parts}:
                yield from self._send(group, sent, result)
            yield from self._ask(group, result)
        return result

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
            for name in self.write:
                if _row(servo.target, name) is not servo.model.register("goal_position"):
                    raise UsageError(f"a cycle sends goal_position, not {name}; write_many() writes other registers")
        if not self.read and not self.write:
            raise UsageError("a cycle without registers to read or write does nothing")
        old = getattr(self, "_parts", {})
        self._chain = [servo.id for servo in self.servos]
        self._parts = {servo.id: _Part(servo, self.read) for servo in self.servos}
        if len(self._parts) < len(self.servos):
            twice = next(id for id in self._chain if self._chain.count(id) > 1)
            raise UsageError(f"id {twice} is named twice, or two servos have it")
        for id, part in self._parts.items():
            if id in old:
                part.motion_status = old[id].motion_status
        for id in set(self._silent) - self._parts.keys():
            del self._silent[id]
        groups: dict[tuple[str, int], _Group] = {}
        for part in self._parts.values():
            family, baud = part.servo.family, part.servo.baud
            groups.setdefault((family.name, baud), _Group(family, baud, [])).parts.append(part)
            longest = math.inf if family.max_move_time is None else family.max_move_time
            if not 0 <= self.time <= longest or self.time == math.inf:
                raise BadValue(f"{part.target}: a move cannot take {self.time} s")
        self._groups = list(groups.values())

    def _packets(self, group: _Group) -> list[Exchange[Any]]:
        goals: list[Exchange[Any]] = []
        if self.write:
            lowest = {part.target: part.target.model.register("goal_position").limits[0] for part in group.parts}
            goals += group.family.goals(lowest, self.time)
        return goals + [question for _, _, question in _questions(group.parts)]

    # Goals

    def _checked(self, goals: Mapping[int, float], result: Result) -> Procedure[dict[int, int]]:
        """Give raw goals, less those of servos that do not answer."""
        if not self.write:
            raise UsageError('this cycle only reads; prepare it with write=("goal_position",)')
        if unknown := goals.keys() - self._parts.keys():
            known = ", ".join(map(str, self._chain))
            raise UnknownName(f"id {min(unknown)} is not in this cycle (in it: {known})")
        raw = {id: raw_goal(self._parts[id].target, angle) for id, angle in goals.items()}
        for id in list(raw):
            part = self._parts[id]
            try:
                if part.motion_status is None:
                    yield SetBaud(part.servo.baud)
                    part.motion_status = yield from part.servo.family.motion_status(part.target)
                yield from self._check(part, part.motion_status, raw[id])
            except NoReply as error:
                result.lost[id] = error
                del raw[id]
        return raw

    def _check(self, part: _Part, motion_status: MotionStatus, raw: int) -> Procedure[None]:
        """Refuse a goal that this servo would not follow, or must not."""
        target, notes, row = part.target, part.servo.notes, part.target.model.register("goal_position")
        enable = target.model.register("torque_enable")
        torque = target.model.family.torque_on(notes.ram[enable]) if enable in notes.ram else motion_status.torque
        if notes.restarted or not torque:
            part.motion_status = None  # somebody may switch it on without our knowing
            raise TorqueOff(f"{target}: torque is off, so nothing would move; switch it on first")
        if motion_status.turning:
            part.motion_status = None
            raise UsageError(f"{target} turns without end; position_mode() ends that")
        if not motion_status.low <= raw <= motion_status.high:
            part.motion_status = None  # they may be changed
            low, high = row.show(row.decode(motion_status.low)), row.show(row.decode(motion_status.high))
            raise BadValue(f"{target}: {row.show(row.decode(raw))} is outside the limits set in it, {low} .. {high}")
        if notes.max_step is not None:
            here = part.position
            if here is None:
                yield SetBaud(part.servo.baud)
                present = target.model.register("present_position")
                (found,) = yield from target.model.family.read(target, [present])
                here = present.decode(found)
            notes.check_step(str(target), abs(row.decode(raw) - here))

    def _send(self, group: _Group, goals: Mapping[ServoRef, int], result: Result) -> Procedure[None]:
        try:
            yield from group.family.goals(goals, self.time)
        except BusError as error:  # the line was not quiet, or its echo broken
            result.lost.update({target.id: error for target in goals})

    # Readings

    def _ask(self, group: _Group, result: Result) -> Procedure[None]:
        asked = _questions([part for part in group.parts if part.target.id not in self._silent])
        # Where speeds change servos may have taken what others were told for the start of a packet.
        again = len({group.baud for group in self._groups}) > 1
        heard = (yield Batch([question for *_, question in asked], again=again)) if asked else []
        answers: dict[_Part, list[Any]] = {}
        for (part, _, _), answer in zip(asked, heard, strict=True):
            answers.setdefault(part, []).append(answer)
        yield from self._ask_silent(group, result)
        for part, found in answers.items():
            self._take(part, found, result)
        for id, error in self._silent.items():
            if self._parts[id] in group.parts:
                result.lost[id] = error

    def _ask_silent(self, group: _Group, result: Result) -> Procedure[None]:
        """Ask those that were silent last time, until one still is: then the others wait for their turn."""
        due = self.transport.now() >= self._next_try
        for id in list(self._silent):
            part = self._parts[id]
            if part not in group.parts or not (due or id in self._fresh):
                continue
            answers: list[Any] = []
            try:
                for question in part.single:
                    answers += [(yield question)]
            except BusError as error:
                answers = [error]
            del self._silent[id]  # and to the end, if it still is silent
            self._take(part, answers, result)
            if id in self._silent:
                self._fresh.clear()
                self._next_try = self.transport.now() + RETRY
                return

    def _take(self, part: _Part, answers: Sequence[Any], result: Result) -> None:
        """Put what a servo answered into the result."""
        id = part.target.id
        error = next((answer for answer in answers if isinstance(answer, BusError)), None)
        if error is None:
            self._fresh.discard(id)
            try:
                result[id] = part.decode(answers)
            except BusError as meaningless:
                result.lost[id] = meaningless
            return
        part.position = None
        self._silent[id] = error
        self._fresh.add(id)


class BusCycle(Blocking, Cycle):
    """A cycle on a blocking bus."""

    def __init__(self, bus: Blocking, *args: Any) -> None:
        self._bus = bus
        super().__init__(*args)

    def do(self, job: Job[T]) -> T:
        return self._bus.do(job)


class AsyncBusCycle(Awaiting, Cycle):
    """A cycle on an asynchronous bus: `await cycle.run(...)`, `async for tick in cycle.every(...)`."""

    def __init__(self, bus: Awaiting, *args: Any) -> None:
        self._bus = bus
        super().__init__(*args)

    async def do(self, job: Job[T]) -> T:
        return await self._bus.do(job)


def _questions(parts: Sequence[_Part]) -> list[tuple[_Part, int, Exchange[bytes]]]:
    """Give the first question to each servo, then the second to each, and so on: no servo is asked twice in a row."""
    most = max((len(part.questions) for part in parts), default=0)
    return [(part, n, part.questions[n]) for n in range(most) for part in parts if n < len(part.questions)]


def _row(target: ServoRef, name: str) -> Register[Any]:
    try:
        return target.model.register(name)
    except UnknownName as error:
        raise UnknownName(f"{target}: {error}") from None
