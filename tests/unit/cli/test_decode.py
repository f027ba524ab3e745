from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus.protocols import herkulex, lewansoul
from unit.cli.conftest import Run

PING = "FF FF 01 02 01 FB"
STATUS = "FF FF 01 02 00 FC"
READ_LX = "55 55 01 03 1C DF"
STAT = herkulex.encode(herkulex.Stat(219)).hex()


def kinds(decoded: Any) -> list[tuple[int, str]]:
    return [(event["offset"], event["kind"]) for event in decoded["events"]]


def test_the_family_is_found_out(load: Callable[..., Any]) -> None:
    assert load("decode", PING)["family"] == "dynamixel"
    assert load("decode", READ_LX)["family"] == "lewansoul"
    assert load("decode", STAT)["family"] == "herkulex"


@pytest.mark.parametrize(
    "form", [PING, PING.replace(" ", ""), "0xff 0xFF 0x01,0x02;01 fb", r"\xff\xff\x01\x02\x01\xfb"]
)
def test_ways_of_writing_hex(load: Callable[..., Any], form: str) -> None:
    assert load("decode", form)["events"][0]["bytes"] == PING


def test_hex_in_several_arguments(load: Callable[..., Any]) -> None:
    assert kinds(load("decode", *PING.split())) == [(0, "packet")]


def test_a_reply_is_told_from_a_request(load: Callable[..., Any]) -> None:
    ping, status, again = load("decode", f"{PING} {STATUS} {PING}")["events"]
    assert "Ping" in ping["text"] or "PING" in ping["text"]
    assert "tatus" in status["text"] or "STATUS" in status["text"]
    assert again["text"] == ping["text"]


def test_junk_and_checksum_faults_are_shown_where_they_are(load: Callable[..., Any]) -> None:
    stream = f"00 11 {PING} FF FF 01 02 01 00 22 {STATUS} FF"
    decoded = load("decode", "--family", "dynamixel", stream)
    assert kinds(decoded) == [(0, "noise"), (2, "packet"), (8, "corrupt"), (14, "noise"), (15, "packet"), (21, "noise")]
    assert "".join(event["bytes"] + " " for event in decoded["events"]).split() == stream.split()
    assert decoded["events"][2]["text"].startswith("CHECKSUM WRONG")


def test_nothing_but_junk(run: Run) -> None:
    assert "JUNK: 3 bytes" in run("decode", "010203").stdout


def test_a_file_of_hex_text_and_one_of_bytes(load: Callable[..., Any], tmp_path: Path) -> None:
    text, raw = tmp_path / "sniffed.txt", tmp_path / "sniffed.bin"
    text.write_text(f"{READ_LX}\n{READ_LX}\n")
    raw.write_bytes(bytes.fromhex(READ_LX) * 2)
    assert kinds(load("decode", text)) == kinds(load("decode", raw)) == [(0, "packet"), (6, "packet")]


def test_standard_input(run: Run) -> None:
    move = lewansoul.encode(lewansoul.Request(2, lewansoul.Command.SERVO_MOVE_TIME_WRITE, (500, 1000)))
    assert "SERVO_MOVE_TIME_WRITE id 2, angle 500, time_ms 1000" in run("decode", "-", input=move).stdout


def test_for_people(run: Run) -> None:
    lines = run("decode", "--family", "herkulex", "00", STAT).stdout.splitlines()
    assert lines[0] == "HerkuleX, 8 bytes"
    assert lines[1] == "     0  00"
    assert lines[3] == "     1  FF FF 07 DB 07 DA 24"


def test_what_is_no_bytes(refused: Callable[..., str], tmp_path: Path) -> None:
    assert "neither a row of hex bytes nor a file" in refused("decode", "hello.bin")
    assert "is no row of hex bytes" in refused("decode", "FF", "GG")
    assert "neither a row" in refused("decode", "FFF")
    assert "neither a row" in refused("decode", "")
    assert "standard input is empty" in refused("decode", "-", input="")
    assert "no family 'foo'" in refused("decode", "--family", "foo", "FF")
    (tmp_path / "folder").mkdir()
    assert "Is a directory" in refused("decode", tmp_path / "folder")
