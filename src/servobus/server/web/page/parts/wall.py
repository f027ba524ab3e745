"""All servos of a bus at a glance: cards or lines, with what has changed alone sent to the browser."""

from collections.abc import Callable, Sequence
from typing import Any

from nicegui.element import Element


class Wall(Element, component="wall.js"):
    """Shows rows as `page.rows` gives them. The browser filters, sorts and marks by itself."""

    def __init__(self, rows: Sequence[dict[str, Any]], bus: str, marked: Callable[[list[str]], object]) -> None:
        super().__init__()
        self._props["rows"] = list(rows)
        self._props["bus"] = bus
        self.on("marked", lambda event: marked([str(key) for key in event.args]))

    def show(self, rows: Sequence[dict[str, Any]]) -> None:
        """Show other servos."""
        self._props["rows"] = list(rows)
        self.update()

    def patch(self, changes: Sequence[tuple[str, dict[str, Any]]]) -> None:
        """Show what has changed: key of a servo, and its new values."""
        if changes:
            self.run_method("patch", changes)

    def choose(self, keys: Sequence[str]) -> None:
        """Mark these servos and no others."""
        self.run_method("mark", list(keys))
