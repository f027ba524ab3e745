"""What it costs another program to share a bus: reads on the port itself, and on a port of its own, in one run.

    python -m bench.foreign [--reads N] [--rounds N] [--quick]

The servo is a responder in C that answers 500 µs after the request, the RX-28's factory setting (manual 3-4-1), over a
pseudo terminal. Each program is in a process of its own and has a responder of its own, and so is the server, with all
its gates; they take turns round by round. What is added is the median over the rounds of the difference of their
medians: the line is quiet otherwise.
"""

import argparse
import asyncio
import math
import statistics
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from bench.clients import RX28_BAUD
from bench.programs import NoCompiler, Program, compiled

DELAY = 500
"""µs from the request to the reply."""
PROGRAMS = ("bare Python", "dynamixel-sdk")
"""A program that only writes and reads, and ROBOTIS' own."""


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.foreign", description="Reads by other programs, in µs.")
    parser.add_argument("--reads", type=int, default=10_000, help="reads of each program")
    parser.add_argument("--rounds", type=int, default=40, help="rounds they are spread over")
    parser.add_argument("--quick", action="store_true", help="1000 reads in 10 rounds")
    parser.add_argument("--serve", nargs=2, metavar=("PORT", "LINK"), help="be the server")
    args = parser.parse_args(arguments)
    if args.serve:
        asyncio.run(_serve(args.serve[0], Path(args.serve[1])))
        return
    reads, rounds = (1_000, 10) if args.quick else (args.reads, args.rounds)
    try:
        with compiled("responder") as (responder,), tempfile.TemporaryDirectory() as folder:
            for program in PROGRAMS:
                _compare(str(responder), str(Path(folder) / "shared"), program, reads, rounds)
    except NoCompiler as error:
        sys.exit(f"bench.foreign: {error}")


async def _serve(port: str, link: Path) -> None:
    from servobus.server.ports.foreign import ForeignPty
    from servobus.server.ports.owner import PortOwner

    owner = PortOwner({}, boxes=link.parent)
    bus = owner.open_bus("arm", port).bus
    bus.attach("rx28", 1, baud=RX28_BAUD)
    async with ForeignPty(bus, "arm", owner.control, link):
        print("ready", flush=True)
        await asyncio.Event().wait()


def _client(stack: ExitStack, program: str, port: str) -> Program:
    client = stack.enter_context(Program(sys.executable, "-m", "bench.clients", program, port))
    assert client.hear() == "ready", f"{program} on {port}"
    return client


def _compare(responder: str, link: str, program: str, reads: int, rounds: int) -> None:
    each = -(-reads // rounds)
    with ExitStack() as stack:
        servo = stack.enter_context(Program(responder, str(DELAY)))
        clients = [_client(stack, program, servo.hear())]
        other = stack.enter_context(Program(responder, str(DELAY)))
        server = stack.enter_context(Program(sys.executable, "-m", "bench.foreign", "--serve", other.hear(), link))
        assert server.hear() == "ready"
        clients.append(_client(stack, program, link))
        medians: list[list[float]] = [[], []]
        taken: list[list[float]] = [[], []]
        for _ in range(rounds):
            for n, client in enumerate(clients):
                client.say(str(each))
                good = [seconds for seconds in map(float, client.hear().split()[1:]) if math.isfinite(seconds)]
                medians[n].append(statistics.median(good))
                taken[n] += good
    added = statistics.median(shared - alone for alone, shared in zip(*medians, strict=True))
    print(f"{program}: read present_position, {DELAY} µs from request to reply; {each * rounds} reads each")
    for name, times in zip(("on the port", "on a port of its own"), taken, strict=True):
        p99 = sorted(times)[int(0.99 * len(times))]
        lost = each * rounds - len(times)
        print(f"  {name:<22}{statistics.median(times) * 1e6:>8.0f} µs, p99 {p99 * 1e6:.0f} µs, {lost} lost")
    print(f"  {'added':<22}{added * 1e6:>8.0f} µs")


if __name__ == "__main__":
    main()
