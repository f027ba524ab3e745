"""Reads over a pseudo terminal: ours beside other drivers, interleaved in one run.

    python -m bench.reads [--reads N] [--rounds N] [--quick] [--only NAME ...]

The servo is a responder in C that answers at once, and in a second table 500 µs after the request. No driver
can be faster than the floor, a client in C; the CPU of a driver in Python can hardly be below that of a bare
loop of write, poll and read. Each driver is a process of its own with a responder of its own; they take turns
in an order that is drawn anew for each round. A pseudo terminal carries no bit times, so that both families
compare with one floor. It takes some four minutes. Compare the ratios, not the absolute figures: each is the median
over the rounds of what was taken there side by side; the figures themselves depend on the machine and on what
else it does.
"""

import argparse
import math
import os
import random
import statistics
import sys
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from bench.clients import CLIENTS
from bench.programs import NoCompiler, Program, Silent, compiled

DELAYS = (0.0, 0.0005)
"""s from the request to the reply; the second is the RX-28's factory setting (manual 3-4-1)."""
FLOOR = "C floor"
BARE = "bare Python"


@dataclass(slots=True)
class Timings:
    """What one driver took, round by round; seconds."""

    cpu: list[float] = field(default_factory=list)
    times: list[list[float]] = field(default_factory=list)

    @property
    def all(self) -> list[float]:
        return [seconds for times in self.times for seconds in _good(times)]

    @property
    def lost(self) -> int:
        return sum(map(len, self.times)) - len(self.all)

    @property
    def cpu_each(self) -> float:
        return sum(self.cpu) / sum(map(len, self.times))

    def slower_than(self, other: "Timings") -> float:
        """Compare the medians of each round, which share the machine's mood; the median of these ratios."""
        pairs = zip(self.times, other.times, strict=True)
        return statistics.median(statistics.median(_good(a)) / statistics.median(_good(b)) for a, b in pairs)

    def busier_than(self, other: "Timings") -> float:
        return statistics.median(a / b for a, b in zip(self.cpu, other.cpu, strict=True))


def _good(times: list[float]) -> list[float]:
    return [seconds for seconds in times if math.isfinite(seconds)]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.reads", description="Reads over a pseudo terminal, in µs.")
    parser.add_argument("--reads", type=int, default=20_000, help="reads of each driver, of each delay")
    parser.add_argument("--rounds", type=int, default=40, help="rounds they are spread over")
    parser.add_argument("--quick", action="store_true", help="2000 reads in 10 rounds")
    parser.add_argument("--only", nargs="+", choices=CLIENTS, default=list(CLIENTS), help="these drivers alone")
    parser.add_argument("--delay", type=float, nargs="+", default=[delay * 1e6 for delay in DELAYS], help="µs")
    parser.add_argument("--seed", type=int, default=1, help="of the order the drivers take turns in")
    args = parser.parse_args(arguments)
    reads, rounds = (2_000, 10) if args.quick else (args.reads, args.rounds)
    names = [BARE, *(name for name in args.only if name != BARE)]
    try:
        with compiled("responder", "floor") as (answers, floor):
            for delay in args.delay:
                servos = _measure(answers, floor, names, delay / 1e6, reads, rounds, random.Random(args.seed))
                _show(servos, delay, names)
    except NoCompiler as error:
        sys.exit(f"bench.reads: {error}")


def _measure(
    answers: Path, floor: Path, names: list[str], delay: float, reads: int, rounds: int, order: random.Random
) -> dict[str, Timings]:
    cpus = _cpus()
    commands = {FLOOR: [str(floor)]} | {name: [sys.executable, "-m", "bench.clients", name] for name in names}
    workers: dict[str, Program] = {}
    with ExitStack() as stack:
        for name, command in commands.items():
            servo = stack.enter_context(Program(str(answers), str(round(delay * 1e6))))
            servo.stay_on(cpus[0])
            worker = stack.enter_context(Program(*command, servo.hear()))
            worker.stay_on(cpus[1])
            with suppress(Silent):
                if worker.hear() == "ready":
                    workers[name] = worker
        servos = {name: Timings() for name in workers}
        for done in range(rounds):
            _progress(f"round {done + 1} of {rounds}")
            for name in order.sample(list(workers), len(workers)):
                workers[name].say(str(-(-reads // rounds)))
                cpu, *times = map(float, workers[name].hear().split())
                servos[name].cpu.append(cpu)
                servos[name].times.append(times)
    _progress("")
    return servos


def _cpus() -> tuple[int, int] | tuple[None, None]:
    """Choose a CPU for the responders and one for the drivers.

    Left to the system, both share a CPU now and then, which is faster than a wake-up on another one: then the
    median would say more of that than of the driver. A servo has a CPU of its own.
    """
    cpus = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return (cpus[0], cpus[1]) if len(cpus) > 1 else (None, None)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{text:<20}\r", end="", file=sys.stderr, flush=True)


def _show(servos: dict[str, Timings], delay: float, names: list[str]) -> None:
    floor, bare = servos[FLOOR], servos[BARE]
    print(f"read present_position, {delay:g} µs from request to reply; {sum(map(len, floor.times))} reads each")
    print(f"{'driver':<22}{'median µs':>10}{'p99 µs':>9}{'x floor':>9}{'CPU µs':>9}{'x bare':>8}{'lost':>6}")
    for name in (FLOOR, *names):
        if name not in servos:
            print(f"{name:<22}  does not run here; its message is above")
            continue
        tally = servos[name]
        if not all(map(_good, tally.times)):
            print(f"{name:<22}  lost {tally.lost} of {sum(map(len, tally.times))} reads, all of some rounds")
            continue
        median, p99 = statistics.median(tally.all), statistics.quantiles(tally.all, n=100)[98]
        print(
            f"{name:<22}{median * 1e6:>10.1f}{p99 * 1e6:>9.1f}{tally.slower_than(floor):>9.2f}"
            f"{tally.cpu_each * 1e6:>9.1f}{tally.busier_than(bare):>8.2f}{tally.lost:>6}"
        )
    print(flush=True)


if __name__ == "__main__":
    main()
