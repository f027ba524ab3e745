"""Finding packets in a stream of bytes, whatever stands between them.

A `Framing` knows the shape of one protocol's packets; the `Decoder` uses it to cut any stream, in any
chunks, into events. Three things can be in a stream:

    Packet    a packet whose length and checksum are right
    Corrupt   bytes of the right shape whose checksum is wrong
    Noise     everything else

A length byte is never trusted: after a Corrupt the search goes on one byte later, so a packet that hides
behind a false header is still found. Each byte is looked at no more often than the longest packet is
long, and no more than one longest packet is ever kept: linear time, bounded memory.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TypeAlias

from servobus.core.values import frozen

BITS_PER_BYTE = 10
"""Bits of a byte on the wire: start bit, eight data bits, stop bit: 8N1, as all three families use."""


class Packet:
    """One packet without its framing: a value that is never changed.

    code  the command, instruction or error byte
    end   position in the stream just behind the last byte: with the bit time this dates the packet
    """

    __slots__ = ("code", "data", "end", "id")

    def __init__(self, id: int, code: int, data: bytes = b"", end: int = 0) -> None:
        # By hand, not `frozen`: there is one for every answer, and this takes half the time.
        self.id, self.code, self.data, self.end = id, code, data, end

    def __repr__(self) -> str:
        return f"Packet(id={self.id}, code={self.code}, data={self.data!r}, end={self.end})"

    def __eq__(self, other: object) -> bool:
        """Where a packet stood in the stream does not count."""
        return isinstance(other, Packet) and (self.id, self.code, self.data) == (other.id, other.code, other.data)

    def __hash__(self) -> int:
        return hash((self.id, self.code, self.data))


@frozen
class Corrupt:
    """A packet-shaped run of bytes that fails its checksum; `packet` is what it would have said."""

    packet: Packet
    raw: bytes


@frozen
class Noise:
    """Bytes that are no packet."""

    raw: bytes


Event: TypeAlias = Packet | Corrupt | Noise

INCOMPLETE = 0
NOT_A_FRAME = -1


class Framing(ABC):
    """The shape of one protocol's packets. Stateless."""

    name: str
    """Family of the servos that speak so; messages and counters show it."""
    header: bytes
    """The two equal bytes every packet starts with."""
    overhead: int
    """Bytes of a frame that are not data: header, id, length, code and checksum."""
    max_size: int
    """Size of the longest packet in bytes, header included."""
    filler: bytes = b""
    """A byte that no servo takes for part of a packet, to send between packets while answers come in; none where
    answers come over the same wire."""
    probe: bytes = b"\x00"
    """A byte that every servo skips before a header. It goes before a request that looks like its own answer: if it
    comes back, so does the request, and the line echoes."""
    forget_time: float = 0.21
    """s after which a servo forgets what it took for the start of a packet; what is sent at another speed may be taken
    so, and the request that comes next is then lost. As long as HerkuleX servos need, if nothing is said."""
    foreign: Mapping[bytes, str] = {}
    """How packets of other protocols begin that may be heard instead -> what they are, for people."""
    baud_tolerance: float = 0.03
    """Share by which a servo's speed may be off; assumption, as RX-28 manual 3-4-1 says of its servo."""

    @abstractmethod
    def size(self, buffer: bytes | bytearray, at: int) -> int:
        """Tell the size of the frame whose header is at `at`, INCOMPLETE or NOT_A_FRAME."""

    @abstractmethod
    def frame(self, packet: Packet) -> bytes:
        """Put a packet into its frame. Raises ValueError if it does not fit."""

    @abstractmethod
    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        """Take a frame of the right size apart; the flag tells whether its checksum is right."""

    def foreign_in(self, raw: bytes) -> str:
        """Say of which other protocol bytes are that are no packet here; "" if they do not begin as one of those."""
        return next((text for header, text in self.foreign.items() if raw.startswith(header)), "")

    def whole(self, raw: bytes) -> Packet | None:
        """Give the packet if the bytes are one good packet and nothing else."""
        if raw[:2] != self.header or self.size(raw, 0) != len(raw):
            return None
        packet, good = self.unframe(raw)
        return packet if good else None

    def decode(self, stream: bytes) -> list[Event]:
        """Cut a whole recording into events."""
        decoder = Decoder(self)
        return decoder.feed(stream) + decoder.flush()


class Decoder:
    """Cuts a stream into events, however it is chunked.

    `max_size` narrows what is believed: a wait for an 8-byte reply need not go on for a header that
    claims 200 bytes.
    """

    def __init__(self, framing: Framing, max_size: int | None = None) -> None:
        self._framing = framing
        self._limit = framing.max_size if max_size is None else min(max_size, framing.max_size)
        self._buffer = bytearray()
        self._base = 0
        """Position in the stream of the first byte in the buffer."""
        self._told = 0
        """Position up to which bytes have been handed out in a Corrupt already."""
        self._noise = bytearray()

    @property
    def pending(self) -> int:
        """Bytes kept because they may still become a packet."""
        return len(self._buffer)

    @property
    def begun(self) -> bytes:
        """What is kept because it may still become a packet."""
        return bytes(self._buffer)

    @property
    def missing(self) -> int:
        """Bytes that must come at least before anything more can be complete."""
        size = self._framing.size(self._buffer, 0) if self._buffer else INCOMPLETE
        return max(1, (size if size > 0 else self._framing.overhead) - len(self._buffer))

    @property
    def position(self) -> int:
        """Bytes fed so far."""
        return self._base + len(self._buffer)

    def feed(self, chunk: bytes) -> list[Event]:
        """Take the next bytes in and give what is complete now."""
        self._buffer += chunk
        events: list[Event] = []
        self._scan(events)
        if not self._buffer or len(self._noise) > self._framing.max_size:
            self._end_noise(events)
        return events

    def flush(self) -> list[Event]:
        """Say that the line went quiet: what is incomplete will stay so and is searched for packets."""
        events: list[Event] = []
        while self._buffer:
            self._skip(1)
            self._scan(events)
        self._end_noise(events)
        return events

    def drop(self) -> bytes:
        """Forget what is incomplete, as firmware does after its inter-byte time-out."""
        dropped = bytes(self._buffer)
        self._skip(len(dropped))
        self._noise.clear()
        return dropped

    def _scan(self, events: list[Event]) -> None:
        buffer, framing = self._buffer, self._framing
        at = taken = 0
        """Index of the candidate header; bytes before `taken` are dealt with."""
        while True:
            at = buffer.find(framing.header, at)
            if at < 0:
                half = 1 if buffer and buffer[-1] == framing.header[0] else 0
                at = max(taken, len(buffer) - half)
                break
            size = framing.size(buffer, at)
            if size == INCOMPLETE:
                break
            if size == NOT_A_FRAME or size > self._limit:
                at += 1
                continue
            if len(buffer) - at < size:
                break
            raw = bytes(buffer[at : at + size])
            packet, good = framing.unframe(raw)
            end = self._base + at + size
            packet = Packet(packet.id, packet.code, packet.data, end)
            self._note(taken, at)
            self._end_noise(events)
            if good:
                events.append(packet)
                at += size
                taken = at
                self._told = max(self._told, end)
            else:
                events.append(Corrupt(packet, raw))
                self._told = max(self._told, end)
                taken = at
                at += 1
        self._note(taken, at)
        del buffer[:at]
        self._base += at

    def _note(self, start: int, stop: int) -> None:
        """Remember buffer[start:stop] as noise, less what a Corrupt showed already."""
        start = max(start, self._told - self._base)
        if start < stop:
            self._noise += self._buffer[start:stop]

    def _skip(self, count: int) -> None:
        self._note(0, count)
        del self._buffer[:count]
        self._base += count

    def _end_noise(self, events: list[Event]) -> None:
        if self._noise:
            events.append(Noise(bytes(self._noise)))
            self._noise.clear()
