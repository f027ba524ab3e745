"""`virtual FILE`: the servos of a robot file, each of its ports for other programs."""

import shlex
import sys
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from servobus.cli.output import note
from servobus.cli.virtual_console import HELP, VirtualConsole, number, read_commands
from servobus.core.units import show
from servobus.errors import PortError
from servobus.robots.axis import Axis
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_file
from servobus.robots.virtual.building import VirtualRobot
from servobus.robots.virtual.serving import serve_robot
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.rig import Rig

LOOK = 0.1
"""s between two looks whether all ports are still served."""
HELP_OF_JOINTS = HELP.rpartition("\n")[0] + "\nSERVOS is a joint, whose angles these are, or all"


def serve(
    spec: str,
    folder: Path | None,
    tcp: tuple[str, int] | None,
    stop: threading.Event,
    surroundings: Mapping[str, Any],
) -> None:
    """Serve the servos of a robot file until told to stop. Raises ServobusError."""
    file = read_file(spec)
    said = {name: value for name, value in surroundings.items() if name != "clock" or value != "real"}
    with serve_robot(file, folder=folder, tcp=tcp, said=said) as robot:
        for name, port in robot.ports.items():
            click.echo(f"ready {name} {port}")
        sys.stdout.flush()  # a program that waits for these lines may wait on a pipe
        if sys.stderr.isatty():
            note(f"try: servobus robot check {shlex.quote(str(robot.path))}     (Ctrl-C here switches the servos off)")
        read_commands(RobotConsole(file, robot.robot), stop)
        while not stop.wait(LOOK):
            if dead := [name for name, port in robot.ports.items() if not port.served]:
                raise PortError(f"port {', '.join(dead)}: its servos are no longer served")
        if sys.stderr.isatty():
            note("")  # the terminal shows ^C
        counts: Counter[str] = sum((port.fault_counts for port in robot.ports.values()), Counter())
    if counts:
        note("faults: " + ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))


class RobotConsole:
    """Carries out typed lines on a robot that is being served: its servos go by the names of their joints."""

    def __init__(self, file: RobotFile, robot: VirtualRobot) -> None:
        self._consoles = []
        for port, rig in robot.rigs.items():
            here = {
                name: [
                    (servo, entry.axis)
                    for entry, servo in zip(file.joints[name].servos, servos, strict=True)
                    if entry.port == port
                ]
                for name, servos in robot.servos.items()
            }
            self._consoles.append(PortConsole(rig, port, {name: some for name, some in here.items() if some}))
        self._joints = list(robot.servos)

    def execute(self, line: str) -> None:
        """Have a line carried out on the ports that it is for."""
        verb, *words = line.split() or [""]
        if verb.lower() in ("help", "?"):
            note(HELP_OF_JOINTS)
            return
        of_all = not words or words[0] == "all" or verb.lower() in ("voltage", "faults")
        consoles = [console for console in self._consoles if of_all or words[0] in console.joints]
        if not consoles:
            note(f"{line}: there is no joint {words[0]}; there are {', '.join(self._joints)}")
        for console in consoles:
            console.execute(line)


class PortConsole(VirtualConsole):
    """The same on one port: its servos and their axes by joint."""

    def __init__(self, rig: Rig, port: str, joints: Mapping[str, Sequence[tuple[VirtualServo, Axis]]]) -> None:
        super().__init__(rig, lambda text: note(f"{port}: {text}"))
        self.joints = joints

    def _carry_out(self, verb: str, words: list[str], now: float) -> str:
        if verb != "turn" or len(words) != 2:
            return super()._carry_out(verb, words, now)
        angle = number(words[1], "rad")
        for name, there in self.joints.items():
            for servo, axis in there if words[0] in (name, "all") else ():
                servo.advance(now)
                servo.turn_shaft(axis.to_servo(angle))
        return f"{words[0]}: at {show(angle, 'rad')}"

    def _find(self, which: str, now: float) -> list[VirtualServo]:
        found = [servo for name, there in self.joints.items() for servo, _ in there if which in (name, "all")]
        for servo in found:
            servo.advance(now)
        return found
