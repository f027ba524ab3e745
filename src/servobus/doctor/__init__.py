"""What is wrong with a port and the servos on it: the cause first, then the commands that mend it.

Each check gives findings. `examine` makes all checks in the order in which one thing rests on the other: the port, who
may open it and which programs have it open, the adapter, the servos, what they report, and how many answers are lost.
It moves nothing, switches no torque and writes to no servo.
"""

from collections.abc import Callable, Iterator

from servobus import connect
from servobus.bus.blocking import Bus
from servobus.doctor.findings import Finding, Severity, Watcher
from servobus.doctor.health import health
from servobus.doctor.losses import losses
from servobus.doctor.port import check_open_port, check_system
from servobus.doctor.search import Rounds, SearchPlan, search
from servobus.errors import PortError, PortLost
from servobus.families.base import Answers


def examine(
    port: str,
    plan: SearchPlan,
    watch: Watcher = lambda *_: None,
    opened: Callable[[str], Bus] | None = None,
) -> Iterator[Finding]:
    """Make all checks of a port, as far as they get. Raises UsageError for a name that is no port.

    `opened` opens a port by its name; `servobus.open` by default.
    """
    for finding in check_system(port):
        yield finding
        if finding.level is Severity.FAIL:
            return  # it could not be opened
    try:
        with (opened or connect.open)(port) as bus:
            bus.models = plan.models
            yield from check_open_port(bus)
            taken: set[int] = set()
            there = yield from search(bus, plan, watch, taken)
            if willing := [servo for servo in there if servo.target.answers is not Answers.NOTHING]:
                # Reading comes first: some errors show themselves only after a while.
                lost = list(losses(bus, willing, plan.reads, watch, taken)) if plan.reads else []
                yield from health(bus, willing)
                yield from lost
    except PortLost as error:
        cause = "a loose plug, a bad cable, or servos that draw more current than the adapter can give"
        yield Finding(Severity.FAIL, "port", str(error), cause, ("servobus ports",))
    except PortError as error:
        yield Finding(Severity.FAIL, "port", str(error))


__all__ = ["Finding", "Rounds", "SearchPlan", "Severity", "examine"]
