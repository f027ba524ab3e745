"""Real ports, opened by pyserial: device paths, COM4, socket://host:port and rfc2217://host:port.

pyserial opens, locks and configures them. Where the system gives a descriptor, the bytes go past pyserial: two
system calls for a read, one for a write.
"""

import contextlib
import errno
import os
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

import serial

from servobus.errors import PortError, PortLost
from servobus.transports import usb_adapter
from servobus.transports.base import Transport
from servobus.transports.usb_adapter import Adapter

if sys.platform != "win32":
    import fcntl
    import termios

    _TROUBLES: tuple[type[Exception], ...] = (serial.SerialException, OSError, ValueError, termios.error)
else:
    _TROUBLES = (serial.SerialException, OSError, ValueError)

LATENCY = 0.025
"""s; assumption: the usual USB adapter holds bytes back for up to 16 ms; the rest is the system's."""
NETWORK_LATENCY = 0.25
"""s; assumption: what a network, a wireless or a distant one too, and the device at its other end may need."""
UARTS = {"ch341", "cp210x", "ftdi_sio", "pl2303", "serial", "serial8250", "uart-pl011"}
"""Drivers of chips whose bytes surely take their time. Boards that speak USB themselves (cdc_acm) need not."""
STUCK = 1.0
"""s after which a port that takes no bytes is given up; a packet leaves within 0.3 s at the slowest speed."""
CHUNK = 4096
PACE = 0.0005
"""s between two looks at a port that cannot be waited on."""

_Wait = Callable[[float], list[tuple[int, int]]]


class SerialPort(Transport):
    """A port that pyserial opens and configures. Opening sends nothing and leaves torque as it is.

    One thread may read at a time; another may write meanwhile.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name, self.baud = name, baud
        self.adapter: Adapter | None = None
        """What is known about the adapter; as it was when the port was opened."""
        self.low_latency = False
        """Whether the system was told to hand bytes over at once, and does so."""
        self._port: Any = None
        self._fd: int | None = None
        self._wait: _Wait = _closed
        self._open(name)

    def write(self, data: bytes) -> None:
        if self._fd is None:
            self._write_slowly(data)
            return
        try:
            sent = os.write(self._fd, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise self._gone("while writing", error) from error
        if sent != len(data):
            self._push(data, sent)

    def read(self, timeout: float) -> bytes:
        if self._fd is None:
            return self._read_slowly(timeout)
        if not self._wait(max(timeout, 0.0)):  # below 0 it would wait for ever
            return self._silence(self._fd)
        try:
            if data := os.read(self._fd, CHUNK):
                return data
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._gone("while reading", error) from error
        return self._read_again()

    def pending(self) -> bool:
        if self._fd is None:
            return bool(self._waiting())
        events = self._wait(0)
        if not events:
            return False
        if not events[0][1] & select.POLLIN:
            raise self._gone("while idle")
        return True

    def set_baud(self, baud: int) -> None:
        if baud == self.baud:
            return
        if not self._port.is_open:
            raise self._gone("while its speed was changed")
        try:
            self._port.baudrate = baud
        except _TROUBLES as error:
            if self._is_gone():
                raise self._gone("while its speed was changed", error) from error
            raise PortError(f"{self.name} cannot be set to {baud} baud ({error})") from error
        self.baud = baud

    def close(self) -> None:
        if self._fd is not None:
            self._fd, self._wait = -1, _closed
        # pyserial does not close a socket that the other end has hung up on.
        own = getattr(self._port, "_socket", None)
        with contextlib.suppress(*_TROUBLES):
            self._port.close()
        if own is not None:
            own.close()

    def reopen(self) -> None:
        """Open the port again, at the same speed, after it was lost or closed.

        A USB adapter with a serial number is found under whatever name it has now; `name` follows it. Raises
        PortError that says what was looked for and what is there.
        """
        self.close()
        name = self.name
        if self.adapter is not None and self.adapter.serial_number:
            found = usb_adapter.find_again(self.adapter)
            if not usb_adapter.is_device(name) or usb_adapter.real_name(name) != found.device:
                name = found.device
        self._open(name)
        self.name = name

    @property
    def lasting_name(self) -> str:
        return usb_adapter.lasting_name(self.name, self.adapter)

    def fileno(self) -> int | None:
        return None if self._fd == -1 else self._fd

    # Opening

    def _open(self, name: str) -> None:
        url, wired = "://" in name, usb_adapter.is_wired(name)
        if wired and (holders := usb_adapter.holders(name)).others:
            # A second program on the same wire would garble both; not all of them lock the port.
            raise PortError(_in_use(name, holders))
        try:
            port = serial.serial_for_url(name, do_not_open=True)
            port.baudrate = self.baud
            port.timeout = 0
            if not url and os.name == "posix":
                port.exclusive = True
            port.open()
        except _TROUBLES as error:
            raise PortError(_explain(name, error)) from error
        self._port = port
        self._fd = _descriptor(port, name)
        if self._fd is None:
            with contextlib.suppress(NotImplementedError):  # rfc2217, which has one of its own
                port.write_timeout = STUCK
        else:
            self._wait = _waiting_on(self._fd)
        if wired:
            _keep_others_out(self._fd)
        self.latency = NETWORK_LATENCY if url else LATENCY
        self.has_speed = not name.startswith("socket://")
        self.low_latency = _ask_for_low_latency(port)
        if wired:
            self.adapter = usb_adapter.adapter(name)
            self.timed = self.adapter is not None and self.adapter.driver in UARTS
            self.latency = (self.adapter and self.adapter.latency) or LATENCY

    # Trouble

    def _silence(self, fd: int) -> bytes:
        """Give nothing, unless nothing came because the descriptor was closed under us: epoll does not tell."""
        try:
            os.fstat(fd)
        except OSError as error:
            raise self._gone("while reading", error) from error
        return b""

    def _read_again(self) -> bytes:
        """Find out what it means that there was something to read and then nothing: the end, or another reader."""
        events = self._wait(0)
        if not events:
            return b""
        if self._fd is not None and events[0][1] == select.POLLIN:
            with contextlib.suppress(OSError):
                if data := os.read(self._fd, CHUNK):
                    return data
        raise self._gone("while reading")

    def _push(self, data: bytes, sent: int) -> None:
        """Send what the port did not take at once. Raises PortLost if it takes nothing for a while."""
        fd = -1 if self._fd is None else self._fd
        poll = select.poll()
        poll.register(fd, select.POLLOUT)
        deadline = time.monotonic() + STUCK
        while sent < len(data):
            if (left := deadline - time.monotonic()) <= 0 or not poll.poll(left * 1000):
                raise PortLost(
                    f"{self.name}: took {sent} of {len(data)} bytes and no more within {STUCK:g} s; "
                    "does its other end still work?"
                )
            try:
                taken = os.write(fd, data[sent:])
            except BlockingIOError:
                taken = 0
            except OSError as error:
                raise self._gone("while writing", error) from error
            if taken:
                sent += taken
                deadline = time.monotonic() + STUCK
            else:
                time.sleep(PACE)  # never busy, whatever the driver of the port says

    def _is_gone(self) -> bool:
        if self._fd is None:
            return not getattr(self._port, "is_open", False)
        events = self._wait(0)
        return bool(events) and bool(events[0][1] & (select.POLLHUP | select.POLLERR | select.POLLNVAL))

    def _gone(self, when: str, error: Exception | None = None) -> PortError:
        if self._fd == -1 or (self._fd is None and not self._port.is_open):
            return PortError(f"{self.name} is closed")
        why = f" ({getattr(error, 'strerror', None) or error})" if error is not None else ""
        hint = "did its other end hang up, or serve another client?" if "://" in self.name else "is it unplugged?"
        return PortLost(f"{self.name}: the port went away {when}{why}; {hint}")

    # Ports without a descriptor: Windows, and rfc2217 whose bytes a thread of pyserial collects

    def _write_slowly(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except _TROUBLES as error:
            raise self._gone("while writing", error) from error

    def _read_slowly(self, timeout: float) -> bytes:
        deadline = time.monotonic() + timeout
        while not self._waiting():
            if time.monotonic() >= deadline:
                return b""
            time.sleep(PACE)
        data = b""
        while waiting := self._waiting():  # some give one byte at a time
            try:
                data += self._port.read(waiting)
            except _TROUBLES as error:
                raise self._gone("while reading", error) from error
        return data

    def _waiting(self) -> int:
        try:
            waiting: int = self._port.in_waiting
        except _TROUBLES as error:
            raise self._gone("while reading", error) from error
        # pyserial's rfc2217 port does not notice by itself that its thread has ended.
        thread = getattr(self._port, "_thread", None)
        if not waiting and thread is not None and not thread.is_alive():
            raise self._gone("while reading")
        return waiting


def _waiting_on(fd: int) -> _Wait:
    """Make the function that waits for bytes, s. The system counts whole milliseconds, rounded up."""
    if hasattr(select, "epoll"):
        epoll = select.epoll()  # it remembers what it waits for, and so costs half of what poll does
        epoll.register(fd, select.POLLIN)
        return epoll.poll
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return lambda timeout: poll.poll(timeout * 1000)


def _closed(_: float) -> list[tuple[int, int]]:
    """Stand in for waiting on a port that was closed: there is something to find out, at once."""
    return [(-1, select.POLLNVAL)]


def _descriptor(port: Any, name: str) -> int | None:
    """Find a descriptor that can be waited on and carries the bytes as they are."""
    if os.name != "posix" or ("://" in name and not name.startswith("socket://")):
        return None
    number: int = port.fileno()
    if name.startswith("socket://"):
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(number)) as own:
            own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # requests are small and urgent
    return number


def _keep_others_out(fd: int | None) -> None:
    """Have the system refuse programs that open the port without asking for a lock."""
    if sys.platform != "win32" and fd is not None:
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCEXCL)


def _ask_for_low_latency(port: Any) -> bool:
    """Have bytes handed over at once, where the system and the adapter can."""
    with contextlib.suppress(AttributeError, NotImplementedError, *_TROUBLES):
        port.set_low_latency_mode(True)
        return True
    return False


def _explain(name: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    text = str(error)
    if address := re.fullmatch(r"(?:tcp://)?([^/]+:\d+)/?", name):
        return f"{name}: no such port; a TCP port is written socket://{address[1]}"
    if number == errno.ENOENT or "No such file" in text or "FileNotFoundError" in text:
        return f"{name}: no such port; `servobus ports` lists what is plugged in"
    if number == errno.EACCES or "Permission denied" in text or "PermissionError" in text:
        return f"{name}: {_not_permitted(name)}"
    if "exclusively lock" in text or number == errno.EBUSY:
        return _in_use(name, usb_adapter.holders(name))
    if "Inappropriate ioctl" in text:
        return f"{name} is no serial port; `servobus ports` lists what is plugged in"
    if number == errno.EISDIR:
        return f"{name} is a folder, and no serial port; `servobus ports` lists what is plugged in"
    # pyserial says the name again, and the reason twice.
    reason = re.sub(r"^(\[Errno \d+\] )?(could not open port [^ ]+: )?(\[Errno \d+\] )?", "", text, flags=re.IGNORECASE)
    return f"{name}: cannot be opened ({reason})"


def _not_permitted(name: str) -> str:
    about = usb_adapter.access(name)
    if about is None:
        return "in use by another program; end that first"  # Windows says so of ports that are open
    if about.allowed or not about.remedy:
        return "no permission"
    owner = f"; it belongs to the group {about.group}" if about.group else ""
    again = ", then log out and in again" if about.group and not about.member else ""
    return f"no permission{owner}: {about.remedy}{again}"


def _in_use(name: str, holders: usb_adapter.Holders) -> str:
    return f"{name}: in use by {holders}; end that first"
