"""What the pages that move servos ask of the server: what bounds a servo, poses kept and gone to, motions played."""

import asyncio
from pathlib import Path

import pytest

from servobus.core.units import deg
from servobus.errors import Stopped, UnknownName, UsageError
from servobus.robots.file.reading import read_file
from servobus.server.web.page.parts.names import joints
from servobus.server.web.served_bus import Actor
from unit.server.web.rig import KEYS, ROBOT, rig

RX28, _, DRS0602, LX16A = KEYS
ME = Actor("test")
MOTION = """
[motion.nod]
steps = [{ time = "0s", pose = "home" }, { time = "0.5s", joints = { shoulder = "-10deg" } }]
"""


def robot_file(folder: Path) -> Path:
    file = folder / "arm.toml"
    file.write_text(ROBOT + MOTION, encoding="utf-8")
    return file


def test_what_bounds_a_servo_is_told() -> None:
    async def check() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            rx28 = await bus.motion(RX28)
            assert rx28["range"] == [0.0, pytest.approx(300 * deg, abs=0.01)]  # RX-28 manual: 0 to 300°
            assert rx28["limits"] == rx28["range"]
            assert not rx28["torque"]
            assert rx28["turn"] == {"unit": "1", "stores": True}
            drs = await bus.motion(DRS0602)
            assert drs["turn"] == {"unit": "rad/s", "stores": False}
            await bus.torque(ME, [RX28], on=True)
            assert (await bus.motion(RX28))["torque"]

    asyncio.run(check())


def test_limits_in_the_servo_bound_it_and_0_of_both_makes_it_turn() -> None:
    async def check() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            await bus.write(ME, RX28, {"min_position": "100deg", "max_position": "200deg"}, save=True)
            told = await bus.motion(RX28)
            assert [end / deg for end in told["limits"]] == pytest.approx([100, 200], abs=0.3)
            await bus.write(ME, RX28, {"min_position": 0.0, "max_position": 0.0}, save=True)
            told = await bus.motion(RX28)
            assert told["turning"]
            assert told["limits"] is None

    asyncio.run(check())


@pytest.mark.parametrize(("key", "on"), [(RX28, True), (DRS0602, "on"), (LX16A, True)])
def test_torque_is_told_from_telemetry(key: str, on: object) -> None:
    async def check() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            value = (await bus.read(key, ["torque_enable"]))["torque_enable"]["value"]
            assert not bus.has_torque(key, value)
            await bus.torque(ME, [key], on=True)
            value = (await bus.read(key, ["torque_enable"]))["torque_enable"]["value"]
            assert bus.has_torque(key, value)

    asyncio.run(check())


def test_servos_are_called_by_their_joints(tmp_path: Path) -> None:
    async def check() -> None:
        async with rig(robots={"arm": str(robot_file(tmp_path))}) as made:
            named = joints(robot.entry() for robot in made.service.robots.values())
            assert named[("bench", RX28)] == "shoulder"

    asyncio.run(check())


def test_a_pose_is_kept_in_the_file_and_gone_to(tmp_path: Path) -> None:
    file = robot_file(tmp_path)

    async def check() -> None:
        async with rig(robots={"arm": str(file)}) as made:
            robot = made.service.robot("arm")
            going = await robot.go(ME, "home", speed=30 * deg)
            robot.robot.ports.align(robot.robot.ports.now() + going["duration"] + 0.5)
            found = (await robot.positions())["positions"]
            assert found["elbow"] == pytest.approx(20 * deg, abs=1 * deg)
            kept = await robot.save_pose(ME, "here")
            assert read_file(file).poses["here"] == pytest.approx(kept, abs=1e-4)
            assert "here" in robot.entry()["poses"]
            await robot.save_pose(ME, "again")  # the file is the one that was written by the save before
            with pytest.raises(UsageError, match="no name of a pose"):
                await robot.save_pose(ME, "so not\n[x]")
            with pytest.raises(UnknownName):
                await robot.go(ME, "nowhere")

    asyncio.run(check())


def test_a_motion_is_played_as_a_job_and_a_stop_ends_it(tmp_path: Path) -> None:
    async def check() -> None:
        async with rig(robots={"arm": str(robot_file(tmp_path))}) as made:
            service = made.service
            robot = service.robot("arm")
            await robot.torque(ME, on=True)
            playing = robot.play(ME, service.jobs, "nod")
            assert playing.job.task is not None
            await playing.job.task
            assert playing.job.entry()["state"] in ("running", "done")
            assert playing.job.error is None
            assert (await robot.positions())["positions"]["shoulder"] == pytest.approx(-10 * deg, abs=2 * deg)
            again = robot.play(ME, service.jobs, "nod")
            service.bus("bench").stopped_by = "somebody"  # as a stop of another client does
            assert again.job.task is not None
            await again.job.task
            assert again.job.error is not None
            assert again.job.error["type"] == "Stopped"
            with pytest.raises(Stopped):
                robot.play(ME, service.jobs, "nod")

    asyncio.run(check())
