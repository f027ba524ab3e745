"""One register that can be set: the control that fits its kind of values, and the row around it."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from servobus.core.present import unit_step_text
from servobus.core.registers import Register
from servobus.core.units import Choice, Flags, Switch
from servobus.server.web.page.settings.draft import is_default, place
from servobus.server.web.page.settings.purposes import meaning, title
from servobus.server.web.page.setup.workbench import Workbench

IDENTITY = ("id", "baud_rate", "baud")
"""What is changed with care, and not as a register."""


class Editor:
    """The control of one register; it shows the edit if there is one, else what the servo has.

    tell  called with what is wrong with what was typed, "" if nothing
    """

    def __init__(self, bench: Workbench, row: Register[Any], tell: Callable[[str], object]) -> None:
        self.bench, self.row, self._tell = bench, row, tell
        self._showing = False
        """Whether a value is shown now: then its change is no edit."""
        self._text = ""
        self._element: ui.element
        self._show_raw: Callable[[int], object]
        self._element, self._show_raw = self._build(title(row))
        if not bench.may_change:
            self._element.props("disable")

    def show(self) -> None:
        """Show what is there now."""
        raw = self.bench.draft.raw(self.row.name)
        if raw is None:
            return
        self._showing = True
        self._show_raw(raw)
        self._showing = False

    def _build(self, label: str) -> tuple[ui.element, Callable[[int], object]]:
        scale, row = self.row.scale, self.row
        if isinstance(scale, Switch):
            switch = ui.switch(on_change=lambda event: self._set(scale.encode(event.value)))
            return self._named(switch, label), lambda raw: switch.set_value(scale.decode(raw))
        if isinstance(scale, Flags):
            bits = {int(flag): scale.show(flag).replace("_", " ") for flag in scale.used if int(flag)}
            many = ui.select(bits, multiple=True, value=[], on_change=lambda event: self._set_bits(event.value, bits))
            many.props("outlined dense use-chips options-dense").classes("sb-edit sb-edit-wide")
            return self._named(many, label), lambda raw: many.set_value([bit for bit in bits if raw & bit])
        if isinstance(scale, Choice) or row.allowed:
            low, high = row.limits
            raws = row.allowed or [int(one) for one in scale.options if low <= one <= high]  # type: ignore[attr-defined]
            options = {raw: row.said(raw).replace("_", " ") for raw in raws}
            one = ui.select(options, on_change=lambda event: self._set(event.value))
            one.props("outlined dense options-dense").classes("sb-edit")
            return self._named(one, label), lambda raw: one.set_value(raw if raw in options else None)
        field = ui.input().props("outlined dense input-class=text-right autocomplete=off").classes("sb-edit")
        field.on("blur", lambda: self._typed(field)).on("keydown.enter", lambda: self._typed(field))
        field.on("focus", js_handler="(event) => event.target.select && event.target.select()")
        return self._named(field, label), lambda raw: self._show_text(field, raw)

    def _named(self, element: Any, label: str) -> Any:
        element.props["aria-label"] = label
        return element

    def _show_text(self, field: ui.input, raw: int) -> None:
        self._text = self.row.said(raw)
        field.set_value(self._text)
        self._mark(field, "")

    def _typed(self, field: ui.input) -> None:
        text = str(field.value or "").strip()
        if text == self._text:
            return  # what is shown is rounded: taken for an edit, it could be another raw value
        if not text:
            self.show()
            return
        error = self.bench.type(self.row.name, text)
        self._mark(field, error.removeprefix(f"{self.row.model} {self.row.name}: "))

    def _mark(self, field: ui.input, error: str) -> None:
        """Show what is wrong with what was typed, or that nothing is."""
        field.props(add="error no-error-icon hide-bottom-space" if error else "", remove="" if error else "error")
        self._tell(error)

    def _set(self, raw: int | None) -> None:
        if not self._showing and raw is not None:
            self.bench.set(self.row.name, raw)

    def _set_bits(self, chosen: list[int], bits: dict[int, str]) -> None:
        raw = self.bench.draft.raw(self.row.name)
        if not self._showing and raw is not None:
            known = sum(bits)
            self.bench.set(self.row.name, (raw & ~known) | sum(chosen))


class EditRow:
    """A line of the page: what the register is, its control, and what there is to know of its value."""

    def __init__(self, bench: Workbench, row: Register[Any]) -> None:
        self.bench, self.row = bench, row
        with ui.element("div").classes("sb-reg") as self.element:
            self.element.props(f"data-register={row.name}")
            with ui.element("div").classes("sb-reg-what"):
                with ui.element("div").classes("sb-reg-title"):
                    ui.label(title(row))
                    self._stored = ui.label("").classes("sb-chip sb-chip-warn")
                ui.label(meaning(row)).classes("sb-muted sb-small")
            with ui.element("div").classes("sb-reg-value"):
                self._editor = Editor(bench, row, self._wrong)
                self._about = ui.label("").classes("sb-small sb-value sb-reg-about")
            with ui.element("div").classes("sb-reg-end"):
                self._raw = ui.label("").classes("sb-mono sb-muted")
                self._back = ui.button(icon="undo", on_click=lambda: bench.drop(row.name), color=None)
                self._back.props('flat round dense size=sm aria-label="Drop this edit"').classes("sb-quiet")
                self._factory = ui.button(icon="restart_alt", on_click=self._set_default, color=None)
                self._factory.props('flat round dense size=sm aria-label="Take the factory setting"')
                self._factory.classes("sb-quiet")
                if row.default is not None:
                    with self._factory:
                        ui.tooltip(f"Factory setting: {row.said(row.default)}")
        with self._raw:
            ui.tooltip(_about(row))
        self._range = range_text(row)

    def _wrong(self, error: str) -> None:
        self._about.classes(add="sb-bad" if error else "", remove="" if error else "sb-bad")
        if error:
            self._about.set_text(error)

    def show(self) -> None:
        """Show what is there now."""
        draft, row = self.bench.draft, self.row
        held, raw = draft.held.get(row.name), draft.raw(row.name)
        if held is None or raw is None:
            return
        edited = row.name in draft
        default = is_default(row, held)
        self._editor.show()
        self._raw.set_text(f"raw {raw}")
        self._about.set_text(f"was {row.said(held.now or 0)}" if edited else self._range)
        self._stored.set_text(f"after power-on: {row.said(held.stored)}" if held.stored is not None else "")
        self._stored.set_visibility(held.differs)
        self._back.set_visibility(edited)
        self._factory.set_visibility(default is False and raw != row.default and self.bench.may_change)
        self.element.classes(add="sb-reg-edited" if edited else "", remove="" if edited else "sb-reg-edited")
        changed = default is False
        self.element.classes(add="sb-reg-changed" if changed else "", remove="" if changed else "sb-reg-changed")

    def _set_default(self) -> None:
        if self.row.default is not None:
            self.bench.set(self.row.name, self.row.default)


def range_text(row: Register[Any]) -> str:
    """Say what may be written, briefly; "" where the control shows it."""
    if isinstance(row.scale, Switch | Choice | Flags) or row.allowed:
        return ""
    low, high = row.limits
    return f"{row.said(low)} … {row.said(high)}"


def _about(row: Register[Any]) -> str:
    """Say what one raw unit is, and where the register lies."""
    step = unit_step_text(row)
    return ", ".join(filter(None, (f"one raw unit is {step}" if step else "", f"{place(row)}, {row.place.text()}")))
