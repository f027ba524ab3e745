"""All servos of a bus as they are now, and what is done with several of them."""

from functools import partial
from typing import Any

from nicegui import ui

from servobus.server.web.auth import Role
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.wall import Wall
from servobus.server.web.page.rows import Row, changed, first_row, live_row
from servobus.server.web.page.scanning import Scanning
from servobus.server.web.poller import MISSED
from servobus.server.web.served_bus import ServedBus
from servobus.server.web.values import key_of

PERIOD = 0.2
"""s between two looks at all servos."""
FORCED = {"appeared", "forgotten", "changed", "job"}
"""Events after which other servos may be there."""


def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    if bus is None:
        with empty("usb_off", "No port is open", "Start the server with a port, or open one here."):
            _open_button(context)
        return
    Overview(context, bus)


class Overview:
    """The overview of one bus."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus = context, bus
        self._marked: list[str] = []
        self._rows: dict[str, Row] = {}
        self._missed: dict[str, int] = {}
        """Looks in a row that a servo has not answered."""
        self._fill()
        head = ui.row().classes("sb-row sb-port")
        self._scanning = Scanning(context, bus)
        with head:
            self._port()
        self._wall = Wall(list(self._rows.values()), bus.name, self._mark)
        self._empty = empty(
            "search", "No servo is known yet", "Scanning asks every id at every speed. It moves nothing."
        )
        with self._empty:
            if context.may_change:
                ui.button("Scan for servos", icon="search", on_click=self._scanning.begin).props("unelevated no-caps")
        self._bar = self._marked_bar()
        self._show_empty()
        context.telemetry(bus.name, None, PERIOD, self._sample)
        context.events(self._event)

    # The port

    def _port(self) -> None:
        context, bus = self._context, self._bus
        with ui.column().classes("sb-two"):
            ui.label(bus.name).classes("sb-title")
            ui.label(bus.port).classes("sb-muted sb-small sb-mono ellipsis")
        self._counts = ui.label("").classes("sb-muted sb-small sb-value")
        ui.space()
        if context.role >= Role.ADMIN:
            _open_button(context)
        if context.may_change:
            ui.button("Scan", icon="search", on_click=self._scanning.open).props("unelevated no-caps")
        self._count()

    def _count(self) -> None:
        entry = self._bus.entry()
        failed = f", {entry['failed']:,} failed" if entry["failed"] else ""
        self._counts.text = f"{entry['sent']:,} requests{failed}".replace(",", "\u202f")

    # The servos

    def _fill(self) -> None:
        names = self._context.service.joints(self._bus.name)
        known = {key_of(servo): first_row(servo, names.get(key_of(servo), "")) for servo in self._bus.bus}
        self._rows = {key: {**row, **self._rows.get(key, {})} for key, row in known.items()}

    def _sample(self, sample: dict[str, Any]) -> None:
        servos = {key_of(servo): servo for servo in self._bus.bus}
        changes = []
        for key, told in sample["servos"].items():
            self._missed[key] = self._missed.get(key, 0) + 1 if told["values"] is None else 0
            if key not in self._rows or key not in servos or 0 < self._missed[key] < MISSED:
                continue
            if new := changed(self._rows[key], live_row(servos[key], told)):
                changes.append((key, new))
        self._wall.patch(changes)
        self._count()

    def _event(self, event: dict[str, Any]) -> None:
        if event["what"] not in FORCED or event["bus"] not in (self._bus.name, None):
            return
        if {key_of(servo) for servo in self._bus.bus} != set(self._rows):
            self._fill()
            self._wall.show(list(self._rows.values()))
            self._show_empty()

    def _show_empty(self) -> None:
        self._empty.visible = not self._rows
        self._wall.visible = bool(self._rows)

    # What is done with the marked ones

    def _marked_bar(self) -> ui.row:
        with ui.row().classes("sb-marked-bar") as bar:
            self._said = ui.label("").classes("sb-value")
            ui.button("Stop", icon="front_hand", color="negative", on_click=self._stop).props(
                "unelevated no-caps dense"
            )
            if self._context.may_change:
                for text, icon, work in (
                    ("Torque on", "lock", lambda: self._torque(on=True)),
                    ("Torque off", "lock_open", lambda: self._torque(on=False)),
                ):
                    ui.button(text, icon=icon, color=None, on_click=work).props("flat no-caps dense")
                with ui.button(icon="more_horiz", color=None).props('flat dense round aria-label="More"'), ui.menu():
                    ui.menu_item("Light on", lambda: self._each("led", "on"))
                    ui.menu_item("Light off", lambda: self._each("led", "off"))
                    ui.menu_item("Rearm after a shutdown", self._rearm)
                    ui.menu_item("Forget", self._forget)
            ui.button(icon="close", color=None, on_click=lambda: self._wall.choose([])).props(
                'flat dense round aria-label="Mark none"'
            )
        bar.visible = False
        return bar

    def _mark(self, keys: list[str]) -> None:
        self._marked = [key for key in keys if key in self._rows]
        self._bar.visible = bool(self._marked)
        self._said.text = f"{len(self._marked)} marked"

    def _names(self) -> list[str]:
        return [self._rows[key]["name"] for key in self._marked]

    async def _stop(self) -> None:
        # To stop is for everybody who may look.
        await self._context.attempt(self._bus.stop(self._context.viewer, self._marked), "Stopped")

    async def _torque(self, *, on: bool) -> None:
        context = self._context
        if not on and not await confirm(
            "Switch the torque off?",
            "What these servos hold up falls down.",
            does="Torque off",
            names=self._names(),
            danger=True,
        ):
            return
        marked = list(self._marked)
        await context.attempt(self._bus.torque(context.actor, marked, on=on), f"Torque is {'on' if on else 'off'}")

    async def _each(self, verb: str, *words: str) -> None:
        context = self._context
        for key in list(self._marked):
            await context.attempt(getattr(self._bus, verb)(context.actor, key, *words))

    async def _rearm(self) -> None:
        if await confirm(
            "Rearm?",
            "The torque comes on again where each servo stands. Mend first what has shut it down.",
            does="Rearm",
            names=self._names(),
        ):
            await self._each("rearm")

    def _forget(self) -> None:
        context = self._context
        for key in list(self._marked):
            context.attempt_now(partial(self._bus.forget, context.actor, key))


# Ports


def _open_button(context: PageContext) -> None:
    """Open another port: for those who give access, as the computer connects to what they name."""

    async def ask() -> None:
        with ui.dialog() as dialog, ui.card().classes("sb-dialog"):
            ui.label("Open a port").classes("sb-title")
            port = ui.input("Port", placeholder="/dev/ttyUSB0, COM3, virtual:rx28@1,2").props(
                "outlined dense autofocus"
            )
            name = ui.input("Name", value=f"bus{len(context.service.buses) + 1}").props("outlined dense")
            for field in (port, name):
                field.classes("full-width")
            with ui.row().classes("sb-actions"):
                ui.button("Cancel", color=None, on_click=lambda: dialog.submit(False)).props("flat no-caps")
                ui.button("Open", on_click=lambda: dialog.submit(True)).props("unelevated no-caps")
        try:
            sure = await dialog
        finally:
            dialog.delete()
        if sure and context.role >= Role.ADMIN:
            opened = await context.attempt(
                context.service.open_bus(context.login.name, name.value.strip(), port.value.strip())
            )
            if opened is not None:
                context.go("overview", bus=opened.name)

    ui.button("Open port", icon="add", color=None, on_click=ask).props("flat no-caps")
