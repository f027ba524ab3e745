"""What every family of servos can do, whatever its bytes look like.

A `Family` builds exchanges and procedures; it performs none. Verbs that all families share are methods
here. What only one family can do is a function in its own module, under its manual's name.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, TypeVar

from servobus.errors import BadValue, UsageError
from servobus.exchange import Exchange, Procedure, ask
from servobus.framing import Framing, Packet
from servobus.registers import Int, Register, RegisterMap

T = TypeVar("T")


class Answers(IntEnum):
    """Which requests a servo answers (Status Return Level, ACK Policy)."""

    NOTHING = 0
    READS = 1
    EVERYTHING = 2


@dataclass(frozen=True, slots=True)
class Performance:
    """One line of a data sheet: what the servo reaches at this voltage."""

    voltage: float
    """V"""
    stall_torque: float
    """N·m"""
    speed: float
    """rad/s without load"""


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Target:
    """The servo that an exchange is for."""

    id: int
    model: type[Model]
    answers: Answers

    def __str__(self) -> str:
        return f"{self.model.title} id {self.id}"


@dataclass(frozen=True, slots=True)
class Identity:
    """What a servo says about itself when asked."""

    number: int | None
    firmware: str
    answers: Answers


@dataclass(frozen=True, slots=True)
class Stance:
    """What must be known before a move: where the servo is and what holds it back."""

    position: float
    """rad"""
    torque: bool
    low: int
    high: int
    """Position limits set in the servo, raw goal units."""
    turning: bool
    """In wheel, motor or infinite turn mode, where a goal does not move it."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One servo's part in a move."""

    target: Target
    goal: int
    """Raw goal position."""
    distance: float
    """rad, never negative"""
    duration: float
    """s, more than 0"""


@dataclass(frozen=True, slots=True)
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

    # Who is there

    @abstractmethod
    def ping(self, id: int) -> Exchange[None]:
        """Ask whether a servo is there."""

    @abstractmethod
    def identify(self, id: int) -> Procedure[Identity]:
        """Ask a servo who it is. Raises NoReply if nobody is there."""

    @abstractmethod
    def markers(self, id: int) -> Sequence[Exchange[Any]]:
        """Give harmless questions, at least three, none of whose answers can be mistaken for another's."""

    # Registers, raw

    @abstractmethod
    def reading(self, target: Target, registers: Sequence[Register[Any]]) -> Reading:
        """Tell what to ask for these registers: as few exchanges as the family allows."""

    def read(self, target: Target, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read raw values."""
        return fetch(self.reading(target, registers))

    @abstractmethod
    def write(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they act at once, in as few exchanges as the family allows."""

    @abstractmethod
    def store(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write raw values where they survive power-off."""

    def read_stored(self, target: Target, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read the values that survive power-off, where they can differ from those that act now."""
        return self.read(target, registers)

    # Motion

    @abstractmethod
    def stance(self, target: Target) -> Procedure[Stance]:
        """Read what a move must know."""

    def check_leg(self, leg: Leg) -> None:  # noqa: B027 - most families have nothing to add
        """Raise BadValue for a leg that this family cannot do, beyond what limits and times tell."""

    @abstractmethod
    def launch(self, legs: Sequence[Leg]) -> Procedure[None]:
        """Start all legs together."""

    @abstractmethod
    def moving(self, target: Target) -> Procedure[bool]:
        """Tell whether the servo still moves towards its goal."""

    @abstractmethod
    def stop(self, target: Target) -> Procedure[None]:
        """End the motion and hold the present position."""

    @abstractmethod
    def torque(self, target: Target, on: bool) -> Procedure[None]:
        """Switch torque. On sets goal := present position first, so that nothing jumps."""

    def torque_on(self, raw: int) -> bool:
        """Tell from the raw value of torque_enable whether the servo is driven."""
        return raw != 0

    @abstractmethod
    def turn(self, target: Target, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Turn without end: wheel, motor or infinite turn mode.

        `speed` in rad/s where the servo controls its speed, `output` as a share -1 .. 1 of full output where
        it does not. Positive is the direction in which the position grows.
        """

    @abstractmethod
    def position_mode(self, target: Target, limits: tuple[int, int] | None) -> Procedure[None]:
        """Come back from `turn` and hold the present position. `limits` are raw position limits to set."""

    # Light, life and identity

    @abstractmethod
    def led(self, target: Target, colour: str) -> Procedure[None]:
        """Set the light: "off", "on" or one of the colours that the model has."""

    @abstractmethod
    def reboot(self, target: Target) -> Procedure[None]:
        """Restart the servo. Raises UsageError where the family has no such command."""

    @abstractmethod
    def reset(self, target: Target, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        """Restore factory settings, less what is kept ("id", "baud", "calibration"). Gives the new id and baud."""

    @abstractmethod
    def set_id(self, target: Target, id: int) -> Procedure[None]:
        """Change the id for good."""

    @abstractmethod
    def set_baud(self, target: Target, baud: int) -> Procedure[None]:
        """Change the speed for good; the servo is on the new speed when the procedure ends."""

    # Explaining

    @abstractmethod
    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        """Say in words what a packet asks or answers.

        `request` is the packet that came before it, unless that was an answer itself. `model` is whose table
        gives the registers their names and units; without it they stay bytes at an address.
        """


def fetch(reading: Reading) -> Procedure[list[int]]:
    """Ask for registers; gives their raw values."""
    answers: list[bytes] = []
    for exchange in reading.exchanges:
        answers += [(yield from ask(exchange))]
    return reading.values(answers)


def check_output(output: float) -> float:
    """Give a share of full output back, or raise BadValue."""
    if not -1 <= output <= 1:
        raise BadValue(f"output {output} is not in -1 .. 1")
    return output


def cannot(target: Target, what: str, why: str) -> UsageError:
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
