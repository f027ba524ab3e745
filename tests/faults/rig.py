"""Servos whose truth is known, on a line that goes wrong, behind either driver."""

from collections.abc import Callable
from typing import Any

from drivers import result_of
from samples import answer_levels, can_be_silenced, goal_range, sample_of
from servobus import MODELS, Bus, BusError
from servobus.bus.asyncio import AsyncBus
from servobus.families.base import Answers
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort, connect
from unit.lossy import ASYNC, SYNC

POSITION = "present_position"
ALTERING = {"flip", "pair", "junk", "drop", "twin"}
"""Kinds of fault that change the bytes of a reply."""


class Port(VirtualPort):
    """Virtual servos in this process; `sent` is what went out, `heard` what came in."""

    def __init__(self, url: str) -> None:
        made = connect(url)
        super().__init__(url, made.rig, real=False)
        self.sent: list[bytes] = []
        self.heard = b""

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        super().write(data)

    def read(self, timeout: float) -> bytes:
        data = super().read(timeout)
        self.heard += data
        return data


class FaultRig:
    """Servos of one model, `port`, and `bus` as a driver for them.

    `verdicts` are what reads came to: "right"; "provable" if it was not, but a fault altered the bytes into a packet
    whose id, command, length and checksum fit, so that nobody could know; "wrong" otherwise; or an exception's name.
    """

    def __init__(
        self,
        key: str,
        driver: str = SYNC,
        *,
        ids: str = "1-3",
        options: str = "",
        echo: bool | None = None,
        answers: Answers | None = None,
        settle: bool = True,
    ) -> None:
        self.model, self.sample = MODELS[key], sample_of(key)
        self.port = Port(f"virtual:{key}@{ids}?clock=virtual{options}")
        self.bus: Any = self._bus(driver, echo)
        if answers is None:
            answers = answer_levels(self.model)[-1]
        if can_be_silenced(self.model):
            for real in self.reals:
                real.memory.store(self.model.register("answer_level"), answers)
                real.power_on(0.0)
        for id in dict.fromkeys(real.id for real in self.reals):
            self.bus.attach(self.model, id, answers=answers)
        self.verdicts: list[str] = []
        self._turned = 0
        if settle:
            self.read()  # finds out about the echo

    def _bus(self, driver: str, echo: bool | None) -> Any:
        """Make the driver."""
        return (AsyncBus if driver == ASYNC else Bus)(self.port, echo=echo)

    @property
    def reals(self) -> list[VirtualServo]:
        return self.port.servos

    def real(self, id: int = 1) -> VirtualServo:
        return next(real for real in self.reals if real.id == id)

    def do(self, job: Callable[..., Any], *arguments: Any) -> Any:
        """Carry out a job on the bus, whichever driver it is; the arguments follow the bus."""
        return result_of(job(self.bus, *arguments))

    def inject(self, faults: str | None) -> None:
        """Let faults happen from now on, and count requests and replies from 1 on."""
        self.port.inject(faults)
        self.port.sent, self.port.heard = [], b""

    def turn(self, id: int = 1) -> int:
        """Turn a shaft to another place by hand; give what its sensor tells there."""
        self._turned += 1
        low, high = goal_range(self.model)
        raw = low + self._turned * 397 % (high - low + 1)
        self.real(id).turn_shaft(self.model.register(POSITION).decode(raw))
        return raw

    def read(self, id: int = 1, name: str = POSITION) -> int:
        row = self.model.register(name)
        raw: int = row.scale.encode(self.do(lambda bus: bus[id].read(row)))
        return raw

    def try_position(self, id: int = 1) -> str:
        """Turn a shaft, read it, and tell what became of that."""
        truth, hits, begin = self.turn(id), sum(self.port.rig.fault_counts.values()), len(self.port.heard)
        try:
            value = self.read(id)
            verdict = "right" if value == truth else "wrong"
            fresh = sum(self.port.rig.fault_counts.values()) - hits
            altered = fresh and any(one.kind in ALTERING for one in self.port.rig.injected[-fresh:])
            if verdict == "wrong" and altered and value in self.sample.positions(id, self.port.heard[begin:]):
                verdict = "provable"
        except BusError as error:
            verdict = type(error).__name__
        self.verdicts.append(verdict)
        return verdict
