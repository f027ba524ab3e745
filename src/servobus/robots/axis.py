"""Joint space and servo space: one object that turns each into the other, for all quantities.

    joint = direction * (servo - zero) / ratio

zero        angle of the servo, rad, where the joint is at 0
direction   1, or -1 where the servo turns the other way round
ratio       turns of the servo for one turn of the joint: above 1 where a gear behind the horn makes the joint slower

Both ways are in one place, so that what is read and what is commanded cannot have different signs.
"""

from servobus.core.values import frozen


@frozen
class Axis:
    """How the angle of a servo and that of its joint belong together; see the head of this module."""

    zero: float = 0.0
    direction: int = 1
    ratio: float = 1.0

    def to_servo(self, angle: float) -> float:
        """Turn an angle of the joint into that of the servo, rad."""
        return self.zero + self.direction * self.ratio * angle

    def to_joint(self, angle: float) -> float:
        """Turn an angle of the servo into that of the joint, rad."""
        return self.direction * (angle - self.zero) / self.ratio

    def change_to_servo(self, change: float) -> float:
        """Turn a change of the joint's angle, its speed or its acceleration, into that of the servo."""
        return self.direction * self.ratio * change

    def change_to_joint(self, change: float) -> float:
        """Turn a change of the servo's angle, its speed or its acceleration, into that of the joint."""
        return self.direction * change / self.ratio

    def load_to_joint(self, load: float) -> float:
        """Turn a load of the servo, a share of what it can bear, into that of the joint: only its sign may change."""
        return self.direction * load

    def range_to_servo(self, low: float, high: float) -> tuple[float, float]:
        """Turn limits of the joint into those of the servo, the lower first."""
        one, other = self.to_servo(low), self.to_servo(high)
        return min(one, other), max(one, other)

    def range_to_joint(self, low: float, high: float) -> tuple[float, float]:
        """Turn limits of the servo into those of the joint, the lower first."""
        one, other = self.to_joint(low), self.to_joint(high)
        return min(one, other), max(one, other)
