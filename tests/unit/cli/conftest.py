import json
from collections.abc import Callable
from typing import Any

import pytest
from click.testing import CliRunner, Result

from servobus.bus.remembered import remember
from servobus.cli.app import app
from servobus.families import registry

RX = "virtual:rx28@1-3?clock=virtual"
DRS = "virtual:drs0602@219,220?clock=virtual"
LX = "virtual:lx16a@1,2?clock=virtual"
ALL = {"dynamixel": (RX, 1), "herkulex": (DRS, 219), "lewansoul": (LX, 1)}
"""family -> a port and an id on it"""

Run = Callable[..., Result]


@pytest.fixture(scope="session", autouse=True)
def lx_is_known(no_home: None) -> None:
    """Remember that the servos on LX are LX-16A: they cannot say so."""
    remember(LX, "", None, registry.model("lx16a"))


@pytest.fixture
def run() -> Run:
    """Run a command; nothing but a planned way out may come of it."""

    def invoke(*args: str | int, code: int = 0, input: str | bytes | None = None) -> Result:
        result = CliRunner().invoke(app, [str(arg) for arg in args], input=input, prog_name="servobus")
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert result.exit_code == code, result.output
        return result

    return invoke


@pytest.fixture
def load(run: Run) -> Callable[..., Any]:
    """Run a command with --json and give what it printed."""

    def invoke(*args: str | int) -> Any:
        return json.loads(run(*args, "--json").stdout)

    return invoke


@pytest.fixture
def refused(run: Run) -> Callable[..., str]:
    """Run a command that must be refused: one line on stderr, nothing on stdout. Give the line."""

    def invoke(*args: str | int, code: int = 1, input: str | bytes | None = None) -> str:
        result = run(*args, code=code, input=input)
        assert result.stdout == ""
        if code == 1:
            assert result.stderr.startswith("servobus: ")
            assert result.stderr.count("\n") == 1
        return result.stderr

    return invoke
