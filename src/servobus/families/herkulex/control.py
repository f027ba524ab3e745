"""The control laws and sensors of HerkuleX servos: plain numbers in, plain numbers out.

    position error -> PID, feed-forwards -> dead zone -> PWM Offset -> Min. PWM -> saturator -> Max. PWM -> output
    speed error    -> PI                                             -> Min. PWM              -> Max. PWM -> output

The order is H-115, an assumption, as the manual's picture of it has no text. Section and register (NO) numbers are
those of the DRS-0602 manual. Units are the registers': pwm (the highest Max. PWM is the whole supply), position units,
speed units of NO 55 (those of infinite turn for its controller), registers raw.

The manual prints the scales of the gains, not the times they count in. What makes the factory gains work, and what
the factory gains of older models (440 and 8000 in 6-1) hint at, is assumed:

- Kd acts on the change of the error in 0.8 ms, which is what the servo's two time units, 11.2 and 4 ms, have in
  common. Kp 440 and Kd 8000 then lead by 15 ms, about the time constant of such a motor. In 11.2 ms it would be 0.2 s.
- Ki of both controllers adds the error once in 11.2 ms. In 0.8 ms the factory's speed controller would swing with
  ever more force, because the speed it is given is 22 ms old on average (see `Speedometer`).
- The speed controller acts on NO 55. At 14.8 V its P gain alone, 100/64 pwm per unit, asks for 0.9 of the output
  that the wanted speed needs, so that unit cannot be far off.
- The feed-forwards have no printed scale: gain/64 like the speed's P gain, pwm for each speed unit of the profile, and
  for each change of it by one unit in 11.2 ms. The gains that fit the DRS-0602 without load are then 111 and 122.
"""

import math
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass

from servobus.virtual.physics.trajectory import StepCounter

UNIT = 11.2e-3
"""s in which Ki adds the error once; assumption, see above."""
CHANGE = 0.8e-3
"""s of which Kd takes the change; assumption, see above."""
LONGEST_SUM = 32767.0
"""pwm that the speed controller's integral holds at most; assumption: a signed register of 16 bits. It is far more than
the output, so what cannot be reached is made up for later, as 6-5 warns (H-88)."""


class PositionControl:
    """PID on the position error, with feed-forwards of the profile (NO 26 to 30)."""

    __slots__ = (
        "_acceleration",
        "_before",
        "_d",
        "_i",
        "_p",
        "_speed",
        "_speed_before",
        "_sum",
        "_tick",
        "forward",
        "full",
    )

    def __init__(self, tick: float, full: int) -> None:
        """Prepare for one call of `output` every `tick` seconds; `full` is the pwm that is the whole supply."""
        self._tick, self.full = tick, full
        self.tune(0, 0, 0)
        self.reset()

    def tune(self, kp: int, kd: int, ki: int, speed: int = 0, acceleration: int = 0) -> None:
        """Take the gains as the registers hold them."""
        self._p = kp / 8
        self._d = kd / 8 * CHANGE / self._tick
        self._i = ki / 16384 * self._tick / UNIT
        self._speed, self._acceleration = speed / 64, acceleration / 64 * UNIT / self._tick
        self.forward = bool(speed or acceleration)
        """Whether the speed of the profile matters."""

    def reset(self) -> None:
        """Forget the past."""
        self._sum = 0.0
        self._before: float | None = None
        self._speed_before = 0.0

    def output(self, error: float, speed: float = 0.0) -> float:
        """Give the pwm that an error in position units asks for, while the profile has a speed in speed units.

        Before the first call there was no error that could have changed. The integral alone never asks for more than
        the full output (assumption), so that a shaft that was held does not overshoot for long.
        """
        before = error if self._before is None else self._before
        self._before = error
        wanted = self._p * error + self._d * (error - before)
        if self._i:
            self._sum = max(-self.full, min(self._sum + self._i * error, self.full))
            wanted += self._sum
        if self.forward:
            wanted += self._speed * speed + self._acceleration * (speed - self._speed_before)
            self._speed_before = speed
        return wanted

    def steady(self, error: float) -> bool:
        """Tell whether the same error again would not change the output."""
        return error == self._before and (not self._i or not error)


class SpeedControl:
    """PI on the error of the speed (NO 31, 32)."""

    __slots__ = ("_i", "_p", "_sum", "_tick")

    def __init__(self, tick: float) -> None:
        """Prepare for one call of `output` every `tick` seconds."""
        self._tick = tick
        self.tune(0, 0)
        self.reset()

    def tune(self, kp: int, ki: int) -> None:
        """Take the gains as the registers hold them."""
        self._p, self._i = kp / 64, ki / 16384 * self._tick / UNIT

    def reset(self) -> None:
        """Forget the past."""
        self._sum = 0.0

    def output(self, error: float) -> float:
        """Give the pwm that an error in speed units asks for. The sum goes on beyond the full output (H-88)."""
        self._sum = max(-LONGEST_SUM, min(self._sum + self._i * error, LONGEST_SUM))
        return self._p * error + self._sum


@dataclass(frozen=True, slots=True)
class Stages:
    """What comes between a controller and the bridge (NO 17 to 22), as the registers hold it.

    A dead zone without output stays without: no later stage turns it on again (H-110). At an error of exactly 0 the
    offset remains. Fractions of a pwm are cut off towards 0 (assumption).
    """

    dead_zone: int  # position units
    offset: int  # pwm, signed
    lowest: int  # pwm
    highest: int  # pwm
    saturator_offset: int = 0  # pwm
    saturator_slope: int = 0  # 1/256 pwm per position unit; 0 is no saturator

    def position(self, wanted: float, error: float) -> int:
        """Give the output for what the position controller wants at an error."""
        distance = abs(error)
        if distance < self.dead_zone:
            return 0
        wanted += self.offset
        size = self._raised(wanted)
        if self.saturator_slope:
            size = min(size, self.saturator_offset + self.saturator_slope / 256 * distance)
        return self._cut(size, wanted)

    def speed(self, wanted: float) -> int:
        """Give the output for what the speed controller wants: neither offset nor saturator (NO 18 to 20)."""
        return self._cut(self._raised(wanted), wanted)

    def _raised(self, wanted: float) -> float:
        size = abs(wanted)
        return size if size >= self.lowest or not size else self.lowest

    def _cut(self, size: float, sign: float) -> int:
        size = int(size) if size < self.highest else self.highest
        return size if sign > 0 else -size


class Speedometer:
    """Measures speed as the way in the last few control loops, in whole position units (NO 55).

    One position unit in that time is one unit of Differential Position: 0.62 degrees/s in the 44.8 ms of the DRS-0602,
    29.09 in the 11.2 ms of the DRS-0101 (EH-58).
    """

    __slots__ = ("_same", "_seen", "way")

    def __init__(self, loops: int, count: int) -> None:
        self._seen = deque([count] * loops, loops)
        self._same = loops
        self.way = 0
        """Position units in that time."""

    def step(self, count: int) -> None:
        """Look at the position, in whole units, once more."""
        seen = self._seen
        self.way = count - seen[0]
        self._same = self._same + 1 if count == seen[-1] else 0
        seen.append(count)

    @property
    def steady(self) -> bool:
        """Whether nothing has changed for so long that the speed stays 0."""
        return self._same >= len(self._seen)


class Sensor(StepCounter):
    """What a servo knows of its shaft, in position units. Angles of the shaft are in rad, counted without end."""

    @abstractmethod
    def where(self, shaft: float) -> float:
        """Give the angle at which the servo takes its shaft to be."""

    @abstractmethod
    def told(self, steps: int) -> int:
        """Give what stands in a register for a position that may be beyond the ends."""


class MagneticEncoder(Sensor):
    """Counts on through turns. A shaft that turns past either end comes in again at the other (H-100).

    Other drivers mask the words of these models with 0x7FFF (EH-35).
    """

    def where(self, shaft: float) -> float:
        return shaft

    def told(self, steps: int) -> int:
        return steps % self.size


class Potentiometer(Sensor):
    """Knows the angle within one turn. In its gap, and beyond the ends, it reads as the nearer end (EH-64)."""

    def where(self, shaft: float) -> float:
        return max(self.angle(0), min(math.remainder(shaft, math.tau), self.angle(self.size - 1)))

    def told(self, steps: int) -> int:
        return max(0, min(steps, self.size - 1))

    def wrap(self, angle: float) -> None:
        """Keep the numbers: those of a potentiometer are fixed."""


class OverloadTimer:
    """Tells what lasts for longer than a while."""

    __slots__ = ("_for", "limit")

    def __init__(self) -> None:
        self.limit = 0
        """Control loops that it may last."""
        self._for = 0

    def step(self, wrong: bool) -> bool:
        """Look once more; tell whether it has been wrong for longer than the limit."""
        self._for = min(self._for, self.limit) + 1 if wrong else 0
        return self._for > self.limit

    @property
    def waiting(self) -> bool:
        """Whether time alone will make it last too long."""
        return 0 < self._for <= self.limit
