"""What is done with the whole servo: id and speed, zero, backup, copy, compare, restart, factory settings."""

import re
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from nicegui import ui
from nicegui.events import UploadEventArguments

from servobus.core.units import deg
from servobus.errors import UsageError
from servobus.families import registry
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.parts.names import titles
from servobus.server.web.page.settings import zero
from servobus.server.web.page.setup.conditions_view import head
from servobus.server.web.page.setup.review import close, counted, diff
from servobus.server.web.page.setup.workbench import Workbench

MOST_FILE = 500_000
"""Bytes of a backup file."""
KEPT = {"id": "Id", "baud": "Speed", "calibration": "Zero"}


class Care:
    """The tab with what concerns the whole servo.

    moved  called with the new key when the servo has another id or speed
    """

    def __init__(self, bench: Workbench, moved: Callable[[str], object]) -> None:
        self.bench, self._moved = bench, moved
        self._position: float | None = None
        self._present: ui.label | None = None
        with ui.element("div").classes("sb-cards"):
            if bench.model.generic:
                self._model()
            self._identity()
            self._zero()
            self._backup()
            self._copy()
            self._compare()
            self._restart()

    def sample(self, values: Mapping[str, Any]) -> None:
        """Show where the shaft is."""
        row = self.bench.model.register("present_position")
        value = values.get(row.name)
        if value is not None and value != self._position and self._present is not None:
            self._present.set_text(row.show(value))
        self._position = value

    # What a servo cannot say

    def _model(self) -> None:
        bench = self.bench
        models = {
            model.key(): model.title
            for model in registry.MODELS.values()
            if model.family is bench.model.family and not model.generic
        }
        with _card("Model", "This servo cannot say which model it is. What is written on its case?"):
            model = ui.select(models, label="Model").props("outlined dense options-dense").classes("sb-wide")
            model.props["data-do"] = "model"
            model.set_enabled(bench.may_change)
            model.on_value_change(lambda event: self._tell_model(event.value))

    async def _tell_model(self, model: str) -> None:
        bench = self.bench

        async def attach() -> dict[str, Any]:
            return bench.bus.attach(bench.context.actor, model, bench.id, bench.baud)

        entry = await self._attempt(attach)
        if entry is not None:
            self._moved(entry["key"])

    # Id and speed

    def _identity(self) -> None:
        bench = self.bench
        with _card("Id and speed", "Both are in the EEPROM. Only one servo of a bus may have an id."):
            with ui.element("div").classes("sb-form"):
                id = ui.number("Id", value=bench.id, min=0, max=253, precision=0).props("outlined dense")
                id.props["data-do"] = "id"
                bauds = {baud: f"{baud:,}".replace(",", " ") + " baud" for baud in sorted(bench.model.bauds)}
                bauds.setdefault(bench.baud, f"{bench.baud} baud")
                baud = ui.select(bauds, label="Speed", value=bench.baud).props("outlined dense options-dense")
                baud.set_enabled(len(bauds) > 1 and bench.may_change)
                id.set_enabled(bench.may_change)
            _action("Change id or speed", lambda: self._change_identity(id.value, baud.value), bench, what="identity")

    async def _change_identity(self, id: float | None, baud: int) -> None:
        bench = self.bench
        if id is None:
            return
        new_id, new_baud = int(id) if int(id) != bench.id else None, baud if baud != bench.baud else None
        if new_id is None and new_baud is None:
            ui.notify("The servo has this id and this speed already", position="top")
            return
        taken = [servo["key"] for servo in bench.bus.servo_entries() if servo["id"] == new_id]
        steps = [
            f"The id becomes {new_id}." if new_id is not None else "",
            f"The speed becomes {new_baud} baud; other programs have to use it too." if new_baud is not None else "",
            f"Careful: {', '.join(taken)} has this id at another speed." if taken else "",
        ]
        worn = counted(sum(one is not None for one in (new_id, new_baud)), "write")
        if not await self._sure("Change who this servo is?", " ".join([*steps, f"{worn} to the EEPROM."]), "Change"):
            return
        entry = await self._attempt(
            lambda: bench.bus.change_identity(bench.context.actor, bench.key, new_id, new_baud), "Id and speed are set"
        )
        if entry is not None:
            self._moved(entry["key"])

    # Zero

    def _zero(self) -> None:
        bench = self.bench
        row = zero.shift_row(bench.model)
        with _card("Zero", "What the servo reads where the shaft stands now."):
            if row is None or row.name in bench.lacking:
                ui.label(
                    f"The {bench.model.title} keeps no zero of its own. The zero of a joint stands in the robot file; "
                    "`servobus robot calibrate` finds it."
                ).classes("sb-muted")
                return
            with ui.element("div").classes("sb-form"):
                with ui.element("div"):
                    ui.label("Reads now").classes("sb-muted sb-small")
                    self._present = ui.label("…").classes("sb-big sb-value")
                wanted = ui.number("Shall read, °", value=0, format="%.1f").props("outlined dense")
                wanted.props["data-do"] = "zero-angle"
                wanted.set_enabled(bench.may_change)
            ui.label("The shaft does not turn: the torque has to be off.").classes("sb-muted sb-small")
            _action("Set the zero", lambda: self._set_zero(wanted.value), bench, what="zero")

    async def _set_zero(self, wanted: float | None) -> None:
        bench = self.bench
        if wanted is None:
            return
        shift = await self._attempt(lambda: self._shift(wanted * deg))
        if shift is None:
            return
        row, old = shift.row, bench.draft.held[shift.row.name].now or 0
        text = f"{row.name.replace('_', ' ')}: {row.said(old)} becomes {row.said(shift.raw)}. 1 write to the EEPROM."
        if not await self._sure("Set the zero?", text, "Set"):
            return
        values = {row.name: {"raw": shift.raw}}
        done = await self._attempt(
            lambda: bench.bus.write(bench.context.actor, bench.key, values, save=True), "The zero is set"
        )
        if done is not None:
            await bench.read()

    async def _shift(self, wanted: float) -> zero.Shift:
        bench, model = self.bench, self.bench.model
        row = zero.shift_row(model)
        if row is None:
            raise UsageError(f"{model.title} keeps no zero of its own")
        names = [model.register("present_position").name, row.name, model.register("torque_enable").name]
        told = await bench.bus.read(bench.key, names)
        present, shift, torque = (told[name]["raw"] for name in names)
        if model.family.torque_on(torque):
            raise UsageError(
                f"the torque of {bench.key} is on, and a new zero would turn the shaft: switch it off first"
            )
        return zero.shifted(model, present, shift, wanted)

    # Backup

    def _backup(self) -> None:
        bench = self.bench
        card = _card("Backup", "All settings that survive power-off, in a file that people can read.")
        with card, ui.row().classes("sb-buttons"):
            _button("Download", "download", self._download).props["data-do"] = "backup"
            if bench.may_change:
                upload = ui.upload(
                    auto_upload=True,
                    max_file_size=MOST_FILE,
                    on_upload=self._uploaded,
                    on_rejected=lambda: ui.notify("This is too large for a backup", type="warning", position="top"),
                ).props("accept=.toml,.txt,text/plain")
                upload.classes("sb-hidden").props["data-do"] = "restore"
                _button("Restore from a file", "upload_file", lambda: upload.run_method("pickFiles"))

    async def _download(self) -> None:
        saved = await self.bench.context.attempt(self.bench.bus.backup(self.bench.key))
        if saved is not None:
            name = re.sub(r"[^a-z0-9]+", "-", f"{saved['model'] or saved['family']}-{saved['id']}".lower())
            ui.download.content(saved["text"], f"{name}.toml", "application/toml")

    async def _uploaded(self, event: UploadEventArguments) -> None:
        try:
            text = (await event.file.read()).decode("utf-8")
        except UnicodeDecodeError:
            ui.notify(f"{event.file.name} is no text, so it is no backup", type="warning", position="top")
            return
        event.sender.run_method("reset")
        await self._restore(self.bench.key, text, f"Restore {event.file.name}?")

    async def _restore(self, key: str, text: str, question: str) -> bool:
        """Write the settings of a backup to a servo, after a look at what that changes."""
        bus, context = self.bench.bus, self.bench.context
        found = await self._attempt(lambda: bus.preview_restore(key, text))
        if found is None:
            return False
        if not found["changes"] and not found["impossible"]:
            ui.notify(f"{key} has all these settings already", type="info", position="top")
            return False
        off = await _ask_restore(question, found)
        if off is None:
            return False
        done = await self._attempt(lambda: bus.restore(context.actor, key, text, torque_off=off))
        if done is not None:
            ui.notify(f"{counted(len(done), 'setting')} written and read back", type="positive", position="top")
        await self.bench.read()
        return done is not None

    # Other servos

    def _others(self, *, same_family: bool) -> dict[str, str]:
        named, bus = titles(self.bench.context.service), self.bench.bus
        return {
            servo["key"]: named[bus.name, servo["key"]]
            for servo in bus.servo_entries()
            if servo["key"] != self.bench.key and (not same_family or servo["family"] == self.bench.model.family.name)
        }

    def _copy(self) -> None:
        bench = self.bench
        with _card("Copy to another servo", "All settings but id and speed, to a servo of the same model."):
            others = self._others(same_family=True)
            if not others:
                ui.label("No other servo of this family is known on this bus.").classes("sb-muted")
                return
            target = ui.select(others, label="To").props("outlined dense options-dense").classes("sb-wide")
            target.props["data-do"] = "copy-to"
            _action("Copy", lambda: self._copy_to(target.value), bench, what="copy")

    async def _copy_to(self, key: str | None) -> None:
        if key is None:
            ui.notify("Choose a servo first", position="top")
            return
        saved = await self._attempt(lambda: self.bench.bus.backup(self.bench.key))
        if saved is not None:
            await self._restore(key, saved["text"], f"Copy the settings to {key}?")

    def _compare(self) -> None:
        with _card("Compare", "What is different on another servo."):
            others = self._others(same_family=False)
            if not others:
                ui.label("No other servo is known on this bus.").classes("sb-muted")
                return
            other = ui.select(others, label="With").props("outlined dense options-dense").classes("sb-wide")
            other.props["data-do"] = "compare"
            result = ui.element("div").classes("sb-wide")

            async def show() -> None:
                if other.value is not None:
                    await self._show_differences(other.value, result)

            other.on_value_change(show)

    async def _show_differences(self, key: str, result: ui.element) -> None:
        bus = self.bench.bus
        mine = await self.bench.context.attempt(bus.backup(self.bench.key))
        theirs = await self.bench.context.attempt(bus.backup(key)) if mine is not None else None
        result.clear()
        if mine is None or theirs is None:
            return
        changes = {
            name: {"text": f"{_text(mine, name)} -> {_text(theirs, name)}"}
            for name in dict.fromkeys((*mine["settings"], *theirs["settings"]))
            if _text(mine, name) != _text(theirs, name)
        }
        with result:
            if not changes:
                ui.label("Both have the same settings.").classes("sb-ok")
            else:
                ui.label(f"{counted(len(changes), 'difference')}: this servo, then {key}").classes("sb-muted sb-small")
                diff(changes)

    # Restart and factory settings

    def _restart(self) -> None:
        bench, family = self.bench, self.bench.model.family
        with _card("Restart and factory settings", "A restart switches the torque off; what is in RAM is lost."):
            keep = [name for name in KEPT if name in family.keepable]
            boxes = {}
            if keep:
                ui.label("A reset leaves alone:").classes("sb-muted sb-small")
                with ui.row().classes("sb-buttons"):
                    boxes = {name: ui.checkbox(KEPT[name], value=name == "id") for name in keep}
            with ui.row().classes("sb-buttons"):
                _action("Restart", self._reboot, bench, what="reboot", flat=True)
                kept = _action(
                    "Factory settings",
                    lambda: self._reset([name for name, box in boxes.items() if box.value]),
                    bench,
                    what="reset",
                    flat=True,
                )
                kept.props("color=negative")

    async def _reboot(self) -> None:
        bench = self.bench
        if await self._sure("Restart the servo?", "Its torque goes off: what it holds may fall.", "Restart"):
            await self._attempt(lambda: bench.bus.reboot(bench.context.actor, bench.key), "The servo has restarted")
            await bench.read()

    async def _reset(self, keep: list[str]) -> None:
        bench = self.bench
        kept = f" Kept: {', '.join(KEPT[name].lower() for name in keep)}." if keep else ""
        text = f"All settings become those of the factory, and the torque goes off.{kept} A backup brings them back."
        if not await self._sure("Restore factory settings?", text, "Reset", danger=True):
            return
        entry = await self._attempt(
            lambda: bench.bus.reset(bench.context.actor, bench.key, keep), "The servo has its factory settings"
        )
        if entry is not None:
            self._moved(entry["key"])

    # Helpers

    async def _sure(self, question: str, text: str, does: str, *, danger: bool = False) -> bool:
        with self.bench.context.content:
            return await confirm(question, text, does=does, names=[self.bench.key], danger=danger)

    async def _attempt(self, work: Callable[[], Awaitable[Any]], done: str = "") -> Any:
        """Do what may be done by this login alone, and say what has come of it."""

        async def allowed() -> Any:
            self.bench.require(fresh=True)
            return await work()

        return await self.bench.context.attempt(allowed(), done)


async def _ask_restore(question: str, found: Mapping[str, Any]) -> bool | None:
    """Show what restoring changes; gives whether the torque is to go off first, or None for nothing."""
    with ui.dialog() as dialog, ui.card().classes("sb-dialog sb-review"):
        ui.label(question).classes("sb-title").props("role=heading aria-level=2")
        diff(found["changes"])
        for name, why in found["impossible"].items():
            ui.label(f"{name}: {why}").classes("sb-warn sb-small")
        ui.label(f"{counted(found['eeprom_writes'], 'write')} to the EEPROM").classes("sb-muted")
        if found["torque"]:
            with ui.row().classes("sb-banner sb-banner-warn"):
                ui.icon("warning")
                ui.label("The torque is on; it goes off first, and what the servo holds may fall.").classes("col")
        with ui.row().classes("sb-actions"):
            ui.button("Cancel", on_click=lambda: dialog.submit(None)).props("flat no-caps color=grey")
            does = "Torque off, then write" if found["torque"] else "Write"
            ui.button(does, on_click=lambda: dialog.submit(found["torque"])).props(
                "unelevated no-caps color=primary autofocus"
            )
    try:
        chosen = await dialog
    finally:
        close(dialog)
    return None if chosen is None else bool(chosen)


def _text(saved: Mapping[str, Any], name: str) -> str:
    value = saved["settings"].get(name)
    return "-" if value is None else str(value["text"])


def _card(name: str, about: str) -> ui.element:
    card = ui.element("div").classes("sb-card sb-care")
    with card:
        head(name, about)
    return card


def _button(name: str, icon: str, does: Callable[[], Any]) -> ui.button:
    return ui.button(name, icon=icon, on_click=does, color=None).props("outline no-caps").classes("sb-outline")


def _action(name: str, does: Callable[[], Any], bench: Workbench, *, what: str, flat: bool = False) -> ui.button:
    """Build the button of a card; only who may change something can press it."""
    button = ui.button(name, on_click=does).props("flat no-caps" if flat else "outline no-caps")
    button.props["data-do"] = what
    button.set_enabled(bench.may_change)
    return button
