"""What can go wrong on a bus, as words and as values.

    seed=7,drop=0.01,junk=0.02:1-64      one reply in a hundred loses a byte, one in fifty meets junk bytes
    flip@12#5                            bit 12 of the fifth reply is flipped
    unplug@3#100-200,latency=16ms        servo 3 is gone for a hundred requests, behind a slow adapter

A fault is KIND[@WHERE][#WHICH][=PROBABILITY][:ARGUMENT]. Replies and requests are counted on each wire from 1 on; every
fault throws dice of its own, seeded, once for each of them. So the same traffic meets the same faults each time,
however it is cut into pieces, and a fault more changes nothing about the others.

What carries this out is servobus.virtual.wire.injector.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final, Self

from servobus.core.ids import LAST_ID
from servobus.core.units import parse
from servobus.errors import BadValue
from servobus.virtual.wire.adapter import USB_PACKET, Adapter

SEPARATOR = re.compile(r"[,\s]+")
_CLAUSE = re.compile(
    r"(?P<kind>\w+)(?:@(?P<where>[^#=:]+))?(?:#(?P<which>[^@=:]+))?(?:=(?P<chance>[^@#:]+))?(?::(?P<argument>.+))?"
)
FORM = "KIND[@WHERE][#WHICH][=PROBABILITY][:ARGUMENT]"
MOST_JUNK = 4096
"""Bytes that one fault may insert."""


@dataclass(frozen=True, slots=True)
class Which:
    """Which replies or requests: from the number `first` to `last`; or, if `timed`, in this span of time, s."""

    first: float = 1
    last: float = float("inf")
    timed: bool = False

    def holds(self, number: int, time: float) -> bool:
        return self.first <= (time if self.timed else number) <= self.last


ALL: Final = Which()


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    kind         its name, a key of KINDS
    where        place in the packet, or ids, as its kind has it; None takes a place by chance, or all servos
    which        the replies or requests that may be hit
    probability  for each of these, 0 .. 1
    argument     as its kind has it; None takes the default

    Raises BadValue.
    """

    kind: str
    where: Any = None
    which: Which = ALL
    probability: float = 1.0
    argument: Any = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise BadValue(f"{self.kind!r} is no fault; there are {', '.join(KINDS)}, and {', '.join(SETTINGS)}")
        if not 0 <= self.probability <= 1:
            raise BadValue(f"{self.kind}: a probability of {self.probability:g} is not in 0 .. 1")
        if KINDS[self.kind].rare and self.which == ALL and self.probability == 1:
            raise BadValue(f"{self.kind}: say when, such as {self.kind}#10, {self.kind}#2s or {self.kind}=0.001")


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A kind of fault, for the help text and for the parser."""

    hits: str
    """"reply" or "request": what is counted."""
    what: str
    where: Callable[[str], Any] | None = None
    place: str = ""
    """What WHERE says, and what holds without it."""
    argument: Callable[[str], Any] | None = None
    more: str = ""
    """What ARGUMENT says, and what holds without it."""
    default: Any = None
    rare: bool = False
    """Whether it would make no sense at each request."""


@dataclass(frozen=True, slots=True)
class Injected:
    """One fault that was brought about."""

    kind: str
    number: int
    """Of the reply or request on its wire, from 1 on; 0 if it was a matter of time."""
    where: str
    """The place, in words: "byte 3", "bits 12, 44", "ids 1, 2"."""
    time: float
    """s"""
    wire: str
    """The family of the wire."""


@dataclass(frozen=True, slots=True)
class Faults:
    """All that goes wrong on a line.

    seed     of the dice
    faults   what befalls single packets and servos
    latency  s until the adapter hands over what it has received, and everything that came meanwhile
    jitter   s that this may take longer, by chance for each reply
    skews    (lowest id, highest id, error) of servos whose clock is fast, as a fraction: 0.03 is 3 % too fast
    """

    seed: int = 0
    faults: tuple[Fault, ...] = ()
    latency: float = 0.0
    jitter: float = 0.0
    skews: tuple[tuple[int, int, float], ...] = ()
    text: str = field(default="", compare=False)
    """What it was read from."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read "seed=7,drop=0.01,flip@12#5"; spaces may stand for the commas. Raises BadValue."""
        faults = cls(text=text)
        for part in filter(None, SEPARATOR.split(text)):
            match = _CLAUSE.fullmatch(part)
            if not match:
                raise BadValue(f"fault {part!r}: write {FORM}, such as drop=0.01 or flip@12#5")
            try:
                faults = faults._with(**match.groupdict())
            except ValueError as error:
                raise BadValue(f"fault {part!r}: {error}") from None
        return faults

    def __bool__(self) -> bool:
        return bool(self.faults or self.latency or self.jitter or self.skews)

    @property
    def adapter(self) -> Adapter | None:
        """The adapter that hands over so late; None if it is to be as it is."""
        return Adapter("usb", self.latency, USB_PACKET) if self.latency else None

    def skew(self, id: int) -> float:
        """Give the error of a servo's clock, as a fraction."""
        return sum(error for low, high, error in self.skews if low <= id <= high)

    def _with(self, kind: str, where: str | None, which: str | None, chance: str | None, argument: str | None) -> Self:
        if kind in SETTINGS:
            if chance is None or which or argument or (where and kind != "skew"):
                raise BadValue(f"write {SETTINGS[kind]}")
            match kind:
                case "seed":
                    return replace(self, seed=int(chance))
                case "latency":
                    return replace(self, latency=_time(chance))
                case "jitter":
                    return replace(self, jitter=_time(chance))
            return replace(self, skews=(*self.skews, (*_ids(where or f"0-{LAST_ID}"), _percent(chance))))
        about = KINDS.get(kind, FaultKind("", ""))
        fault = Fault(
            kind,
            _value("WHERE", kind, where, about.where, about.place) if kind in KINDS else None,
            _which(which) if which else ALL,
            float(chance) if chance else 1.0,
            _value("ARGUMENT", kind, argument, about.argument, about.more) if kind in KINDS else None,
        )
        return replace(self, faults=(*self.faults, fault))


def _value(name: str, kind: str, text: str | None, read: Callable[[str], Any] | None, meaning: str) -> Any:
    if text is None:
        return None
    if read is None:
        raise BadValue(f"{kind} has no {name}, so {text!r} means nothing")
    try:
        return read(text)
    except ValueError as error:
        raise BadValue(f"{name} of {kind} is: {meaning} ({error})") from None


def _time(text: str) -> float:
    seconds = parse(text, "s")
    if not 0 <= seconds < float("inf"):
        raise BadValue(f"{text!r} is no time to wait")
    return seconds


def _percent(text: str) -> float:
    error = float(text.removesuffix("%")) / 100
    if not -0.5 <= error <= 1:
        raise BadValue(f"{text!r} is not in -50 .. 100 %")
    return error


def _number(text: str) -> int:
    if not text.isdecimal():
        raise BadValue(f"{text!r} is no number from 0 on")
    return int(text)


def _range(text: str) -> tuple[int, int]:
    first, dash, last = text.partition("-")
    low = _number(first)
    high = _number(last) if dash else low
    if high < low:
        raise BadValue(f"{text} runs backwards")
    return low, high


def _ids(text: str) -> tuple[int, int]:
    low, high = _range(text)
    if high > LAST_ID:
        raise BadValue(f"{high} is no id; ids are 0 .. {LAST_ID}")
    return low, high


def _id(text: str) -> int:
    return _ids(text)[0]


def _junk(text: str) -> bytes | tuple[int, int]:
    if text.lower().startswith("0x"):
        return bytes.fromhex(text[2:])
    low, high = _range(text)
    if high > MOST_JUNK:
        raise BadValue(f"{high} bytes are more than {MOST_JUNK}")
    return low, high


def _one_of(*words: str, number: bool = False) -> Callable[[str], int | str]:
    def read(text: str) -> int | str:
        if number and text.isdecimal():
            return int(text)
        if text not in words:
            raise BadValue(f"{text!r} is none of {', '.join(words)}")
        return text

    return read


def _which(text: str) -> Which:
    """Read "5", "5-9", "5-", "2s", "1.5s-3s"."""
    first, dash, last = text.partition("-")
    timed = first.endswith("s")
    read: Callable[[str], float] = _time if timed else _number
    start = read(first)
    end = read(last) if last else float("inf") if dash else start
    if end < start or (not timed and start < 1):
        raise BadValue(f"#{text} is none: numbers count from 1 on, such as #5, #5-9, #5-, #2s, #1.5s-3s")
    return Which(start, end, timed)


NO_FAULTS: Final = Faults()

KINDS: Final[Mapping[str, FaultKind]] = MappingProxyType(
    {
        # In the order in which they are applied to one reply.
        "mute": FaultKind("reply", "the reply is lost"),
        "stranger": FaultKind("reply", "the reply bears another id, with the checksum right", _id, "the id; any other"),
        "pair": FaultKind(
            "reply",
            "two bits of one column are flipped so that the checksum still fits",
            _number,
            "the first bit; by chance",
        ),
        "flip": FaultKind("reply", "one bit is flipped", _number, "bit, the lowest of byte 0 is 0; by chance"),
        "drop": FaultKind("reply", "one byte is lost", _number, "byte, the first is 0; by chance"),
        "junk": FaultKind(
            "reply",
            "bytes that mean nothing come in, header bytes among them",
            _one_of("before", "inside", "after", number=True),
            "before, inside, after, or a byte in front of which; by chance",
            _junk,
            "how many, N or N-M, or which, 0xFF55; 1-64",
            (1, 64),
        ),
        "split": FaultKind(
            "reply",
            "a pause within the reply; what is behind it waits too",
            _number,
            "byte in front of which; by chance",
            _time,
            "how long; 5 ms",
            0.005,
        ),
        "glue": FaultKind(
            "reply",
            "the reply is held until the next one has come, and handed over with it",
            argument=_time,
            more="how long at most; for ever",
            default=float("inf"),
        ),
        "stall": FaultKind(
            "reply",
            "the adapter stands still from the first byte on, and everything waits",
            argument=_time,
            more="how long; 120 ms",
            default=0.12,
        ),
        "late": FaultKind(
            "reply",
            "the reply comes later than it should, and others overtake it",
            argument=_time,
            more="how much later; 50 ms",
            default=0.05,
        ),
        "twin": FaultKind(
            "reply",
            "a second servo of this id sends the same",
            argument=_time,
            more="how long after the first begins, overlapped if that is short; right behind it",
            default=-1.0,
        ),
        "deaf": FaultKind("request", "the request is lost"),
        "echo": FaultKind(
            "request",
            "what the adapter hears of the request that it sends",
            _one_of("full", "part", "bad", "none"),
            "full, part (its beginning), bad (one byte wrong) or none; full",
            _number,
            "bytes that come (part), or the bad byte (bad); by chance",
        ),
        "reboot": FaultKind(
            "request",
            "the supply of servos breaks down and comes back; what is in RAM is lost",
            _ids,
            "ids N or N-M; all, or with a probability any one",
            _time,
            "how long; 10 ms",
            0.01,
            rare=True,
        ),
        "unplug": FaultKind(
            "request",
            "servos are off the bus, without supply, while WHICH holds",
            _ids,
            "ids N or N-M; all, or with a probability any one",
            _time,
            "how long, in place of the end of WHICH; with a probability or at a moment 0.5 s",
            0.5,
        ),
        "gone": FaultKind(
            "request",
            "the port goes away",
            _one_of("read", "write"),
            "read (the request still gets out) or write; read",
            _time,
            "how long; for ever",
            float("inf"),
            rare=True,
        ),
    }
)

SETTINGS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "seed": "seed=N, a whole number",
        "latency": "latency=TIME, such as latency=16ms",
        "jitter": "jitter=TIME, such as jitter=4ms",
        "skew": "skew@IDS=PERCENT, such as skew@2=3%",
    }
)


def explain() -> str:
    """Say what there is, as a table for people."""
    lines = [FORM, "", "WHICH replies or requests, from 1 on: #5, #5-9, #5-, or a time: #2s, #1.5s-3s, #2s-", ""]
    for name, kind in KINDS.items():
        lines.append(f"{name:9} {kind.hits:8} {kind.what}")
        lines += [f"{'':18} @ {kind.place}"] * bool(kind.where) + [f"{'':18} : {kind.more}"] * bool(kind.argument)
    lines += ["", *(f"{name:9} {text}" for name, text in SETTINGS.items())]
    return "\n".join(lines)
