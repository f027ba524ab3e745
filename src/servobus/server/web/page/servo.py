"""The page of one servo: all its registers, its conditions and policies, and what is done with the whole servo."""

from typing import Any

from nicegui import ui

from servobus.core.registers import Area
from servobus.errors import ServobusError
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.names import titles
from servobus.server.web.page.setup.care import Care
from servobus.server.web.page.setup.conditions_view import Conditions
from servobus.server.web.page.setup.registers import Registers
from servobus.server.web.page.setup.review import EditBar
from servobus.server.web.page.setup.workbench import Workbench
from servobus.server.web.served_bus import ServedBus

PERIOD = 0.25
"""s between two samples of what the servo measures."""
TABS = {"registers": "Registers", "conditions": "Conditions", "care": "Care"}


async def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    servos = [] if bus is None else bus.servo_entries()
    if bus is None or not servos:
        with empty("tune", "No servo is known yet", "Look for servos on the overview; their settings stand here then."):
            ui.button("Go to the overview", on_click=lambda: context.go("overview")).props("unelevated no-caps")
        return
    asked = context.query.get("servo", "")
    keys = [servo["key"] for servo in servos]
    try:
        bench = Workbench(context, bus, asked if asked in keys else keys[0])
    except ServobusError:
        return
    await ServoPage(context, bus, bench, servos).build()


class ServoPage:
    """The page as long as one servo is shown."""

    def __init__(self, context: PageContext, bus: ServedBus, bench: Workbench, servos: list[dict[str, Any]]) -> None:
        self._context, self._bus, self._bench, self._servos = context, bus, bench, servos
        self._tab = context.query.get("tab", "registers")
        self._parts: dict[str, Registers | Conditions | Care] = {}

    async def build(self) -> None:
        """Read the servo, and show it."""
        self._header()
        body = ui.element("div").classes("sb-servo")
        with body:
            waiting = ui.element("div").classes("sb-waiting")
            with waiting:
                ui.spinner(size="28px")
                ui.label("Reading the registers …").classes("sb-muted")
        read = await self._bench.read()
        waiting.delete()
        if not read:
            with body, empty("link_off", f"{self._bench.key} does not answer", "Check its power and the line."):
                ui.button("Try again", on_click=self._again).props("unelevated no-caps")
            return
        with body:
            self._build_tabs()
            EditBar(self._bench)
        self._listen()

    # The head

    def _header(self) -> None:
        bench = self._bench
        entry = self._bus.servo_entry(self._bus.servo(bench.key))
        with ui.element("div").classes("sb-card sb-servo-head"):
            named = titles(self._context.service)
            names = {servo["key"]: named[self._bus.name, servo["key"]] for servo in self._servos}
            chooser = ui.select(
                names, value=bench.key, with_input=len(names) > 8, on_change=lambda event: self._turn(event.value)
            )
            chooser.props('outlined dense options-dense aria-label="Servo"').classes("sb-servo-choose")
            with ui.element("div").classes("sb-servo-facts sb-value"):
                ui.label(f"{bench.model.title}, id {bench.id}").classes("sb-muted")
                ui.label(bench.model.family.title).classes("sb-muted")
                ui.label(f"{bench.baud:,} baud".replace(",", " ")).classes("sb-muted")
                if bench.firmware:
                    ui.label(f"firmware {bench.firmware}").classes("sb-muted")
            ui.space()
            with ui.element("div").classes("sb-servo-live"):
                self._position = ui.label("").classes("sb-big sb-value")
                self._torque = ui.label("").classes("sb-chip")
                self._alarm = ui.label("").classes("sb-chip sb-chip-bad")
                self._lost = ui.label("does not answer").classes("sb-chip sb-chip-warn")
            self._alarm.set_visibility(False)
            self._lost.set_visibility(bool(entry["lost"]))
            self._torque.set_visibility(False)
            again = ui.button(icon="refresh", on_click=self._again, color=None).props("flat round")
            again.props('aria-label="Read all registers again"').classes("sb-quiet")
            with again:
                ui.tooltip("Read all registers again")

    def _turn(self, key: str | None) -> None:
        if key is not None and key != self._bench.key:
            self._context.go("servo", bus=self._bus.name, servo=key, tab=self._tab)

    async def _again(self) -> None:
        if self._parts:
            if await self._bench.read():
                ui.notify("All registers were read again", position="top", timeout=1500)
        else:
            self._context.go("servo", bus=self._bus.name, servo=self._bench.key)

    # The tabs

    def _build_tabs(self) -> None:
        with ui.tabs(on_change=lambda event: self._show(event.value)) as self._tabs:
            for name, title in TABS.items():
                ui.tab(name, title)
        self._tabs.props("no-caps align=left inline-label dense").classes("sb-tabs")
        self._panels = {name: ui.element("div").classes("sb-panel") for name in TABS}
        self._tabs.set_value(self._tab if self._tab in TABS else "registers")

    def _show(self, name: str) -> None:
        """Show a tab; it is built when it is shown for the first time."""
        self._tab = name
        if name not in self._parts:
            with self._panels[name]:
                if name == "registers":
                    self._parts[name] = Registers(self._bench, lambda: self._tabs.set_value("care"))
                elif name == "conditions":
                    self._parts[name] = Conditions(self._bench)
                else:
                    self._parts[name] = Care(self._bench, self._moved)
        for one, panel in self._panels.items():
            panel.set_visibility(one == name)

    def _moved(self, key: str) -> None:
        """Follow the servo to another id or speed."""
        self._context.go("servo", bus=self._bus.name, servo=key, tab="care")

    # What the servo tells

    def _listen(self) -> None:
        bench, model = self._bench, self._bench.model
        told = [row for row in model.registers.values() if row.readable and not row.writable and row.area is Area.RAM]
        told.append(model.register("torque_enable"))
        names = [row.name for row in told if row.name not in bench.lacking]
        self._context.telemetry(self._bus.name, {bench.key: names}, PERIOD, self._sample)
        self._context.events(self._event)

    def _sample(self, message: dict[str, Any]) -> None:
        told = message["servos"].get(self._bench.key)
        if told is None:
            return
        values = told["values"]
        self._lost.set_visibility(values is None)
        if values is None:
            return
        model = self._bench.model
        place = model.register("present_position")
        if values[place.name] is not None:
            self._position.set_text(place.show(values[place.name]))
        torque = model.register("torque_enable")
        on = values[torque.name] in (True, "on")
        self._torque.set_text("Torque on" if on else "Torque off")
        self._torque.classes(add="sb-chip-ok" if on else "", remove="" if on else "sb-chip-ok")
        self._torque.set_visibility(True)
        alarms = told["alarms"]
        self._alarm.set_visibility(bool(alarms))
        self._alarm.set_text(", ".join(alarms).replace("_", " "))
        part = self._parts.get(self._tab)
        if isinstance(part, Conditions):
            part.sample(values, alarms)
        elif part is not None:
            part.sample(values)

    async def _event(self, event: dict[str, Any]) -> None:
        """Read again what somebody else has changed."""
        mine = event.get("bus") == self._bus.name and event.get("servo") == self._bench.key
        if mine and event["what"] == "changed" and event.get("by") != self._context.login.name:
            await self._bench.read()
