"""Programs find a server of the same user by the file in the runtime folder, and are let in by its token."""

import asyncio
import json
import os
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from serial.tools import list_ports

import servobus
from servobus import RX28, PortError, UsageError
from servobus.cli.app import app
from servobus.connect import lasting_name
from servobus.remote.address import Address
from servobus.remote.runtime import RuntimeFile, Server, find_server, runtime_folder, servers, sharing
from servobus.server.ports.hosting import Host, hosting
from servobus.virtual.serve.ports import PtyPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from unit.cli.conftest import Run, load, refused, run  # noqa: F401 - fixtures
from unit.remote.hosted import PATIENCE
from unit.served import served

SPEC = "virtual:rx28@1-2"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a runtime folder of its own; no token is given otherwise."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("SERVOBUS_TOKEN", raising=False)
    return tmp_path


@contextmanager
def shared(**ports: str) -> Iterator[Host]:
    """Share ports, name -> port, in a thread."""
    ready, loops = threading.Event(), []
    hosts: list[Host] = []

    async def main() -> None:
        over = asyncio.Event()
        async with hosting(ports) as host:
            hosts.append(host)
            loops.append((asyncio.get_running_loop(), over))
            ready.set()
            await over.wait()

    thread = threading.Thread(target=lambda: asyncio.run(main()))
    thread.start()
    assert ready.wait(PATIENCE)
    try:
        yield hosts[0]
    finally:
        (loop, over), *_ = loops
        loop.call_soon_threadsafe(over.set)
        thread.join(PATIENCE)
        assert not thread.is_alive()


def test_a_bus_is_opened_by_its_name() -> None:
    with shared(arm=SPEC) as host:
        for port in (
            "servobus:///arm",
            "servobus://",
            "servobus:///",
            str(Address("127.0.0.1", host.server.port, "arm")),
        ):
            with servobus.open(port) as bus:
                assert bus.attach(RX28, 1).read("present_temperature") == 25.0
                assert bus.transport.name == str(Address.parse(port))
                assert bus.transport.lasting_name == SPEC
        assert lasting_name("servobus:///arm") == (SPEC, "")
    with pytest.raises(PortError, match="no server of yours runs here"):
        servobus.open("servobus:///arm")


def test_what_is_not_there_is_said() -> None:
    with shared(arm=SPEC, leg=SPEC) as host:
        with pytest.raises(PortError, match="no such bus; there are: servobus:///arm, servobus:///leg"):
            servobus.open("servobus:///hand")
        with pytest.raises(UsageError, match="name one of the buses there: arm, leg"):
            servobus.open(f"servobus://127.0.0.1:{host.server.port}")
    with pytest.raises(PortError, match="no server answers at 127"):
        servobus.open("servobus://127.0.0.1:9/arm")


@pytest.mark.parametrize(
    "port", ["servobus://pi/arm", "servobus://pi:0/arm", "servobus://pi:99999/arm", "servobus:///a/b"]
)
def test_an_address_that_is_none_is_refused(port: str) -> None:
    with pytest.raises(UsageError, match="write servobus://HOST:PORT/NAME"):
        servobus.open(port)


@pytest.mark.parametrize("text", ["servobus:///arm", "servobus://pi.local:80/arm", "servobus://[::1]:80/arm"])
def test_an_address_is_written_as_it_is_read(text: str) -> None:
    assert str(Address.parse(text)) == text


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_the_file_is_for_this_user_alone(folder: Path) -> None:
    with shared(arm=SPEC) as host:
        (path,) = (folder / "servobus").iterdir()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
        assert json.loads(path.read_text()) == {
            "pid": os.getpid(), "host": "127.0.0.1", "port": host.server.port, "token": host.server.token, "http": "",
            "buses": {"arm": SPEC},
        }  # fmt: skip
        host.tell(http="http://127.0.0.1:7380")
        assert find_server("arm").http == "http://127.0.0.1:7380"
    assert not list((folder / "servobus").iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_a_folder_that_others_may_look_into_is_not_used(folder: Path) -> None:
    (folder / "servobus").mkdir(mode=0o755)
    with pytest.raises(PortError, match="chmod 700"):
        runtime_folder()
    assert list(servers()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locks")
def test_the_file_of_a_dead_server_is_removed(folder: Path) -> None:
    server = Server(1, "127.0.0.1", 9, "token", "", (("arm", SPEC),))
    left = runtime_folder() / "server-1.json"
    left.write_text('{"pid": 1}')
    assert list(servers()) == []
    assert not left.exists()
    with RuntimeFile(server):
        assert list(servers()) == [server]
    assert list(servers()) == []


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"pid": "x"}', '{"buses": 7}'])
def test_a_file_that_makes_no_sense_is_passed_over(text: str) -> None:
    with RuntimeFile(Server(7, "127.0.0.1", 9, "token", "", ())):
        (runtime_folder() / "server-7.json").write_text(text)
        assert list(servers()) == []


def test_a_port_on_a_virtual_clock_is_not_shared() -> None:
    async def main() -> None:
        async with hosting({"arm": SPEC + "?clock=virtual"}):
            pass

    with pytest.raises(UsageError, match="leave clock=virtual out"):
        asyncio.run(main())


# Commands


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo terminals")
def test_who_finds_the_port_taken_is_told_the_address(refused: Callable[..., str]) -> None:  # noqa: F811
    with served(PtyPort(build_rig(parse_url(SPEC)))) as port, shared(arm=port.name):
        said = f"servobus: {port.name}: a server shares it, process {os.getpid()}; open servobus:///arm instead\n"
        assert refused("read", port.name, 1, "present_position") == said
        found = sharing(port.name)
        assert found is not None
        assert found.address == "servobus:///arm"
    assert sharing(port.name) is None


def test_commands_work_over_it(run: Run, load: Callable[..., Any], refused: Callable[..., str]) -> None:  # noqa: F811
    with shared(arm=SPEC):
        run("set-id", "servobus:///arm", 2, 7)
        assert "id  7" in run("read", "servobus:///arm", 7, "id").stdout
        assert [found["id"] for found in load("scan", "servobus:///arm", "--ids", "1-8", "--family", "dynamixel")] == [
            1,
            7,
        ]
        # On a computer that is busy a read may be lost, which is a finding: only who is there counts here.
        told = CliRunner().invoke(
            app, ["doctor", "servobus:///arm", "--ids", "1-8", "--reads", "1"], prog_name="servobus"
        )
        assert "servos: RX-28 ids 1, 7" in told.output
        assert "a server, which alone sees its bytes" in refused("sniff", "servobus:///arm")


def test_ports_lists_what_is_shared(run: Run, load: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr(list_ports, "comports", list)
    with shared(arm=SPEC):
        words = f"servobus:///arm  {SPEC}, shared by process {os.getpid()}\n"
        assert run("ports").stdout.startswith(words)
        assert load("ports")[0]["port"] == "servobus:///arm"


def test_a_robot_stands_on_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(
        '[robot]\nformat = 1\n[port.arm]\npath = "servobus:///arm"\n'
        '[joint.elbow]\nmodel = "rx28"\nport = "arm"\nid = 1\nbaud = 57600\n'
    )
    with shared(arm=SPEC), servobus.robot(path) as arm:
        with arm.torque():
            arm.move(elbow=0.1, speed=3.0).wait()
        assert arm.positions()["elbow"] == pytest.approx(0.1, abs=0.03)
