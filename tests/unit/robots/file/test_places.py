"""Paths of ports in a robot file: relative ones begin at the folder of the file."""

from pathlib import Path

import pytest

import servobus
from servobus.errors import PortError
from servobus.robots.file.places import for_file, from_file


@pytest.mark.parametrize(("written", "here"), [("left", "arms/left"), ("../tty/1", "arms/../tty/1")])
def test_a_relative_path_begins_at_the_file(written: str, here: str) -> None:
    assert from_file(written, Path("arms")) == here
    assert for_file(here, Path("arms")) == written
    assert from_file(written, None) == written


@pytest.mark.parametrize(
    "path", ["/dev/ttyUSB0", "COM4", "socket://pi.local:3333", "virtual:rx28@1", "usb:A50285BI", "?"]
)
def test_all_else_is_what_it_says(path: str) -> None:
    assert from_file(path, Path("arms")) == path == for_file(path, Path("arms"))


def test_a_port_beside_the_file_is_looked_for_there(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text("""
[robot]
format = 1
[port.main]
path = "left"
[joint.base]
port = "main"
model = "rx28"
id = 1
""")
    with pytest.raises(PortError, match=f"{tmp_path}/left: no such port"):
        servobus.robot(file)
