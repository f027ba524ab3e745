"""When `play` sends its goals, beside a bare loop that does nothing.

    python -m bench.play [--seconds N] [--rate HZ] [--servos N]

Virtual RX-28 at 1 Mbit/s are served by a program of their own. Both loops run in the same process, a second each in
turn. What is measured is how much later than it was due a turn begins; `play` leaves out a turn that is late by more
than half a period. The bare loop says what the machine allows: compare the lines, not the figures of two machines.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Iterator

import servobus
from bench.programs import Program
from servobus import deg
from servobus.bus.rate import Tick
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.motions.motion import Motion

BAUD = 1_000_000
SLICE = 1.0
"""s of a turn of each loop."""
SHARES = (50, 90, 99, 100)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.play", description="Jitter of goals that are played.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each loop")
    parser.add_argument("--rate", type=float, default=100.0, help="goals a second")
    parser.add_argument(
        "--servos", type=int, default=1, help="each takes its server some processor time, in every turn"
    )
    args = parser.parse_args(arguments)
    command = [sys.executable, "-m", "servobus", "virtual", f"rx28@1-{args.servos}", "--baud", str(BAUD)]
    late: dict[str, list[float]] = {"bare loop": [], "play": []}
    missed = dict.fromkeys(late, 0)
    with Program(*command) as server:
        port = server.hear().split()[-1]
        with servobus.robot(read_text(_robot_file(port, args.servos))) as arm, arm.torque():
            for _ in range(max(1, round(args.seconds / SLICE))):
                late["bare loop"] += _bare(args.rate)
                times, left_out = _played(arm, args.rate)
                late["play"] += times
                missed["play"] += left_out
    print(f"{args.rate:g} goals a second to {args.servos} RX-28 at {BAUD} bit/s: ms after their time")
    print(f"{'':>12}" + "".join(f"{f'{share} %':>10}" for share in SHARES) + f"{'turns':>10}{'left out':>10}")
    for name, times in late.items():
        cuts = [*statistics.quantiles(times, n=100, method="inclusive"), max(times)]
        figures = "".join(f"{cuts[share - 1] * 1e3:>10.2f}" for share in SHARES)
        print(f"{name:>12}{figures}{len(times):>10}{missed[name]:>10}")


def _robot_file(port: str, servos: int) -> str:
    text = f'[robot]\nformat = 1\n[port.p]\npath = "{port}"\necho = false\n'
    for id in range(1, servos + 1):
        text += f'[joint.j{id}]\nport = "p"\nmodel = "rx28"\nid = {id}\nbaud = {BAUD}\nzero = "150deg"\n'
    return text


def _bare(rate: float) -> list[float]:
    """Do nothing but wait for the next turn, as any loop has to; give how late each turn is."""
    late = []
    began = time.monotonic()
    for turn in range(round(SLICE * rate)):
        due = began + turn / rate
        while (rest := due - time.monotonic()) > 0:
            time.sleep(rest)
        late.append(time.monotonic() - due)
    return late


def _played(arm: Robot, rate: float) -> tuple[list[float], int]:
    """Play for a while; give how late the goals of each turn are sent, and how many turns were left out."""
    swing = Motion((0.0, SLICE / 2, SLICE), dict.fromkeys(arm.joints, (0.0, 5 * deg, 0.0)))
    play = arm.play(swing, rate=rate)
    schedule = play.turns()
    late: list[float] = []

    def turns() -> Iterator[Tick]:
        began = time.monotonic()
        for tick in schedule:
            late.append(time.monotonic() - began - tick.time)
            yield tick

    play.turns = turns  # type: ignore[method-assign, assignment]
    play.wait()
    return late, schedule.missed


if __name__ == "__main__":
    main()
