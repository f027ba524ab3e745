"""The ten commands of docs/wave.md, one after the other, as a reader types them; a hand turns the virtual servos."""

import math
import re
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from servobus.robots.motions.motion import read_samples

PAGE = Path(__file__).parents[1] / "docs" / "wave.md"
SERVOBUS = [sys.executable, "-m", "servobus"]
AMPLITUDE, PERIOD = 20.0, 2.0
"""Degrees and s of the wave that the hand makes: its acceleration, 197°/s², is within what a joint may by itself."""


def commands() -> list[list[str]]:
    (block,) = re.findall(r"```\n(servobus .*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return [shlex.split(line.partition("#")[0])[1:] for line in block.splitlines()]


@pytest.fixture
def drawer(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Serve the servos of the first command."""
    with subprocess.Popen(
        [*SERVOBUS, *commands()[0]], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        assert server.stdout.readline().startswith("ready")
        yield server
        server.terminate()


def wave(server: subprocess.Popen[str], stop: threading.Event) -> None:
    """Turn the shafts of two servos to and fro by hand, until told to stop.

    While they have torque the server refuses that, and says so.
    """
    assert server.stdin is not None
    began = time.monotonic()
    while not stop.wait(0.02):
        angle = 150 + AMPLITUDE * math.sin(2 * math.pi * (time.monotonic() - began) / PERIOD)
        server.stdin.write(f"turn 1-2 {angle:.2f}\n")
        server.stdin.flush()


def test_ten_commands_from_a_drawer_to_a_recorded_wave(drawer: subprocess.Popen[str], tmp_path: Path) -> None:
    lines = commands()
    assert len(lines) == 10
    said = []
    for words in lines[1:]:
        stop = threading.Event()
        if words[0] == "teach":
            threading.Thread(target=wave, args=(drawer, stop), daemon=True).start()
        run = subprocess.run(
            [*SERVOBUS, *words], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
        )
        stop.set()
        assert run.returncode == 0, (words, run.stdout, run.stderr)
        said.append(run.stdout)
    found, *_ = said
    assert found.count("RX-28 id") == 3
    taught = read_samples(tmp_path / "wave.csv")
    assert list(taught.poses) == ["joint1", "joint2"]
    swing = max(taught.poses["joint1"]) - min(taught.poses["joint1"])
    assert math.degrees(swing) == pytest.approx(2 * AMPLITUDE, abs=3)
    assert said[-1].startswith("wave played: joint1")
