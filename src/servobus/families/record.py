"""What a bus keeps of one servo beside its registers: the record of what was written to it, and its permit to move.

Both belong to a `KnownServo`, which every verb that writes registers or sets in motion takes. So no verb can pass them
by. What only reads, and `Family.put`, which writes as asked, take a plain `ServoRef`.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, TypeAlias

from servobus.core.registers import Register
from servobus.core.units import finite, said
from servobus.errors import BadValue, EepromWear, Stopped

MOST = 10
"""Writes of one EEPROM register that are let through within WINDOW. Assumption: no manual says how many an EEPROM
bears; usual ones bear 100 000, which a loop of 100 Hz would use up in 17 minutes."""
WINDOW = 60.0
"""s"""

SafeAction: TypeAlias = Literal["hold", "free", "brake"]
"""What makes a servo safe: end the motion and hold the present position, torque off, or short its motor."""


class ServoRecord:
    """What was written to one servo.

    clock           seconds that never go back; by it the brake on EEPROM writes counts. Assumption: the
                    computer's own clock, even where the servo lives on a virtual one
    most            EEPROM writes of one register within WINDOW, 1 or more; None takes the brake off
    eeprom_writes   values written to its EEPROM so far
    ram             raw values that we gave it and that it keeps by itself until it restarts
    lent            speed, or time, of moves that it had, raw, before a move set its own
    goal            raw goal of the last move; None where it may have another one, which it tells itself
    modes           how often we have changed what its goals mean: limits, or a mode
    restarted       whether it lost them, so that it must not be moved before the torque is switched on anew
    """

    __slots__ = ("_recent", "clock", "eeprom_writes", "goal", "lent", "modes", "most", "ram", "restarted")

    def __init__(self) -> None:
        self.clock: Callable[[], float] = time.monotonic
        self.most: int | None = MOST
        self.eeprom_writes = 0
        self.ram: dict[Register[Any], int] = {}
        self.lent: dict[Register[Any], int] = {}
        self.goal: int | None = None
        self.modes = 0
        self.restarted = False
        self._recent: dict[str, list[float]] = {}
        """Register -> times of its last writes."""

    def check_wear(self, who: str, registers: Iterable[Register[Any]]) -> None:
        """Raise EepromWear if one of these was written too often lately."""
        if self.most is None:
            return
        now = self.clock()
        for register in registers:
            written = self._lately(register, now)
            if len(written) < self.most:
                continue
            wait = math.ceil(WINDOW - (now - written[-self.most]))
            instead = (
                "write() sets it in RAM, which does not wear out"
                if register.place.has_working_copy
                else "use a register in RAM if one does the same"
            )
            raise EepromWear(
                f"{who}: {register.name} was written to EEPROM {len(written)} times within {WINDOW:g} s, and an EEPROM "
                f"wears out; {instead}, or wait {wait} s. It was not written"
            )

    def wrote(self, registers: Iterable[Register[Any]]) -> None:
        """Count values that went to the EEPROM."""
        now = self.clock()
        for register in registers:
            self.eeprom_writes += 1
            self._recent[register.name] = [*self._lately(register, now), now]

    def _lately(self, register: Register[Any], now: float) -> list[float]:
        return [moment for moment in self._recent.get(register.name, ()) if now - moment < WINDOW]

    def set(self, values: Mapping[Register[Any], int]) -> None:
        """Note values that the servo has in RAM now."""
        self.ram.update(values)

    def forget(self, registers: Iterable[Register[Any]] | None = None) -> None:
        """Expect nothing of these RAM values any more, or of all."""
        if registers is None:
            self.lent.clear()
            self.goal = None
            self.modes += 1
        for register in list(self.ram if registers is None else registers):
            self.ram.pop(register, None)


class MotionPermit:
    """Whether, how fast and how far one servo may be moved, and whether it is being moved.

    max_step        farthest that one goal may lie from where it is, rad; None for no limit
    safe_action     what makes it safe; None: none was chosen, so it is "hold"
    driven          whether we switched it on or set it in motion, and nothing has ended that since
    stopped         whether it was stopped since
    inhibited       why it must not be moved now; "" if it may
    speed_factor    share of the speed asked for with which it is moved
    before_motion   called before it is set in motion; what it raises forbids that
    keep_alive      called while a program waits for it, or sends goals again and again; what it raises ends that
    """

    __slots__ = (
        "before_motion", "driven", "inhibited", "keep_alive", "max_step", "safe_action", "speed_factor", "stopped",
    )  # fmt: skip

    def __init__(self) -> None:
        self.max_step: float | None = None
        self.safe_action: SafeAction | None = None
        self.driven = self.stopped = False
        self.inhibited = ""
        self.speed_factor = 1.0
        self.before_motion: Callable[[], None] | None = None
        self.keep_alive: Callable[[], None] | None = None

    @property
    def given_up(self) -> bool:
        """Whether something has ended its motion since it was set going."""
        return self.stopped or not self.driven

    def ask(self) -> None:
        """Raise Stopped if it must not be set in motion or switched on now."""
        if self.inhibited:
            raise Stopped(self.inhibited)
        if self.before_motion is not None:
            self.before_motion()

    def mark_moving(self) -> None:
        """Take note that it is set in motion or switched on now. Raises Stopped if that must not be."""
        self.ask()
        self.driven, self.stopped = True, False

    def mark_idle(self) -> None:
        """Take note that nothing we did moves it or holds it any more."""
        self.driven = self.stopped = False

    def attend(self) -> None:
        """Say that the program cares for this servo in motion, which feeds the watchdog. Raises Stopped."""
        if self.keep_alive is not None:
            self.keep_alive()

    def check_step(self, who: str, distance: float) -> None:
        """Raise BadValue if a goal lies farther off than `max_step`; `distance` in rad."""
        if self.max_step is not None and not distance <= self.max_step:
            raise BadValue(
                f"{who}: {math.degrees(distance):.1f}° in one step is more than its max_step, "
                f"{math.degrees(self.max_step):.1f}°; go in smaller steps"
            )


def check_max_step(step: float | None) -> float | None:
    """Give a limit of one step in rad back, or raise BadValue."""
    if step is None:
        return None
    angle = finite(step)
    if angle is None or angle <= 0:
        raise BadValue(f"max_step {said(step)} is not an angle above 0 (None is no limit)")
    if angle > 2 * math.pi:
        raise BadValue(f"max_step {angle:g} rad is more than a turn: did you mean {angle:g} * deg? (None is no limit)")
    return angle
