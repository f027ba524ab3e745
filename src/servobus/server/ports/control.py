"""Who may send what: the gate through which all requests of all clients go.

What a request does is told from its bytes, so the rules hold for every program alike, whether it knows of them or not:

- Reading is for all.
- What writes needs the role of an operator, and a servo that nobody else holds.
- What ends a motion is let through to a servo that another one holds, too.
- What drives takes the lease of a servo that nobody holds, must not come too late, and not after a stop.

The driver of the bus takes note of what the clients drive, as it does of its own moves. So its safe stop finds all of
it: when a client is gone or hangs its servos are made safe, at the end all of them.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple, TypeVar

from servobus.bus.asyncio import AsyncBusServo
from servobus.core.effect import Effect, Kind
from servobus.core.exchange import Exchange
from servobus.core.framing import Packet
from servobus.core.operation import Priority
from servobus.core.registers import Register
from servobus.core.values import frozen
from servobus.errors import BusError, Refused, ServobusError, Stopped, UsageError
from servobus.families import registry
from servobus.families.base import Family
from servobus.remote.protocol import ROLES
from servobus.server.ports.events import Events
from servobus.server.ports.leases import Holder, Leases
from servobus.server.ports.served_bus import ServedBus, family_of, key_of

STALE = 0.5
"""s after which a command of motion is too old, whatever the deadman of its sender."""
MISSED = 3
"""Requests in a row without a good answer after which a servo is said to be lost."""
MOST_JUDGED = 4096
T = TypeVar("T")


class Place(NamedTuple):
    """A servo of the server: its bus, and its key there."""

    bus: str
    servo: str

    def __str__(self) -> str:
        return f"{self.servo} on bus {self.bus}"


@frozen
class _Judged:
    """What a request does, and to whom, as long as the servos of the bus are the same."""

    generation: int
    family: Family
    effect: Effect
    packet: Packet
    touched: tuple[AsyncBusServo, ...]
    driven: tuple[AsyncBusServo, ...]


class Control:
    """The gate of a server: roles, leases, stops, and what is told of requests; see `servobus.server.ports.gate`.

    buses   name -> bus, which may come and go
    events  is told what has happened
    """

    def __init__(self, buses: dict[str, ServedBus], events: Events) -> None:
        self.buses, self.events = buses, events
        self.leases: Leases[Place] = Leases(self._lease_changed)
        self._judged: dict[tuple[str, int, str, bytes], _Judged] = {}
        """What requests do that come again: by bus, speed, family and bytes."""
        self._missed: dict[Place, int] = {}
        self._alarms: dict[Place, int] = {}
        self._stoppers = ThreadPoolExecutor(thread_name_prefix="servobus stop")
        """Threads of their own: a stop must not wait until another thread has written a file."""
        self._stopping: set[asyncio.Future[Any]] = set()
        """Stops under way, so that they are not forgotten before they are over."""

    # The gate

    def admit(
        self,
        who: Holder,
        bus: str,
        exchange: Exchange[Any],
        baud: int,
        asked: float,
        priority: Priority = Priority.READ,
    ) -> None:
        """Raise the error with which a request is refused: UsageError, Held or Stopped; see `Gate`."""
        served = self.buses[bus]
        if (exchange.framing.name, exchange.request) in _strangers():
            return
        judged = self._judge(served, exchange, baud)
        if judged.effect.only_reads:
            served.speaker = who.name
            return
        try:
            require(who, "operator")
            if priority is not Priority.STOP:
                self._check(who, served, judged, asked)
        except ServobusError as error:
            self.events.tell("refused", bus=bus, by=who.name, request=exchange.what, why=str(error))
            raise
        served.speaker = who.name
        if priority is not Priority.STOP:  # to hold a servo where it is a goal is written, too
            for servo in judged.driven:
                servo.permit.driven, servo.permit.stopped = True, False

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:
        """Take note of what a request has changed, and of who answered."""
        served = self.buses.get(bus)
        if served is None or (exchange.framing.name, exchange.request) in _strangers():
            return
        outcomes = outcome if isinstance(outcome, list) else [outcome]
        judged = self._judge(served, exchange, baud)
        for one in outcomes if exchange.replies else ():  # where nothing answers there is an empty packet
            if isinstance(one, Packet):
                if exchange.replies:  # else it stands for the silence that was expected
                    self._answered(served, judged, baud, one)
            elif isinstance(one, BusError) and not isinstance(one, Refused) and one is outcome:
                self._unanswered(served, judged, baud, exchange.id)
        if not judged.effect.only_reads and not isinstance(outcome, ServobusError):
            self._changed(who, served, judged, baud)

    def silent(self, who: Holder) -> None:
        """Make safe what a client drives that hangs, and end its leases."""
        self._let_go(who, "hangs")

    def left(self, who: Holder) -> None:
        """Make safe what a client drives that is gone, and end its leases."""
        self._let_go(who, "has gone")

    # Leases and stops

    def bus(self, name: str) -> ServedBus:
        """Give a bus. Raises UsageError."""
        served = self.buses.get(name)
        if served is None:
            raise UsageError(f"no bus {name!r:.60} here; there are: {', '.join(self.buses) or 'none'}")
        return served

    def take(self, who: Holder, bus: str, keys: Sequence[str], *, over: bool) -> None:
        """Have a client hold servos. What another one has lost to it is made safe. Raises Held, UsageError."""
        require(who, "operator")
        served = self.bus(bus)
        places = [Place(bus, key_of(served.servo(key))) for key in keys]
        if not over:
            self.leases.take(who, places)
            return
        lost = self.leases.take_over(who, places)
        self._make_safe(served, [served.servo(key) for _, key in lost])

    def end_leases(self, who: Holder, bus: str, keys: Sequence[str] | None = None) -> None:
        """End leases of a client; what it drives goes on, held by nobody."""
        self.leases.end(who, None if keys is None else [Place(bus, key) for key in keys])

    def latch(self, bus: str, by: str, keys: Sequence[str] | None = None) -> None:
        """Let nothing move on a bus, or none of these servos, until `resume`."""
        served = self.bus(bus)
        served.latch.stop(by, asyncio.get_running_loop().time(), keys)
        self.events.tell("stopped", bus=bus, by=by, servos=list(keys) if keys is not None else None)

    def resume(self, who: Holder, bus: str, keys: Sequence[str] | None = None) -> None:
        """Allow motion again after a stop."""
        require(who, "operator")
        self.bus(bus).latch.resume(keys)
        self.events.tell("resumed", bus=bus, by=who.name, servos=list(keys) if keys is not None else None)

    async def settled(self) -> None:
        """Wait until all stops are over that are under way."""
        await asyncio.gather(*self._stopping, return_exceptions=True)

    # How it is decided

    def _judge(self, served: ServedBus, exchange: Exchange[Any], baud: int) -> _Judged:
        asked = served.name, baud, exchange.framing.name, exchange.request
        judged = self._judged.get(asked)
        if judged is not None and judged.generation == served.generation:
            return judged
        family = family_of(exchange.framing)
        packet, _ = exchange.framing.unframe(exchange.request)
        effect = family.effect(packet, partial(served.model_at, family, baud))
        if effect.only_reads:
            judged = _Judged(served.generation, family, effect, packet, (), ())
        else:
            touched = tuple(served.concerned(family, effect.ids, baud))
            driven = set(served.concerned(family, effect.ids_of(Kind.DRIVES), baud))
            moved = tuple(one for one in touched if one in driven)
            judged = _Judged(served.generation, family, effect, packet, touched, moved)
        if len(self._judged) >= MOST_JUDGED:
            self._judged.clear()
        self._judged[asked] = judged
        return judged

    def _check(self, who: Holder, served: ServedBus, judged: _Judged, asked: float) -> None:
        self.leases.check(who, [Place(served.name, key_of(servo)) for servo in judged.touched])
        if not judged.effect.kinds & Kind.DRIVES:
            return
        if getattr(who, "silent", False):
            raise Stopped(f"{who.name} was taken for hung, and its servos were made safe")
        if (late := asyncio.get_running_loop().time() - asked) > STALE:
            raise Stopped(f"a command of {who.name} came {late:.2f} s after it was sent, and was not carried out")
        keys = [key_of(servo) for servo in judged.driven]
        if served.latch.stopped() is not None:
            served.latch.check(keys or ["every servo"])
        served.latch.check(keys)
        self.leases.take(who, [Place(served.name, key) for key in keys])

    # What is noted

    def _answered(self, served: ServedBus, judged: _Judged, baud: int, answer: Packet) -> None:
        family = judged.family
        number = family.told_number(answer, judged.packet)
        known = served.met(family, answer.id, baud)
        servo = known if known is not None and number is None else served.meet(family, answer.id, baud, number)
        if servo is None:
            return
        place = Place(served.name, key_of(servo))
        missed = self._missed.pop(place, 0)
        if known is None or known.model is not servo.model or missed >= MISSED:
            self.events.tell("appeared", bus=served.name, servo=place[1], model=servo.model.title)
        if (told := family.told_alarms(answer)) is None:
            return
        alarms = family.known_alarms(servo.model, told)
        if alarms != self._alarms.get(place, 0):
            self._alarms[place] = alarms
            servo.note_alarms(alarms)
            self.events.tell("alarm", bus=served.name, servo=place[1], text=servo.alarm_text() if alarms else "")

    def _unanswered(self, served: ServedBus, judged: _Judged, baud: int, id: int) -> None:
        servo = served.met(judged.family, id, baud)
        if servo is None:
            return
        place = Place(served.name, key_of(servo))
        self._missed[place] = self._missed.get(place, 0) + 1
        if self._missed[place] == MISSED:
            self.events.tell("lost", bus=served.name, servo=place[1])

    def _changed(self, who: Holder, served: ServedBus, judged: _Judged, baud: int) -> None:
        for touch in judged.effect.touches:
            for servo in served.concerned(judged.family, [touch.id], baud):
                if touch.kinds & Kind.RELEASES:
                    servo.permit.mark_idle()
                elif touch.kinds & Kind.STOPS and servo.permit.driven:
                    servo.permit.stopped = True
                if touch.written:
                    values = {row.name: raw for row, raw in touch.written.items()}
                    what = "moved" if touch.kinds & Kind.DRIVES else "written"
                    self.events.tell(what, bus=served.name, servo=key_of(servo), by=who.name, raw=values)
                    self._follow(served, servo, touch.written)

    def _follow(self, served: ServedBus, servo: AsyncBusServo, written: Mapping[Register[Any], int]) -> None:
        """Know a servo by its new id or speed, with its lease, from when that is written."""
        before = Place(served.name, key_of(servo))
        id = written.get(servo.model.register("id"))
        speed = servo.model.optional("baud")
        raw = None if speed is None else written.get(speed)
        baud = None if speed is None or raw is None else int(speed.decode(raw))
        if id is None and baud is None:
            return
        served.moved_to(servo, id=id, baud=baud)
        self.leases.rename(before, Place(served.name, key_of(servo)))

    def _lease_changed(self, place: Place, holder: Holder | None) -> None:
        bus, servo = place
        self.events.tell("lease", bus=bus, servo=servo, by=holder.name if holder is not None else "")

    # Letting go

    def _let_go(self, who: Holder, why: str) -> None:
        places = self.leases.end(who)
        for name in dict.fromkeys(bus for bus, _ in places):
            served = self.buses.get(name)
            if served is None:
                continue
            keys = {key for bus, key in places if bus == name}
            driven = [servo for servo in served.bus if key_of(servo) in keys and servo.permit.driven]
            if driven:
                said = [key_of(servo) for servo in driven]
                self.events.tell("stopped", bus=name, by="server", servos=said, why=f"{who.name} {why}")
                self._make_safe(served, driven)

    def stop(self, served: ServedBus, servos: Sequence[AsyncBusServo]) -> Awaitable[list[str]]:
        """Begin to stop servos: those that are driven at once, beside the loop, then the others where they are.

        Gives what may still move, in words.
        """
        driven = [servo for servo in servos if servo.permit.driven]
        at_once = self._beside(partial(served.bus.safety.make_safe, None, driven))

        async def others() -> list[str]:
            said = await at_once
            try:
                await served.bus.stop([servo for servo in servos if servo not in driven])
            except ServobusError as error:
                said.append(str(error))
            return said

        return asyncio.ensure_future(others())

    def _make_safe(self, served: ServedBus, servos: Sequence[AsyncBusServo]) -> None:
        """Begin to make servos safe, beside the loop, by the safe action of each."""
        if any(servo.permit.driven for servo in servos):
            self._beside(partial(served.bus.safety.make_safe, None, servos))

    def _beside(self, work: Callable[[], T]) -> "asyncio.Future[T]":
        stop = asyncio.get_running_loop().run_in_executor(self._stoppers, work)
        self._stopping.add(stop)
        stop.add_done_callback(self._stopping.discard)
        return stop


@cache
def _strangers() -> frozenset[tuple[str, bytes]]:
    """Give the requests with which a scan finds devices of other protocols: they only ask."""
    return frozenset(
        (one.framing.name, one.request) for family in registry.FAMILIES.values() for one in family.strangers()
    )


def require(who: Holder, role: str) -> None:
    """Raise UsageError where the role of a client is less than this one."""
    if ROLES.index(getattr(who, "role", ROLES[-1])) < ROLES.index(role):
        raise UsageError(f"{who.name} may not do this: it takes the token of {role}, not of {getattr(who, 'role', '')}")
