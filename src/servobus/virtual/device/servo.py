"""A servo that is not there: registers, firmware and a shaft.

    memory    what its registers hold
    firmware  how it answers packets and what it commands: a subclass, which the model names
    shaft     how the output follows

Nothing here has a clock or a thread. The owner of a servo tells it the time: `advance(now)` before
anything is observed or heard, and as often or as rarely as pleases; the firmware counts its own ticks.
"""

import math
import random
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import IntFlag
from typing import Any, ClassVar, Protocol, TypeAlias

from servobus.core.framing import BITS_PER_BYTE, Corrupt, Packet
from servobus.core.ids import check_id
from servobus.core.registers import Register
from servobus.core.units import show
from servobus.errors import BadValue, UnknownName, UsageError
from servobus.families.model import Model
from servobus.virtual.device.memory import Memory
from servobus.virtual.device.motors import motor, supply
from servobus.virtual.device.options import NO_TIME, Option, Reading, Span, Times, defaults, read_options
from servobus.virtual.device.references import resolve
from servobus.virtual.physics.motor import no_load_speed
from servobus.virtual.physics.shaft import Rail, Shaft

Replies: TypeAlias = list[tuple[float, bytes]]
"""What a servo sends: (seconds after the last bit of what it heard, bytes)."""

FARTHEST = 200 * math.pi
"""rad that a shaft may be turned to by hand, either way: a hundred turns."""
ROOM_TEMPERATURE = 25.0
"""degC; assumption, where nothing else is said."""


class Company(Protocol):
    """Servos that live in step because they feel each other; see servobus.virtual.device.mechanism."""

    def advance(self, servo: "VirtualServo", now: float) -> None:
        """Bring a servo up to now, and as far as can be the others too."""

    def let_pass(self, servo: "VirtualServo", now: float) -> None:
        """Let time pass in which nobody looks at this servo."""


class VirtualServo(ABC):
    """A servo of some family. A subclass is the firmware of the models that name it, see `Model.firmware`.

    What the firmware listens to is kept in plain attributes, because the line sorts servos by them:

    id               the id it answers to now
    baud             its speed now, bit/s
    garbage_timeout  longest pause inside a packet, s
    deaf_until       time before which it hears nothing, because it restarts
    awaits_turn      whether its answer waits for the answers of others, which `overhear` is told of
    """

    awaits_turn = False
    company: Company | None = None
    """Servos that it lives in step with; None where it lives for itself."""

    answer_time = Option(
        Times(), practice=NO_TIME, manual=NO_TIME,
        text="how much later than its settings ask for an answer begins; another time for each answer",
    )  # fmt: skip
    eeprom_pause = Option(
        Times(usual=Span(0.005, 0.007)), practice=NO_TIME, manual=NO_TIME,
        text="how long it hears nothing after its answer, for each byte written to its EEPROM",
    )  # fmt: skip
    boot_time = Option(
        Times(), practice=NO_TIME, manual=NO_TIME,
        text="how long it hears nothing after its supply comes back, or after it was told to restart",
    )  # fmt: skip

    tick: ClassVar[float]
    """Seconds between two runs of the control loop."""
    id: int
    baud: float
    garbage_timeout: float

    def __init__(
        self,
        model: type[Model],
        id: int | None = None,
        *,
        voltage: float | None = None,
        temperature: float = ROOM_TEMPERATURE,
        position: float | None = None,
        motor_set: str | None = None,
        reading: Reading = "practice",
        options: Mapping[str, Any] | None = None,
        memory: Mapping[str, int] | None = None,
        now: float = 0.0,
    ) -> None:
        """Take a servo out of its box, give it an id, and switch it on.

        id           None leaves the factory id
        voltage      supply in V; by default the nominal voltage, the middle of what the model allows, or its sibling's
        temperature  of the case, degC
        position     of the shaft, rad; `home` by default
        motor_set    name of a set of motor data, see `servobus.virtual.device.motors`; `manual` by default
        reading      "practice" or "manual": what its options are at first, see servobus.virtual.device.options
        options      options with other values: name -> value, or the word for it
        memory       what registers of its EEPROM hold: name -> raw value. It need not be one that a host could write:
                     real servos hold such values too

        Raises BadValue or UsageError for what it cannot have.
        """
        self.options = defaults(type(self), model, reading)
        """Name of an option -> its value. Set one as an attribute: `servo.goal_torque = False`."""
        self.options |= read_options(type(self), model, options or {})
        self.model = model
        self.memory = Memory(model)
        if id is not None:
            self.memory.store(model.register("id"), check_id(id))
        self.memory.hold(memory or {})
        start = self.home if position is None else position
        self.shaft = Shaft(
            motor(model, motor_set), start, self.tick, Rail(supply(model)[0] if voltage is None else voltage)
        )
        self.temperature = temperature
        self.deaf_until = -math.inf
        self.powered = False
        self.time = now
        """Time up to which everything has happened."""
        self._dice = random.Random(self.memory[model.register("id")])
        """For all that is another time on each occasion: the same servo throws the same every time."""
        try:
            self.power_on(now)
        except UnknownName as error:
            raise UsageError(
                f"{model.title} cannot be a virtual servo: its firmware, {type(self).__name__}, needs what it lacks "
                f"({error}); name another class with `firmware`"
            ) from error

    def __repr__(self) -> str:
        return f"<virtual {self.model.title} id {self.id}>"

    # What the firmware of a family does

    @abstractmethod
    def start(self) -> None:
        """Begin as after power-on, with memory already in that state. Sets what the servo listens to."""

    @abstractmethod
    def hear(self, event: Packet | Corrupt, now: float) -> Replies:
        """Act on a packet to this servo's id, or to all, whose last bit came now; give the replies."""

    def overhear(self, packet: Packet, now: float) -> Replies:  # noqa: ARG002 - most servos answer alone
        """Take note of another servo's answer, whose last bit came now; give what this servo sends after it."""
        return []

    def garbage(self, now: float) -> None:  # noqa: B027 - most firmware just forgets
        """Take note that an incomplete packet was dropped after a pause."""

    def options_changed(self) -> None:  # noqa: B027 - most firmware looks at them when they count
        """Take note that an option was set."""

    @abstractmethod
    def control(self, ticks: int) -> None:
        """Run the control loop this many times: protections, profile, shaft."""

    @property
    @abstractmethod
    def torque(self) -> bool:
        """Whether the motor holds the shaft."""

    @property
    @abstractmethod
    def led(self) -> str:
        """What the light shows now: "off", "red", "green+blue" ..."""

    @property
    def alarms(self) -> IntFlag | None:
        """What is wrong with it, as its family's flags; None for firmware that knows no alarms."""
        return None

    @property
    def home(self) -> float:
        """Where the shaft stands in a servo out of its box, rad. Assumption: the middle of its range."""
        return self.model.sheet.angle / 2

    # Life

    def power_on(self, now: float) -> None:
        """Switch the supply on."""
        self.powered = True
        self.time = self.started = now
        self._ticks = 0
        self.deaf_until = -math.inf
        self.shaft.rest()
        self.memory.power_on()
        self.start()

    def restart(self, now: float) -> None:
        """Switch the supply on, or do what a servo does that was told to restart: it needs time until it hears."""
        self.power_on(now)
        if self.boot_time != NO_TIME:
            self.deaf_until = now + self._throw(self.boot_time)

    def power_off(self) -> None:
        """Switch the supply off: the shaft is free, the RAM is lost, the EEPROM is not."""
        self.powered = False
        self.shaft.rest()

    def advance(self, now: float) -> None:
        """Bring motion and protections up to now.

        Voltage and temperature are taken to have been what they are since the last call.
        """
        if self.company is None:
            self.live(now)
        else:
            self.company.advance(self, now)

    def let_pass(self, now: float) -> None:
        """Let time pass until now in which nobody looks at it: as `advance`, but it may wait for its company."""
        if self.company is None:
            self.live(now)
        else:
            self.company.let_pass(self, now)

    def live(self, now: float) -> int:
        """Bring this servo alone up to now; give how many ticks that took."""
        if not self.powered:
            return 0
        # A time that should be a whole number of ticks can be a rounding error short of it.
        ticks = math.floor((now - self.started) / self.tick + 1e-6) - self._ticks
        self.time = max(self.time, now)
        if ticks <= 0:
            return 0
        self._ticks += ticks
        self.control(ticks)
        return ticks

    # Packets

    def answer(self, event: Packet | Corrupt, now: float) -> Replies:
        """Act on a packet as `hear` does, in the time that this servo takes for it."""
        written = self.memory.bytes_stored
        replies = self.in_its_time(self.hear(event, now))
        if self.memory.bytes_stored != written and self.eeprom_pause != NO_TIME:
            pause = sum(self._throw(self.eeprom_pause) for _ in range(self.memory.bytes_stored - written))
            self.deaf_until = max(self.deaf_until, self._sent_at(replies, now) + pause)
        return replies

    def in_its_time(self, replies: Replies) -> Replies:
        """Have replies begin as much later as `answer_time` says."""
        if self.answer_time == NO_TIME:
            return replies
        return [(delay + self._throw(self.answer_time), data) for delay, data in replies]

    def _sent_at(self, replies: Replies, now: float) -> float:
        """Give the time at which these replies will have been sent."""
        return max((now + delay + len(data) * BITS_PER_BYTE / self.baud for delay, data in replies), default=now)

    def _throw(self, span: Span) -> float:
        return span.low if span.low == span.high else self._dice.uniform(*span)

    # Surroundings

    @property
    def position(self) -> float:
        """Where the shaft is, rad."""
        return self.shaft.position

    def turn_shaft(self, position: float) -> None:
        """Turn the shaft by hand. Raises UsageError while the motor holds it, BadValue for an angle out of reach."""
        if not abs(position) <= FARTHEST:
            raise BadValue(f"{show(position, 'rad')} is not in {show(-FARTHEST, 'rad')} .. {show(FARTHEST, 'rad')}")
        if self.powered and self.torque:
            raise UsageError(f"{self.model.title} id {self.id} holds its shaft: its torque is on")
        self.shaft.position = position

    @property
    def voltage(self) -> float:
        """Supply at the servo's plug, V. Setting it sets the source's voltage, without load."""
        return self.shaft.rail.voltage

    @voltage.setter
    def voltage(self, voltage: float) -> None:
        self.shaft.rail.source = voltage

    @property
    def temperature(self) -> float:
        """Of the case, degC. Setting it brings the servo and its surroundings to that temperature."""
        return self.shaft.case

    @temperature.setter
    def temperature(self, temperature: float) -> None:
        self.shaft.soak(temperature)

    @property
    def trajectory(self) -> float | None:
        """Where the firmware's profile wants the shaft now, rad; None if it has no such thing."""
        return None

    @property
    def top_speed(self) -> float:
        """The highest speed at the present supply voltage without load, rad/s."""
        return no_load_speed(self.shaft.motor, self.voltage)

    def store_baud(self, baud: int) -> None:
        """Set the speed as if a host had stored it before, and start again. Raises BadValue."""
        register = self.model.optional("baud")
        if register is None:
            title, only = self.model.title, self.model.factory_baud
            if baud != only:
                raise BadValue(f"{title} has one speed, {only} baud, and cannot be set to {baud}")
            return
        self.memory.store(register, register.encode(baud))
        self.power_on(self.time)

    # Registers by name, for firmware that serves every model of its family

    def get(self, name: str) -> int:
        """Give the working value of a register, raw."""
        return self.memory[self.model.register(name)]

    def put(self, name: str, raw: int) -> None:
        """Set the working value of a register, raw."""
        self.memory[self.model.register(name)] = raw

    def row(self, name: str) -> Register[Any]:
        return self.model.register(name)


def virtual_servo(
    model: type[Model],
    id: int | None = None,
    *,
    voltage: float | None = None,
    temperature: float = ROOM_TEMPERATURE,
    position: float | None = None,
    motor_set: str | None = None,
    reading: Reading = "practice",
    options: Mapping[str, Any] | None = None,
    memory: Mapping[str, int] | None = None,
    now: float = 0.0,
) -> VirtualServo:
    """Make a virtual servo of any model; see `VirtualServo` for the arguments."""
    kind = firmware(model)
    return kind(
        model,
        id,
        voltage=voltage,
        temperature=temperature,
        position=position,
        motor_set=motor_set,
        reading=reading,
        options=options,
        memory=memory,
        now=now,
    )


def firmware(model: type[Model]) -> type[VirtualServo]:
    """Find the class that is the firmware of a model. Raises UnknownName for a model that names none."""
    if not model.firmware:
        raise UnknownName(f"there is no virtual servo for {model.title}")
    kind: type[VirtualServo] = resolve(model.firmware, f"the firmware of {model.title}")
    return kind
