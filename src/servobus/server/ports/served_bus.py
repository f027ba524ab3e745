"""One bus of the server: its port, the servos that were met on it, and what is kept of it."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from servobus.bus.asyncio import AsyncBus, AsyncBusServo
from servobus.bus.servo import Servo
from servobus.core.exchange import Job, Procedure
from servobus.core.framing import Framing
from servobus.core.ids import BROADCAST
from servobus.core.values import replace
from servobus.errors import BadValue, UnknownName
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.families.present import servo_key
from servobus.server.ports.blackbox import BlackBox
from servobus.server.ports.leases import StopLatch
from servobus.server.ports.telemetry import Deliver, Telemetry
from servobus.traffic.recording import Chunk, Header, Line, RecordingFile
from servobus.transports.base import Transport
from servobus.transports.tap import TapTransport

T = TypeVar("T")


def key_of(servo: Servo) -> str:
    """Give what a servo is called in messages: its family, id and speed, as "dynamixel:1@57600"."""
    return servo_key(servo.family, servo.id, servo.baud)


def parse_key(key: str) -> tuple[Family, int, int]:
    """Give family, id and speed. Raises BadValue, UnknownName."""
    name, _, rest = key.partition(":")
    id, _, baud = rest.partition("@")
    if not (id.isdecimal() and baud.isdecimal()):
        raise BadValue(f"{key!r:.60} names no servo; one is dynamixel:1@57600")
    return registry.family(name), int(id), int(baud)


class ServedBus:
    """A bus that several share.

    name   what clients call it
    port   its port, opened
    deliver  is given what was read for clients; see `Telemetry`
    record  file for a recording that goes on all the time
    bus    the driver, which holds what the server itself knows of the servos
    latch  what a stop has forbidden to move
    box    the last minute of its traffic
    file   a recording that goes on all the time, if one was asked for
    """

    def __init__(self, name: str, port: Transport, deliver: Deliver, *, record: Path | None = None) -> None:
        self.name = name
        self.tap = TapTransport(port, self._carried)
        header = Header(port.name, port.baud)
        self.box = BlackBox(header, self.tap.elapsed)
        self.file = RecordingFile(record, header) if record is not None else None
        self.bus = AsyncBus(self.tap)
        self.latch: StopLatch[str] = StopLatch()
        self.telemetry = Telemetry(self.bus, deliver, self._as_server)
        self.speaker = ""
        """Name of the client whose request went out last; empty for one of the server itself."""
        self._listeners: list[Callable[[Chunk, str], object]] = []
        self.generation = 0
        """Grows when a servo becomes known or turns out to be another one: then requests may mean other things."""
        self._met: dict[tuple[Family, int, int], AsyncBusServo] = {}
        self._met_at = -1

    def _carried(self, line: Line) -> None:
        self.box.add(line)
        if self.file is not None:
            self.file.write(line)
        if self._listeners and isinstance(line, Chunk):
            for listener in list(self._listeners):
                listener(line, self.speaker)

    def _as_server(self, job: Job[T]) -> Procedure[T]:
        """Have a job of the server itself go out under no client's name."""
        self.speaker = ""
        return (yield from job)

    def listen(self, listener: Callable[[Chunk, str], object]) -> Callable[[], None]:
        """Have a listener told of the bytes on the bus, with the name of who asked; give what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def close(self) -> None:
        """Give the port back."""
        self.bus.close()
        if self.file is not None:
            self.file.close()

    def servo(self, key: str) -> AsyncBusServo:
        """Give a servo that is known. Raises UnknownName, BadValue."""
        family, id, baud = parse_key(key)
        found = self.met(family, id, baud)
        if found is None:
            raise UnknownName(f"no servo {key} was met on bus {self.name}; a scan finds those that are there")
        return found

    def met(self, family: Family, id: int, baud: int) -> AsyncBusServo | None:
        """Give the servo that is known at this place."""
        if self._met_at != self.generation:
            self._met = {(one.family, one.id, one.baud): one for one in self.bus}
            self._met_at = self.generation
        return self._met.get((family, id, baud))

    def meet(self, family: Family, id: int, baud: int, number: int | None = None) -> AsyncBusServo | None:
        """Know a servo, of the model that it says, or that is remembered of it; None where no table fits it."""
        servo = self.met(family, id, baud)
        if servo is not None and number is None:
            return servo
        model = self.bus.identify(family, id, baud, number)
        if model is None or (servo is not None and servo.model is model):
            return servo
        return self.introduce(family, id, baud, model)

    def introduce(self, family: Family, id: int, baud: int, model: type[Model]) -> AsyncBusServo:
        """Know a servo of this model, as somebody says who knows it."""
        servo = self.met(family, id, baud)
        if servo is not None and servo.model is model:
            return servo
        servo = self.bus.attach(model, id, baud=baud)
        self.generation += 1
        return servo

    def moved_to(self, servo: AsyncBusServo, *, id: int | None = None, baud: int | None = None) -> None:
        """Take note that a servo was given another id or speed, by somebody who wrote its register."""
        id = servo.id if id is None else id
        baud = servo.baud if baud is None else baud
        servo.target = replace(servo.target, id=id, baud=baud)
        self.generation += 1

    def model_at(self, family: Family, baud: int, id: int) -> type[Model] | None:
        """Give the model of a servo, as far as it is known."""
        servo = None if id == BROADCAST else self.met(family, id, baud)
        return servo.model if servo is not None else registry.unknown(family, None)

    def concerned(self, family: Family, ids: Iterable[int], baud: int) -> list[AsyncBusServo]:
        """Give the servos that a request is for. One that was not met yet is known from then on."""
        found: dict[AsyncBusServo, None] = {}
        for id in ids:
            if id == BROADCAST:
                found.update(dict.fromkeys(one for one in self.bus if one.family is family and one.baud == baud))
            elif (servo := self.meet(family, id, baud)) is not None:
                found[servo] = None
        return list(found)


def family_of(framing: Framing) -> Family:
    """Give the family whose packets have this framing. Raises UnknownName."""
    for family in registry.FAMILIES.values():
        if family.framing is framing:
            return family
    raise UnknownName(f"no family speaks {framing.name}")
