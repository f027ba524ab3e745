"""When what was sent has left the wire, and when its answer must be here."""

import math
from typing import Any

from servobus.core.exchange import Exchange
from servobus.core.framing import BITS_PER_BYTE, Framing
from servobus.core.values import frozen
from servobus.link.stats import Counts
from servobus.transports.base import Transport


@frozen
class Timing:
    """What the fast path needs to know of an exchange at one speed."""

    exchanges: tuple[Exchange[Any], ...]
    """The exchange, alone."""
    window: float
    """s from the first bit of the request to the last of the reply, at most."""
    wire: float
    """s of these that the bits take."""
    soon: float
    """s from the first bit of the request until another may be sent though no reply has come."""
    counts: Counts


class LineClock:
    """The times of one line, in seconds of the transport's clock.

    clear_at    when the last byte of the last request has left, or of a reply that nothing waits for any more has come;
                0 once the request is answered, which shows that it has left
    settled_at  from when on a change of speed cannot spoil what was sent: an adapter may send later than it was told
    changed_at  when the speed was last changed after something had been sent at the old one
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.clear_at = 0.0
        self.settled_at = 0.0
        self.changed_at = -math.inf
        self._used = False
        """Whether anything was sent since the speed last changed."""

    @property
    def byte_time(self) -> float:
        return BITS_PER_BYTE / self._transport.baud

    def note_sent(self, at: float, size: int, *, answered: bool) -> None:
        """Note that so many bytes were handed to the port at this time; they leave behind those before them."""
        self._used = True
        self.clear_at = self.settled_at = max(at, self.clear_at) + size * self.byte_time
        if not answered:
            self.settled_at += self._transport.latency  # no answer will tell when the adapter has really sent it

    def note_began(self, at: float, size: int) -> None:
        """Note a request of so many bytes that began to leave at this time, behind nothing else: on the fast path."""
        self.clear_at = self.settled_at = at + size * self.byte_time

    def note_broken_off(self, until: float) -> None:
        """Note that the wait for a reply has ended although it may come until this time.

        On one wire a request that is sent before would meet it, and spoil both.
        """
        self.clear_at = max(self.clear_at, until)

    def note_answered(self) -> None:
        """Note that the last request was answered, so it has left."""
        self.clear_at = 0.0

    def note_baud(self) -> None:
        """Note that the speed has just changed."""
        if self._used:
            self.changed_at = self._transport.now()
            self._used = False

    def forgotten_at(self, framing: Framing) -> float:
        """Tell when servos of this kind have forgotten what they heard at the speed before.

        They hear it as garbage. A servo that took it for the start of a packet misses the next request until then, and
        as what it hears meanwhile is more of that packet to it, begins to wait anew.
        """
        at = self.changed_at + framing.forget_time
        return at if at <= self._transport.now() else max(at, self.settled_at + framing.forget_time)

    def longest_answer(self, exchange: Exchange[Any]) -> float:
        """Tell how long the replies may take at most from the moment at which the request has left, s."""
        delay = exchange.max_delay * max(len(exchange.replies), 1)
        return (1 + exchange.framing.baud_tolerance) * (delay + exchange.reply_size * self.byte_time)

    def longest_wait(self, exchange: Exchange[Any]) -> float:
        """Tell how long one of several replies may take at most from the moment at which the last one was here, s."""
        longest = exchange.framing.overhead + max(max(reply.sizes) for reply in exchange.replies)
        return (1 + exchange.framing.baud_tolerance) * (exchange.max_delay + longest * self.byte_time)

    def timing(self, exchange: Exchange[Any], counts: Counts, answered_within: float) -> Timing:
        """Work out the times of an exchange at the present speed, at which it is about to be sent.

        Its reply is off the wire so many s after the request.
        """
        self._used = True
        request = len(exchange.request) * self.byte_time
        window = request + self.longest_answer(exchange)
        wire = request + exchange.reply_size * self.byte_time
        return Timing((exchange,), window, wire, request + answered_within, counts)

    def follow(self, other: "LineClock", seconds: float) -> None:
        """Take over from the clock of another link, whose last bytes have left in so many seconds at the latest."""
        self.changed_at, self._used = other.changed_at, True
        self.clear_at = self.settled_at = self._transport.now() + seconds
