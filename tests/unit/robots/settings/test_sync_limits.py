"""The limits of joints in the registers of their servos: rounded inwards, and nothing where a servo stands outside."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from servobus import UsageError, deg
from servobus.cli.app import app
from unit.robots.settings.workshop import Workshop

JOINTS = """\
[joint.swing]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
limits = ["-90deg", "45deg"]
registers = { max_torque = "50%" }

[joint.free]
port = "left"
model = "rx28"
id = 2

[joint.grip]
port = "right"
model = "lx16a"
id = 1
zero = "100deg"
ratio = 2.0
limits = ["-10.1deg", "20.1deg"]
"""
# An RX-28 has 1023 steps over 300°, an LX-16A 1000 over 240°. -90° .. 45° of the joint that is turned round at 150°
# is 105° .. 240°: raw 358.05 .. 818.4. -10.1° .. 20.1° behind a gear of 2 is 79.8° .. 140.2°: raw 332.5 .. 584.2.
WANTED = {
    ("left", 1, "cw_angle_limit"): 359,
    ("left", 1, "ccw_angle_limit"): 818,
    ("right", 1, "min_position"): 333,
    ("right", 1, "max_position"): 584,
}


@pytest.fixture
def shop(tmp_path: Path) -> Workshop:
    return Workshop(tmp_path, JOINTS, {"left": "rx28@1-2", "right": "lx16a@1"})


def test_limits_are_written_and_nothing_else(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        plan = arm.plan_limits()
        assert plan.changes() == 4
        assert shop.memories() == before
        assert set(arm.sync_limits().written) == {"swing (RX-28 id 1 on left)", "grip (LX-16A id 1 on right)"}
        assert {key: shop.get(*key) for key in WANTED} == WANTED
        after = shop.memories()
        assert sum(before[who] != after[who] for who in before) == 2
        assert shop.get("left", 1, "max_torque") == 1023
        assert arm.plan_limits().changes() == 0
        arm.undo_settings()
    assert shop.memories() == before


def test_a_servo_outside_is_refused_before_anything_is_written(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        shop.servo("right", 1).shaft.position = 150 * deg
        with pytest.raises(UsageError, match=r"outside the limits stands grip at 2[45]\.\d°: turn it inside by hand"):
            arm.sync_limits()
    assert shop.memories() == before


def test_a_servo_with_torque_is_refused(shop: Workshop) -> None:
    before = shop.memories()
    with shop.open() as arm:
        arm.torque_on()
        with pytest.raises(UsageError, match="torque"):
            arm.sync_limits()
        assert shop.memories() == before
        arm.sync_limits(torque_off=True)
        assert {name: state.torque for name, state in arm.look().items()} == {
            "swing": False, "free": True, "grip": False,
        }  # fmt: skip


def test_on_the_command_line(tmp_path: Path) -> None:
    head = '[robot]\nformat = 1\n[port.left]\npath = "virtual:rx28@1-2"\n[port.right]\npath = "virtual:lx16a@1"\n'
    path = tmp_path / "arm.toml"
    path.write_text(head + JOINTS)
    done = CliRunner().invoke(app, ["robot", "sync-limits", str(path)], input="n\n")
    assert done.exit_code == 1
    assert "nothing was written" in done.stderr
    done = CliRunner().invoke(app, ["robot", "sync-limits", str(path), "--yes"])
    assert done.exit_code == 0, done.output
    assert "4 values to write" in done.stdout
    assert "swing (RX-28 id 1 on left): written" in done.stdout
