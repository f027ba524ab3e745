"""Reads over a pseudo terminal: ours beside other drivers, interleaved in one run.

    python -m bench.reads [--reads N] [--rounds N] [--quick] [--only NAME ...]

The servo is a responder in C that answers at once, and in a second table 500 µs after the request. No driver
can be faster than the floor, a client in C; the CPU of a driver in Python can hardly be below that of a bare
loop of write, poll and read. Each driver is a process of its own with a responder of its own; they take turns
in an order that is drawn anew for each round. A pseudo terminal carries no bit times, so that both families
compare with one floor. Compare the ratios, not the absolute figures: they depend on the machine and on what
else it does.
"""

import argparse
import math
import random
import statistics
import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from bench.clients import CLIENTS
from bench.programs import NoCompiler, Worker, compiled, python_worker, responder

DELAYS = (0.0, 0.0005)
"""s from the request to the reply; the second is the RX-28's factory setting (manual 3-4-1)."""
FLOOR = "C floor"
BARE = "bare Python"


@dataclass(slots=True)
class Tally:
    """What one driver took."""

    cpu: float = 0.0
    times: list[float] = field(default_factory=list)

    @property
    def good(self) -> list[float]:
        return [seconds for seconds in self.times if math.isfinite(seconds)]

    @property
    def median(self) -> float:
        return statistics.median(self.good)

    @property
    def p99(self) -> float:
        return statistics.quantiles(self.good, n=100)[98]

    @property
    def cpu_each(self) -> float:
        return self.cpu / len(self.times)


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
                tallies = _measure(answers, floor, names, delay / 1e6, reads, rounds, random.Random(args.seed))
                _show(tallies, delay, names)
    except NoCompiler as error:
        sys.exit(f"bench.reads: {error}")


def _measure(
    answers: Path, floor: Path, names: list[str], delay: float, reads: int, rounds: int, order: random.Random
) -> dict[str, Tally]:
    with ExitStack() as stack:
        workers = {FLOOR: Worker(stack, str(floor), stack.enter_context(responder(answers, delay)))}
        for name in names:
            worker = python_worker(stack, name, stack.enter_context(responder(answers, delay)))
            if worker.works:
                workers[name] = worker
        tallies = {name: Tally() for name in workers}
        for done in range(rounds):
            _progress(f"round {done + 1} of {rounds}")
            for name in order.sample(list(workers), len(workers)):
                cpu, times = workers[name].reads(-(-reads // rounds))
                tallies[name].cpu += cpu
                tallies[name].times += times
    _progress("")
    return tallies


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{text:<20}\r", end="", file=sys.stderr, flush=True)


def _show(tallies: dict[str, Tally], delay: float, names: list[str]) -> None:
    print(f"read present_position, {delay:g} µs from request to reply; {len(tallies[FLOOR].times)} reads each")
    print(f"{'driver':<22}{'median µs':>10}{'p99 µs':>9}{'x floor':>9}{'CPU µs':>9}{'x bare':>8}{'lost':>6}")
    floor, bare = tallies[FLOOR], tallies[BARE]
    for name in (FLOOR, *names):
        if name not in tallies:
            print(f"{name:<22}  does not run here; its message is above")
            continue
        tally = tallies[name]
        if len(tally.good) < 2:
            print(f"{name:<22}  no read of {len(tally.times)} came back")
            continue
        print(
            f"{name:<22}{tally.median * 1e6:>10.1f}{tally.p99 * 1e6:>9.1f}{tally.median / floor.median:>9.2f}"
            f"{tally.cpu_each * 1e6:>9.1f}{tally.cpu_each / bare.cpu_each:>8.2f}{len(tally.times) - len(tally.good):>6}"
        )
    print(flush=True)


if __name__ == "__main__":
    main()
