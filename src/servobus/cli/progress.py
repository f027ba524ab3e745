"""Where a servo is, as a bar of characters."""

from rich.text import Text

from servobus.core.units import show
from servobus.families.base import Model


def goal_range(model: type[Model]) -> tuple[float, float]:
    """Give the lowest and highest goal of a model, rad."""
    row = model.register("goal_position")
    low, high = row.limits
    return row.decode(low), row.decode(high)


def position_bar(position: float, goal: float | None, low: float, high: float, width: int) -> Text:
    """Draw a position between `low` and `high`, and the goal if there is one."""

    def column(angle: float) -> int:
        share = (angle - low) / (high - low) if high > low else 0.5
        return round(min(max(share, 0.0), 1.0) * (width - 1))

    line = Text("─" * width, style="dim")
    here = column(position)
    if goal is not None:
        there = column(goal)
        line = _put(line, there, "┃", "yellow")
        for at in range(min(here, there) + 1, max(here, there)):
            line = _put(line, at, "━", "cyan")
    return _put(line, here, "●", "bold cyan")


def angle_column(value: float) -> str:
    """Write an angle in a column of its own."""
    return f"{show(value, 'rad'):>8}"


def _put(line: Text, at: int, mark: str, style: str) -> Text:
    return Text.assemble(line[:at], (mark, style), line[at + 1 :])
