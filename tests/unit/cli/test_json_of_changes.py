"""--json of the commands that change something: `id`, `baud` and settings as `write` tells them, old and new."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from samples import every_model, sample_models
from servobus import MODELS
from unit.cli.conftest import Run


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


@every_model
def test_set_id(load: Callable[..., Any], key: str) -> None:
    assert load("set-id", f"virtual:{key}@1?clock=virtual", 1, 7) == {"id": {"old": 1, "new": 7, "unit": ""}}


def test_set_baud(load: Callable[..., Any], refused: Callable[..., str]) -> None:
    port = "virtual:rx28@1?clock=virtual"
    assert load("set-baud", port, 1, 500000) == {"baud": {"old": 57600, "new": 500000, "unit": "baud"}}
    assert "-5 is not a speed in baud: give a whole number" in refused("set-baud", port, 1, -5)


@sample_models
def test_backup_and_restore(load: Callable[..., Any], refused: Callable[..., str], key: str) -> None:
    port = f"virtual:{key}@1,2?clock=virtual&state=state.json"
    saved = load("backup", port, 1, "a.toml", "--model", key)
    assert saved == {"file": "a.toml", "settings": saved["settings"]}
    assert Path("a.toml").read_text().count(" = ") >= saved["settings"] > 5
    both = load("backup", port, "1,2", "--model", key)
    assert [(one["model"], one["id"], one["file"]) for one in both] == [
        (key, id, f"{key}-id{id}.toml") for id in (1, 2)
    ]
    assert "prints the settings themselves" in refused("backup", port, 1, "-", "--json", code=2)

    assert load("restore", port, 1, "a.toml", "--yes") == {}
    load("write", port, 1, "max_position=100", "--save")
    found = load("read", port, 1, "max_position")["max_position"]
    row = MODELS[key].register("max_position")
    assert load("restore", port, 1, "a.toml", "--yes") == {
        row.name: {
            "old": found["value"],
            "new": load("read", port, 1, "max_position")["max_position"]["value"],
            "unit": "°",
        }
    }
    assert "say --yes too" in refused("restore", port, 1, "a.toml", "--json", code=2)


@pytest.mark.parametrize(
    ("key", "option", "told"),
    [
        ("rx28", ("--output", 30), {"output": {"value": 30.0, "unit": "%"}}),
        ("drs0602", ("--speed", -90), {"speed": {"value": -90.0, "unit": "°/s"}}),
    ],
)
def test_turn(load: Callable[..., Any], key: str, option: tuple[Any, ...], told: dict[str, Any]) -> None:
    port = f"virtual:{key}@1?clock=virtual"
    assert load("turn", port, 1, *option) == {"turning": True, **told}
    assert load("turn", port, 1, "--end") == {
        "turning": False, "position": {"value": pytest.approx(150 if key == "rx28" else 0, abs=0.5), "unit": "°"},
    }  # fmt: skip


@sample_models
def test_torque(load: Callable[..., Any], run: Run, key: str) -> None:
    port = f"virtual:{key}@1,2?clock=virtual"
    family = MODELS[key].family.name
    assert load("torque", port, 1, "on") == {"torque": True}
    assert load("torque", port, "1,2", "off", "--model", key) == [
        {"family": family, "model": key, "id": id, "baud": MODELS[key].factory_baud, "torque": False} for id in (1, 2)
    ]
    told = load("torque", port, "all", "off", "--family", family)
    assert told["torque"] is False
    assert [one["family"] for one in told["told"]] == [family]
    assert MODELS[key].factory_baud in told["told"][0]["bauds"]


def test_who_comes_in_to_its_limits_says_where_that_ended(run: Run, load: Callable[..., Any]) -> None:
    """The RX-28 starts at 150° (its middle); 341 of 1023 is 100° (3-4-1, 300° in 1023 steps)."""
    port = "virtual:rx28@1,ccw_angle_limit=341?clock=virtual"
    assert run("torque", port, 1, "on", "--to-limit").stdout == "RX-28 id 1: torque on, holds 100.0°\n"
    assert load("torque", port, 1, "on", "--to-limit") == {"torque": True, "position": {"value": 100.0, "unit": "°"}}
