"""What every family of servos can do, whatever its bytes look like.

A `Family` builds exchanges and procedures; it performs none. Verbs that all families share are methods here:
abstract where the bytes decide, else written by the rules in `motion`, `change` and `stopping`, which are the same for
every family. What only one family can do is a function in its `protocol`, under its manual's name.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

from servobus.core.effect import Effect, Kind, Touch
from servobus.core.exchange import Exchange, GroupExchange, Now, Pause, Procedure, ReplyPattern
from servobus.core.framing import Framing, Packet
from servobus.core.ids import check_id
from servobus.core.registers import Area, Register
from servobus.core.values import frozen
from servobus.errors import BusError, NoReply
from servobus.families import change, stopping
from servobus.families.change import policy_register, set_registers
from servobus.families.model import Model, Performance, SpecSheet
from servobus.families.motion import (
    AxisMove,
    MotionStatus,
    Reach,
    TorqueState,
    check_hold,
    check_inside,
    no_torque,
)
from servobus.families.reading import Reading, adjacent, blocks, fetch, within
from servobus.families.refusal import cannot, check_output, require_model, require_turning
from servobus.families.stopping import LIMP, TRIES, TURNS_NO_MORE, StopOutcome
from servobus.families.target import Answers, KnownServo, ServoRef

# What a family is written with, to be had from here; each name lives in the module that it is imported from above.
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
    "Reach",
    "Reading",
    "ServoRef",
    "SpecSheet",
    "StopOutcome",
    "Stranger",
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

ASK_AGAIN = 0.02
"""s between two questions to a servo that does not answer yet."""


@frozen
class Identity:
    """What a servo says about itself when asked."""

    number: int | None
    firmware: str
    answers: Answers


@frozen
class Stranger:
    """A device on the line that speaks a protocol not known here."""

    id: int
    text: str
    """What it is, for people."""


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
    mode_rows: ClassVar[tuple[str, ...]] = ()
    """Names of the registers that tell, beside the limits, whether it turns without end, where a model has them; see
    `is_turning`."""
    holds_outside_limits: ClassVar[bool] = False
    """Whether a servo whose torque comes on outside its limits holds where it is, and does not run to them."""

    @property
    def joins(self) -> Callable[[Sequence[Exchange[Any]]], GroupExchange[Any]] | None:
        """What makes one request of the first of several reads, where servos answer such; see `Exchange.joins`."""
        return None

    def check_model(self, model: type[Model]) -> None:  # noqa: B027 - most families ask no more of a table
        """Raise TypeError for a table that the verbs of this family cannot use, when its class is made."""

    # Who is there

    @abstractmethod
    def ping(self, id: int) -> Exchange[None]:
        """Ask whether a servo is there."""

    @abstractmethod
    def identify(self, id: int) -> Procedure[Identity]:
        """Ask a servo who it is. Raises NoReply if none answers."""

    def number_text(self, number: int | None) -> str:
        """Write a model number as people know it."""
        return str(number)

    @abstractmethod
    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        """Give harmless questions, at least three, none of whose answers can be mistaken for another's.

        The first is one that every servo answers, whatever it is set to.
        """

    def strangers(self) -> Sequence[Exchange[Stranger]]:
        """Give harmless questions that devices answer which speak another protocol, for a scan of all ids."""
        return ()

    # Registers, raw

    @abstractmethod
    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        """Tell what to ask for these registers: as few exchanges as the family allows."""

    def question(self, target: ServoRef, register: Register[T]) -> Exchange[T]:
        """Make the one exchange that reads one register, in its unit."""
        reading = self.reading(target, [register])
        (exchange,), ((_, part, layout),) = reading.exchanges, reading.places
        answer, unpack, decode = exchange.interpret, layout.unpacker(), register.decoder(target)
        return exchange.mapped(lambda packet: decode(unpack(answer(packet)[part])))

    def read(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read raw values."""
        return fetch(self.reading(target, registers))

    def read_values(self, target: ServoRef, names: Iterable[str]) -> Procedure[dict[str, int]]:
        """Read raw values by the names of their registers."""
        rows = {name: target.model.register(name) for name in names}
        return dict(zip(rows, (yield from self.read(target, list(rows.values()))), strict=True))

    def read_stored(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read the values that survive power-off, where they can differ from those that act now."""
        return self.read(target, registers)

    def stored_is_told(self, register: Register[Any]) -> bool:  # noqa: ARG002 - one register cannot
        """Tell whether what `read_stored` gives for this register is what survives power-off."""
        return True

    def write(self, target: KnownServo, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they act at once, in as few exchanges as the family allows.

        What lives in EEPROM is read first, and written only if it differs. Raises EepromWear if that was done too
        often lately, UsageError if the servo has locked it. What moves the servo obeys the rules of moves, see
        `servobus.families.motion`; torque comes on as with `torque`.
        """
        return change.write(target, values, keep=False)

    def store(self, target: KnownServo, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they survive power-off, if they differ from what is there; see `write`.

        Raises UsageError for a register that lives in RAM alone.
        """
        return change.write(target, values, keep=True)

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

    def check_unlocked(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[None]:  # noqa: ARG002
        """Raise UsageError if the servo has locked its EEPROM. Most families have no lock."""
        yield from ()

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

    # What it does now

    def motion_status(self, target: ServoRef) -> Procedure[MotionStatus]:
        """Read what a move must know."""
        modes = (name for name in self.mode_rows if name in target.model.registers)
        names = ("present_position", "min_position", "max_position", *modes, *self.torque_rows)
        return self.status_of(target, (yield from self.read_values(target, names)))

    def status_of(self, target: ServoRef, raw: Mapping[str, int]) -> MotionStatus:
        """Tell what a move must know from the raw values, by name, of position, limits, `mode_rows`, `torque_rows`."""
        position: float = target.model.register("present_position").decode(raw["present_position"])
        torque, reach = self.torque_state(raw), self.reach(target.model, raw["min_position"], raw["max_position"])
        turning = reach.turning or self.is_turning(raw)
        return MotionStatus(position, torque.on, reach.low, reach.high, turning, torque.shutdown)

    def reach(self, model: type[Model], low: int, high: int) -> Reach:  # noqa: ARG002 - mostly they are what they say
        """Tell what two raw position limits mean: which goals a servo takes, or that it turns without end."""
        return Reach(low, high)

    def multi_turn_limits(self, model: type[Model]) -> tuple[int, int] | None:  # noqa: ARG002 - most have none
        """Give the raw position limits with which a servo counts its goals over several turns; None if none do."""
        return None

    def is_turning(self, values: Mapping[str, int]) -> bool:  # noqa: ARG002 - not every family has a mode for that
        """Tell whether a mode makes a servo turn without end, from the raw values, by name, of the `mode_rows`."""
        return False

    def read_torque(self, target: ServoRef) -> Procedure[TorqueState]:
        """Read whether the servo is driven."""
        return self.torque_state((yield from self.read_values(target, self.torque_rows)))

    def torque_state(self, values: Mapping[str, Any]) -> TorqueState:
        """Tell whether the servo is driven from the values, by name, of the `torque_rows`."""
        return TorqueState(bool(values["torque_enable"]))

    def torque_on(self, raw: int) -> bool:
        """Tell from a raw value of torque_enable whether it is the one with which the servo is driven."""
        return raw == self.driven

    @abstractmethod
    def moving(self, target: ServoRef) -> Procedure[bool]:
        """Tell whether the servo still moves towards its goal."""

    @abstractmethod
    def push(self, target: KnownServo) -> Procedure[float]:
        """Read how hard the servo pushes, as a share 0 .. 1 of the output that it is allowed now."""

    def known_alarms(self, model: type[Model], alarms: int) -> int:  # noqa: ARG002 - most families know all bits
        """Leave out the bits of a reply that mean nothing on a model."""
        return alarms

    @abstractmethod
    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        """Ask which alarms stand now, as the family's own flags."""

    # Moves

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

    def borrow(self, target: KnownServo) -> Procedure[None]:
        """Note what the speed, or time, of moves is in the servo, before a move sets its own."""
        row = target.model.optional("goal_speed") or target.model.optional("goal_time")
        if row is not None and row not in target.record.lent:
            (target.record.lent[row],) = yield from self.read(target, [row])

    def give_back(self, target: KnownServo) -> Procedure[None]:
        """Set the speed, or time, of moves again that `borrow` noted, if that moves nothing."""
        if target.record.lent:
            yield from set_registers(target, dict(target.record.lent))

    @abstractmethod
    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Turn without end: wheel, motor or infinite turn mode. The torque must be on.

        `speed` in rad/s where the servo controls its speed, `output` as a share -1 .. 1 of full output where
        it does not. Positive is the direction in which the position grows.
        """

    def check_current(self, target: ServoRef, current: float) -> int:  # noqa: ARG002 - most control none
        """Give a current in A to turn with, raw. Raises UsageError where the servo controls none, or BadValue."""
        raise cannot(target, "turn with a given current", "it does not control its current")

    def turn_by_current(self, target: KnownServo, current: float) -> Procedure[None]:
        """Turn with a current in A, as long as nothing holds the shaft: torque control. The torque must be on."""
        yield from ()  # a procedure without steps
        self.check_current(target, current)

    @abstractmethod
    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:
        """Come back from `turn` and hold the present position. `limits` are raw position limits to set.

        Nothing moves, whatever goal the servo remembers. Raises OutsideLimits, before anything is written, if it has
        torque and would run to the nearest of the new limits.
        """

    # Stops

    def stop(self, target: KnownServo) -> Procedure[StopOutcome]:
        """End the motion, whatever state the servo is in: hold it where it is, or let go of it.

        It is held by `hold`. Where that fails, for an answer is lost, makes no sense or says no, its torque is switched
        off. Raises BusError only if nothing shows that this has arrived: then the servo may still move.
        """
        return stopping.stop(target)

    @abstractmethod
    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        """End the motion and hold the present position, or the nearest one that its limits allow.

        What is near enough `servobus.families.stopping` tells. Makes sure that it was heard. Not subject to `max_step`,
        nor recorded. Raises BusError, or UsageError for a servo that answers no reads; `stop` goes on from there.
        """

    def let_go(self, target: KnownServo) -> Procedure[None]:
        """Switch the torque off without asking anything first, again and again until it is known to be off.

        Of a servo that answers no reads it is only made sure that it is there. Raises BusError if its torque may still
        be on.
        """
        return stopping.let_go(target)

    def brake(self, target: KnownServo) -> Procedure[None]:
        """Short the motor. Raises UsageError where the family cannot, BusError if nothing shows that it did."""
        yield from ()  # a procedure without steps
        raise cannot(target, "brake", "nothing in it shorts the motor; hold or free it")

    # Torque

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
        yield from set_registers(target, {target.model.register("torque_enable"): self.driven})

    @abstractmethod
    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Make the present position the goal, and 0 the speed of endless turn, so that nothing goes on from here.

        The servo stands within its limits, or holds outside of them by itself. Raises BusError if it did not take that:
        with torque it might run to another goal.
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

    @abstractmethod
    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Clear what keeps the torque off, by the family's own rule; the torque is off then, unless it was on.

        Raises Refused, with the alarms as flags, if what switched it off is still there.
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

    def set_id(self, target: KnownServo, id: int) -> Procedure[None]:
        """Change the id for good."""
        yield from set_registers(target, {target.model.register("id"): check_id(id)})

    @abstractmethod
    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        """Change the speed for good; the servo is on its way to the new speed when the procedure ends."""

    # For those who listen

    @abstractmethod
    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        """Say in words what a packet asks or answers.

        `request` is the packet that came before it, unless that was an answer itself. `model` is whose table
        gives the registers their names and units; without it they stay bytes at an address.
        """

    def explain_to_several(self, packet: Packet, models: Sequence[type[Model] | None]) -> str:  # noqa: ARG002 - for families that can
        """Say in words what a request asks of servos of several models, in the order of `concerns`."""
        return self.explain(packet)

    def concerns(self, packet: Packet) -> tuple[int, ...]:
        """Give the ids of the servos whose registers a packet is about; the broadcast id where it lists none."""
        return (packet.id,)

    def told_number(self, packet: Packet, request: Packet) -> int | None:  # noqa: ARG002 - some families cannot be asked
        """Give the model number that a packet brings as the answer to a request; None if it brings none."""
        return None

    def effect(self, packet: Packet, model_of: Callable[[int], type[Model] | None]) -> Effect:  # noqa: ARG002 - see below
        """Tell what a request does to the servos that it is for, and which raw values it gives them.

        `model_of` gives the model of a servo by its id: the generic one if no more is known, and for the broadcast id;
        None if no table tells what its registers are. Where there is doubt, a request drives. So every request of a
        family that says nothing of this counts as motion.
        """
        return Effect(tuple(Touch(id, Kind.DRIVES) for id in self.concerns(packet)))

    def told_alarms(self, answer: Packet) -> int | None:  # noqa: ARG002 - the answers of some families carry none
        """Give the alarm bits that an answer carries; None in a family whose answers carry none."""
        return None

    @abstractmethod
    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        """Tell what replies a packet asks for, as far as listening tells.

        Empty where nothing answers; None if the packet can be no request.
        """
