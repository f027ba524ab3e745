"""Errors as values that can be sent: what went wrong in one process is raised in the other as what it is."""

from collections.abc import Mapping
from typing import Any

from servobus import errors
from servobus.core.values import frozen
from servobus.errors import (
    BusError,
    Held,
    NotRestored,
    Refused,
    RobotMismatch,
    ServobusError,
    StopFailed,
)
from servobus.remote.messages import message


@message("fault")
@frozen
class Fault:
    """An error of servobus.errors, or what stands for one.

    type      name of its class
    text      its message
    heard     bytes that came instead of a reply
    flags     error bits of a refusal
    by        who holds the servo
    notes     what was added to it
    names     settings that were restored, or findings of a robot
    reasons   setting -> why it was not restored
    before    register -> what was there before, as text
    failures  servo -> why it may still move
    stopped   servo -> what was done with it, as text
    """

    type: str
    text: str
    heard: bytes = b""
    flags: int = 0
    by: str = ""
    notes: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    reasons: tuple[tuple[str, str], ...] = ()
    before: tuple[tuple[str, str], ...] = ()
    failures: "tuple[tuple[str, Fault], ...]" = ()
    stopped: tuple[tuple[str, str], ...] = ()


def fault(error: BaseException) -> Fault:
    """Make what can be sent of an error. One that is none of ours goes as a ServobusError that names it."""
    known = isinstance(error, ServobusError) and getattr(errors, type(error).__name__, None) is type(error)
    given: dict[str, Any] = {"notes": tuple(map(str, getattr(error, "__notes__", ())))}
    if isinstance(error, ServobusError):
        given["before"] = _texts(error.before)
    if isinstance(error, BusError):
        given["heard"] = error.heard
    if isinstance(error, Refused):
        given["flags"] = int(error.flags)
    if isinstance(error, Held):
        given["by"] = error.by
    if isinstance(error, NotRestored):
        given |= {"names": tuple(error.restored), "reasons": _texts(error.failed)}
    if isinstance(error, RobotMismatch):
        given["names"] = tuple(map(str, error.findings))
    if isinstance(error, StopFailed):
        given["failures"] = tuple((str(servo), fault(one)) for servo, one in error.failures.items())
        given["stopped"] = _texts(error.stopped)
    return Fault(
        type(error).__name__ if known else _nearest(error),
        str(error) if isinstance(error, ServobusError) else f"{type(error).__name__}: {error}",
        **given,
    )


def error_of(found: Fault) -> ServobusError:
    """Make the error that was sent. One that is not known here is the nearest that is: a ServobusError."""
    kind = getattr(errors, found.type, None)
    if not (isinstance(kind, type) and issubclass(kind, ServobusError)):
        kind = ServobusError
    error = _made(kind, found)
    if found.before:
        error.before = dict(found.before)
    for note in found.notes:
        error.add_note(note)
    return error


def _made(kind: type[ServobusError], found: Fault) -> ServobusError:
    if issubclass(kind, NotRestored):
        return kind(found.text, found.names, dict(found.reasons))
    if issubclass(kind, RobotMismatch):
        return kind(found.text, found.names)
    if issubclass(kind, StopFailed):
        failures: Mapping[str, Exception] = {servo: error_of(one) for servo, one in found.failures}
        return kind(found.text, failures, dict(found.stopped))
    if issubclass(kind, Held):
        return kind(found.text, found.by)
    if issubclass(kind, Refused):
        return kind(found.text, found.flags)
    if issubclass(kind, BusError):
        return kind(found.text, found.heard)
    return kind(found.text)


def _nearest(error: BaseException) -> str:
    """Name the class of ours that says most of an error: another distribution may derive its own."""
    names = (kind.__name__ for kind in type(error).__mro__ if getattr(errors, kind.__name__, None) is kind)
    return next(names, ServobusError.__name__)


def _texts(values: Mapping[Any, Any]) -> tuple[tuple[str, str], ...]:
    return tuple((str(name), str(value)) for name, value in values.items())
