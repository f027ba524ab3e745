"""A port whose answers are written down beforehand, on a clock that only waiting advances."""

from servobus.bus.blocking import Bus
from servobus.link.link import Link
from servobus.transports.base import Transport


class Scripted(Transport):
    """Answers each request with the next entry of the script.

    An entry is the bytes (hex) that come back, or None for silence. `requests` holds what was sent (hex).
    `delay` is how long after the request an answer comes.
    """

    name = "scripted"
    latency = 0.001

    def __init__(self, *script: str | None, delay: float = 0.0005, baud: int = 57_600) -> None:
        self.script = list(script)
        self.delay = delay
        self.baud = baud
        self.requests: list[str] = []
        self.bauds: list[int] = []
        self.closed = False
        self._now = 0.0
        self._due: list[tuple[float, bytes]] = []

    def write(self, data: bytes) -> None:
        self.requests.append(data.hex(" ").upper())
        answer = self.script.pop(0) if self.script else None
        if answer is not None:
            self._due.append((self._now + 10 * len(data) / self.baud + self.delay, bytes.fromhex(answer)))

    def read(self, timeout: float) -> bytes:
        if self._due and self._due[0][0] <= self._now + timeout:
            when, data = self._due.pop(0)
            self._now = max(self._now, when)
            return data
        self._now += timeout
        return b""

    def set_baud(self, baud: int) -> None:
        self.baud = baud
        self.bauds.append(baud)

    def close(self) -> None:
        self.closed = True

    def blocking(self) -> bool:
        return False

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += seconds


def own_link(bus: Bus) -> Link:
    """Give the link of a bus that has its port itself."""
    assert isinstance(bus.link, Link)
    return bus.link
