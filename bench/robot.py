"""A robot on three ports: its control cycle beside the slowest port alone, and how punctual a motion is played.

    python -m bench.robot [--cycles N] [--rounds N] [--servos N] [--seconds N] [--quick]

Each port is a responder in C behind a pseudo terminal, a process of its own. It answers as RX-28 do at 1 Mbit/s: the
time that request and reply of a read take on the wire passes before the reply, and in a second table the return delay
of the factory on top. The cycle reads the position of all servos. Each port alone is a robot of one port; all take
turns, in each round in another order, and a rate is compared with those of the same round: the share is the median of
these ratios. The figures themselves say as much of the machine, and of what else it does, as of the driver. Python runs
one thread at a time: where the processor time of a cycle of three ports is more than the slowest port alone takes, no
driver in Python could keep up its rate. The responders want processors too, one each.

A motion is played at 100 goals a second on virtual servos that another process serves. The time of the goals of
each turn is taken as it is handed to the port, and beside it, in turn, that of a bare loop which sleeps until its next
turn is due and does nothing. Shown is by how much the time from turn to turn misses 10 ms.
"""

import argparse
import os
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import servobus
from bench.programs import NoCompiler, Program, compiled
from servobus.robots.file.reading import read_text

PORTS = ("left", "middle", "right")
BAUD = 1_000_000
ON_THE_WIRE = 16 * 10 / BAUD
"""s that a read and its reply take, 8 bytes each (RX-28 manual 3-2)."""
DELAYS = (0.0, 0.0005)
"""s: no return delay, and that of the factory (RX-28 manual 3-4-1)."""
ALL = "three ports"
RATE = 100.0
"""Turns a second of a motion that is played."""
AT = 150 * servobus.deg
LASTS = 1.0
"""s from one step of the motion to the next."""
ANGLES = (150, 170, 150)
"""deg that all joints go to, one step of the motion each."""
SYNC_WRITE = b"\x83"
"""Instruction of the packet that carries the goals (RX-28 manual 3-5-7)."""
WARM_UP = 20


def robot_file(paths: dict[str, str], servos: int) -> str:
    """Write a robot file with some RX-28 on each port."""
    text = "[robot]\nformat = 1\n"
    for port, path in paths.items():
        text += f'[port.{port}]\npath = "{path}"\necho = false\n'
        for id in range(1, servos + 1):
            text += f'[joint.{port}{id}]\nport = "{port}"\nmodel = "rx28"\nid = {id}\nbaud = {BAUD}\n'
    return text


def wave() -> str:
    """Write a motion of all joints."""
    steps = []
    for number, angle in enumerate(ANGLES):
        joints = ", ".join(f'{port}{id} = "{angle}deg"' for port in PORTS for id in (1, 2))
        steps.append(f'{{ time = "{number * LASTS:g}s", joints = {{ {joints} }} }}')
    return f"[motion.wave]\nsteps = [{', '.join(steps)}]\n"


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.robot", description="Cycles of a robot on three ports.")
    parser.add_argument("--cycles", type=int, default=2000, help="cycles of each, of each delay")
    parser.add_argument("--rounds", type=int, default=20, help="rounds they are spread over")
    parser.add_argument("--seconds", type=float, default=12.0, help="that a motion is played")
    parser.add_argument("--servos", type=int, default=4, help="on each port")
    parser.add_argument("--quick", action="store_true", help="200 cycles in 5 rounds")
    args = parser.parse_args(arguments)
    cycles, rounds = (200, 5) if args.quick else (args.cycles, args.rounds)
    print(f"cycles of three ports with {args.servos} RX-28 each at {BAUD} bit/s, beside each port alone")
    print(f"{len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()} processors")
    print(f"{'':>16}{'cycles/s':>13}{'':>13}{'':>8}{'CPU µs':>13}")
    print(f"{'return delay µs':>16}{'slowest':>13}{'three':>13}{'share':>8}{'one':>13}{'three':>13}")
    try:
        with compiled("responder") as (responder,):
            for delay in DELAYS:
                _show(delay, _measure(responder, delay, args.servos, cycles, rounds))
    except NoCompiler as error:
        sys.exit(f"bench.robot: {error}")
    if os.name == "posix":
        _show_jitter(*_play(4.0 if args.quick else args.seconds))


@dataclass(slots=True)
class Taken:
    """What a cycle took, round by round; seconds."""

    median: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)


def _measure(responder: Path, delay: float, servos: int, cycles: int, rounds: int) -> dict[str, Taken]:
    """Time the cycles of the whole robot and of each port alone."""
    order = random.Random(1)
    with ExitStack() as stack:
        paths = {}
        for port in PORTS:
            program = stack.enter_context(Program(str(responder), str(round((ON_THE_WIRE + delay) * 1e6))))
            paths[port] = program.hear()
        taken = {name: Taken() for name in (ALL, *PORTS)}
        for _ in range(rounds):
            for name in order.sample(list(taken), len(taken)):
                ports = paths if name == ALL else {name: paths[name]}
                with servobus.robot(read_text(robot_file(ports, servos))) as arm:
                    _take(taken[name], arm.cycle().run, -(-cycles // rounds))
        return taken


def _take(taken: Taken, run: Callable[[], object], cycles: int) -> None:
    for _ in range(WARM_UP):
        run()
    times = []
    spent = time.process_time()
    for _ in range(cycles):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    taken.cpu.append((time.process_time() - spent) / cycles)
    taken.median.append(statistics.median(times))


def _show(delay: float, taken: dict[str, Taken]) -> None:
    whole, alone = taken[ALL], [taken[port] for port in PORTS]
    slowest = [max(times) for times in zip(*(port.median for port in alone), strict=True)]
    share = statistics.median(one / all for one, all in zip(slowest, whole.median, strict=True))
    cpus = statistics.median(alone[0].cpu), statistics.median(whole.cpu)
    print(
        f"{delay * 1e6:>16.0f}{1 / statistics.median(slowest):>13.0f}{1 / statistics.median(whole.median):>13.0f}"
        f"{share:>8.1%}{cpus[0] * 1e6:>13.0f}{cpus[1] * 1e6:>13.0f}",
        flush=True,
    )


def _play(seconds: float) -> tuple[list[float], list[float]]:
    """Give the s between two turns of a motion that is played, and of a bare loop."""
    played: list[float] = []
    bare: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = {port: f"/dev/{port}" for port in PORTS}
        (folder / "arm.toml").write_text(robot_file(paths, 2) + wave(), encoding="utf-8")
        serve = ["-m", "servobus", "virtual", str(folder / "arm.toml"), "--pty", str(folder / "ports")]
        with Program(sys.executable, *serve) as server:
            for _ in PORTS:
                server.hear()  # "ready ..."
            with servobus.robot(folder / "ports" / "arm.toml") as arm, arm.torque():
                port = arm.buses[PORTS[0]].transport
                times: list[float] = []
                write = port.write

                def timed(data: bytes) -> None:
                    if data[4:5] == SYNC_WRITE:
                        times.append(time.perf_counter())
                    write(data)

                while len(bare) < seconds * RATE:
                    arm.move({joint.name: AT for joint in arm}, speed=1.0).wait()
                    port.write = timed  # type: ignore[method-assign] # the time is taken on the way
                    arm.play("wave", rate=RATE).wait()
                    port.write = write  # type: ignore[method-assign]
                    played += [now - before for before, now in pairwise(times)]
                    times.clear()
                    turns = _bare(2 * LASTS)
                    bare += [now - before for before, now in pairwise(turns)]
    return played, bare


def _bare(seconds: float) -> list[float]:
    """Give the times of a loop that does nothing at a fixed rate."""
    times = []
    due = time.perf_counter()
    for _ in range(round(seconds * RATE)):
        due += 1 / RATE
        time.sleep(max(0.0, due - time.perf_counter()))
        times.append(time.perf_counter())
    return times


def _show_jitter(played: list[float], bare: list[float]) -> None:
    print(f"\n{'':>16}{'turns':>8}{'off by: median ms':>20}{'p99 ms':>9}{'max ms':>9}")
    for title, times in ((f"play, {RATE:g} Hz", played), ("a bare loop", bare)):
        off = [abs(one - 1 / RATE) * 1e3 for one in times]
        figures = statistics.median(off), statistics.quantiles(off, n=100)[98], max(off)
        print(f"{title:>16}{len(off):>8}{figures[0]:>20.2f}{figures[1]:>9.2f}{figures[2]:>9.2f}", flush=True)


if __name__ == "__main__":
    main()
