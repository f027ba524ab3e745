"""Two ports at once with asyncio: while one arm moves, so does the other.

    python examples/async_two_ports.py [PORT PORT]

Without ports it takes one virtual RX-28 and one LX-16A, each on a line of its own. Expect "starts" of both
sides, then "there" of both sides.
"""

import asyncio
import sys

import servobus
from servobus import deg


async def wave(side: str, port: str) -> None:
    async with servobus.open_async(port) as bus:
        servo = (await bus.scan(ids=range(1, 4)))[0]
        assert servo.state is not None  # a scan looks at every servo it finds
        async with servo.torque():
            move = await servo.move(servo.state.position + 45 * deg, time=0.5)
            print(f"{side}: {servo.model.title} starts, {move.duration:.1f} s")
            await move.wait()
            state = await servo.look()
            print(f"{side}: there, at {state.position / deg:.0f}°")


async def main() -> None:
    left, right = sys.argv[1:3] if len(sys.argv) > 2 else ("virtual:rx28@1", "virtual:lx16a@1")
    await asyncio.gather(wave("left", left), wave("right", right))


asyncio.run(main())
