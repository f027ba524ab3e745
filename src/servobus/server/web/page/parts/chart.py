"""The plot as an element: it is told of its channels once, and of new rows from then on."""

from collections.abc import Sequence

from nicegui.element import Element

from servobus.server.web.page.parts.plotting import Channel, Row, lanes

COLOURS = (
    "#2f7df6", "#e8590c", "#12a46c", "#c2479b", "#d9a406", "#7c5cff", "#0ea5c4", "#d6336c", "#74910f", "#8a6d5a",
)  # fmt: skip
"""Told apart on light and on dark; *assumption*: also by most people who see colours otherwise."""


class Chart(Element, component="chart.js"):
    """Values against time.

    seconds  how much is shown while it runs
    """

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._props.update(series=[], lanes=[], seconds=seconds, label="Values against time")
        self.classes("sb-chart-box")

    def show(self, channels: Sequence[Channel]) -> None:
        """Show these channels from now on, and none of what was there before. Raises BadValue for too many."""
        units = lanes(channels)
        self._props["lanes"] = units
        self._props["series"] = [
            {"label": channel.label, "lane": units.index(channel.symbol), "colour": COLOURS[n % len(COLOURS)]}
            for n, channel in enumerate(channels)
        ]
        self._props["label"] = f"Plot of {', '.join(channel.label for channel in channels) or 'nothing'}"
        self.update()

    def set_seconds(self, seconds: float) -> None:
        """Show as much while it runs."""
        self._props["seconds"] = seconds
        self.update()

    def push(self, rows: Sequence[Row]) -> None:
        """Add rows."""
        self.run_method("push", rows)
