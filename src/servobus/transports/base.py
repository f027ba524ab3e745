"""What a driver needs of a port: bytes out, bytes in, and a clock."""

import time
from abc import ABC, abstractmethod

from servobus.errors import PortError


class Transport(ABC):
    """A byte stream with a speed and a clock.

    The clock belongs to the transport because virtual servos may run on virtual time: there, time passes only while
    a caller waits in `read` or `sleep`.
    """

    name: str
    """The port as the user named it."""
    baud: int
    latency: float = 0.0
    """Seconds that a reply may be late for reasons of the adapter and the system, not of the servo."""
    timed: bool = False
    """Whether bytes surely take the time here that the speed says: no answer can come sooner than its bits allow."""
    baud_elsewhere: bool = False
    """Whether the speed on the wire is set by what serves this port (TCP): `set_baud` changes nothing on the wire."""

    remote: bool = False
    """Whether another process owns the port: then exchanges go there as values, and `write` and `read` carry no bytes
    of servos."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes. Raises PortLost if the port is gone."""

    @abstractmethod
    def read(self, timeout: float) -> bytes:
        """Give what has arrived; wait up to `timeout` seconds for the first byte. Empty means silence.

        Raises PortLost if the port is gone.
        """

    @abstractmethod
    def set_baud(self, baud: int) -> None:
        """Talk at this speed, bit/s, from now on. Raises PortError if the port cannot, PortLost if it is gone."""

    @abstractmethod
    def close(self) -> None:
        """Give the port back. May be called twice."""

    def reopen(self) -> None:
        """Open the port again, at the same speed, after it was lost or closed. Raises PortError if it is not there."""
        raise PortError(f"{self.name} cannot be opened again")

    def pending(self) -> bool:
        """Tell whether bytes may have arrived that were not read yet; True where only reading tells.

        A port that can say False has `time.monotonic` for its clock.
        """
        return True

    @property
    def lasting_name(self) -> str:
        """The name under which its servos are remembered: that of the adapter, whatever the port is called now."""
        return self.name

    def fileno(self) -> int | None:
        """Give a descriptor that turns readable when bytes arrive, or None if there is no such thing."""
        return None

    def blocking(self) -> bool:
        """Tell whether `read` may take real time, so that an event loop must not call it directly."""
        return True

    def discard(self) -> bytes:
        """Throw away what has arrived, and give it; of a port that never stops, some of it."""
        dropped = b""
        while len(dropped) < 65536 and (chunk := self.read(0)):
            dropped += chunk
        return dropped

    def now(self) -> float:
        """Give the time of this port's clock in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)


class MissingPort(Transport):
    """Stands in the place of a port that could not be opened: whoever asks something of it is told why."""

    def __init__(self, name: str, why: PortError) -> None:
        self.name, self.baud = name, 0
        self._why = str(why)

    def write(self, data: bytes) -> None:  # noqa: ARG002 - nothing is sent
        raise PortError(self._why)

    def read(self, timeout: float) -> bytes:  # noqa: ARG002 - nothing can come
        raise PortError(self._why)

    def set_baud(self, baud: int) -> None:  # noqa: ARG002 - there is nothing that has a speed
        raise PortError(self._why)

    def close(self) -> None:
        """There is nothing to give back."""
