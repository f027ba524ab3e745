import json
from collections.abc import Callable
from pathlib import Path

import pytest

from unit.cli.conftest import Run

FILE = """\
[robot]
format = 1
[port.left]
path = "virtual:rx28@1,2?clock=virtual&state=left.json"
[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-90deg", "90deg"]
limits_in_servo = true
[joint.elbow]
port = "left"
model = "rx28"
id = 2
[joint.elbow.registers]
max_torque = "50%"
"""


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(FILE)


def test_plan_apply_undo(run: Run, refused: Callable[..., str]) -> None:
    plan = run("robot", "plan", "arm.toml").stdout
    assert plan == (
        "shoulder (RX-28 id 1 on left):\n"
        "  cw_angle_limit: 0.0° -> 60.1°   [EEPROM, for -90.0° .. 90.0° of the joint]\n"
        "  ccw_angle_limit: 300.0° -> 239.9°   [EEPROM, for -90.0° .. 90.0° of the joint]\n"
        "elbow (RX-28 id 2 on left):\n"
        "  max_torque: 100.0 % -> 50.0 %   [EEPROM]\n"
        "arm.toml: 3 values to write, 3 of them to the EEPROM\n"
    )
    result = run("robot", "apply", "arm.toml", code=1, input="n\n")
    assert "write these 3 values, 3 of them to the EEPROM? [y/N]" in result.stdout
    assert result.stderr == "servobus: nothing was written\n"
    assert json.loads(run("robot", "plan", "arm.toml", "--json").stdout)["eeprom_writes"] == 3

    assert "elbow (RX-28 id 2 on left): written max_torque\n" in run("robot", "apply", "arm.toml", input="y\n").stdout
    assert "arm.toml: nothing to write" in run("robot", "apply", "arm.toml").stdout
    assert (
        "elbow (RX-28 id 2 on left): brought back max_torque"
        in run("robot", "apply", "arm.toml", "--undo", input="y\n").stdout
    )
    assert run("robot", "plan", "arm.toml").stdout == plan
    assert "there is no run that could be undone" in refused("robot", "apply", "arm.toml", "--undo")


def test_a_missing_servo_is_told(run: Run) -> None:
    Path("arm.toml").write_text(FILE.replace("id = 2", "id = 5"))
    result = run("robot", "plan", "arm.toml", code=1)
    assert "elbow is missing: RX-28 id 5" in result.stdout
    result = run("robot", "apply", "arm.toml", "--yes", code=1)
    assert "not as the file says: elbow (RX-28 id 5 on left): elbow is missing" in result.stderr
    assert "cw_angle_limit" not in run("robot", "plan", "arm.toml", code=1).stdout


def test_nobody_is_there_to_answer(run: Run) -> None:
    result = run("robot", "apply", "arm.toml", code=1)
    assert "nobody is there to answer, and nothing was changed: --yes writes it" in result.stderr
