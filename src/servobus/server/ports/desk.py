"""What clients may ask beyond the steps of procedures: leases, stops, what is to be seen, and what has happened.

A stop goes before everything: it is begun while its message is read, and carried out in a thread that waits for the job
that has the line alone.
"""

import asyncio
import weakref
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from servobus.bus.asyncio import AsyncBusServo
from servobus.bus.servo import Servo
from servobus.core.present import decoded_si
from servobus.errors import StopFailed, UsageError
from servobus.families import registry
from servobus.remote.managing import (
    CloseBus,
    Done,
    EndLease,
    Happened,
    Introduce,
    ListServos,
    LookAtBench,
    OpenBus,
    Resume,
    SaveBox,
    Seen,
    ServoInfo,
    Servos,
    SetBench,
    StopServos,
    Subscribe,
    TakeLease,
    Telemetry,
    Traffic,
    Unsubscribe,
    Value,
    WatchEvents,
    WatchTraffic,
)
from servobus.safety.safe_stop import check_safe_action
from servobus.server.ports.control import Control, Place, require
from servobus.server.ports.events import Event, Events
from servobus.server.ports.served_bus import ServedBus, key_of, parse_key
from servobus.server.ports.service import Connection, Service
from servobus.server.ports.telemetry import Values, Wish, check_wish, overview
from servobus.transports.tap import Chunk


class Ports(Protocol):
    """What a desk needs of the owner of the ports."""

    buses: dict[str, ServedBus]
    control: Control
    events: Events
    service: Service
    boxes: Path

    def open_bus(self, name: str, port: str, *, by: str = "") -> ServedBus: ...
    async def close_bus(self, name: str, *, by: str = "") -> None: ...


class Desk:
    """Answers the requests of all connections of a server."""

    def __init__(self, owner: Ports) -> None:
        self._owner, self._control = owner, owner.control
        self._watching: weakref.WeakKeyDictionary[Connection, dict[str, Callable[[], object]]] = (
            weakref.WeakKeyDictionary()
        )
        """Connection -> what it watches -> what ends that."""
        owner.service.handlers.update(
            {
                TakeLease: self._take_lease,
                EndLease: self._end_lease,
                StopServos: self._stop,
                Resume: self._resume,
                ListServos: self._list,
                Introduce: self._introduce,
                OpenBus: self._open,
                CloseBus: self._close,
                Subscribe: self._subscribe,
                Unsubscribe: self._unsubscribe,
                WatchTraffic: self._watch_traffic,
                WatchEvents: self._watch_events,
                SaveBox: self._save,
                LookAtBench: self._look_at_bench,
                SetBench: self._set_bench,
            }
        )

    # Who may move what

    def _take_lease(self, connection: Connection, asked: TakeLease) -> None:
        self._control.take(connection.who, asked.bus, asked.servos, over=asked.over)
        connection.tell(Done(asked.n))

    def _end_lease(self, connection: Connection, asked: EndLease) -> None:
        self._control.end_leases(connection.who, asked.bus, asked.servos or None)
        connection.tell(Done(asked.n))

    def _resume(self, connection: Connection, asked: Resume) -> None:
        self._control.resume(connection.who, asked.bus, asked.servos or None)
        connection.tell(Done(asked.n))

    def _stop(self, connection: Connection, asked: StopServos) -> None:
        names = [asked.bus] if asked.bus else list(self._owner.buses)
        if asked.servos and not asked.bus:
            raise UsageError("servos that are to be stopped stand with their bus")
        stops = []
        for name in names:
            served = self._control.bus(name)
            servos = [served.servo(key) for key in asked.servos] if asked.servos else list(served.bus)
            self._control.latch(name, connection.who.name, asked.servos or None)
            stops.append(self._control.stop(served, servos))
        connection.begin(asked.n, _stopped(asked.n, stops))

    # Who is there

    def _list(self, connection: Connection, asked: ListServos) -> None:
        served = self._control.bus(asked.bus)
        connection.tell(Servos(asked.n, tuple(self._info(served, servo) for servo in served.bus)))

    def _info(self, served: ServedBus, servo: AsyncBusServo) -> ServoInfo:
        key = key_of(servo)
        holder, stop = self._control.leases.holder(Place(served.name, key)), served.latch.stopped(key)
        return ServoInfo(
            key,
            servo.model.key(),
            holder.name if holder is not None else "",
            servo.permit.driven,
            stop.by if stop is not None else "",
        )

    def _introduce(self, connection: Connection, asked: Introduce) -> None:
        require(connection.who, "operator")
        served = self._control.bus(asked.bus)
        family, id, baud = parse_key(asked.servo)
        model = registry.model(asked.model)
        if model.family is not family:
            raise UsageError(f"{model.title} is of the family {model.family.name}, not {family.name}")
        servo = served.introduce(family, id, baud, model)
        if asked.safe_action:
            servo.permit.safe_action = check_safe_action(asked.safe_action, [servo.target])  # type: ignore[arg-type] # it raises for what is none
        connection.tell(Done(asked.n))

    def _open(self, connection: Connection, asked: OpenBus) -> None:
        require(connection.who, "operator")
        self._owner.open_bus(asked.bus, asked.port, by=connection.who.name)
        connection.tell(Done(asked.n))

    def _close(self, connection: Connection, asked: CloseBus) -> None:
        require(connection.who, "operator")
        self._control.bus(asked.bus)
        connection.begin(asked.n, _done(asked.n, self._owner.close_bus(asked.bus, by=connection.who.name)))

    # What is to be seen

    def _subscribe(self, connection: Connection, asked: Subscribe) -> None:
        served = self._control.bus(asked.bus)
        wanted: dict[Servo, tuple[str, ...]] = {}
        for one in asked.servos:
            servo = served.servo(one.servo)
            wanted[servo] = check_wish(servo, one.registers) if one.registers else overview(servo)
        served.telemetry.subscribe(connection, Wish(wanted, asked.period, everyone=not asked.servos))
        self._watch(connection, f"telemetry {asked.bus}", partial(served.telemetry.unsubscribe, connection))
        connection.tell(Done(asked.n))

    def _unsubscribe(self, connection: Connection, asked: Unsubscribe) -> None:
        self._unwatch(connection, f"telemetry {asked.bus}")
        connection.tell(Done(asked.n))

    def show(
        self,
        connection: Connection,
        served: ServedBus,
        now: float,
        seen: Mapping[Servo, Values],
        lost: Mapping[Servo, str],
    ) -> None:
        """Send what was read for a connection; one that is behind with reading gets the next one instead."""
        if connection.crowded:
            return
        answered = [Seen(key_of(servo), _values(servo, values)) for servo, values in seen.items()]
        silent = [Seen(key_of(servo), (), why) for servo, why in lost.items()]
        connection.tell(Telemetry(served.name, now, (*answered, *silent)))

    def _watch_traffic(self, connection: Connection, asked: WatchTraffic) -> None:
        served = self._control.bus(asked.bus)
        what = f"traffic {asked.bus}"
        self._unwatch(connection, what)
        if asked.on:
            missed = 0

            def carried(chunk: Chunk, by: str) -> None:
                nonlocal missed
                if connection.crowded:
                    missed += 1
                    return
                connection.tell(Traffic(asked.bus, chunk.time, chunk.direction, chunk.data, by, missed))
                missed = 0

            self._watch(connection, what, served.listen(carried))
        connection.tell(Done(asked.n))

    def _watch_events(self, connection: Connection, asked: WatchEvents) -> None:
        def told(event: Event) -> None:
            connection.tell(
                Happened(event.number, event.time, event.what, event.bus, event.servo, event.by, event.data)
            )

        self._watch(connection, "events", self._owner.events.listen(told))
        connection.tell(Done(asked.n))
        for event in self._owner.events.past(asked.after):
            told(event)

    def _save(self, connection: Connection, asked: SaveBox) -> None:
        require(connection.who, "operator")
        served = self._control.bus(asked.bus)

        async def save() -> str:
            path = await served.box.save(self._owner.boxes, served.name, asked.why)
            self._owner.events.tell("saved", bus=served.name, by=connection.who.name, path=str(path))
            return str(path)

        connection.begin(asked.n, _done(asked.n, save()))

    # Virtual servos

    def _look_at_bench(self, connection: Connection, asked: LookAtBench) -> None:
        from servobus.server.ports import bench  # noqa: PLC0415 - real ports need no virtual servos

        connection.tell(bench.look(self._control.bus(asked.bus), asked.n))

    def _set_bench(self, connection: Connection, asked: SetBench) -> None:
        from servobus.server.ports import bench  # noqa: PLC0415 - as above

        require(connection.who, "operator")
        connection.tell(bench.change(self._control.bus(asked.bus), asked))

    # What a connection watches ends with it

    def _watch(self, connection: Connection, what: str, end: Callable[[], object]) -> None:
        self._unwatch(connection, what)
        ends = self._watching.get(connection)
        if ends is None:
            ends = self._watching[connection] = {}
            connection.at_end.append(partial(self._forget, connection))
        ends[what] = end

    def _unwatch(self, connection: Connection, what: str) -> None:
        end = self._watching.get(connection, {}).pop(what, None)
        if end is not None:
            end()

    def _forget(self, connection: Connection) -> None:
        for end in self._watching.pop(connection, {}).values():
            end()


def _values(servo: Servo, values: Values) -> tuple[tuple[str, Value], ...]:
    rows = ((name, servo.model.register(name), value) for name, value in values.items())
    shown = ((name, decoded_si(row, value)) for name, row, value in rows)
    return tuple((name, tuple(value) if isinstance(value, list) else value) for name, value in shown)


async def _done(n: int, work: Coroutine[Any, Any, Any]) -> Done:
    came = await work
    return Done(n, came if isinstance(came, str) else "")


async def _stopped(n: int, stops: Sequence[Awaitable[list[str]]]) -> Done:
    """Answer when all were stopped, or tried. Raises StopFailed for what may still move."""
    outcomes = await asyncio.gather(*stops, return_exceptions=True)
    said = [str(one) for one in outcomes if isinstance(one, BaseException)]
    said += [text for one in outcomes if not isinstance(one, BaseException) for text in one]
    if said:
        raise StopFailed("; ".join(said), {}, {})
    return Done(n)
