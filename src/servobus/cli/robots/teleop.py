"""`teleop`: a limp robot that is moved by hand leads another."""

from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING

import click

from servobus import robot
from servobus.cli.held_key import HeldKey
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.keys import SPACE, Keys
from servobus.cli.options import as_json, verb
from servobus.cli.output import compact, note
from servobus.cli.robots.under_way import angles_entry, drawn, joint_table, recording, switch_on
from servobus.cli.values import ANGLE, split_assignment
from servobus.core.units import parse, show
from servobus.errors import UsageError
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.motions.leading import Lead
from servobus.robots.teleop import GATE, RATE, Teleop, TeleopTick

if TYPE_CHECKING:
    from rich.console import RenderableType

LATE = 0.1
"""s of a turn from which on is warned: a hand feels it, and overshoots."""
EVERY = 1.0
"""s between two lines of JSON where nothing changes."""


@verb(
    "teleop",
    "servobus teleop leader.toml follower.toml",
    "servobus teleop lead.toml arm.toml --map lift=j2:-1 --map grip=claw:0.5:10deg",
    "servobus teleop leader.toml follower.toml --record run.mcap",
)
@click.argument("leader", type=click.Path())
@click.argument("follower", type=click.Path())
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="A=B[:SCALE[:OFFSET]]",
    help="Joint B of the leader leads joint A of the follower: A = SCALE * B + OFFSET. Then only these are led.",
)
@click.option("--rate", type=float, default=RATE, metavar="HZ", help=f"Goals a second; {RATE:g} without it.")
@click.option(
    "--gate", type=ANGLE, default=GATE, metavar="DEG", help=f"How far apart it may begin; {show(GATE, 'rad')} else."
)
@click.option("--no-deadman", is_flag=True, help="Follow without a key held.")
@click.option("--limp", is_flag=True, help="Switch the torque of the leader off first: hold it.")
@click.option("--record", metavar="OUT", help="Keep goals and positions in a file: OUT.csv or OUT.mcap.")
@as_json
def teleop(
    leader: str,
    follower: str,
    maps: tuple[str, ...],
    rate: float,
    gate: float,
    no_deadman: bool,
    limp: bool,
    record: str | None,
    json: bool,
) -> None:
    """Let the robot of file LEADER, moved by hand, lead that of file FOLLOWER; joints of the same name, or by --map.

    The follower moves while SPACE is held (--no-deadman: all the time), and holds when it is let go. It begins when
    both robots are within the gate, comes slowly to the leader, and then follows, within its own limits. q or Ctrl-C
    ends: the follower holds where it is. The leader's torque has to be off, the follower's is switched on.
    """
    leads = dict(map(_lead, maps)) or None
    with ExitStack() as stack:
        leading = stack.enter_context(robot(read_file(leader)))
        following = stack.enter_context(robot(read_file(follower)))
        stack.enter_context(signals_as_interrupt())
        keys = stack.enter_context(Keys())
        if not keys.there and not no_deadman:
            raise UsageError("there is no terminal, so no key can be held: --no-deadman goes without")
        deadman = Deadman(keys, following)
        led = Teleop(
            leading, following, leads, rate=rate, gate=gate, deadman=deadman.no_key if no_deadman else deadman.held
        )
        deadman.end = led.stop
        joints = [following[joint.name] for joint in led.joints]
        write = stack.enter_context(recording(record, following, joints, joints))
        if limp:
            for name in dict.fromkeys(lead.leader for lead in led.leading.leads.values()):
                leading[name].torque_off()
        switch_on(joints, quiet=json)
        show_ = Lines(led) if json else Table(led, following, deadman=not no_deadman)
        stack.enter_context(drawn(show_.table, wanted=not json))
        late = 0
        try:
            with closing(iter(led)) as ticks:
                for tick in ticks:
                    write(tick.result.positions, tick.leader)
                    show_.take(tick)
                    late += tick.lag >= LATE
        finally:
            note(f"the follower holds where it is{f'; {late} turns took {LATE:g} s or more' if late else ''}")


class Deadman:
    """Asks the keyboard whether SPACE is held, and ends it on q."""

    def __init__(self, keys: Keys, robot: Robot) -> None:
        self._keys, self._held, self._robot = keys, HeldKey(), robot
        self.end: Callable[[], None] = lambda: None

    def held(self) -> bool:
        """Tell whether SPACE is held."""
        now = self._robot.ports.now()
        pressed = self._keys.pressed()
        if SPACE in pressed:
            self._held.pressed(now)
        if "q" in pressed:
            self.end()
        return self._held.held(now)

    def no_key(self) -> bool:
        """Go on without SPACE; q ends it all the same."""
        self.held()
        return True


class Table:
    """Shows the turns in a table."""

    def __init__(self, led: Teleop, follower: Robot, *, deadman: bool) -> None:
        self._joints = [follower[joint.name] for joint in led.joints]
        self._foot = "hold SPACE to lead, q ends" if deadman else "q ends"
        self._tick: TeleopTick | None = None

    def take(self, tick: TeleopTick) -> None:
        """Take the turn that is shown next."""
        self._tick = tick

    def table(self) -> "RenderableType":
        """Draw it."""
        if (tick := self._tick) is None:
            return ""
        alarm = "  LATE" if tick.lag >= LATE else ""
        head = f"{tick.phase.value}{f': {tick.why}' if tick.why else ''}   lag {tick.lag * 1000:.0f} ms{alarm}"
        marks = dict.fromkeys(tick.clamped, "at its limit")
        return joint_table(head, self._joints, tick.result.positions, tick.leader, self._foot, marks)


class Lines(Table):
    """Prints a line of JSON when something changes, and each second."""

    def __init__(self, led: Teleop) -> None:
        super().__init__(led, led.follower, deadman=False)  # type: ignore[arg-type] # it is a blocking one
        self._clock = led.follower.ports.now
        self._began = self._clock()
        self._said: tuple[object, ...] = ()
        self._due = 0.0

    def take(self, tick: TeleopTick) -> None:
        """Print the turn, where there is something to tell."""
        now, late = self._clock() - self._began, tick.lag >= LATE
        state = (tick.phase, tick.why.partition(":")[0], tick.clamped, late, tuple(tick.result.lost))
        if state == self._said and now < self._due:
            return
        self._said, self._due = state, now + EVERY
        entry = {
            "time": round(now, 3),
            "phase": tick.phase.value,
            "why": tick.why,
            "lag": round(tick.lag, 4),
            "late": late,
            "clamped": list(tick.clamped),
            "leader": angles_entry(tick.leader),
            "positions": angles_entry(tick.result.positions),
        }
        click.echo(compact(entry))


def _lead(text: str) -> tuple[str, Lead]:
    """Read A=B[:SCALE[:OFFSET]]."""
    name, rest = split_assignment(text, "A=B[:SCALE[:OFFSET]], such as lift=arm2:-1 or grip=claw:0.5:10deg")
    leader, _, numbers = rest.partition(":")
    scale, _, offset = numbers.partition(":")
    try:
        factor = float(scale) if scale else 1.0
    except ValueError:
        raise click.BadParameter(f"{text}: {scale!r} is no number to scale by", param_hint="--map") from None
    try:
        return name, Lead(leader, factor, parse(offset, "rad") if offset else 0.0)
    except ValueError as error:
        raise click.BadParameter(f"{text}: {error}; OFFSET is an angle such as 10deg", param_hint="--map") from None
