"""What it costs to read through a server that shares the port: reads on the port itself and through it, in one run.

    python -m bench.server [--reads N] [--rounds N] [--quick]

The servo is a responder in C that answers 500 µs after the request, the RX-28's factory setting (manual 3-4-1), over a
pseudo terminal. Both drivers are processes of their own, each with a responder of its own, and so is the server; they
take turns round by round. What is added is the median over the rounds of the difference of their medians. Then several
programs read through the server at once: how many reads a second they get together.
"""

import argparse
import asyncio
import math
import os
import statistics
import sys
import tempfile
from contextlib import ExitStack

from bench.programs import NoCompiler, Program, compiled

DELAY = 500
"""µs from the request to the reply."""
PROGRAMS = (1, 2, 4)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.server", description="Reads through a server, in µs.")
    parser.add_argument("--reads", type=int, default=10_000, help="reads of each driver")
    parser.add_argument("--rounds", type=int, default=40, help="rounds they are spread over")
    parser.add_argument("--quick", action="store_true", help="1000 reads in 10 rounds")
    parser.add_argument("--serve", metavar="PORT", help="be the server")
    args = parser.parse_args(arguments)
    if args.serve:
        asyncio.run(_serve(args.serve))
        return
    reads, rounds = (1_000, 10) if args.quick else (args.reads, args.rounds)
    try:
        with compiled("responder") as (responder,), tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_RUNTIME_DIR"] = folder  # programs find the server by the file that it leaves there
            for driver in ("servobus", "servobus async"):
                _compare(str(responder), driver, reads, rounds)
            _together(str(responder), reads)
    except NoCompiler as error:
        sys.exit(f"bench.server: {error}")


async def _serve(port: str) -> None:
    from servobus.server.ports.hosting import hosting

    async with hosting({"arm": port}):
        print("ready", flush=True)
        await asyncio.Event().wait()


def _client(stack: ExitStack, driver: str, port: str) -> Program:
    client = stack.enter_context(Program(sys.executable, "-m", "bench.clients", driver, port))
    assert client.hear() == "ready", f"{driver} on {port}"
    return client


def _server(stack: ExitStack, responder: str) -> Program:
    servo = stack.enter_context(Program(responder, str(DELAY)))
    server = stack.enter_context(Program(sys.executable, "-m", "bench.server", "--serve", servo.hear()))
    assert server.hear() == "ready"
    return server


def _compare(responder: str, driver: str, reads: int, rounds: int) -> None:
    each = -(-reads // rounds)
    with ExitStack() as stack:
        servo = stack.enter_context(Program(responder, str(DELAY)))
        clients = [_client(stack, driver, servo.hear())]
        _server(stack, responder)
        clients.append(_client(stack, driver, "servobus:///arm"))
        medians: list[list[float]] = [[], []]
        taken: list[list[float]] = [[], []]
        for _ in range(rounds):
            for n, client in enumerate(clients):
                client.say(str(each))
                good = [seconds for seconds in map(float, client.hear().split()[1:]) if math.isfinite(seconds)]
                medians[n].append(statistics.median(good))
                taken[n] += good
    added = statistics.median(shared - alone for alone, shared in zip(*medians, strict=True))
    print(f"{driver}: read present_position, {DELAY} µs from request to reply; {each * rounds} reads each")
    for name, times in zip(("on the port", "through the server"), taken, strict=True):
        p99 = sorted(times)[int(0.99 * len(times))]
        lost = each * rounds - len(times)
        print(f"  {name:<20}{statistics.median(times) * 1e6:>8.0f} µs, p99 {p99 * 1e6:.0f} µs, {lost} lost")
    print(f"  {'added':<20}{added * 1e6:>8.0f} µs")


def _together(responder: str, reads: int) -> None:
    print("programs that read through one server at once, and what they get together")
    for number in PROGRAMS:
        with ExitStack() as stack:
            _server(stack, responder)
            clients = [_client(stack, "servobus", "servobus:///arm") for _ in range(number)]
            each = -(-reads // number)
            for client in clients:
                client.say(str(each))
            spent = max(sum(map(float, client.hear().split()[1:])) for client in clients)
        print(f"  {number}: {number * each / spent:>8.0f} reads a second")


if __name__ == "__main__":
    main()
