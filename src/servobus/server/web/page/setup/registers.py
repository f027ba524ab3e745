"""All registers of a servo: what survives power-off, what does not, and what is measured."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from nicegui import ui

from servobus.core.registers import Area, Register
from servobus.core.units import Flags, Measure, Switch
from servobus.server.web.page.settings.draft import is_default
from servobus.server.web.page.settings.purposes import Purpose, grouped, matches, meaning, title
from servobus.server.web.page.setup.editor import IDENTITY, EditRow
from servobus.server.web.page.setup.workbench import Workbench

SHOWN = {"all": "All", "changed": "Not factory", "edited": "Edited"}


class Registers:
    """The tab with all registers.

    care  called by the button beside what is changed with care: id and speed
    """

    def __init__(self, bench: Workbench, care: Callable[[], object]) -> None:
        self.bench, self._care = bench, care
        self._rows: dict[str, EditRow] = {}
        self._measured: dict[str, Measured] = {}
        self._cards: list[tuple[ui.element, list[str]]] = []
        self._asked, self._which = "", "all"
        rows = [row for row in bench.model.registers.values() if row.name not in bench.lacking]
        with ui.element("div").classes("sb-tools"):
            search = ui.input(placeholder="Find a register", on_change=lambda event: self._find(event.value))
            search.props('outlined dense clearable debounce=150 aria-label="Find a register"').classes("sb-search")
            with search.add_slot("prepend"):
                ui.icon("search")
            ui.toggle(SHOWN, value="all", on_change=lambda event: self._choose(event.value)).props(
                "unelevated no-caps dense padding='4px 12px' toggle-color=primary"
            ).classes("sb-toggle")
        self._none = ui.label("No register fits.").classes("sb-muted")
        kept = [row for row in rows if row.area is Area.EEPROM]
        lost = [row for row in rows if row.area is Area.RAM and row.writable]
        told = [row for row in rows if row.area is Area.RAM and not row.writable]
        self._section("Kept after power-off", "EEPROM: it wears out after many writes", grouped(kept))
        self._section("Until power-off", "RAM: lost when the power goes", grouped(lost))
        self._section("Measured", "What the servo tells now", {Purpose.MEASURED: told})
        bench.shown(self.show)
        self.show()

    def show(self) -> None:
        """Show what has changed, and what fits what is looked for."""
        for one in self._rows.values():
            one.show()
        self._filter()

    def sample(self, values: Mapping[str, Any]) -> None:
        """Show what was measured: name of the register -> SI value."""
        for name, value in values.items():
            if name in self._measured:
                self._measured[name].show(value)

    def _section(self, name: str, about: str, groups: Mapping[Purpose, list[Register[Any]]]) -> None:
        if not any(groups.values()):
            return
        with ui.element("section").classes("sb-section") as section:
            with ui.element("div").classes("sb-section-head"):
                ui.label(name).classes("sb-title").props("role=heading aria-level=2")
                ui.label(about).classes("sb-muted sb-small")
            for purpose, some in groups.items():
                with ui.element("div").classes("sb-card sb-regs") as card:
                    with ui.element("div").classes("sb-regs-head"):
                        ui.label(purpose.title).classes("sb-regs-title").props("role=heading aria-level=3")
                        ui.label(purpose.about).classes("sb-muted sb-small")
                    for row in sorted(some, key=lambda row: not row.writable):
                        self._row(row)
                self._cards.append((card, [row.name for row in some]))
        self._cards.append((section, [row.name for some in groups.values() for row in some]))

    def _row(self, row: Register[Any]) -> None:
        if row.writable and row.name not in IDENTITY:
            self._rows[row.name] = EditRow(self.bench, row)
        else:
            self._measured[row.name] = Measured(self.bench, row, self._care if row.writable else None)

    def _find(self, text: str | None) -> None:
        self._asked = text or ""
        self._filter()

    def _choose(self, which: str) -> None:
        self._which = which
        self._filter()

    def _filter(self) -> None:
        fits = {name for name in (*self._rows, *self._measured) if self._fits(self.bench.model.registers[name])}
        for name, element in self._elements():
            element.set_visibility(name in fits)
        for card, names in self._cards:
            card.set_visibility(not fits.isdisjoint(names))
        self._none.set_visibility(not fits)

    def _elements(self) -> Iterator[tuple[str, ui.element]]:
        yield from ((name, one.element) for name, one in self._rows.items())
        yield from ((name, one.element) for name, one in self._measured.items())

    def _fits(self, row: Register[Any]) -> bool:
        draft = self.bench.draft
        held = draft.held.get(row.name)
        if self._which == "edited" and row.name not in draft:
            return False
        if self._which == "changed" and (held is None or is_default(row, held) is not False):
            return False
        return matches(row, self._asked)


class Measured:
    """A line of the page whose value cannot be set here."""

    def __init__(self, bench: Workbench, row: Register[Any], care: Callable[[], object] | None) -> None:
        self.row = row
        with ui.element("div").classes("sb-reg") as self.element:
            self.element.props(f"data-register={row.name}")
            with ui.element("div").classes("sb-reg-what"):
                ui.label(title(row)).classes("sb-reg-title")
                ui.label(meaning(row)).classes("sb-muted sb-small")
            held = bench.draft.held.get(row.name)
            now = None if held is None else held.now
            self._value = ui.label("-" if now is None else row.said(now)).classes("sb-reg-value sb-value sb-reg-told")
            with ui.element("div").classes("sb-reg-end"):
                self._raw = ui.label("" if now is None else f"raw {now}").classes("sb-mono sb-muted")
                if care is not None and bench.may_change:
                    button = ui.button(icon="edit", on_click=care, color=None).props("flat round dense size=sm")
                    button.props["aria-label"] = f"Change: {title(row)}"
                    button.classes("sb-quiet")

    def show(self, value: Any) -> None:
        """Show a value as telemetry tells it."""
        self._value.set_text(told_text(self.row, value))
        if isinstance(self.row.scale, Measure) and value is not None:
            self._raw.set_text(f"raw {self.row.scale.encode(value)}")


def told_text(row: Register[Any], value: Any) -> str:
    """Write a value as telemetry tells it for people."""
    if value is None:
        return "-"
    if isinstance(row.scale, Flags):
        return ", ".join(value).replace("_", " ") or "none" if isinstance(value, list) else str(value)
    if isinstance(row.scale, Switch):
        return "on" if value else "off"
    return row.show(value) if isinstance(row.scale, Measure) else str(value).replace("_", " ")
