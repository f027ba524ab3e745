"""The table of formats: what it says is so, and a file is known by what is in it."""

import pytest

from servobus import FormatError, PortError, UnknownName
from servobus.robots import opening
from servobus.robots.file.reading import read_text
from servobus.robots.formats.table import FORMATS, by_name, recognised
from unit.robots.arms import SIX


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.write])
def test_what_is_written_is_recognised(name: str) -> None:
    write = FORMATS[name].write
    assert write is not None
    made = write(read_text(SIX))
    assert recognised(made.text.encode(), "x").name == {"ros2_control": "urdf"}.get(name, name)


def test_strange_files_are_refused_with_the_names_of_all() -> None:
    for data in (b"", b"{}", b"PK\x03\x04", b"[robot]\nformat = 1\n"):
        with pytest.raises(FormatError, match=r"--format: lerobot .*, pypot .*, robotis .*, urdf .*, d6a .*, move"):
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
