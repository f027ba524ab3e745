from collections.abc import Callable
from pathlib import Path

import pytest

from servobus import Backup
from unit.cli.conftest import Run

FILE = """\
[robot]
format = 1
[port.hand]
path = "virtual:lx16a@1,9?clock=virtual&state=hand.json"
[joint.wrist]
port = "hand"
model = "lx16a"
id = 1
[joint.grip]
port = "hand"
model = "lx16a"
id = 2
[joint.grip.registers]
max_temperature = 70
"""


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(FILE)


def test_adopt(run: Run, refused: Callable[..., str]) -> None:
    result = run("robot", "adopt", "arm.toml", code=1, input="n\n")
    assert result.stdout == (
        "LX-16A id 9 at 115200 baud takes the place of grip (LX-16A id 2 on hand):\n"
        "  id: 9 -> 2   [EEPROM]\n"
        "  max_temperature: 85 °C -> 70 °C   [EEPROM]\n"
        "  no settings of the old servo are kept\n"
        "write this to the new servo? [y/N]: n\n"
    )
    assert result.stderr.endswith("servobus: nothing was written\n")
    run("robot", "check", "arm.toml", "--quick", code=1)

    result = run("robot", "adopt", "arm.toml", "grip", input="y\n")
    assert "LX-16A id 2 at 115200 baud takes the place of grip" in result.stdout
    assert result.stdout.endswith("arm.toml: all servos are there\n")
    (kept,) = Path("arm.backups/new").iterdir()
    assert Backup.parse(kept.read_text()).id == 9
    assert Backup.parse(Path("arm.backups/last/grip.toml").read_text()).values["max_temperature"] == 70
    assert "nothing to write" in run("robot", "plan", "arm.toml").stdout
    assert "the servo of grip answers, so no new one is needed" in refused("robot", "adopt", "arm.toml", "grip")
    assert "no joint 'nose'" in refused("robot", "adopt", "arm.toml", "nose")


def test_adopt_on_an_adapter_of_its_own(run: Run) -> None:
    Path("arm.toml").write_text(FILE.replace("@1,9", "@1"))
    result = run("robot", "adopt", "arm.toml", "--port", "virtual:lx16a@1?clock=virtual&state=new.json", "--yes")
    assert "LX-16A id 1 at 115200 baud takes the place of grip" in result.stdout
    assert "plug it in on port hand now; `servobus robot check arm.toml` tells" in result.stderr
    run("read", "virtual:lx16a@1?clock=virtual&state=new.json", 2, "id", "--model", "lx16a")
