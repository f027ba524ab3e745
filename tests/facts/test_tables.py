"""Every row of every table, and every figure of every sheet, against the facts beside this file."""

import csv
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servobus import MODELS
from servobus.core.registers import Access, Area, Register
from servobus.core.units import Quantity
from servobus.families.base import Model
from servobus.families.dynamixel.places import Address
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.lewansoul.places import Pair
from servobus.families.model import Confidence

HERE = Path(__file__).parent
DECISIONS = (HERE.parents[1] / "docs" / "decisions.md").read_text(encoding="utf-8")

Row = dict[str, str]

SI = {
    "deg": ("rad", math.pi / 180),
    "rpm": ("rad/s", 2 * math.pi / 60),
    "deg/s": ("rad/s", math.pi / 180),
    "deg/s2": ("rad/s2", math.pi / 180),
    "us": ("s", 1e-6),
    "ms": ("s", 1e-3),
    "mV": ("V", 1e-3),
    "percent": ("1", 0.01),
    "ratio": ("1", 1.0),
    "pwm": ("1", 1 / 1023),
    "gain": ("", 1.0),
}
"""Unit of a source -> unit of servobus, and what one is worth in it."""


def rows(name: str) -> list[Row]:
    with (HERE / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def number(text: str) -> int | None:
    return int(text) if text else None


DECIDED: dict[tuple[str, str, str], str] = {
    ("*", "lowest_limit_voltage", "max"): "ED-40",
    ("*", "highest_limit_voltage", "max"): "ED-40",
    ("*", "cw_compliance_margin", "max"): "ED-45",
    ("*", "ccw_compliance_margin", "max"): "ED-45",
    ("*", "goal_position", "min"): "ED-48",
    ("*", "goal_position", "max"): "ED-48",
    ("*", "min_voltage", "default"): "EL-29",
    ("*", "min_voltage", "max"): "EL-29",
    ("*", "max_voltage", "default"): "EL-29",
    ("*", "max_voltage", "max"): "EL-29",
    ("ax12w", "highest_limit_temperature", "max"): "ED-46",
    ("rx28", "highest_limit_temperature", "min"): "ED-46",
    ("rx28", "highest_limit_temperature", "max"): "ED-46",
    ("rx28", "highest_limit_voltage", "default"): "ED-12",
    ("rx28", "cw_compliance_margin", "default"): "ED-45",
    ("rx28", "ccw_compliance_margin", "default"): "ED-45",
    ("rx28", "cw_compliance_slope", "min"): "ED-45",
    ("rx28", "ccw_compliance_slope", "min"): "ED-45",
    ("rx28", "registered_instruction", "access"): "ED-16",
    ("rx28", "sheet", "voltage"): "ED-12",
    ("rx28", "sheet", "nominal"): "ED-12",
    ("rx28", "18.5 V", "voltage"): "ED-12",
    ("drs0101", "overload_pwm_threshold", "default"): "EH-50",
    ("drs0201", "overload_pwm_threshold", "default"): "EH-50",
    ("drs0401", "overload_pwm_threshold", "max"): "EH-50",
    ("drs0601", "overload_pwm_threshold", "max"): "EH-50",
    ("lx16a", "6 V", "speed"): "EL-27",
    ("lx16a", "6.6 V", "voltage"): "EL-27",
    ("lx16a", "7.4 V", "torque"): "EL-27",
}
"""Model ("*" for all), register and column in which the table differs from its facts -> the decision that says why."""


def decided(model: str, register: str, column: str) -> str | None:
    return DECIDED.get((model, register, column)) or DECIDED.get(("*", register, column))


class Differences:
    """What differs between a row of a table and its facts, less what was decided."""

    def __init__(self, model: str, register: str) -> None:
        self.model, self.register = model, register
        self.found: list[str] = []

    def expect(self, column: str, ours: object, fact: object) -> None:
        """Compare; a decision must be about a real difference."""
        why = decided(self.model, self.register, column)
        if ours != fact and why is None:
            self.found.append(f"{column}: {ours!r}, where the source says {fact!r}")
        if ours == fact and (self.model, self.register, column) in DECIDED:
            self.found.append(f"{column}: {why} is about no difference")

    def expect_step(self, row: Register[Any], fact: Row) -> None:
        if not fact["step"] or fact["unit"] in ("position unit", "pwm per position unit"):
            return
        unit, size = SI.get(fact["unit"], (fact["unit"], 1.0))
        assert isinstance(row.scale, Quantity), f"{row}: no unit, where the source has {fact['unit']}"
        same = row.unit == unit and math.isclose(row.scale.step, float(fact["step"]) * size, rel_tol=0.004)
        self.expect("step", (row.unit, row.scale.step) if not same else "as told", "as told")


def turns_endlessly(row: Register[Any]) -> bool:
    """Tell whether the model of a row turns without end, for which a speed has a direction."""
    return row.owner is not None and issubclass(row.owner, Model) and row.owner.turns


def common(found: Differences, row: Register[Any], fact: Row) -> None:
    """Compare what the tables of all families have."""
    found.expect("size", row.layout.size, int(fact["size"]))
    found.expect("access", row.writable, fact["access"] == "RW")
    if fact["default"]:
        found.expect("default", row.default, int(fact["default"]))
    if row.writable and fact["min"] and row.layout.sign_bit is not None:
        magnitude = (1 << row.layout.sign_bit) - 1  # sources count the sign bit, or leave it out
        lowest = -magnitude if turns_endlessly(row) else 0
        found.expect("max", row.limits, (lowest, int(fact["max"]) & magnitude))
    elif row.writable and fact["min"]:
        found.expect("min", row.limits[0], int(fact["min"]))
        found.expect("max", row.limits[1], int(fact["max"]))
    found.expect_step(row, fact)


def dynamixel(model: type[Model], fact: Row) -> list[str]:
    row, found = model.register(fact["register"]), Differences(model.key(), fact["register"])
    assert isinstance(row.place, Address)
    found.expect("address", row.place.address, int(fact["address"]))
    found.expect("area", row.area is Area.EEPROM, fact["area"] == "eeprom")
    sign = {10: "bit 10", None: "two's complement" if row.layout.signed else ""}[row.layout.sign_bit]
    if fact["sign"]:
        found.expect("sign", sign, fact["sign"])
    common(found, row, fact)
    return found.found


def herkulex(model: type[Model], fact: Row) -> list[str]:
    found = Differences(model.key(), fact["register"])
    place = number(fact["eep"]), number(fact["ram"])
    if fact["access"] == "-":
        reserved = {tuple(row.place.within(space) for space in (EEP, RAM)): row for row in model.registers.values()}
        row = reserved.get(place)
        found.expect("access", row and row.access, Access.RESERVED)
        return found.found
    row = model.register(fact["register"])
    found.expect("eep", row.place.within(EEP), number(fact["eep"]))
    found.expect("ram", row.place.within(RAM), number(fact["ram"]))
    if fact["values"]:
        found.expect("values", sorted(row.allowed or ()), sorted(map(int, fact["values"].split())))
    found.expect("signed", row.layout.signed, fact["signed"] == "yes")
    common(found, row, fact)
    return found.found


def lewansoul(model: type[Model], fact: Row) -> list[str]:
    row, found = model.register(fact["register"]), Differences(model.key(), fact["register"])
    assert isinstance(row.place, Pair)
    found.expect("commands", (row.place.write, row.place.read), (number(fact["write"]), number(fact["read"])))
    found.expect("byte", row.place.at, int(fact["byte"]))
    found.expect("signed", row.layout.signed, fact["signed"] == "yes")
    found.expect("area", row.area is Area.EEPROM, fact["area"] == "eeprom")
    common(found, row, fact)
    return found.found


def facts() -> Iterator[tuple[str, Row]]:
    """Give each row of the facts, with the model that it is about."""
    for name in ("dynamixel.csv", "herkulex.csv"):
        yield from ((row["model"], row) for row in rows(name))
    for row in rows("lewansoul.csv"):
        yield from ((key, row) for key, model in MODELS.items() if model.family.name == "lewansoul")


COMPARE = {"dynamixel": dynamixel, "herkulex": herkulex, "lewansoul": lewansoul}


@pytest.mark.parametrize("key", MODELS)
def test_every_row_is_what_the_sources_say(key: str) -> None:
    model = MODELS[key]
    about = [fact for known, fact in facts() if known == key]
    assert about, f"no facts of {model.title}"
    differences = {fact["register"]: found for fact in about if (found := COMPARE[model.family.name](model, fact))}
    assert not differences


@pytest.mark.parametrize("key", MODELS)
def test_no_row_is_without_a_source(key: str) -> None:
    told = {fact["register"] for known, fact in facts() if known == key}
    model = MODELS[key]
    ours = {name for name, row in model.registers.items() if row.access is not Access.RESERVED}
    assert ours - told - {"reserved_19"} == set()


def test_every_model_of_the_sources_is_known() -> None:
    assert {row["model"] for row in rows("models.csv")} == set(MODELS)


def test_a_decision_stands_in_the_list_of_decisions() -> None:
    for where, name in DECIDED.items():
        assert re.search(rf"\b{name}\b", DECISIONS), f"{where}: {name}"


# The figures


@pytest.mark.parametrize("fact", rows("models.csv"), ids=lambda fact: str(fact["model"]))
def test_the_figures_of_a_model(fact: Row) -> None:
    model = MODELS[fact["model"]]
    found, sheet = Differences(fact["model"], "sheet"), model.sheet
    found.expect("title", model.title, fact["title"])
    found.expect("number", model.number, number(fact["number"]))
    found.expect("names", set(fact["other_names"].split()) - set(model.names), set())
    supply = tuple(float(fact[name]) for name in ("lowest_voltage", "highest_voltage") if fact[name])
    found.expect("voltage", sheet.voltage or (), supply)
    if fact["nominal_voltage"]:
        found.expect("nominal", sheet.nominal_voltage, float(fact["nominal_voltage"]))
    found.expect("weight", None if sheet.weight is None else round(sheet.weight * 1000, 3), _float(fact["weight_g"]))
    found.expect("gear", sheet.gear_ratio, _float(fact["gear_ratio"]))
    found.expect("range", round(math.degrees(sheet.angle), 3), _float(fact["range_deg"]))
    close = math.isclose(math.degrees(sheet.resolution), float(fact["deg_per_unit"]), rel_tol=0.004)
    found.expect("resolution", close, True)
    found.expect("id", model.register("id").default, int(fact["factory_id"]))
    if fact["confidence"]:
        told = {"H": Confidence.HIGH, "M": Confidence.MEDIUM, "L": Confidence.LOW}[fact["confidence"]]
        found.expect("confidence", sheet.confidence, told)
    assert not found.found


@pytest.mark.parametrize("fact", rows("performance.csv"), ids=lambda fact: f"{fact['model']}-{fact['voltage']}V")
def test_a_printed_point(fact: Row) -> None:
    model, volts = MODELS[fact["model"]], float(fact["voltage"])
    found = Differences(fact["model"], f"{volts:g} V")
    points = {point.voltage: point for point in model.sheet.performance}
    found.expect("voltage", volts in points, True)
    if volts in points:
        point = points[volts]
        if fact["stall_torque_nm"]:
            found.expect("torque", _close(point.stall_torque, float(fact["stall_torque_nm"])), True)
        if fact["speed_rpm"] or fact["seconds_for_60_deg"]:
            rpm = float(fact["speed_rpm"]) if fact["speed_rpm"] else 10 / float(fact["seconds_for_60_deg"])
            found.expect("speed", _close(point.speed, rpm * 2 * math.pi / 60), True)
        if fact["stall_current_a"]:
            found.expect("current", point.stall_current, float(fact["stall_current_a"]))
    assert not found.found


def _float(text: str) -> float | None:
    return float(text) if text else None


def _close(ours: float | None, fact: float) -> bool:
    return ours is not None and math.isclose(ours, fact, rel_tol=0.005)
