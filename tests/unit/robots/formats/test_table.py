"""The table of formats: what it says is so, and a file is known by what is in it."""

import json
from contextlib import suppress
from copy import deepcopy
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import extent
from servobus import FormatError, PortError, UnknownName
from servobus.robots import opening
from servobus.robots.file.reading import read_text
from servobus.robots.formats.base import ALL, Given
from servobus.robots.formats.draft import draft_text
from servobus.robots.formats.table import FORMATS, by_name, recognised
from unit.robots.arms import SIX


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.write])
def test_what_is_written_is_recognised(name: str) -> None:
    write = FORMATS[name].write
    assert write is not None
    made = write(read_text(SIX))
    assert recognised(made.text.encode(), "x").name == name


def test_strange_files_are_refused_with_the_names_of_all() -> None:
    for data in (b"", b"{}", b"PK\x03\x04", b"[robot]\nformat = 1\n"):
        with pytest.raises(
            FormatError, match=r"--format: lerobot .*, pypot .*, robotis .*, ros2_control .*, urdf .*, d6a"
        ):
            recognised(data, "x")


def test_a_name_that_is_none() -> None:
    with pytest.raises(UnknownName, match="no format 'klipper'; there are lerobot"):
        by_name("klipper")
    with pytest.raises(UnknownName, match="other way only"):
        by_name("d6a", ["lerobot"])


def test_each_goes_some_way() -> None:
    for one in FORMATS.values():
        assert one.write or one.new or one.onto


def test_an_open_port_asks_for_its_path() -> None:
    text = '[robot]\nformat = 1\n[port.arm]\npath = "?"\n[joint.a]\nport = "arm"\nmodel = "rx28"\nid = 1\n'
    with pytest.raises(PortError, match="port arm: its path is not known yet"):
        opening.robot(read_text(text))


NAUGHTY: st.SearchStrategy[Any] = st.sampled_from([None, True, -1, 5, 1e308, 10**30, "", "a b", "\x07", [], {}, [1, 2]])
THEIRS: dict[str, Any] = {
    "lerobot": {"wrist": {"id": 1, "drive_mode": 0, "homing_offset": 0, "range_min": 100, "range_max": 900}},
    "pypot": {
        "controllers": {"arm": {"port": "auto", "sync_read": False, "attached_motors": ["all"], "protocol": 1}},
        "motorgroups": {"all": ["wrist"]},
        "motors": {"wrist": {"id": 1, "type": "MX-28", "orientation": "x", "offset": 1.0, "angle_limit": [-90, 90]}},
    },
    "move": {"framerate": 50.0, "positions": {"0.0": {"wrist": [1.5, 0.0]}, "1.0": {"wrist": [2.5, 0.0]}}},
}


def places(said: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Give the paths of all values in what a file says."""
    inside = said.items() if isinstance(said, dict) else enumerate(said) if isinstance(said, list) else ()
    return [before, *(path for key, value in inside for path in places(value, (*before, key)))]


@settings(deadline=None, max_examples=200 if extent.everything else 15)
@given(data=st.data(), name=st.sampled_from(sorted(THEIRS)))
def test_whatever_stands_in_a_file_it_is_taken_or_refused(data: st.DataObject, name: str) -> None:
    said = {"it": deepcopy(THEIRS[name])}
    path: tuple[Any, ...] = ("it", *data.draw(st.sampled_from(places(THEIRS[name]))))
    table: Any = said
    for parent in path[:-1]:
        table = table[parent]
    table[path[-1]] = data.draw(NAUGHTY)
    text = json.dumps(said["it"]).encode()
    one, told = FORMATS[name], Given("x.json", models={ALL: "mx28"})
    with suppress(FormatError):
        if one.new is not None:
            read_text(draft_text(one.new(text, told), "arm"))
    with suppress(FormatError):
        if one.onto is not None:
            one.onto(text, read_text(SIX), told)
