"""Move: servos driven by hand, one or several, and the poses and motions of robots."""

from typing import Any

from nicegui import ui

from servobus.core.units import deg
from servobus.errors import ServobusError
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.drive_card import SEEN, DriveCard, Settings
from servobus.server.web.page.parts import toast
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.names import titles
from servobus.server.web.page.robot_card import RobotCard
from servobus.server.web.served_bus import ServedBus

FIRST_SERVOS = 4
"""Servos that have a card at first; more are a choice, for each is read all the time."""
MOST_SERVOS = 24
"""Cards at once."""
PERIOD = 0.1
"""s between two readings."""


def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    if bus is None or not bus.servo_entries():
        with empty("open_with", "No servos yet", "Scan for servos first; then they can be moved here."):
            ui.button("To the overview", on_click=lambda: context.go("overview")).props("unelevated no-caps")
        return
    MovePage(context, bus)


class MovePage:
    """The servos of one bus."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus = context, bus
        self._settings = Settings()
        self._cards: dict[str, DriveCard] = {}
        named = titles(context.service)
        self._titles = {entry["key"]: named[bus.name, entry["key"]] for entry in bus.servo_entries()}
        asked = [key for key in context.query.get("servo", "").split(",") if key in self._titles]
        chosen = asked or list(self._titles)[:FIRST_SERVOS]
        with ui.column().classes("sb-card"):
            self._choose(chosen)
            self._how()
        for robot in context.service.robots.values():
            if bus.name in robot.ports:
                RobotCard(context, robot)
        self._grid = ui.element("div").classes("sb-drive-grid")
        ui.timer(0.01, lambda: self._show(chosen), once=True)

    # Building

    def _choose(self, chosen: list[str]) -> None:
        with ui.row().classes("sb-row no-wrap"):
            self._servos = (
                ui.select(self._titles, value=chosen, multiple=True, with_input=True, label="Servos")
                .props("use-chips outlined dense options-dense clearable input-debounce=0")
                .classes("col")
            )
            self._servos.on_value_change(lambda event: self._show(event.value or []))

    def _how(self) -> None:
        with ui.row().classes("sb-row sb-tools"):
            self._kind = ui.toggle({"speed": "Speed", "time": "Time"}, value="speed", on_change=self._set_how).props(
                "no-caps unelevated dense"
            )
            self._amount = ui.number(value=90, min=0.1, suffix="°/s", on_change=self._set_how).props(
                'outlined dense aria-label="Speed or time of a move"'
            )
            self._amount.classes("sb-amount")
            jog = ui.number("Jog", value=45, min=1, max=360, suffix="°/s").props("outlined dense").classes("sb-amount")
            jog.on_value_change(lambda event: self._set_jog(event.value))
            ui.switch("Follow the dial", on_change=lambda event: setattr(self._settings, "follow", event.value)).props(
                "dense"
            ).tooltip("The servo follows while the dial is dragged, not only when it is let go")
            ui.space()
            with ui.row().classes("sb-actions-inline"):
                ui.button("Torque on", on_click=lambda: self._torque(on=True)).props("outline no-caps")
                ui.button("Torque off", on_click=lambda: self._torque(on=False)).props("outline no-caps")
                ui.button("Go together", icon="play_arrow", on_click=self._together).props(
                    "unelevated no-caps"
                ).tooltip("All goals at once: the servos start together and arrive together")

    def _set_how(self) -> None:
        by_time = self._kind.value == "time"
        if self._amount.suffix != (" s" if by_time else "°/s"):
            self._amount.suffix = " s" if by_time else "°/s"
            self._amount.value = 1 if by_time else 90
        amount = self._amount.value
        if amount is None or amount <= 0:
            return
        self._settings.time = float(amount) if by_time else None
        self._settings.speed = None if by_time else float(amount) * deg

    def _set_jog(self, speed: float | None) -> None:
        if speed is not None and speed > 0:
            self._settings.jog = float(speed) * deg

    # What is shown

    async def _show(self, keys: list[str]) -> None:
        if len(keys) > MOST_SERVOS:
            ui.notify(f"{MOST_SERVOS} servos at once are enough: the others are left out", type="warning")
            keys = keys[:MOST_SERVOS]
        for key in [key for key in self._cards if key not in keys]:
            self._cards.pop(key).card.delete()
        new = []
        with self._grid:
            for key in keys:
                if key not in self._cards:
                    self._cards[key] = DriveCard(self._context, self._bus, key, self._titles[key], self._settings)
                    new.append(self._cards[key])
        self._watch()
        for card in new:
            await card.ask()

    def _watch(self) -> None:
        wanted = {}
        for key in self._cards:
            there = {row["name"] for row in self._bus.table(key)}
            wanted[key] = [name for name in SEEN if name in there]
        self._context.telemetry(self._bus.name, wanted, PERIOD, self._seen)

    def _seen(self, sample: dict[str, Any]) -> None:
        for key, told in sample["servos"].items():
            if key in self._cards:
                self._cards[key].seen(told)

    # Several at once

    async def _torque(self, *, on: bool) -> None:
        if self._cards:
            await self._context.attempt(self._bus.torque(self._context.actor, list(self._cards), on=on))

    async def _together(self) -> None:
        goals = {key: card.goal for key, card in self._cards.items() if card.goal is not None}
        if not goals:
            ui.notify("Set goals on the dials first.", type="warning", position="top")
            return
        how = self._settings
        try:
            await self._bus.move(self._context.actor, goals, time=how.time, speed=how.speed)
        except ServobusError as error:
            toast.failed(error)
