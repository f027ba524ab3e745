"""Plot."""

from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.empty import empty


def build(context: PageContext) -> None:
    """Build the page."""
    empty("construction", "Plot", "There is nothing on this page yet.")
