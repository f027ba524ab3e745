"""Reads a second over a pseudo terminal, ours beside other drivers, interleaved in one run.

    python -m bench.reads [--reads N] [--rounds N] [--baud N]

The servo is a virtual RX-28 with return delay 0, so that the wire takes 16 byte times for each read. Compare
the ratios, not the absolute figures: they depend on the machine and on what else it does.
"""

import argparse
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.clients import CLIENTS
from servobus import RX28
from servobus import open as open_port

BYTES = 8 + 8
"""Request and reply of a read of two bytes (RX-28 manual 3-5-1)."""


@contextmanager
def virtual_servo(baud: int, delay: float = 0.0) -> Iterator[str]:
    """Serve one RX-28 behind a pseudo terminal in a process of its own, with a return delay in s."""
    with tempfile.TemporaryDirectory() as folder:
        port = str(Path(folder) / "rx28")
        command = [sys.executable, "-m", "servobus", "virtual", "rx28@1", "--baud", str(baud), "--pty", port]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                process.stdout.readline()  # "ready ..."
                with open_port(port, bauds=baud) as bus:
                    bus.attach(RX28, 1, baud=baud).write(RX28.return_delay_time, delay)
                yield port
            finally:
                process.terminate()


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.reads", description="Reads a second over a pseudo terminal.")
    parser.add_argument("--reads", type=int, default=200, help="reads of each driver in a round")
    parser.add_argument("--rounds", type=int, default=10, help="rounds; the drivers take turns")
    parser.add_argument("--baud", type=int, default=1_000_000)
    args = parser.parse_args(arguments)

    times: dict[str, list[float]] = {name: [] for name in CLIENTS}
    cpu: dict[str, float] = dict.fromkeys(CLIENTS, 0.0)
    with virtual_servo(args.baud) as port:
        for done in range(args.rounds):
            for name, client in CLIENTS.items():
                before = time.process_time()
                times[name] += client(port, args.baud, args.reads)
                cpu[name] += time.process_time() - before
            print(f"\rround {done + 1} of {args.rounds}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)

    wire = BYTES * 10 / args.baud * 1e6
    print(f"read present_position of a virtual RX-28 at {args.baud} baud; the wire alone takes {wire:.0f} µs")
    print(f"{'driver':<16}{'reads/s':>9}{'median µs':>11}{'p99 µs':>9}{'CPU µs':>8}{'lost':>6}{'ratio':>8}")
    ours = statistics.median(filter(math.isfinite, times["servobus"]))
    for name, taken in times.items():
        good = [seconds for seconds in taken if math.isfinite(seconds)]
        median, p99 = statistics.median(good), statistics.quantiles(good, n=100)[98]
        spent = cpu[name] / len(taken)
        print(
            f"{name:<16}{1 / statistics.fmean(good):>9.0f}{median * 1e6:>11.0f}{p99 * 1e6:>9.0f}"
            f"{spent * 1e6:>8.0f}{len(taken) - len(good):>6}{median / ours:>8.2f}"
        )


if __name__ == "__main__":
    main()
