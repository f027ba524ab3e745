"""Mounting the pages on the application, behind the API and inside the guard."""

from pathlib import Path

from nicegui import app as pages
from nicegui import ui

from servobus.server.web.app import WebApplication
from servobus.server.web.page.shell import Shell
from servobus.server.web.page.table import PAGES

ASSETS = Path(__file__).parent / "assets"
AWAY = 3.0
"""s for which a page that has lost its connection may come back as it was."""
ICON = (ASSETS / "icon.svg").read_text(encoding="utf-8")


def mount(application: WebApplication) -> None:
    """Have the application serve the pages. One application of a process can: NiceGUI keeps its pages for itself."""
    shell = Shell(application)
    for entry in PAGES:
        ui.page(entry.path)(shell.show)
    pages.add_static_files("/_servobus", ASSETS)
    ui.run_with(
        application.api,
        title="servobus",
        favicon=ICON,
        dark=None,
        language="en-US",
        tailwind=False,
        reconnect_timeout=AWAY,
        show_welcome_message=False,
    )
