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

from servobus.bus.base import ReconnectReport
from servobus.bus.blocking import Bus, BusServo, Move
from servobus.connect import open, open_async
from servobus.core.units import deg, ms, rpm
from servobus.errors import (
    BadChecksum,
    BadValue,
    BrokenEcho,
    BusError,
    DuplicateId,
    EepromWear,
    Garbled,
    LineBusy,
    MotionError,
    MoveTimeout,
    NoReply,
    PortError,
    PortLost,
    Refused,
    Restarted,
    ServobusError,
    ShortReply,
    Stopped,
    TorqueOff,
    UnknownName,
    UsageError,
    WrongReply,
)
from servobus.families.dynamixel import protocol as dynamixel1
from servobus.families.herkulex import protocol as herkulex
from servobus.families.lewansoul import protocol as lewansoul
from servobus.families.registry import DRS0602, FAMILIES, LX16A, MODELS, RX28
from servobus.jobs.backup import Backup
from servobus.jobs.look import Snapshot
from servobus.link.stats import Counts, Stats
from servobus.safety.watchdog import Watchdog

__version__ = "0.1.0"

__all__ = [
    "DRS0602",
    "FAMILIES",
    "LX16A",
    "MODELS",
    "RX28",
    "Backup",
    "BadChecksum",
    "BadValue",
    "BrokenEcho",
    "Bus",
    "BusError",
    "BusServo",
    "Counts",
    "DuplicateId",
    "EepromWear",
    "Garbled",
    "LineBusy",
    "MotionError",
    "Move",
    "MoveTimeout",
    "NoReply",
    "PortError",
    "PortLost",
    "ReconnectReport",
    "Refused",
    "Restarted",
    "ServobusError",
    "ShortReply",
    "Snapshot",
    "Stats",
    "Stopped",
    "TorqueOff",
    "UnknownName",
    "UsageError",
    "Watchdog",
    "WrongReply",
    "deg",
    "dynamixel1",
    "herkulex",
    "lewansoul",
    "ms",
    "open",
    "open_async",
    "rpm",
]
