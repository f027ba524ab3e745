"""When `play` sends its goals, beside a bare loop that does nothing.

    python -m bench.play [--seconds N] [--rate HZ] [--servos N]

Virtual RX-28 at 1 Mbit/s are served by a program of their own. Both loops run in the same process by the same schedule,
in turns of a second; a moment is late by as much as it comes after its place on the grid of its turn. The bare loop
says what the machine allows: compare the lines, not the figures of two machines.
"""

import argparse
import itertools
import statistics
import sys
import time
from collections.abc import Callable, Iterator

import servobus
from bench.programs import Program
from servobus import deg
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.motion import Motion

BAUD = 1_000_000
SLICE = 1.0
"""s of a turn of each loop."""
SHARES = (50, 90, 99, 100)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.play", description="Jitter of goals that are played.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each loop")
    parser.add_argument("--rate", type=float, default=100.0, help="goals a second")
    parser.add_argument("--servos", type=int, default=4)
    args = parser.parse_args(arguments)
    command = [sys.executable, "-m", "servobus", "virtual", f"rx28@1-{args.servos}", "--baud", str(BAUD)]
    late: dict[str, list[float]] = {"bare loop": [], "play": []}
    with Program(*command) as server:
        port = server.hear().split()[-1]
        with servobus.robot(read_text(_robot_file(port, args.servos))) as arm, arm.torque():
            for _ in range(max(1, round(args.seconds / SLICE))):
                late["bare loop"] += _late(_bare(args.rate), args.rate)
                late["play"] += _late(_played(arm, args.rate), args.rate)
    print(f"{args.rate:g} goals a second to {args.servos} RX-28 at {BAUD} bit/s: ms after their time")
    print(f"{'':>12}" + "".join(f"{f'{share} %':>10}" for share in SHARES) + f"{'turns':>10}{'left out':>10}")
    for name, times in late.items():
        cuts = [*statistics.quantiles(times, n=100, method="inclusive"), max(times)]
        missed = round(args.seconds * args.rate) - len(times)
        figures = "".join(f"{cuts[share - 1] * 1e3:>10.2f}" for share in SHARES)
        print(f"{name:>12}{figures}{len(times):>10}{max(0, missed):>10}")


def _robot_file(port: str, servos: int) -> str:
    text = f'[robot]\nformat = 1\n[port.p]\npath = "{port}"\necho = false\n'
    for id in range(1, servos + 1):
        text += f'[joint.j{id}]\nport = "p"\nmodel = "rx28"\nid = {id}\nbaud = {BAUD}\nzero = "150deg"\n'
    return text


def _late(moments: Iterator[float], rate: float) -> list[float]:
    """Give how late each moment is. The earliest of a turn, by its place on the grid, is taken to be in time."""
    times = list(moments)
    places = [time - round((time - times[0]) * rate) / rate for time in times]
    first = min(places)
    return [place - first for place in places]


def _bare(rate: float) -> Iterator[float]:
    """Do nothing but wait for the next turn, as any loop has to."""
    began = time.monotonic()
    for turn in itertools.count():
        due = began + turn / rate
        if due > began + SLICE:
            return
        while (rest := due - time.monotonic()) > 0:
            time.sleep(rest)
        yield time.monotonic()


def _played(arm: Robot, rate: float) -> Iterator[float]:
    """Give the moments at which `play` begins to send goals."""
    swing = Motion((0.0, SLICE / 2, SLICE), dict.fromkeys(arm.joints, (0.0, 5 * deg, 0.0)))
    play = arm.play(swing, rate=rate)
    moments: list[float] = []
    send: Callable[[], object] = play.step

    def step() -> object:
        moments.append(time.monotonic())
        return send()

    play.step = step  # type: ignore[method-assign, assignment]
    ticks = [tick.time for tick in play]
    yield from (moment for moment, at in zip(moments, ticks, strict=False) if at >= 0)


if __name__ == "__main__":
    main()
