"""Doctor."""

from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.empty import empty


def build(context: PageContext) -> None:
    """Build the page."""
    empty("construction", "Doctor", f"There is nothing yet of {context.bus and context.bus.name}.")
