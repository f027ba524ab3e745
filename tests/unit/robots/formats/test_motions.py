"""Action groups of Hiwonder and moves of pypot as motions of a robot file."""

import json
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from servobus import FormatError
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.file.writing import edited
from servobus.robots.formats import d6a, move
from servobus.robots.formats import mtn as mtn_format
from servobus.robots.formats.base import Given
from servobus.robots.motions.motion import motion_of
from unit.robots.arms import SIX


def group(rows: Sequence[tuple[Any, ...]], columns: str = "Time INT, Servo1 INT, Servo2 INT, Servo9 INT") -> bytes:
    """Make an action group, as Hiwonder's editor does: one table, a row a pose."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"CREATE TABLE ActionGroup ([Index] INTEGER PRIMARY KEY AUTOINCREMENT UNIQUE, {columns})")
        marks = ", ".join("?" * (columns.count(",") + 1))
        names = ", ".join(column.split()[0] for column in columns.split(","))
        database.executemany(f"INSERT INTO ActionGroup ({names}) VALUES ({marks})", rows)
        database.commit()
        return bytes(database.serialize())


ROWS = [(500, 500, 300, 0), (1500, 458, 500, 0), (200, 500, 300, 0)]


def taken(data: bytes, **said: Any) -> Any:
    file = read_text(SIX)
    changes = d6a.onto(data, file, Given("wave hand.d6a", **said))
    return read_text(edited(file, changes.changes)), changes


def test_an_action_group_is_a_motion_of_steps() -> None:
    file, changes = taken(group(ROWS))
    motion = file.motions["wave_hand"]
    assert motion.path == "pchip"
    assert [step.time for step in motion.steps] == [0.0, 1.5, 1.7]  # the first way is not part of it
    # wrist: zero 110°, turned round: 500 counts are 120°, so -10°; 458 are 109.92°, so 0.08°
    # grip: zero 60°, behind 2.5:1: 300 counts are 72°, so 4.8°; 500 are 120°, so 24°
    assert motion.steps[0].joints == {"wrist": "-10deg", "grip": "4.8deg"}
    assert motion.steps[1].joints == {"wrist": "0.08deg", "grip": "24deg"}
    assert "Servo9" in " ".join(changes.notes)
    assert changes.files == {}


def test_ids_find_the_bus_servos() -> None:
    """Ids 1 and 2 are on all three ports of the arm, but on one of them are bus servos."""
    file, _ = taken(group([(1, 300)], "Time INT, Servo2 INT"), motion="m")
    assert file.motions["m"].steps[0].joints == {"grip": "4.8deg"}
    with pytest.raises(FormatError, match="base, elbow, wrist all have id 1"):
        taken(group([(1, 1500)], "Time INT, Servo1 INT"), kind="pwm")


def test_pulses_must_be_said() -> None:
    pulses = group([(500, 1500, 1500, 1500), (500, 1700, 1500, 1500)])
    with pytest.raises(FormatError, match="--kind pwm"):
        taken(pulses, joints={"Servo1": "wrist"})
    file, changes = taken(pulses, joints={"Servo1": "wrist", "Servo2": "turn"}, kind="pwm", motion="w")
    # 200 µs are 18° of the servo, whose middle is 120°: 138°, joint 110° - 138° = -28°
    assert file.motions["w"].steps[1].joints["wrist"] == "-28deg"
    assert "180°" in " ".join(changes.notes)


@pytest.mark.parametrize(
    ("data", "said", "words"),
    [
        (b"SQLite format 3\0nothing", {}, "no action group"),
        (group([], "Time INT, Servo1 INT"), {}, "no pose"),
        (group([(1, 2)], "Time INT, Pose INT"), {}, "columns Time and Servo1"),
        (group([(1, "x")], "Time INT, Servo1 INT"), {}, "no whole number"),
        (group([(100, 500, 300, 0), (0, 500, 300, 0)]), {}, "row 2 has 0 ms"),
        (group([(100, 1000, 300, 0)]), {}, "row 1: wrist goes to -130.0°, which is outside its limits"),
        (group([(100, -4, 300, 0)]), {}, "0 to 1000"),
        (group(ROWS), {"joints": {"Servo1": "base"}}, "other counts"),
        (group(ROWS), {"joints": {"Servo1": "hip"}}, "no joint"),
        (group(ROWS), {"joints": {"Servo1": "wrist", "Servo2": "wrist"}}, "two of its servos"),
        (group(ROWS), {"motion": "wave"}, "--name wave2"),
        (group([(1, 3000)], "Time INT, Servo9 INT"), {"kind": "pwm", "joints": {"Servo9": "wrist"}}, "500 to 2500"),
    ],
)
def test_a_wrong_group_is_refused(data: bytes, said: dict[str, Any], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        taken(data, **said)


def positions(**poses: dict[str, list[float]]) -> bytes:
    return json.dumps({"framerate": 50.0, "positions": poses}).encode()


MOVE = positions(**{"0.02": {"wrist": [12.5, 0.0], "m7": [0.0, 0.0]}, "0.5": {"wrist": [-3.25, 8.0], "m7": [1.0, 0.0]}})


def test_a_move_is_a_file_of_samples() -> None:
    file = read_text(SIX)
    changes = move.onto(MOVE, file, Given("nod.move"))
    assert changes.files == {"nod.csv": "time,wrist\n0.0000,12.500\n0.4800,-3.250\n"}
    made = read_text(edited(file, changes.changes))
    assert made.motions["nod"].file == "nod.csv"
    assert "m7" in " ".join(changes.notes)


def test_an_angle_at_the_limit_stays_within_it(tmp_path: Path) -> None:
    """The table has thousandths of a degree; the limit of this joint has more places, and it can be played."""
    path = tmp_path / "arm.toml"
    path.write_text(SIX.replace('["-70deg", "100deg"]', '["-70.0004deg", "89.8826deg"]'))
    data = positions(**{"0": {"wrist": [-70.0004, 0.0]}, "1": {"wrist": [89.8826, 0.0]}})
    file = read_file(path)
    changes = move.onto(data, file, Given("nod.move"))
    (tmp_path / "nod.csv").write_text(changes.files["nod.csv"])
    motion = motion_of(read_text(edited(file, changes.changes), path), "nod")
    low, high = file.joints["wrist"].range
    assert all(low <= angle <= high for angle in motion.poses["wrist"])
    past = positions(**{"0": {"wrist": [-70.002, 0.0]}, "1": {"wrist": [0.0, 0.0]}})
    with pytest.raises(FormatError, match="outside its limits"):
        move.onto(past, file, Given("nod.move"))


def test_times_are_put_in_order() -> None:
    data = positions(**{"10.0": {"wrist": [1.0, 0]}, "9.5": {"wrist": [2.0, 0]}})
    changes = move.onto(data, read_text(SIX), Given("nod.move"))
    assert changes.files["nod.csv"] == "time,wrist\n0.0000,2.000\n0.5000,1.000\n"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"{}", "positions by time"),
        (positions(x={"wrist": [0.0, 0.0]}), "no time"),
        (positions(nan={"wrist": [0.0, 0.0]}), "no time"),
        (positions(**{"0": {}}), "no motors"),
        (b'{"positions": {"0": {"wrist": []}}}', "position in degrees"),
        (positions(**{"0": {"wrist": [0.0]}, "1": {"grip": [0.0]}}), "other motors"),
        (positions(**{"0": {"wrist": [0.0]}, "0.0": {"wrist": [1.0]}}), "two of its samples"),
        (positions(**{"0": {"wrist": [120.0, 0.0]}, "1": {"wrist": [0.0, 0.0]}}), "outside its limits"),
        (positions(**{"0": {"m1": [0.0, 0.0]}, "1": {"m1": [0.0, 0.0]}}), "--joint"),
        (positions(**{"0": {"wrist": [0.0, 0.0]}}), "at least two"),
    ],
)
def test_a_wrong_move_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        move.onto(data, read_text(SIX), Given("nod.move"))


# RoboPlus


def row(words: dict[int, object], *more: object) -> str:
    return " ".join(map(str, [*(words.get(id, 0) for id in range(26)), *more]))


def mtn(*pages: str, ids: tuple[int, ...] = (1, 2, 7)) -> bytes:
    lines = ["type=motion", "version=1.01", f"enable={row(dict.fromkeys(ids, 1))}", *pages]
    return "\r\n".join(lines).encode("utf-8-sig")


def page(name: str, *steps: str, play: str = "0 0 1 1 32") -> str:
    compliance = f"compliance={row(dict.fromkeys(range(26), 5))}"
    parts = ["page_begin", f"name={name}", compliance, f"play_param={play}", *(f"step={one}" for one in steps)]
    return "\r\n".join([*parts, "page_end"])


WAVE = (row({1: 512, 2: 512, 7: 100}, 0, 0.5), row({1: 612, 2: 512}, 0.4, 1), row({1: 512, 2: 412}, 0, 0.6))


def robot_plus(data: bytes, text: str = SIX, **said: Any) -> Any:
    file = read_text(text)
    changes = mtn_format.onto(data, file, Given("robot.mtn", **said))
    return read_text(edited(file, changes.changes)), changes


def test_pages_of_robot_plus_are_motions() -> None:
    data = mtn(page("Wave 1", *WAVE, play="0 0 1 2.0 32"), page(""), page("Bow", *WAVE, play="3 0 1 1 32"))
    file, changes = robot_plus(data)
    wave = file.motions["Wave_1"]
    # Rate 2: way 0.5 s, pause 0.2 s, way 0.3 s; the way to the first pose is not part of it.
    assert [step.time for step in wave.steps] == [0.0, 0.5, 0.7, 1.0]
    assert [step.time for step in file.motions["Bow"].steps] == [0.0, 1.0, 1.4, 2.0]
    # base: zero 150°; lift: zero 120°, turned round. 1023 counts are 300°: 512 are 150.147°, 612 are 179.472°.
    assert wave.steps[0].joints == {"base": "0.1466deg", "lift": "-30.1466deg"}
    assert wave.steps[1].joints == wave.steps[2].joints == {"base": "29.4721deg", "lift": "-30.1466deg"}
    assert wave.steps[3].joints == {"base": "0.1466deg", "lift": "-0.8211deg"}
    notes = " ".join(changes.notes)
    assert "Servo7" in notes
    assert 'page "Bow" is repeated, or goes on with another' in notes
    assert "Wave" not in notes
    assert motion_of(file, "Wave_1").times == (0.0, 0.5, 0.7, 1.0)


def test_one_page_of_robot_plus_is_named() -> None:
    data = mtn(page("Wave", *WAVE), page("Bow", *WAVE))
    assert list(robot_plus(data, motion="Bow")[0].motions) == ["wave", "Bow"]
    assert list(robot_plus(mtn(page("Wave", *WAVE)), motion="hello")[0].motions) == ["wave", "hello"]
    with pytest.raises(FormatError, match='its pages are "Wave", "Bow"'):
        robot_plus(data, motion="Nod")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (mtn(page("a", row({1: 1024}, 0, 1), row({1: 512}, 0, 1)), ids=(1,)), "counts of an AX-12 are 0 to 1023"),
        (mtn(page("a", row({1: 0}, 0, 1), row({1: 512}, 0, 1)), ids=(1,)), "outside its limits"),
        (mtn(page("a", row({1: 512}, 0, 1), row({1: 512}, 0, 0)), ids=(1,)), "a step needs time"),
        (mtn(page("a", "1 2 3")), "is no row of 28 numbers"),
        (mtn(page("a", row({1: "x"}, 0, 1))), "is no row of 28 numbers"),
        (mtn(page("a", *WAVE, play="0 0 1 0 32")), "rate of a page is above 0"),
        (mtn(page("wave", *WAVE)), "has a motion wave already"),
        (mtn(page("a", *WAVE), ids=(20,)), "none of its servos is a joint"),
        (mtn(), "no page with two poses"),
    ],
)
def test_motion_files_of_robot_plus_that_make_no_motion_are_refused(data: bytes, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        robot_plus(data)


def test_servos_with_other_counts_are_refused() -> None:
    with pytest.raises(FormatError, match="wrist is a LX-16A, which has other counts than an AX-12"):
        robot_plus(mtn(page("a", *WAVE)), joints={"Servo1": "wrist"})
