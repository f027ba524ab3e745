import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from samples import goal_range, one_model_of_each_family
from servobus import MODELS, NotRestored, RobotFileError, UsageError
from servobus.bus.asyncio import AsyncBus
from servobus.robots.asyncio import AsyncRobot
from servobus.robots.axis import Axis
from servobus.robots.file.reading import read_text
from servobus.robots.settings.backups import Backups
from servobus.robots.settings.planning import limits_wanted
from servobus.virtual.serve.inprocess import VirtualPort
from unit.robots.settings.workshop import Killed, Workshop

JOINTS = """\
[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
limits = ["-90deg", "45deg"]
limits_in_servo = true
[joint.shoulder.registers]
max_torque = "50%"
cw_compliance_slope = 64

[joint.lift]
port = "left"
model = "rx28"
id = 2
zero = "150deg"
limits = ["-60deg", "60deg"]
limits_in_servo = true
[joint.lift.mirror]
id = 3
zero = "100deg"

[joint.grip]
port = "right"
model = "drs0602"
id = 219
[joint.grip.registers]
dead_zone = 3
calibration_difference = 12
"""
WANTED = {
    # By the manuals: an RX-28 has 1023 steps over 300°, a max_torque of 1023 is 100 %. The joint's -90° .. 45° is
    # 240° .. 105° of a servo that is turned round at 150°: raw 818.4 and 358.05, rounded inwards.
    ("left", 1, "max_torque"): 512,
    ("left", 1, "cw_angle_limit"): 359,
    ("left", 1, "ccw_angle_limit"): 818,
    # 90° .. 210°, and 40° .. 160° of the second servo: raw 306.9 and 716.1, 136.4 and 545.6.
    ("left", 2, "cw_angle_limit"): 307,
    ("left", 2, "ccw_angle_limit"): 716,
    ("left", 3, "cw_angle_limit"): 137,
    ("left", 3, "ccw_angle_limit"): 545,
    ("right", 219, "dead_zone"): 3,
}
RAM = ("left", 1, "cw_compliance_slope"), 64
OFFSET = ("right", 219, "calibration_difference"), 12


@pytest.fixture
def shop(tmp_path: Path) -> Workshop:
    return Workshop(tmp_path, JOINTS, {"left": "rx28@1-3", "right": "drs0602@219"})


def held(shop: Workshop) -> dict[tuple[str, int, str], int]:
    return {key: shop.get(*key) for key in WANTED}


@one_model_of_each_family
@given(
    low=st.floats(0.01, 0.95), span=st.floats(0.03, 1.0), direction=st.sampled_from([1, -1]), ratio=st.floats(0.3, 4)
)
def test_limits_are_ordered_after_the_sign_and_rounded_inwards(
    key: str, low: float, span: float, direction: int, ratio: float
) -> None:
    model = MODELS[key]
    row = model.register("goal_position")
    least, most = (row.decode(raw) for raw in goal_range(model))
    axis = Axis((least + most) / 2, direction, ratio)
    bottom = least + low * (most - least) * 0.96
    top = min(bottom + span * (most - bottom), most)
    limits = axis.range_to_joint(bottom, top)
    raws = limits_wanted(model, axis, limits)
    lower, upper = raws[model.register("min_position")], raws[model.register("max_position")]
    step = row.decode(1) - row.decode(0)
    assert bottom - 1e-9 <= row.decode(lower) < bottom + step + 1e-9
    assert top - step - 1e-9 < row.decode(upper) <= top + 1e-9
    joint = axis.range_to_joint(row.decode(lower), row.decode(upper))
    assert limits[0] - 1e-9 <= joint[0]
    assert joint[1] <= limits[1] + 1e-9


def test_a_plan_shows_what_differs_and_writes_nothing(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        plan = arm.plan_settings()
    assert shop.memories() == before
    assert plan.changes() == 9
    assert plan.eeprom_writes() == 8
    assert plan.changes(offsets=True) == 10
    text = str(plan)
    assert "cw_compliance_slope: 32 -> 64   [RAM]" in text
    assert "ccw_angle_limit: 300.0° -> 239.9°   [EEPROM, for -90.0° .. 45.0° of the joint]" in text
    assert "calibration_difference: 0 -> 12   [EEPROM, shifts the angles of the joint: written with --offsets" in text
    assert "arm.toml: 9 values to write, 8 of them to the EEPROM" in text
    data = json.loads(json.dumps(plan.entry()))
    assert data["servos"][0]["changes"]["max_torque"] == {"old": 100, "new": 50.0489, "unit": "%", "eeprom": True}
    assert data["servos"][3]["offset"]["calibration_difference"]["old"] == 0


def test_an_offset_that_the_file_does_not_name_is_shown(shop: Workshop) -> None:
    shop.path.write_text(shop.path.read_text().replace("calibration_difference = 12\n", ""))
    servo = shop.servo("right", 219)
    servo.memory.store(servo.model.register("calibration_difference"), -7)
    with shop.open() as arm:
        plan = arm.plan_settings()
        assert "calibration_difference: -7   [the servo's own offset" in str(plan)
        arm.apply_settings(plan, offsets=True)
    assert shop.get(*OFFSET[0]) == -7


def test_apply_writes_what_differs_and_undo_brings_it_back(shop: Workshop) -> None:
    before, slope = shop.memories(), shop.get(*RAM[0])
    with shop.open() as arm:
        done = arm.apply_settings()
        assert held(shop) == WANTED
        assert shop.get(*RAM[0]) == RAM[1]
        assert shop.get(*OFFSET[0]) == 0
        assert set(done.written) == {
            "shoulder (RX-28 id 1 on left)",
            "lift (RX-28 id 2 on left)",
            "lift (RX-28 id 3 on left)",
            "grip (DRS-0602 id 219 on right)",
        }
        assert arm.plan_settings().changes() == 0
        stored = [servo.memory.bytes_stored for rig in shop.rigs.values() for servo in rig.servos]
        assert arm.apply_settings().written == {}
        assert stored == [servo.memory.bytes_stored for rig in shop.rigs.values() for servo in rig.servos]

        arm.apply_settings(offsets=True)
        assert shop.get(*OFFSET[0]) == OFFSET[1]
        assert arm.undo_settings() == {"grip (DRS-0602 id 219 on right)": ["calibration_difference"]}
        assert shop.get(*OFFSET[0]) == 0
        arm.undo_settings()
        assert (shop.memories(), shop.get(*RAM[0])) == (before, slope)
        with pytest.raises(UsageError, match="no run that could be undone"):
            arm.undo_settings()


def test_what_another_changed_meanwhile_stays_at_an_undo(shop: Workshop) -> None:
    with shop.open() as arm:
        arm.apply_settings()
        arm.shoulder.servo.store({"highest_limit_temperature": 70.0})
        arm.undo_settings()
    assert shop.get("left", 1, "highest_limit_temperature") == 70
    assert shop.get("left", 1, "max_torque") == 1023


def test_a_driven_servo_is_refused_or_let_go(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        for joint in arm:
            for part in joint.parts:
                shop.servo(part.port, part.servo.id).turn_shaft(part.axis.to_servo(0.0))
        arm.lift.torque_on()
        assert "its torque is on: it has to go off before anything is written" in str(arm.plan_settings())
        with pytest.raises(UsageError, match=r"lift \(RX-28 id 2 on left\), lift \(RX-28 id 3 on left\) is on"):
            arm.apply_settings()
        assert shop.memories() == before
        assert shop.servo("left", 2).torque
        arm.apply_settings(torque_off=True)
        assert held(shop) == WANTED
        assert not shop.servo("left", 2).torque

        arm.shoulder.torque_on()
        with pytest.raises(UsageError, match=r"shoulder .* is on"):
            arm.undo_settings()
        assert held(shop) == WANTED
        arm.undo_settings(torque_off=True)
    assert shop.memories() == before


def test_a_missing_servo_is_named_and_the_others_are_written(shop: Workshop) -> None:
    shop.unplug("left", 1)
    with shop.open() as arm:
        plan = arm.plan_settings()
        assert "shoulder is missing" in plan.problems[0]
        with pytest.raises(NotRestored, match="shoulder is missing") as failure:
            arm.apply_settings(plan)
    assert [who.partition(" ")[0] for who in failure.value.restored] == ["lift", "lift", "grip"]
    assert {key: value for key, value in held(shop).items() if key[:2] != ("left", 1)} == {
        key: value for key, value in WANTED.items() if key[:2] != ("left", 1)
    }


@pytest.mark.parametrize("what", ["apply", "undo"])
def test_a_program_that_is_killed_anywhere_loses_nothing(tmp_path: Path, what: str) -> None:
    """At every third request in turn: the same again does the rest, and undo finds all as it was at first."""
    joints = JOINTS[: JOINTS.index("[joint.lift]")]
    for kill_at in count(0, 3):
        folder = tmp_path / str(kill_at)
        folder.mkdir()
        shop = Workshop(folder, joints, {"left": "rx28@1"})
        before, killed = shop.memories(), False
        with shop.open() as arm:
            plan = arm.plan_settings()
            if what == "undo":
                arm.apply_settings(plan)
            shop.before = killer(kill_at)
            try:
                arm.undo_settings() if what == "undo" else arm.apply_settings(plan)
            except Killed:
                killed = True
        shop.before = lambda _: None
        with shop.open() as arm:
            if what == "apply":
                arm.apply_settings()
                assert shop.get("left", 1, "max_torque") == 512
                assert shop.get("left", 1, "ccw_angle_limit") == 818
                assert len(Backups(arm.file).runs()) == 1
            if killed or what == "apply":
                arm.undo_settings()
            assert shop.memories() == before
            assert Backups(arm.file).latest() is None
        if not killed:
            break
    assert kill_at > 10


def killer(kill_at: int) -> Callable[[bytes], None]:
    """End the program at this request, counted from 0."""
    requests = count()

    def before(_: bytes) -> None:
        if next(requests) == kill_at:
            raise Killed

    return before


def test_an_undo_that_was_broken_off_comes_first(shop: Workshop) -> None:
    with shop.open() as arm:
        arm.apply_settings()
        shop.before = killer(12)
        with pytest.raises(Killed):
            arm.undo_settings()
    shop.before = lambda _: None
    with shop.open() as arm:
        with pytest.raises(UsageError, match="an undo of this run was broken off; finish it with `servobus robot"):
            arm.apply_settings()
        arm.undo_settings()
        assert shop.get("left", 1, "max_torque") == 1023


def test_a_pulled_cable_is_told_and_the_rest_is_done_later(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        plan = arm.plan_settings()
        shop.unplug("right", 219)
        with pytest.raises(NotRestored, match=r"grip \(DRS-0602 id 219 on right\): .*no reply") as failure:
            arm.apply_settings(plan)
        assert len(failure.value.failed) == 1
        shop.plug("right", 219)
        assert list(arm.apply_settings().written) == ["grip (DRS-0602 id 219 on right)"]
        assert held(shop) == WANTED
        while Backups(arm.file).latest() is not None:
            arm.undo_settings()
    assert shop.memories() == before


@pytest.mark.parametrize("what", ["apply", "undo"])
@pytest.mark.parametrize("request_", [2, 9, 14])
def test_a_servo_that_restarts_meanwhile_is_right_in_the_end(tmp_path: Path, what: str, request_: int) -> None:
    shop = Workshop(tmp_path, JOINTS[: JOINTS.index("[joint.lift]")], {"left": "rx28@1"})
    before = shop.memories()
    requests = count()

    def restart(_: bytes) -> None:
        if next(requests) == request_:
            shop.before = lambda _: None
            shop.unplug("left", 1)
            shop.rigs["left"].plug(shop.rigs["left"].servos, shop.now)

    with shop.open() as arm:
        if what == "undo":
            arm.apply_settings()
        shop.before = restart
        with suppress(NotRestored, UsageError):
            arm.undo_settings() if what == "undo" else arm.apply_settings()
        assert next(requests) > request_
        for bus in arm.buses.values():
            bus.transport.sleep(1.0)
        if what == "apply":
            arm.apply_settings()
            assert shop.get(*RAM[0]) == RAM[1]
            assert shop.get("left", 1, "ccw_angle_limit") == 818
        while Backups(arm.file).latest() is not None:
            arm.undo_settings()
    assert shop.memories() == before


def test_the_asynchronous_robot_does_the_same(shop: Workshop) -> None:
    async def work() -> None:
        file = read_text(shop.path.read_text(encoding="utf-8"), shop.path)
        ports = {name: VirtualPort(name, rig, real=False) for name, rig in shop.rigs.items()}
        arm = AsyncRobot(file, {name: AsyncBus(port, echo=False) for name, port in ports.items()}, incomplete=True)
        async with arm:
            plan = await arm.plan_settings()
            assert plan.changes() == 9
            await arm.apply_settings(plan)
            assert held(shop) == WANTED
            await arm.undo_settings()
            assert (await arm.plan_settings()).changes() == 9

    asyncio.run(work())


def test_what_is_no_setting_is_refused_with_its_line() -> None:
    head = '[robot]\nformat = 1\n[port.a]\npath = "virtual:rx28@1"\n[joint.j]\nport = "a"\nmodel = "rx28"\nid = 1\n'

    def refused(rest: str) -> str:
        with pytest.raises(RobotFileError) as failure:
            read_text(head + rest)
        return str(failure.value)

    assert "robot file:10: [joint.j.registers.id] id says where the servo is found" in refused(
        "[joint.j.registers]\nid = 3\n"
    )
    assert "baud_rate says where" in refused("[joint.j.registers]\nbaud_rate = 1\n")
    assert "goal_position is a command and no setting" in refused('[joint.j.registers]\ngoal_position = "1deg"\n')
    assert "torque_enable is a command and no setting" in refused("[joint.j.registers]\ntorque_enable = true\n")
    assert "robot file:9: [joint.j.limits_in_servo] there are no limits to keep" in refused("limits_in_servo = true\n")
    assert "cw_angle_limit is worked out from the limits of the joint" in refused(
        'limits = ["10deg", "20deg"]\nlimits_in_servo = true\n[joint.j.registers]\ncw_angle_limit = 3\n'
    )


def test_limits_that_would_cross_are_impossible(shop: Workshop) -> None:
    text = shop.path.read_text().replace("dead_zone = 3", 'min_voltage = "19V"')
    shop.path.write_text(text)
    with shop.open() as arm:
        plan = arm.plan_settings()
        assert any("min_voltage = 19.0 V would not be below max_voltage" in problem for problem in plan.problems)
        with pytest.raises(NotRestored, match="min_voltage stays"):
            arm.apply_settings(plan)
    assert shop.get("left", 1, "max_torque") == 512


def test_a_limp_joint_outside_its_new_limits_is_told(shop: Workshop) -> None:
    # It stands at 149.85°, the middle of an RX-28: -0.15° of a joint with its zero at 150°, and direction -1.
    shop.path.write_text(shop.path.read_text().replace('["-90deg", "45deg"]', '["10deg", "45deg"]'))
    with shop.open() as arm:
        plan = arm.plan_settings()
        assert "it stands at 0.1°, outside its new limits: turn it inside by hand" in str(plan)
        assert [one.joint for one in plan.servos if one.outside is not None] == ["shoulder"]
        assert plan.entry()["servos"][0]["outside"] == pytest.approx(0.15, abs=0.3)
        assert plan.entry()["servos"][1]["outside"] is None
