"""Looking for servos: what to look for, how far the search is, and breaking it off."""

from typing import Any

from nicegui import ui

from servobus.core.ids import LAST_ID, parse_ids
from servobus.families import registry
from servobus.server.web.jobs import ServerJob
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.served_bus import ServedBus

EVERY_ID = f"0-{LAST_ID}"
COMMON = (9600, 19200, 57600, 115200, 200000, 250000, 400000, 500000, 666666, 1000000)
"""Speeds, baud, that are offered to choose from; any other can be typed."""


class Scanning:
    """The panel of a search. The search itself is a job of the server: it goes on when the page is left."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus = context, bus
        self._job: ServerJob | None = None
        with ui.column().classes("sb-card") as self._panel:
            self._choices = ui.row().classes("sb-row")
            with self._choices:
                self._choose()
            self._progress = ui.column().classes("sb-row")
            with self._progress:
                with ui.row().classes("sb-row no-wrap"):
                    self._text = ui.label("").classes("col sb-muted sb-value ellipsis")
                    ui.button("Cancel", color=None, on_click=self._cancel).props("flat dense no-caps")
                self._bar = ui.linear_progress(0.0, show_value=False, size="6px").props("rounded instant-feedback")
        for entry in context.service.jobs.entries():
            if (entry["kind"], entry["bus"], entry["state"]) == ("scan", bus.name, "running"):
                self._job = context.service.jobs[entry["id"]]
        self.close()
        context.events(self._event)

    def _choose(self) -> None:
        families = {family.name: family.title for family in registry.FAMILIES.values()}
        self._families = ui.select(families, multiple=True, label="Families", value=[]).props(
            "outlined dense use-chips options-dense stack-label hint='none: all'"
        )
        self._bauds = ui.select(
            [str(baud) for baud in COMMON], multiple=True, label="Speeds (baud)", value=[], new_value_mode="add-unique"
        ).props("outlined dense use-chips options-dense stack-label hint='none: those from the factory'")
        self._ids = ui.input("Ids", value=EVERY_ID).props("outlined dense hint='such as 1-4,7'")
        for field in (self._families, self._bauds):
            field.classes("sb-field-wide")
        self._ids.classes("sb-field")
        ui.space()
        ui.button("Close", color=None, on_click=self.close).props("flat no-caps")
        ui.button("Scan", icon="search", on_click=self.begin).props("unelevated no-caps")

    def open(self) -> None:
        """Ask what to look for."""
        if self._job is None:
            self._panel.visible = self._choices.visible = True

    def close(self) -> None:
        """Ask nothing any more; a search that runs stays in sight."""
        self._choices.visible = False
        self._panel.visible = self._progress.visible = self._job is not None
        self._show()

    def begin(self) -> None:
        """Look for servos."""
        if self._job is not None:
            return
        job = self._context.attempt_now(
            lambda: self._context.service.scan(
                self._context.actor,
                self._bus.name,
                families=self._families.value or None,
                bauds=[int(baud) for baud in self._bauds.value if str(baud).isdecimal()] or None,
                ids=parse_ids(self._ids.value or EVERY_ID),
            )
        )
        if job is not None:
            self._job = job
            self.close()

    async def _cancel(self) -> None:
        self._context.check_may_change()
        if self._job is not None:
            await self._context.service.jobs.cancel(self._job.id)

    def _event(self, event: dict[str, Any]) -> None:
        job = self._job
        if job is None or event.get("job") != job.id:
            return
        if event["what"] == "job":
            self._job = None
            self.close()
            kind, text = outcome(job)
            ui.notify(text, type=kind, position=toast.PLACE, timeout=5000)
        else:
            self._show()

    def _show(self) -> None:
        if self._job is not None:
            self._text.text = progress(self._job)
            self._bar.value = self._job.done / self._job.total if self._job.total else 0.0


def progress(job: ServerJob) -> str:
    """Say how far a search is."""
    count = len(job.found)
    share = f"{100 * job.done / job.total:.0f} %" if job.total else "0 %"
    return f"{share}: {job.text or 'begins'}, {count} found"


def outcome(job: ServerJob) -> tuple[Any, str]:
    """Say what has come of a search: the kind of message, and the words."""
    count = len(job.found)
    found = f"{count or 'no'} servo{'' if count == 1 else 's'} found"
    if job.state == "failed":
        return "negative", f"The search has failed: {(job.error or {}).get('message', '')}"
    if job.state == "cancelled":
        return "warning", f"Broken off, {found}"
    unclear = len((job.result or {}).get("unclear", ()))
    if unclear:
        return "warning", f"{found.capitalize()}; {unclear} answers were garbled, so that two servos may have one id"
    return ("positive" if count else "warning"), found.capitalize()
