"""What is said beyond the steps of procedures: who holds what, stops, what is to be seen, and what has happened.

Servos are called by family, id and speed, as "dynamixel:1@57600", for an id alone tells no servo from another.
"""

from typing import TypeAlias

from servobus.core.values import frozen
from servobus.remote.messages import message

Value: TypeAlias = bool | int | float | str | tuple[str, ...] | None


@message("done")
@frozen
class Done:
    """A request was carried out. `text` says what came of it, where there is something to say."""

    n: int
    text: str = ""


# Who may move what


@message("lease")
@frozen
class TakeLease:
    """Hold these servos; with `over` also those that another one holds, and that are made safe then."""

    n: int
    bus: str
    servos: tuple[str, ...]
    over: bool = False


@message("end_lease")
@frozen
class EndLease:
    """Hold these servos no more, or with none named all that this session holds on the bus."""

    n: int
    bus: str
    servos: tuple[str, ...] = ()


@message("stop")
@frozen
class StopServos:
    """Stop these servos, or all on the bus, or on all buses: whoever holds them. Nothing moves until `Resume`."""

    n: int
    bus: str = ""
    servos: tuple[str, ...] = ()


@message("resume")
@frozen
class Resume:
    """Allow motion again, of these servos or of all on the bus."""

    n: int
    bus: str
    servos: tuple[str, ...] = ()


# Who is there


@frozen
class ServoInfo:
    """A servo that was met.

    model    key of its model
    holder   name of who holds it; empty if nobody does
    driven   whether somebody has set it in motion, or holds it with torque
    stopped  who has stopped it, so that it must not move; empty if it may
    """

    key: str
    model: str
    holder: str
    driven: bool
    stopped: str


@message("list")
@frozen
class ListServos:
    """Ask which servos were met on a bus."""

    n: int
    bus: str


@message("servos")
@frozen
class Servos:
    """The servos that were met on a bus."""

    n: int
    servos: tuple[ServoInfo, ...]


@message("introduce")
@frozen
class Introduce:
    """Say of which model a servo is that cannot say it itself, and its safe action if it has one of its own."""

    n: int
    bus: str
    servo: str
    model: str
    safe_action: str = ""


@message("open")
@frozen
class OpenBus:
    """Open a port, as a bus of this name."""

    n: int
    bus: str
    port: str


@message("close")
@frozen
class CloseBus:
    """Make safe what is driven on a bus, and give its port back."""

    n: int
    bus: str


# What is to be seen


@frozen
class Wanted:
    """What is to be read of a servo; no register means what an overview shows."""

    servo: str
    registers: tuple[str, ...] = ()


@message("subscribe")
@frozen
class Subscribe:
    """See this on a bus from now on, each `period` s, in place of what this connection saw before.

    With no servo named, an overview of all that were met, also of those that are met later.
    """

    n: int
    bus: str
    servos: tuple[Wanted, ...]
    period: float


@message("unsubscribe")
@frozen
class Unsubscribe:
    """See no more of a bus."""

    n: int
    bus: str


@frozen
class Seen:
    """What was read of a servo: registers and values in their units; `lost` says why it did not answer."""

    servo: str
    values: tuple[tuple[str, Value], ...]
    lost: str = ""


@message("telemetry")
@frozen
class Telemetry:
    """What was read on a bus; `time` is that of the server's clock."""

    bus: str
    time: float
    seen: tuple[Seen, ...]


@message("watch_traffic")
@frozen
class WatchTraffic:
    """See the bytes on a bus from now on, or no more."""

    n: int
    bus: str
    on: bool


@message("traffic")
@frozen
class Traffic:
    """Bytes on a bus. `time` is s since its port was opened, `direction` ">" to the servos or "<" from them.

    by      name of whose request it is, as far as that is known
    missed  pieces that were left out before this one, for the client reads too slowly
    """

    bus: str
    time: float
    direction: str
    data: bytes
    by: str = ""
    missed: int = 0


@message("watch_events")
@frozen
class WatchEvents:
    """Be told of all events from now on, and of those kept that have a higher number."""

    n: int
    after: int = 0


@message("event")
@frozen
class Happened:
    """Something has happened; see `servobus.server.ports.events.Event`. `data` is JSON."""

    number: int
    time: float
    what: str
    bus: str
    servo: str
    by: str
    data: str


@message("save")
@frozen
class SaveBox:
    """Save the last minute of a bus as a recording; answered with its path."""

    n: int
    bus: str
    why: str


# The bench: what surrounds virtual servos


@frozen
class BenchServo:
    """A virtual servo as it is, whatever it reports, and what surrounds it.

    number       its place on the bench, which stays when its id changes
    id           its id now; `family` the name of its family
    title        of its model
    position     of its shaft, rad; `speed` in rad/s, `current` of its motor in A
    voltage      at its plug, V; `source` what the supply gives without load
    nominal      supply that it is made for, V; `home` where its shaft stands out of the box, rad
    temperature  of its case, degC
    torque       whether the motor holds the shaft; `led` is the colour of its light
    plugged      whether it has its supply
    load         N·m from outside; `mass` in kg at the end of an arm of `length` in m; `inertia` in kg·m²
    blocked      whether the shaft is held as in a vice
    stall        N·m with which it pushes at most, at its voltage
    """

    number: int
    family: str
    id: int
    title: str
    position: float
    speed: float
    current: float
    voltage: float
    source: float
    nominal: float
    home: float
    temperature: float
    torque: bool
    led: str
    plugged: bool
    load: float
    mass: float
    length: float
    inertia: float
    blocked: bool
    stall: float


@message("look_at_bench")
@frozen
class LookAtBench:
    """Ask for the virtual servos of a bus, and what surrounds them."""

    n: int
    bus: str


@message("bench")
@frozen
class Bench:
    """The virtual servos of a bus. `faults` go wrong on the line; `happened` says which have, and how often."""

    n: int
    servos: tuple[BenchServo, ...]
    faults: str
    happened: tuple[tuple[str, int], ...]


@message("set_bench")
@frozen
class SetBench:
    """Change what surrounds these virtual servos, by number, or all where none is named; answered with `Bench`.

    load         what hangs on the shafts, in the words of `virtual:`: "torque=0.2", "blocked", "none"
    voltage      of the supply, V
    temperature  of the case and what is around it, degC
    position     to turn the shaft to by hand, rad
    plugged      whether it has its supply
    faults       what goes wrong on the line, in the words of `virtual:`; "none" mends everything
    """

    n: int
    bus: str
    servos: tuple[int, ...] = ()
    load: str = ""
    voltage: float | None = None
    temperature: float | None = None
    position: float | None = None
    plugged: bool | None = None
    faults: str = ""
