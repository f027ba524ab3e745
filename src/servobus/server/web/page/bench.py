"""Bench: what surrounds virtual servos: load, blocked shaft, supply, heat, faults on the line."""

import math
import time
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Any

from nicegui import ui

from servobus.errors import ServobusError
from servobus.remote.managing import Bench, BenchServo
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.surroundings import (
    COLD,
    FAULTS,
    HOT,
    faults_text,
    load_text,
    read_faults,
    supply_span,
    torque_span,
)
from servobus.server.web.served_bus import ServedBus

LOOK = 0.2
"""s between two looks at the servos."""
OWN = 1.0
"""s after a change for which a slider stays as it was put, whatever is told."""
ROOM = 25.0
"""degC."""
PER_PAGE = 12
"""Servos that are shown at once."""
THROTTLE = 0.1
"""s between two changes while a slider is dragged."""


async def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    if bus is None:
        empty("usb_off", "No bus", "Start one with virtual servos: servobus serve virtual:rx28@1-4")
        return
    try:
        bench = await bus.bench()
    except ServobusError as error:
        empty("science", "No virtual servos here", str(error))
        return
    BenchPage(context, bus, bench).build()


class Knob:
    """A slider with its name and value, which leaves what somebody drags alone."""

    def __init__(
        self,
        name: str,
        unit: str,
        low: float,
        high: float,
        step: float,
        value: float,
        change: Callable[[float], Awaitable[object]],
        *,
        enabled: bool = True,
    ) -> None:
        self._unit, self._change, self._step = unit, change, step
        self._touched = -math.inf
        with ui.column().classes("sb-knob"):
            with ui.row().classes("sb-knob-head"):
                ui.label(name).classes("sb-muted")
                self._text = ui.label(self._said(value)).classes("sb-value")
            self._slider = ui.slider(min=low, max=high, step=step, value=value).props(f'aria-label="{name}"')
            self._slider.set_enabled(enabled)
        self._slider.on("update:model-value", self._moved, throttle=THROTTLE, leading_events=True)

    def _said(self, value: float) -> str:
        digits = max(0, -math.floor(math.log10(self._step) + 1e-9))
        return f"{value:.{digits}f} {self._unit}"

    async def _moved(self) -> None:
        self._touched = time.monotonic()
        value = float(self._slider.value)
        self._text.text = self._said(value)
        await self._change(value)

    def enable(self, *, on: bool) -> None:
        """Let it be dragged, or not; only a change goes to the browser."""
        if self._slider.enabled != on:
            self._slider.set_enabled(on)

    def told(self, value: float) -> None:
        """Show what it is now."""
        if time.monotonic() - self._touched < OWN:
            return
        if abs(float(self._slider.value) - value) > self._step / 2:
            self._slider.value = value
            self._text.text = self._said(value)


class BenchPage:
    """The page of one tab."""

    def __init__(self, context: PageContext, bus: ServedBus, bench: Bench) -> None:
        self._context, self._bus, self._bench = context, bus, bench
        self._first = 0
        self._cards: dict[int, ServoCard] = {}

    def build(self) -> None:
        with ui.column().classes("sb-card"):
            with ui.row().classes("sb-row"):
                with ui.column().classes("sb-grow sb-tight"):
                    ui.label("Everything around the servos").classes("sb-title")
                    ui.label("No real servo is touched. Watch on the other pages what the servos say to it.").classes(
                        "sb-muted"
                    )
                if self._context.may_change:
                    ui.button("Put everything right", icon="restart_alt", on_click=self._mend_all).props(
                        "outline no-caps dense padding='6px 14px'"
                    )
            with ui.element("div").classes("sb-knobs"):
                self._build_line()
            with ui.row().classes("sb-row"):
                self._words = (
                    ui.input("All faults, in words", value=self._bench.faults)
                    .props("dense outlined input-class=sb-mono")
                    .classes("sb-grow")
                    .on("keydown.enter", self._set_words)
                )
                ui.button("Set", on_click=self._set_words).props("flat no-caps dense")
            self._happened = ui.label("").classes("sb-muted sb-small sb-value")
        pages = math.ceil(len(self._bench.servos) / PER_PAGE)
        if pages > 1:
            ui.pagination(1, pages, value=1, on_change=lambda event: self._turn_to(event.value))
        self._place = ui.element("div").classes("sb-bench")
        self._build_cards()
        look = ui.timer(LOOK, self._look)
        self._context.leaving(look.cancel)

    def _build_line(self) -> None:
        may = self._context.may_change
        faults = read_faults(self._bench.faults) or {}
        self._faults = {
            kind: Knob(name, unit, 0.0, most, step, faults.get(kind, 0.0), partial(self._set_fault, kind), enabled=may)
            for kind, (name, unit, most, step) in FAULTS.items()
        }

    def _build_cards(self) -> None:
        self._place.clear()
        self._cards = {}
        with self._place:
            for servo in self._bench.servos[self._first : self._first + PER_PAGE]:
                self._cards[servo.number] = ServoCard(self, servo, may=self._context.may_change)

    def _turn_to(self, page: int) -> None:
        self._first = (page - 1) * PER_PAGE
        self._build_cards()

    # What is asked for

    async def set(self, servos: Sequence[int] = (), **changes: Any) -> None:
        """Change something, and show what came of it."""
        bench = await self._context.attempt(self._bus.set_bench(self._context.actor, servos, **changes))
        if bench is not None:
            self._show(bench)

    async def _set_fault(self, kind: str, value: float) -> None:
        faults = read_faults(self._bench.faults) or {}
        await self.set(faults=faults_text({**faults, kind: value}))

    async def _set_words(self) -> None:
        await self.set(faults=self._words.value or "none")

    async def _mend_all(self) -> None:
        await self.set(load="none", temperature=ROOM, plugged=True, faults="none")
        supplies = {servo.nominal for servo in self._bench.servos}
        for volts in supplies:
            await self.set([one.number for one in self._bench.servos if one.nominal == volts], voltage=volts)

    # What comes

    async def _look(self) -> None:
        try:
            self._show(await self._bus.bench())
        except ServobusError:  # the bus is closed; the frame says so
            return

    def _show(self, bench: Bench) -> None:
        if bench.faults != self._bench.faults:
            self._words.value = bench.faults
        self._bench = bench
        faults = read_faults(bench.faults) or {}
        for kind, knob in self._faults.items():
            knob.told(faults.get(kind, 0.0))
        said = ", ".join(f"{FAULTS[kind][0].lower() if kind in FAULTS else kind} {n}" for kind, n in bench.happened)
        self._happened.text = f"Since then: {said}" if said else ""
        for servo in bench.servos:
            if servo.number in self._cards:
                self._cards[servo.number].show(servo)


class ServoCard:
    """One servo of the bench."""

    def __init__(self, page: BenchPage, servo: BenchServo, *, may: bool) -> None:
        self._page, self._servo = page, servo
        self._home = round(math.degrees(servo.home))
        only = [servo.number]
        with ui.column().classes("sb-card sb-bench-card"):
            with ui.row().classes("sb-row no-wrap"):
                with ui.element("div").classes("sb-gauge").props('role=img aria-label="Angle of the shaft"'):
                    self._needle = ui.element("div").classes("sb-needle")
                with ui.column().classes("sb-grow sb-tight"):
                    with ui.row().classes("sb-tight-row items-center"):
                        self._name = ui.label("").classes("sb-title")
                        self._led = ui.element("span").classes("sb-led")
                    self._state = ui.label("").classes("sb-muted sb-small")
                    self._angle = ui.label("").classes("sb-value")
            self._figures = ui.label("").classes("sb-muted sb-small sb-value")
            most = torque_span(servo)
            self._supply = Knob(
                "Supply", "V", 0.0, supply_span(servo), 0.1, servo.source,
                lambda v: page.set(only, voltage=v), enabled=may,
            )  # fmt: skip
            self._load = Knob(
                "Load", "N·m", -most, most, 0.01, servo.load, lambda v: self._hang("torque", v), enabled=may
            )
            self._mass = Knob(
                "Weight on an arm of 10 cm", "kg", 0.0, _weight(servo), 0.01, servo.mass,
                lambda v: self._hang("mass", v), enabled=may,
            )  # fmt: skip
            self._heat = Knob(
                "Heat", "°C", COLD, HOT, 1.0, servo.temperature,
                lambda v: page.set(only, temperature=v), enabled=may,
            )  # fmt: skip
            self._turn = Knob(
                "Turn by hand", "°", self._home - 180, self._home + 180, 1.0, math.degrees(servo.position),
                lambda v: page.set(only, position=math.radians(v)), enabled=may,
            )  # fmt: skip
            with ui.row().classes("sb-row"):
                self._blocked = ui.switch("Shaft blocked", value=servo.blocked).props("dense")
                self._plugged = ui.switch("Plugged in", value=servo.plugged).props("dense")
                for switch in (self._blocked, self._plugged):
                    switch.set_enabled(may)
                self._blocked.on(
                    "update:model-value",
                    lambda: page.set(only, load="blocked" if self._blocked.value else "blocked=off"),
                )
                self._plugged.on("update:model-value", lambda: page.set(only, plugged=bool(self._plugged.value)))
        self._may = may
        self._last: tuple[Any, ...] = ()
        self.show(servo)

    def _hang(self, name: str, value: float) -> Awaitable[None]:
        return self._page.set([self._servo.number], load=load_text(self._servo, name, value))

    def show(self, servo: BenchServo) -> None:
        """Show how it is now; only what is another than before goes to the browser."""
        self._servo = servo
        degrees = math.degrees(servo.position)
        said = (
            f"{servo.title} id {servo.id}",
            "no supply" if not servo.plugged else "holds its shaft" if servo.torque else "shaft turns freely",
            f"{degrees:.1f}°",
            " · ".join(
                (
                    f"{servo.voltage:.1f} V",
                    f"{1000 * servo.current:.0f} mA",
                    f"{servo.temperature:.0f} °C",
                    f"{math.degrees(servo.speed):.0f} °/s",
                )
            ),
            servo.led,
        )
        if said != self._last:
            self._name.text, self._state.text, self._angle.text, self._figures.text, led = said
            self._needle.style(f"transform: rotate({degrees - self._home:.1f}deg)")
            self._led.style(f"background: {led_colour(led)}")
            self._led.props(f'title="LED {led}"')
            self._last = said
        self._supply.told(servo.source)
        self._load.told(servo.load)
        self._mass.told(servo.mass)
        self._heat.told(servo.temperature)
        self._turn.told((degrees - self._home + 180) % 360 + self._home - 180)
        self._turn.enable(on=self._may and not servo.torque)
        for switch, value in ((self._blocked, servo.blocked), (self._plugged, servo.plugged)):
            if switch.value != value:
                switch.value = value


LEDS = {"red": "#ef4444", "green": "#22c55e", "blue": "#3b82f6", "green+blue": "#22d3ee", "red+green": "#eab308"}


def led_colour(led: str) -> str:
    """Give the colour of a light for a style sheet."""
    if led == "off":
        return "var(--sb-track)"
    return LEDS.get(led, "#e879f9" if set(led.split("+")) == {"red", "blue"} else "#f8fafc")


def _weight(servo: BenchServo) -> float:
    """Give the end of the slider of the weight, kg: what the servo cannot lift any more on an arm of 10 cm."""
    return max(0.05, round(torque_span(servo) / 9.81 / 0.1, 2))
