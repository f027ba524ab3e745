"""Who answers a command that asks for one step after the other: a person at a terminal, or a script in place of one."""

import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from servobus.cli.interrupts import unless_nobody_answers
from servobus.cli.keys import SPACE, Keys
from servobus.cli.output import note
from servobus.core.units import deg, parse
from servobus.errors import ServobusError, UsageError
from servobus.robots.blocking import Robot

if TYPE_CHECKING:
    from rich.live import Live

ENTER = "\n"
HAND_SPEED = 90 * deg
"""rad/s with which a script turns shafts if it does not say another speed."""
PATIENCE = 20.0
"""s that a script waits for a prompt before it counts as stuck."""


class Person(ABC):
    """Who reads what there is to do, and presses keys."""

    @abstractmethod
    def show(self, prompt: str, table: Callable[[], Any] | None = None) -> None:
        """Show what is to be done now, and a table that is drawn where one looks on live."""

    @abstractmethod
    def key(self, seconds: float) -> str:
        """Let time pass and give the key that was pressed meanwhile; "" for none."""

    @abstractmethod
    def yes(self, question: str) -> bool:
        """Ask for a yes or a no."""

    @abstractmethod
    def angle(self, question: str) -> float:
        """Ask for an angle; gives rad."""

    @abstractmethod
    @contextmanager
    def attentive(self) -> Iterator[None]:
        """Take single keys while the block runs."""


class AtTerminal(Person):
    """A person at a terminal."""

    def __init__(self, arm: Robot) -> None:
        self._arm, self._keys = arm, Keys()
        self._pressed = ""
        """Keys that were pressed and not yet given."""
        self._live: Live | None = None
        self._shown = ""

    def show(self, prompt: str, table: Callable[[], Any] | None = None) -> None:
        if self._live is not None:
            self._live.update(prompt if table is None else table(), refresh=True)
        elif prompt != self._shown:
            note(prompt)
        self._shown = prompt

    def key(self, seconds: float) -> str:
        if not self._arm.ports.real:
            pass_time(self._arm, seconds)
            seconds = 0.0
        self._pressed += self._keys.wait(0.0 if self._pressed else seconds)
        if not self._keys.there:
            raise UsageError("nobody is there to press a key: a terminal is needed, or a --script")
        pressed, self._pressed = self._pressed[:1], self._pressed[1:]
        return ENTER if pressed == "\r" else pressed

    def yes(self, question: str) -> bool:
        with unless_nobody_answers("a person at a terminal answers, or a --script"):
            return click.confirm(question, err=True)

    def angle(self, question: str) -> float:
        with unless_nobody_answers("a person at a terminal answers, or a --script"):
            return parse(click.prompt(question, type=str, err=True), "rad")

    @contextmanager
    def attentive(self) -> Iterator[None]:
        from rich.console import Console  # noqa: PLC0415 - rich is slow to import and not always wanted
        from rich.live import Live  # noqa: PLC0415

        with self._keys:
            self._pressed = ""
            if not sys.stderr.isatty():
                yield
                return
            console = Console(file=sys.stderr, highlight=False, emoji=False)
            with Live(console=console, auto_refresh=False, transient=True) as live:
                self._live = live
                try:
                    yield
                finally:
                    self._live = None


def pass_time(arm: Robot, seconds: float) -> None:
    """Let time pass on all ports of a robot."""
    if arm.ports.real:
        time.sleep(seconds)
        return
    for bus in arm.buses.values():
        bus.transport.sleep(seconds)


class Script(Person):
    """A script in place of a person, for virtual servos: it turns their shafts and presses keys.

    await TEXT                        go on when the prompt has this text in it
    turn PORT:ID=ANGLE ... [at SPEED] turn shafts, together, to angles of the servos
    press y | n | r | s | enter       press a key
    hold space SECONDS                hold a key
    type TEXT                         answer a question with a text
    wait SECONDS
    """

    def __init__(self, arm: Robot, path: Path) -> None:
        self._arm, self._path = arm, path
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{path}: cannot be read: {error}") from None
        lines = [(number, line.partition("#")[0].split()) for number, line in enumerate(text.splitlines(), 1)]
        self._lines = [(number, words) for number, words in lines if words]
        self._prompt = ""
        self._since = 0.0
        """Seconds for which the line in hand has been under way."""
        self._start: dict[str, float] = {}

    def show(self, prompt: str, table: Callable[[], Any] | None = None) -> None:  # noqa: ARG002 - nobody looks at it
        if prompt != self._prompt:
            note(prompt)
        self._prompt = prompt

    def key(self, seconds: float) -> str:
        pass_time(self._arm, seconds)
        number, words = self._line()
        verb, *rest = words
        self._since += seconds
        match verb:
            case "await":
                if " ".join(rest) in self._prompt:
                    self._ended()
                elif self._since > PATIENCE:
                    raise self._wrong(number, f"this prompt never came; the last was: {self._prompt}")
            case "turn":
                self._turn(number, rest)
            case "wait":
                if self._since >= self._seconds(number, rest):
                    self._ended()
            case "hold":
                if self._since >= self._seconds(number, rest[1:]):
                    self._ended()
                    return ""
                return _named_key(rest[0])
            case "press":
                self._ended()
                return _named_key(" ".join(rest))
            case _:
                raise self._wrong(number, f"there is no {verb} here: await, turn, press, hold, type or wait")
        return ""

    def yes(self, question: str) -> bool:
        return self._answer(question, "press") == "y"

    def angle(self, question: str) -> float:
        return parse(self._answer(question, "type"), "rad")

    @contextmanager
    def attentive(self) -> Iterator[None]:
        yield

    def _answer(self, question: str, verb: str) -> str:
        note(question)
        self._prompt = question
        while True:
            number, words = self._line()
            if words[0] == verb:
                self._ended()
                return " ".join(words[1:])
            if words[0] != "await" or " ".join(words[1:]) not in question:
                raise self._wrong(number, f"there is a question to answer with {verb}: {question}")
            self._ended()

    def _line(self) -> tuple[int, list[str]]:
        if not self._lines:
            raise UsageError(f"{self._path}: the script has ended, and there is still to do: {self._prompt}")
        return self._lines[0]

    def _ended(self) -> None:
        del self._lines[0]
        self._since, self._start = 0.0, {}

    def _turn(self, number: int, words: list[str]) -> None:
        speed = HAND_SPEED
        if "at" in words:
            at = words.index("at")
            speed = self._quantity(number, " ".join(words[at + 1 :]), "rad/s")
            words = words[:at]
        goals = {}
        for word in words:
            name, _, angle = word.partition("=")
            goals[name] = self._quantity(number, angle, "rad")
        servos = {name: self._servo(number, name) for name in goals}
        if not self._start:
            self._start = {name: servo.position for name, servo in servos.items()}
        longest = max((abs(goal - self._start[name]) for name, goal in goals.items()), default=0.0)
        share = min(1.0, self._since * speed / longest) if longest else 1.0
        for name, servo in servos.items():
            try:
                servo.turn_shaft(self._start[name] + share * (goals[name] - self._start[name]))
            except ServobusError as error:
                raise self._wrong(number, str(error)) from None
        if share == 1.0:
            self._ended()

    def _servo(self, number: int, name: str) -> Any:
        port, _, id = name.rpartition(":")
        bus = self._arm.buses.get(port)
        servos = getattr(bus.transport, "servos", None) if bus is not None else None
        if servos is None:
            raise self._wrong(number, f"{name}: the robot has no virtual port {port}, and a script turns no real shaft")
        for servo in servos:
            if str(servo.id) == id:
                return servo
        raise self._wrong(number, f"{name}: there is no servo with this id on {port}")

    def _quantity(self, number: int, text: str, unit: str) -> float:
        try:
            return parse(text, unit)
        except ValueError as error:
            raise self._wrong(number, str(error)) from None

    def _seconds(self, number: int, words: list[str]) -> float:
        return self._quantity(number, " ".join(words), "s")

    def _wrong(self, number: int, why: str) -> UsageError:
        return UsageError(f"{self._path}:{number}: {why}")


def _named_key(name: str) -> str:
    return {"enter": ENTER, "space": SPACE}.get(name.lower(), name)


def angle_text(angle: float) -> str:
    """Write an angle for a table; "" where there is none yet."""
    return "" if not math.isfinite(angle) else f"{angle / deg:.1f}°"
