"""`demo robot`: a hand moves a limp arm, and another arm of other servos follows. All of it is virtual."""

import math
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import click

import servobus
from servobus.cli.output import console
from servobus.cli.robots.under_way import drawn, joint_table
from servobus.core.units import deg, show
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.motions.leading import Phase
from servobus.robots.teleop import Teleop, TeleopTick
from servobus.robots.virtual.serving import ServedRobot, serve_robot

if TYPE_CHECKING:
    from rich.console import RenderableType

LEADER = """\
[robot]
format = 1
name = "leader"
rest = "rest"

[port.arm]
path = "/dev/ttyUSB0"

[port.hand]
path = "/dev/ttyUSB1"

[joint.base]
port = "arm"
model = "rx28"
id = 1
zero = "150deg"

[joint.shoulder]
port = "arm"
model = "rx28"
id = 2
zero = "150deg"

[joint.elbow]
port = "hand"
model = "lx16a"
id = 1
zero = "120deg"

[pose.rest]
shoulder = "60deg"
elbow = "-80deg"
"""
"""A small arm of RX-28 and LX-16A, limp, without loads: a hand holds it."""

FOLLOWER = """\
[robot]
format = 1
name = "follower"
rest = "rest"

[port.left]
path = "/dev/ttyUSB2"

[port.right]
path = "/dev/ttyUSB3"

[joint.base]                # a gear of 2 behind the servo
port = "left"
model = "drs0602"
id = 1
zero = "0deg"
ratio = 2.0
speed = "180deg/s"

[joint.shoulder]            # turned round: positive is up
port = "left"
model = "drs0602"
id = 2
zero = "10deg"
direction = -1
speed = "180deg/s"

[joint.shoulder.load]
mass = "0.3kg"
length = "0.2m"
down = "-90deg"
parent = "base"

[joint.elbow]
port = "right"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
speed = "180deg/s"

[joint.elbow.load]
mass = "0.15kg"
length = "0.15m"
down = "0deg"
parent = "shoulder"

[pose.rest]
shoulder = "60deg"
elbow = "-80deg"
"""
"""A larger one of DRS-0602 and RX-28, with other zeros, directions and gears; its links hang on each other."""

SWINGS = {"base": (40 * deg, 6.0), "shoulder": (25 * deg, 4.0), "elbow": (35 * deg, 3.0)}
"""How far the hand moves each joint to either side of its rest, and in how many s there and back."""
STEP = 0.01
"""s between two moves of the hand."""
PRINT_PERIOD = 1.0
"""s between two lines where there is no terminal to draw on."""
PARKING = 1.5
"""s of the moves to rest, before and after."""


def demo_robot(seconds: float) -> None:
    """Let one arm lead the other for so many s."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="servobus-")))
        leading, leader = _arm(stack, folder, "leader", LEADER)
        _, follower = _arm(stack, folder, "follower", FOLLOWER)
        click.echo("\nservobus teleop leader.toml follower.toml --no-deadman")
        click.echo(f"  A hand moves the limp leader for {seconds:g} s; Ctrl-C ends it.\n")
        stop, follows = threading.Event(), threading.Event()
        hand = threading.Thread(target=_hand, args=(leading, leader, follows, stop), daemon=True)
        with follower.torque():
            # Limp, it has sunk under its own weight since it was switched on.
            follower.move(follower.file.poses["rest"], time=PARKING).wait()
            hand.start()
            try:
                lags = _follow(leader, follower, seconds, follows)
            finally:
                stop.set()
                hand.join()
            follower.move(follower.file.poses["rest"], time=PARKING).wait()
        if lags:
            lags.sort()
            click.echo(f"From the hand's arm to the goals of the other: {lags[len(lags) // 2] * 1000:.0f} ms (median).")
    click.echo("The follower is back at rest, its torque is off.\n")
    click.echo("The same with arms of yours:")
    click.echo("  servobus robot init /dev/ttyUSB0 -o leader.toml")
    click.echo("  servobus teleop leader.toml follower.toml")


def _arm(stack: ExitStack, folder: Path, name: str, text: str) -> tuple[ServedRobot, Robot]:
    """Serve an arm, and open it as any program would."""
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    served = stack.enter_context(serve_robot(read_file(path), folder=folder / name))
    click.echo(f"servobus virtual {name}.toml")
    for port, where in served.ports.items():
        click.echo(f"  ready {port} {where}")
    opened = stack.enter_context(servobus.robot(served.path))
    click.echo(f"servobus robot check {name}.toml")
    click.echo(f"  {opened.attendance}")
    return served, opened


def _hand(served: ServedRobot, leader: Robot, follows: threading.Event, stop: threading.Event) -> None:
    """Turn the joints of the leader as a hand would, from when the follower follows."""
    rest = leader.file.poses["rest"]
    while not follows.wait(STEP):
        if stop.is_set():
            return
    start = time.monotonic()
    while not stop.wait(STEP):
        moment = time.monotonic() - start
        for name, (swing, period) in SWINGS.items():
            angle = rest.get(name, 0.0) + swing * math.sin(2 * math.pi * moment / period)
            for servo, part in zip(served.servos[name], leader[name].parts, strict=True):
                servo.turn(part.axis.to_servo(angle))


def _follow(leader: Robot, follower: Robot, seconds: float, follows: threading.Event) -> list[float]:
    """Let the follower follow, and tell when it does; give the s of each turn, from the leader to the follower."""
    led = Teleop(leader, follower)
    picture = _Picture(follower)
    began = printed = time.monotonic()
    lags = []
    terminal = console(stderr=True).is_terminal
    with drawn(picture.table, wanted=True), closing(iter(led)) as ticks:
        for tick in ticks:
            picture.tick = tick
            if tick.phase is Phase.FOLLOWING:
                lags.append(tick.lag)
                follows.set()
            now = time.monotonic()
            if not terminal and now - printed >= PRINT_PERIOD:
                printed = now
                both = (f"{name} {show(tick.leader[name], 'rad')} {_angle(tick, name)}" for name in tick.leader)
                click.echo(f"{now - began:5.1f} s  {tick.phase.value:<9} " + " | ".join(both))
                sys.stdout.flush()
            if now - began >= seconds:
                led.stop()
    return lags


def _angle(tick: TeleopTick, name: str) -> str:
    positions = tick.result.positions
    return show(positions[name], "rad") if name in positions else "lost"


class _Picture:
    """The latest turn as a table."""

    def __init__(self, follower: Robot) -> None:
        self._follower = follower
        self.tick: TeleopTick | None = None

    def table(self) -> "RenderableType":
        """Draw it."""
        if (tick := self.tick) is None:
            return ""
        head = f"{tick.phase.value}{f': {tick.why}' if tick.why else ''}   lag {tick.lag * 1000:.0f} ms"
        return joint_table(head, list(self._follower), tick.result.positions, tick.leader, "-> is where the hand is")
