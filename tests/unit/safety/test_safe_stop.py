"""Ctrl-C, SIGTERM, crashes and ends of programs, and what they leave of servos in motion (F21)."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

if sys.platform == "win32":
    pytest.skip("no pseudo terminals on Windows", allow_module_level=True)

import servobus
from samples import ONE_OF_EACH_FAMILY, sample_of
from servobus import DRS0602, LX16A, RX28, Stopped, TorqueOff, UsageError, deg
from servobus.bus.asyncio import AsyncBus
from servobus.bus.blocking import Bus
from servobus.link.blocking import run_blocking
from servobus.virtual.serve.inprocess import VirtualPort
from unit.bus.test_blocking import ANSWER
from unit.lossy import ASYNC, SYNC
from unit.scripted import Scripted
from unit.served import PATIENCE, Arm, frees, stops

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
COMMON = """
import atexit, os, signal, sys, threading, time
import servobus
from servobus import deg
port, key, end, action = sys.argv[1:]
model = servobus.MODELS[key]
options = {"safe_action": action} if action else {}

# Where all cores are busy servos answer late, and one that seems not to answer is told to stop again.
def be_patient(bus):
    bus.transport.latency = 0.3  # s: a stop waits so long for what was under way, so no more
    bus.link.latency.review()

def finish():
    print("ready", flush=True)
    if end == "crash":
        raise ValueError("a slip")
    if end == "exit":
        sys.exit(3)
    if end == "exit 0":
        sys.exit(0)
    while end == "wait":
        time.sleep(0.01)
"""
SCRIPTS = {
    SYNC: """
def work(bus):
    be_patient(bus)
    first, other = (bus.attach(model, id) for id in (1, 2))
    other.ping()
    other.look()
    first.torque_on()
    here = first.look().position
    first.start_move(here + 40 * deg, speed=20 * deg)
    finish()

if end == "open":
    bus = servobus.open(port, echo=False, **options)
    work(bus)
else:
    with servobus.open(port, echo=False, **options) as bus:
        work(bus)
""",
    ASYNC: """
import asyncio

async def work(bus):
    be_patient(bus)
    first, other = (bus.attach(model, id) for id in (1, 2))
    await other.ping()
    await other.look()
    await first.torque_on()
    here = (await first.look()).position
    await first.start_move(here + 40 * deg, speed=20 * deg)
    if end == "wait":
        print("ready", flush=True)
        while True:
            await other.look()
    finish()

async def main():
    global bus
    if end == "open":
        bus = servobus.open_async(port, echo=False, **options)
        await work(bus)
    else:
        async with servobus.open_async(port, echo=False, **options) as bus:
            await work(bus)

asyncio.run(main())
""",
}


@pytest.fixture(params=ONE_OF_EACH_FAMILY)
def arm(request: pytest.FixtureRequest) -> Iterator[tuple[str, Arm]]:
    with Arm(f"{request.param}@1,2") as arm:
        yield request.param, arm


def run(arm: Arm, key: str, driver: str, end: str, *, action: str = "", send: int | None = None) -> int:
    """Run a program that moves servo 1 and looks at servo 2, and have it end somehow; give its exit status.

    What the servos heard before its end is forgotten.
    """
    command = [sys.executable, "-c", COMMON + SCRIPTS[driver], arm.name, key, end, action]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n", program.communicate()[1]
        if send is not None:
            arm.heard.clear()
            program.send_signal(send)
        try:
            _, said = program.communicate(timeout=PATIENCE)
        finally:
            program.kill()
    assert "may still move" not in said
    return program.returncode


@DRIVERS
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_what_moves_once(arm: tuple[str, Arm], driver: str, number: int) -> None:
    key, servos = arm
    status = run(servos, key, driver, "wait", send=number)
    assert status == (143 if number == signal.SIGTERM else -signal.SIGINT if driver == SYNC else status)
    assert status != 0
    heard = servos.settled()
    assert (stops(heard, key, 1), stops(heard, key, 2)) == (1, 0)
    assert (frees(heard, key, 1), frees(heard, key, 2)) == (0, 0)
    assert servos.servos[0].torque


@DRIVERS
@pytest.mark.parametrize("end", ["crash", "exit", "open"])
def test_a_crash_and_an_open_bus_at_the_end_stop_what_moves(arm: tuple[str, Arm], driver: str, end: str) -> None:
    key, servos = arm
    status = run(servos, key, driver, end)
    assert status == {"crash": 1, "exit": 3, "open": 0}[end]
    heard = servos.settled()
    assert (stops(heard, key, 1) - sample_of(key).stops_of_torque_on, stops(heard, key, 2)) == (1, 0)


@DRIVERS
@pytest.mark.parametrize("end", ["normal", "exit 0"])
def test_a_normal_end_changes_nothing(driver: str, end: str) -> None:
    with Arm("lx16a@1,2") as arm:
        assert run(arm, "lx16a", driver, end) == 0
        heard = arm.settled()
        assert [stops(heard, "lx16a", id) + frees(heard, "lx16a", id) for id in (1, 2)] == [0, 0]
        assert arm.servos[0].torque


@DRIVERS
def test_the_action_is_chosen(arm: tuple[str, Arm], driver: str) -> None:
    key, servos = arm
    run(servos, key, driver, "crash", action="free")
    heard = servos.settled()
    assert (frees(heard, key, 1), frees(heard, key, 2)) == (1, 0)
    assert not servos.servos[0].torque


@DRIVERS
def test_a_herkulex_brakes(driver: str) -> None:
    with Arm("drs0602@1,2") as arm:
        run(arm, "drs0602", driver, "crash", action="brake")
        arm.settled()
        # 5-2 RAM 52: 0x40 is brake on
        assert [servo.get("torque_control") for servo in arm.servos] == [0x40, 0]


def test_sigterm_of_a_program_that_moved_nothing_ends_it_as_ever() -> None:
    script = COMMON + "bus = servobus.open(port)\nbus.attach(model, 1).ping()\nfinish()"
    with Arm("lx16a@1,2") as arm:
        command = [sys.executable, "-c", script, arm.name, "lx16a", "wait", ""]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "ready\n"
            program.terminate()
            assert program.wait(PATIENCE) == -signal.SIGTERM
        assert [packet.code for packet in arm.settled()] == [14]  # SERVO_ID_READ


def test_the_handler_of_sigterm_goes_with_the_bus_and_respects_others() -> None:
    mine = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with Arm("lx16a@1") as arm:
            with arm.open() as bus:
                assert callable(signal.getsignal(signal.SIGTERM))  # a thread that moves could not catch it
                bus.attach(LX16A, 1).torque_on()
                assert callable(signal.getsignal(signal.SIGTERM))
                with pytest.raises(SystemExit) as ended:
                    os.kill(os.getpid(), signal.SIGTERM)
                assert ended.value.code == 143
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            with arm.open() as bus:
                bus.attach(LX16A, 1).torque_on()
                assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, mine)


def test_a_forked_child_leaves_the_servos_alone() -> None:
    script = COMMON + SCRIPTS[SYNC] + "\nif os.fork():\n    os.wait()\n    bus.close()\n"
    with Arm("lx16a@1,2") as arm:
        command = [sys.executable, "-c", script, arm.name, "lx16a", "open", ""]
        assert subprocess.run(command, timeout=PATIENCE, check=False, capture_output=True).returncode == 0
        assert stops(arm.settled(), "lx16a", 1) == 0


# In this process


def virtual(spec: str, driver: str = SYNC, **options: Any) -> Any:
    opener: Any = servobus.open if driver == SYNC else servobus.open_async
    return opener(f"virtual:{spec}?clock=virtual", **options)


def record(bus: Any) -> list[bytes]:
    """Write down what is sent from now on."""
    port: VirtualPort = bus.transport
    sent: list[bytes] = []
    write = port.write

    def wrapped(data: bytes) -> None:
        sent.append(data)
        write(data)

    port.write = wrapped  # type: ignore[method-assign]
    return sent


@pytest.mark.parametrize("action", ["hold", "free"])
def test_each_servo_has_its_turn_though_another_fails(action: Any, caplog: pytest.LogCaptureFixture) -> None:
    bus = virtual("lx16a@1-3", safe_action=action)
    with pytest.raises(ValueError, match="a slip"), bus:
        for id in (1, 2, 3):
            bus.attach(LX16A, id).torque_on()
        bus.transport.servos[1].power_off()
        sent = record(bus)
        raise ValueError("a slip")
    stopping = {request[2] for request in sent if request[4] == (12 if action == "hold" else 31)}
    assert stopping == {1, 2, 3}
    assert "LX-16A id 2 may still move" in caplog.text
    assert "id 1" not in caplog.text


def test_a_release_that_is_lost_is_sent_again() -> None:
    bus = virtual("lx16a@1", safe_action="free")
    with pytest.raises(ValueError, match="a slip"), bus:
        bus.attach(LX16A, 1).torque_on()
        bus.transport.sleep(0.01)
        bus.transport.inject("deaf#1")
        sent = record(bus)
        raise ValueError("a slip")
    assert [request[4] for request in sent].count(31) == 2
    assert not bus.transport.rig.servos[0].torque


def test_what_was_switched_off_or_never_on_is_left_alone() -> None:
    bus = virtual("rx28@1-4")
    with pytest.raises(ValueError, match="a slip"), bus:
        first, second, third, _ = bus.scan(family="dynamixel", ids=range(5))
        with first.torque():
            pass
        second.torque_on()
        second.write(RX28.torque_enable, False)
        third.write(RX28.torque_limit, 0.5)
        sent = record(bus)
        raise ValueError("a slip")
    assert sent == []


def test_what_another_switched_off_is_not_switched_on_by_holding_it() -> None:
    bus = virtual("rx28@1")
    with pytest.raises(ValueError, match="a slip"), bus:
        bus.attach(RX28, 1).torque_on()
        bus.transport.sleep(0.01)
        bus.transport.servos[0].put("torque_enable", 0)
        bus.transport.servos[0].goal_torque = True  # as some say of real ones
        raise ValueError("a slip")
    bus.transport.rig.run(bus.transport.now() + 0.1)
    assert bus.transport.rig.servos[0].get("torque_enable") == 0


@pytest.mark.parametrize(
    "mark_moving",
    [
        lambda servo: servo.torque_on(),
        lambda servo: servo.rearm(),
        lambda servo: (servo.torque_on(), servo.permit.mark_idle(), servo.turn(output=0.1)),
        lambda servo: (servo.torque_on(), servo.permit.mark_idle(), servo.write(RX28.goal_position, 1.0)),
        lambda servo: (
            servo.torque_on(),
            servo.turn(output=0.1),
            servo.permit.mark_idle(),
            servo.write_raw({RX28.moving_speed: 10}),
        ),
        lambda servo: servo.write_many({RX28.torque_enable: True}),
        lambda servo: servo._bus.torque_on([servo]),
    ],
    ids=["torque_on", "rearm", "turn", "goal", "speed", "torque register", "torque of several"],
)
def test_whatever_sets_it_going_is_known(mark_moving: Any) -> None:
    bus = virtual("rx28@1", safe_action="free")
    with pytest.raises(ValueError, match="a slip"), bus:
        mark_moving(bus.attach(RX28, 1))
        raise ValueError("a slip")
    bus.transport.rig.run(bus.transport.now() + 0.1)
    assert bus.transport.rig.servos[0].get("torque_enable") == 0


def test_a_stopped_servo_is_not_stopped_again_but_freed() -> None:
    for action, count in (("hold", 0), ("free", 2)):  # sent, and made sure of
        bus = virtual("lx16a@1", safe_action=action)
        with pytest.raises(ValueError, match="a slip"), bus:
            servo = bus.attach(LX16A, 1)
            servo.torque_on()
            servo.stop()
            sent = record(bus)
            raise ValueError("a slip")
        assert len(sent) == count


def test_a_stop_is_not_refused_for_being_far_from_the_goal() -> None:
    bus = virtual("rx28@1")
    with pytest.raises(ValueError, match="a slip"), bus:
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        servo.write(RX28.goal_position, 250 * deg)
        servo.max_step = 0.001 * deg
        bus.transport.sleep(0.2)
        servo.stop()
        servo.write_raw({RX28.moving_speed: 0})
        raise ValueError("a slip")
    assert not servo.permit.driven


@DRIVERS
def test_an_error_in_a_torque_block_frees_unless_something_was_chosen(driver: str) -> None:
    import asyncio  # noqa: PLC0415 - one of these needs it

    for action, torque in ((None, False), ("hold", True), ("free", False)):
        for whole in (True, False):
            bus = virtual("rx28@1", driver, safe_action=action)
            servo = bus.attach(RX28, 1)
            with pytest.raises(ValueError, match="a slip"):
                if driver == SYNC:
                    with bus.torque() if whole else servo.torque():
                        raise ValueError("a slip")
                else:

                    async def main(bus: AsyncBus = bus, servo: Any = servo, whole: bool = whole) -> None:
                        async with bus.torque() if whole else servo.torque():
                            raise ValueError("a slip")

                    asyncio.run(main())
            bus.transport.sleep(0.01)
            assert bus.transport.servos[0].torque is torque


def test_brakes_are_refused_where_there_are_none() -> None:
    bus = virtual("rx28@1,lx16a@2,drs0602@3")
    for model, id in ((RX28, 1), (LX16A, 2)):
        servo = bus.attach(model, id)
        with pytest.raises(UsageError, match=f"{model.title} id {id} cannot brake"):
            servo.safe_action = "brake"
        assert servo.safe_action == "hold"
    with pytest.raises(UsageError, match="cannot brake"):
        bus.safe_action = "brake"
    with pytest.raises(UsageError, match="'stop' is no safe action; choose hold, free, brake"):
        bus.safe_action = "stop"
    with pytest.raises(UsageError, match="'stop' is no safe action"):
        servobus.open("virtual:rx28@1", safe_action="stop")  # type: ignore[arg-type]
    bus.attach(DRS0602, 3).safe_action = "brake"


def test_a_bus_that_is_to_brake_finds_all_and_moves_those_that_can() -> None:
    bus = virtual("rx28@1,drs0602@3", safe_action="brake")
    rx28, drs0602 = bus.attach(RX28, 1), bus.attach(DRS0602, 3)
    sent = record(bus)
    with pytest.raises(UsageError, match="RX-28 id 1 cannot brake"):
        rx28.torque_on()
    assert sent == []
    drs0602.torque_on()
    rx28.safe_action = "free"
    rx28.torque_on()


def test_all_servos_of_a_bus_get_its_action_and_one_its_own() -> None:
    bus = virtual("rx28@1-3")
    one, two = bus.attach(RX28, 1), bus.attach(RX28, 2)
    bus.safe_action = "free"
    two.safe_action = "hold"
    assert [one.safe_action, two.safe_action, bus.attach(RX28, 3).safe_action] == ["free", "hold", "free"]
    assert bus.safe_action == "free"


@pytest.mark.parametrize("when", ["while it is sent", "while it is waited for"])
def test_an_interrupted_read_does_not_spoil_the_stop(when: str) -> None:
    """The answer to it is still under way, and looks like the position that the stop asks for."""
    bus = virtual("rx28@1")
    with pytest.raises(KeyboardInterrupt), bus:
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        servo.start_move(200 * deg, time=1.0)
        bus.transport.sleep(0.5)
        port: VirtualPort = bus.transport
        read, write = port.read, port.write

        def interrupted_read(timeout: float) -> bytes:
            port.read = read  # type: ignore[method-assign]
            raise KeyboardInterrupt

        def interrupted_write(data: bytes) -> None:
            port.write = write  # type: ignore[method-assign]
            write(data)
            raise KeyboardInterrupt

        if when == "while it is sent":
            port.write = interrupted_write  # type: ignore[method-assign]
        else:
            port.read = interrupted_read  # type: ignore[method-assign]
        servo.read(RX28.goal_position)
    port.rig.run(port.now() + 0.1)
    real = port.rig.servos[0]
    goal = RX28.goal_position.scale.decode(real.get("goal_position"))
    # At 50°/s and less than 0.1 s for the stop it is within 5° of where it was; its old goal is 25° away.
    assert abs(goal - real.position) < 5 * deg
    assert goal < 190 * deg


def test_whoever_takes_the_line_over_waits_for_what_is_under_way() -> None:
    """A question was sent and its asker has gone: its answer is none to the same question asked again."""
    port = Scripted(ANSWER, "FF FF 01 03 00 21 DA")  # 32 °C, then 33 °C: 01+03+21 = 25
    bus = Bus(port, echo=False)
    servo = bus.attach(RX28, 1)
    question = servo.family.question(servo.target, RX28.present_temperature)
    port.write(question.request)
    with bus._take_over(True) as (link, line, turn):
        assert run_blocking(link, link.transact(question), line, turn) == 33.0


def test_nothing_moves_any_more_once_the_bus_ends() -> None:
    bus = virtual("rx28@1")
    with pytest.raises(ValueError, match="a slip"), bus:
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        raise ValueError("a slip")
    with pytest.raises(Stopped, match="is being closed"):
        servo.torque_on()


def test_a_restarted_servo_is_not_woken_by_a_goal() -> None:
    """F14: an RX-28 switches its torque on when it gets a goal."""
    bus = virtual("rx28@1")
    servo = bus.attach(RX28, 1)
    servo.torque_on()
    real = bus.transport.servos[0]
    real.power_off()
    real.power_on(bus.transport.now())
    with pytest.raises(servobus.Restarted, match="has lost what was set in it"):
        servo.verify()
    for move in (
        lambda: servo.write(RX28.goal_position, 1.0),
        lambda: servo.turn(output=0.1),
        lambda: servo.start_move(1.0),
    ):
        with pytest.raises((servobus.Restarted, TorqueOff)):
            move()  # type: ignore[no-untyped-call]
    bus.transport.sleep(0.01)
    assert not bus.transport.servos[0].torque
    servo.torque_on()
    servo.write(RX28.goal_position, 1.0)


def test_a_second_ctrl_c_does_not_end_the_stopping() -> None:
    bus = virtual("lx16a@1-3", safe_action="free")
    with pytest.raises(ValueError, match="a slip"), bus:
        for id in (1, 2, 3):
            bus.attach(LX16A, id).torque_on()
        port: VirtualPort = bus.transport
        write = port.write

        def interrupted(data: bytes) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            write(data)

        port.write = interrupted  # type: ignore[method-assign]
        raise ValueError("a slip")
    port.rig.run(port.now() + 0.1)
    assert [servo.torque for servo in port.rig.servos] == [False] * 3


def test_opening_looking_and_closing_after_an_error_sends_nothing() -> None:
    port = Scripted()
    with pytest.raises(ValueError, match="a slip"), Bus(port, echo=False) as bus:
        bus.attach(RX28, 1)
        raise ValueError("a slip")
    assert port.requests == []
    assert port.closed
