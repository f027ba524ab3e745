"""What happened on a bus, in numbers: `print(bus.stats)`."""

COLUMNS = (
    "sent", "received", "timeouts", "checksum", "strangers", "late", "doubled", "echo", "junk", "retries", "worst",
)  # fmt: skip


class Counts:
    """Counters of one servo, or of a whole bus.

    sent       requests
    received   answers that fit
    timeouts   requests that should have been answered and met silence
    checksum   packets with a wrong checksum
    strangers  good packets that answered nothing
    late       answers that came after they had been given up
    doubled    second answers to one question
    echo       echoes that were not what was sent
    junk       bytes that were no packet
    retries    requests that were sent again
    worst      longest time that an answer came later than its bits allow, s: return delay, adapter and system
    """

    __slots__ = COLUMNS

    def __init__(self) -> None:
        self.sent = self.received = self.timeouts = self.checksum = self.strangers = self.late = 0
        self.doubled = self.echo = self.junk = self.retries = 0
        self.worst = 0.0

    def __repr__(self) -> str:
        """Show what is not 0, and how many were sent and received in any case."""
        names = [name for name in COLUMNS if name in ("sent", "received") or getattr(self, name)]
        return f"<{', '.join(f'{name} {_cell(self, name)}' for name in names)}>"

    @property
    def failed(self) -> int:
        """Requests whose answer was not to be had at once."""
        return self.timeouts + self.checksum + self.echo


class Stats:
    """Counters by id; `total` sums them up. Broadcasts count under id 254."""

    def __init__(self) -> None:
        self.servos: dict[int, Counts] = {}

    def __getitem__(self, id: int) -> Counts:
        """Give the counters of one id; they begin at 0 for one never asked."""
        counts = self.servos.get(id)
        if counts is None:
            counts = self.servos[id] = Counts()
        return counts

    @property
    def total(self) -> Counts:
        total = Counts()
        for counts in self.servos.values():
            for name in COLUMNS:
                both = getattr(total, name), getattr(counts, name)
                setattr(total, name, max(both) if name == "worst" else sum(both))
        return total

    def __repr__(self) -> str:
        return f"<Stats of {len(self.servos)} ids: {repr(self.total)[1:-1]}>"

    def __str__(self) -> str:
        """Draw a table: a line for each servo that was asked, and the sum."""
        rows = [(str(id), counts) for id, counts in sorted(self.servos.items()) if counts.sent]
        head = "id".rjust(5) + "".join(name.rjust(max(6, len(name) + 1)) for name in COLUMNS)
        return "\n".join([head, *(_line(*row) for row in [*rows, ("total", self.total)])])


def _cell(counts: Counts, column: str) -> str:
    return f"{counts.worst * 1e3:.1f}ms" if column == "worst" else str(getattr(counts, column))


def _line(name: str, counts: Counts) -> str:
    cells = [_cell(counts, column) for column in COLUMNS]
    return f"{name:>5}" + "".join(
        f" {cell:>{max(5, len(column))}}" for cell, column in zip(cells, COLUMNS, strict=True)
    )
