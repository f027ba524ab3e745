import subprocess
import sys

import pytest

from servobus.core.present import json_value, register_entry, unit_text, value_entry, value_text, writable_text
from servobus.core.registers import U8, U16, Access, Area, Register
from servobus.core.units import Quantity, Switch, deg
from servobus.families.dynamixel.places import Address
from servobus.families.model import Model


class Table(Model):
    angle = Register(Address(30), U16, Quantity("rad", 0.5 * deg), "Where to go.", limits=(0, 600), default=300)
    light = Register(Address(25), U8, Switch(), "The LED.", default=0)
    heat = Register(Address(43), U8, Quantity("degC", 1.0), "How warm it is.", access=Access.READ)
    model = Register(
        Address(0), U16, Quantity("", 1.0), "Its number.", access=Access.READ, area=Area.EEPROM, default=28
    )
    goal = angle


def test_a_value_is_told_in_the_unit_people_use() -> None:
    assert value_entry(Table.angle, 180) == {"value": 90.0, "unit": "°", "raw": 180}
    assert value_text(Table.angle, 180) == "90.0°"
    assert (json_value(Table.light, 1), unit_text(Table.light), value_text(Table.light, 1)) == (True, "", "on")


def test_a_row_as_an_entry() -> None:
    entry = register_entry(Table.angle)
    assert entry["aliases"] == ["goal"]
    assert (entry["address"], entry["size"], entry["area"], entry["access"]) == (30, 2, "ram", "rw")
    assert (entry["limits"], entry["default"], entry["unit"]) == ([0.0, 300.0], 150.0, "°")
    assert entry["raw"] == {"limits": [0, 600], "allowed": None, "default": 300}
    assert register_entry(Table.heat)["limits"] is None


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (Table.angle, "0.0° .. 300.0°; factory setting 150.0°"),
        (Table.light, "on or off; factory setting off"),
        (Table.heat, ""),
    ],
)
def test_what_can_be_written(row: Register[object], said: str) -> None:
    assert writable_text(row) == said


def test_presenters_load_neither_click_nor_rich() -> None:
    """A web server uses them too, and need not have the command line's packages."""
    code = (
        "import sys, servobus.core.present, servobus.families.present, servobus.traffic.present; "
        "print(sorted({'click', 'rich', 'servobus.cli'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
