"""What every family of servos can do, whatever its bytes look like.

A `Family` builds exchanges and procedures; it performs none. Verbs that all families share are methods
here. What only one family can do is a function in its own module, under its manual's name.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

from servobus.core.exchange import Exchange, Now, Pause, Procedure, ReplyPattern, told
from servobus.core.framing import Framing, Packet
from servobus.core.registers import Area, Int, Register
from servobus.core.units import deg, finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue, BusError, NoReply, ServobusError, UsageError
from servobus.families.change import before_told, check_pairs, pairs_touched
from servobus.families.model import Model, Performance, SpecSheet
from servobus.families.motion import (
    AxisMove,
    MotionStatus,
    TorqueState,
    begin_motion,
    check_awake,
    check_hold,
    check_inside,
    movement,
    no_torque,
)
from servobus.families.target import Answers, KnownServo, ServoRef

__all__ = [
    "LIMP",
    "TRIES",
    "TURNS_NO_MORE",
    "Answers",
    "AxisMove",
    "Family",
    "Identity",
    "KnownServo",
    "Model",
    "MotionStatus",
    "Performance",
    "Reading",
    "ServoRef",
    "SpecSheet",
    "StopOutcome",
    "TorqueState",
    "adjacent",
    "blocks",
    "cannot",
    "check_output",
    "fetch",
    "policy_register",
    "require_model",
    "require_turning",
    "within",
]

T = TypeVar("T")

TELL_MODEL = "say which it is: --model MODEL, models={id: MODEL} or attach(MODEL, id)"
"""The remedy for a servo whose model is not known."""
ASK_AGAIN = 0.02
"""s between two questions to a servo that does not answer yet."""
TRIES = 3
"""Times that a servo is told to stop, or to let go, before something else is done about it."""
ANSWERED = 0.005
"""s in which a servo has answered what was only told; assumption, at 57600 baud and more."""
SLACK = 2 * deg
"""Way to the nearer limit that a stop may make a servo go; assumption: about what a loaded shaft gives way."""


@frozen
class Identity:
    """What a servo says about itself when asked."""

    number: int | None
    firmware: str
    answers: Answers


@frozen
class StopOutcome:
    """What a stop did with a servo."""

    text: str
    """In words: "held at 201.5°", "let go: ..."."""
    let_go: bool = False
    """Whether its torque is off now, so that its shaft turns freely."""

    def __str__(self) -> str:
        return self.text


LIMP = StopOutcome("it drives nothing: its torque was off", let_go=True)
TURNS_NO_MORE = StopOutcome("it turns no more")


@frozen
class Reading:
    """Registers to read: what is asked for them, and where each stands in the answers."""

    exchanges: tuple[Exchange[bytes], ...]
    places: tuple[tuple[int, slice, Int], ...]
    """Of each register: which answer, which of its bytes, how they are laid out."""

    def values(self, answers: Sequence[bytes]) -> list[int]:
        """Give the raw values, in the order of the registers."""
        return [layout.unpack(answers[n][part]) for n, part, layout in self.places]


class Family(ABC):
    """One family of servos: its packets and its verbs. Stateless; one instance serves all."""

    name: ClassVar[str]
    title: ClassVar[str]
    framing: ClassVar[Framing]
    full_duplex: ClassVar[bool] = False
    eeprom_time: ClassVar[float] = 0.0
    """s for which a servo hears nothing after each byte that was written to its EEPROM, as far as that is known."""
    patience: ClassVar[float] = 1.0
    """s for which a servo is asked until it answers, after a write to its EEPROM, a reset or a restart. Assumption:
    twice as long as any was seen to need."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of the registers that the verbs of this family rely on, beside those that every model has."""
    one_table: ClassVar[bool] = False
    """Whether the registers of all its models are the same, so that values can be told without knowing the model."""
    torque_returns: ClassVar[bool] = False
    """Whether a torque that an alarm has switched off comes back by itself when that is over."""
    keepable: ClassVar[tuple[str, ...]] = ()
    """What `reset` can leave alone: some of "id", "baud" and "calibration"."""
    driven: ClassVar[int] = 1
    """Raw value of torque_enable with which the servo is driven."""
    torque_rows: ClassVar[tuple[str, ...]] = ("torque_enable",)
    """Names of the registers that decide whether it is driven; see `torque_state`."""
    holds_outside_limits: ClassVar[bool] = False
    """Whether a servo whose torque comes on outside its limits holds where it is, and does not run to them."""
    limits_turn: ClassVar[bool] = False
    """Whether limits that are both 0 are endless turn."""

    def check_model(self, model: type[Model]) -> None:  # noqa: B027 - most families ask no more of a table
        """Raise TypeError for a table that the verbs of this family cannot use, when its class is made."""

    # Who is there

    @abstractmethod
    def ping(self, id: int) -> Exchange[None]:
        """Ask whether a servo is there."""

    @abstractmethod
    def identify(self, id: int) -> Procedure[Identity]:
        """Ask a servo who it is. Raises NoReply if none answers."""

    @abstractmethod
    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        """Give harmless questions, at least three, none of whose answers can be mistaken for another's.

        The first is one that every servo answers, whatever it is set to.
        """

    # Registers, raw

    @abstractmethod
    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        """Tell what to ask for these registers: as few exchanges as the family allows."""

    def read(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read raw values."""
        return fetch(self.reading(target, registers))

    def write(self, target: KnownServo, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they act at once, in as few exchanges as the family allows.

        What lives in EEPROM is read first, and written only if it differs. Raises EepromWear if that was done too
        often lately, UsageError if the servo has locked it. What moves the servo obeys the rules of moves, see
        `servobus.families.motion`; torque comes on as with `torque`.
        """
        yield from self._write_moving(target, values, keep=False)

    def store(self, target: KnownServo, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they survive power-off, if they differ from what is there; see `write`."""
        for register in values:
            if not self.wears(register, keep=True):
                raise UsageError(
                    f"{register.model} {register.name} lives in RAM and is not saved: it is lost at power-off"
                )
        yield from self._write_moving(target, values, keep=True)

    def _write_moving(self, target: KnownServo, values: Mapping[Register[Any], int], *, keep: bool) -> Procedure[None]:
        """Write what may move the servo, by the rules of moves."""
        torque = target.model.register("torque_enable")
        waking = torque in values and self.torque_on(values[torque])
        others = {row: raw for row, raw in values.items() if row is not torque or not (waking or raw == 0)}
        if torque in values and values[torque] == 0:
            yield from self.let_go(target)
        if others:
            if (yield from movement(target, others)) is not None:
                begin_motion(target)
            if target.model.register("goal_position") in others:  # what a move has set for itself is not for this goal
                others = target.record.lent | others
            yield from self._set(target, others, keep=keep)
        if waking:
            yield from self.torque(target, on=True)

    @abstractmethod
    def put(
        self, target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool, same: Collection[Register[Any]] = ()
    ) -> Procedure[None]:
        """Write raw values as they are: with `keep` for good, else for now.

        `same` are registers whose EEPROM has the value already: it is not written there again.
        """

    def wears(self, register: Register[Any], *, keep: bool) -> bool:  # noqa: ARG002 - HerkuleX keeps some twice
        """Tell whether writing this register, for good or for now, goes to the EEPROM."""
        return register.area is Area.EEPROM

    def stored_is_told(self, register: Register[Any]) -> bool:  # noqa: ARG002 - one register cannot
        """Tell whether what `read_stored` gives for this register is what survives power-off."""
        return True

    def await_eeprom(self, target: ServoRef, size: int) -> Procedure[None]:
        """Wait until a servo hears again of which `size` bytes of EEPROM were written just now. Raises NoReply."""
        if self.eeprom_time:
            yield Pause(size * self.eeprom_time)
        yield from self.await_answer(target, "a write to its EEPROM")

    def await_answer(self, target: ServoRef, after: str) -> Procedure[None]:
        """Ask until a servo answers, `patience` s at most. Raises the last error, which says after what that was."""
        began: float = yield Now()
        while True:
            try:
                yield from self.ping(target.id).no_retry()
            except BusError as error:
                if (yield Now()) - began >= self.patience:
                    said = f"{target} does not answer within {self.patience:g} s after {after}: is it powered?"
                    raise NoReply(f"{said} ({error})") from error
                yield Pause(ASK_AGAIN)
            else:
                return

    def _set(self, target: KnownServo, values: Mapping[Register[Any], int], *, keep: bool = False) -> Procedure[None]:
        """Write with care for EEPROM and record, and without asking what it moves: for verbs that see to that.

        Every write of registers but `put` and what stops a servo comes through here.
        """
        record = target.record
        yield from self._check_limits(target, values, keep=keep)
        worn = [register for register in values if self.wears(register, keep=keep)]
        before: dict[Register[Any], int] = {}
        if worn and target.answers is not Answers.NOTHING:  # what cannot be read cannot be compared
            before = dict(zip(worn, (yield from self.read_stored(target, worn)), strict=True))
        same = frozenset(row for row, raw in before.items() if raw == values[row] and self.stored_is_told(row))
        fresh = [register for register in worn if register not in same]
        if fresh:
            record.check_wear(str(target), fresh)
            yield from self._check_unlocked(target, fresh)
        in_ram = {register: raw for register, raw in values.items() if not register.volatile and register.acts_in_ram}
        record.forget(in_ram)  # until it is known that they arrived
        for register in values:
            record.lent.pop(register, None)
        try:
            with before_told({row: before[row] for row in fresh if row in before}):
                for part in _policy_last(target.model, values):
                    yield from self.put(target, part, keep=keep, same=same)
        except ServobusError:
            record.wrote(fresh)  # they may have arrived
            raise
        record.wrote(fresh)
        record.set(in_ram)
        torque = target.model.register("torque_enable")
        if torque in values and self.torque_on(values[torque]):
            record.restarted = False

    def _check_limits(self, target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool) -> Procedure[None]:
        """Refuse limits that would cross those beside which they are written, or which the servo has. Raises BadValue.

        What a servo that answers nothing has cannot be known, and is not compared.
        """
        pairs = pairs_touched(target.model, values)
        others = [row for pair in pairs for row in pair.rows(target.model) if row not in values]
        if others and target.answers is not Answers.NOTHING:
            have = yield from (self.read_stored if keep else self.read)(target, others)
            values = {**values, **dict(zip(others, have, strict=True))}
        check_pairs(target.model, values, str(target))

    def _check_unlocked(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[None]:  # noqa: ARG002
        """Raise UsageError if the servo has locked its EEPROM. Most families have no lock."""
        yield from ()

    def read_stored(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read the values that survive power-off, where they can differ from those that act now."""
        return self.read(target, registers)

    # Motion

    @abstractmethod
    def motion_status(self, target: ServoRef) -> Procedure[MotionStatus]:
        """Read what a move must know."""

    def torque_state(self, values: Mapping[str, Any]) -> TorqueState:
        """Tell whether the servo is driven from the values, by name, of the `torque_rows`."""
        return TorqueState(bool(values["torque_enable"]))

    def read_torque(self, target: ServoRef) -> Procedure[TorqueState]:
        """Read whether the servo is driven."""
        return self.torque_state((yield from self.read_values(target, self.torque_rows)))

    def read_values(self, target: ServoRef, names: Iterable[str]) -> Procedure[dict[str, int]]:
        """Read raw values by the names of their registers."""
        rows = {name: target.model.register(name) for name in names}
        return dict(zip(rows, (yield from self.read(target, list(rows.values()))), strict=True))

    def check_axis(self, axis: AxisMove) -> None:  # noqa: B027 - most families have nothing to add
        """Raise BadValue for a leg that this family cannot do, beyond what limits and times tell."""

    @abstractmethod
    def start_moves(self, axes: Sequence[AxisMove]) -> Procedure[None]:
        """Start all legs together."""

    @abstractmethod
    def goals(self, goals: Mapping[ServoRef, int], time: float) -> list[Exchange[None]]:
        """Give what sends raw goals to servos, in as few packets as the family allows; nothing answers.

        They act as soon as the last has arrived. `time` in s is what the way takes, where moves have a time; 0 is as
        fast as possible.
        """

    @abstractmethod
    def moving(self, target: ServoRef) -> Procedure[bool]:
        """Tell whether the servo still moves towards its goal."""

    def stop(self, target: KnownServo) -> Procedure[StopOutcome]:
        """End the motion, whatever state the servo is in: hold it where it is, or let go of it.

        It is held by `hold`. Where that fails, for an answer is lost, makes no sense or says no, its torque is switched
        off. Raises BusError only if nothing shows that this has arrived: then the servo may still move.
        """
        try:
            return (yield from self.hold(target))
        except (BusError, ValueError) as error:
            why = str(error)
        yield from self.let_go(target)
        return StopOutcome(f"let go, its torque is off: it could not be held ({why})", let_go=True)

    @abstractmethod
    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        """End the motion and hold the present position, or the nearest one that its limits allow; see `reachable`.

        Makes sure that it was heard. Not subject to `max_step`, nor recorded. Raises BusError, or UsageError for a
        servo that answers no reads; `stop` goes on from there.
        """

    def let_go(self, target: KnownServo) -> Procedure[None]:
        """Switch the torque off without asking anything first, again and again until it is known to be off.

        Of a servo that answers no reads it is only made sure that it is there. Raises BusError if its torque may still
        be on.
        """
        torque = target.model.register("torque_enable")
        target.record.forget([torque])
        error: BusError | None = None
        for attempt in range(TRIES):
            try:
                if attempt == 0:
                    yield from self.put(target, {torque: 0}, keep=False)
                    if target.answers is Answers.EVERYTHING:
                        break
                else:
                    # What is answered waits for a quiet line, and for old answers; what is only told does not.
                    yield from told(self.put(target, {torque: 0}, keep=False))
                    yield Pause(ANSWERED)
                if target.answers is not Answers.NOTHING:
                    (raw,) = yield from self.read(target, [torque])
                    if not self.torque_on(raw):
                        break
                    error = BusError(f"{target}: its torque is still on")
            except BusError as trouble:
                error = trouble
        else:
            if target.answers is Answers.NOTHING:
                yield from self.ping(target.id)
            elif error is not None:
                raise error
        target.record.set({torque: 0})

    def reachable(self, target: ServoRef, status: MotionStatus) -> int | None:
        """Give the raw goal that holds a servo where it is.

        Outside its limits that is the nearer limit; None if that is farther off than SLACK, for it would move.
        """
        row = target.model.register("goal_position")
        here = row.scale.encode(status.position)
        goal = min(max(here, status.low), status.high)
        return goal if abs(row.decode(goal) - row.decode(here)) <= SLACK else None

    def outside(self, target: KnownServo, status: MotionStatus) -> Procedure[StopOutcome]:
        """Let go of a servo that cannot be held because it stands outside its limits."""
        row = target.model.register("goal_position")
        yield from self.let_go(target)
        where, low, high = (row.show(angle) for angle in (status.position, *map(row.decode, (status.low, status.high))))
        return StopOutcome(f"let go, its torque is off: it stood at {where}, outside its limits {low} .. {high}", True)

    def torque(self, target: KnownServo, on: bool) -> Procedure[None]:
        """Switch torque. With it nothing moves: goal := present position first. One that has it is left as it is.

        Raises TorqueOff if the servo keeps its torque off, OutsideLimits if it would run to the nearest limit, BusError
        if its torque did not come on.
        """
        if not on:
            yield from self.let_go(target)
            return
        target.permit.ask()
        motion_status = yield from self.motion_status(target)
        check_hold(target, motion_status)
        target.permit.mark_moving()
        if not motion_status.torque:
            yield from self.settle(target, motion_status)
        yield from self.switch_on(target, motion_status)

    def switch_on(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Switch the torque on, whatever goal stands in the servo, and make sure that it is; see `torque`."""
        for _ in range(2):  # what is not answered may be lost
            yield from self._drive(target, motion_status)
            state = yield from self.read_torque(target)
            if state.on:
                return
        if state.shutdown:
            raise no_torque(target, state.shutdown)
        raise BusError(f"{target}: the torque did not come on")

    def _drive(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:  # noqa: ARG002 - see HerkuleX
        """Tell a servo to switch its torque on."""
        yield from self._set(target, {target.model.register("torque_enable"): self.driven})

    def borrow(self, target: KnownServo) -> Procedure[None]:
        """Note what the speed, or time, of moves is in the servo, before a move sets its own."""
        row = target.model.optional("goal_speed") or target.model.optional("goal_time")
        if row is not None and row not in target.record.lent:
            (target.record.lent[row],) = yield from self.read(target, [row])

    def give_back(self, target: KnownServo) -> Procedure[None]:
        """Set the speed, or time, of moves again that `borrow` noted, if that moves nothing."""
        if target.record.lent:
            yield from self._set(target, dict(target.record.lent))

    @abstractmethod
    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Make the present position the goal, and 0 the speed of endless turn, so that nothing goes on from here.

        The servo stands within its limits, or holds outside of them by itself. Raises BusError if it did not take that:
        with torque it might run to another goal.
        """

    def brake(self, target: KnownServo) -> Procedure[None]:
        """Short the motor. Raises UsageError where the family cannot, BusError if nothing shows that it did."""
        yield from ()  # a procedure without steps
        raise cannot(target, "brake", "nothing in it shorts the motor; hold or free it")

    @abstractmethod
    def push(self, target: ServoRef) -> Procedure[float]:
        """Read how hard the servo pushes, as a share 0 .. 1 of the output that it is allowed now."""

    @abstractmethod
    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        """Ask which alarms stand now, as the family's own flags."""

    @abstractmethod
    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Clear what keeps the torque off, by the family's own rule; the torque is off then, unless it was on.

        Raises Refused, with the alarms as flags, if what switched it off is still there.
        """

    def rearm(self, target: KnownServo) -> Procedure[None]:
        """Bring a servo back that switched its torque off: nothing moves, and one whose torque is on is left as it is.

        Raises Refused, with the alarms as flags, if what switched it off is still there, OutsideLimits if it would run
        to the nearest limit; then the torque stays off.
        """
        motion_status = yield from self.motion_status(target)
        if not motion_status.torque:
            check_inside(target, motion_status)
        yield from self.end_shutdown(target, motion_status)
        if not motion_status.torque:
            yield from self.torque(target, on=True)

    def torque_on(self, raw: int) -> bool:
        """Tell from a raw value of torque_enable whether it is the one with which the servo is driven."""
        return raw == self.driven

    def about_to_turn(self, target: KnownServo) -> Procedure[MotionStatus]:
        """Make sure that the servo would turn, and take note that it does. Raises TorqueOff, Stopped or Restarted."""
        target.permit.ask()
        check_awake(target)
        motion_status = yield from self.motion_status(target)
        if not motion_status.torque:
            raise no_torque(target, motion_status.shutdown)
        begin_motion(target)
        return motion_status

    @abstractmethod
    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Turn without end: wheel, motor or infinite turn mode. The torque must be on.

        `speed` in rad/s where the servo controls its speed, `output` as a share -1 .. 1 of full output where
        it does not. Positive is the direction in which the position grows.
        """

    @abstractmethod
    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:
        """Come back from `turn` and hold the present position. `limits` are raw position limits to set.

        Nothing moves, whatever goal the servo remembers. Raises OutsideLimits, before anything is written, if it has
        torque and would run to the nearest of the new limits.
        """

    # Light, life and identity

    @abstractmethod
    def led(self, target: KnownServo, colour: str) -> Procedure[None]:
        """Set the light: "off", "on" or one of the colours that the model has."""

    @abstractmethod
    def reboot(self, target: KnownServo) -> Procedure[None]:
        """Tell the servo to restart; it is deaf for a while then. Raises UsageError where there is no such command."""

    def check_reset(self, target: ServoRef, keep: frozenset[str]) -> None:
        """Raise UsageError for a reset that this family cannot do, before anything is asked or sent."""
        if unknown := keep - set(self.keepable):
            can = f"only {', '.join(self.keepable)}" if self.keepable else "everything is restored"
            raise cannot(target, f"keep {', '.join(sorted(unknown))}", can)

    @abstractmethod
    def reset(self, target: KnownServo, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        """Restore factory settings, less what is kept ("id", "baud", "calibration"). Gives the new id and baud."""

    @abstractmethod
    def set_id(self, target: KnownServo, id: int) -> Procedure[None]:
        """Change the id for good."""

    @abstractmethod
    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        """Change the speed for good; the servo is on its way to the new speed when the procedure ends."""

    # Explaining

    @abstractmethod
    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        """Say in words what a packet asks or answers.

        `request` is the packet that came before it, unless that was an answer itself. `model` is whose table
        gives the registers their names and units; without it they stay bytes at an address.
        """

    def concerns(self, packet: Packet) -> tuple[int, ...]:
        """Give the ids of the servos whose registers a packet is about; the broadcast id where it lists none."""
        return (packet.id,)

    def told_number(self, packet: Packet, request: Packet) -> int | None:  # noqa: ARG002 - some families cannot be asked
        """Give the model number that a packet brings as the answer to a request; None if it brings none."""
        return None

    @abstractmethod
    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        """Tell what replies a packet asks for, as far as listening tells.

        Empty where nothing answers; None if the packet can be no request.
        """


def fetch(reading: Reading) -> Procedure[list[int]]:
    """Ask for registers; gives their raw values."""
    answers: list[bytes] = []
    for exchange in reading.exchanges:
        answers += [(yield from exchange)]
    return reading.values(answers)


def check_output(output: float) -> float:
    """Give a share of full output back, or raise BadValue."""
    share = finite(output)
    if share is None or not -1 <= share <= 1:
        raise BadValue(f"output {said(output)} is not a share of full output, -1 .. 1")
    return share


def policy_register(model: type[Model]) -> Register[Any] | None:
    """Give the register that says which requests a servo answers; None for a model that has none."""
    return model.optional("answer_level")


def cannot(target: ServoRef, what: str, why: str) -> UsageError:
    """Make the error for a verb that a family does not have."""
    return UsageError(f"{target} cannot {what}: {why}")


def require_turning(target: ServoRef) -> None:
    """Raise UsageError if the servo cannot turn without end, or if its model is not known."""
    require_model(target, "turn without end")
    if not target.model.turns:
        raise cannot(target, "turn without end", f"the {target.model.series} series has no such mode")


def require_model(target: ServoRef, what: str) -> None:
    """Raise UsageError if it is not known what an angle is on this servo, for its model is not known."""
    if target.model.unscaled("goal_position"):
        raise UsageError(
            f"{target} cannot {what} as long as its model is not known, for each model has its own units; {TELL_MODEL}"
        )


def blocks(spans: Iterable[tuple[int, int]], *, gap: int, longest: int) -> list[tuple[int, int]]:
    """Join (address, size) spans into blocks (address, size) that bridge at most `gap` unwanted bytes."""
    joined: list[tuple[int, int]] = []
    for address, size in sorted(spans):
        if joined:
            start, length = joined[-1]
            end = max(start + length, address + size)
            if address - (start + length) <= gap and end - start <= longest:
                joined[-1] = (start, end - start)
                continue
        joined.append((address, size))
    return joined


def within(spans: Sequence[tuple[int, int]], address: int) -> tuple[int, int]:
    """Find the block that holds an address: its number, and how far into it the address is."""
    return next((n, address - start) for n, (start, size) in enumerate(spans) if start <= address < start + size)


def _policy_last(model: type[Model], values: Mapping[Register[Any], int]) -> list[Mapping[Register[Any], int]]:
    """Part what is to be written: which requests are answered comes last, since what follows would go by it."""
    policy = policy_register(model)
    if policy is None or policy not in values or len(values) == 1:
        return [values]
    return [{register: raw for register, raw in values.items() if register is not policy}, {policy: values[policy]}]


def adjacent(parts: Mapping[int, bytes]) -> list[tuple[int, bytes]]:
    """Join (address, data) parts that touch into one write each."""
    runs: list[tuple[int, bytes]] = []
    for address, data in sorted(parts.items()):
        if runs and runs[-1][0] + len(runs[-1][1]) == address:
            runs[-1] = (runs[-1][0], runs[-1][1] + data)
        else:
            runs.append((address, data))
    return runs
