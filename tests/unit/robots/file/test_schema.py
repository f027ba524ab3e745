"""The JSON Schema of robot files takes what can be read, and finds the mistakes that one value shows."""

import json
import tomllib
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from servobus.cli.app import app
from servobus.robots.file.reading import read_text
from servobus.robots.file.schema import schema, shipped
from unit.robots.arms import SIX

FULL = """\
[robot]
format = 1
name = "all keys"
rest = "home"
changed = "2026-11-28"

[port.main]
path = "usb:A50285BI"
bauds = [57600, 1000000]
echo = false

[port.other]
path = "/dev/ttyUSB1"

[joint.hip]
port = "main"
model = "rx28"
id = 1
baud = 1000000
zero = "150deg"
direction = -1
ratio = 1.5
limits = ["-0.5rad", "0.25turn"]
speed = "120deg/s"
limits_in_servo = true
acceleration = "400deg/s2"
jerk = "4000deg/s3"
safe_action = "free"
mirror = { id = 2, port = "other", model = "rx28", baud = 57600, zero = "140deg", direction = 1, disagreement = "3deg" }
protect = { warn = "10degC", derate = "5degC", push = "80%", stall = "500ms" }
load = { mass = "0.2kg", length = "0.1m", down = "-90deg", sense = -1 }
registers = { punch = 40, led = true, return_delay_time = "100us" }

[joint.knee]
port = "main"
model = "RX-28"
id = 3
load = { parent = "hip" }

[group]
leg = ["hip", "knee"]

[pose.home]
hip = "0deg"
knee = "+10deg"

[motion.step]
path = "pchip"
loop = true
steps = [
  { time = "0s", pose = "home" },
  { time = "500ms", joints = { knee = "1.2e1deg" } },
  { time = "1s", pose = "home", joints = { knee = "20°" } },
]

[motion.wave]
file = "wave.csv"
"""
"""A file with every key that there is."""

BAD = [
    ('name = "all keys"', 'nme = "all keys"'),
    ('name = "all keys"', "name = 3"),
    ("format = 1", "format = 2"),
    ('path = "usb:A50285BI"', ""),
    ("bauds = [57600, 1000000]", "bauds = []"),
    ("bauds = [57600, 1000000]", "bauds = [0]"),
    ("echo = false", 'echo = "no"'),
    ("id = 3", "id = 254"),
    ("id = 3", "id = 3.5"),
    ('zero = "150deg"', "zero = 150"),
    ('zero = "150deg"', 'zero = "150"'),
    ("direction = -1", "direction = 0"),
    ("ratio = 1.5", "ratio = 0"),
    ('limits = ["-0.5rad", "0.25turn"]', 'limits = ["-0.5rad"]'),
    ('safe_action = "free"', 'safe_action = "sleep"'),
    ('zero = "140deg", ', ""),
    ('push = "80%"', "push = 0.8"),
    ('push = "80%"', 'pushing = "80%"'),
    ('leg = ["hip", "knee"]', "leg = []"),
    ('leg = ["hip", "knee"]', 'leg = ["hip", "hip"]'),
    ('hip = "0deg"', "hip = 0"),
    ("[joint.knee]", '[joint."1 knee"]'),
    ("[joint.knee]", "[joins.knee]"),
    ('path = "pchip"', 'path = "zigzag"'),
    ('time = "0s", ', ""),
    ('file = "wave.csv"', ""),
    ('file = "wave.csv"', 'file = "wave.csv"\nsteps = [{ time = "0s", pose = "home" }]'),
]
"""What stands in the file, and a mistake in its place."""


def complaints(text: str) -> list[str]:
    validator: Any = jsonschema.Draft7Validator(schema())
    return [error.message for error in validator.iter_errors(tomllib.loads(text))]


def test_the_schema_is_one() -> None:
    jsonschema.Draft7Validator.check_schema(schema())


@pytest.mark.parametrize("text", [SIX, FULL, "[robot]\nformat = 1\n"], ids=["six", "full", "empty"])
def test_files_that_can_be_read_are_taken(text: str) -> None:
    read_text(text)
    assert complaints(text) == []


@pytest.mark.parametrize(("good", "bad"), BAD, ids=[bad or f"without {good}" for good, bad in BAD])
def test_mistakes_are_found_by_schema_and_reader(good: str, bad: str) -> None:
    assert FULL.count(good) == 1
    text = FULL.replace(good, bad)
    assert complaints(text)
    with pytest.raises(ValueError, match=r"robot file"):
        read_text(text)


def test_every_key_explains_itself() -> None:
    def keys(table: dict[str, Any]) -> list[str]:
        found = []
        for name, value in table.get("properties", {}).items():
            assert value["description"].endswith("."), name
            found += [name, *keys(value)]
        for inner in ("additionalProperties", "items"):
            if isinstance(table.get(inner), dict):
                found += keys(table[inner])
        return found

    named = keys(schema())
    assert {"joint", "zero", "disagreement", "stall", "down", "time", "bauds"} <= set(named)
    assert {name for name in named if name not in FULL} == set()


def test_the_schema_is_shipped_and_printed() -> None:
    assert json.loads(shipped()) == schema()
    assert CliRunner().invoke(app, ["robot", "schema"]).stdout == shipped()
