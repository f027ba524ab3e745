"""A driver that reads positions under faults, in a process of its own.

    python -m bench.asker NAME

It takes lines: the name of a port opens it (answered with `ready`, or `fails` and the exception), a number reads
so often, an empty line closes the port (answered with `closed`, or `fails`). Each read gives a line at once: when
it began and ended (s, monotonic clock), and the raw position it gave or the exception it raised.
"""

import sys
import time
from collections.abc import Iterator

from bench.clients import CLIENTS, Reads

PAUSE = 0.002
"""s between two reads: in a robot's loop the line is quiet now and then."""


def main() -> None:
    client = CLIENTS[sys.argv[1]]
    lines = iter(sys.stdin)
    for port in lines:
        try:
            with client(port.strip()) as reads:
                print("ready", flush=True)
                _ask(reads, lines)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # noqa: BLE001 - a panic in Rust is no Exception
            print("fails", type(error).__name__, flush=True)
        else:
            print("closed", flush=True)


def _ask(reads: Reads, lines: Iterator[str]) -> None:
    for line in lines:
        if not line.strip():
            return
        for _ in range(int(line)):
            began = time.monotonic()
            try:
                said = str(reads.raw(reads.read()))
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:  # noqa: BLE001 - as above
                said = type(error).__name__
            print(f"{began:.9f} {time.monotonic():.9f} {said}", flush=True)
            time.sleep(PAUSE)


if __name__ == "__main__":
    main()
