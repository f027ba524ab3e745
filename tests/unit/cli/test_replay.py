"""`replay`, and recordings as MCAP in `decode`."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from servobus.cli.app import app
from servobus.traffic.recording import Chunk, Direction, Header, Note, RecordingFile, TapEnd

PING = bytes.fromhex("FFFF010201FB")  # RX-28 manual 3-4: PING of id 1
STATUS = bytes.fromhex("FFFF010200FC")  # RX-28 manual 3-4: its answer


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "arm.rec"
    with RecordingFile(path, Header("/dev/ttyUSB0", 57_600, started="then")) as file:
        file.write(Chunk(0.0, Direction.OUT, PING))
        file.write(Chunk(0.002, Direction.IN, STATUS))
        file.write(Note(0.5, "alarm", {"id": 1, "text": "overheating"}))
        file.write(Chunk(1.0, Direction.OUT, bytes.fromhex("FFFF020201FA")))
        file.write(Chunk(1.002, Direction.IN, bytes.fromhex("FFFF020200FB")))
        file.write(TapEnd(2.0))
    return path


def run(*args: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, args)
    return result.exit_code, result.output


def test_what_differs_is_shown(recording: Path) -> None:
    code, said = run("replay", str(recording), "virtual:rx28@1?clock=virtual")
    assert code == 0
    assert "2 requests played: 1 answered as recorded, 1 in another way" in said
    assert "now  nothing" in said


def test_a_real_port_is_refused(recording: Path) -> None:
    code, said = run("replay", str(recording), "/dev/ttyUSB0")
    assert code != 0
    assert "played into virtual servos only" in said


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("hello")
    code, said = run("replay", str(tmp_path / "x"), "virtual:rx28@1")
    assert code != 0
    assert "is no recording" in said


def test_notes_are_shown_and_the_recording_becomes_mcap(recording: Path, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    mcap = tmp_path / "arm.mcap"
    code, said = run("decode", str(recording), "--mcap", str(mcap))
    assert code == 0, said
    assert "alarm:" in said
    assert "overheating" in said
    code, same = run("decode", str(mcap))
    assert code == 0
    assert same == said.replace(f"{mcap}: 6 entries written as MCAP\n", "")
    assert run("replay", str(mcap), "virtual:rx28@1?clock=virtual")[0] == 0
