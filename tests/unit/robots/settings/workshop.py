"""Robots on virtual servos whose truth is known, and that live on when a program ends."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from servobus import Bus
from servobus.core.registers import Area
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url


class Killed(BaseException):
    """The program ended here, at once: no handler of an error sees it."""


class KilledPort(VirtualPort):
    """A port that calls `before` ahead of each request."""

    def __init__(self, name: str, rig: Any, before: Callable[[bytes], None], now: float) -> None:
        super().__init__(name, rig, real=False)
        self._before, self._now = before, now

    def write(self, data: bytes) -> None:
        self._before(data)
        super().write(data)


class Workshop:
    """Virtual servos by port, and a robot file for them in a folder; `open` gives a robot as a new program would.

    before   is called ahead of each request with its bytes
    buses    the bus on each port, as the last program opened it
    """

    def __init__(self, folder: Path, text: str, ports: Mapping[str, str]) -> None:
        self.rigs = {name: build_rig(parse_url(f"virtual:{spec}?clock=virtual")) for name, spec in ports.items()}
        self.path = folder / "arm.toml"
        head = "".join(f'[port.{name}]\npath = "virtual:{spec}"\n' for name, spec in ports.items())
        self.path.write_text(f"[robot]\nformat = 1\n{head}{text}", encoding="utf-8")
        self.before: Callable[[bytes], None] = lambda _: None
        self.buses: dict[str, Bus] = {}

    def servo(self, port: str, id: int) -> VirtualServo:
        return next(servo for servo in self.rigs[port].servos if servo.id == id)

    @property
    def now(self) -> float:
        """The time on the clock of the servos, s."""
        return max((bus.transport.now() for bus in self.buses.values()), default=0.0)

    def unplug(self, port: str, id: int) -> None:
        self.rigs[port].unplug([self.servo(port, id)], self.now)

    def plug(self, port: str, id: int) -> None:
        self.rigs[port].plug([self.servo(port, id)], self.now)
        for bus in self.buses.values():
            bus.transport.sleep(1.0)  # it starts

    def get(self, port: str, id: int, name: str) -> int:
        """Give what a register of a servo holds, raw: what survives power-off, where it has that."""
        servo = self.servo(port, id)
        row = servo.model.register(name)
        return servo.memory.eeprom[row] if row.area is Area.EEPROM else servo.memory[row]

    def memories(self) -> dict[str, Any]:
        """Give all that survives power-off in the servos."""
        return {
            f"{port} {n}": {
                row.name: servo.memory.eeprom[row] for row in servo.model.registers.values() if row.area is Area.EEPROM
            }
            for port, rig in self.rigs.items()
            for n, servo in enumerate(rig.servos)
        }

    def _about_to(self, data: bytes) -> None:
        self.before(data)

    def open(self) -> Robot:
        now = self.now
        self.buses = {
            name: Bus(KilledPort(name, rig, self._about_to, now), echo=False) for name, rig in self.rigs.items()
        }
        return Robot(read_text(self.path.read_text(encoding="utf-8"), self.path), self.buses)
