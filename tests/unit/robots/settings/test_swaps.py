"""Servos of one model that have changed places are told by the settings that they keep."""

from pathlib import Path

import pytest

from servobus.core.registers import Area
from servobus.errors import RobotMismatch
from servobus.robots.joints.attendance import refuse
from unit.robots.settings.workshop import Workshop

JOINTS = """\
[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-90deg", "45deg"]
limits_in_servo = true

[joint.elbow]
port = "left"
model = "rx28"
id = 2
zero = "150deg"
limits = ["-60deg", "60deg"]
limits_in_servo = true

[joint.wrist]
port = "right"
model = "rx28"
id = 1
zero = "150deg"
[joint.wrist.registers]
max_torque = "50%"

[joint.tilt]
port = "right"
model = "rx28"
id = 2
zero = "150deg"
"""


@pytest.fixture
def shop(tmp_path: Path) -> Workshop:
    shop = Workshop(tmp_path, JOINTS, {"left": "rx28@1-2", "right": "rx28@1-2"})
    with shop.open() as arm:
        assert arm.check(strangers="near")  # servos that were never set up tell nothing
        arm.apply_settings()
        assert arm.check(strangers="near")
    return shop


def swap(shop: Workshop, port: str) -> None:
    """Let the servos on a port change places: each is as the other was, but for its id."""
    one, other = (shop.servo(port, id).memory for id in (1, 2))
    model = shop.servo(port, 1).model
    for row in model.registers.values():
        if row.area is Area.EEPROM and row.writable and row.name != "id":
            raws = one.eeprom[row], other.eeprom[row]
            other.store(row, raws[0])
            one.store(row, raws[1])


def told(shop: Workshop) -> list[tuple[str, str, str]]:
    with shop.open() as arm:
        return [(one.kind, one.joint, one.port) for one in arm.check(strangers="near").findings]


def test_two_that_hold_the_settings_of_each_other_are_swapped(shop: Workshop) -> None:
    swap(shop, "left")
    assert told(shop) == [("swapped", "shoulder", "left"), ("swapped", "elbow", "left")]
    with shop.open() as arm:
        found = arm.check(strangers="near")
        assert "shoulder: id 1 on port left holds the settings of elbow (id 2 on port left: cw_angle_limit" in str(
            found
        )
        with pytest.raises(RobotMismatch, match="exchange their ids or their cables"):
            refuse(found, incomplete=False)


def test_two_ports_that_are_exchanged_are_told(shop: Workshop) -> None:
    shop.rigs = {"left": shop.rigs["right"], "right": shop.rigs["left"]}
    # What the file asks nothing of, as of tilt, cannot be told.
    assert told(shop) == []
    shop.path.write_text(
        shop.path.read_text().replace('max_torque = "50%"', "cw_angle_limit = 7\nccw_angle_limit = 900")
    )
    shop.rigs = {"left": shop.rigs["right"], "right": shop.rigs["left"]}
    with shop.open() as arm:
        arm.apply_settings()
    shop.rigs = {"left": shop.rigs["right"], "right": shop.rigs["left"]}
    assert told(shop) == [("swapped", "shoulder", "left"), ("swapped", "wrist", "right")]


def test_what_was_exchanged_in_the_file_can_be_written(shop: Workshop) -> None:
    swap(shop, "left")
    with shop.open() as arm:
        arm.apply_settings()
    assert told(shop) == []


def test_servos_that_hold_other_settings_are_not_swapped(shop: Workshop) -> None:
    text = shop.path.read_text()
    shop.path.write_text(text.replace('["-90deg", "45deg"]', '["-60deg", "60deg"]'))  # those of the elbow
    assert told(shop) == []
    shop.path.write_text(text.replace('"45deg"', '"30deg"').replace('"60deg"', '"50deg"'))
    assert told(shop) == []
