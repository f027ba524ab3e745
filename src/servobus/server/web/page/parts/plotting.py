"""What a plot shows: its channels, what was read of them, and the trigger that stops it. No page is needed for that."""

import csv
import io
import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from servobus.core.units import shown
from servobus.errors import BadValue

MOST_LANES = 10
"""Axes that one plot has, a lane for each unit."""
MOST_CHANNELS = 20
MOST_ROWS = 200_000
"""Rows that are kept for the export; the oldest are dropped first. 200 000 are an hour at 50 Hz."""
PLOTTABLE = ("quantity", "number", "switch")
"""Kinds of registers, as in `si_register_entry`, whose values are numbers."""

Edge: TypeAlias = Literal["rising", "falling", "either"]
Row: TypeAlias = tuple[float, dict[int, float | None]]
"""A moment, s, and place of a channel -> its value in the unit people use; None where the servo did not answer."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One register of one servo.

    servo  its key
    title  what people call the servo
    unit   SI unit of the register
    """

    bus: str
    servo: str
    register: str
    title: str
    unit: str

    @property
    def symbol(self) -> str:
        """The unit people use."""
        return shown(0.0, self.unit)[1] if self.unit else ""

    @property
    def label(self) -> str:
        return f"{self.title} {self.register.replace('_', ' ')}"

    def number(self, value: Any) -> float | None:
        """Give a value of telemetry as the number that is drawn; None for what is none."""
        if isinstance(value, bool):
            return float(value)
        if not isinstance(value, int | float) or not math.isfinite(value):
            return None
        return shown(value, self.unit)[0] if self.unit else float(value)


def lanes(channels: Sequence[Channel]) -> list[str]:
    """Give the units in the order of the lanes. Raises BadValue for more than a plot has."""
    units = list(dict.fromkeys(channel.symbol for channel in channels))
    if len(units) > MOST_LANES:
        raise BadValue(f"{len(units)} different units are more than {MOST_LANES} axes: take some channels away")
    if len(channels) > MOST_CHANNELS:
        raise BadValue(f"{len(channels)} channels are more than {MOST_CHANNELS}: take some away")
    return units


def subscriptions(channels: Iterable[Channel]) -> dict[str, dict[str, list[str]]]:
    """Give what has to be read: bus -> key of a servo -> registers."""
    wanted: dict[str, dict[str, list[str]]] = {}
    for channel in channels:
        wanted.setdefault(channel.bus, {}).setdefault(channel.servo, []).append(channel.register)
    return wanted


class Recording:
    """What was read of some channels since a moment."""

    def __init__(self, channels: Sequence[Channel], most: int = MOST_ROWS) -> None:
        self.channels = tuple(channels)
        self.rows: deque[Row] = deque(maxlen=most)
        self._began: float | None = None

    def add(self, sample: Mapping[str, Any]) -> Row | None:
        """Take a message of telemetry; gives the row that it makes, None if it has no value of these channels.

        Times are s since the first row.
        """
        servos = sample["servos"]
        row: dict[int, float | None] = {}
        for place, channel in enumerate(self.channels):
            if channel.bus == sample["bus"] and channel.servo in servos:
                values = servos[channel.servo]["values"]
                row[place] = None if values is None else channel.number(values.get(channel.register))
        if not row:
            return None
        if self._began is None:
            self._began = sample["t"]
        made = (round(sample["t"] - self._began, 4), row)
        self.rows.append(made)
        return made

    def clear(self) -> None:
        """Forget what was read, and begin anew with the next row."""
        self.rows.clear()
        self._began = None

    def csv(self, first: float = -math.inf, last: float = math.inf) -> str:
        """Write the rows between two moments as CSV, an empty field where nothing was read."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["time [s]", *(_head(channel) for channel in self.channels)])
        for time, values in self.rows:
            if first <= time <= last:
                read = [values.get(place) for place in range(len(self.channels))]
                writer.writerow([f"{time:.4f}", *("" if value is None else f"{value:g}" for value in read)])
        return out.getvalue()


def _head(channel: Channel) -> str:
    head = channel.label + (f" [{channel.symbol}]" if channel.symbol else "")
    # A spreadsheet takes a field that begins with one of these for a formula, and names come from files.
    return f"'{head}" if head[:1] in "=+-@\t\r" else head


@dataclass(slots=True)
class Trigger:
    """Tells when a channel crosses a level.

    channel  its place among the channels
    level    in the unit people use
    """

    channel: int
    level: float
    edge: Edge = "rising"
    fired: float | None = None
    """When it crossed, by the times of the rows; None before."""
    _before: float | None = None

    def see(self, row: Row) -> bool:
        """Look at the next row; tells whether the trigger fires with it. It fires once."""
        time, values = row
        value, before = values.get(self.channel), self._before
        if value is None or self.fired is not None:
            return False
        self._before = value
        if before is None:
            return False
        rises, falls = before < self.level <= value, before > self.level >= value
        if (rises and self.edge != "falling") or (falls and self.edge != "rising"):
            self.fired = time
            return True
        return False
