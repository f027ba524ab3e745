"""Real ports, opened by pyserial: device paths, COM4, socket://host:port and rfc2217://host:port."""

import contextlib
import errno
import os
import select
import time
from typing import Any

import serial

from servobus.errors import PortError
from servobus.transports.base import Transport

LATENCY = 0.025
"""s; assumption: the usual USB adapter holds bytes back for up to 16 ms; the rest is the system's."""
NETWORK_LATENCY = 0.1
"""s; assumption: what a local network and the device at its other end may need."""


class SerialPort(Transport):
    """A port that pyserial opens and configures. Opening sends nothing and leaves torque as it is."""

    def __init__(self, name: str, baud: int) -> None:
        self.name, self.baud = name, baud
        self.latency = NETWORK_LATENCY if "://" in name else LATENCY
        try:
            port = serial.serial_for_url(name, do_not_open=True)
            port.baudrate = baud
            port.timeout = 0
            if "://" not in name and os.name == "posix":
                port.exclusive = True  # a second program on the same wire would garble both
            port.open()
        except (serial.SerialException, OSError, ValueError) as error:
            raise PortError(_explain(name, error)) from error
        self._port: Any = port
        self._fd = _descriptor(port)

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise PortError(f"{self.name}: the port went away while writing ({error})") from error

    def read(self, timeout: float) -> bytes:
        try:
            if self._fd is not None:
                if not select.select([self._fd], [], [], max(timeout, 0))[0]:
                    return b""
                data = os.read(self._fd, 4096)
            else:
                return self._poll(timeout)
        except (serial.SerialException, OSError, ValueError, TypeError) as error:
            # A descriptor that was closed under us shows as ValueError or TypeError.
            raise PortError(f"{self.name}: the port went away while reading ({error})") from error
        if not data:
            raise PortError(f"{self.name}: the port went away (end of file)")
        return data

    def pending(self) -> bool:
        return self._fd is None or bool(select.select([self._fd], [], [], 0)[0])

    def set_baud(self, baud: int) -> None:
        if baud == self.baud:
            return
        try:
            self._port.baudrate = baud
        except (serial.SerialException, OSError, ValueError) as error:
            raise PortError(f"{self.name} cannot be set to {baud} baud ({error})") from error
        self.baud = baud

    def close(self) -> None:
        with contextlib.suppress(OSError, serial.SerialException):
            self._port.close()

    def fileno(self) -> int | None:
        return self._fd

    def _poll(self, timeout: float) -> bytes:
        """Wait on ports without a descriptor: Windows, and rfc2217 whose bytes a thread collects."""
        deadline = time.monotonic() + timeout
        while not (waiting := self._port.in_waiting):
            if time.monotonic() >= deadline:
                return b""
            time.sleep(0.0005)
        data: bytes = self._port.read(waiting)
        return data


def _descriptor(port: Any) -> int | None:
    """Find a descriptor that `select` can wait on."""
    if os.name != "posix":
        return None
    with contextlib.suppress(Exception):  # rfc2217 has none, and says so in its own way
        number = port.fileno()
        return number if isinstance(number, int) else None
    return None


def _explain(name: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    text = str(error)
    if number == errno.ENOENT or "No such file" in text or "FileNotFoundError" in text:
        return f"{name}: no such port; `servobus ports` lists what is plugged in"
    if number == errno.EACCES or "Permission denied" in text or "PermissionError" in text:
        return f"{name}: no permission; join the group that owns it (often `dialout`) and log in again"
    if "exclusively lock" in text or number == errno.EBUSY:
        return f"{name}: in use by another program; close that first"
    return f"{name}: cannot be opened ({text})"
