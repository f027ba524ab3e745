"""Conditions and policies: limits with the live value on the same scale, alarms and what follows, answers."""

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from servobus.core.registers import Register
from servobus.families.base import Answers
from servobus.server.web.page.settings import conditions
from servobus.server.web.page.settings.gauges import Gauge, gauges
from servobus.server.web.page.settings.purposes import title
from servobus.server.web.page.setup.editor import Editor
from servobus.server.web.page.setup.workbench import Workbench


class Conditions:
    """The tab with conditions and policies."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        with ui.element("div").classes("sb-card"):
            head(
                "Limits", "The mark is the value now, on the same scale. Outside the coloured part the servo complains."
            )
            with ui.element("div").classes("sb-bars"):
                self._bars = [LimitBar(bench, one) for one in gauges(bench.model)]
        with ui.element("div").classes("sb-card"):
            head("Alarms, and what follows", "Choose for each alarm whether the LED blinks and the torque goes off.")
            self._grid = AlarmGrid(bench)
        with ui.element("div").classes("sb-card"):
            head("Answers", "Which requests the servo answers.")
            self._answers = AnswerPolicy(bench)
        bench.shown(self.show)
        self.show()

    def show(self) -> None:
        """Show what is there now."""
        for bar in self._bars:
            bar.show()
        self._grid.show()
        self._answers.show()

    def sample(self, values: Mapping[str, Any], alarms: Sequence[str]) -> None:
        """Show what was measured, and which alarms stand."""
        for bar in self._bars:
            bar.sample(values)
        self._grid.sample(alarms)


class LimitBar:
    """A measured value between its limits."""

    def __init__(self, bench: Workbench, gauge: Gauge) -> None:
        self.bench, self.gauge = bench, gauge
        self._value: float | None = None
        self._error: ui.label | None = None
        with ui.element("div").classes("sb-bar"):
            with ui.element("div").classes("sb-bar-head"):
                ui.label(gauge.title).classes("sb-reg-title")
                self._now = ui.label("").classes("sb-bar-now sb-value")
            with ui.element("div").classes("sb-bar-track"):
                self._fill = ui.element("div").classes("sb-bar-fill")
                self._mark = ui.element("div").classes("sb-bar-mark")
            with ui.element("div").classes("sb-bar-ends"):
                self._editors = [
                    self._end(row, "from" if row is gauge.low else "to")
                    for row in (gauge.low, gauge.high)
                    if row is not None
                ]
            self._error = ui.label("").classes("sb-small sb-bad sb-reg-about")
        self._mark.set_visibility(False)

    def show(self) -> None:
        for editor in self._editors:
            editor.show()
        limits = self._limits()
        low = 0.0 if self.gauge.low is None else self.gauge.share(limits.get(self.gauge.low.name, self.gauge.span[0]))
        high = self.gauge.share(limits.get(self.gauge.high.name, self.gauge.span[1]))
        self._fill.style(f"left:{100 * low:.1f}%;width:{100 * max(high - low, 0):.1f}%")
        self._tell()

    def sample(self, values: Mapping[str, Any]) -> None:
        value = values.get(self.gauge.live.name)
        if value != self._value:
            self._value = value
            self._tell()

    def _end(self, row: Register[Any], word: str) -> Editor:
        with ui.element("div").classes("sb-bar-end"):
            ui.label(word).classes("sb-muted sb-small")
            return Editor(self.bench, row, self._wrong)

    def _wrong(self, error: str) -> None:
        if self._error is not None:
            self._error.set_text(error)

    def _limits(self) -> dict[str, float]:
        rows = [row for row in (self.gauge.low, self.gauge.high) if row is not None]
        raws = {row: self.bench.draft.raw(row.name) for row in rows}
        return {row.name: row.scale.decode(raw) for row, raw in raws.items() if raw is not None}

    def _tell(self) -> None:
        value = self._value
        self._mark.set_visibility(value is not None)
        self._now.set_text("" if value is None else self.gauge.text(value))
        if value is None:
            return
        fine = self.gauge.inside(value, self._limits())
        self._mark.style(f"left:{100 * self.gauge.share(value):.1f}%")
        for element in (self._mark, self._now):
            element.classes(add="" if fine else "sb-out", remove="sb-out" if fine else "")


class AlarmGrid:
    """A line for each alarm, with what follows."""

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        model = bench.model
        self._light, self._torque = conditions.light_row(model), conditions.torque_row(model)
        self._states: dict[str, ui.label] = {}
        self._limits: list[tuple[ui.label, tuple[Register[Any], ...]]] = []
        self._boxes: list[tuple[ui.checkbox, Register[Any], int]] = []
        self._showing = False
        with ui.element("div").classes("sb-grid").props("role=table"):
            with ui.element("div").classes("sb-grid-row sb-grid-head").props("role=row"):
                for word in ("Alarm", "LED blinks", "Torque off"):
                    ui.label(word).props("role=columnheader")
            for one in conditions.conditions(model):
                self._line(one)
        if self._torque is None:
            ui.label("Which alarms switch the torque off cannot be chosen on this model.").classes("sb-muted sb-small")

    def show(self) -> None:
        self._showing = True
        for box, row, bit in self._boxes:
            raw = self.bench.draft.raw(row.name)
            box.set_value(bool((raw or 0) & bit))
            edited = row.name in self.bench.draft and self._changed(row, bit)
            box.classes(add="sb-box-edited" if edited else "", remove="" if edited else "sb-box-edited")
        self._showing = False
        for label, rows in self._limits:
            raws = [(row, self.bench.draft.raw(row.name)) for row in rows]
            label.set_text(", ".join(f"{title(row)} {row.said(raw)}" for row, raw in raws if raw is not None))

    def sample(self, alarms: Sequence[str]) -> None:
        for name, state in self._states.items():
            state.set_visibility(name in alarms)

    def _line(self, one: conditions.Condition) -> None:
        with ui.element("div").classes("sb-grid-row").props(f"role=row data-alarm={one.name}"):
            with ui.element("div").props("role=cell"):
                with ui.element("div").classes("sb-reg-title"):
                    ui.label(one.title)
                    state = ui.label("now").classes("sb-chip sb-chip-bad")
                    state.set_visibility(False)
                    self._states[one.name] = state
                self._limits.append((ui.label("").classes("sb-small sb-value"), one.limits))
                ui.label(one.mend).classes("sb-muted sb-small")
            self._box(self._light, one.light, f"{one.title}: LED blinks")
            self._box(self._torque, one.torque, f"{one.title}: torque off")

    def _box(self, row: Register[Any] | None, bit: int | None, label: str) -> None:
        with ui.element("div").props("role=cell").classes("sb-grid-box"):
            if row is None or bit is None:
                ui.label("-").classes("sb-muted")
                return
            box = ui.checkbox(on_change=lambda event, row=row, bit=bit: self._set(row, bit, event.value))
            box.props["aria-label"] = label
            if not self.bench.may_change:
                box.props("disable")
            self._boxes.append((box, row, bit))

    def _set(self, row: Register[Any], bit: int, on: bool) -> None:
        raw = self.bench.draft.raw(row.name)
        if not self._showing and raw is not None:
            self.bench.set(row.name, conditions.with_bit(raw, bit, on))

    def _changed(self, row: Register[Any], bit: int) -> bool:
        held, raw = self.bench.draft.held[row.name], self.bench.draft.raw(row.name)
        return bool(((held.now or 0) ^ (raw or 0)) & bit)


class AnswerPolicy:
    """Which requests are answered: three cards of which one is chosen."""

    def __init__(self, bench: Workbench) -> None:
        self.bench, self.row = bench, conditions.answer_policy(bench.model)
        self._cards: dict[Answers, ui.element] = {}
        if self.row is None:
            ui.label("This servo answers every question, and no write. That cannot be set.").classes("sb-muted")
            return
        with ui.element("div").classes("sb-choices").props("role=radiogroup"):
            for level, (name, about) in conditions.ANSWERS.items():
                with ui.element("button").classes("sb-choice").props("type=button role=radio") as card:
                    ui.label(name).classes("sb-reg-title")
                    ui.label(about).classes("sb-muted sb-small")
                if bench.may_change:
                    card.on("click", lambda level=level: bench.set(self._name, int(level)))
                self._cards[level] = card

    @property
    def _name(self) -> str:
        return "" if self.row is None else self.row.name

    def show(self) -> None:
        if self.row is None:
            return
        raw = self.bench.draft.raw(self.row.name)
        for level, card in self._cards.items():
            here = raw == level
            card.classes(add="sb-chosen" if here else "", remove="" if here else "sb-chosen")
            card.props(f"aria-checked={'true' if here else 'false'}")


def head(name: str, about: str) -> None:
    """Write the head of a card."""
    with ui.element("div").classes("sb-regs-head"):
        ui.label(name).classes("sb-title").props("role=heading aria-level=2")
        ui.label(about).classes("sb-muted sb-small")
