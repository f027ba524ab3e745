"""The drivers that are compared. Each reads the present position of id 1, of an RX-28 or of an LX-16A.

    python -m bench.clients NAME PORT

takes lines from its input, a number of reads, and gives a line for each: the CPU seconds they took, then the
seconds of each read, nan for one that was lost. Each driver is imported only where it is used.
"""

import asyncio
import math
import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any

RX28_BAUD = 1_000_000
LX16A_BAUD = 115_200
WARM_UP = 200
PATIENCE = 0.1
"""s for an answer, where a driver lets one choose; what ours gives comes from the speed and the port."""


class Reads:
    """One driver on one port. `read` gives what the driver gives, or raises; `raw` makes a raw position of it."""

    def __init__(self, read: Callable[[], Any], raw: Callable[[Any], int] = int) -> None:
        self.read = read
        self.raw = raw

    def times(self, count: int) -> list[float]:
        """Read so many times; give the seconds of each, nan for one that failed."""
        read, clock, times = self.read, time.perf_counter, []
        for _ in range(count):
            start = clock()
            try:
                read()
            except Exception:  # noqa: BLE001 - each driver has its own
                times.append(math.nan)
            else:
                times.append(clock() - start)
        return times


class AwaitedReads(Reads):
    """An asynchronous driver, in an event loop that lives as long as the port is open."""

    def __init__(self, runner: asyncio.Runner, read: Callable[[], Any], raw: Callable[[Any], int]) -> None:
        async def awaited() -> Any:
            return await read()

        super().__init__(lambda: runner.run(awaited()), raw)
        self._runner = runner
        self._awaitable = read

    def times(self, count: int) -> list[float]:
        return self._runner.run(self._times(count))

    async def _times(self, count: int) -> list[float]:
        read, clock, times = self._awaitable, time.perf_counter, []
        for _ in range(count):
            start = clock()
            try:
                await read()
            except Exception:  # noqa: BLE001 - as above
                times.append(math.nan)
            else:
                times.append(clock() - start)
        return times


@contextmanager
def bare(port: str) -> Iterator[Reads]:
    """Write, poll, read: what any driver in Python must do. It checks nothing but the length."""
    import tty

    request, reply = bytes.fromhex("FF FF 01 04 02 24 02 D2"), 8
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    poll = select.poll()
    poll.register(fd, select.POLLIN)

    def read() -> bytes:
        os.write(fd, request)
        heard = b""
        while len(heard) < reply:
            if not poll.poll(PATIENCE * 1000):
                raise TimeoutError
            heard += os.read(fd, 64)
        return heard

    try:
        yield Reads(read, lambda heard: heard[5] | heard[6] << 8)
    finally:
        os.close(fd)


def ours(model_name: str, baud: int) -> Callable[[str], AbstractContextManager[Reads]]:
    @contextmanager
    def client(port: str) -> Iterator[Reads]:
        import servobus

        model: Any = getattr(servobus, model_name)
        register = model.present_position
        with servobus.open(port, bauds=baud) as bus:
            servo = bus.attach(model, 1, baud=baud)
            yield Reads(lambda: servo.read(register), register.scale.encode)

    return client


def ours_async(model_name: str, baud: int) -> Callable[[str], AbstractContextManager[Reads]]:
    @contextmanager
    def client(port: str) -> Iterator[Reads]:
        import servobus

        model: Any = getattr(servobus, model_name)
        register = model.present_position
        with asyncio.Runner() as runner:

            async def opened() -> Any:
                return servobus.open_async(port, bauds=baud)

            bus = runner.run(opened())
            servo = bus.attach(model, 1, baud=baud)
            try:
                yield AwaitedReads(runner, lambda: servo.read(register), register.scale.encode)
            finally:
                runner.run(bus.__aexit__(None, None, None))

    return client


@contextmanager
def dynamixel_sdk(port: str) -> Iterator[Reads]:
    from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(1.0)
    handler.openPort()
    handler.setBaudRate(RX28_BAUD)

    def read() -> int:
        value, result, error = packets.read2ByteTxRx(handler, 1, 36)
        if result != COMM_SUCCESS or error:
            raise OSError(packets.getTxRxResult(result))
        return int(value)

    try:
        yield Reads(read)
    finally:
        handler.closePort()


@contextmanager
def rustypot(port: str) -> Iterator[Reads]:
    from rustypot import AxPyController

    controller = AxPyController(port, RX28_BAUD, PATIENCE)
    try:
        yield Reads(lambda: controller.read_raw_present_position(1), lambda values: int(values[0]))
    finally:
        controller.close()


@contextmanager
def pypot(port: str) -> Iterator[Reads]:
    from pypot.dynamixel.io import DxlIO

    with DxlIO(port, baudrate=RX28_BAUD, timeout=PATIENCE, convert=False) as bus:  # raw, as the two above
        yield Reads(lambda: bus.get_present_position((1,)), lambda values: int(values[0]))


@contextmanager
def pylx16a(port: str) -> Iterator[Reads]:
    from pylx16a.lx16a import LX16A

    LX16A.initialize(port, timeout=PATIENCE)
    try:
        yield Reads(LX16A(1).get_physical_angle, lambda degrees: round(degrees / 0.24))
    finally:
        LX16A._controller.close()
        LX16A._controller = None


@contextmanager
def lewansoul_lx16a(port: str) -> Iterator[Reads]:
    import lewansoul_lx16a as module
    import serial

    with serial.Serial(port, LX16A_BAUD, timeout=PATIENCE) as opened:
        controller = module.ServoController(opened, timeout=PATIENCE)
        yield Reads(lambda: controller.get_position(1))


CLIENTS: dict[str, Callable[[str], AbstractContextManager[Reads]]] = {
    "bare Python": bare,
    "servobus": ours("RX28", RX28_BAUD),
    "servobus async": ours_async("RX28", RX28_BAUD),
    "dynamixel-sdk": dynamixel_sdk,
    "rustypot": rustypot,
    "pypot": pypot,
    "servobus LX-16A": ours("LX16A", LX16A_BAUD),
    "servobus LX-16A async": ours_async("LX16A", LX16A_BAUD),
    "pylx16a": pylx16a,
    "lewansoul-lx16a": lewansoul_lx16a,
}
"""The first six read an RX-28, the others an LX-16A."""


def main() -> None:
    name, port = sys.argv[1:]
    with ExitStack() as stack:
        try:
            client = stack.enter_context(CLIENTS[name](port))
        except ImportError as error:
            sys.exit(f"{name}: {error}")
        client.times(WARM_UP)
        print("ready", flush=True)
        for line in sys.stdin:
            before = time.process_time()
            times = client.times(int(line))
            spent = time.process_time() - before
            print(f"{spent:.9f}", *(f"{seconds:.9f}" for seconds in times), flush=True)


if __name__ == "__main__":
    main()
