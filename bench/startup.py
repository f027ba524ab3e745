"""What it takes to start: `import servobus` and `servobus --help`, over a bare interpreter.

    python -m bench.startup [--runs N]

The runs take turns; the medians are compared.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time

COMMANDS = {
    "bare interpreter": ["-c", "pass"],
    "import servobus": ["-c", "import servobus"],
    "servobus --help": ["-m", "servobus", "--help"],
}
BARE = "bare interpreter"
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Compiled modules are kept, as they are for everybody who has not forbidden it."""


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.startup", description="Start-up times, in ms.")
    parser.add_argument("--runs", type=int, default=21, help="runs of each command")
    args = parser.parse_args(arguments)
    taken: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(args.runs + 1):
        for name, command in COMMANDS.items():
            start = time.perf_counter()
            subprocess.run([sys.executable, *command], stdout=subprocess.DEVNULL, env=ENVIRONMENT, check=True)
            taken[name].append(time.perf_counter() - start)
    medians = {name: statistics.median(times[1:]) for name, times in taken.items()}  # the first writes the .pyc
    print(f"{'start':<20}{'median ms':>11}{'over bare ms':>14}")
    for name, median in medians.items():
        print(f"{name:<20}{median * 1e3:>11.1f}{(median - medians[BARE]) * 1e3:>14.1f}")


if __name__ == "__main__":
    main()
