"""LeRobot names torch for types alone in what is used here: a module with these names stands for it where it is not."""

import importlib.util
import sys
import types
from pathlib import Path

import pytest

if importlib.util.find_spec("torch") is None:
    torch = types.ModuleType("torch")
    for name in ("Tensor", "dtype", "device"):
        setattr(torch, name, type(name, (), {}))
    sys.modules["torch"] = torch

ARM = """\
[robot]
format = 1
name = "arm"
rest = "home"
[port.left]
path = "virtual:rx28@1-3?clock=virtual"
[port.right]
path = "virtual:lx16a@1?clock=virtual"
[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
limits = ["-90deg", "90deg"]
speed = "100deg/s"
[joint.lift]
port = "left"
model = "rx28"
id = 2
zero = "150deg"
limits = ["-60deg", "60deg"]
[joint.lift.mirror]
id = 3
zero = "150deg"
[joint.grip]
port = "right"
model = "lx16a"
id = 1
zero = "70deg"
limits = ["0deg", "80deg"]
[pose.home]
shoulder = "0deg"
lift = "0deg"
grip = "40deg"
"""


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the path of a robot file of virtual servos; to ask a question fails."""

    def asked(*_: object) -> str:
        raise AssertionError("a question was asked")

    monkeypatch.setattr("builtins.input", asked)
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return path
