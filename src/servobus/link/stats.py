"""What happened on a bus, in numbers: `print(bus.stats)`."""

from collections.abc import Iterable
from typing import TypeAlias

from servobus.errors import UnknownName

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


Key: TypeAlias = tuple[str, int, int]
"""A servo: the name of its family, its id, and its speed in bit/s."""


class Stats:
    """Counters of each servo, by family, id and speed; `total` sums them up.

    `stats[id]` gives those of the only servo with this id. Broadcasts count under id 254, and so does what came of a
    group of servos when nothing tells which of them it came from.
    """

    def __init__(self) -> None:
        self.servos: dict[Key, Counts] = {}
        self._unasked: dict[int, Counts] = {}
        """Counters that were asked for by an id before a servo of that id was."""

    def servo(self, family: str, id: int, baud: int) -> Counts:
        """Give the counters of one servo; they begin at 0."""
        key = family, id, baud
        counts = self.servos.get(key)
        if counts is None:
            counts = self.servos[key] = self._unasked.pop(id) if id in self._unasked else Counts()
        return counts

    def __getitem__(self, id: int | Key) -> Counts:
        """Give the counters of the servo with this id, or of one named by (family, id, speed); 0 if never asked.

        An id that was asked at several speeds or in several families, as a scan does, stands for the servo that
        answered; if none did, its counters are summed up. Raises UnknownName if several servos with this id answered.
        """
        if not isinstance(id, int):
            return self.servo(*id)
        rows = self._rows(id)
        if len(rows) > 1:
            names = " and ".join(f"{family} at {baud}" for (family, _, baud), _ in rows)
            raise UnknownName(f"id {id} is not unique here: {names}; ask for (family, id, speed)")
        return rows[0][1] if rows else self._unasked.setdefault(id, Counts())

    @property
    def total(self) -> Counts:
        return _sum([*self.servos.values(), *self._unasked.values()])

    def __repr__(self) -> str:
        ids = {id for _, id, _ in self.servos} | self._unasked.keys()
        return f"<Stats of {len(ids)} ids: {repr(self.total)[1:-1]}>"

    def __str__(self) -> str:
        """Draw a table: a line for each servo that was asked, with family and speed if ids are not unique; the sum."""
        rows = []
        for id in sorted({id for _, id, _ in self.servos} | self._unasked.keys()):
            found = self._rows(id) or [(("", id, 0), self._unasked[id])]
            for (family, _, baud), counts in found:
                if counts.sent:
                    rows.append((f"{family} {id} at {baud}" if len(found) > 1 else str(id), counts))
        width = max([5, *(len(name) for name, _ in rows)])
        head = "id".rjust(width) + "".join(name.rjust(max(6, len(name) + 1)) for name in COLUMNS)
        return "\n".join([head, *(_line(name, counts, width) for name, counts in [*rows, ("total", self.total)])])

    def _rows(self, id: int) -> list[tuple[Key, Counts]]:
        """Give the servos with this id: those that answered, or what was asked in vain as if it were one servo."""
        asked = [(key, counts) for key, counts in self.servos.items() if key[1] == id]
        answered = [(key, counts) for key, counts in asked if counts.received]
        if answered or len(asked) < 2:
            return sorted(answered or asked, key=lambda row: row[0])
        return [(("", id, 0), _sum([counts for _, counts in asked]))]


def _sum(counters: Iterable[Counts]) -> Counts:
    total = Counts()
    for counts in counters:
        for name in COLUMNS:
            both = getattr(total, name), getattr(counts, name)
            setattr(total, name, max(both) if name == "worst" else sum(both))
    return total


def _cell(counts: Counts, column: str) -> str:
    return f"{counts.worst * 1e3:.1f}ms" if column == "worst" else str(getattr(counts, column))


def _line(name: str, counts: Counts, width: int) -> str:
    cells = [_cell(counts, column) for column in COLUMNS]
    return name.rjust(width) + "".join(
        f" {cell:>{max(5, len(column))}}" for cell, column in zip(cells, COLUMNS, strict=True)
    )
