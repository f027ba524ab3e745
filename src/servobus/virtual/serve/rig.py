"""A rig of virtual servos: one line for each family, side by side, behind one port.

Real servos of two families cannot share a wire. In a rig each family has its own; what the client sends
goes to all of them, and what they answer comes back in the order of time.
"""

import math
import threading
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence

from servobus.errors import UsageError
from servobus.virtual.device.servo import ROOM_TEMPERATURE, VirtualServo, virtual_servo
from servobus.virtual.device.state_file import StateFile
from servobus.virtual.physics.shaft import Rail
from servobus.virtual.serve.spec import Clock, Setup
from servobus.virtual.wire.faults import NO_FAULTS, Faults, Injected
from servobus.virtual.wire.line import VirtualLine


class Rig:
    """Several lines with one client. Time is told from outside, as with a single line."""

    def __init__(self, lines: Sequence[VirtualLine], state: StateFile | None = None, clock: Clock = "real") -> None:
        if not lines:
            raise UsageError("a rig needs at least one line")
        self.lines = list(lines)
        self.state = state
        self.clock = clock
        self.faults = NO_FAULTS
        self.lock = threading.RLock()
        """Held by whoever lets something happen here. Rigs whose servos feel each other share one."""
        self._tasks: deque[Callable[[float], None]] = deque()

    def open(self) -> None:
        """Have the state file, if there is one, for this rig alone; it has been from the start. Raises UsageError."""
        if self.state:
            self.state.open()

    def close(self) -> None:
        """Let others have the state file."""
        if self.state:
            self.state.close()

    @property
    def servos(self) -> list[VirtualServo]:
        return [servo for line in self.lines for servo in line.servos]

    @property
    def default_baud(self) -> int:
        """The factory speed of the first servo."""
        return self.lines[0].servos[0].model.factory_baud

    @property
    def client_baud(self) -> float | None:
        return self.lines[0].client_baud

    @client_baud.setter
    def client_baud(self, baud: float | None) -> None:
        for line in self.lines:
            line.client_baud = baud

    def post(self, task: Callable[[float], None]) -> None:
        """Have something done between two events, with the time as its argument; from any thread.

        It is done at the next `receive`, in that thread. One task at a time: a long job should post what is left of it.
        """
        self._tasks.append(task)

    def send(self, data: bytes, now: float) -> None:
        """Let the client begin to send, behind what it is still sending."""
        for line in self.lines:
            line.send(data, now)

    def receive(self, now: float) -> bytes:
        """Give what the client has received whole by now and not been given yet."""
        if self._tasks:
            self._tasks.popleft()(now)
        if len(self.lines) == 1:
            return self.lines[0].receive(now)
        timed = []
        for line in self.lines:
            timed += [(run.end, run.data) for run in line.arrivals(now)]
        timed.sort(key=lambda item: item[0])  # stable: of two at once the first line's comes first
        return b"".join(data for _, data in timed)

    def next_event(self) -> float | None:
        """Give the time of the next thing that happens by itself; None if all is quiet."""
        return min((time for line in self.lines if (time := line.next_event()) is not None), default=None)

    def next_look(self) -> float | None:
        """Give the time to look again; None if nothing is going to happen by itself."""
        return -math.inf if self._tasks else self.next_event()

    def inject(self, faults: Faults | str | None, now: float) -> None:
        """Let these faults happen from now on, instead of any others; None mends everything. Raises BadValue."""
        self.faults = Faults.parse(faults) if isinstance(faults, str) else faults or NO_FAULTS
        for line in self.lines:
            line.inject(self.faults, now)

    def unplug(self, servos: Collection[VirtualServo], now: float) -> None:
        """Take the supply from servos; nothing happens to those that have none."""
        self.run(now)
        for line in self.lines:
            line.unplug([servo for servo in line.servos if servo in servos and servo.powered], now)

    def plug(self, servos: Collection[VirtualServo], now: float) -> None:
        """Give servos their supply again; nothing happens to those that have it."""
        self.run(now)
        for line in self.lines:
            line.plug([servo for servo in line.servos if servo in servos and not servo.powered], now)

    @property
    def injected(self) -> list[Injected]:
        """The latest faults that have happened since the last call of `inject`, in the order of time."""
        return sorted((one for line in self.lines for one in line.injected), key=lambda one: one.time)

    @property
    def fault_counts(self) -> Counter[str]:
        """Kind of fault -> how often it has happened since the last call of `inject`."""
        return sum((line.fault_counts for line in self.lines), Counter())

    @property
    def handing_over(self) -> float:
        """How much later than its last bit a reply may reach the client, s, as its adapter is set."""
        return max(line.handing_over for line in self.lines) + self.faults.jitter

    def gone(self, now: float) -> bool:
        """Tell whether the client's port is gone."""
        return any(line.gone(now) for line in self.lines)

    def run(self, now: float) -> None:
        """Let everything on the wires happen up to now; servos live on when they are spoken to or looked at."""
        for line in self.lines:
            line.run(now)

    def advance(self, now: float) -> None:
        """Bring everything, every servo included, up to now; those that feel servos of other ports wait for these."""
        self.run(now)
        for line in self.lines:
            for servo in line.servos:
                servo.let_pass(now)


def build_rig(setup: Setup) -> Rig:
    """Make the servos that a setup names, at time 0. Raises UsageError."""
    temperature = ROOM_TEMPERATURE if setup.temperature is None else setup.temperature
    servos = []
    for group in setup.servos:
        options, memory = setup.settings(group)
        servos += [
            virtual_servo(
                group.model,
                id,
                voltage=setup.voltage,
                temperature=temperature,
                position=group.position,
                motor_set=setup.motor,
                reading=setup.reading,
                options=options,
                memory=memory,
            )
            for id in group.ids
        ]
    state = None if setup.state is None else StateFile(setup.state, servos)
    try:
        return _wired(setup, servos, state)
    except BaseException:
        if state:
            state.close()
        raise


def _wired(setup: Setup, servos: Sequence[VirtualServo], state: StateFile | None) -> Rig:
    """Put servos on the wires of a rig."""
    families: dict[str, list[VirtualServo]] = {}
    for servo in servos:
        servo.shaft.load = setup.load
        if setup.baud is not None:
            servo.store_baud(setup.baud)
        families.setdefault(servo.model.family.name, []).append(servo)
    rig = Rig(
        [
            VirtualLine(line, echo=setup.echo, supply=_supply(setup, line), adapter=setup.adapter)
            for line in families.values()
        ],
        state,
        setup.clock,
    )
    rig.inject(setup.faults, 0.0)
    return rig


def _supply(setup: Setup, servos: Sequence[VirtualServo]) -> Rail | None:
    """Give the supply that the servos of a line share: the first one's, behind a resistance."""
    if setup.supply_resistance is None:
        return None
    return Rail(servos[0].shaft.rail.source, setup.supply_resistance)
