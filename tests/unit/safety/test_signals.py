"""Signals, threads and ends of programs: what is driven comes to rest, and the program ends as it was told to.

Each program here drives a virtual servo behind a pseudo terminal; its true shaft tells whether it stands.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

if sys.platform == "win32":
    pytest.skip("no pseudo terminals on Windows", allow_module_level=True)

import servobus
from samples import ONE_OF_EACH_FAMILY
from servobus import LX16A, RX28, deg
from servobus.safety import signals
from unit.served import PATIENCE, Arm

HEAD = """
import os, signal, sys, threading, time
import servobus
from servobus import deg
port, key = sys.argv[1:3]

def move(bus):
    servo = bus.attach(servobus.MODELS[key], 1)
    servo.torque_on()
    servo.start_move(servo.look().position + 100 * deg, time=2.5)
    return servo

def ready():
    print("ready", flush=True)

def forever():
    while True:
        time.sleep(0.01)
"""
MAIN = """
with servobus.open(port, echo=False) as bus:
    move(bus)
    ready()
    forever()
"""
WORKER_MOVES = """
def work():
    move(bus)
    ready()
    forever()

with servobus.open(port, echo=False) as bus:
    thread = threading.Thread(target=work, daemon={daemon})
    thread.start()
    while thread.is_alive():
        time.sleep(0.01)
"""
ALL_IN_WORKER = """
def work():
    with servobus.open(port, echo=False) as bus:
        move(bus)
        ready()
        forever()

servobus.catch_signals()
thread = threading.Thread(target=work)
thread.start()
while thread.is_alive():
    time.sleep(0.01)
"""


def stands(arm: Arm) -> bool:
    """Tell whether the shaft is at rest 0.5 s from now."""
    time.sleep(0.5)
    before = arm.servos[0].shaft.position
    time.sleep(0.15)
    return abs(arm.servos[0].shaft.position - before) < 0.05 * deg


def run(arm: Arm, key: str, script: str, end: Callable[[subprocess.Popen[str]], None], *before: str) -> tuple[int, str]:
    """Run a program until it moves, end it somehow, and make sure that the servo stands; give its status and errors."""
    command = [*before, sys.executable, "-c", HEAD + script, arm.name, key]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n", program.communicate()[1]
        end(program)
        try:
            assert stands(arm), "it still moves"
            _, said = program.communicate(timeout=PATIENCE)
        finally:
            program.kill()
    return program.returncode, said


def sent(number: int) -> Callable[[subprocess.Popen[str]], None]:
    return lambda program: program.send_signal(number)


@pytest.fixture
def arm() -> Iterator[Arm]:
    with Arm("lx16a@1") as arm:
        yield arm


@pytest.mark.parametrize(
    ("key", "number"), [*((key, signal.SIGHUP) for key in ONE_OF_EACH_FAMILY), ("lx16a", signal.SIGQUIT)]
)
def test_N8_the_end_of_the_terminal_stops_what_moves(key: str, number: int) -> None:
    with Arm(f"{key}@1") as arm:
        status, _ = run(arm, key, MAIN, sent(number))
        assert status == 128 + number
        assert arm.servos[0].torque


def test_N8_sighup_is_left_alone_where_it_is_ignored(arm: Arm) -> None:
    script = HEAD + MAIN.replace("forever()", "time.sleep(0.5)\n    print('went on')")
    command = ["nohup", sys.executable, "-c", script, arm.name, "lx16a"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        program.send_signal(signal.SIGHUP)
        said, _ = program.communicate(timeout=PATIENCE)
    assert (program.returncode, said) == (0, "went on\n")


@pytest.mark.parametrize(("verb", "number"), [("move", signal.SIGHUP), ("step", signal.SIGQUIT)])
def test_N8_commands_stop_too(arm: Arm, verb: str, number: int) -> None:
    words = {
        "move": ["1=230", "--speed", "20"],
        "step": ["1", "--to", "230", "--time", "10", "--limits", "0", "240", "--seconds", "60"],
    }[verb]
    command = [sys.executable, "-m", "servobus", verb, arm.name, "--model", "lx16a", *words]
    start = arm.servos[0].shaft.position
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        end = time.monotonic() + PATIENCE
        while abs(arm.servos[0].shaft.position - start) < 1 * deg and program.poll() is None:
            assert time.monotonic() < end
            time.sleep(0.005)
        program.send_signal(number)
        assert stands(arm)
        _, said = program.communicate(timeout=PATIENCE)
    assert program.returncode == 130
    assert "LX-16A id 1 stopped: held at" in said


def test_N8_a_command_whose_terminal_is_gone_stops_too(arm: Arm) -> None:
    """What it would print has nowhere to go."""
    master, slave = os.openpty()
    command = [sys.executable, "-m", "servobus", "move", arm.name, "1=230", "--speed", "20"]
    start = arm.servos[0].shaft.position
    with subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True) as program:
        os.close(slave)
        end = time.monotonic() + PATIENCE
        while abs(arm.servos[0].shaft.position - start) < 1 * deg:
            assert time.monotonic() < end
            time.sleep(0.005)
        os.close(master)
        program.send_signal(signal.SIGHUP)  # as the system does to whoever has it as controlling terminal
        assert stands(arm)
        assert program.wait(PATIENCE) != 0


@pytest.mark.parametrize(("daemon", "number"), [(True, signal.SIGTERM), (False, signal.SIGHUP)])
def test_N9_a_worker_that_moves_is_stopped(arm: Arm, daemon: bool, number: int) -> None:
    status, _ = run(arm, "lx16a", WORKER_MOVES.format(daemon=daemon), sent(number))
    # A thread that is no daemon goes on for ever: then the signal ends the program as it always does.
    assert status == (128 + number if daemon else -number)


def test_N9_so_it_is_by_ctrl_c(arm: Arm) -> None:
    script = WORKER_MOVES.format(daemon=True)
    status, said = run(arm, "lx16a", script, sent(signal.SIGINT))
    assert status == -signal.SIGINT
    assert "KeyboardInterrupt" in said


def test_N9_by_ctrl_c_also_if_nothing_closes_the_bus_and_the_worker_goes_on(arm: Arm) -> None:
    """Python waits for the worker; the servo does not."""

    def end(program: subprocess.Popen[str]) -> None:
        program.send_signal(signal.SIGINT)

    script = """
bus = servobus.open(port, echo=False)

def work():
    move(bus)
    ready()
    time.sleep(2)

thread = threading.Thread(target=work)
thread.start()
while thread.is_alive():
    time.sleep(0.01)
"""
    status, said = run(arm, "lx16a", script, end)
    assert status == -signal.SIGINT
    assert "KeyboardInterrupt" in said


def test_N9_all_in_a_worker(arm: Arm) -> None:
    status, _ = run(arm, "lx16a", ALL_IN_WORKER, sent(signal.SIGTERM))
    assert status == -signal.SIGTERM


def test_N9_what_cannot_be_caught_is_told(arm: Arm) -> None:
    script = ALL_IN_WORKER.replace("servobus.catch_signals()\n", "").replace("        forever()\n", "")
    command = [sys.executable, "-c", HEAD + script, arm.name, "lx16a"]
    said = subprocess.run(command, timeout=PATIENCE, check=True, capture_output=True, text=True).stderr
    assert "SIGTERM and SIGHUP and SIGQUIT would end this program with its servos in motion" in said
    assert "servobus.catch_signals()" in said
    assert said.count("servobus.catch_signals()") == 1


def test_N9_a_main_thread_that_is_stuck_with_the_line_is_no_obstacle(arm: Arm) -> None:
    """The signal comes while the main thread is in the middle of a question, which it may ask for ever."""
    script = """
with servobus.open(port, echo=False) as bus:
    servo = move(bus)
    ready()
    while True:
        try:
            servo.look()
        except servobus.ServobusError:
            pass
"""
    status, _ = run(arm, "lx16a", script, sent(signal.SIGTERM))
    assert status == 143


# In this process


@pytest.fixture
def free_handlers() -> Iterator[None]:
    """Let nobody have a handler for the time of a test."""
    old = {number: signal.signal(number, signal.SIG_DFL) for number in signals.ENDING}
    yield
    for number, handler in old.items():
        signal.signal(number, handler)


def test_N8_handlers_of_others_stay(arm: Arm, free_handlers: None) -> None:
    def mine(*_: Any) -> None: ...

    signal.signal(signal.SIGHUP, mine)
    signal.signal(signal.SIGQUIT, signal.SIG_IGN)
    with arm.open() as bus:
        bus.attach(LX16A, 1).torque_on()
        assert signal.getsignal(signal.SIGHUP) is mine
        assert signal.getsignal(signal.SIGQUIT) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTERM) is signals._handle
        signal.signal(signal.SIGTERM, mine)  # set later, it stays too
    assert [signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM)] == [mine] * 2
    assert signal.getsignal(signal.SIGQUIT) is signal.SIG_IGN


def test_N8_a_bus_that_is_closed_gives_the_signals_back(arm: Arm, free_handlers: None) -> None:
    with arm.open(), servobus.open("virtual:rx28@1"):
        assert [signal.getsignal(number) for number in signals.ENDING] == [signals._handle] * 3
    assert [signal.getsignal(number) for number in signals.ENDING] == [signal.SIG_DFL] * 3
    with servobus.open("virtual:rx28@1?clock=virtual"):  # its servos end with this process
        assert [signal.getsignal(number) for number in signals.ENDING] == [signal.SIG_DFL] * 3


@pytest.fixture
def hears_ctrl_c() -> Iterator[None]:
    """Let this process hear Ctrl-C, which a job in the background of a shell ignores."""
    old = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, old)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_N7_ctrl_c_during_an_ordinary_stop_comes_out_behind_it(count: int, hears_ctrl_c: None) -> None:
    with servobus.open("virtual:lx16a@1-3?clock=virtual") as bus:
        port: Any = bus.transport
        for id in (1, 2, 3):
            bus.attach(LX16A, id).torque_on()
        write, left = port.write, count

        def interrupted(data: bytes) -> None:
            nonlocal left
            if left:
                left -= 1
                os.kill(os.getpid(), signal.SIGINT)
            write(data)

        port.write = interrupted
        with pytest.raises(KeyboardInterrupt):
            bus.make_safe("free")
        port.write = write
        port.sleep(0.1)
        assert [real.torque for real in port.servos] == [False] * 3
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_N7_sigterm_during_an_ordinary_stop_comes_out_behind_it(free_handlers: None) -> None:
    came: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        bus.attach(RX28, 1).torque_on()
        port: Any = bus.transport
        write = port.write

        def interrupted(data: bytes) -> None:
            os.kill(os.getpid(), signal.SIGTERM)
            write(data)
            assert not came

        port.write = interrupted
        bus.make_safe("free")
        assert came == [signal.SIGTERM]
