"""Drive smart serial-bus servos, and be them.

    import servobus
    from servobus import deg

    with servobus.open("/dev/ttyUSB0") as bus:      # or "virtual:rx28@1,lx16a@2"
        for servo in bus.scan():
            print(servo)
        with bus[1].torque():
            bus[1].move(90 * deg, speed=60 * deg).wait()

Angles are radians, times seconds, voltages volts; `90 * deg` is how one writes an angle.
What only one family can do is in `servobus.dynamixel1`, `servobus.herkulex` and `servobus.lewansoul`.
"""

from typing import TYPE_CHECKING, Any

from servobus.bus.blocking import Bus, BusServo, Move
from servobus.bus.by_servo import ByServo, Readings
from servobus.bus.reconnect import ReconnectReport
from servobus.bus.servo import Servo
from servobus.connect import open, open_async
from servobus.core.units import deg, ms, rpm
from servobus.errors import (
    BadChecksum,
    BadReading,
    BadValue,
    BrokenEcho,
    BusError,
    Disagreement,
    DuplicateId,
    EepromWear,
    FormatError,
    Garbled,
    Held,
    LineBusy,
    MotionError,
    MoveTimeout,
    NoReply,
    NotRestored,
    OtherProtocol,
    OutsideLimits,
    PortError,
    PortLost,
    Refused,
    Restarted,
    RobotFileError,
    RobotMismatch,
    ServobusError,
    ShortReply,
    StopFailed,
    Stopped,
    TorqueOff,
    UnknownName,
    UsageError,
    WrongReply,
)
from servobus.families.base import StopOutcome
from servobus.families.dynamixel import protocol as dynamixel1
from servobus.families.herkulex import protocol as herkulex
from servobus.families.lewansoul import protocol as lewansoul
from servobus.families.registry import DRS0602, FAMILIES, LX16A, MODELS, RX28
from servobus.jobs.backup import Backup
from servobus.jobs.look import Snapshot
from servobus.link.stats import Counts, Stats
from servobus.safety.signals import catch_signals
from servobus.safety.watchdog import Watchdog

if TYPE_CHECKING:
    from servobus.bus.asyncio import AsyncBus, AsyncBusServo, AsyncMove
    from servobus.bus.cycle import Cycle
    from servobus.robots.asyncio import AsyncRobot
    from servobus.robots.blocking import Robot
    from servobus.robots.opening import robot, robot_async
    from servobus.safety.overload import Level, Thresholds

__version__ = "0.1.0"

_LATE = {
    "AsyncBus": "servobus.bus.asyncio",
    "AsyncBusServo": "servobus.bus.asyncio",
    "AsyncMove": "servobus.bus.asyncio",
    "AsyncRobot": "servobus.robots.asyncio",
    "Cycle": "servobus.bus.cycle",
    "Level": "servobus.safety.overload",
    "Robot": "servobus.robots.blocking",
    "Thresholds": "servobus.safety.overload",
    "robot": "servobus.robots.opening",
    "robot_async": "servobus.robots.opening",
}
"""Names whose modules not all programs need: they are imported when they are first used, for asyncio takes long."""

__all__ = [
    "DRS0602",
    "FAMILIES",
    "LX16A",
    "MODELS",
    "RX28",
    "AsyncBus",
    "AsyncBusServo",
    "AsyncMove",
    "AsyncRobot",
    "Backup",
    "BadChecksum",
    "BadReading",
    "BadValue",
    "BrokenEcho",
    "Bus",
    "BusError",
    "BusServo",
    "ByServo",
    "Counts",
    "Cycle",
    "Disagreement",
    "DuplicateId",
    "EepromWear",
    "FormatError",
    "Garbled",
    "Held",
    "Level",
    "LineBusy",
    "MotionError",
    "Move",
    "MoveTimeout",
    "NoReply",
    "NotRestored",
    "OtherProtocol",
    "OutsideLimits",
    "PortError",
    "PortLost",
    "Readings",
    "ReconnectReport",
    "Refused",
    "Restarted",
    "Robot",
    "RobotFileError",
    "RobotMismatch",
    "Servo",
    "ServobusError",
    "ShortReply",
    "Snapshot",
    "Stats",
    "StopFailed",
    "StopOutcome",
    "Stopped",
    "Thresholds",
    "TorqueOff",
    "UnknownName",
    "UsageError",
    "Watchdog",
    "WrongReply",
    "catch_signals",
    "deg",
    "dynamixel1",
    "herkulex",
    "lewansoul",
    "ms",
    "open",
    "open_async",
    "robot",
    "robot_async",
    "rpm",
]


def __getattr__(name: str) -> Any:
    if name not in _LATE:
        raise AttributeError(f"module 'servobus' has no attribute {name!r}")
    from importlib import import_module  # noqa: PLC0415 - only wanted here

    value = globals()[name] = getattr(import_module(_LATE[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__doc__", "__version__"])
