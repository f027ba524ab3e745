"""The drivers that are compared, each as one function: read the present position of RX-28 id 1, many times.

Each opens the port, reads once to warm up, then gives the seconds each read took; nan for a read that was lost.
"""

import asyncio
import math
import time
from collections.abc import Callable

import servobus
from servobus import RX28

Client = Callable[[str, int, int], list[float]]
"""(port, baud, reads) -> seconds of each read"""


def blocking(port: str, baud: int, reads: int) -> list[float]:
    with servobus.open(port, bauds=baud) as bus:
        servo = bus.attach(RX28, 1, baud=baud)
        servo.read(RX28.present_position)
        return [_timed(lambda: servo.read(RX28.present_position)) for _ in range(reads)]


def asynchronous(port: str, baud: int, reads: int) -> list[float]:
    async def main() -> list[float]:
        async with servobus.open_async(port, bauds=baud) as bus:
            servo = bus.attach(RX28, 1, baud=baud)
            await servo.read(RX28.present_position)
            times = []
            for _ in range(reads):
                start = time.perf_counter()
                try:
                    await servo.read(RX28.present_position)
                    times.append(time.perf_counter() - start)
                except servobus.BusError:
                    times.append(math.nan)
            return times

    return asyncio.run(main())


def dynamixel_sdk(port: str, baud: int, reads: int) -> list[float]:
    from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

    handler, packets = PortHandler(port), PacketHandler(1.0)
    handler.openPort()
    handler.setBaudRate(baud)

    def read() -> None:
        _, result, error = packets.read2ByteTxRx(handler, 1, 36)
        if result != COMM_SUCCESS or error:
            raise OSError(packets.getTxRxResult(result))

    try:
        read()
        return [_timed(read) for _ in range(reads)]
    finally:
        handler.closePort()


def rustypot(port: str, baud: int, reads: int) -> list[float]:
    from rustypot import AxPyController

    controller = AxPyController(port, baud, 0.1)
    try:
        controller.read_raw_present_position(1)
        return [_timed(lambda: controller.read_raw_present_position(1)) for _ in range(reads)]
    finally:
        controller.close()


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    try:
        call()
    except (OSError, RuntimeError, servobus.BusError):
        return math.nan
    return time.perf_counter() - start


CLIENTS: dict[str, Client] = {
    "servobus": blocking,
    "servobus async": asynchronous,
    "dynamixel-sdk": dynamixel_sdk,
    "rustypot": rustypot,
}
