"""How long to wait for an answer, beyond what the wire and the servo take: adapter and system, measured."""

from collections import deque

from servobus.transports.base import Transport


class Latency:
    """How much later than the wire allows answers come: learned from those that come.

    worst_delay      the latest of the last some thousand, s; it fades
    usual_delay      the median of the last few, s
    reply_margin     how long to wait for one, s: twice the worst_delay, and SPARE; more where all come later than
                     LONGEST; as long as few have come, at least the transport's own guess
    """

    __slots__ = ("_recent", "_transport", "answers", "reply_margin", "worst_delay")

    SPARE = 0.004
    FLOOR = 0.010
    """s; assumption: a computer that does other things as well may look that late."""
    LONGEST = 0.15
    """s; what is later than that is a fault and no habit, unless the last FEW all were."""
    FEW = 8
    HABIT = 0.5
    """s; assumption: no port is worth waiting longer for, a network included."""
    ENOUGH = 64
    SLACK = 0.1
    """Share of its time on the wire by which an answer may seem to come too soon: clocks differ."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self.answers = 0
        self._recent: deque[float] = deque(maxlen=self.FEW)
        self.worst_delay = 0.0
        self.reply_margin = 0.0
        self.review()

    def note(self, late: float) -> None:
        """Learn from an answer that came this many seconds later than the wire allows."""
        self.answers += 1
        self._recent.append(late)
        if late > self.worst_delay:
            self.worst_delay = min(late, self.LONGEST)
            self.review()
        elif not self.answers % self.ENOUGH:
            self.worst_delay = max(late, 0.95 * self.worst_delay)
            self.review()

    @property
    def usual_delay(self) -> float:
        """How late answers come, by the last few; 0 before the first, s."""
        return max(sorted(self._recent)[len(self._recent) // 2], 0.0) if self._recent else 0.0

    def impossible(self, late: float, wire: float) -> bool:
        """Tell whether nothing that is asked now can have been answered so soon; `wire` is what the bits take, s."""
        return self._transport.timed and late < -self.SLACK * wire

    def review(self) -> None:
        """Work out the patience anew."""
        guess = self._transport.latency
        if self.answers >= self.ENOUGH:
            guess = min(guess, self.FLOOR)
        habit = min(1.5 * min(self._recent, default=0.0), self.HABIT)
        self.reply_margin = max(guess, min(2 * self.worst_delay + self.SPARE, self.LONGEST), habit)
