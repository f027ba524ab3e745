"""One robot as people and programs use it through the server: joints by name, poses, and settings by its file."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from servobus.bus.asyncio import AsyncBusServo
from servobus.bus.servo import Servo
from servobus.core.units import deg
from servobus.errors import RobotFileError, UsageError
from servobus.robots.asyncio import AsyncRobot
from servobus.robots.file.kinds import NAME
from servobus.robots.file.reading import read_file
from servobus.robots.file.writing import edited, quantity, save
from servobus.robots.motions.play import AsyncPlay
from servobus.robots.settings.planning import Plan
from servobus.server.web.audit import Audit
from servobus.server.web.feeds import Events
from servobus.server.web.jobs import Jobs, ServerJob
from servobus.server.web.served_bus import Actor, ServedBus
from servobus.server.web.values import key_of

RATE = 50.0
"""Goals a second of a motion: half of what a program sends, for this process serves pages meanwhile."""


class ServedRobot:
    """A robot on buses of the server.

    ports  the buses that it uses
    """

    def __init__(
        self,
        name: str,
        file: str,
        buses: Mapping[str, ServedBus],
        ports: Mapping[str, str] | None,
        *,
        events: Events,
        audit: Audit,
    ) -> None:
        self.name, self._events, self._audit = name, events, audit
        contents = read_file(file)
        if not contents.joints:
            raise RobotFileError(f"{contents.name}: there is no joint")
        used = {servo.port for joint in contents.joints.values() for servo in joint.servos}
        names = {port: (ports or {}).get(port, port) for port in used}
        if missing := [f"{port} (bus {bus})" for port, bus in names.items() if bus not in buses]:
            raise UsageError(f"{contents.name}: no bus is open for port {', '.join(missing)}")
        self.ports = frozenset(names.values())
        self._served = {port: buses[bus] for port, bus in names.items()}
        self.robot = AsyncRobot(contents, {port: one.bus for port, one in self._served.items()}, incomplete=True)

    def entry(self) -> dict[str, Any]:
        """Give the robot for JSON."""
        robot = self.robot
        return {
            "name": self.name,
            "file": robot.file.name,
            "buses": sorted(self.ports),
            "joints": {
                joint.name: {
                    "servos": [
                        {"bus": self._served[part.port].name, "key": key_of(_driver(part.servo))}
                        for part in joint.parts
                    ],
                    "limits": None if joint.entry.limits is None else list(joint.entry.limits),
                }
                for joint in robot
            },
            "groups": {name: list(group.joints) for name, group in robot.groups.items()},
            "poses": {name: dict(angles) for name, angles in robot.poses.items()},
            "motions": list(robot.file.motions),
        }

    async def positions(self) -> dict[str, Any]:
        """Read the angle of each joint, rad: of those that answer, and why others do not."""
        found = await self.robot.positions()
        return {
            "positions": {joint: float(angle) for joint, angle in found.items()},
            "lost": {str(joint): str(why) for joint, why in found.lost.items()},
        }

    async def plan(self) -> dict[str, Any]:
        """Say what `apply` would write, and how many values of it would go to the EEPROM."""
        return _plan_entry(await self.robot.plan_settings())

    async def apply(self, actor: Actor, *, torque_off: bool, offsets: bool) -> dict[str, Any]:
        """Write what differs from the file; see `BaseRobot.apply_settings`."""
        applied = await self.robot.apply_settings(torque_off=torque_off, offsets=offsets)
        written = {who: list(names) for who, names in applied.written.items()}
        self._note(actor, "apply", written)
        return {"written": written}

    async def undo(self, actor: Actor, *, torque_off: bool) -> dict[str, Any]:
        """Bring back what the servos held before the last `apply`."""
        restored = await self.robot.undo_settings(torque_off=torque_off)
        self._note(actor, "undo", restored)
        return {"restored": restored}

    async def check(self) -> dict[str, Any]:
        """Compare who answers with the file."""
        found = await self.robot.check()
        return {
            "complete": bool(found),
            "findings": [
                {"kind": one.kind, "joint": one.joint or None, "port": one.port, "text": one.text}
                for one in found.findings
            ],
        }

    async def torque(self, actor: Actor, *, on: bool) -> None:
        """Switch the torque of all joints on, each where it stands, or off."""
        if on:
            self._begin(actor)
        await (self.robot.torque_on() if on else self.robot.torque_off())
        self._note(actor, "torque", {"on": on})

    async def move(
        self, actor: Actor, goals: Mapping[str, float], *, time: float | None, speed: float | None
    ) -> dict[str, Any]:
        """Start a move of joints, name -> angle in rad; gives how long it takes."""
        self._begin(actor)
        planned = await self.robot.start_move(dict(goals), time=time, speed=speed)
        self._note(actor, "move", dict(goals))
        return {"duration": planned.duration}

    async def go(
        self, actor: Actor, pose: str, *, time: float | None = None, speed: float | None = None
    ) -> dict[str, Any]:
        """Start a move to a pose of the file; torque that is off is switched on first, from where each joint is.

        Raises UnknownName.
        """
        goals = self.robot.pose(pose)
        self._begin(actor)
        # Planned before any torque comes on: a pose that cannot be reached changes nothing.
        await self.robot.plan_move(dict(goals), time=time, speed=speed)
        for joint in self.robot.named(*goals):
            await joint.torque_on()
        return await self.move(actor, goals, time=time, speed=speed)

    async def save_pose(self, actor: Actor, name: str, joints: Sequence[str] = ()) -> dict[str, float]:
        """Keep where the joints are, all or these, as a pose in the robot file. Moves nothing.

        A pose of that name is changed; what was in the file is kept beside it. Raises UsageError for a name that cannot
        be, or where a joint does not answer: then nothing was saved.
        """
        if not re.fullmatch(NAME, name):
            raise UsageError(f"{name[:40]!r} is no name of a pose: use letters, digits, - and _, and a letter first")
        wanted = self.robot.named(*joints)
        seen = await self.robot.positions()
        if lost := [joint.name for joint in wanted if joint.name in seen.lost]:
            raise UsageError(f"{', '.join(lost)}: no answer, so nothing was saved; name the joints that are to be kept")
        # Hundredths of a degree: finer than the steps of the servos.
        angles = {joint.name: round(seen[joint.name] / deg, 2) * deg for joint in wanted}
        said = {joint: quantity(angle, "rad") for joint, angle in angles.items()}
        self.robot.file = save(self.robot.file, edited(self.robot.file, {("pose", name): said}))
        self._note(actor, f"pose {name}", said)
        return angles

    def play(self, actor: Actor, jobs: Jobs, motion: str, *, pace: float = 1.0) -> "Playing":
        """Start a motion of the file; a job that ends with it. Torque must be on. Raises UnknownName, BadValue.

        A stop of any of its buses ends it, and so does whoever plays it by going away.
        """
        played = self.robot.play(motion, rate=RATE)
        played.set_pace(pace)
        self._begin(actor)

        async def run(job: ServerJob) -> dict[str, Any]:
            whole = round(played.duration, 3)
            async for tick in played:
                self._begin(actor)
                jobs.progress(
                    job,
                    int(max(tick.time, 0.0) * 1000),
                    int(whole * 1000),
                    "on the way to the first pose" if tick.time < 0 else f"{tick.time:.1f} of {whole:g} s",
                )
            return {"played": not played.stopped}

        job = jobs.start("play", min(self.ports), actor.name, run)
        self._note(actor, f"play {motion}", {"pace": pace})
        return Playing(job, played)

    def _begin(self, actor: Actor) -> None:
        for port, served in self._served.items():
            served.begin(
                actor, [_driver(part.servo) for joint in self.robot for part in joint.parts if part.port == port]
            )

    def _note(self, actor: Actor, what: str, values: Mapping[str, Any]) -> None:
        self._audit.note(actor.name, what, ", ".join(sorted(self.ports)), f"robot {self.name}", values)
        self._events.tell("changed", bus=None, by=actor.name, robot=self.name, change=what)


@dataclass(frozen=True, slots=True)
class Playing:
    """A motion under way: the job, and what slows, pauses and ends it on its path."""

    job: ServerJob
    motion: AsyncPlay


def _driver(servo: Servo) -> AsyncBusServo:
    """Give the servo of a part, which is one of the asynchronous driver here."""
    assert isinstance(servo, AsyncBusServo)
    return servo


def _plan_entry(plan: Plan) -> dict[str, Any]:
    return {**plan.entry(), "problems": list(plan.problems), "text": plan.text()}
