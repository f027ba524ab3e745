"""From the name of a port to a bus.

A port is a device path (`/dev/ttyUSB0`), `COM4`, `socket://host:port`, `rfc2217://host:port`, or
`virtual:SPEC` for virtual servos in this process, such as `virtual:rx28@1-4,lx16a@7`.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from servobus.bus.blocking import Bus
from servobus.errors import BadValue
from servobus.families.record import SafeAction
from servobus.jobs.scan import Models, check_models
from servobus.safety.safe_stop import check_safe_action
from servobus.transports.base import Transport

if TYPE_CHECKING:
    from servobus.bus.asyncio import AsyncBus

VIRTUAL = "virtual:"
FIRST_BAUD = 115_200
"""Speed a port is opened at. It only matters until the first servo is spoken to, at its own speed."""


def open(
    port: str,
    *,
    bauds: int | Iterable[int] | None = None,
    echo: bool | None = None,
    safe_action: SafeAction | None = None,
    models: Models | None = None,
) -> Bus:
    """Open a port. Nothing is sent, nothing moves, torque stays as it is.

    bauds         speed or speeds to look for servos at, bit/s; the factory speeds of all models by default
    echo          whether the adapter hears what it sends; found out by default
    safe_action   what a crash does with servos that were driven: "hold" (also by default), "free" or "brake"; see
                  `Servo.safe_action`
    models        what servos are that cannot say it themselves: "lx16a" for all of that family, {3: "lx16a"} for id 3;
                  the first model of their family by default

    Raises PortError if the port is missing, in use or not permitted, UsageError for a name that is no port or no model.
    """
    speeds = _speeds(bauds)
    check_safe_action(safe_action or "hold", ())
    check_models(models)
    return Bus(transport(port, speeds), bauds=speeds, echo=echo, safe_action=safe_action, models=models)


def open_async(
    port: str,
    *,
    bauds: int | Iterable[int] | None = None,
    echo: bool | None = None,
    safe_action: SafeAction | None = None,
    models: Models | None = None,
) -> "AsyncBus":
    """Open a port for asyncio: `async with servobus.open_async(port) as bus`. See `open`."""
    from servobus.bus.asyncio import AsyncBus  # noqa: PLC0415 - asyncio is slow to import and not always wanted

    speeds = _speeds(bauds)
    check_safe_action(safe_action or "hold", ())
    check_models(models)
    return AsyncBus(transport(port, speeds), bauds=speeds, echo=echo, safe_action=safe_action, models=models)


def transport(port: str, speeds: tuple[int, ...] | None = None) -> Transport:
    """Open the bare port behind a name."""
    if port.startswith(VIRTUAL):
        from servobus.virtual.serve.inprocess import connect  # noqa: PLC0415 - real ports need no virtual servos

        return connect(port)
    from servobus.transports.serial_port import SerialPort  # noqa: PLC0415 - virtual servos need no pyserial

    return SerialPort(port, speeds[0] if speeds else FIRST_BAUD)


def _speeds(bauds: int | Iterable[int] | None) -> tuple[int, ...] | None:
    if bauds is None:
        return None
    speeds = (bauds,) if isinstance(bauds, int) else tuple(bauds)
    for speed in speeds:
        if not 1 <= speed <= 4_000_000:
            raise BadValue(f"{speed} is not a speed in baud")
    return speeds


__all__ = ["open", "open_async", "transport"]
