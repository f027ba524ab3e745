from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus.families.dynamixel import protocol as dynamixel1
from servobus.families.herkulex import protocol as herkulex
from servobus.families.lewansoul import protocol as lewansoul
from unit.cli.conftest import Run

PING = "FF FF 01 02 01 FB"
STATUS = "FF FF 01 02 00 FC"
READ = "FF FF 01 04 02 24 02 D2"
READ_LX = "55 55 01 03 1C DF"
STAT = herkulex.encode(herkulex.Stat(219)).hex()


def kinds(decoded: Any) -> list[tuple[int, str]]:
    return [(event["offset"], event["kind"]) for event in decoded]


def texts(decoded: Any) -> list[str]:
    return [event["text"] for event in decoded]


def test_the_family_is_found_out(load: Callable[..., Any]) -> None:
    assert load("decode", PING)[0]["family"] == "dynamixel"
    assert load("decode", READ_LX)[0]["family"] == "lewansoul"
    assert load("decode", STAT)[0]["family"] == "herkulex"


def test_signed_bytes_behind_the_command_are_no_options(load: Callable[..., Any], run: Run) -> None:
    assert [packet["hex"] for packet in load("decode", "-1", "-1", "1", "2", "1", "-5")] == [PING]
    assert [packet["hex"] for packet in load("decode", "-1,", "-1,", "1,", "2,", "1,", "-5")] == [PING]
    assert "Did you mean '--family'" in run("decode", "--famly", "x", PING, code=2).stderr


def test_what_a_program_gets(load: Callable[..., Any]) -> None:
    packet, noise = load("decode", PING, "00")
    read = {"read_as": "read as hexadecimal bytes, 7 of them"}
    ping = {"offset": 0, "hex": PING, "kind": "packet", "family": "dynamixel", "id": 1, "text": "PING id 1"}
    junk = "JUNK: a byte that is no packet"
    assert packet == ping | read
    assert noise == {"offset": 6, "hex": "00", "kind": "noise", "family": "dynamixel", "id": None, "text": junk} | read


@pytest.mark.parametrize(
    "form", [PING, PING.replace(" ", ""), "0xff 0xFF 0x01,0x02;01 fb", r"\xff\xff\x01\x02\x01\xfb"]
)
def test_ways_of_writing_hex(load: Callable[..., Any], form: str) -> None:
    assert load("decode", form)[0]["hex"] == PING


def test_hex_in_several_arguments(load: Callable[..., Any]) -> None:
    assert kinds(load("decode", *PING.split())) == [(0, "packet")]


def test_a_reply_is_told_from_a_request(load: Callable[..., Any]) -> None:
    decoded = load("decode", f"{PING} {STATUS} {PING}")
    assert texts(decoded) == ["PING id 1", "status of id 1: ok", "PING id 1"]


def test_an_answer_that_looks_like_its_question_is_not_answered(load: Callable[..., Any]) -> None:
    # Input voltage too low: error byte 01, the code of PING.
    alarm = "status of id 1: ALARM input_voltage"
    assert texts(load("decode", PING, PING, PING, PING)) == ["PING id 1", alarm, "PING id 1", alarm]


def test_values_need_the_question(load: Callable[..., Any]) -> None:
    asked, answer = "READ_DATA id 1: 2 bytes from address 36, present_position", "FF FF 01 04 00 00 02 F8"
    told = "status of id 1: ok, present_position 150.1°"
    assert texts(load("decode", "--model", "rx28", READ, answer, READ)) == [asked, told, asked]
    assert texts(load("decode", "--model", "rx28", READ, READ, answer)) == [asked, asked, told]
    assert texts(load("decode", "--model", "rx28", READ, "00", answer)) == [
        asked,
        "JUNK: a byte that is no packet",
        told,
    ]
    assert texts(load("decode", answer)) == ["status of id 1: ok, 00 02"]
    assert (
        texts(load("decode", "--model", "rx28", READ, "FF FF 01 04 00 00 02 F9"))[1]
        == f"CHECKSUM WRONG: would be {told}"
    )


def test_the_model_can_be_named(load: Callable[..., Any], run: Run, refused: Callable[..., str]) -> None:
    assert load("decode", "--model", "lx16a", READ_LX)[0]["family"] == "lewansoul"
    assert load("decode", "--model", "RX-28", "--family", "Dynamixel", PING)[0]["family"] == "dynamixel"
    assert run("decode", "--model", "rx28", PING).stdout.splitlines()[1] == "Dynamixel protocol 1.0, registers of RX-28"
    assert "no model 'rx29'; did you mean rx28?" in refused("decode", "--model", "rx29", PING)
    clash = refused("decode", "--model", "rx28", "--family", "herkulex", PING)
    assert "RX-28 is of the family dynamixel, not herkulex" in clash


def test_junk_and_checksum_faults_are_shown_where_they_are(load: Callable[..., Any]) -> None:
    stream = f"00 11 {PING} FF FF 01 02 01 00 22 {STATUS} FF"
    decoded = load("decode", "--family", "dynamixel", stream)
    assert kinds(decoded) == [(0, "noise"), (2, "packet"), (8, "corrupt"), (14, "noise"), (15, "packet"), (21, "noise")]
    assert " ".join(event["hex"] for event in decoded) == stream
    assert [event["id"] for event in decoded] == [None, 1, 1, None, 1, None]
    assert decoded[2]["text"] == "CHECKSUM WRONG: would be status of id 1: ALARM input_voltage"


def test_nothing_but_junk(run: Run) -> None:
    assert "JUNK: 3 bytes" in run("decode", "010203").stdout


def test_a_file_of_hex_text_and_one_of_bytes(load: Callable[..., Any], tmp_path: Path) -> None:
    text, raw = tmp_path / "sniffed.txt", tmp_path / "sniffed.bin"
    text.write_text(f"{READ_LX}\n{READ_LX}\n")
    raw.write_bytes(bytes.fromhex(READ_LX) * 2)
    assert kinds(load("decode", text)) == kinds(load("decode", raw)) == [(0, "packet"), (6, "packet")]


def test_standard_input(run: Run) -> None:
    move = lewansoul.encode(lewansoul.Request(2, lewansoul.Command.SERVO_MOVE_TIME_WRITE, (500, 1000)))
    assert "SERVO_MOVE_TIME_WRITE id 2: goal_position 120.0°, goal_time 1 s" in run("decode", "-", input=move).stdout


def test_for_people(run: Run) -> None:
    lines = run("decode", "--family", "herkulex", "00", STAT).stdout.splitlines()
    assert lines == [
        "read as hexadecimal bytes, 8 of them",
        "HerkuleX; values are bytes at addresses until the model is known, or named by",
        "--model",
        "     0  00",
        "        padding: 1 byte between requests, which servos skip",
        "     1  FF FF 07 DB 07 DA 24",
        "        STAT id 219",
    ]


def test_long_packets_are_folded_at_80_columns(run: Run) -> None:
    data = {id: bytes.fromhex("10005001") for id in range(1, 6)}
    lines = run("decode", "-", "--model", "rx28", input=dynamixel1.sync_write(30, data).request).stdout.splitlines()
    assert lines[0] == "read as the bytes themselves, 33 of them"
    assert lines[2] == "     0  FF FF FE 1D 83 1E 04 01 10 00 50 01 02 10 00 50"
    assert lines[5] == "        SYNC_WRITE to all, for ids 1, 2, 3, 4, 5: id 1: goal_position 4.7°,"
    assert max(map(len, lines)) <= 80


def test_what_is_no_bytes(refused: Callable[..., str], tmp_path: Path) -> None:
    said = refused("decode", "hello.bin")
    assert "'hello.bin' is neither a row of bytes nor a file: line 1: 'hello.bin' is no byte" in said
    assert "'FF GG' is no row of bytes: line 1: 'GG' is no byte" in refused("decode", "FF", "GG")
    assert "'FFF' is no byte: 3 hexadecimal digits are no whole bytes" in refused("decode", "FFF")
    assert "there are no bytes in it" in refused("decode", "")
    assert "standard input is empty" in refused("decode", "-", input="")
    assert "no family 'foo'" in refused("decode", "--family", "foo", "FF")
    (tmp_path / "folder").mkdir()
    assert "Is a directory" in refused("decode", tmp_path / "folder")
