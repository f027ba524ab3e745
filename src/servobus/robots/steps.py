"""Jobs of a robot: generators of steps, each with a job for every port, that are carried out side by side.

A bus has jobs for one line (`servobus.core.exchange`). A robot has several lines, and what it does is written once for
both drivers in the same way:

    def alarms(joints):
        came = yield from together({"left": read_left(), "right": read_right()})
        return came["left"], came["right"]
"""

from collections.abc import Callable, Generator, Mapping
from typing import Any, TypeAlias, TypeVar

from servobus.core.exchange import Job, Now, Pause
from servobus.core.values import frozen
from servobus.errors import ServobusError

T = TypeVar("T")


@frozen
class Together:
    """Jobs that begin at the same time, port -> job. Each is carried to its end, even if another fails."""

    jobs: Mapping[str, Job[Any]]


RobotJob: TypeAlias = Generator[Together | Pause | Now, Any, T]
"""A job of a robot. For `Together` it is sent port -> result, or the ServobusError that came instead of one; for `Now`
the time on the robot's clock, s since it was opened. A `Pause` lets time pass on all ports, others use the lines."""


def each(jobs: Mapping[str, Job[Any]]) -> RobotJob[dict[str, Any]]:
    """Carry out a job on each port; gives port -> its result, or the error that it raised."""
    if not jobs:
        return {}
    outcomes: dict[str, Any] = yield Together(jobs)
    return outcomes


def together(jobs: Mapping[str, Job[Any]]) -> RobotJob[dict[str, Any]]:
    """Carry out a job on each port. Gives port -> result, or raises the first error when all have ended."""
    outcomes = yield from each(jobs)
    for outcome in outcomes.values():
        if isinstance(outcome, ServobusError):
            raise outcome
    return outcomes


def by_port(things: Mapping[Any, T], port: Callable[[Any], str]) -> dict[str, dict[Any, T]]:
    """Sort a mapping by the ports of its keys."""
    sorted_: dict[str, dict[Any, T]] = {}
    for thing, value in things.items():
        sorted_.setdefault(port(thing), {})[thing] = value
    return sorted_
