"""Every example runs as it stands, on virtual servos."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SAYS = {
    "async_two_ports.py": "there, at",
    "backup_restore.py": "restored: ccw_angle_limit, max_torque",
    "control_loop.py": "turns, 0 missed",
    "first_minute.py": "back",
    "herkulex_s_jog.py": "inposition+torque_on",
    "mixed_drawer.py": "LX-16A id 4 turned by 1",
    "sine_wave.py": "calm",
}


def test_every_example_is_tested() -> None:
    assert sorted(SAYS) == sorted(path.name for path in EXAMPLES.glob("*.py"))


@pytest.mark.parametrize("name", sorted(SAYS))
def test_example(name: str) -> None:
    program = EXAMPLES / name
    done = subprocess.run(
        [sys.executable, "-W", "error", str(program)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert SAYS[name] in done.stdout
    assert len(program.read_text(encoding="utf-8").splitlines()) <= 40
