"""What the servos of one family have made of requests to another that went over the same line at the same speed.

A HerkuleX takes the id of a Dynamixel instruction packet for the size of a packet, and what comes next for the rest of
it: after FF FF DB 02 01 21 it waits for 213 bytes more, and hears no request until then. The other way round, and with
LewanSoul servos, it is alike. So before a request to servos of another kind than the last ones, what these have heard
is decoded as they would. If the request would not be heard, padding bytes end the packet that they wait for.

Only our own bytes count: the answers of servos of another family are not looked at. What was sent at another speed
nobody can foresee, see `LineClock.forgotten_at`. That a servo finds packets as our decoder does is an assumption.
"""

from collections import deque

from servobus.core.framing import Decoder, Framing

KEPT = 64
"""Requests that are kept: the longest packet of any family is filled by fewer."""


class Overheard:
    """What was sent at the present speed, as far back as it can matter. `last` is the kind of the last bytes."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Framing, bytes]] = deque(maxlen=KEPT)
        self.last: Framing | None = None

    def note(self, until: float, framing: Framing, data: bytes) -> None:
        """Note bytes that have left by this time."""
        self._sent.append((until, framing, data))
        self.last = framing

    def forget(self) -> None:
        """Forget all: the speed is another."""
        self._sent.clear()
        self.last = None

    def padding(self, framing: Framing, now: float, request: bytes = b"") -> bytes:
        """Give what must be sent so that servos of this kind hear the request; without one, so that they wait for none.

        Empty if they hear it anyway.
        """
        if self.last is framing or self.last is None:
            return b""
        heard = self._heard_by(framing, now)
        decoder = Decoder(framing)
        events = decoder.feed(heard + request)
        if not decoder.pending and (not request or (events and events[-1] == framing.unframe(request)[0])):
            return b""
        decoder = Decoder(framing)
        decoder.feed(heard)
        padding = b""
        while decoder.pending:
            more = framing.probe * decoder.missing
            decoder.feed(more)
            padding += more
        return padding

    def _heard_by(self, framing: Framing, now: float) -> bytes:
        """Give what servos of this kind heard since the last request to them, or a pause that ends any packet."""
        heard: list[bytes] = []
        later = now
        for until, kind, data in reversed(self._sent):
            if kind is framing or later - until > framing.forget_time:
                break
            heard.append(data)
            later = until
        return b"".join(reversed(heard))
