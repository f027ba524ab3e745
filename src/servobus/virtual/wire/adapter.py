"""The adapter between the receiver at the client's end of the wire and the client: in which pieces bytes come.

    whole       a reply in one piece, as soon as its last byte is on the line
    none        each byte by itself, at its own time
    usb:16ms    what came in so long, 62 bytes at most, as a USB adapter with a latency timer hands it over
    fifo:14     that many bytes, or fewer after a pause, as a UART with a FIFO does

Bytes keep their order here: what waits makes everything behind it wait. Only a late reply, which is a fault, leaves its
place; it is let in where the line has a gap.
"""

import bisect
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, Self

from servobus.core.units import parse
from servobus.errors import BadValue
from servobus.virtual.wire.uart import EPSILON, ReceivedBytes, Transmission

LATENCY_TIMER = 0.016
"""s; what FTDI's driver sets in its adapters (FTDI AN232B-04, 3.3). Assumption: it runs from the first byte on."""
LONGEST_TIMER = 0.255
"""s; it is one byte, in ms (FTDI AN232B-04, 3.3)."""
USB_PACKET = 62
"""Bytes of a packet of 64 beside the two of the adapter's status (FTDI AN232B-04, 2.1)."""
FIFO_LEVELS = 1, 4, 8, 14
"""Bytes of 16 at which the FIFO of a 16550 calls for the processor (PC16550D, FIFO control register)."""
FIFO_TIMEOUT = 4
"""Times of a byte without another one, after which it calls all the same (PC16550D, FIFO interrupt mode)."""
FORMS: Final = (
    f"whole, none, usb, usb:TIME such as usb:1ms, fifo, fifo:N with N one of {', '.join(map(str, FIFO_LEVELS))}"
)


@dataclass(frozen=True, slots=True)
class Adapter:
    """In which pieces an adapter hands over what it receives.

    kind     "whole", "none", "usb" or "fifo"; see the head of this module
    latency  s from the first byte of a piece until it is handed over; for "usb"
    size     bytes with which a piece is handed over at once; None for "whole"
    """

    kind: str = "whole"
    latency: float = 0.0
    size: int | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read "whole", "none", "usb:16ms" or "fifo:14". Raises BadValue."""
        kind, _, argument = text.strip().lower().partition(":")
        try:
            match kind:
                case "whole" if not argument:
                    return cls()
                case "none" if not argument:
                    return cls("none", size=1)
                case "usb":
                    return cls.usb(parse(argument, "s") if argument else LATENCY_TIMER)
                case "fifo":
                    level = int(argument) if argument else FIFO_LEVELS[-1]
                    if level in FIFO_LEVELS:
                        return cls("fifo", size=level)
        except ValueError as error:
            raise BadValue(f"adapter {text!r}: {error}; an adapter is {FORMS}") from None
        raise BadValue(f"adapter {text!r} is none of {FORMS}")

    @classmethod
    def usb(cls, latency: float) -> Self:
        """Make one with a latency timer of so many s. Raises BadValue."""
        if not 0 <= latency <= LONGEST_TIMER:
            raise BadValue(f"a latency timer of {latency:g} s is not in 0 .. {LONGEST_TIMER:g} s")
        return cls("usb", latency, USB_PACKET)

    def __str__(self) -> str:
        match self.kind:
            case "usb":
                return f"usb:{1000 * self.latency:g}ms"
            case "fifo":
                return f"fifo:{self.size}"
        return self.kind

    def delay(self, baud: float | None) -> float:
        """Give how much later than its last bit a reply may be handed over, s, to a client at this speed in bit/s."""
        if self.kind == "fifo" and baud:
            return FIFO_TIMEOUT * 10 / baud
        return self.latency


WHOLE: Final = Adapter()


@dataclass(slots=True)
class Delivery:
    """What is handed over for the bytes of one wave, and when."""

    parts: list[bytes]
    """For each byte of the wave."""
    pauses: dict[int, float] = field(default_factory=dict)
    """Byte -> s for which everything from there on waits."""
    hold: float | None = None
    """s at most for which all of it is held until something else comes."""
    late: float | None = None
    """s by which all of it is late, while others pass."""
    jitter: float = 0.0
    """s by which each piece comes later than the adapter alone would have it."""

    @property
    def data(self) -> bytes:
        return b"".join(self.parts)


def plain(data: bytes) -> Delivery:
    """Give the plan that changes nothing."""
    return Delivery([bytes((byte,)) for byte in data])


class Handover:
    """Takes what arrives and hands it over in the adapter's pieces.

    `wire` holds the waves that the client's receiver listens to, in the order of their start.
    """

    def __init__(self, adapter: Adapter, wire: Sequence[Transmission], now: float) -> None:
        self.adapter = adapter
        self._wire = wire
        self._out: deque[ReceivedBytes] = deque()
        self._last = now
        """Time at which the last byte of these is handed over."""
        self._blocked_until = now
        self._piece: list[bytes] = []
        """What has come and is not yet handed over."""
        self._size = 0
        """Bytes received for it."""
        self._began = self._due = now
        """When it began on the wire, and when it is handed over at the latest."""
        self._wave: Transmission | None = None
        """What the last byte of it was a part of."""
        self._jitter = 0.0
        self._held: list[ReceivedBytes] = []
        self._holder: Transmission | None = None
        self._held_until = math.inf
        self._late: list[tuple[float, bytes]] = []

    def follow(self, other: "Handover") -> None:
        """Go on with the piece that another one has begun; what faults hold back there is lost."""
        self._piece, self._size, self._wave = other._piece, other._size, other._wave
        self._began, self._due = other._began, other._due

    def take(self, run: ReceivedBytes) -> None:
        """Take what the receiver has received."""
        self._pass(run.start)
        if self._holder is not None and run.wave is not self._holder:
            self._flush()
            self._release(run.wave.end if run.wave else run.end)
        plan = _plan(run)
        if plan is not None and plan.hold is not None and run.at == 0 and run.wave is not None:
            self._flush()
            self._holder, self._held_until = run.wave, run.wave.end + plan.hold
        step = (run.end - run.start) / len(run.data)
        if plan is None and self.adapter.kind == "whole":
            self._collect(run.data, run.start + step, step, run, run.at)
            return
        for i, byte in enumerate(run.data):
            time, at, data = run.start + (i + 1) * step, run.at + i, bytes((byte,))
            if plan is not None:
                if at in plan.pauses:
                    self._flush()  # what is in front of the pause does not wait for its end
                    self._blocked_until = max(self._blocked_until, time + plan.pauses[at])
                data = plan.parts[at]
                if data:
                    self._jitter = plan.jitter
            if data:
                self._collect(data, time, step, run, at)

    def take_late(self, time: float, data: bytes) -> None:
        """Hand these bytes over at that time, or as soon then as the line has a gap."""
        bisect.insort(self._late, (time, data), key=_time_of)

    def due(self, now: float) -> list[ReceivedBytes]:
        """Give what is handed over by now and was not given yet; the end of each is when that happened."""
        self._pass(now)
        runs: list[ReceivedBytes] = []
        while self._out and self._out[0].end <= now + EPSILON:
            runs.append(self._out.popleft())
        return runs

    def next_event(self, arriving: ReceivedBytes | None) -> float | None:
        """Give a time up to which nothing more is handed over; None if nothing is known to come.

        `arriving` is what the receiver receives next.
        """
        times = [self._out[0].end] if self._out else []
        times += [time for time, _ in self._waiting()]
        if arriving is not None:
            times.append(self._first(arriving))
        return min(times, default=None)

    # Pieces

    def _collect(self, data: bytes, time: float, step: float, run: ReceivedBytes, at: int) -> None:
        """Add what came at this time to the piece, or begin the next one with it."""
        adapter = self.adapter
        if self._piece and (time > self._due + EPSILON or (adapter.kind == "whole" and run.wave is not self._wave)):
            self._flush()
        if not self._piece:
            self._began = time - step
            self._due = time + adapter.latency + self._jitter
        match adapter.kind:
            case "whole":
                self._due = self._end(run, at) + self._jitter
            case "fifo":
                self._due = time + FIFO_TIMEOUT * step + self._jitter
        self._wave = run.wave
        self._piece.append(data)
        self._size += 1
        if adapter.size is not None and self._size >= adapter.size:
            self._due = time + self._jitter
            self._flush()

    def _end(self, run: ReceivedBytes, at: int) -> float:
        """Give the end of the reply, up to the next pause within it, that this byte is a part of."""
        if run.wave is None:  # several senders at once: the end of the last one that is heard here
            return max((wave.end for wave in self._wire if wave.start <= run.end <= wave.end), default=run.end)
        plan = _plan(run)
        pauses = [pause for pause in plan.pauses if pause > at] if plan is not None else []
        return run.wave.time(min(pauses)) if pauses else run.wave.end

    def _first(self, run: ReceivedBytes) -> float:
        """Give a time up to which nothing of these bytes is handed over."""
        adapter = self.adapter
        if adapter.kind == "whole":
            return max(self._end(run, run.at), run.start + EPSILON)
        step = (run.end - run.start) / len(run.data)
        left = (adapter.size or 1) - self._size
        if left <= len(run.data):
            full = run.start + left * step
            return min(full, run.start + step + adapter.latency) if adapter.kind == "usb" else full
        return run.end if adapter.kind == "fifo" else run.start + step + adapter.latency

    def _flush(self) -> None:
        """End the piece: it is handed over when it is due."""
        if self._piece:
            data, self._piece, self._size = b"".join(self._piece), [], 0
            self._put(data, self._due, self._began)

    def _put(self, data: bytes, time: float, start: float) -> None:
        if self._holder is not None:
            self._held.append(ReceivedBytes(data, start, time, time, from_servo=True))
            return
        self._last = max(time, self._blocked_until, self._last)
        self._out.append(ReceivedBytes(data, start, self._last, self._last, from_servo=True))

    # What happens by itself

    def _waiting(self) -> Iterator[tuple[float, str]]:
        if self._piece:
            yield self._due, "piece"
        if self._late:
            yield self._gap(self._late[0][0]), "late"
        if self._holder is not None and self._held_until < math.inf:
            yield self._held_until, "hold"

    def _pass(self, until: float) -> None:
        """Let happen what is due by then, in the order of time."""
        while self._piece or self._late or self._holder is not None:
            time, what = min(self._waiting(), key=_time_of, default=(math.inf, ""))  # a piece comes first
            if time > until + EPSILON:
                return
            match what:
                case "piece":
                    self._flush()
                case "hold":
                    self._flush()
                    self._release(time)
                case "late":
                    if self._holder is not None:
                        self._release(time)
                    self._put(self._late.pop(0)[1], time, time)

    def _release(self, time: float) -> None:
        """Let go what is held, no earlier than this."""
        self._holder, held, self._held = None, self._held, []
        self._held_until = math.inf
        self._blocked_until = max(self._blocked_until, time)
        for run in held:
            self._put(run.data, time, run.start)

    def _gap(self, time: float) -> float:
        """Give the first time from then on at which nothing is being received, as far as is known."""
        for wave in self._wire:
            if wave.start + EPSILON < time < wave.end - EPSILON:
                time = wave.end
        return time


def _plan(run: ReceivedBytes) -> Delivery | None:
    return run.wave.note if run.wave is not None and isinstance(run.wave.note, Delivery) else None


def _time_of(item: tuple[float, object]) -> float:
    return item[0]
