"""How the output shaft follows what the firmware commands.

The shaft is ideal: it does exactly as commanded, without load, inertia or play, but never faster than the
motor turns without load at the present supply voltage.
"""

import itertools
from collections.abc import Sequence

from servobus.families.base import Performance


class Shaft:
    """The output shaft: where it is and how fast it turns."""

    def __init__(self, position: float) -> None:
        self.position = position
        """rad, counted on beyond full turns"""
        self.velocity = 0.0
        """rad/s during the last step"""

    def move_towards(self, goal: float, speed: float, dt: float) -> None:
        """Go towards a position at a speed (rad/s, not negative) for one step, and stop there."""
        distance = goal - self.position
        reach = speed * dt
        if abs(distance) <= reach:
            self.position, self.velocity = goal, distance / dt
        else:
            self.turn(speed if distance > 0 else -speed, dt)

    def turn(self, speed: float, dt: float) -> None:
        """Turn at a signed speed in rad/s for one step."""
        self.position += speed * dt
        self.velocity = speed

    def rest(self) -> None:
        """Stand still."""
        self.velocity = 0.0


def no_load_speed(performance: Sequence[Performance], voltage: float) -> float:
    """Give the highest speed in rad/s at a supply voltage.

    Between the points of the data sheet it is interpolated. Below the lowest and above the highest it is
    proportional to the voltage, as for a DC motor without friction (assumption).
    """
    points = sorted((point.voltage, point.speed) for point in performance)
    for (low, slow), (high, fast) in itertools.pairwise(points):
        if low <= voltage <= high:
            return slow + (fast - slow) * (voltage - low) / (high - low)
    nearest, speed = points[0] if voltage < points[0][0] else points[-1]
    return speed * max(voltage, 0.0) / nearest
