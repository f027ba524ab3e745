"""What happened on a bus, in numbers: `print(bus.stats)`."""

from dataclasses import dataclass, field, fields


@dataclass(slots=True)
class Counts:
    """Counters of one servo, or of a whole bus."""

    sent: int = 0
    """Requests."""
    received: int = 0
    """Answers that fit."""
    timeouts: int = 0
    """Requests that should have been answered and met silence."""
    checksum: int = 0
    """Packets with a wrong checksum."""
    strangers: int = 0
    """Good packets that answered nothing."""
    late: int = 0
    """Answers that came after they had been given up."""
    doubled: int = 0
    """Second answers to one question."""
    echo: int = 0
    """Echoes that were not what was sent."""
    junk: int = 0
    """Bytes that were no packet."""
    retries: int = 0
    """Requests that were sent again."""
    worst: float = 0.0
    """Longest time from the end of a request to the end of its answer, s, less the answer's bits."""

    @property
    def failed(self) -> int:
        """Requests whose answer was not to be had at once."""
        return self.timeouts + self.checksum + self.echo


@dataclass(slots=True)
class Stats:
    """Counters by id; `total` sums them up. Broadcasts count under id 254."""

    servos: dict[int, Counts] = field(default_factory=dict)

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

    def __str__(self) -> str:
        """Draw a table: a line for each servo that was asked, and the sum."""
        rows = [(str(id), counts) for id, counts in sorted(self.servos.items()) if counts.sent]
        head = "id".rjust(5) + "".join(name.rjust(max(6, len(name) + 1)) for name in COLUMNS)
        return "\n".join([head, *(_line(*row) for row in [*rows, ("total", self.total)])])


COLUMNS = tuple(column.name for column in fields(Counts))


def _line(name: str, counts: Counts) -> str:
    cells = [f"{counts.worst * 1e3:.1f}ms" if column == "worst" else getattr(counts, column) for column in COLUMNS]
    return f"{name:>5}" + "".join(
        f"{cell:>{max(6, len(column) + 1)}}" for cell, column in zip(cells, COLUMNS, strict=True)
    )
