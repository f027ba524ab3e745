"""`servobus serve` as a whole: two processes, a program on each way in, and what is left when one of them dies."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servobus.errors import RobotFileError, UsageError
from servobus.server.serving import buses_of

PATIENCE = 60.0
"""s; a limit against hanging, and never a measurement."""
SPEC = "virtual:rx28@1-2,lx16a@3"


def test_sources_are_ports_named_ports_and_robot_files(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text(
        '[robot]\nformat = 1\n[port.left]\npath = "/dev/ttyUSB7"\n'
        '[joint.elbow]\nport = "left"\nmodel = "rx28"\nid = 1\n',
        encoding="utf-8",
    )
    ports, robots = buses_of(
        ["/dev/ttyUSB0", "hand=/dev/ttyUSB1", str(file), SPEC, "virtual:rx28@9", "socket://pi:3333"]
    )
    assert ports == {
        "ttyUSB0": "/dev/ttyUSB0",
        "hand": "/dev/ttyUSB1",
        "left": "/dev/ttyUSB7",
        "virtual": SPEC,
        "virtual2": "virtual:rx28@9",
        "pi": "socket://pi:3333",
    }
    assert robots == {"arm": file}


def test_names_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="two buses are called a"):
        buses_of(["a=/dev/ttyUSB0", "a=/dev/ttyUSB1"])
    (tmp_path / "arm.toml").write_text("nonsense", encoding="utf-8")
    with pytest.raises(RobotFileError):
        buses_of([str(tmp_path / "arm.toml")])


@contextmanager
def serving(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """Have a server run; gives its process, and the lines that it has said."""
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder), "XDG_STATE_HOME": str(folder / "state")}
    process = subprocess.Popen(
        [sys.executable, "-m", "servobus", "serve", *options],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert process.stdout is not None
    try:
        lines = [process.stdout.readline().strip()]
        while lines[-1] and not lines[-1].startswith(("bus ", "port ")):
            lines.append(process.stdout.readline().strip())
        yield process, lines
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)
        process.stdout.close()


def told(folder: Path) -> dict[str, Any]:
    """Give what the runtime file says."""
    (path,) = (folder / "servobus").glob("server-*.json")
    said: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return said


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Give a runtime folder for this user alone."""
    tmp_path.chmod(0o700)
    return tmp_path


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_ports_alone_are_shared_and_the_end_leaves_nothing(folder: Path) -> None:
    with serving(folder, SPEC, "--no-http") as (process, lines):
        assert lines[0].startswith("ready servobus://127.0.0.1:")
        assert lines[1] == f"bus virtual {SPEC}"
        assert told(folder)["buses"] == {"virtual": SPEC}
        assert (folder / "servobus").stat().st_mode & 0o777 == 0o700
        (path,) = (folder / "servobus").glob("server-*.json")
        assert path.stat().st_mode & 0o777 == 0o600
        said = subprocess.run(
            [
                sys.executable,
                "-m",
                "servobus",
                "read",
                "servobus:///virtual",
                "1",
                "present_voltage",
                "--family",
                "dynamixel",
            ],
            env=os.environ | {"XDG_RUNTIME_DIR": str(folder)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert "V" in said.stdout, said.stderr
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
    assert not list((folder / "servobus").glob("server-*.json"))


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_the_web_process_may_die_and_comes_back_while_the_ports_go_on(folder: Path) -> None:
    pytest.importorskip("uvicorn")
    pytest.importorskip("fastapi")
    with serving(folder, SPEC, "--http", "127.0.0.1:0") as (process, lines):
        assert lines[0].startswith("ready http://127.0.0.1:")
        assert process.stdout is not None
        first = told(folder)

        def buses() -> list[dict[str, Any]]:
            request = urllib.request.Request(
                first["http"] + "/api/v1/buses", headers={"Authorization": f"Bearer {first['token']}"}
            )
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                found: list[dict[str, Any]] = json.load(answer)
                return found

        assert [(one["name"], one["port"]) for one in buses()] == [("virtual", SPEC)]
        children = subprocess.run(
            ["ps", "-o", "pid=", "--ppid", str(process.pid)], capture_output=True, text=True, check=True
        )
        os.kill(int(children.stdout.split()[0]), signal.SIGKILL)
        assert "a new one is started" in process.stdout.readline()
        again = process.stdout.readline()
        assert again.startswith("ready " + first["http"] + "/?token=")
        assert again.strip() != lines[0]
        assert told(folder)["port"] == first["port"]  # programs on the ports have not noticed
        end = time.monotonic() + PATIENCE
        while not buses():
            assert time.monotonic() < end
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_what_cannot_be_served_is_an_error(folder: Path) -> None:
    said = subprocess.run(
        [sys.executable, "-m", "servobus", "serve", str(folder / "no-such-port"), "--no-http"],
        env=os.environ | {"XDG_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == 1
    assert "no-such-port" in said.stderr
    assert "Traceback" not in said.stderr
