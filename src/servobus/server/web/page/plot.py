"""Plot: any registers of any servos against time."""

from typing import Any

from nicegui import ui

from servobus.errors import ServobusError
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.page.parts.chart import Chart
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.names import titles
from servobus.server.web.page.parts.plotting import PLOTTABLE, Channel, Recording, Row, Trigger, subscriptions

WINDOWS = {5: "5 s", 10: "10 s", 30: "30 s", 60: "1 min", 300: "5 min"}
RATES = {5: "5 Hz", 10: "10 Hz", 20: "20 Hz", 50: "50 Hz", 100: "100 Hz"}
DRAWN = 0.05
"""s between two messages to the page."""
BEFORE = 0.3
"""Share of the window that is shown of the time before a trigger."""
FIRST = "present_position"
FIRST_SERVOS = 3
"""Servos that are shown at first."""
EDGES = {"rising": "rises above", "falling": "falls below", "either": "crosses"}


def build(context: PageContext) -> None:
    """Build the page."""
    if not titles(context.service):
        with empty("show_chart", "No servos yet", "Scan for servos first; then their values can be plotted here."):
            ui.button("To the overview", on_click=lambda: context.go("overview")).props("unelevated no-caps")
        return
    PlotPage(context)


class PlotPage:
    """One plot."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._titles = titles(context.service)
        self._tables: dict[tuple[str, str], dict[str, dict[str, Any]]] = {}
        self._recording = Recording(())
        self._pending: list[Row] = []
        self._trigger: Trigger | None = None
        self._seconds, self._rate, self._paused = 10.0, 20, False
        with ui.column().classes("sb-card"):
            self._choose()
            self._toolbar()
            self._trigger_row()
        with ui.column().classes("sb-card sb-chart-card"):
            self._chart = Chart(self._seconds)
        ui.timer(DRAWN, self._flush)
        self._changed()

    # Building

    def _choose(self) -> None:
        bus = self._context.bus
        assert bus is not None  # there are servos
        first = [key for key in self._titles if key[0] == bus.name]
        asked = (bus.name, self._context.query.get("servo", ""))
        chosen = [asked] if asked in self._titles else first[:FIRST_SERVOS]
        several = len({name for name, _ in self._titles}) > 1
        names = {key: f"{key[0]}: {title}" if several else title for key, title in self._titles.items()}
        with ui.row().classes("sb-row sb-pickers"):
            self._servos = ui.select(
                names, value=chosen, multiple=True, with_input=True, label="Servos", on_change=self._changed
            ).props("use-chips outlined dense options-dense clearable input-debounce=0")
            self._registers = ui.select(
                self._choices(chosen),
                value=[self._context.query.get("register", FIRST)],
                multiple=True,
                with_input=True,
                label="Values",
                on_change=self._changed,
            ).props("use-chips outlined dense options-dense clearable input-debounce=0")

    def _toolbar(self) -> None:
        with ui.row().classes("sb-row sb-tools"):
            self._pause = ui.button("Pause", icon="pause", on_click=self._toggle).props("unelevated no-caps")
            ui.select(WINDOWS, value=10, on_change=lambda event: self._span(event.value)).props(
                'outlined dense options-dense aria-label="Time shown"'
            ).tooltip("How much time is shown")
            ui.select(RATES, value=20, on_change=lambda event: self._set_rate(event.value)).props(
                'outlined dense options-dense aria-label="Readings a second"'
            ).tooltip("Readings a second: more load the bus more")
            with ui.row().classes("sb-icons"):
                self._icon("zoom_in", "Zoom in; or drag over a stretch", lambda: self._chart.run_method("zoom", 0.5))
                self._icon("zoom_out", "Zoom out", lambda: self._chart.run_method("zoom", 2))
                self._icon("fit_screen", "Show the newest; or double-click", lambda: self._chart.run_method("reset"))
                self._icon("delete_sweep", "Forget what was read", self._clear)
            ui.space()
            ui.button("Trigger", icon="bolt", on_click=lambda: self._trigger_box.set_visibility(True)).props(
                "flat no-caps"
            )
            with ui.button("Export", icon="download").props("outline no-caps"), ui.menu():
                ui.menu_item("CSV, all that was read", lambda: self._export_csv(visible=False))
                ui.menu_item("CSV, what is shown", lambda: self._export_csv(visible=True))
                ui.menu_item("PNG, a picture", lambda: self._chart.run_method("png", "servobus-plot.png"))

    @staticmethod
    def _icon(icon: str, says: str, does: Any) -> None:
        ui.button(icon=icon, color=None, on_click=does).props(f'flat round dense aria-label="{says}"').classes(
            "sb-quiet"
        ).tooltip(says)

    def _trigger_row(self) -> None:
        with ui.row().classes("sb-row sb-trigger") as self._trigger_box:
            ui.label("Stop when")
            self._source = ui.select({}).props('outlined dense options-dense aria-label="Value of the trigger"')
            self._edge = ui.select(EDGES, value="rising").props('outlined dense options-dense aria-label="Direction"')
            self._level = ui.number(value=0, format="%.6g").props('outlined dense aria-label="Level"')
            self._level.classes("sb-level")
            self._arm_button = ui.button("Arm", on_click=self._arm).props("unelevated no-caps")
            self._state = ui.label("").classes("sb-chip")
            ui.space()
            self._icon("close", "No trigger", self._disarm)
        self._trigger_box.set_visibility(False)

    # What is shown

    def _table(self, servo: tuple[str, str]) -> dict[str, dict[str, Any]]:
        """Give the registers of a servo that can be drawn: name -> row."""
        if servo not in self._tables:
            rows = self._context.service.bus(servo[0]).table(servo[1])
            self._tables[servo] = {row["name"]: row for row in rows if row["kind"] in PLOTTABLE}
        return self._tables[servo]

    def _choices(self, servos: list[tuple[str, str]]) -> dict[str, str]:
        names = dict.fromkeys(name for servo in servos for name in self._table(servo)) or {FIRST: None}
        ordered = sorted(names, key=lambda name: (not name.startswith(("present", "goal")), name))
        return {name: name.replace("_", " ") for name in ordered}

    def _channels(self) -> list[Channel]:
        return [
            Channel(bus, key, name, self._titles[bus, key], row["unit"])
            for bus, key in self._servos.value or []
            for name in self._registers.value or []
            if (row := self._table((bus, key)).get(name)) is not None
        ]

    def _changed(self) -> None:
        """Show what is chosen now, and read it."""
        try:
            choices = self._choices(self._servos.value or list(self._titles)[:1])
            if choices != self._registers.options:
                self._registers.set_options(
                    choices, value=[one for one in self._registers.value or [] if one in choices]
                )
            channels = self._channels()
            self._chart.show(channels)
        except ServobusError as error:
            toast.failed(error)
            return
        before = {channel.bus for channel in self._recording.channels}
        self._recording, self._pending = Recording(channels), []
        self._resume()
        self._disarm()
        self._source.set_options(
            {n: channel.label for n, channel in enumerate(channels)}, value=0 if channels else None
        )
        wanted = subscriptions(channels)
        for bus in before | set(wanted):
            self._context.telemetry(bus, wanted.get(bus, {}), 1 / self._rate, self._sample)

    def _sample(self, sample: dict[str, Any]) -> None:
        row = self._recording.add(sample)
        if row is None:
            return
        self._pending.append(row)
        trigger = self._trigger
        if trigger is None or self._paused:
            return
        if trigger.see(row):
            self._chart.run_method("mark", row[0], "trigger")
            self._state.text = f"fired at {row[0]:.2f} s"
            self._state.classes(add="sb-chip-warn", remove="sb-chip-accent")
        if trigger.fired is not None and row[0] >= trigger.fired + (1 - BEFORE) * self._seconds:
            self._flush()
            self._trigger = None
            self._toggle()

    def _flush(self) -> None:
        if self._pending:
            rows, self._pending = self._pending, []
            self._chart.push(rows)

    # What the buttons do

    def _toggle(self) -> None:
        self._paused = not self._paused
        self._chart.run_method("pause", self._paused)
        self._pause.text = "Go on" if self._paused else "Pause"
        self._pause.props(f"icon={'play_arrow' if self._paused else 'pause'}")

    def _resume(self) -> None:
        if self._paused:
            self._toggle()

    def _span(self, seconds: float) -> None:
        self._seconds = seconds
        self._chart.set_seconds(seconds)

    def _set_rate(self, rate: int) -> None:
        self._rate = rate
        self._changed()

    def _clear(self) -> None:
        self._recording.clear()
        self._pending = []
        self._chart.run_method("clear")
        self._resume()

    def _arm(self) -> None:
        if self._source.value is None or self._level.value is None:
            return
        self._resume()
        self._trigger = Trigger(self._source.value, float(self._level.value), self._edge.value)
        self._state.text = "armed"
        self._state.classes(add="sb-chip-accent", remove="sb-chip-warn")

    def _disarm(self) -> None:
        self._trigger = None
        self._state.text = ""
        self._state.classes(remove="sb-chip-accent sb-chip-warn")
        self._trigger_box.set_visibility(False)

    async def _export_csv(self, *, visible: bool) -> None:
        span = await self._chart.run_method("visible") if visible else ()
        ui.download.content(self._recording.csv(*map(float, span)), "servobus-plot.csv", "text/csv")
