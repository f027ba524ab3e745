"""How punctual a virtual servo answers over a pseudo terminal.

    python -m bench.latency [--count N] [--baud N]

A bare client (write, select, read) sends PING and takes the time until the first byte of the answer. Less what
the request and that byte take on the wire, this should be the return delay; what is more is the machine's.
"""

import argparse
import os
import select
import statistics
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import serial

from servobus import RX28
from servobus import open as open_port

PING = bytes.fromhex("FF FF 01 02 01 FB")  # RX-28 manual 3-5-5, Example 3
ANSWER = 6
DELAYS = (0.0, 0.0005)
"""s: none, and the factory setting (RX-28 manual 3-4-1)."""


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
    parser = argparse.ArgumentParser(prog="bench.latency", description="Punctuality of a virtual servo.")
    parser.add_argument("--count", type=int, default=1000, help="PINGs for each return delay")
    parser.add_argument("--baud", type=int, default=1_000_000)
    args = parser.parse_args(arguments)

    print(f"from the end of PING to the first byte of the answer, at {args.baud} baud, over a pseudo terminal")
    print(f"{'return delay µs':>16}{'median µs':>11}{'p99 µs':>9}{'late: median µs':>17}{'p99 µs':>9}{'lost':>6}")
    for delay in DELAYS:
        with virtual_servo(args.baud, delay) as port:
            taken, lost = _measure(port, args.baud, args.count)
        median, p99 = statistics.median(taken), statistics.quantiles(taken, n=100)[98]
        late, late99 = median - delay, p99 - delay
        figures = f"{median * 1e6:>11.0f}{p99 * 1e6:>9.0f}{late * 1e6:>17.0f}{late99 * 1e6:>9.0f}"
        print(f"{delay * 1e6:>16.0f}{figures}{lost:>6}")


def _measure(port: str, baud: int, count: int) -> tuple[list[float], int]:
    """Give the seconds from the end of each request to the start of the answer, and how many were lost."""
    on_wire = (len(PING) + 1) * 10 / baud
    taken: list[float] = []
    with serial.Serial(port, baud, timeout=0) as terminal:
        fd = terminal.fileno()
        for _ in range(count):
            termios.tcflush(fd, termios.TCIFLUSH)
            start = time.perf_counter()
            os.write(fd, PING)
            if not select.select([fd], [], [], 0.2)[0]:
                continue
            taken.append(time.perf_counter() - start - on_wire)
            got = len(os.read(fd, ANSWER))
            while got < ANSWER and select.select([fd], [], [], 0.05)[0]:
                got += len(os.read(fd, ANSWER - got))
    return taken, count - len(taken)


if __name__ == "__main__":
    main()
