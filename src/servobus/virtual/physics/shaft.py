"""The shaft of a virtual servo: its motor, what hangs on it, and the supply it shares with others.

The firmware says once a tick what the bridge does; `tick` lets the motor answer. All physics is in
`servobus.virtual.physics.motor`; here is only what makes one servo of it.
"""

from collections.abc import Callable
from dataclasses import replace

from servobus.virtual.physics.motor import (
    CLOSED,
    NOTHING,
    OPEN,
    REFERENCE,
    Load,
    MotorParams,
    MotorState,
    line_voltage,
    prepare,
    step,
    warm,
)

HEAT_TIME = 0.1
"""s between two looks at the temperatures; the fastest of them changes within seconds."""
WARMER = 0.1
"""K by which the winding may warm before its resistance follows: 0.04 % of it."""
STANDBY = 0.05
"""A that the electronics of a servo draw; assumption, from the RX-28 manual 1-3 (50 mA) and the DRS-0602's 33 mA."""


class Rail:
    """A supply that servos share: a source with a resistance inside.

    The bridges draw duty * current each, and the current is linear in the voltage, so that two sums give the
    voltage under any number of motors, without iteration.
    """

    def __init__(self, source: float, resistance: float = 0.0) -> None:
        self._source, self._resistance = source, resistance
        self._conductance = self._fed = self._standby = 0.0
        self._settle()

    voltage: float
    """What arrives at the servos, V: never negative, and never more than the source's. Kept, as it is often asked."""

    @property
    def source(self) -> float:
        """V without load."""
        return self._source

    @source.setter
    def source(self, source: float) -> None:
        self._source = source
        self._settle()

    @property
    def resistance(self) -> float:
        """Of the inside and the wires, ohm."""
        return self._resistance

    @resistance.setter
    def resistance(self, resistance: float) -> None:
        self._resistance = resistance
        self._settle()

    def connect(self) -> None:
        """Take one more servo on."""
        self._standby += STANDBY
        self._settle()

    def draw(self, conductance: float, fed: float) -> None:
        """Take note that the draw of a servo has changed by so much."""
        self._conductance += conductance
        self._fed += fed
        if self._resistance:
            self._settle()

    def _settle(self) -> None:
        self.voltage = line_voltage(self._source, self._resistance, self._conductance, self._fed - self._standby)


class Shaft:
    """The output shaft of one servo, rad, rad/s and N·m; see servobus.virtual.physics.motor for frame and signs."""

    def __init__(self, motor: MotorParams, position: float, tick: float, rail: Rail) -> None:
        self.motor, self.tick_time = motor, tick
        self.state = MotorState(position=position)
        self.ambient = REFERENCE
        """degC around the case"""
        self.duty = 0.0
        self.closed = OPEN
        self._load = NOTHING
        self._borne = self._push = 0.0
        self._conductance = self._fed = 0.0
        self._still_at = 0.0
        """V under which it came to rest."""
        self._unheated = 0
        """Ticks since the temperatures were looked at."""
        self._heat_ticks = round(HEAT_TIME / tick)
        self.rail = rail
        rail.connect()
        self._prepare()

    # What can be seen

    @property
    def position(self) -> float:
        return self.state.output

    @position.setter
    def position(self, position: float) -> None:
        """Turn it by hand."""
        self._still = False
        self.state.position, self.state.velocity, self.state.play = position, 0.0, 0.0

    @property
    def velocity(self) -> float:
        return self.state.velocity

    @property
    def current(self) -> float:
        """Through the winding, A."""
        return self.state.current

    @property
    def case(self) -> float:
        """Temperature of the case in degC: what the sensor of a servo measures."""
        return self.state.case

    @property
    def at_rest(self) -> bool:
        """Whether it stands, and will go on standing while the bridge goes on as it does."""
        return self._still and self._still_at == self.rail.voltage

    # What is around it

    @property
    def load(self) -> Load:
        return self._load

    @load.setter
    def load(self, load: Load) -> None:
        self._load = load
        self._prepare()

    def bear(self, inertia: float, torque: float) -> None:
        """Feel what other shafts let it feel: an inertia, kg·m², beside its load's, and a torque, N·m, from now on."""
        if inertia != self._borne:
            self._borne = inertia
            self._prepare()
        if torque != self._push:
            self._push, self._still = torque, False

    def join(self, rail: Rail) -> None:
        """Connect it to another supply."""
        self.rail.draw(-self._conductance, -self._fed)
        self._conductance = self._fed = 0.0
        self.rail = rail
        rail.connect()

    def soak(self, temperature: float) -> None:
        """Bring it and what is around it to a temperature, degC."""
        self.ambient = self.state.case = self.state.winding = temperature
        self._prepare()

    # What the firmware does

    def drive(self, duty: float) -> None:
        """Close the winding through the bridge, at -1 .. 1 of the supply; 0 brakes."""
        if duty != self.duty or self.closed != CLOSED:
            self.duty, self.closed, self._still = duty, CLOSED, False

    def brake(self) -> None:
        """Join both ends of the winding."""
        self.drive(0.0)

    def release(self) -> None:
        """Leave the winding open: only friction holds the shaft."""
        if self.closed != OPEN:
            self.duty, self.closed, self._still = 0.0, OPEN, False

    def tick(self, ticks: int = 1) -> None:
        """Let ticks of the control loop pass, during which the bridge does the same."""
        state, plan, rail = self.state, self._plan, self.rail
        self._still = False
        for _ in range(ticks):
            before = state.position
            step(plan, state, self.duty, rail.voltage, self.closed, self._push)
            if state.velocity == 0 and state.position == before:
                self._rest(ticks)
                break
        self._pass(ticks)

    def foresee(self) -> float:
        """Give the acceleration in the next tick, rad/s², if the bridge does the same."""
        state = self.state
        position, velocity, current, heat, play = state.position, state.velocity, state.current, state.heat, state.play
        step(self._plan, state, self.duty, self.rail.voltage, self.closed, self._push)
        change = state.velocity - velocity
        state.position, state.velocity, state.current, state.heat, state.play = position, velocity, current, heat, play
        return change / self.tick_time

    def run(self, ticks: int, law: Callable[[float], float]) -> int:
        """Let up to so many ticks pass, each driven at law(position), and give how many did.

        It ends before what a law does not look at may change: when the shaft comes to rest, when the temperatures are
        looked at, and after every tick at a supply that gives way.
        """
        if self.rail.resistance:
            ticks = 1
        elif ticks > self._heat_ticks - self._unheated:
            ticks = self._heat_ticks - self._unheated
        state, plan, voltage, push = self.state, self._plan, self.rail.voltage, self._push
        self._still = False
        passed, duty, position = 0, self.duty, state.position
        while passed < ticks:
            passed += 1
            before, duty = position, law(position + state.play)
            step(plan, state, duty, voltage, CLOSED, push)
            position = state.position
            if position == before and state.velocity == 0:
                self._rest(1)
                break
        self.duty, self.closed = duty, CLOSED
        self._pass(passed)
        return passed

    def rest(self) -> None:
        """Cut the power: no current, and whatever moved is taken to have come to rest."""
        self.release()
        self.state.velocity = self.state.current = 0.0
        self._draw()

    # Inside

    def _pass(self, ticks: int) -> None:
        """Look after what is slow: supply and temperatures."""
        if self.rail.resistance:
            self._draw()
        self._unheated += ticks
        if self._unheated >= self._heat_ticks:
            state = self.state
            warm(self.motor, state, self.ambient, self._unheated * self.tick_time)
            self._unheated = 0
            if abs(state.winding - self._prepared_at) > WARMER:
                self._prepare()

    def _rest(self, ticks: int) -> None:
        """Standing still, only heat goes on."""
        self._still, self._still_at = True, self.rail.voltage
        state = self.state
        state.heat += self._plan.resistance * state.current**2 * self.tick_time * (ticks - 1)

    def _prepare(self) -> None:
        self._prepared_at = self.state.winding
        load = replace(self._load, inertia=self._load.inertia + self._borne) if self._borne else self._load
        self._plan = prepare(self.motor, load, dt=self.tick_time, winding=self._prepared_at)
        self._still = False

    def _draw(self) -> None:
        """Tell the supply what the bridge draws now; one without resistance does not care."""
        if not self.rail.resistance:
            return
        share = self.duty / self._plan.resistance if self.closed else 0.0
        conductance, fed = share * self.duty, share * self._plan.constant * self.state.velocity
        self.rail.draw(conductance - self._conductance, fed - self._fed)
        self._conductance, self._fed = conductance, fed
