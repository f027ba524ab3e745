"""The bar at the bottom that counts edits, what is asked before they are written, and what came of it."""

from collections.abc import Mapping, Sequence

from nicegui import ui

from servobus.server.web.page.parts import toast
from servobus.server.web.page.settings.purposes import title
from servobus.server.web.page.setup.workbench import Outcome, Workbench


class EditBar:
    """Stands at the bottom as long as there are edits, or something to undo."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        with ui.element("div").classes("sb-editbar").props("role=region aria-label=Edits") as self._bar:
            with ui.element("div").classes("sb-editbar-words sb-value"):
                self._text = ui.label("").classes("sb-editbar-text")
                self._worn = ui.label("").classes("sb-muted sb-small")
            ui.space()
            self._undo = _flat("Undo", self._bring_back)
            self._close = _flat("Close", bench.forget_undo)
            self._discard = _flat("Discard", bench.clear)
            self._apply = ui.button("Review", on_click=self._review).props("unelevated no-caps color=primary")
        bench.shown(self.show)
        self.show()

    def show(self) -> None:
        count, undo = len(self.bench.draft), self.bench.can_undo
        self._bar.set_visibility(bool(count or undo) and self.bench.may_change)
        for one in (self._discard, self._apply):
            one.set_visibility(bool(count))
        for one in (self._undo, self._close):
            one.set_visibility(bool(undo) and not count)
        worn = len(self.bench.draft.eeprom(keep=True))
        self._text.set_text(counted(count, "change") if count else f"{counted(undo, 'value')} written")
        self._worn.set_text(f"{counted(worn, 'write')} to the EEPROM" if count else "Undo brings back what was there")

    async def _review(self) -> None:
        keep = await review(self.bench)
        if keep is None:
            return
        outcomes = await self.bench.apply(keep=keep)
        await self._tell(outcomes, "written and read back")

    async def _bring_back(self) -> None:
        await self._tell(await self.bench.undo(), "brought back")

    async def _tell(self, outcomes: Sequence[Outcome], done: str) -> None:
        refused = [one for one in outcomes if one.taken is False]
        with self.bench.context.content:
            if refused:
                names = ", ".join(f"{title(one.row)} ({one.text})" for one in refused)
                ui.notify(f"The servo did not take: {names}", type="warning", position="top", timeout=9000)
            elif outcomes:
                toast.told(f"{counted(len(outcomes), 'value')} {done}")


async def review(bench: Workbench) -> bool | None:
    """Show what is to be written; gives whether it is kept after power-off, or None for nothing."""
    draft = bench.draft
    problem, choosable = draft.problem(), draft.choosable
    with bench.context.content, ui.dialog() as dialog, ui.card().classes("sb-dialog sb-review"):
        ui.label("Review the changes").classes("sb-title").props("role=heading aria-level=2")
        with ui.element("div").classes("sb-diff"):
            for one in draft.edits():
                diff_line(title(one.row), one.old, one.new, one.warning)
        keep = ui.radio({True: "For good: EEPROM and RAM", False: "Until power-off: RAM alone"}, value=True)
        keep.set_visibility(choosable)
        count = ui.label("").classes("sb-muted")
        if problem:
            with ui.row().classes("sb-banner sb-banner-bad"):
                ui.icon("error")
                ui.label(problem).classes("col")
        with ui.row().classes("sb-actions"):
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps color=grey")
            write = ui.button(f"Write {counted(len(draft), 'value')}", on_click=lambda: dialog.submit(keep.value))
            write.props("unelevated no-caps color=primary autofocus")
            write.set_enabled(not problem)

    def told() -> None:
        worn = len(draft.eeprom(keep=bool(keep.value)))
        count.set_text(f"{counted(worn, 'write')} to the EEPROM" if worn else "Nothing goes to the EEPROM")

    keep.on_value_change(told)
    told()
    try:
        chosen = await dialog
    finally:
        close(dialog)
    return None if chosen is None else bool(chosen)


def close(dialog: ui.dialog) -> None:
    """Take a dialog away, unless the tab was closed and has taken it along."""
    if not dialog.is_deleted:
        dialog.delete()


def diff_line(name: str, old: str, new: str, warning: str = "") -> None:
    """Write one change."""
    with ui.element("div").classes("sb-diff-line"):
        ui.label(name).classes("sb-diff-name")
        with ui.element("div").classes("sb-diff-values sb-value"):
            ui.label(old).classes("sb-muted")
            ui.icon("arrow_forward").classes("sb-muted")
            ui.label(new).classes("sb-diff-new")
        if warning:
            with ui.element("div").classes("sb-warn sb-small sb-diff-warning"):
                ui.icon("warning")
                ui.label(warning)


def diff(changes: Mapping[str, Mapping[str, str]]) -> None:
    """Write changes as the service tells them: name -> {"text": "old -> new"}."""
    with ui.element("div").classes("sb-diff"):
        for name, change in changes.items():
            old, _, new = change["text"].partition(" -> ")
            diff_line(name.replace("_", " "), old, new)


def counted(number: int, word: str) -> str:
    """Write a number with a word: "1 change", "3 changes"."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def _flat(name: str, does: object) -> ui.button:
    return ui.button(name, on_click=does, color=None).props("flat no-caps").classes("sb-quiet")  # type: ignore[arg-type]
