"""Short messages that go away: what has been done, and errors with what to do about them."""

from collections.abc import Mapping
from typing import Any, Literal

from nicegui import ui

from servobus.errors import ServobusError
from servobus.server.web.errors import error_entry


def said(error: ServobusError) -> tuple[str, str]:
    """Give the sentence of an error, and what to do where that is not in the sentence."""
    entry: Mapping[str, Any] = error_entry(error)
    return entry["message"], PAGE_REMEDIES.get(entry["type"], "")


PLACE: Literal["bottom-right"] = "bottom-right"
"""Away from STOP and from the messages at the top that stay."""
PAGE_REMEDIES: Mapping[str, str] = {
    "TorqueOff": "Switch the torque of the servo on first.",
    "Stopped": "Press Resume at the top of the page.",
    "EepromWear": "Write without saving, where the value has a place in the RAM too.",
}
"""As `errors.REMEDIES`, in the words of the pages."""


def told(text: str) -> None:
    """Say what has been done."""
    ui.notify(text, type="positive", position=PLACE, timeout=2500, progress=False)


def warned(text: str) -> None:
    """Say what somebody should know."""
    ui.notify(text, type="warning", position=PLACE, timeout=6000, multi_line=True)


def failed(error: ServobusError) -> None:
    """Say what has gone wrong, long enough to read it."""
    sentence, remedy = said(error)
    ui.notify(
        sentence,
        type="negative",
        position=PLACE,
        timeout=9000,
        close_button="OK",
        multi_line=True,
        caption=remedy or None,
    )


def fault() -> None:
    """Say that the server has a fault, which its log tells more about."""
    ui.notify("A fault of the server: its log says more", type="negative", position=PLACE, timeout=9000)
