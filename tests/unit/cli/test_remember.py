"""`remember`, `forget`, what `ports` shows of it, and the hint where a servo cannot say its model."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from servobus.bus.remembered import remember
from servobus.families import registry
from unit.cli.conftest import Run

PORT = "virtual:hts35h@1-4?clock=virtual"
UNKNOWN = "LX/HTS bus servo, model unknown"


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "servobus" / "models.toml"


USB3 = {
    "device": "/dev/ttyUSB3", "vid": 0x0403, "pid": 0x6001, "serial_number": "A5", "description": "FT232R",
    "hwid": "USB A5",
}  # fmt: skip


def plugged(monkeypatch: pytest.MonkeyPatch, *ports: dict[str, Any]) -> None:
    """Have these ports, and no others, plugged in."""
    made = []
    for port in ports:
        one = ListPortInfo(port["device"], skip_link_detection=True)
        vars(one).update(port)
        made.append(one)
    monkeypatch.setattr(list_ports, "comports", lambda: made)


def models(load: Callable[..., Any], *more: str) -> dict[int, str | None]:
    return {one["id"]: one["model"] for one in load("scan", PORT, "--ids", "0-5", *more)}


def test_remembered_and_forgotten(run: Run, load: Callable[..., Any]) -> None:
    assert models(load) == {1: None, 2: None, 3: None, 4: None}
    assert run("remember", PORT, "1-2,4", "HTS-35H").stdout == f"ids 1-2,4 on {PORT}: remembered as HTS-35H\n"
    run("remember", PORT, 3, "lx16a")
    assert models(load) == {1: "hts35h", 2: "hts35h", 3: "lx16a", 4: "hts35h"}
    assert models(load, "--model", "lx224") == dict.fromkeys(range(1, 5), "lx224")
    assert load("info", PORT, 3)["sheet"]["model"] == "LX-16A"
    assert run("forget", PORT, 3, "1").stdout == f"ids 1,3 on {PORT}: forgotten\n"
    assert models(load) == {1: None, 2: "hts35h", 3: None, 4: "hts35h"}
    assert run("forget", PORT).stdout == f"ids 2,4 on {PORT}: forgotten\n"
    assert models(load) == {1: None, 2: None, 3: None, 4: None}


def test_all_of_a_port(run: Run, load: Callable[..., Any]) -> None:
    assert run("remember", PORT, "all", "hts35h").stdout == f"all servos on {PORT}: remembered as HTS-35H\n"
    run("remember", PORT, 2, "lx16a")
    assert models(load) == {1: "hts35h", 2: "lx16a", 3: "hts35h", 4: "hts35h"}
    assert run("forget", PORT, "all").stdout == f"id 2, all others on {PORT}: forgotten\n"


def test_set_id_takes_it_along(run: Run, load: Callable[..., Any]) -> None:
    run("remember", PORT, 1, "hts35h")
    run("set-id", PORT, 1, 5)
    run("forget", PORT, 5)


def test_nothing_is_remembered_by_looking(run: Run, file: Path) -> None:
    run("scan", PORT, "--ids", "1")
    run("info", PORT, 1, "--model", "hts35h")
    run("ports")
    assert not file.parent.exists()


def test_the_hint(run: Run) -> None:
    said = f"no such servo can say its model; `servobus remember '{PORT}' "
    assert said in (text := run("scan", PORT, "--ids", "1-4").stderr)
    assert text.startswith("ids 1-4: ")
    assert text.count("MODEL` keeps it, --model says it once") == 1
    assert run("info", PORT, "2,4").stderr.count(f"ids 2,4: {said}2,4 MODEL`") == 1
    assert run("scan", PORT, "--ids", "1-4", "--json").stderr == ""
    run("remember", PORT, "1-3", "hts35h")
    assert run("scan", PORT, "--ids", "1-4").stderr.startswith(f"id 4: {said}4 MODEL`")
    assert run("info", PORT, "1").stderr == ""
    assert run("scan", "virtual:rx28@1?clock=virtual", "--ids", "1").stderr == ""


@pytest.mark.parametrize("verb", ["scan", "info", "doctor", "backup", "decode"])
def test_a_model_that_is_not_known_is_called_so(verb: str, run: Run) -> None:
    more = {"scan": ["--ids", "1"], "doctor": ["--ids", "1", "--reads", "5"], "info": ["1"], "backup": ["1", "-"]}
    if verb == "decode":
        text = run("decode", "55 55 01 03 1C DF").stdout
        assert "LX-16A" not in text
        assert "all its models have the same registers" in " ".join(text.split())
    else:
        text = run(verb, PORT, *more[verb]).stdout
        assert ('model = "lx"' if verb == "backup" else UNKNOWN) in text
        assert "LX-16A" not in text


def test_doctor_says_how_to_tell(run: Run) -> None:
    assert f"servobus remember '{PORT}' 1-4 MODEL" in run("doctor", PORT, "--ids", "1-5", "--reads", "5").stdout
    run("remember", PORT, "all", "hts35h")
    text = run("doctor", PORT, "--ids", "1-5", "--reads", "5").stdout
    assert "HTS-35H ids 1, 2, 3, 4" in text
    assert "remember" not in text


def test_a_backup_of_an_unknown_one_goes_back(run: Run, tmp_path: Path) -> None:
    saved = tmp_path / "lx.toml"
    run("backup", PORT, 1, saved)
    assert "has these settings already" in run("restore", PORT, 1, saved).stdout
    text = saved.read_text(encoding="utf-8")
    saved.write_text(text.replace("max_voltage = 14000", "max_voltage = 13500"), encoding="utf-8")
    for model in ([], ["--model", "hts35h"]):
        assert "restored max_voltage" in run("restore", PORT, 1, saved, "--yes", *model).stdout


# ports


def test_ports_shows_it_under_its_adapter(run: Run, load: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    plugged(monkeypatch, USB3)
    run("remember", "virtual:lx16a@1", "1-3", "lx16a")
    remember("0403:6001 serial number A5", "FT232R", [4, 5, 9], registry.model("hts35h"))
    remember("0403:6001 serial number A5", "FT232R", None, registry.model("lx16a"))
    assert run("ports").stdout.splitlines() == [
        "/dev/ttyUSB3  FT232R  USB A5",
        "    all others: LX-16A, remembered",
        "    ids 4-5,9: HTS-35H, remembered",
        "virtual:lx16a@1  not listed here",
        "    ids 1-3: LX-16A, remembered",
    ]
    assert load("ports") == [
        {
            "port": "/dev/ttyUSB3",
            "description": "FT232R",
            "hardware": "USB A5",
            "remembered": {"all": "lx16a", "4": "hts35h", "5": "hts35h", "9": "hts35h"},
            "listed": True,
        },
        {
            "port": "virtual:lx16a@1",
            "description": "",
            "hardware": "",
            "remembered": {"1": "lx16a", "2": "lx16a", "3": "lx16a"},
            "listed": False,
        },
    ]


def test_what_an_adapter_that_is_not_plugged_in_is_called_can_be_forgotten(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugged(monkeypatch)
    remember("0403:6001 serial number A5", "FT232R", [4], registry.model("hts35h"))
    assert "0403:6001 serial number A5  FT232R  not listed here" in run("ports").stdout
    assert run("forget", "0403:6001 serial number A5").stdout == "id 4 on 0403:6001 serial number A5: forgotten\n"


def test_a_damaged_file_is_told_and_does_no_harm(run: Run, refused: Callable[..., str], file: Path) -> None:
    file.parent.mkdir()
    file.write_text('["x"]\n1 = lx16a\n', encoding="utf-8")
    for looks in (["ports"], ["scan", PORT, "--ids", "1"]):
        text = run(*looks).stderr
        assert text.count(f"servobus: {file}, line 2: ") == 1
        assert "it is left out" in text
    for words in (("remember", PORT, "1", "lx16a"), ("forget", PORT)):
        assert f"{file}, line 2: " in refused(*words)
    assert file.read_text(encoding="utf-8") == '["x"]\n1 = lx16a\n'


# What is refused


@pytest.mark.parametrize(
    ("words", "code", "why"),
    [
        (("remember", PORT, "1"), 2, "say ID... and MODEL"),
        (("remember", PORT, "lx16a", "1"), 2, "is no id"),
        (("remember", PORT, "254", "lx16a"), 1, "broadcast id"),
        (("remember", PORT, "1", "lx99"), 1, "no model 'lx99'"),
        (("remember", PORT, "1", "rx28"), 1, "RX-28 servos say themselves what they are"),
        (("remember", PORT, "1", "lx"), 1, "lx is no model"),
        (("remember", PORT, "1", "all", "lx16a"), 2, "either ids or `all`"),
        (("remember", "/dev/ttyUSB77", "1", "lx16a"), 1, "/dev/ttyUSB77: no such port"),
        (("remember", "socket://x", "1", "lx16a"), 1, "write socket://HOST:PORT"),
        (("forget", PORT, "1"), 1, f"nothing is remembered of id 1 on {PORT}"),
        (("forget", PORT), 1, f"nothing is remembered of all servos on {PORT}"),
        (("forget", PORT, "x"), 2, "is no id"),
    ],
)
def test_what_is_refused(words: tuple[str, ...], code: int, why: str, refused: Callable[..., str], file: Path) -> None:
    assert why in " ".join(refused(*words, code=code).split())
    assert not file.exists()
