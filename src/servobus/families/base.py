"""What every family of servos can do, whatever its bytes look like.

A `Family` builds exchanges and procedures; it performs none. Verbs that all families share are methods
here. What only one family can do is a function in its own module, under its manual's name.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any, ClassVar, TypeVar

from servobus.core.exchange import Exchange, Procedure, ReplyPattern
from servobus.core.framing import Framing, Packet
from servobus.core.registers import Area, EepRam, Int, Register, RegisterMap
from servobus.core.values import frozen
from servobus.errors import BadValue, BusError, UsageError
from servobus.families.record import ServoRecord

T = TypeVar("T")


class Answers(IntEnum):
    """Which requests a servo answers (Status Return Level, ACK Policy)."""

    NOTHING = 0
    READS = 1
    EVERYTHING = 2


@frozen
class Performance:
    """One line of a data sheet: what the servo reaches at this voltage."""

    voltage: float
    """V"""
    stall_torque: float
    """N·m"""
    speed: float
    """rad/s without load"""


@frozen
class SpecSheet:
    """The maker's specification of a model, in SI units. None where the manual does not say."""

    maker: str
    performance: tuple[Performance, ...]
    voltage: tuple[float, float]
    """Supply, V: lowest and highest."""
    angle: float
    """Range in position mode, rad."""
    resolution: float
    """rad per position unit"""
    nominal_voltage: float | None = None
    temperature: tuple[float, float] | None = None
    """Working range, °C."""
    weight: float | None = None
    """kg"""
    size: tuple[float, float, float] | None = None
    """m: width, depth and height"""
    gear_ratio: float | None = None
    gear: str = ""
    motor: str = ""
    standby_current: float | None = None
    """A"""
    max_current: float | None = None
    """A"""
    link: str = ""


class Model(RegisterMap):
    """A register table with a name on the case: what `models/` is full of."""

    family: ClassVar["Family"]
    number: ClassVar[int | None]
    """What the servo says when asked for its model; None for families that cannot be asked."""
    sheet: ClassVar[SpecSheet]

    @classmethod
    def key(cls) -> str:
        """Give the name used in commands and files: rx28 for RX-28."""
        return cls.title.replace("-", "").lower()


@frozen
class ServoRef:
    """The servo that an exchange is for; `notes` are what was noted of it, if anybody does."""

    id: int
    model: type[Model]
    answers: Answers
    notes: ServoRecord | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ServoRef) and self._who() == other._who()

    def __hash__(self) -> int:
        return hash(self._who())

    def _who(self) -> tuple[object, ...]:
        return self.id, self.model, self.answers

    def __str__(self) -> str:
        return f"{self.model.title} id {self.id}"


@frozen
class Identity:
    """What a servo says about itself when asked."""

    number: int | None
    firmware: str
    answers: Answers


@frozen
class MotionStatus:
    """What must be known before a move: where the servo is and what holds it back."""

    position: float
    """rad"""
    torque: bool
    low: int
    high: int
    """Position limits set in the servo, raw goal units."""
    turning: bool
    """In wheel, motor or infinite turn mode, where a goal does not move it."""


@frozen
class AxisMove:
    """One servo's part in a move."""

    target: ServoRef
    goal: int
    """Raw goal position."""
    distance: float
    """rad, never negative"""
    duration: float
    """s, more than 0"""


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
    default_baud: ClassVar[int]
    bauds: ClassVar[tuple[int, ...]]
    """Speeds that servos of this family can be set to, bit/s, most likely first."""
    full_duplex: ClassVar[bool] = False
    max_move_time: ClassVar[float | None] = None
    """Longest time in seconds that one timed move can take; None if moves are given by speed."""
    volatile: ClassVar[frozenset[str]] = frozenset()
    """Registers in RAM that the servo changes by itself: they do not tell that it restarted."""
    motion_registers: ClassVar[frozenset[str]] = frozenset()
    """Registers that can set a servo in motion, beside torque and goals."""
    output_limit: ClassVar[str] = ""
    """Register in RAM that bounds the output; "" if the family has none."""
    turns_at_speed: ClassVar[bool] = False
    """Whether it controls the speed of endless turn; else a share of full output is set."""
    brakes: ClassVar[bool] = False
    """Whether it can brake: short its motor, so that the shaft turns only slowly."""

    # Who is there

    @abstractmethod
    def ping(self, id: int) -> Exchange[None]:
        """Ask whether a servo is there."""

    @abstractmethod
    def identify(self, id: int) -> Procedure[Identity]:
        """Ask a servo who it is. Raises NoReply if nobody is there."""

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

    def write(self, target: ServoRef, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they act at once, in as few exchanges as the family allows.

        What lives in EEPROM is read first, and written only if it differs. Raises EepromWear if that was done too
        often lately, UsageError if the servo has locked it, BadValue for a goal beyond `max_step`.
        """
        yield from self._set(target, values, keep=False)

    def store(self, target: ServoRef, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they survive power-off, if they differ from what is there; see `write`."""
        for register in values:
            if not self.wears(register, keep=True):
                raise UsageError(
                    f"{register.model} {register.name} lives in RAM and is not saved: it is lost at power-off"
                )
        yield from self._set(target, values, keep=True)

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

    def _set(self, target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool) -> Procedure[None]:
        """Write with care: every write of registers comes through here."""
        notes = target.notes
        if notes is None:
            yield from self.put(target, values, keep=keep)
            return
        yield from self._check_step(target, values, notes)
        worn = [register for register in values if self.wears(register, keep=keep)]
        same: frozenset[Register[Any]] = frozenset()
        if worn and target.answers is not Answers.NOTHING:  # what cannot be read cannot be compared
            present = yield from self.read_stored(target, worn)
            same = frozenset(
                register
                for register, raw in zip(worn, present, strict=True)
                if raw == values[register] and self.stored_is_told(register)
            )
        fresh = [register for register in worn if register not in same]
        if fresh:
            notes.check_wear(str(target), fresh)
            yield from self._check_unlocked(target, fresh)
        in_ram = {
            register: raw
            for register, raw in values.items()
            if register.name not in self.volatile and (register.area is Area.RAM or isinstance(register.place, EepRam))
        }
        notes.forget(in_ram)  # until it is known that they arrived
        try:
            yield from self.put(target, values, keep=keep, same=same)
        except BusError:
            notes.wrote(fresh)  # they may have arrived
            raise
        notes.wrote(fresh)
        notes.set(in_ram)
        torque = target.model.register("torque_enable")
        if torque in values and self.torque_on(values[torque]):
            notes.restarted = False

    def _check_step(self, target: ServoRef, values: Mapping[Register[Any], int], notes: ServoRecord) -> Procedure[None]:
        """Refuse goals that lie too far from where the servo is. Raises BadValue."""
        goals = [register for register in values if register.name.endswith("goal_position")]
        if not goals or notes.max_step is None:
            return
        row = target.model.register("present_position")
        (here,) = yield from self.read(target, [row])
        for goal in goals:
            notes.check_step(str(target), abs(goal.decode(values[goal]) - row.decode(here)))

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

    @abstractmethod
    def stop(self, target: ServoRef) -> Procedure[None]:
        """End the motion and hold the present position."""

    @abstractmethod
    def torque(self, target: ServoRef, on: bool) -> Procedure[None]:
        """Switch torque. On sets goal := present position first, so that nothing jumps."""

    def brake(self, target: ServoRef) -> Procedure[None]:
        """Short the motor. Raises UsageError where the family cannot."""
        yield from ()  # a procedure without steps
        raise cannot(target, "brake", "only HerkuleX servos can (Torque Control); hold or free it")

    @abstractmethod
    def push(self, target: ServoRef) -> Procedure[float]:
        """Read how hard the servo pushes, as a share 0 .. 1 of the output that it is allowed now."""

    def sets_going(self, target: ServoRef, values: Mapping[Register[Any], int]) -> bool:
        """Tell whether writing these raw values can set the servo in motion, or switches it on."""
        torque = target.model.register("torque_enable")
        return (torque in values and self.torque_on(values[torque])) or any(
            register.name.endswith("goal_position") or register.name in self.motion_registers for register in values
        )

    @abstractmethod
    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        """Ask which alarms stand now, as the family's own flags."""

    @abstractmethod
    def rearm(self, target: ServoRef) -> Procedure[None]:
        """Bring a servo back that switched its torque off, by the family's own rule.

        Goal := present position before the torque comes on; one whose torque is on is left as it is. Raises
        Refused, with the alarms as flags, if what switched it off is still there; then the torque stays off.
        """

    def torque_on(self, raw: int) -> bool:
        """Tell from the raw value of torque_enable whether the servo is driven."""
        return raw != 0

    @abstractmethod
    def turn(self, target: ServoRef, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Turn without end: wheel, motor or infinite turn mode.

        `speed` in rad/s where the servo controls its speed, `output` as a share -1 .. 1 of full output where
        it does not. Positive is the direction in which the position grows.
        """

    @abstractmethod
    def position_mode(self, target: ServoRef, limits: tuple[int, int] | None) -> Procedure[None]:
        """Come back from `turn` and hold the present position. `limits` are raw position limits to set."""

    # Light, life and identity

    @abstractmethod
    def led(self, target: ServoRef, colour: str) -> Procedure[None]:
        """Set the light: "off", "on" or one of the colours that the model has."""

    @abstractmethod
    def reboot(self, target: ServoRef) -> Procedure[None]:
        """Restart the servo. Raises UsageError where the family has no such command."""

    @abstractmethod
    def reset(self, target: ServoRef, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        """Restore factory settings, less what is kept ("id", "baud", "calibration"). Gives the new id and baud."""

    @abstractmethod
    def set_id(self, target: ServoRef, id: int) -> Procedure[None]:
        """Change the id for good."""

    @abstractmethod
    def set_baud(self, target: ServoRef, baud: int) -> Procedure[None]:
        """Change the speed for good; the servo is on the new speed when the procedure ends."""

    # Explaining

    @abstractmethod
    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        """Say in words what a packet asks or answers.

        `request` is the packet that came before it, unless that was an answer itself. `model` is whose table
        gives the registers their names and units; without it they stay bytes at an address.
        """

    @abstractmethod
    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        """Tell what replies a packet asks for, as far as one can tell who only listens.

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
    if not -1 <= output <= 1:
        raise BadValue(f"output {output} is not in -1 .. 1")
    return output


def cannot(target: ServoRef, what: str, why: str) -> UsageError:
    """Make the error for a verb that a family does not have."""
    return UsageError(f"{target} cannot {what}: {why}")


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


def adjacent(parts: Mapping[int, bytes]) -> list[tuple[int, bytes]]:
    """Join (address, data) parts that touch into one write each."""
    runs: list[tuple[int, bytes]] = []
    for address, data in sorted(parts.items()):
        if runs and runs[-1][0] + len(runs[-1][1]) == address:
            runs[-1] = (runs[-1][0], runs[-1][1] + data)
        else:
            runs.append((address, data))
    return runs
