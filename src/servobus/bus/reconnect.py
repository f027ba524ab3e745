"""Which servos are there again after a port was lost, and which servos have lost their RAM meanwhile."""

from collections.abc import Iterable
from typing import Literal, TypeAlias, TypeVar

from servobus.bus.by_servo import ByServo, name
from servobus.bus.servo import Servo
from servobus.bus.several import by_kind
from servobus.core.exchange import Batch, Procedure, SetBaud
from servobus.errors import BusError, Restarted
from servobus.families.base import Answers
from servobus.jobs.look import verify

S = TypeVar("S", bound=Servo)

Presence: TypeAlias = Literal["present", "restarted", "missing"]


class ReconnectReport(ByServo[S, Presence]):
    """What became of each servo while the port was lost: "present", "restarted" (it lost its RAM) or "missing".

    Can be asked by servo, or by id where that is unique.
    """

    @property
    def present(self) -> tuple[S, ...]:
        """Those that answer, the restarted ones among them."""
        return tuple(servo for servo, presence in self.items() if presence != "missing")

    @property
    def restarted(self) -> tuple[S, ...]:
        """Those that answer and lost what was set in their RAM."""
        return tuple(servo for servo, presence in self.items() if presence == "restarted")

    @property
    def missing(self) -> tuple[S, ...]:
        """Those that do not answer."""
        return tuple(servo for servo, presence in self.items() if presence == "missing")

    def __repr__(self) -> str:
        def said(servos: tuple[S, ...]) -> str:
            labels = [str(servo.id) if self._unique() else name(servo) for servo in servos]
            return f"({', '.join(labels)}{',' if len(labels) == 1 else ''})"

        present, missing, restarted = said(self.present), said(self.missing), said(self.restarted)
        return f"ReconnectReport(present={present}, missing={missing}, restarted={restarted})"


def reunite(servos: Iterable[S]) -> Procedure[ReconnectReport[S]]:
    """Find out which of the known servos are there, and which of them have restarted."""
    known = list(servos)
    present: list[S] = []
    for group in by_kind(known):
        yield SetBaud(group[0].baud)
        answers = yield Batch([servo.family.ping(servo.id) for servo in group])
        present += [servo for servo, answer in zip(group, answers, strict=True) if answer is None]
    restarted: list[S] = []
    for servo in list(present):
        if servo.target.answers is Answers.NOTHING:
            continue  # it cannot be read
        yield SetBaud(servo.baud)
        try:
            yield from verify(servo.target)
        except Restarted:
            servo.state = None
            restarted.append(servo)
        except BusError:
            present.remove(servo)  # it answered, and then no more
    presences: dict[S, Presence] = {
        servo: "restarted" if servo in restarted else "present" if servo in present else "missing" for servo in known
    }
    return ReconnectReport(presences)
