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

from servobus.backup import Backup
from servobus.bus import Bus, BusServo, Move
from servobus.connect import open, open_async
from servobus.errors import (
    BadChecksum,
    BadValue,
    BusError,
    EepromWear,
    Garbled,
    MoveTimeout,
    NoReply,
    PortError,
    PortLost,
    Refused,
    Restarted,
    ServobusError,
    Stopped,
    TorqueOff,
    UnknownName,
    UsageError,
    WrongReply,
)
from servobus.models import DRS0602, FAMILIES, LX16A, MODELS, RX28
from servobus.procedures import State
from servobus.protocols import dynamixel1, herkulex, lewansoul
from servobus.units import deg, ms, rpm

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
    "Bus",
    "BusError",
    "BusServo",
    "EepromWear",
    "Garbled",
    "Move",
    "MoveTimeout",
    "NoReply",
    "PortError",
    "PortLost",
    "Refused",
    "Restarted",
    "ServobusError",
    "State",
    "Stopped",
    "TorqueOff",
    "UnknownName",
    "UsageError",
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
