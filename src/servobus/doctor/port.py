"""What the system tells of a port: may it be opened, which programs have it open, and how fast its adapter is."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from servobus.bus.blocking import Bus
from servobus.connect import VIRTUAL
from servobus.doctor.findings import SHOWN, Finding, Severity
from servobus.transports import usb_adapter as facts

MEMORY_DEVICES = 1
"""Major number of /dev/null, /dev/zero and the like (Linux, devices.txt)."""
RULES = "/etc/udev/rules.d/99-servobus.rules"


def check_system(port: str, root: Path = facts.ROOT) -> Iterator[Finding]:
    """Check a port that is not open. Gives nothing for ports that the system does not know."""
    if port.startswith(VIRTUAL):
        return
    access = facts.access(port, root)
    if access is not None:
        if not access.exists:
            cause = "it is not plugged in, has another name, or the system has no driver for it"
            yield Finding(Severity.FAIL, "port", f"{port} is not there", cause, ("servobus ports", "sudo dmesg | tail"))
            return
        is_link = f" is a link to {access.real}" if access.real != port else " is there"
        yield Finding(Severity.OK, "port", port + is_link)
        yield _permission(access)
        if not access.allowed:
            return
        if _may_be_serial(access.real):
            yield _holders(port, root)
    about = facts.adapter(port, root) if facts.is_wired(port, root) else None
    if about is not None:
        driver = f", driver {about.driver}" if about.driver else ""
        place = f", at {about.location}" if about.location else ""
        yield Finding(Severity.OK, "adapter", f"{about}{driver}{place}")
        yield _timer(about)


def check_open_port(bus: Bus) -> Iterator[Finding]:
    """Check what opening a port has shown."""
    about: facts.Adapter | None = getattr(bus.transport, "adapter", None)
    if about is None:
        return
    if getattr(bus.transport, "low_latency", False):
        timer = "" if about.latency_timer is None else f": the latency timer is {about.latency_timer} ms now"
        yield Finding(Severity.OK, "low latency", f"on{timer}")
    else:
        yield Finding(Severity.UNKNOWN, "low latency", "the system or the driver has no such mode")


def _permission(access: facts.PortAccess) -> Finding:
    if access.allowed:
        return Finding(Severity.OK, "permission", "this user may read and write it")
    if access.member:
        cause = f"this user joined the group {access.group} after logging in: {access.remedy}"
        return Finding(Severity.FAIL, "permission", "this login may not open it", cause)
    cause = f"it belongs to the group {access.group}; log out and in again after joining" if access.group else ""
    return Finding(Severity.FAIL, "permission", "this user may not open it", cause, (access.remedy,))


def _may_be_serial(path: str) -> bool:
    """Tell whether it is worth a look who uses it: of a plain file, or of /dev/null, no user is to be ended."""
    try:
        about = Path(path).stat()
    except OSError:  # it cannot be told
        return True
    return stat.S_ISCHR(about.st_mode) and os.major(about.st_rdev) != MEMORY_DEVICES


def _holders(port: str, root: Path) -> Finding:
    holders = facts.holders(port, root)
    if others := holders.others:
        # The other end of a pseudo terminal may hold this one too.
        level = Severity.FAIL if facts.is_wired(port, root) else Severity.WARN
        cause = "two programs on one wire garble what both send, and take each other's answers"
        return Finding(level, "in use", f"by {holders}", cause, tuple(f"kill {one.pid}" for one in others[:SHOWN]))
    unseen = ", as far as can be seen: not what other users run" if holders.hidden else ""
    return Finding(Severity.OK, "in use", f"by nobody{unseen}")


def _timer(about: facts.Adapter) -> Finding:
    if about.latency_timer is None:
        return Finding(Severity.UNKNOWN, "latency timer", "this adapter has none, or its driver does not tell")
    what = f"{about.latency_timer} ms"
    if not about.slow:
        return Finding(Severity.OK, "latency timer", what)
    most = 1000 // about.latency_timer
    cause = f"the adapter keeps answers back for so long: some {most} reads a second at most, in every program"
    rule = about.udev_rule.replace(", ", ", \\\n  ")  # which such a file may have over several lines
    commands = about.command, f"echo '{rule}' |\n  sudo tee {RULES}", "sudo udevadm control --reload"
    return Finding(Severity.WARN, "latency timer", what, cause, commands)
