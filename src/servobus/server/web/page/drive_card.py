"""A card with which one servo is driven: by its dial, by numbers, by buttons that are held, and as a wheel."""

import asyncio
import math
from typing import Any

from nicegui import ui

from servobus.core.units import deg, show
from servobus.errors import ServobusError
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts import toast
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.page.parts.controls import Aim, Hold
from servobus.server.web.page.parts.jogging import BEAT, GONE, Freshness, Jog, wheel
from servobus.server.web.served_bus import ServedBus

SEEN = ("present_position", "present_speed", "present_load", "torque_enable", "moving")
"""What is read of a servo that is driven, as far as its model has it."""
AHEAD = 2.5 * BEAT
"""s for the way to a goal that is replaced soon."""
FASTEST = 360 * deg
"""rad/s of a wheel whose data sheet gives no speed; *assumption*: what small servos reach."""
SLIGHT = 0.05 * deg
"""rad that are not seen on a dial."""


class Settings:
    """How all cards of the page move: `time` in s or `speed` in rad/s; `jog` in rad/s; whether a dial is followed."""

    def __init__(self) -> None:
        self.speed: float | None = 90 * deg
        self.time: float | None = None
        self.jog = 45 * deg
        self.follow = False


class DriveCard:
    """One servo.

    goal  where it is to go next, rad; None as long as none was set
    """

    def __init__(self, context: PageContext, bus: ServedBus, key: str, title: str, settings: Settings) -> None:
        self.context, self.bus, self.key, self.title, self.settings = context, bus, key, title, settings
        self.goal: float | None = None
        self.position: float | None = None
        self._motion: dict[str, Any] = {}
        self._before_turning: tuple[float, float] | None = None
        self._shown: float | None = None
        self._torque: bool | None = None
        self._jog = Jog(settings.jog, -math.inf, math.inf)
        self._fresh = {-1: Freshness(), 1: Freshness()}
        """Of each button: they count their messages by themselves."""
        self._busy = self._refused = False
        self._next: float | None = None
        """The goal that goes out when the one before has."""
        self._turning_to = 0
        self._silence: asyncio.TimerHandle | None = None
        with ui.column().classes("sb-card sb-drive") as self.card:
            self._build()
        context.leaving(self._left)

    # Building

    def _build(self) -> None:
        with ui.row().classes("sb-row no-wrap"):
            ui.label(self.title).classes("sb-title sb-ellipsis")
            ui.space()
            self._state = ui.label("").classes("sb-chip")
            self._switch = ui.switch(on_change=self._torque_switched).props(
                f'dense aria-label="Torque of {self.title.replace(chr(34), "")}"'
            )
            self._switch.tooltip("Torque")
        self._modes = ui.toggle({"position": "Position"}, value="position", on_change=self._mode_chosen).props(
            "no-caps unelevated dense spread"
        )
        self._modes.classes("sb-modes")
        self._problem = ui.label("").classes("sb-muted sb-small")
        with ui.column().classes("sb-drive-position") as self._position_box:
            self._dial = Aim(f"Goal of {self.title}, degrees", self._aimed)
            self._slider = (
                ui.slider(min=0, max=1, step=0.1, on_change=self._slid).props("dense").classes("sb-drive-slider")
            )
            self._slider.on("change", self._slid_to)
            with ui.row().classes("sb-drive-row no-wrap"):
                self._hold("chevron_left", "Jog towards smaller angles", -1)
                self._number = ui.number(suffix="°", format="%.1f", step=1).props(
                    f'outlined dense aria-label="Goal of {self.title.replace(chr(34), "")} in degrees"'
                )
                self._number.on("keydown.enter", self._typed)
                ui.button("Go", on_click=self._typed).props("unelevated no-caps")
                self._hold("chevron_right", "Jog towards larger angles", 1)
        with ui.column().classes("sb-drive-wheel") as self._wheel_box:
            self._how_fast = ui.label("").classes("sb-big sb-value")
            self._share = ui.slider(min=0, max=100, step=1, value=20, on_change=self._share_shown).props("dense")
            with ui.row().classes("sb-drive-row no-wrap"):
                self._hold("rotate_left", "Turn towards smaller angles while held", -1)
                ui.label("turns while held").classes("sb-muted sb-small")
                self._hold("rotate_right", "Turn towards larger angles while held", 1)
        self._wheel_box.set_visibility(False)

    def _hold(self, icon: str, says: str, direction: int) -> None:
        async def held(number: int, sent: float) -> None:
            await self._held(direction, number, sent)

        with Hold(says, held, self._released).tooltip(says):
            ui.icon(icon)

    # What is known of the servo

    async def ask(self) -> None:
        """Ask the servo what bounds it and how it is set, and show that."""
        try:
            self._motion = await self.bus.motion(self.key)
        except ServobusError as error:
            sentence, remedy = toast.said(error)
            self._problem.text = f"{sentence}. {remedy}"
            self._position_box.set_visibility(False)
            self._modes.set_visibility(False)
            return
        motion = self._motion
        self._problem.text = f"Shut down by {motion['shutdown']}" if motion["shutdown"] else ""
        turning = motion["turning"]
        limits = motion["limits"] or motion["range"]
        if not turning:
            self._before_turning = None if motion["several_turns"] else (limits[0], limits[1])
        self._jog = Jog(self.settings.jog, *limits)
        self._dial.bounds(tuple(limits), tuple(motion["range"]), disabled=turning or not self.context.may_change)
        low, high = (round(end / deg, 1) for end in limits)
        self._slider.props(f"min={low} max={high}")
        self._number.min, self._number.max = low, high
        self._position_seen(motion["position"])
        if self.goal is None:
            self._slider.value = self._number.value = min(max(round(motion["position"] / deg, 1), low), high)
        self._torque_seen(motion["torque"])
        self._show_modes()

    def _show_modes(self) -> None:
        motion = self._motion
        modes = {"position": "Position"}
        if motion["can_count_turns"]:
            modes["turns"] = "Several turns"
        if motion["turn"] is not None:
            modes["wheel"] = "Wheel"
        now = "wheel" if motion["turning"] else "turns" if motion["several_turns"] else "position"
        self._modes.set_options(modes, value=now)
        self._modes.set_visibility(len(modes) > 1)
        self._position_box.set_visibility(now != "wheel")
        self._wheel_box.set_visibility(now == "wheel")
        self._share_shown()

    def seen(self, told: dict[str, Any]) -> None:
        """Take what was read of the servo."""
        values = told["values"]
        if values is None:
            self._say("no answer", "sb-chip-bad")
            return
        if isinstance(position := values.get("present_position"), int | float):
            self._position_seen(position)
        if "torque_enable" in values:
            self._torque_seen(self.bus.has_torque(self.key, values["torque_enable"]))
        if told["alarms"]:
            self._say(", ".join(told["alarms"]), "sb-chip-bad")
        elif not self._torque:
            self._say("limp", "")
        else:
            self._say("moving" if values.get("moving") else "holds", "sb-chip-ok")

    def _say(self, text: str, style: str) -> None:
        if self._state.text != text:
            self._state.text = text
            self._state.classes(replace=f"sb-chip {style}")

    def _position_seen(self, position: float) -> None:
        self.position = position
        if self._shown is None or abs(position - self._shown) > SLIGHT:
            self._shown = position
            self._dial.see(position)

    def _torque_seen(self, on: bool) -> None:
        if on != self._torque:
            self._torque = on
            if self._switch.value != on:
                self._switch.value = on

    # Goals

    def set_goal(self, goal: float) -> None:
        """Note where the servo is to go next, and show that."""
        self.goal = goal
        self._dial.set_goal(goal)
        self._show_goal(goal)

    def _show_goal(self, goal: float) -> None:
        degrees = round(goal / deg, 1)
        self._number.value = degrees
        if self._slider.value != degrees:
            self._slider.value = degrees

    async def _aimed(self, goal: float, done: bool) -> None:
        self.goal = goal
        if done:
            self._show_goal(goal)
            await self._go()
        elif self.settings.follow:
            await self._stream(goal)

    async def _slid(self) -> None:
        if self._slider.value is None or self.goal is None or self._slider.value == round(self.goal / deg, 1):
            return
        if self.settings.follow and self._torque:
            self.goal = self._slider.value * deg
            await self._stream(self.goal)

    async def _slid_to(self) -> None:
        if self._slider.value is not None:
            self.set_goal(self._slider.value * deg)
            await self._go()

    async def _typed(self) -> None:
        if self._number.value is not None:
            self.set_goal(float(self._number.value) * deg)
            await self._go()

    async def _go(self) -> None:
        """Go where the goal is, as the settings say."""
        if self.goal is None:
            return
        how = self.settings
        await self.context.attempt(
            self.bus.move(self.context.actor, {self.key: self.goal}, time=how.time, speed=how.speed)
        )

    async def _stream(self, goal: float) -> None:
        """Follow a goal that is replaced soon: the newest goes out as soon as the one before has."""
        if self._refused:
            return
        self._next = goal
        if self._busy:
            return
        self._busy = True
        try:
            while self._next is not None:
                goal, self._next = self._next, None
                way = abs(goal - (goal if self.position is None else self.position))
                time = max(AHEAD, way / (self.settings.speed or FASTEST))
                await self.bus.stream(self.context.actor, {self.key: goal}, time)
        except ServobusError as error:
            self._refuse(error)
        finally:
            self._busy = False

    def _refuse(self, error: ServobusError) -> None:
        """Say once why it does not move, until the hand lets go."""
        self._refused = True
        asyncio.get_running_loop().call_later(1.0, self._forgive)
        with self.card:
            toast.failed(error)

    def _forgive(self) -> None:
        self._refused = False

    # Buttons that are held

    async def _held(self, direction: int, number: int, sent: float) -> None:
        loop = asyncio.get_running_loop()
        if not self._fresh[direction].fresh(number, sent, loop.time()) or not self._motion:
            return
        if self._silence is not None:
            self._silence.cancel()
        self._silence = loop.call_later(GONE, lambda: asyncio.ensure_future(self._released()))
        if self._motion["turning"]:
            await self._turn(direction)
            return
        self._jog.speed = self.settings.jog
        if self.position is None or self._refused:
            return
        goal = self._jog.step(direction, loop.time(), self.position)
        if goal is not None:
            self.set_goal(goal)
            await self._stream(goal)

    async def _turn(self, direction: int) -> None:
        if direction == self._turning_to or self._refused:
            return
        self._turning_to = direction
        try:
            await self.bus.turn(self.context.actor, self.key, **self._turn_how(direction))
        except ServobusError as error:
            self._turning_to = 0
            self._refuse(error)

    async def _released(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        self._jog.end()
        self._next = None
        if self._turning_to:
            self._turning_to = 0
            await self.context.attempt(self.bus.turn(self.context.actor, self.key, **self._turn_how(0)))

    def _left(self) -> None:
        """The page is left: what turns stands still."""
        if self._silence is not None or self._turning_to:
            asyncio.ensure_future(self._released())  # noqa: RUF006 - nobody is there to wait

    def _turn_how(self, direction: int) -> dict[str, float]:
        unit = self._motion["turn"]["unit"]
        most = (self._motion["speed"] or FASTEST) if unit == "rad/s" else 1.0
        how_fast = wheel((self._share.value or 0) / 100, direction, most) if direction else 0.0
        return {"speed" if unit == "rad/s" else "output": how_fast}

    def _share_shown(self) -> None:
        if self._motion and self._motion["turn"] is not None:
            ((_, how_fast),) = self._turn_how(1).items()
            self._how_fast.text = show(how_fast, self._motion["turn"]["unit"])

    # Torque and modes

    async def _torque_switched(self) -> None:
        on = bool(self._switch.value)
        if on == self._torque:
            return
        await self.context.attempt(self.bus.torque(self.context.actor, [self.key], on=on))
        self._torque = None  # what is read next tells

    async def _mode_chosen(self) -> None:
        wanted, motion = self._modes.value, self._motion
        now = "wheel" if motion["turning"] else "turns" if motion["several_turns"] else "position"
        if wanted == now:
            return
        if await self._may_change_mode(wanted):
            actor = self.context.actor
            if wanted == "wheel":
                await self.context.attempt(self.bus.turn(actor, self.key, **self._turn_how(0)))
            else:
                limits = self._before_turning if wanted == "position" else None
                await self.context.attempt(self.bus.position_mode(actor, self.key, limits, wanted == "turns"))
        await self.ask()

    async def _may_change_mode(self, wanted: str) -> bool:
        turn = self._motion["turn"]
        if turn is None or not turn["stores"]:
            return True
        then = "0, which makes it turn without end" if wanted == "wheel" else "those of this mode"
        return await confirm(
            "Change the mode?",
            f"The mode of this servo follows from its angle limits. They become {then}: two writes to its EEPROM.",
            does="Change",
            names=[self.title],
        )
