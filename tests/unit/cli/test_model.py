"""--model: what a servo is that cannot say it itself. Two models that are no part of servobus serve for that."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from servobus import LX16A, RX28, deg
from servobus.families import registry
from servobus.families.model import Performance, SpecSheet
from unit.cli.conftest import Run


class LX924(LX16A):
    title = "LX-924"


class AX912(RX28):
    """The AX-12A of the ROBOTIS e-manual, under a name and a number that no real model has."""

    title, number, factory_baud = "AX-912", 912, 1_000_000
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 1.5, 354 * deg),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 70.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.0546,
        size=(0.032, 0.050, 0.040),
        gear_ratio=254,
        standby_current=0.050,
        link="TTL, half duplex, 8N1, 7843 bit/s to 1 Mbit/s",
    )
    highest_limit_temperature = RX28.highest_limit_temperature.with_(default=70)
    highest_limit_voltage = RX28.highest_limit_voltage.with_(default=140)


LX = "virtual:lx16a@1,2,rx28@3?clock=virtual"


@pytest.fixture(autouse=True)
def more_models() -> Iterator[None]:
    registry.add(LX924, AX912)
    yield
    for model in (LX924, AX912):
        del registry.MODELS.entries[model.key()]


def test_it_says_what_a_servo_is(run: Run, load: Callable[..., Any]) -> None:
    assert load("info", LX, 1, "--model", "lx924")["model"] == "lx924"
    assert load("info", LX, 1)["model"] is None
    found = load("scan", LX, "--ids", "0-4", "--model", "LX-924")
    assert [(one["model"], one["id"]) for one in found] == [("lx924", 1), ("lx924", 2)]
    assert "LX-924 id 1" in run("move", LX, "1=90", "2=90", "--model", "lx924").stdout
    assert "LX-924 id 2: torque off" in run("torque", LX, 2, "off", "--model", "lx924").stdout
    assert "LX-924 id 1 stopped: " in run("stop", LX, "all", "--model", "lx924").stdout
    assert "LX-924 ids 1, 2" in run("doctor", LX, "--ids", "0-4", "--reads", 20, "--model", "lx924").stdout


def test_its_factory_speed_is_asked_alone(run: Run) -> None:
    port = "virtual:ax912@1,rx28@2?clock=virtual"
    assert "AX-912 id 1 at 1000000" in run("scan", port, "--ids", "0-3", "--model", "ax912").stdout
    assert "RX-28" not in run("scan", port, "--ids", "0-3", "--model", "ax912").stdout
    assert "AX-912 id 1 at 1000000" in run("scan", port, "--ids", "0-3").stdout
    assert "torque off: told all ids\n  dynamixel at 57600, 1000000, 115200" in (
        run("torque", port, "all", "off", "--model", "ax912").stdout
    )


def test_N13_one_id_at_two_speeds(refused: Callable[..., str], load: Callable[..., Any]) -> None:
    port = "virtual:ax912@1,rx28@1?clock=virtual"
    said = refused("read", port, 1, "led", "--baud", "all", "--family", "dynamixel")
    assert "--family dynamixel --baud 57600 or --family dynamixel --baud 1000000" in said
    assert load("info", port, 1, "--baud", "1000000")["model"] == "ax912"


def test_what_the_servo_says_itself_counts_more(refused: Callable[..., str]) -> None:
    port = "virtual:ax912@1?clock=virtual&baud=57600"
    assert "id 1 says that it is AX-912, not RX-28" in refused("read", port, 1, "led", "--model", "rx28")


def test_it_is_checked_before_the_port_is_opened(refused: Callable[..., str]) -> None:
    assert "no model 'lx999'" in refused("read", "/dev/nowhere", 1, "led", "--model", "lx999", code=2)
    said = refused("read", "/dev/nowhere", 1, "led", "--model", "lx16a", "--family", "herkulex", code=2)
    assert "LX-16A is of the family lewansoul, not herkulex" in said


def test_help_names_the_families(run: Run) -> None:
    for verb in ("read", "scan", "doctor"):
        said = " ".join(run(verb, "--help").stdout.split())
        assert "Look only for dynamixel, herkulex or lewansoul servos." in said
        assert "--model MODEL" in said
    assert "dynamixel, herkulex or lewansoul; else all of them are looked for." in " ".join(
        run("decode", "--help").stdout.split()
    )
