"""How many virtual servos run in real time.

    python -m bench.ticks [--seconds N]

All servos of a line move back and forth without a rest, on a virtual clock, and the CPU time is taken. A share of
100 % would be one core fully busy with keeping up.
"""

import argparse
import time
from typing import TYPE_CHECKING

import servobus
from servobus import MODELS, deg
from servobus.families.base import AxisMove

if TYPE_CHECKING:
    from servobus.virtual.serve.inprocess import VirtualPort

COUNTS = (1, 16, 64, 254)
BEAT = 0.5
"""s between two moves."""
SWING = 30 * deg


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.ticks", description="Virtual servos in real time.")
    parser.add_argument("--seconds", type=float, default=2.0, help="simulated seconds of each run")
    args = parser.parse_args(arguments)
    print(f"{args.seconds:g} s of virtual servos that all move, and of as many that all rest")
    print(f"{'model':<10}{'servos':>8}{'servo-ticks/s':>15}{'CPU, moving':>13}{'CPU, at rest':>14}")
    for key in MODELS:
        for count in COUNTS:
            moving, ticks = _run(key, count, args.seconds, moving=True)
            resting, _ = _run(key, count, args.seconds, moving=False)
            share, rest = moving / args.seconds, resting / args.seconds
            print(f"{MODELS[key].title:<10}{count:>8}{ticks / moving:>15.0f}{share:>13.1%}{rest:>14.1%}")


def _run(key: str, count: int, seconds: float, *, moving: bool) -> tuple[float, float]:
    """Give the CPU seconds of a run, and the servo-ticks in it."""
    model = MODELS[key]
    with servobus.open(f"virtual:{key}@0-{count - 1}?clock=virtual") as bus:
        port: VirtualPort = bus.transport  # type: ignore[assignment] # a virtual: port is one
        servos = [bus.attach(model, id) for id in range(count)]
        row = model.register("goal_position")
        middle = servos[0].look().position
        ends = [row.scale.encode(middle + side * SWING) for side in (-1, 1)]
        if moving:
            bus.torque_on(servos)
        begin, spent, beat = port.now(), 0.0, 0
        while port.now() - begin < seconds:
            start = time.process_time()
            if moving:
                goal = ends[beat % 2]
                bus.do(model.family.start_moves([AxisMove(servo.target, goal, 2 * SWING, BEAT) for servo in servos]))
            port.sleep(max(0.0, begin + (beat + 1) * BEAT - port.now()))
            assert len(port.servos) == count  # to look at them brings them up to date
            spent += time.process_time() - start
            beat += 1
        tick = port.servos[0].tick
        return spent, count * (port.now() - begin) / tick


if __name__ == "__main__":
    main()
