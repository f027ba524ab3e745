"""Errors of servobus as JSON, and as the status of an answer.

A status of 500 and above means that this program has a fault, and nothing else: a servo that does not answer, or a port
that is unplugged, is 424 (what the request depends on has failed).

    404   no such bus, servo, register, job, ...
    409   not in the state that things are in: torque off, held by somebody else, id taken, stopped
    422   a value that cannot be
    424   the servo, the line or the port has failed: silence, garbage, unplugged
    429   too many at once
"""

from collections.abc import Mapping
from typing import Any

from servobus.errors import (
    BadValue,
    BusError,
    EepromWear,
    FormatError,
    Held,
    NotRestored,
    PortError,
    Refused,
    RobotFileError,
    RobotMismatch,
    ServobusError,
    StopFailed,
    Stopped,
    TorqueOff,
    UnknownName,
)

STATUS: tuple[tuple[type[Exception], int], ...] = (
    (UnknownName, 404),
    (BadValue, 422),
    (RobotFileError, 422),
    (FormatError, 422),
    (Refused, 409),
    (BusError, 424),
    (PortError, 424),
    (StopFailed, 424),
    (ServobusError, 409),
)
"""The first that fits counts."""
REMEDIES: Mapping[type[Exception], str] = {
    TorqueOff: "switch the torque on first: POST .../torque",
    Held: "take it over: POST /api/v1/buses/BUS/take, with the header Servobus-Connection",
    Stopped: "resume the bus: POST /api/v1/buses/BUS/resume",
    EepromWear: "write without `save`, where the register has a place in RAM too",
}


class TooMany(ServobusError):
    """A bound of the server is reached: of jobs, of clients, of what waits."""


class RoleTooLow(ServobusError):
    """The role of the login is too low."""


def status_of(error: ServobusError) -> int:
    """Give the status of an answer that tells of an error."""
    if isinstance(error, TooMany):
        return 429
    return next(status for kind, status in STATUS if isinstance(error, kind))


def error_entry(error: BaseException) -> dict[str, Any]:
    """Give an error for JSON: its type, the sentence, and what to do where that is not in the sentence."""
    entry: dict[str, Any] = {"type": type(error).__name__, "message": str(error)}
    remedy = next((text for kind, text in REMEDIES.items() if isinstance(error, kind)), None)
    if remedy is not None:
        entry["remedy"] = remedy
    if isinstance(error, NotRestored):
        entry["detail"] = {"restored": error.restored, "failed": error.failed}
    if isinstance(error, StopFailed):
        entry["detail"] = {
            "failed": {str(servo): str(why) for servo, why in error.failures.items()},
            "stopped": {str(servo): str(outcome) for servo, outcome in error.stopped.items()},
        }
    if isinstance(error, RobotMismatch):
        entry["detail"] = {"findings": [one.text for one in error.findings]}
    return entry
