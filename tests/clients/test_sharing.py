"""Several programs of other makes, and one of ours, on one bus at once: each as if it had the bus for itself."""

import os
import select
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import pytest

import servobus
from clients.conftest import PATIENCE
from clients.sharing import TOKEN
from servobus.errors import Held

sdk = pytest.importorskip("dynamixel_sdk")

Serve = Callable[..., str]
Eventually = Callable[[Callable[[], bool]], None]
OK = (0, 0)
"""COMM_SUCCESS, no error bit."""
READS = 60
TRIES = 8


class Sharing:
    """The process that shares a port: the links for programs, and the address for ours."""

    def __init__(self, port: str, folder: Path) -> None:
        self.links = [str(folder / f"shared{n}") for n in range(2)]
        command = [sys.executable, str(Path(__file__).with_name("sharing.py")), port, str(folder), *self.links]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert select.select([self._process.stdout], [], [], PATIENCE)[0], "it never got ready"
        word, _, self.address = self._process.stdout.readline().strip().partition(" ")
        assert word == "ready"

    def end(self) -> None:
        self._process.communicate(timeout=PATIENCE)
        assert self._process.returncode == 0


@pytest.fixture(scope="module")
def sharing(serve: Serve, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sharing]:
    """Serve virtual servos in one process, and share their port in another."""
    if sys.platform == "win32":
        pytest.skip("there are no pseudo terminals")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SERVOBUS_TOKEN", TOKEN)
        # The SDK gives an answer 34 ms, which a busy computer may exceed without any servo's fault.
        patch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 500)
        sharing = Sharing(serve("rx28@1-10,ax12a@30,lx16a@40"), tmp_path_factory.mktemp("shared"))
        yield sharing
        sharing.end()


class Program:
    """The SDK on a port of its own."""

    def __init__(self, name: str, baud: int = 57_600) -> None:
        self.port = sdk.PortHandler(name)
        self.port.baudrate = baud
        assert self.port.openPort()
        assert self.port.setBaudRate(baud)
        self.packets = sdk.PacketHandler(1.0)

    def __getattr__(self, name: str) -> Any:
        call = getattr(self.packets, name)

        def again(*arguments: Any) -> Any:
            """Repeat what was lost, as programs do: a busy computer may be late."""
            for _ in range(TRIES):
                outcome = call(self.port, *arguments)
                if isinstance(outcome, int) or outcome[-2] == 0:
                    break
            return outcome

        return again

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.port.closePort()

    def word(self, id: int, address: int) -> int:
        value, *state = self.read2ByteTxRx(id, address)
        assert tuple(state) == OK
        assert isinstance(value, int)
        return value

    def byte(self, id: int, address: int) -> int:
        return self.word(id, address) & 0xFF


@contextmanager
def programs(sharing: Sharing, first: int = 57_600, second: int = 57_600) -> Iterator[tuple[Program, Program]]:
    with Program(sharing.links[0], first) as one, Program(sharing.links[1], second) as two:
        yield one, two


def all_at_once(*works: Callable[[], None]) -> None:
    """Run works in threads; raise what one of them raises."""
    with ThreadPoolExecutor(len(works)) as pool:
        for done in [pool.submit(work) for work in works]:
            done.result(PATIENCE * 3)


def test_two_programs_and_one_of_ours(sharing: Sharing) -> None:
    """Each servo keeps a number of its own in punch: whoever hears another one has heard what was not for him."""
    with programs(sharing) as (one, two), servobus.open(sharing.address) as bus:
        ours = [bus.attach("rx28", id) for id in (5, 6)]
        for servo in ours:
            servo.write_raw({servo.model.register("punch"): 100 + servo.id})
        for program, ids in ((one, (1, 2)), (two, (3, 4))):
            for id in ids:
                assert program.write2ByteTxRx(id, 48, 100 + id) == OK

        def read(program: Program, ids: tuple[int, ...]) -> None:
            for n in range(READS):
                id = ids[n % len(ids)]
                assert program.word(id, 48) == 100 + id
                if n % 10 == 0:
                    assert program.write1ByteTxRx(id, 25, n % 2) == OK

        def read_ours() -> None:
            for _ in range(READS):
                assert [servo.read_raw("punch") for servo in ours] == [[105], [106]]

        all_at_once(lambda: read(one, (1, 2)), lambda: read(two, (3, 4)), read_ours)
        all_at_once(lambda: read(one, (5,)), lambda: read(two, (5,)))  # and both of one servo


def test_speeds_of_their_own(sharing: Sharing) -> None:
    """An RX-28 and an AX-12A, each at the speed from its factory."""
    with programs(sharing, 57_600, 1_000_000) as (one, two):

        def read(program: Program, id: int, number: int) -> None:
            for _ in range(10):
                assert program.word(id, 0) == number

        all_at_once(lambda: read(one, 1, 28), lambda: read(two, 30, 12))
        assert two.port.setBaudRate(57_600)
        all_at_once(lambda: read(one, 1, 28), lambda: read(two, 2, 28))


def test_a_program_of_another_family(sharing: Sharing) -> None:
    module = pytest.importorskip("pylx16a.lx16a")
    module.LX16A.initialize(sharing.links[1], timeout=1.0)
    try:

        def again(question: Callable[[], Any]) -> Any:
            for _ in range(TRIES):
                try:
                    return question()
                except module.ServoTimeoutError:
                    pass
            return None

        servo = again(lambda: module.LX16A(40))

        def read() -> None:
            for n in range(20):
                servo.set_angle_offset(n)
                assert again(lambda: servo.get_angle_offset(poll_hardware=True)) == pytest.approx(n, abs=0.13)
                assert again(servo.get_vin) == 7400

        def ask() -> None:
            for _ in range(30):
                assert one.word(1, 0) == 28

        with Program(sharing.links[0]) as one:
            all_at_once(read, ask)
        with pytest.raises(module.ServoTimeoutError):
            module.LX16A(8)
    finally:
        module.LX16A._controller.close()
        module.LX16A._controller = None


def test_who_holds_a_servo_and_leaves(sharing: Sharing, eventually: Eventually) -> None:
    """A goal takes the servo: another program's goals stay without an answer until the first has gone."""
    with programs(sharing) as (one, two):
        assert one.write2ByteTxRx(7, 32, 30) == OK  # slow: 20 degrees a second
        assert one.write1ByteTxRx(7, 24, 1) == OK
        assert two.byte(7, 24) == 1  # to read needs no lease
        assert two.write2ByteTxOnly(7, 30, 900) == sdk.COMM_SUCCESS
        assert two.word(7, 30) != 900
        with servobus.open(sharing.address) as bus:
            servo = bus.attach("rx28", 7)
            with pytest.raises(Held):
                servo.start_move_by(0.1)
        assert one.write2ByteTxRx(7, 30, 1000) == OK
        one.port.closePort()
        eventually(lambda: two.byte(7, 46) == 0)
        assert two.word(7, 36) < 990  # it was made safe long before its goal
        assert two.write2ByteTxRx(7, 30, two.word(7, 36)) == OK


PROGRAM = """
import sys, dynamixel_sdk as sdk
port, packets = sdk.PortHandler(sys.argv[1]), sdk.PacketHandler(1.0)
port.baudrate = 57600
assert port.openPort()
while packets.write2ByteTxRx(port, 8, 32, 30) != (0, 0):
    pass
while packets.write2ByteTxRx(port, 8, 30, 1000) != (0, 0):
    pass
print("moves", flush=True)
while True:
    packets.read2ByteTxRx(port, 8, 36)
"""


def test_a_program_that_is_killed(sharing: Sharing, eventually: Eventually) -> None:
    """In the middle of its questions: what it moved is made safe, and the next program on its port hears its own."""
    command = [sys.executable, "-c", PROGRAM, sharing.links[0]]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as killed:
        try:
            assert killed.stdout is not None
            assert killed.stdout.readline() == "moves\n"
        finally:
            killed.kill()
    with Program(sharing.links[1]) as two:
        eventually(lambda: two.byte(8, 46) == 0)
        assert two.word(8, 36) < 990
    with Program(sharing.links[0]) as one:
        assert one.word(1, 0) == 28
        assert one.byte(8, 3) == 8


def test_half_requests_of_one_disturb_no_other(sharing: Sharing) -> None:
    over = threading.Event()
    with Program(sharing.links[1]) as two, Path(sharing.links[0]).open("wb", buffering=0) as raw:

        def babble() -> None:
            while not over.wait(0.003):
                os.write(raw.fileno(), b"\xff\xff\x02\x07\x03\x1e")

        def read() -> None:
            try:
                for n in range(READS):
                    assert two.word(1 + n % 2, 0) == 28
            finally:
                over.set()

        all_at_once(babble, read)
