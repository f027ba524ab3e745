"""Commands that are typed while virtual servos are served: they change what surrounds the servos.

The lines come from standard input, in a thread of their own; what they ask for is done between two events of the
bus. The end of the input is the end of the commands and of nothing else.
"""

import os
import select
import sys
import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

from servobus.cli.output import note
from servobus.cli.virtual_options import options_text
from servobus.core.ids import parse_ids
from servobus.core.units import parse, show
from servobus.errors import BadValue, ServobusError, UsageError
from servobus.virtual.device.options import read_options
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.motor import NOTHING, Load
from servobus.virtual.serve.rig import Rig
from servobus.virtual.serve.spec import check_temperature, check_voltage, parse_load, parse_specs
from servobus.virtual.wire.faults import explain

HELP: Final = """\
load SERVOS mass=0.2 length=0.1  hang an arm on a shaft; also inertia, torque, down, tilt, blocked; none takes it off
block SERVOS                     hold a shaft as in a vice
release SERVOS                   let it turn again
turn SERVOS ANGLE                turn a shaft by hand
voltage V                        set the supply of all
temperature SERVOS C             set a case, and what is around it
options SERVOS                   show what real servos do in different ways, and what these do
options SERVOS goal_torque=off   let them do otherwise
unplug SERVOS                    take servos off the bus, their supply too
plug SERVOS                      put them on it again
faults drop=0.01                 let things go wrong on the line from now on; `faults none` mends everything, `faults`
                                 shows how often what has happened, `faults help` explains what there is
SERVOS is an id, ids such as 1-4,7, a model with ids such as rx28@1, or all"""

TAKES: Final = {
    "load": "servos, and what hangs on them, such as `load 1 torque=0.5`",
    "block": "servos, such as `block 1`",
    "release": "servos, such as `release 1`",
    "turn": "servos and an angle in degrees, such as `turn 1 90`",
    "voltage": "a supply in V, such as `voltage 11`",
    "temperature": "servos and degrees Celsius, such as `temperature 1 80`",
    "options": "servos, and what they are to do otherwise, such as `options 1 goal_torque=off`",
    "unplug": "servos, such as `unplug 3`",
    "plug": "servos, such as `plug 3`",
}
"""Command -> what stands behind it."""
MANY = 3
"""Servos up to which they are named one by one."""
PATIENCE = 0.2
"""s after which the reader notices that the servos are switched off."""


class VirtualConsole:
    """Carries out typed lines on a rig that is being served; calls `show` with what was done, or what was wrong."""

    def __init__(self, rig: Rig, show: Callable[[str], None] = note) -> None:
        self.rig = rig
        self.show = show

    def execute(self, line: str) -> None:
        """Have a line carried out between two events of the bus."""
        words = line.split()
        if words:
            self.rig.post(lambda now: self._run(words, now))

    def _run(self, words: list[str], now: float) -> None:
        try:
            self.show(self._carry_out(words[0].lower(), words[1:], now))
        except ServobusError as error:
            self.show(f"{' '.join(words)}: {error}")

    def _carry_out(self, verb: str, words: list[str], now: float) -> str:
        match verb, words:
            case "help" | "?", _:
                return HELP
            case "load", [which, *what]:
                return self._load(self._find(which, now), " ".join(what))
            case "block", [which]:
                return self._load(self._find(which, now), "blocked")
            case "release", [which]:
                return self._load(self._find(which, now), "blocked=off")
            case "options", [which, *words]:
                return self._options(self._find(which, now), words)
            case "turn", [which, angle]:
                position = number(angle, "rad")
                for servo in (found := self._find(which, now)):
                    servo.turn_shaft(position)
                return f"{_names(found)}: at {show(position, 'rad')}"
            case "voltage", [volts]:
                supply = check_voltage(number(volts, "V"))
                for servo in (found := self._find("all", now)):
                    servo.voltage = supply
                return f"{_names(found)}: supply {show(supply, 'V')}"
            case "temperature", [which, celsius]:
                heat = check_temperature(number(celsius, "degC"))
                for servo in (found := self._find(which, now)):
                    servo.temperature = heat
                return f"{_names(found)}: {show(heat, 'degC')}"
            case "unplug", [which]:
                self.rig.unplug(found := self._find(which, now), now)
                return f"{_names(found)}: off the bus"
            case "plug", [which]:
                self.rig.plug(found := self._find(which, now), now)
                return f"{_names(found)}: on the bus"
            case "faults", words:
                return self._faults(" ".join(words), now)
        if verb in TAKES:
            raise UsageError(f"{verb} takes {TAKES[verb]}")
        raise UsageError("this is no command; `help` lists them")

    def _load(self, servos: list[VirtualServo], text: str) -> str:
        loads = [parse_load(text, servo.shaft.load) for servo in servos]
        for servo, load in zip(servos, loads, strict=True):
            if load != servo.shaft.load:
                servo.shaft.load = load
        return "\n".join(f"{_names([servo])}: {describe(load)}" for servo, load in zip(servos, loads, strict=True))

    def _faults(self, text: str, now: float) -> str:
        """Let faults happen from now on, or tell which have."""
        match text.lower():
            case "":
                counts = self.rig.fault_counts
                said = ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items()))
                return f"faults: {said or 'none has happened'}"
            case "help" | "?":
                return explain()
            case "none":
                self.rig.inject(None, now)
                return "faults: none from now on"
        self.rig.inject(text, now)
        return f"faults: {text} from now on"

    def _options(self, servos: list[VirtualServo], words: list[str]) -> str:
        """Set options of all these servos, or of none; show those that were set, or all."""
        for word in words:
            if "=" not in word:
                raise UsageError(f"{word!r} sets no option; write NAME=VALUE, such as goal_torque=off")
        given = {name: value for name, _, value in (word.partition("=") for word in words)}
        values = [read_options(type(servo), servo.model, given) for servo in servos]
        for servo, some in zip(servos, values, strict=True):
            for name, value in some.items():
                setattr(servo, name, value)
        return "\n".join(f"{_names([servo])}: {options_text(servo, all=True)}" for servo in servos)

    def _find(self, which: str, now: float) -> list[VirtualServo]:
        """Find the servos that are meant, and bring them up to now. Raises UsageError."""
        if which == "all":
            found = self.rig.servos
        elif "@" in which:
            wanted = [(model, id) for model, ids, *_ in parse_specs(which) for id in ids]
            found = [servo for servo in self.rig.servos if (servo.model, servo.id) in wanted]
        else:
            ids = parse_ids(which)
            found = [servo for servo in self.rig.servos if servo.id in ids]
        if not found:
            raise UsageError(f"there is no servo {which}")
        for servo in found:
            servo.advance(now)
        return found


def describe(load: Load) -> str:
    """Say what hangs on a shaft, in the words that `load` takes."""
    parts = {
        "inertia": f"{load.inertia:g} kg·m²",
        "mass": f"{load.mass:g} kg",
        "length": f"{load.length:g} m",
        "torque": f"{load.torque:g} N·m",
        "down": show(load.down, "rad"),
        "tilt": show(load.tilt, "rad"),
    }
    words = [f"{name} {text}" for name, text in parts.items() if getattr(load, name) != getattr(NOTHING, name)]
    return "load " + (", ".join(words + ["blocked"] * bool(load.blocked)) or "none")


def _names(servos: list[VirtualServo]) -> str:
    if len(servos) > MANY:
        return f"{len(servos)} servos"
    return ", ".join(f"{servo.model.title} id {servo.id}" for servo in servos)


def number(text: str, unit: str) -> float:
    """Read a number that was typed. Raises BadValue."""
    try:
        return parse(text, unit)
    except ValueError as error:
        raise BadValue(str(error)) from None


# Standard input


class Console(Protocol):
    """Carries out lines that are typed."""

    def execute(self, line: str) -> None: ...


def read_commands(
    console: Console, stop: threading.Event, typed: Callable[[], None] | None = None
) -> threading.Thread | None:
    """Let a thread take the lines of standard input until it ends, or until `stop`; None if there is none.

    `typed` is called for each line before it is carried out.
    """

    def execute(line: str) -> None:
        if typed:
            typed()
        console.execute(line)

    try:
        handle = sys.stdin.fileno()
    except (AttributeError, ValueError, OSError):  # closed, or something that a test put there
        return None
    # Reading past Python's own buffer: a thread that sleeps inside that would hinder the end of the program.
    thread = threading.Thread(target=_read, args=(handle, execute, stop), name="commands", daemon=True)
    thread.start()
    return thread


def _read(handle: int, execute: Callable[[str], None], stop: threading.Event) -> None:
    rest = b""
    while not stop.is_set():
        try:
            if not _ready(handle):
                continue
            data = os.read(handle, 4096)
        except (OSError, ValueError):
            return
        *lines, rest = (rest + data).split(b"\n")
        if not data:
            lines = [rest]
        for line in lines:
            execute(line.decode(errors="replace"))
        if not data:
            return


def _ready(handle: int) -> bool:
    """Wait a while for input. A program in the background leaves the terminal's to the one in the foreground."""
    if sys.platform == "win32":
        return True  # it cannot wait for a console, and has to read right away
    if not select.select([handle], [], [], PATIENCE)[0]:
        return False
    try:
        background = os.tcgetpgrp(handle) != os.getpgrp()
    except OSError:  # no terminal, or not the one that this program belongs to
        return True
    if background:
        time.sleep(PATIENCE)
    return not background
