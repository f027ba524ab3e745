"""A line between a driver and virtual servos that loses what a test says, and counts."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

import extent
from samples import answer_levels, can_be_silenced
from servobus import MODELS, Bus
from servobus.bus.asyncio import AsyncBus
from servobus.bus.servo import Servo
from servobus.errors import PortLost
from servobus.families.base import Answers
from servobus.transports.base import Transport
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort, connect


class Lossy(Transport):
    """Virtual servos behind a bad contact.

    requests     what was sent since `lose`, bytes
    lose         forget what was sent so far; from now on lose the request or the reply with this number, from 1 on
    on_request   called with each request before it goes out; False loses it
    unplugged    whether the port is gone for whoever reads
    """

    def __init__(self, spec: str) -> None:
        self.port: VirtualPort = connect(f"virtual:{spec}?clock=virtual")
        self.name, self.latency = self.port.name, self.port.latency
        self.requests: list[bytes] = []
        self.on_request: Callable[[bytes], bool] | None = None
        self._lost_request = self._lost_reply = 0
        self._deaf = False
        self.unplugged = False

    def lose(self, *, request: int = 0, reply: int = 0) -> None:
        self.requests = []
        self._lost_request, self._lost_reply = request, reply

    @property
    def servos(self) -> list[VirtualServo]:
        return self.port.servos

    @property
    def baud(self) -> int:  # type: ignore[override] # that of the line below
        return self.port.baud

    def write(self, data: bytes) -> None:
        self.requests.append(data)
        self._deaf = len(self.requests) == self._lost_reply
        if len(self.requests) == self._lost_request or (self.on_request and not self.on_request(data)):
            return
        self.port.write(data)

    def read(self, timeout: float) -> bytes:
        data = self.port.read(timeout)
        if self.unplugged:
            raise PortLost("the port is gone")
        return b"" if self._deaf else data

    def set_baud(self, baud: int) -> None:
        self.port.set_baud(baud)

    def close(self) -> None:
        self.port.close()

    def blocking(self) -> bool:
        return self.port.blocking()

    def now(self) -> float:
        return self.port.now()

    def sleep(self, seconds: float) -> None:
        self.port.sleep(seconds)


SYNC, ASYNC = "sync", "async"
DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
CHOSEN_DRIVERS = pytest.mark.parametrize("driver", extent.some([SYNC, ASYNC], 1))
"""For jobs that are done dozens of times in a test: what carries them out is the same each time."""
Job = Callable[[Any], Any]


class Bench:
    """One virtual servo with id 5 behind a lossy line, and a driver for it."""

    def __init__(self, key: str, driver: str, answers: Answers | None = None, id: int = 5) -> None:
        """Give the servo this answer level, the highest that it has by default."""
        model = MODELS[key]
        if answers is None:
            answers = answer_levels(model)[-1]
        self.line = Lossy(f"{key}@{id}")
        self.bus: Any = (Bus if driver == SYNC else AsyncBus)(self.line, echo=False)
        if can_be_silenced(model):
            self.real.memory.store(model.register("answer_level"), answers)
            self.real.power_on(0.0)
        self.servo: Servo = self.bus.attach(model, id, answers=answers)

    @property
    def real(self) -> VirtualServo:
        """The virtual servo, up to date."""
        return self.line.servos[0]

    def do(self, job: Job) -> Any:
        """Carry out a job on the servo, whichever driver it has."""
        if isinstance(self.bus, Bus):
            return job(self.servo)

        async def main() -> Any:
            return await job(self.servo)

        return asyncio.run(main())

    def at(self) -> tuple[int, int]:
        """Where the servo object is."""
        return self.servo.id, self.servo.baud

    def really_at(self) -> tuple[int, int]:
        """Where the virtual servo is; speeds as the manual prints them."""
        near = min(self.real.model.bauds, key=lambda baud: abs(baud - self.real.baud))
        return self.real.id, near

    def stored(self, name: str) -> int:
        return self.real.memory.eeprom[self.real.model.register(name)]
