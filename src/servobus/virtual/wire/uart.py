"""What a serial receiver makes of what is on the wire.

A line carries levels, not bytes: high while idle, and for each byte a low start bit, eight data bits with
the lowest first, and a high stop bit (8N1, as all three families use). Senders that talk at once pull the
line low together: the wire is the AND of what they send. A receiver waits for a falling edge and looks at
the line in the middle of each bit, at its own speed. What it makes of bytes sent at another speed, or by
two senders at once, follows from that and is the same every time.
"""

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from servobus.core.framing import BITS_PER_BYTE

TOLERANCE = 0.03
"""Speeds that differ by no more than this understand each other (RX-28 manual 3-4-1)."""
EPSILON = 1e-9
"""s; a thousandth of a bit at 1 Mbit/s: times that differ by less are the same."""


def understands(heard: float, sent: float) -> bool:
    """Tell whether a receiver at one speed takes bytes sent at the other for what they are."""
    return abs(heard / sent - 1) <= TOLERANCE + EPSILON


def distort(data: bytes, sent: float, heard: float) -> bytes:
    """Give the bytes that a receiver at speed `heard` makes of bytes sent back to back at speed `sent`."""
    receiver = Receiver(heard, 0.0)
    waves = [Transmission(0.0, sent, data)]
    out = b""
    while run := receiver.next_run(waves):
        receiver.since = run.resume
        out += run.data
    return out


_LEVELS = [bytes((0, *(byte >> place & 1 for place in range(BITS_PER_BYTE - 2)), 1)) for byte in range(256)]
"""Byte -> its levels: start bit, data bits, stop bit."""


@dataclass(slots=True)
class Transmission:
    """Bytes that one sender puts on the wire back to back.

    `plain` is for clients whose speed is unknown (TCP): every receiver understands these bytes.
    """

    start: float
    """s"""
    baud: float
    data: bytes
    sender: object = None
    """The servo that sends; None for the client."""
    plain: bool = False
    note: object = None
    """Whatever its sender needs again when its bytes arrive, such as their `Delivery`."""
    end: float = field(init=False)
    _levels: bytes = field(default=b"", init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.end = self.time(len(self.data))

    @property
    def levels(self) -> bytes:
        """The level during each bit, from the idle line before the first start bit on."""
        if not self._levels:
            self._levels = b"\1" + b"".join(_LEVELS[byte] for byte in self.data)
        return self._levels

    def time(self, count: int) -> float:
        """Give the time at which this many bytes are sent."""
        return self.start + count * BITS_PER_BYTE / self.baud

    def complete(self, until: float) -> int:
        """Count the bytes that are sent whole by then."""
        if until >= self.end:
            return len(self.data)
        return max(0, min(math.floor((until - self.start + EPSILON) * self.baud / BITS_PER_BYTE), len(self.data)))

    def byte_at(self, since: float) -> int | None:
        """Give the index of the next byte for a receiver that waits for a start bit since then.

        None if the receiver is out of step: it began to wait in the middle of a byte.
        """
        behind = (since - self.start) * self.baud / BITS_PER_BYTE
        if behind <= 0:
            return 0
        index = math.ceil(behind - 1e-6)
        # The stop bit, the last tenth of a byte, is as high as an idle line.
        return index if index - behind <= 1 / BITS_PER_BYTE + 1e-6 else None

    def bit(self, index: int) -> int:
        """Give the level during one bit, counted from the first start bit."""
        return self.levels[index + 1] if 0 <= index < BITS_PER_BYTE * len(self.data) else 1

    def level(self, time: float) -> int:
        return self.bit(math.floor((time - self.start) * self.baud + 1e-6))

    def falling_edges(self, since: float) -> Iterator[float]:
        index = self.falling_edge((since - self.start) * self.baud)
        while index >= 0:
            yield self.start + index / self.baud
            index = self.falling_edge(index + 1)

    def falling_edge(self, since: float) -> int:
        """Give the next bit from this one on whose beginning is a falling edge; -1 if there is none."""
        return self.levels.find(b"\1\0", max(0, math.ceil(since - 1e-6)))


@dataclass(slots=True)
class ReceivedBytes:
    """Bytes received back to back; `resume` is when the receiver waits for the next start bit.

    Between bytes that were read off a wire at another speed there may be pauses, shorter than a byte of the sender.
    """

    data: bytes
    start: float
    end: float
    resume: float
    from_servo: bool
    """Whether any of it was sent by a servo."""
    wave: Transmission | None = None
    """What these bytes are a part of; None if they were read off a wire with several senders, or at another speed."""
    at: int = 0
    """Index of the first of them in the wave."""


class Receiver:
    """A UART that listens. `baud` None understands every speed."""

    def __init__(self, baud: float | None, since: float) -> None:
        self.baud = baud
        self.since = since
        """Time from which it waits for a start bit: all before is received."""

    def next_run(
        self, waves: Sequence[Transmission], limit: int | None = None, until: float = math.inf
    ) -> ReceivedBytes | None:
        """Give the next bytes, without taking them: set `since` to the run's `resume` for that.

        `waves` are in the order of their start. At most `limit` bytes of the client, complete by `until`,
        are given; without a limit, what is read off the wire at another speed comes byte by byte, each with its time.
        The result holds as long as no wave that starts before its end is added.
        """
        active = [wave for wave in waves if wave.end > self.since + EPSILON] if waves else waves
        if not active:
            return None
        wave = active[0]
        index = wave.byte_at(self.since)
        if index == len(wave.data):  # only its last stop bit is left
            return self.next_run(active[1:], limit, until)
        alone_until = active[1].start if len(active) > 1 else math.inf
        understood = wave.plain or self.baud is None or understands(self.baud, wave.baud)
        if index is not None and understood:
            stop = wave.complete(min(until, alone_until))
            if limit is not None and wave.sender is None:
                stop = min(stop, index + limit)
            if stop > index:
                end = wave.time(stop)
                return ReceivedBytes(
                    wave.data[index:stop], wave.time(index), end, end, wave.sender is not None, wave, index
                )
            if until <= alone_until:
                return None
        several = 1 if understood or limit is None else limit
        return self._misread(wave, min(until, alone_until), several) or self._sample(active, until)

    def _misread(self, wave: Transmission, until: float, limit: int) -> ReceivedBytes | None:
        """Read bytes, complete by then, of one sender with another speed. Times are counted in bits of the sender."""
        baud = self.baud or wave.baud
        ratio = wave.baud / baud
        middles = [(place + 1.5) * ratio + 1e-6 for place in range(BITS_PER_BYTE - 2)]
        levels, idle = wave.levels, BITS_PER_BYTE * len(wave.data)
        last = (until - wave.start + EPSILON) * wave.baud - BITS_PER_BYTE * ratio
        data = bytearray()
        since = (self.since - wave.start) * wave.baud
        begin = edge = -1
        while len(data) < limit and 0 <= (edge := wave.falling_edge(since)) <= last:
            begin = edge if begin < 0 else begin
            byte = 0
            for place, middle in enumerate(middles):
                at = int(edge + middle)
                byte |= 1 << place if at >= idle or levels[at + 1] else 0
            data.append(byte)
            since = edge + (BITS_PER_BYTE - 0.5) * ratio
        if not data:
            return None
        resume = wave.start + since / wave.baud
        return ReceivedBytes(
            bytes(data), wave.start + begin / wave.baud, resume + 0.5 / baud, resume, wave.sender is not None
        )

    def _sample(self, waves: Sequence[Transmission], until: float) -> ReceivedBytes | None:
        """Read one byte off the levels of the wire."""
        baud = self.baud or waves[0].baud
        for start in heapq.merge(*(wave.falling_edges(self.since) for wave in waves)):
            if all(wave.level(start - EPSILON) for wave in waves):
                break
        else:
            return None
        end = start + BITS_PER_BYTE / baud
        if end > until + EPSILON:
            return None
        # Data bits are looked at in their middle; a stop bit that is low is not noticed.
        bits = [all(wave.level(start + (place + 1.5) / baud) for wave in waves) for place in range(8)]
        byte = sum(bit << place for place, bit in enumerate(bits))
        servo = any(wave.sender is not None and wave.start < end and wave.end > start for wave in waves)
        return ReceivedBytes(bytes((byte,)), start, end, start + (BITS_PER_BYTE - 0.5) / baud, servo)
