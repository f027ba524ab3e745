import io
import os
import re
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest
from rich.console import Console

import servobus
from servobus.cli.live_table import LiveTable, led_text, servo_table
from servobus.families.registry import RX28
from servobus.virtual.device.snapshot import VirtualSnapshot
from servobus.virtual.serve.ports import TcpPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import Setup, parse_specs

STALLED = VirtualSnapshot(
    title="DRS-0602", family="HerkuleX", id=219, powered=True, angle=-2.789, speed=-6.4, duty=-1.0, current=-3.48,
    temperature=104.4, voltage=13.05, torque=True, led="red+blue", errors=("over load", "temperature"),
)  # fmt: skip
FREE = VirtualSnapshot(
    title="LX-16A", family="LewanSoul", id=1, powered=True, angle=2.0944, speed=-0.0, duty=None, current=-0.0,
    temperature=25.0, voltage=7.4, torque=False, led="off", errors=(),
)  # fmt: skip


def drawn(*servos: VirtualSnapshot, colour: bool = False, **options: object) -> str:
    console = Console(file=io.StringIO(), width=80, force_terminal=colour, color_system="standard" if colour else None)
    console.print(servo_table(servos, **options))  # type: ignore[arg-type]
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_table() -> None:
    lines = drawn(STALLED, FREE, name="/tmp/arm", note="help lists them").splitlines()
    assert lines[0] == "/tmp/arm   supply 13.05 V, 7.40 V"
    assert lines[1].split() == ["servo", "id", "angle", "speed", "duty", "current", "°C", "light", "errors"]
    assert " ".join(lines[2].split()) == "DRS-0602 219 -159.8° -367°/s -100 % -3.48 A 104 ● red+blue over load, temp…"
    assert lines[3].split() == ["LX-16A", "1", "120.0°", "0°/s", "free", "0.00", "A", "25", "○", "off"]
    assert lines[4] == "help lists them"
    assert max(map(len, lines)) <= 80


def test_no_more_rows_than_there_is_room() -> None:
    text = drawn(*[FREE] * 30, rows=4)
    assert text.count("LX-16A") == 4
    assert "... and 26 more" in text


@pytest.mark.parametrize(
    ("led", "colour"),
    [("red", "red"), ("green+blue", "cyan"), ("blue+red", "magenta"), ("red+green", "yellow"), ("on", "bright_white")],
)
def test_lights_have_their_colour(led: str, colour: str) -> None:
    assert (str(led_text(led)), led_text(led).style) == (f"● {led}", colour)
    assert str(led_text("off")) == "○ off"


def test_looking_does_not_make_the_bus_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = build_rig(Setup(parse_specs("lx16a@1-200")))
    stop = threading.Event()
    show = LiveTable(rig, stop)
    seen: list[VirtualSnapshot] = []
    looker = threading.Thread(target=lambda: seen.extend(show.snapshots()))
    looker.start()
    longest, now, deadline = 0.0, 0.0, time.monotonic() + 10
    while looker.is_alive():
        assert time.monotonic() < deadline
        now += 0.001
        started = time.process_time()
        rig.receive(now)
        longest = max(longest, time.process_time() - started)
        time.sleep(0)
    assert [one.id for one in seen] == list(range(1, 201))
    assert longest < 0.05
    stop.set()
    assert show.snapshots() == []  # nobody serves any more


def test_the_table_lives_while_a_client_is_served() -> None:
    """Both threads have ended before anything that failed is told: two that format a traceback at once spoil it."""
    rig = build_rig(Setup(parse_specs("rx28@1-3")))
    stop = threading.Event()
    screen = Console(file=io.StringIO(), width=80, height=24, force_terminal=True)
    show = LiveTable(rig, stop, screen)
    with TcpPort(rig) as port:
        server = threading.Thread(target=port.serve, args=[stop])
        server.start()
        try:
            show.start(port.name)
            show.show_note("hello")
            with servobus.open(port.name) as bus:
                arm = bus.find(2, family="dynamixel")
                arm.write(RX28.led, True)
                time.sleep(0.5)
        finally:
            stop.set()
            show.join()
            server.join()
    assert isinstance(screen.file, io.StringIO)
    text = screen.file.getvalue()
    assert port.name in text
    assert "● red" in text
    assert "hello" in text
    assert text.count("servo") > 2  # several pictures


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals as on POSIX")
def test_on_a_terminal_of_its_own() -> None:
    master, slave = os.openpty()
    command = [sys.executable, "-m", "servobus", "virtual", "lx16a@1-2", "--show"]
    environment = {**os.environ, "COLUMNS": "80", "LINES": "24", "TERM": "xterm"}
    pipes = {"stdin": slave, "stdout": subprocess.PIPE, "stderr": slave, "env": environment}
    with subprocess.Popen(command, text=True, **pipes) as process:  # type: ignore[call-overload]
        os.close(slave)
        assert process.stdout.readline().startswith("ready /dev/")
        text = heard(master, lambda text: "LX-16A" in text)
        os.write(master, b"block 2\n")
        text = heard(master, lambda text: "LX-16A id 2: load blocked" in text)
        process.terminate()
        text += heard(master, lambda _: process.poll() is not None)
        assert process.wait(10) == 0
        assert process.stdout.read() == ""
    os.close(master)
    assert "Traceback" not in text


def heard(terminal: int, enough: Callable[[str], bool]) -> str:
    """Read what appears on a terminal until it is enough."""
    data, deadline = b"", time.monotonic() + 10
    while not enough(data.decode(errors="replace")):
        assert time.monotonic() < deadline, data
        if select.select([terminal], [], [], 0.1)[0]:
            try:
                data += os.read(terminal, 65536)
            except OSError:  # the other side is gone
                time.sleep(0.05)
    return data.decode(errors="replace")


def test_it_needs_a_terminal(refused: Callable[..., str]) -> None:
    assert "--show needs a terminal" in refused("virtual", "rx28@1", "--show", code=2)


def screen(sent: str) -> list[str]:
    """Give what a terminal shows that was sent this: CR, LF, cursor up, erase line (ECMA-48); colours do not count."""
    lines, row, column = [""], 0, 0
    for up, erase, other, text in re.findall(r"\x1b\[(\d+)A|(\x1b\[2K)|\x1b\[[?0-9;]*([a-zA-Z])|([^\x1b])", sent):
        if up:
            row = max(0, row - int(up))
        elif erase:
            lines[row] = ""
        elif text == "\r":
            column = 0
        elif text == "\n":
            row, column = row + 1, 0
            lines += [""] * (row + 1 - len(lines))
        elif not other:
            lines[row] = lines[row][:column].ljust(column) + text + lines[row][column + 1 :]
            column += 1
    return lines


@pytest.mark.parametrize("lines", [0, 1, 2])
def test_typed_lines_leave_no_old_header_above_the_table(lines: int) -> None:
    from rich.live import Live  # noqa: PLC0415

    out = io.StringIO()
    console = Console(file=out, width=80, force_terminal=True, color_system=None)
    table = LiveTable(build_rig(Setup(parse_specs("lx16a@1"))), threading.Event(), console)
    with Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False) as live:
        table._draw(live, servo_table([FREE], "/tmp/arm"))
        for _ in range(lines):
            out.write("load 1\n")  # what the terminal shows of a line that is typed, and of Enter
            table.line_typed()
        table._draw(live, servo_table([FREE], "/tmp/arm"))
    shown = screen(out.getvalue())
    assert sum("supply" in line for line in shown) == 1
    assert sum("LX-16A" in line for line in shown) == 1
