"""Doctor: what is wrong with a bus and its servos, and buttons that mend it."""

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from servobus.core.ids import LAST_ID, parse_ids
from servobus.errors import ServobusError
from servobus.server.web.mending import Mend, carry_out, mend_of
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.served_bus import ServedBus

LOOK = 0.2
"""s between two looks how far the examination is."""
READS = {100: "100, some seconds", 1000: "1000", 10_000: "10 000, finds rare losses"}
"""Reads in which losses are counted -> what the choice says."""
LOOKS = {
    "fail": ("error", "sb-bad", "Wrong"),
    "warn": ("warning", "sb-warn", "Odd"),
    "unknown": ("help", "sb-muted", "Not known"),
    "ok": ("check_circle", "sb-ok", "Fine"),
}
"""Level of a finding -> its icon, its colour, and its word; the worst first."""


def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    if bus is None:
        empty("usb_off", "No bus", "There is nothing to examine: open a bus on the page Overview.")
        return
    DoctorPage(context, bus).build()


class DoctorPage:
    """The page of one tab."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus = context, bus
        self._job = next(
            (
                job["id"]
                for job in context.service.jobs.entries()
                if (job["kind"], job["bus"]) == ("doctor", bus.name) and job["state"] in ("running", "done")
            ),
            "",
        )
        """The examination that is shown: the last one of this bus, for it holds whoever opens the page."""
        self._shown: list[Mapping[str, Any]] = []
        self._state = ""

    def build(self) -> None:
        known = sorted({servo.id for servo in self._bus.bus})
        with ui.column().classes("sb-card"):
            with ui.row().classes("sb-row"):
                with ui.column().classes("sb-grow sb-tight"):
                    ui.label(f"Examine {self._bus.name}").classes("sb-title")
                    ui.label("Nothing moves and nothing is changed.").classes("sb-muted")
                self._ids = ui.input("Ids", value=_ranges(known) or f"0-{LAST_ID}").props("dense outlined")
                self._reads = ui.select(READS, value=100, label="Reads for losses").props(
                    "dense outlined options-dense"
                )
                self._begin = ui.button("Examine", icon="search", on_click=self._examine).props("unelevated no-caps")
                self._cancel = ui.button("Cancel", on_click=self._break_off).props("flat no-caps color=grey")
            with ui.column().classes("sb-tight sb-wide") as self._progress:
                self._bar = ui.linear_progress(0.0, show_value=False).props("rounded aria-label=Progress")
                self._doing = ui.label("").classes("sb-muted sb-small sb-value")
        self._summary = ui.row().classes("sb-chips")
        self._list = ui.column().classes("sb-findings")
        self._look()
        look = ui.timer(LOOK, self._look)
        self._context.leaving(look.cancel)

    # The examination

    def _examine(self) -> None:
        def begin() -> str:
            return self._context.service.doctor(
                self._context.actor, self._bus.name, ids=parse_ids(self._ids.value or ""), reads=self._reads.value
            ).id

        began = self._context.attempt_now(begin)
        if began is not None:
            self._job, self._state = began, ""
            self._look()

    async def _break_off(self) -> None:
        await self._context.attempt(self._context.service.jobs.cancel(self._job))

    def _look(self) -> None:
        """Show how far it is, and what was found since."""
        if not self._job:
            self._progress.set_visibility(False)
            self._cancel.set_visibility(False)
            return
        try:
            job = self._context.service.jobs[self._job].entry()
        except ServobusError:  # it is forgotten some time after its end
            self._job = ""
            return
        running = job["state"] == "running"
        if job["state"] != self._state:
            self._state = job["state"]
            self._progress.set_visibility(running)
            self._cancel.set_visibility(running)
            self._begin.set_enabled(not running)
            if job["error"]:
                with self._context.content:
                    toast.failed(ServobusError(job["error"]["message"]))
        if running:
            self._bar.value = job["done"] / job["total"] if job["total"] else 0.0
            self._doing.text = f"{job['text']}  {job['done']} of {job['total']}" if job["total"] else "opening the port"
        if job["found"] != self._shown:
            self._show(job["found"])

    # What was found

    def _show(self, found: Sequence[Mapping[str, Any]]) -> None:
        self._shown = list(found)
        self._list.clear()
        self._summary.clear()
        with self._summary:
            for level, (_, colour, word) in LOOKS.items():
                if count := sum(one["level"] == level for one in found):
                    ui.label(f"{word}  {count}").classes(f"sb-chip {colour.replace('sb-', 'sb-chip-')}")
        with self._list:
            for finding in worst_first(found):
                self._finding(finding)

    def _finding(self, finding: Mapping[str, Any]) -> None:
        icon, colour, word = LOOKS[finding["level"]]
        with ui.row().classes(f"sb-finding sb-finding-{finding['level']}"):
            ui.icon(icon).classes(colour).props(f'role=img aria-label="{word}"')
            with ui.column().classes("sb-grow sb-tight"):
                with ui.element("div").classes("sb-said"):
                    ui.label(finding["check"]).classes("sb-check")
                    ui.label(finding["what"])
                if finding["cause"]:
                    ui.label(finding["cause"]).classes("sb-muted")
                self._mends([mend_of(command) for command in finding["mend"]])

    def _mends(self, mends: Sequence[Mend]) -> None:
        """Offer what mends it: buttons for what can be done from here, commands for the rest."""
        buttons = [one for one in mends if one.verb]
        if buttons and self._context.may_change:
            with ui.row().classes("sb-tight-row"):
                for mend in buttons:
                    ui.button(mend.label, on_click=lambda mend=mend: self._mend(mend)).props(
                        "outline no-caps dense padding='4px 12px'"
                    )
        for mend in mends if not self._context.may_change else [one for one in mends if not one.verb]:
            with ui.row().classes("sb-command"):
                ui.label(mend.command).classes("sb-mono sb-grow")
                ui.button(icon="content_copy", color=None, on_click=lambda mend=mend: self._copy(mend)).props(
                    'flat round dense size=sm aria-label="Copy"'
                ).classes("sb-quiet")

    def _copy(self, mend: Mend) -> None:
        ui.clipboard.write(mend.command)
        toast.told("Copied")

    async def _mend(self, mend: Mend) -> None:
        names = [f"id {id}" for id in mend.ids]
        if not await confirm(f"{mend.label}?", mend.question, does=mend.label, names=names):
            return
        done = await self._context.attempt(
            _true(carry_out(self._bus, self._context.actor, mend)), "Done: it is examined again"
        )
        if done:
            self._examine()


async def _true(work: Any) -> bool:
    await work
    return True


def worst_first(found: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Put what is wrong in front, else in the order in which it was found."""
    levels = list(LOOKS)
    return sorted(found, key=lambda one: levels.index(one["level"]))


def _ranges(ids: Sequence[int]) -> str:
    """Write ids as they are typed, "1-4,7"."""
    parts: list[list[int]] = []
    for id in ids:
        if parts and id == parts[-1][1] + 1:
            parts[-1][1] = id
        else:
            parts.append([id, id])
    return ",".join(str(low) if low == high else f"{low}-{high}" for low, high in parts)
