"""M12: what the Tab key offers."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.shell_completion import BashComplete, CompletionItem, FishComplete, ZshComplete
from serial.tools import list_ports

from servobus import FAMILIES, LX16A, MODELS, RX28
from servobus.cli import complete
from servobus.cli.app import app
from servobus.cli.complete_bash import WholeWords
from unit.cli.verbs import NAMES

SHELLS = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}


def offered(*words: str) -> list[str]:
    """Give what is offered for the last word."""
    return [item.value for item in items(*words)]


def items(*words: str) -> list[CompletionItem]:
    shell = BashComplete(app, {}, "servobus", "_SERVOBUS_COMPLETE")
    return shell.get_completions(list(words[:-1]), words[-1])


def test_M12_verbs_and_options() -> None:
    assert offered("") == list(NAMES)
    assert offered("re") == [name for name in NAMES if name.startswith("re")]
    assert set(offered("read", "arm", "1", "--")) >= {"--watch", "--csv", "--family", "--json"}


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Port:
        description = "FT232R"

        def __init__(self, device: str) -> None:
            self.device = device

    (tmp_path / "usb-FTDI_A1").touch()
    monkeypatch.setattr(list_ports, "comports", lambda: [Port("/dev/ttyUSB0"), Port("COM4")])
    monkeypatch.setattr(complete, "BY_ID", tmp_path)


VERBS_ON_PORTS = (
    "scan", "doctor", "info", "read", "plot", "sniff", "move", "turn", "stop", "torque", "rearm", "led",
    "write", "set-id", "set-baud", "backup", "restore", "reset", "reboot",
)  # fmt: skip


@pytest.mark.parametrize("verb", VERBS_ON_PORTS)
def test_M12_ports(verb: str, plugged: None, tmp_path: Path) -> None:
    every = offered(verb, "")
    assert every[:3] == ["/dev/ttyUSB0", "COM4", str(tmp_path / "usb-FTDI_A1")]
    assert every[3:] == [f"virtual:{name}@1" for name in MODELS]
    assert offered(verb, "C") == ["COM4"]
    assert offered(verb, "vir") == every[3:]


@pytest.mark.parametrize("begun", ["/dev/tty", "/tmp/ar", "./ar", "arm"])
def test_M12_files_stay_what_they_are(begun: str, plugged: None) -> None:
    (item,) = items("scan", begun)
    assert (item.type, item.value) == ("file", begun)


def test_M12_models_and_families() -> None:
    for words in (("read", "arm", "--model", ""), ("registers", ""), ("decode", "--model", ""), ("step", "")):
        assert offered(*words) == list(MODELS)
    for words in (("read", "arm", "--family", ""), ("decode", "--family", "")):
        assert offered(*words) == list(FAMILIES)
    assert offered("virtual", "rx") == [f"{name}@1" for name in MODELS if name.startswith("rx")]
    assert {"rx10@1", "rx24f@1", "rx28@1", "rx64@1"} == set(offered("virtual", "rx"))


@pytest.mark.parametrize("verb", ["read", "plot"])
def test_M12_registers(verb: str) -> None:
    assert {"present_position", "punch", "motor_speed"} <= set(offered(verb, "arm", "1", ""))
    assert set(offered(verb, "arm", "1-4,7", "goal_")) >= {"goal_position", "goal_time"}
    of_one = set(offered(verb, "arm", "--model", "lx16a", "1", ""))
    assert of_one == {name for row in LX16A.registers.values() if row.readable for name in (row.name, *row.aliases)}
    assert "punch" not in offered(verb, "arm", "--family", "lewansoul", "1", "")
    assert "present_position" in offered(verb, "arm", "1", "led", "present_")
    assert "punch" in offered("registers", "rx28", "p")
    assert "motor_speed" not in offered("registers", "rx28", "")


def test_M12_settings_can_be_written() -> None:
    names = offered("write", "arm", "--model", "rx28", "1", "")
    assert "led=" in names
    assert all(RX28.register(name.rstrip("=")).writable for name in names)


@pytest.mark.parametrize("shell", SHELLS)
def test_M12_the_line_in_the_readme_switches_it_on(shell: str) -> None:
    readme = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
    assert f"_SERVOBUS_COMPLETE={shell}_source servobus" in readme
    done = subprocess.run(
        [sys.executable, "-c", "from servobus.cli import main; import sys; sys.argv = ['servobus']; main()"],
        env={**os.environ, "_SERVOBUS_COMPLETE": f"{shell}_source"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert f"_SERVOBUS_COMPLETE={shell}_complete" in done.stdout


def test_M12_a_shell_is_answered() -> None:
    env: Any = {**os.environ, "_SERVOBUS_COMPLETE": "bash_complete", "COMP_WORDS": "servobus led arm 1 --fam"}
    done = subprocess.run(
        [sys.executable, "-c", "from servobus.cli import main; import sys; sys.argv = ['servobus']; main()"],
        env={**env, "COMP_CWORD": "4"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert re.fullmatch(r"plain,--family\s*", done.stdout)
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("typed", "words", "offers"),
    [
        # how bash 5 breaks what is typed, from its manual: COMP_WORDBREAKS has : and =
        ("read virtual:drs060", ["read", "virtual", ":", "drs060"], "drs0602@1"),
        ("read virtual:", ["read", "virtual", ":"], "rx28@1"),
        ("write virtual:rx28@1 1 lock", ["write", "virtual", ":", "rx28@1", "1", "lock"], "lock="),
        (
            "write virtual:rx28@1 1 led=on lock",
            ["write", "virtual", ":", "rx28@1", "1", "led", "=", "on", "lock"],
            "lock=",
        ),
        ("read x --family=dyn", ["read", "x", "--family", "=", "dyn"], "dynamixel"),
        ("rea", ["rea"], "read"),
    ],
)
def test_M12_bash_breaks_words_and_they_are_put_together(
    typed: str, words: list[str], offers: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COMP_WORDS", "\n".join(["servobus", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    shell = WholeWords(app, {}, "servobus", "_SERVOBUS_COMPLETE")
    args, incomplete = shell.get_completion_args()
    assert " ".join([*args, incomplete]) == typed
    assert f"plain,{offers}" in shell.complete().splitlines()
    assert "compopt -o nospace" in shell.source_template
