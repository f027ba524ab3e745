"""A line with a clock that only the test turns: bytes in, bytes out, in hex and in seconds.

    wire = Wire(virtual_servo(RX28, 1))
    assert wire.say("FF FF 01 02 01 FB") == "FF FF 01 02 00 FC"

Everything in here knows bytes and times only, so that the facts that are tested stand in the tests.
"""

from dataclasses import dataclass
from typing import Any

from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.wire.line import VirtualLine


@dataclass(frozen=True)
class Reply:
    """What was heard after a request: bytes in hex, and when, in seconds after the request's last bit."""

    text: str
    first: float
    """The start of the first byte; nan for silence."""
    last: float
    """The end of the last byte."""
    bytes: bytes

    def __eq__(self, other: object) -> bool:
        return self.text == other if isinstance(other, str) else NotImplemented

    __hash__ = None  # type: ignore[assignment]


class Wire:
    """One line, its client at the servos' speed, and the time."""

    def __init__(self, *servos: VirtualServo, baud: float | None = None, **options: Any) -> None:
        self.line = VirtualLine(servos, **options)
        self.line.client_baud = self.baud = baud or servos[0].baud
        self.now = self.line.now

    @property
    def servo(self) -> VirtualServo:
        return self.line.servos[0]

    def say(self, request: str | bytes, *, baud: float | None = None, listen: float = 0.05) -> Reply:
        """Send bytes (hex) at once, and give all that comes back within `listen` seconds after them."""
        data = bytes.fromhex(request) if isinstance(request, str) else request
        self.line.client_baud = baud or self.baud
        self.line.send(data, self.now)
        sent = self.now + len(data) * 10 / (baud or self.baud)
        self.now = sent + listen
        runs = self.line.arrivals(self.now)
        heard = b"".join(run.data for run in runs)
        first, last = (runs[0].start - sent, runs[-1].end - sent) if runs else (float("nan"), float("nan"))
        return Reply(heard.hex(" ").upper(), first, last, heard)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.now += seconds
        self.line.run(self.now)
        self.observe()

    def observe(self) -> None:
        """Bring every servo up to now, so that its attributes can be looked at."""
        for servo in self.line.servos:
            servo.advance(self.now)

    def power_cycle(self, off: float = 1.0) -> None:
        """Switch the supply of all servos off and on again."""
        self.observe()
        for servo in self.line.servos:
            servo.power_off()
        self.now += off
        self.line.run(self.now)
        for servo in self.line.servos:
            servo.power_on(self.now)
        self.line.regroup()


def lx(text: str) -> bytes:
    """Give the bytes of a packet to LewanSoul servos: id, length, command and parameters in hex."""
    body = bytes.fromhex(text)
    return b"\x55\x55" + body + bytes([~sum(body) & 0xFF])


def dxl(text: str) -> bytes:
    """Give the bytes of a packet of Dynamixel protocol 1.0: id, length, code and parameters in hex."""
    body = bytes.fromhex(text)
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
