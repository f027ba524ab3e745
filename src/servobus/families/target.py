"""The servo that a verb is for: a reference to read it by, or one that is known, whose record and permit go along."""

from enum import IntEnum

from servobus.core.values import frozen
from servobus.families.model import Model
from servobus.families.record import MotionPermit, ServoRecord


class Answers(IntEnum):
    """Which requests a servo answers (Status Return Level, ACK Policy)."""

    NOTHING = 0
    READS = 1
    EVERYTHING = 2


@frozen
class ServoRef:
    """The servo that an exchange is for: enough to read it, and to write to it as asked."""

    id: int
    model: type[Model]
    answers: Answers

    @property
    def answers_writes(self) -> bool:
        """Whether it answers what writes to it, not only what reads it."""
        return self.answers is Answers.EVERYTHING

    def __str__(self) -> str:
        return self.model.named(f"id {self.id}")


@frozen
class KnownServo(ServoRef):
    """A servo as a bus knows it. Whatever writes registers with care, or sets in motion, takes one of these.

    Two of them are the same only if they are one object: two servos on one port may have the same id and model, at two
    speeds. Where id, speed or policy change, another object takes the place of this one, with the same record and
    permit.
    """

    id: int
    model: type[Model]
    answers: Answers
    baud: int
    record: ServoRecord
    permit: MotionPermit

    @classmethod
    def of(cls, ref: ServoRef, baud: int) -> "KnownServo":
        """Begin to keep a record of a servo at this speed: nothing was written to it so far."""
        return cls(ref.id, ref.model, ref.answers, baud, ServoRecord(), MotionPermit())

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return object.__hash__(self)
