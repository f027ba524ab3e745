"""From a robot file to a robot."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from os import PathLike, fspath
from typing import TYPE_CHECKING, TypeVar

from servobus.bus.blocking import Bus
from servobus.connect import transport
from servobus.errors import PortError, RobotFileError
from servobus.robots.base import check_safe
from servobus.robots.blocking import Robot
from servobus.robots.file.entries import OPEN_PORT, RobotFile
from servobus.robots.file.places import from_file
from servobus.robots.file.reading import read_file
from servobus.robots.joints.attendance import refuse
from servobus.transports import usb_adapter
from servobus.transports.base import MissingPort, Transport

if TYPE_CHECKING:
    from servobus.bus.asyncio import AsyncBus
    from servobus.robots.asyncio import AsyncRobot

USB = "usb:"
B = TypeVar("B", Bus, "AsyncBus")


def robot(file: str | PathLike[str] | RobotFile, *, incomplete: bool = False) -> Robot:
    """Open a robot: all ports of a robot file, and its joints by name. Nothing moves, torque stays as it is.

        with servobus.robot("arm.toml") as arm:
            print(arm.positions())

    file        the path of a robot file, or one that was read; "virtual:arm.toml" is the same robot on virtual servos
                in this process, see docs/virtual.md
    incomplete  whether to open it although servos are missing or are not those of the file, or ports but not all;
                `arm.attendance` says which

    Raises RobotFileError for a wrong file, PortError for a port that is missing or in use, RobotMismatch where the
    servos that answer are not those of the file.
    """
    contents = _contents(file)
    with ExitStack() as stack:
        opened = Robot(contents, _opened(contents, stack, Bus, incomplete=incomplete))
        stack.callback(opened.close)
        check_safe(opened)
        refuse(opened.check(strangers="near"), incomplete=incomplete)
        stack.pop_all()
    return opened


def robot_async(file: str | PathLike[str] | RobotFile, *, incomplete: bool = False) -> "AsyncRobot":
    """Open a robot for asyncio: `async with servobus.robot_async("arm.toml") as arm`; see `robot`.

    Its servos are compared with the file as the block begins.
    """
    from servobus.bus.asyncio import AsyncBus  # noqa: PLC0415 - asyncio is slow to import and not always wanted
    from servobus.robots.asyncio import AsyncRobot  # noqa: PLC0415

    contents = _contents(file)
    with ExitStack() as stack:
        buses = _opened(contents, stack, AsyncBus, incomplete=incomplete)
        opened = AsyncRobot(contents, buses, incomplete=incomplete)
        check_safe(opened)
        stack.pop_all()
    return opened


def _contents(file: str | PathLike[str] | RobotFile) -> RobotFile:
    """Read a robot file. Raises RobotFileError for one that names no joint."""
    contents = file if isinstance(file, RobotFile) else read_file(fspath(file))
    if not contents.joints:
        raise RobotFileError(
            f"{contents.name}: there is no joint; write [port.NAME] and [joint.NAME], or have "
            "`servobus robot init PORT` make a file from the servos of a port"
        )
    return contents


def _opened(file: RobotFile, stack: ExitStack, make: Callable[..., B], *, incomplete: bool) -> dict[str, B]:
    """Open all ports of the file, port -> bus; the stack closes them.

    Where the robot may be incomplete, and another port is there, a port that is not has a bus on which nothing can be
    asked.
    """
    transports: Mapping[str, Transport] = {}
    if file.virtual is not None:
        from servobus.robots.virtual.building import virtual_ports  # noqa: PLC0415 - real robots need no virtual servos

        transports = virtual_ports(file)
    buses = {}
    missing: dict[str, PortError] = {}
    for entry in file.ports.values():
        if file.virtual is None:
            try:
                path = from_file(entry.path, None if file.path is None else file.path.parent)
                bus = make(transport(port_path(path), entry.bauds), bauds=entry.bauds, echo=entry.echo)
            except PortError as error:
                if not incomplete:
                    raise PortError(f"{file.name}: port {entry.name}: {error}") from None
                missing[entry.name] = error
                bus = make(MissingPort(entry.path, error), bauds=entry.bauds, echo=entry.echo)
        elif entry.name in transports:
            bus = make(transports[entry.name], bauds=entry.bauds)
        else:
            continue  # no joint is on this port
        stack.callback(bus.close)
        buses[entry.name] = bus
    if missing and len(missing) == len(buses):
        name, why = next(iter(missing.items()))
        raise PortError(f"{file.name}: port {name}: {why}")
    return buses


def port_path(path: str) -> str:
    """Give the path of a port: `usb:SERIAL` is where the adapter with this serial number is now.

    Raises PortError if no such adapter is plugged in, or if the file leaves the path open.
    """
    if path == OPEN_PORT:
        raise PortError("its path is not known yet; write it into the file: `servobus ports` lists the ports")
    if not path.startswith(USB):
        return path
    serial = path.removeprefix(USB)
    for adapter in usb_adapter.adapters():
        if adapter.serial_number == serial:
            return adapter.device
    raise PortError(f"no USB adapter with serial number {serial} is plugged in; `servobus ports` lists those that are")
