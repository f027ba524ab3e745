"""A card with the poses and motions of one robot."""

from typing import Any

from nicegui import ui

from servobus.core.units import deg, show
from servobus.server.web.page.context import PageContext
from servobus.server.web.page.parts.confirm import confirm
from servobus.server.web.served_robot import Playing, ServedRobot

SLOW = 30 * deg
"""rad/s at which a robot goes to a pose: one can follow it by eye, and stop it."""
PACES = {0.25: "quarter pace", 0.5: "half pace", 1.0: "full pace"}


class RobotCard:
    """Poses: gone to, and kept. Motions: played, paused, ended on their path."""

    def __init__(self, context: PageContext, robot: ServedRobot) -> None:
        self._context, self._robot = context, robot
        self._playing: Playing | None = None
        with ui.column().classes("sb-card"):
            with ui.row().classes("sb-row"):
                ui.label(robot.name).classes("sb-title")
                ui.label(f"{len(robot.entry()['joints'])} joints").classes("sb-muted sb-small")
                ui.space()
                if context.may_change:
                    with ui.row().classes("sb-actions-inline"):
                        self._name = ui.input(placeholder="name of a pose").props(
                            'outlined dense aria-label="Name of a pose"'
                        )
                        ui.button("Save pose", icon="add", on_click=self._save).props("outline no-caps").tooltip(
                            "Keep where the joints are now, in the robot file"
                        )
            self._lists = ui.column().classes("sb-robot")
        self._show()
        ui.timer(0.2, self._progress)
        context.leaving(self._left)

    def _show(self) -> None:
        entry = self._robot.entry()
        self._lists.clear()
        with self._lists:
            with ui.row().classes("sb-row sb-poses"):
                ui.label("Poses").classes("sb-muted sb-lead")
                if not entry["poses"]:
                    ui.label("none yet: bring the joints somewhere and save it").classes("sb-muted sb-small")
                for name, angles in entry["poses"].items():
                    said = ", ".join(f"{joint} {show(angle, 'rad')}" for joint, angle in angles.items())
                    ui.button(name, icon="near_me", on_click=lambda name=name: self._go(name)).props(
                        "outline no-caps dense padding='4px 12px'"
                    ).tooltip(said)
            if entry["motions"]:
                with ui.row().classes("sb-row sb-poses"):
                    ui.label("Motions").classes("sb-muted sb-lead")
                    for name in entry["motions"]:
                        ui.button(name, icon="play_arrow", on_click=lambda name=name: self._play(name)).props(
                            "outline no-caps dense padding='4px 12px'"
                        )
                    self._pace = ui.select(PACES, value=1.0, on_change=self._set_pace).props(
                        'dense outlined options-dense aria-label="Pace"'
                    )
                with ui.row().classes("sb-row no-wrap") as self._under_way:
                    self._what = ui.label("").classes("sb-small sb-value sb-playing")
                    self._bar = ui.linear_progress(value=0, show_value=False, size="6px").classes("col")
                    self._pause = ui.button(icon="pause", color=None, on_click=self._toggle).props(
                        'flat round dense aria-label="Pause the motion"'
                    )
                    ui.button(icon="stop", color=None, on_click=self._end).props(
                        'flat round dense aria-label="End the motion on its path"'
                    )
                self._under_way.set_visibility(False)

    async def _go(self, name: str) -> None:
        context = self._context
        await context.attempt(self._robot.go(context.actor, name, speed=SLOW), f"On the way to {name}")

    async def _save(self) -> None:
        name, context = str(self._name.value or "").strip(), self._context
        if name in self._robot.entry()["poses"] and not await confirm(
            f"Replace {name}?",
            "There is a pose of that name. The file as it is now is kept beside it.",
            does="Replace",
        ):
            return
        if await context.attempt(self._robot.save_pose(context.actor, name), f"{name} is kept"):
            self._name.value = ""
            self._show()

    def _play(self, name: str) -> None:
        context = self._context
        self._left()
        self._playing = context.attempt_now(
            lambda: self._robot.play(context.actor, context.service.jobs, name, pace=self._pace.value)
        )

    def _set_pace(self) -> None:
        if self._playing is not None:
            self._playing.motion.set_pace(self._pace.value)

    def _toggle(self) -> None:
        if self._playing is None:
            return
        paused = self._pause.props.get("icon") == "pause"
        (self._playing.motion.pause if paused else self._playing.motion.resume)()
        self._pause.props(f"icon={'play_arrow' if paused else 'pause'}")

    def _end(self) -> None:
        if self._playing is not None:
            self._playing.motion.stop()

    def _left(self) -> None:
        """The page is left: the motion comes to rest."""
        self._end()

    def _progress(self) -> None:
        playing = self._playing
        if playing is None:
            return
        entry: dict[str, Any] = playing.job.entry()
        running = entry["state"] == "running"
        self._under_way.set_visibility(running)
        self._what.text = entry["text"] or "begins"
        self._bar.value = entry["done"] / entry["total"] if entry["total"] else 0.0
        if not running:
            self._playing = None
            self._pause.props("icon=pause")
            if entry["error"] is not None:
                ui.notify(entry["error"]["message"], type="negative", position="top", timeout=9000, close_button="OK")
