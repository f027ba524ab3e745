import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from servobus import __version__
from servobus.cli.app import VERBS
from unit.cli.conftest import RX, Run
from unit.cli.verbs import EXPLAINED, PATHS


def test_help_lists_every_verb_under_its_purpose(run: Run) -> None:
    text = run("--help").stdout
    for heading, verbs in VERBS.items():
        assert f"{heading}:" in text
        for name, (_, meaning) in verbs.items():
            assert any(line.split()[:1] == [name] and line.endswith(meaning) for line in text.splitlines())


def test_help_fits_80_columns(run: Run) -> None:
    for args in ([], *(path.split() for path in PATHS)):
        for line in run(*args, "--help").stdout.splitlines():
            assert len(line) <= 80, line


@pytest.mark.parametrize("name", EXPLAINED)
def test_every_verb_explains_itself_with_examples(run: Run, name: str) -> None:
    text = run(*name.split(), "--help").stdout
    examples = text.partition("Examples:\n")[2].splitlines()
    assert examples
    assert any(line.strip().startswith(f"servobus {name}") for line in examples)
    assert text.split("\n\n")[1].strip()


def test_version(run: Run) -> None:
    assert run("--version").stdout == f"servobus {__version__}\n"


def test_a_misspelt_verb_is_answered_with_the_right_one(refused: Callable[..., str]) -> None:
    assert "did you mean 'scan'?" in refused("scna", code=2)
    assert "--help` lists them all" in refused("xyzzy", code=2)


def test_an_unknown_option_is_a_usage_error(refused: Callable[..., str]) -> None:
    assert "--nope" in refused("scan", RX, "--nope", code=2)


def test_python_dash_m() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "servobus", "read", "/no/such/port", "1", "id"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "servobus: /no/such/port: no such port; `servobus ports` lists what is plugged in\n"


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = f"{sys.executable} -m servobus registers drs0602 --json | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[\n", "")


@pytest.mark.parametrize("command", ["info", "read"])
def test_a_terminal_that_knows_only_ascii(command: str) -> None:
    # How the degree sign comes out is up to click and rich; that it is no reason to fail is ours.
    names = ["present_temperature"] if command == "read" else []
    done = subprocess.run(
        [sys.executable, "-m", "servobus", command, RX, "1", *names],
        capture_output=True, check=True, env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert b"present_temperature" in done.stdout
    assert done.stderr == b""
