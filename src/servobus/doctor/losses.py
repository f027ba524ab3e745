"""How many answers are lost, why, and how long the others take."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

from servobus.bus.blocking import Bus, BusServo
from servobus.core.exchange import Exchange, Procedure
from servobus.doctor.findings import NOISE, Finding, Severity, Watcher, duplicate_id, id_list, is_noise
from servobus.errors import (
    BadChecksum,
    BadReading,
    BrokenEcho,
    BusError,
    DuplicateId,
    Garbled,
    LineBusy,
    NoReply,
    WrongReply,
)

T = TypeVar("T")

LOSSY = 0.01
"""Share of lost answers from which on a bus is not usable; below it is worth a look."""
HOPELESS = 20
"""Answers lost in a row after which a servo is asked no more."""

DOUBLED = 3
"""Questions answered twice from which on two servos are said to have one id; assumption: fewer may be late answers."""
_ANSWERED_TWICE = "answered twice"

_KINDS: tuple[tuple[type[BusError], str, str], ...] = (
    (BadChecksum, "with a wrong checksum", "noise, a line without termination, or two servos with one id"),
    (Garbled, "garbled", "noise, a missing ground wire, or two servos with one id"),
    (WrongReply, "of another servo or request", "another program on the line, or answers that come too late"),
    (NoReply, "silent", "a loose plug, a servo that restarts for want of power, or an adapter slower than it says"),
    (DuplicateId, _ANSWERED_TWICE, "two servos with one id, or answers that come late"),
    (BrokenEcho, "with a wrong echo", "another program or a servo that talks at the same time, or a bad adapter"),
    (LineBusy, "on a busy line", "another program on the line, or noise without end"),
    (BadReading, "out of range", "a servo of another model than it is taken for; --model names the model"),
    (BusError, "refused", "a servo that does not know the request"),
)
"""What was lost, in words, and what may be its cause; the first that fits."""
_CAUSES = {kind: cause for _, kind, cause in _KINDS}
_UNCLEAR = [kind for error, kind, _ in _KINDS if issubclass(error, Garbled)]
_QUANTILES = (("median", 0.5), ("p99", 0.99), ("longest", 1.0))


@dataclass(slots=True)
class ReadCounts:
    """Reads that were counted: how long each took in seconds, and why others were lost."""

    times: list[float] = field(default_factory=list)
    lost: Counter[str] = field(default_factory=Counter)
    by_servo: dict[BusServo, Counter[str]] = field(default_factory=dict)
    """What was lost, by servo and kind."""

    @property
    def reads(self) -> int:
        return len(self.times) + self.lost.total()

    def quantile(self, share: float) -> float:
        """Give the time within which this share of the answers came, s."""
        times = sorted(self.times)
        return times[min(int(share * len(times)), len(times) - 1)]


def losses(
    bus: Bus, servos: Sequence[BusServo], reads: int, watch: Watcher, taken: set[int] | None = None
) -> Iterator[Finding]:
    """Read positions so many times in all, and say how many answers were lost; `taken` as for `duplicate_id`."""
    counts = count(bus, servos, reads, watch)
    taken = {servo.id for servo in servos} | (taken or set())
    garbled = [servo for servo, lost in counts.by_servo.items() if sum(lost[kind] for kind in _UNCLEAR) >= HOPELESS]
    if is_noise(len(garbled), len(servos)):
        what = f"{id_list(servo.id for servo in garbled)}: their answers are garbled again and again"
        yield Finding(Severity.FAIL, "ids", what, NOISE)
        garbled = []
    for servo in garbled:
        what = f"{servo.target}: its answers are garbled again and again"
        yield duplicate_id(bus.transport.name, what, (servo.family, servo.id, servo.baud), taken)
    for servo, lost in counts.by_servo.items():
        if lost[_ANSWERED_TWICE] >= DOUBLED:
            what = f"{servo.target}: two answers come to one question again and again"
            yield duplicate_id(bus.transport.name, what, (servo.family, servo.id, servo.baud), taken)
    yield _summary(counts)


def _summary(counts: ReadCounts) -> Finding:
    times = []
    if counts.times:
        took = ", ".join(f"{name} {1000 * counts.quantile(share):.2f} ms" for name, share in _QUANTILES)
        times = [f"answers after {took}"]
    lost = counts.lost.total()
    if not lost:
        return Finding(Severity.OK, "reads", "; ".join([f"{counts.reads}, none lost", *times]))
    kinds = ", ".join(f"{number} {kind}" for kind, number in counts.lost.most_common())
    what = [f"{lost} of {counts.reads} lost ({100 * lost / counts.reads:.1f} %): {kinds}"]
    if len(counts.by_servo) > 1:
        worst = max(counts.by_servo, key=lambda servo: counts.by_servo[servo].total())
        what.append(f"worst is {worst.target} with {counts.by_servo[worst].total()}")
    level = Severity.FAIL if lost >= LOSSY * counts.reads else Severity.WARN
    return Finding(level, "reads", "; ".join(what + times), _CAUSES[counts.lost.most_common(1)[0][0]])


def count(bus: Bus, servos: Sequence[BusServo], reads: int, watch: Watcher = lambda *_: None) -> ReadCounts:
    """Read the position of each servo, so many times in all, and count what is lost. Nothing is asked twice."""
    counts = ReadCounts()
    share, rest = divmod(reads, len(servos))
    done = 0
    for number, servo in enumerate(servos):
        row = servo.model.register("present_position")
        lost = counts.by_servo.setdefault(servo, Counter())
        missed = 0
        with suppress(BusError):  # what follows a change of speed is no part of what is measured
            bus.do(servo.family.ping(servo.id).no_retry(), baud=servo.baud)
        for _ in range(share + (number < rest)):
            start = bus.transport.now()
            try:
                bus.do(_without_retries(servo.family.read(servo.target, [row])), baud=servo.baud)
            except BusError as error:
                kind = next(name for error_type, name, _ in _KINDS if isinstance(error, error_type))
                counts.lost[kind] += 1
                lost[kind] += 1
                missed += 1
            else:
                counts.times.append(bus.transport.now() - start)
                missed = 0
            done += 1
            watch("reading", done, reads)
            if missed == HOPELESS:
                break
    return counts


def _without_retries(job: Procedure[T]) -> Procedure[T]:
    """Carry out a job without the second tries that would hide what is lost."""
    result: Any = None
    while True:
        try:
            step = job.send(result)
        except StopIteration as stop:
            done: T = stop.value
            return done
        result = yield step.no_retry() if isinstance(step, Exchange) else step
