"""Packets: what goes over the line, in words, and a packet written by hand."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from nicegui import background_tasks, ui

from servobus.core.effect import Kind
from servobus.core.ids import BROADCAST
from servobus.errors import ServobusError
from servobus.families import registry
from servobus.server.web.composer import Composed, compose, send, template
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.parts.empty import empty
from servobus.server.web.page.parts.log import PacketLog
from servobus.server.web.served_bus import ServedBus
from servobus.server.web.traffic import Filter
from servobus.server.web.values import key_of

LOOK, COUNT = 0.2, 1.0
"""s between two looks for new packets, and at the counts."""
READ, SELDOM = 0.5, 5.0
"""s between two reads of all servos, and of none."""
ANY = "Any"


async def build(context: PageContext) -> None:
    """Build the page."""
    bus = context.bus
    if bus is None:
        empty("usb_off", "No bus", "Packets are seen on a bus: open one on the page Overview.")
        return
    page = PacketsPage(context, bus)
    page.build()
    await page.begin()


class PacketsPage:
    """The page of one tab."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus, self._watch = context, bus, bus.traffic
        self._filter = Filter()
        self._shown = 0
        self._paused = False

    async def begin(self) -> None:
        """Look at the packets until another page is shown."""
        try:
            await self._watch.begin()
        except ServobusError as error:
            self._log.delete()
            with self._place:
                ui.label(str(error)).classes("sb-muted")
            return
        looks = [ui.timer(LOOK, self._look), ui.timer(COUNT, self._count)]

        def leave() -> None:
            for one in looks:
                one.cancel()
            background_tasks.create(self._watch.end())

        self._context.leaving(leave)
        self._read()

    # Building

    def build(self) -> None:
        with ui.element("div").classes("sb-packets"):
            with ui.column().classes("sb-card sb-packets-log") as self._place:
                self._build_filter()
                self._log = PacketLog()
            with ui.column().classes("sb-packets-side"):
                if self._context.may_change:
                    Composer(self._context, self._bus).build()
                self._build_counts()

    def _build_filter(self) -> None:
        with ui.row().classes("sb-row sb-filters"):
            self._servo = ui.select([ANY], value=ANY, label="Servo", on_change=self._refilter).props(
                "dense outlined options-dense"
            )
            self._by = ui.select([ANY], value=ANY, label="Program", on_change=self._refilter).props(
                "dense outlined options-dense"
            )
            self._text = (
                ui.input("Find words or bytes", on_change=self._refilter)
                .props("dense outlined clearable debounce=250")
                .classes("sb-grow")
            )
        with ui.row().classes("sb-row"):
            self._troubles = ui.switch("Only errors", on_change=self._refilter).props("dense")
            self._reads = ui.switch("Read all servos", value=True, on_change=self._read).props("dense")
            self._pause = (
                ui.button(icon="pause", color=None, on_click=self._toggle)
                .props('flat round dense aria-label="Pause"')
                .classes("sb-quiet")
            )

    def _build_counts(self) -> None:
        with ui.column().classes("sb-card"):
            ui.label("Servos").classes("sb-title")
            self._nobody = ui.label("Nothing has been asked yet.").classes("sb-muted")
            self._table = ui.aggrid(
                {
                    "columnDefs": [
                        {"field": "servo", "headerName": "Servo", "flex": 2, "minWidth": 112},
                        {"field": "requests", "headerName": "Asked", "flex": 1, "minWidth": 64},
                        {"field": "median", "headerName": "Median ms", "flex": 1, "minWidth": 78},
                        {"field": "worst", "headerName": "Longest ms", "flex": 1, "minWidth": 78},
                        {"field": "errors", "headerName": "Errors %", "flex": 1, "minWidth": 70},
                    ],
                    "defaultColDef": {
                        "wrapHeaderText": True,
                        "sortable": True,
                        "suppressMovable": True,
                        "resizable": True,
                    },
                    "rowData": [],
                    ":getRowId": "params => params.data.servo",
                    "rowHeight": 36,
                    "headerHeight": 48,
                },
                auto_size_columns=False,
            ).classes("sb-counts")
            self._table.set_visibility(False)
            ui.label("Programs").classes("sb-title")
            self._programs = ui.row().classes("sb-chips")
            self._missed = ui.label("").classes("sb-warn sb-small")
        self._rows: dict[str, dict[str, Any]] = {}
        self._chips: dict[str, ui.label] = {}
        self._before: dict[str, int] = {}

    # What comes

    def _look(self) -> None:
        if self._paused:
            return
        new = self._watch.after(self._shown)
        if not new:
            return
        self._shown = new[-1].number
        if fitting := self._filter.of(new):
            self._log.add(fitting)

    def _count(self) -> None:
        rows = {entry["name"]: count_row(entry) for entry in self._watch.servos()}
        added = [row for name, row in rows.items() if name not in self._rows]
        changed = [row for name, row in rows.items() if name in self._rows and self._rows[name] != row]
        gone = [row for name, row in self._rows.items() if name not in rows]
        if added or changed or gone:
            self._rows = rows
            self._nobody.set_visibility(not rows)
            if rows and not self._table.visible:
                self._table.set_visibility(True)
                self._table.options["rowData"] = list(rows.values())
                self._table.update()
            else:
                self._table.run_grid_method("applyTransaction", {"add": added, "update": changed, "remove": gone})
            if added or gone:
                self._servo.set_options([ANY, *rows])
        self._count_programs()

    def _count_programs(self) -> None:
        counts = self._watch.programs
        for name, count in counts.items():
            if name not in self._chips:
                with self._programs:
                    self._chips[name] = ui.label("").classes("sb-chip sb-value")
                self._by.set_options([ANY, *counts])
            rate = (count - self._before.get(name, count)) / COUNT
            self._chips[name].text = f"{name}  {rate:.0f}/s"
        self._before = dict(counts)
        missed = self._watch.missed
        self._missed.text = f"{missed} pieces were left out: the line is faster than this page" if missed else ""

    # What is asked for

    def _refilter(self) -> None:
        self._filter = Filter(
            servo="" if self._servo.value == ANY else self._servo.value,
            by="" if self._by.value == ANY else self._by.value,
            text=self._text.value or "",
            troubles=self._troubles.value,
        )
        seen = self._watch.after(0)
        if seen and not self._paused:
            self._shown = seen[-1].number
        self._log.replace(self._filter.of([one for one in seen if one.number <= self._shown]))

    def _read(self) -> None:
        """Have all servos read, so that there is something to see, or leave the line to others."""
        self._context.telemetry(
            self._bus.name, None if self._reads.value else {}, READ if self._reads.value else SELDOM, _nothing
        )

    def _toggle(self) -> None:
        self._paused = not self._paused
        icon, does = ("play_arrow", "Go on") if self._paused else ("pause", "Pause")
        self._pause.props(f'icon={icon} aria-label="{does}"')
        if not self._paused:
            self._look()


class Composer:
    """A packet that is written by hand."""

    def __init__(self, context: PageContext, bus: ServedBus) -> None:
        self._context, self._bus = context, bus

    def build(self) -> None:
        servos = {key_of(one): f"{one.model.title} id {one.id}" for one in self._bus.bus}
        with ui.column().classes("sb-card sb-composer"):
            ui.label("Write a packet").classes("sb-title")
            with ui.row().classes("sb-row no-wrap"):
                families = {name: family.title for name, family in registry.FAMILIES.items()}
                first = next(iter(self._bus.bus), None)
                self._family = ui.select(
                    families,
                    value=first.family.name if first else next(iter(families)),
                    label="Family",
                    on_change=self._change,
                ).props("dense outlined options-dense")
                self._family.classes("sb-grow")
                self._id = ui.number("Id", value=first.id if first else 1, min=0, max=BROADCAST, precision=0).props(
                    "dense outlined"
                )
                self._id.on_value_change(self._change)
            with ui.row().classes("sb-row no-wrap"):
                self._code = (
                    ui.input("Command", value="01", on_change=self._change)
                    .props("dense outlined input-class=sb-mono maxlength=4")
                    .classes("sb-code")
                )
                self._data = (
                    ui.input("Data, hexadecimal", on_change=self._change)
                    .props("dense outlined input-class=sb-mono clearable")
                    .classes("sb-grow")
                )
            if servos:
                with ui.row().classes("sb-row no-wrap"):
                    self._question = (
                        ui.select(
                            ["ping", *_registers(self._bus)],
                            label="Or begin with a question",
                            with_input=True,
                            on_change=self._begin_with,
                        )
                        .props("dense outlined options-dense")
                        .classes("sb-grow")
                    )
            self._raw = ui.label("").classes("sb-mono sb-raw")
            self._said = ui.label("")
            self._does = ui.row().classes("sb-chips")
            with ui.row().classes("sb-row"):
                self._send = ui.button("Send", icon="send", on_click=self._do).props("unelevated no-caps")
                self._answer = ui.label("").classes("sb-grow").props("role=status")
        self._change()

    @property
    def _baud(self) -> int:
        family = registry.family(self._family.value)
        known = [one.baud for one in self._bus.bus if one.family is family and one.id == self._id.value]
        known += [one.baud for one in self._bus.bus if one.family is family]
        return known[0] if known else registry.factory_bauds(family)[0]

    def _composed(self) -> Composed:
        return compose(
            self._bus, self._family.value, int(self._id.value or 0), self._code.value or "", self._data.value or ""
        )

    def _change(self) -> None:
        if not hasattr(self, "_send"):
            return
        self._does.clear()
        try:
            composed = self._composed()
        except ServobusError as error:
            self._raw.text, self._said.text = "", str(error)
            self._said.classes(replace="sb-bad sb-small")
            self._send.disable()
            return
        self._raw.text = composed.raw.hex(" ").upper()
        self._said.text = composed.text
        self._said.classes(replace="sb-small")
        with self._does:
            for text in composed.does:
                harmless = composed.effect.only_reads
                ui.label(text).classes(f"sb-chip {'sb-chip-ok' if harmless else 'sb-chip-warn'}")
        self._send.enable()

    def _begin_with(self) -> None:
        asked = self._question.value
        for servo in self._bus.bus:
            if servo.family.name == self._family.value and servo.id == self._id.value:
                register = "" if asked == "ping" else asked
                made = self._context.attempt_now(partial(template, self._bus, key_of(servo), register))
                if made is not None:
                    self._code.value, self._data.value = made
                return
        self._answer.text = "No servo with this id is known here."

    async def _do(self) -> None:
        composed = self._context.attempt_now(self._composed)
        if composed is None:
            return
        if composed.effect.kinds & (Kind.STORES | Kind.DRIVES):
            sure = await confirm(
                "Send this packet?",
                f"{composed.text}. It {' and '.join(composed.does)}.",
                does="Send",
                danger=True,
            )
            if not sure:
                return
        said = await self._context.attempt(send(self._bus, self._context.actor, composed, self._baud))
        self._answer.text = said or ""


def count_row(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Give what a servo did as a row of the table."""
    rate = entry["error_rate"]
    return {
        "servo": entry["name"],
        "requests": entry["requests"],
        "median": _milliseconds(entry["latency_median"]),
        "worst": _milliseconds(entry["latency_longest"]),
        "errors": "" if rate is None else f"{100 * rate:.3g}",
    }


def _nothing(_: Mapping[str, Any]) -> None:
    """Show no values: their packets are what is looked at."""


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1000 * seconds:.2f}"


def _registers(bus: ServedBus) -> list[str]:
    """Give the names of all registers that can be read, of all models on a bus."""
    names: dict[str, None] = {}
    for one in bus.bus:
        names.update(dict.fromkeys(row.name for row in one.model.registers.values() if row.readable))
    return sorted(names)
