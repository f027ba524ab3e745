"""Move."""

from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.empty import empty


def build(context: PageContext) -> None:
    """Build the page."""
    empty("construction", "Move", "There is nothing on this page yet.")
