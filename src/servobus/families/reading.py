"""Reading several registers at once, and what reading and writing have in common: how pieces of a table are joined."""

from collections.abc import Iterable, Mapping, Sequence

from servobus.core.exchange import Exchange, Procedure
from servobus.core.registers import Int
from servobus.core.values import frozen


@frozen
class Reading:
    """Registers to read: what is asked for them, and where each stands in the answers."""

    exchanges: tuple[Exchange[bytes], ...]
    places: tuple[tuple[int, slice, Int], ...]
    """Of each register: which answer, which of its bytes, how they are laid out."""

    def values(self, answers: Sequence[bytes]) -> list[int]:
        """Give the raw values, in the order of the registers."""
        return [layout.unpack(answers[n][part]) for n, part, layout in self.places]


def fetch(reading: Reading) -> Procedure[list[int]]:
    """Ask for registers; gives their raw values."""
    answers: list[bytes] = []
    for exchange in reading.exchanges:
        answers += [(yield from exchange)]
    return reading.values(answers)


def blocks(spans: Iterable[tuple[int, int]], *, gap: int, longest: int) -> list[tuple[int, int]]:
    """Join (address, size) spans into blocks (address, size) that bridge at most `gap` unwanted bytes."""
    joined: list[tuple[int, int]] = []
    for address, size in sorted(spans):
        if joined:
            start, length = joined[-1]
            end = max(start + length, address + size)
            if address - (start + length) <= gap and end - start <= longest:
                joined[-1] = (start, end - start)
                continue
        joined.append((address, size))
    return joined


def within(spans: Sequence[tuple[int, int]], address: int) -> tuple[int, int]:
    """Find the block that holds an address: its number, and how far into it the address is."""
    return next((n, address - start) for n, (start, size) in enumerate(spans) if start <= address < start + size)


def place(spans: Sequence[tuple[int, int]], address: int, layout: Int) -> tuple[int, slice, Int]:
    """Tell where a register stands in the answers, each of which brings one of these blocks; see `Reading.places`."""
    n, at = within(spans, address)
    return n, slice(at, at + layout.size), layout


def adjacent(parts: Mapping[int, bytes]) -> list[tuple[int, bytes]]:
    """Join (address, data) parts that touch into one write each."""
    runs: list[tuple[int, bytes]] = []
    for address, data in sorted(parts.items()):
        if runs and runs[-1][0] + len(runs[-1][1]) == address:
            runs[-1] = (runs[-1][0], runs[-1][1] + data)
        else:
            runs.append((address, data))
    return runs
