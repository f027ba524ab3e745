"""The same wire faults through all drivers, over a pseudo terminal, in one run.

    python -m bench.faults [--reads N] [--kind NAME ...] [--only NAME ...] [--rate SHARE] [--seed N]

A value is right if it is the one that the servo gave to a request of this very read; anything else that a driver
returns as good is wrong. After the reads under faults come some without: a driver whose last reads are right
has recovered. A read that takes longer than 5 s hangs; its process is killed.
"""

import argparse
import sys
from bisect import bisect_left, bisect_right
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Self

from bench.clients import CLIENTS
from bench.faulty import KINDS
from bench.programs import Program, Silent

CLEAN, LAST = 15, 5
"""Reads after the faults, and how many at their end must be right."""
HANGS = 5.0
"""s"""
DRIVERS = [name for name in CLIENTS if name != "bare Python"]
READY, RIGHT, WRONG = "ready", "right", "wrong"


@dataclass(slots=True)
class Outcome:
    """What became of the reads of one driver under one kind of fault."""

    faults: int = 0
    right: int = 0
    wrong: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    end: str = ""
    """yes or no, whether it recovered; or what else became of it."""

    def __iadd__(self, other: "Outcome") -> Self:
        self.faults += other.faults
        self.right += other.right
        self.wrong += other.wrong
        self.errors += other.errors
        return self

    @property
    def reads(self) -> int:
        return self.right + self.wrong + self.errors.total()


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.faults", description="Wire faults, and what drivers make of them.")
    parser.add_argument("--reads", type=int, default=80, help="reads of each driver under each kind of fault")
    parser.add_argument("--rate", type=float, default=0.2, help="share of the replies that suffer")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS), help="these faults alone")
    parser.add_argument("--only", nargs="+", choices=DRIVERS, default=DRIVERS, help="these drivers alone")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)

    print(f"{args.rate:.0%} of the replies suffer; then {CLEAN} reads without faults, of which the last {LAST} count")
    print(f"{'fault':<16}{'driver':<22}{'reads':>6}{'faults':>8}{'right':>7}{'WRONG':>7}{'errors':>8}  recovered")
    sums = {name: Outcome() for name in args.only}
    ends: dict[str, Counter[str]] = {name: Counter() for name in args.only}
    with ExitStack() as stack:
        askers: dict[str, Program] = {}
        for kind in args.kind:
            for name in args.only:
                if name not in askers:
                    askers[name] = stack.enter_context(Program(sys.executable, "-m", "bench.asker", name, quiet=True))
                outcome = _run(askers[name], kind, args.seed, args.rate, args.reads)
                if outcome.end in ("hung", "died"):
                    del askers[name]  # the next kind gets a new one; this one is killed in the end
                _show(kind if name == args.only[0] else "", name, outcome)
                sums[name] += outcome
                ends[name][outcome.end] += 1
    print(
        f"\n{'all of them':<16}{'driver':<22}{'reads':>6}{'faults':>8}{'right':>7}{'WRONG':>7}{'errors':>8}  recovered"
    )
    for name, outcome in sums.items():
        outcome.end = ", ".join(f"{end} {count}" for end, count in ends[name].most_common())
        _show("", name, outcome, names=False)


def _show(kind: str, name: str, outcome: Outcome, *, names: bool = True) -> None:
    errors = ", ".join(f"{error} {count}" for error, count in outcome.errors.most_common(3)) if names else ""
    print(
        f"{kind:<16}{name:<22}{outcome.reads:>6}{outcome.faults:>8}{outcome.right:>7}{outcome.wrong:>7}"
        f"{outcome.errors.total():>8}  {outcome.end:<10}{errors}".rstrip(),
        flush=True,
    )


def _run(asker: Program, kind: str, seed: int, rate: float, reads: int) -> Outcome:
    outcome = Outcome()
    share = {"none": 0.0, "echo": 1.0}.get(kind, rate)
    answers: list[tuple[float, float, str]] = []
    with Program(sys.executable, "-m", "bench.faulty", kind, str(seed), str(share)) as servo:
        port = servo.hear()
        try:
            asker.say(port)
            word, *why = asker.hear(HANGS).split()
            if word != READY:
                outcome.end = f"does not start: {' '.join(why)}"
                return outcome
            for order, count in (("on", reads), ("off", CLEAN)):
                servo.say(order)
                servo.hear()
                asker.say(str(count))
                for _ in range(count):
                    began, ended, said = asker.hear(HANGS).split()
                    answers.append((float(began), float(ended), said))
            asker.say("")
            asker.hear(HANGS)
        except Silent as how:
            outcome.end = str(how)
        servo.say("end")
        log = _log(servo)
    outcome.faults = sum(suffered for _, _, suffered in log)
    verdicts = [_verdict(*answer, log) for answer in answers]
    outcome.right, outcome.wrong = verdicts.count(RIGHT), verdicts.count(WRONG)
    outcome.errors = Counter(verdict for verdict in verdicts if verdict not in (RIGHT, WRONG))
    outcome.end = outcome.end or ("yes" if verdicts[-LAST:] == [RIGHT] * LAST else "NO")
    return outcome


def _log(servo: Program) -> list[tuple[float, int, bool]]:
    """Give the servo's log: when each request came, the position in its reply, whether that reply suffered."""
    log = []
    while line := servo.hear():
        when, position, suffered = line.split()
        log.append((float(when), int(position), suffered == "1"))
    return log


def _verdict(began: float, ended: float, said: str, log: list[tuple[float, int, bool]]) -> str:
    """Tell right from wrong; an exception is given back as it is."""
    if not said.lstrip("-").isdigit():
        return said
    first = bisect_left(log, began, key=itemgetter(0))
    last = bisect_right(log, ended, key=itemgetter(0))
    return RIGHT if int(said) in [position for _, position, _ in log[first:last]] else WRONG


if __name__ == "__main__":
    main()
