"""From the name of a port to a bus.

A port is a device path (`/dev/ttyUSB0`), `COM4`, `socket://host:port`, `rfc2217://host:port`,
`virtual:SPEC` for virtual servos in this process, such as `virtual:rx28@1-4,lx16a@7`, or a bus that a server of ours
shares: `servobus://host:port/name`, `servobus:///name` for a server of this user on this computer.
"""

import re
from collections.abc import Iterable
from os import PathLike, fspath
from typing import TYPE_CHECKING

from servobus.bus.blocking import Bus
from servobus.core.arguments import check_bauds
from servobus.errors import PortError, UsageError
from servobus.families.record import SafeAction
from servobus.jobs.scan import Models, check_models
from servobus.remote.address import SCHEME, Address
from servobus.safety.safe_stop import check_safe_action
from servobus.transports.base import Transport

if TYPE_CHECKING:
    from servobus.bus.asyncio import AsyncBus

VIRTUAL = "virtual:"
FIRST_BAUD = 115_200
"""Speed a port is opened at. It only matters until the first servo is spoken to, at its own speed."""


def open(
    port: str | PathLike[str],
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
                  else what `servobus remember` was told, or a model that is not known

    Raises PortError if the port is missing, in use or not permitted, UsageError for a name that is no port or no model.
    """
    speeds = check_bauds(bauds)
    check_safe_action(safe_action or "hold", ())
    check_models(models)
    return Bus(transport(port, speeds), bauds=speeds, echo=echo, safe_action=safe_action, models=models)


def open_async(
    port: str | PathLike[str],
    *,
    bauds: int | Iterable[int] | None = None,
    echo: bool | None = None,
    safe_action: SafeAction | None = None,
    models: Models | None = None,
) -> "AsyncBus":
    """Open a port for asyncio: `async with servobus.open_async(port) as bus`. See `open`."""
    from servobus.bus.asyncio import AsyncBus  # noqa: PLC0415 - asyncio is slow to import and not always wanted

    speeds = check_bauds(bauds)
    check_safe_action(safe_action or "hold", ())
    check_models(models)
    return AsyncBus(transport(port, speeds), bauds=speeds, echo=echo, safe_action=safe_action, models=models)


def transport(port: str | PathLike[str], speeds: tuple[int, ...] | None = None) -> Transport:
    """Open the bare port behind a name."""
    port = _name(port)
    if port.startswith(VIRTUAL):
        from servobus.virtual.serve.inprocess import connect  # noqa: PLC0415 - real ports need no virtual servos

        return connect(port)
    if port.startswith(SCHEME):
        from servobus.remote.port import RemotePort  # noqa: PLC0415 - most ports belong to this process

        return RemotePort(Address.parse(port))
    from servobus.transports.serial_port import SerialPort  # noqa: PLC0415 - virtual servos need no pyserial

    try:
        return SerialPort(port, speeds[0] if speeds else FIRST_BAUD)
    except PortError:
        from servobus.remote.runtime import sharing  # noqa: PLC0415 - only ever needed for this message

        if (shared := sharing(port)) is None:
            raise
        raise PortError(f"{port}: a server shares it, process {shared.pid}; open {shared.address} instead") from None


def lasting_name(port: str) -> tuple[str, str]:
    """Give the name under which the servos on a port are remembered, and the words for its adapter; opens nothing.

    Raises UsageError for a name that is no port, PortError for one that is not there.
    """
    name = _name(port)
    if name.startswith(VIRTUAL):
        return name, ""
    if name.startswith(SCHEME):
        shared = transport(name)  # the server knows
        shared.close()
        return shared.lasting_name, ""
    from servobus.transports import usb_adapter  # noqa: PLC0415 - seldom wanted

    about = usb_adapter.access(name)
    if about is not None and not about.exists:
        raise PortError(f"{name}: no such port; `servobus ports` lists what is plugged in")
    adapter = usb_adapter.adapter(name) if usb_adapter.is_wired(name) else None
    return usb_adapter.lasting_name(name, adapter), str(adapter) if adapter is not None else ""


def _name(port: str | PathLike[str]) -> str:
    """Give the name of a port, be it a text or a path. Raises UsageError for anything else."""
    given: object = fspath(port) if isinstance(port, PathLike) else port
    if not isinstance(given, str):
        raise UsageError(f"{port!r:.40} is no name of a port; one is /dev/ttyUSB0, COM4 or virtual:rx28@1-4")
    if not given.strip():
        raise UsageError("the name of the port is empty; `servobus ports` lists what is plugged in")
    if "\0" in given:
        raise UsageError(f"{given!r:.60} is no name of a port: a name has no NUL in it")
    if given.startswith(SCHEME):
        Address.parse(given)
    if match := re.match(r"(socket|rfc2217)://([^/?#]*)", given):
        number = match[2].rpartition(":")[2]
        if not number.isdecimal() or not 0 < int(number) < 1 << 16 or len(number) == len(match[2].lstrip(":")):
            raise UsageError(f"{given}: write {match[1]}://HOST:PORT, such as {match[1]}://pi.local:3333")
    return given


__all__ = ["lasting_name", "open", "open_async", "transport"]
