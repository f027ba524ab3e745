"""What a start loads: that of `import servobus` and of the commands. Not how long it takes: that is the bench's."""

import json
import subprocess
import sys

import pytest

from unit.cli.conftest import RX

TOOLS = {"click", "rich", "serial", "matplotlib", "asyncio"}
"""What only some of all programs need."""
SLOW = {"dataclasses", "inspect", "tomllib", "datetime", "string", "difflib", "socket", "subprocess", "json"}
"""Modules of Python's own that take long to import, or bring others along."""
OWN = {
    "servobus.virtual",
    "servobus.bus.asyncio",
    "servobus.cli",
    "servobus.transports.serial_port",
    "servobus.cli.response",
}


def loaded_by(script: str) -> set[str]:
    """Run a script in a fresh interpreter and tell which modules it loaded."""
    script = f"import sys\nbare = set(sys.modules)\n{script}\nloaded = set(sys.modules) - bare\n"
    script += "import json\nprint(json.dumps(list(loaded)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def loaded_by_command(*args: str) -> set[str]:
    return loaded_by(
        "import io, contextlib\n"
        "from servobus.cli import main\n"
        f"sys.argv = ['servobus', *{list(args)!r}]\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "    main()"
    )


def test_importing_servobus_loads_the_driver_and_little_else() -> None:
    modules = loaded_by("import servobus")
    assert "servobus.bus.blocking" in modules
    assert not modules & (TOOLS | SLOW | OWN)


def test_help_loads_click_and_little_else() -> None:
    modules = loaded_by_command("--help")
    assert {"click", "servobus.cli.app"} <= modules
    assert not modules & (TOOLS - {"click"} | OWN - {"servobus.cli"})
    assert {name for name in modules if name.startswith("servobus.cli.")} == {"servobus.cli.app"}


def test_the_entry_point_itself_loads_nothing() -> None:
    assert "click" not in loaded_by("import servobus.cli")


def test_reading_a_virtual_servo_needs_neither_rich_nor_serial_nor_asyncio() -> None:
    modules = loaded_by_command("read", RX, "1", "present_position")
    assert "servobus.virtual.serve.inprocess" in modules
    assert not modules & (TOOLS - {"click"})


@pytest.mark.parametrize(
    ("late", "script"),
    [
        ("tomllib", "servobus.Backup.parse('')"),
        ("difflib", "servobus.RX28.register('punsh')"),
    ],
)
def test_what_is_imported_late_is_there_when_needed(late: str, script: str) -> None:
    script = f"import contextlib, servobus\nwith contextlib.suppress(servobus.ServobusError):\n    {script}"
    assert late in loaded_by(script)
