"""What the system knows about a port: may it be opened, which programs have it open, which adapter is behind it.

Linux tells it in /dev, /proc and /sys; `root` is where these hang. Elsewhere, and of ports that are no device of
this computer, what is not known is None or empty. Nothing is opened and nothing is changed here.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from servobus.errors import PortError

if sys.platform != "win32":
    import grp
    import pwd

ROOT = Path("/")
HANDING_OVER = 0.002
"""s; assumption: what USB frames and the system need beside the time for which an adapter collects bytes."""
FAST_TIMER = 1
"""ms; the shortest latency timer that an FTDI adapter has. Its driver begins with 16 ms."""
LONGEST_COMMAND = 60
"""Characters of a command line that are worth showing."""
NAMED = 2
"""Processes that are worth naming."""


# May it be opened?


@dataclass(frozen=True, slots=True)
class PortAccess:
    """Whether a port is there, and whether this user may open it."""

    real: str
    """Its name behind all links."""
    exists: bool
    allowed: bool = False
    group: str = ""
    """The group whose members may open it; empty if there is none that one should join."""
    member: bool = False
    """Whether this user is in that group by now; it counts from the next login on."""

    @property
    def remedy(self) -> str:
        """The command that gives this user the permission; empty if it is there."""
        if not self.exists or self.allowed:
            return ""
        if not self.group:
            return f"sudo chmod a+rw {self.real}"
        return "log out and in again" if self.member else f"sudo usermod -aG {self.group} $USER"


def is_device(name: str) -> bool:
    """Tell whether a port is a file of this computer: no URL, and not on Windows."""
    return os.name == "posix" and "://" not in name


def is_wired(name: str, root: Path = ROOT) -> bool:
    """Tell whether a port is a serial port of this computer, as far as the system tells.

    A pseudo terminal is none: its other end may have it open too, and no adapter is behind it.
    """
    if sys.platform == "linux" and is_device(name):
        return (root / "sys/class/tty" / Path(real_name(name, root)).name).exists()
    return "://" not in name


def access(name: str, root: Path = ROOT) -> PortAccess | None:
    """Look whether a port is there and may be opened; None if it is no file of this computer."""
    if not is_device(name):
        return None
    real = real_name(name, root)
    path = _under(root, real)
    try:
        about = path.stat()
    except OSError:
        return PortAccess(real, exists=False)
    group, member = _group(about.st_gid) if about.st_mode & 0o060 == 0o060 else ("", False)
    return PortAccess(real, exists=True, allowed=os.access(path, os.R_OK | os.W_OK), group=group, member=member)


def real_name(name: str, root: Path = ROOT) -> str:
    """Follow the links behind a name: /dev/serial/by-id/... becomes /dev/ttyUSB0."""
    root = root.resolve()
    path = _under(root, str(Path(name).absolute())).resolve()
    return "/" + str(path.relative_to(root)) if path.is_relative_to(root) else str(path)


def _group(number: int) -> tuple[str, bool]:
    """Give the name of a group, and whether this user is listed in it. Nobody should join root."""
    if sys.platform != "win32" and number != 0:
        with suppress(KeyError):
            group, user = grp.getgrgid(number), pwd.getpwuid(os.getuid())
            return group.gr_name, user.pw_name in group.gr_mem or user.pw_gid == number
    return "", False


# Who has it open?


@dataclass(frozen=True, slots=True)
class Holder:
    """A process that has a port open."""

    pid: int
    command: str
    own: bool = False
    """Whether it is this process."""

    def __str__(self) -> str:
        return "this process" if self.own else f"{self.command or 'a process'} (pid {self.pid})"


@dataclass(frozen=True, slots=True)
class Holders:
    """The processes that have a port open, as far as this user can see."""

    known: tuple[Holder, ...] = ()
    hidden: bool = False
    """Whether there are processes of other users, whose files cannot be seen."""

    @property
    def others(self) -> tuple[Holder, ...]:
        """All but this process."""
        return tuple(holder for holder in self.known if not holder.own)

    def __str__(self) -> str:
        """Name the programs that have the port; there is at least one."""
        if self.known:
            names = [str(holder) for holder in self.others or self.known]
            more = [f"{len(names) - NAMED} more"] if len(names) > NAMED else []
            return " and ".join(names[:NAMED] + more)
        return "a process of another user" if self.hidden else "another program"


def holders(name: str, root: Path = ROOT) -> Holders:
    """Find the processes that have a port open."""
    proc = root / "proc"
    if not is_device(name) or not proc.is_dir():
        return Holders()
    real = real_name(name, root)
    pids = set(_lockers(_under(root, real), proc))
    hidden = False
    for process in proc.iterdir():
        if not process.name.isdecimal():
            continue
        try:
            if any(_target(link) == real for link in (process / "fd").iterdir()):
                pids.add(int(process.name))
        except PermissionError:
            hidden = True
        except OSError:
            pass  # it ended meanwhile
    known = (Holder(pid, _command(proc / str(pid)), pid == os.getpid()) for pid in sorted(pids))
    return Holders(tuple(known), hidden)


def _lockers(path: Path, proc: Path) -> Iterator[int]:
    """Find the processes that lock a file. The system tells that of the processes of other users too."""
    try:
        about = path.stat()
        lines = (proc / "locks").read_text().splitlines()
    except OSError:
        return
    place = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
    for line in lines:
        words = line.split()
        # 1: FLOCK  ADVISORY  WRITE 4711 00:06:345 0 EOF; those that wait have an arrow as their second word
        if len(words) >= 6 and words[1] == "FLOCK" and words[5] == place and (proc / words[4]).is_dir():
            yield int(words[4])


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except FileNotFoundError:
        return ""  # it was closed meanwhile


def _command(process: Path) -> str:
    """Give the command line of a process, without its folder and without what a terminal could stumble over."""
    try:
        words = (process / "cmdline").read_bytes().decode(errors="replace").rstrip("\0").split("\0")
    except OSError:
        return ""
    text = " ".join([Path(words[0]).name, *words[1:]])
    text = "".join(character if character.isprintable() else "?" for character in text)
    return text if len(text) <= LONGEST_COMMAND else text[: LONGEST_COMMAND - 4] + " ..."


# Which adapter is behind it?


@dataclass(frozen=True, slots=True)
class Adapter:
    """What is between the computer and the bus. Empty and None where the system does not say."""

    device: str
    vid: int | None = None
    pid: int | None = None
    manufacturer: str = ""
    product: str = ""
    serial_number: str = ""
    location: str = ""
    """Where it is plugged in, such as 1-1.2; of an adapter with several ports also which, such as 1-1.2:1.0."""
    driver: str = ""
    latency_timer: int | None = None
    """ms for which it collects bytes before it hands them over; known of FTDI adapters."""

    @property
    def usb(self) -> str:
        """Vendor and product number as usually written, such as 0403:6001; empty if it is no USB adapter."""
        return "" if self.vid is None or self.pid is None else f"{self.vid:04x}:{self.pid:04x}"

    @property
    def latency(self) -> float | None:
        """Seconds that a reply may be late because of it; None if unknown."""
        return None if self.latency_timer is None else self.latency_timer / 1000 + HANDING_OVER

    @property
    def slow(self) -> bool:
        """Whether its latency timer could be shorter."""
        return self.latency_timer is not None and self.latency_timer > FAST_TIMER

    @property
    def udev_rule(self) -> str:
        """The line for a file in /etc/udev/rules.d that sets its latency timer whenever it is plugged in."""
        marks = {"idVendor": f"{self.vid or 0:04x}", "idProduct": f"{self.pid or 0:04x}", "serial": self.serial_number}
        which = ", ".join(f'ATTRS{{{name}}}=="{value}"' for name, value in marks.items() if value)
        rule = f'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="{self.driver}", {which}'
        return f'{rule}, ATTR{{latency_timer}}="{FAST_TIMER}"'

    @property
    def command(self) -> str:
        """The command that sets its latency timer until it is unplugged."""
        return f"echo {FAST_TIMER} | sudo tee {_timer(self.device)}"

    def __str__(self) -> str:
        maker = "" if self.manufacturer and self.product.startswith(self.manufacturer) else self.manufacturer
        words = [maker, self.product, self.usb and f"({self.usb})"]
        words.append(self.serial_number and f"serial number {self.serial_number}")
        return " ".join(filter(None, words)) or self.driver or self.device


def adapters() -> list[Adapter]:
    """List the adapters of this computer, as pyserial finds them."""
    try:
        from serial.tools import list_ports  # noqa: PLC0415 - slow, and seldom wanted
    except ImportError:  # a system of which pyserial does not know how it lists its ports
        return []
    try:
        return [described(port) for port in list_ports.comports()]
    except (OSError, TypeError, ValueError):  # what pyserial makes of an adapter that is being unplugged
        return []


def adapter(name: str, root: Path = ROOT) -> Adapter | None:
    """Find out about the adapter behind a port; None if nothing is known."""
    if "://" in name:
        return None
    device = real_name(name, root) if is_device(name) else name
    found = next((one for one in adapters() if one.device.lower() == device.lower()), Adapter(device))
    driver = timer = None
    with suppress(OSError):
        driver = (root / "sys/class/tty" / Path(device).name / "device/driver").readlink().name
    with suppress(OSError, ValueError):
        timer = int(_under(root, _timer(device)).read_text())
    found = replace(found, driver=driver or "", latency_timer=timer)
    return None if found == Adapter(device) else found


def find_again(last: Adapter) -> Adapter:
    """Find an adapter that was unplugged, under whatever name it has now. Raises PortError.

    It is known by its serial number. Where several have the same, as cheap ones do, it is the one that is plugged in
    where it was.
    """
    there = adapters()
    same = [one for one in there if _identity(one) == _identity(last)]
    if len(same) > 1 and (here := [one for one in same if one.location == last.location]):
        same = here
    if len(same) == 1:
        return same[0]
    names = ", ".join(f"{one.device} ({one})" for one in same or there if one.vid is not None) or "no USB adapter"
    why = "cannot be told from others: plug it in where it was" if same else "is not plugged in"
    raise PortError(f"{last.device}: the adapter {last} {why}; there is: {names}")


def lasting_name(name: str, adapter: Adapter | None) -> str:
    """Name what is behind a port so that the name stays when the port is called otherwise.

    That is the serial number of an adapter, or where it is plugged in; of what is no USB adapter the port itself.
    """
    if adapter is None or not adapter.usb:
        return str(Path(name).absolute()) if is_device(name) and ":" not in name else name
    part = adapter.location.partition(":")[2]
    if not adapter.serial_number:
        return f"{adapter.usb} at {adapter.location or name}"
    return f"{adapter.usb} serial number {adapter.serial_number}" + f", port {part}" * bool(part)


def _identity(one: Adapter) -> tuple[int | None, int | None, str, str]:
    """Tell adapters apart, and the ports of one adapter."""
    return one.vid, one.pid, one.serial_number, one.location.partition(":")[2]


def described(port: Any) -> Adapter:
    """Give what pyserial tells of a port."""
    return Adapter(
        port.device, port.vid, port.pid, port.manufacturer or "", port.product or "", port.serial_number or "",
        port.location or "",
    )  # fmt: skip


def _timer(device: str) -> str:
    return f"/sys/bus/usb-serial/devices/{Path(device).name}/latency_timer"


def _under(root: Path, name: str) -> Path:
    """Give the place of an absolute name under another root."""
    return root / name.lstrip("/")
