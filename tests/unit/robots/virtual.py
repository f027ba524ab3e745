"""Robots on virtual servos whose truth is known, and that live on when a program ends."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from servobus import Bus
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

    def __init__(self, name: str, rig: Any, before: Callable[[bytes], None]) -> None:
        super().__init__(name, rig, real=False)
        self._before = before

    def write(self, data: bytes) -> None:
        self._before(data)
        super().write(data)


class Workshop:
    """Virtual servos by port, and a robot file for them in a folder; `open` gives a robot as a new program would.

    before   is called ahead of each request with its bytes
    """

    def __init__(self, folder: Path, text: str, ports: Mapping[str, str]) -> None:
        self.rigs = {name: build_rig(parse_url(f"virtual:{spec}?clock=virtual")) for name, spec in ports.items()}
        self.path = folder / "arm.toml"
        head = "".join(f'[port.{name}]\npath = "virtual:{spec}"\n' for name, spec in ports.items())
        self.path.write_text(f"[robot]\nformat = 1\n{head}{text}", encoding="utf-8")
        self.before: Callable[[bytes], None] = lambda _: None

    def servo(self, port: str, id: int) -> VirtualServo:
        return next(servo for servo in self.rigs[port].servos if servo.id == id)

    def get(self, port: str, id: int, name: str) -> int:
        """Give what a servo holds: what survives power-off, where it has that."""
        servo = self.servo(port, id)
        row = servo.model.register(name)
        return servo.memory.stored(row) if row.place.locations[-1][0] != row.place.locations[0][0] else servo.get(name)

    def memories(self) -> dict[str, Any]:
        """Give all that the servos hold."""
        return {
            f"{port} {servo.id}": {row.name: self.get(port, servo.id, row.name) for row in _settings(servo)}
            for port, rig in self.rigs.items()
            for servo in rig.servos
        }

    def open(self) -> Robot:
        buses = {
            name: Bus(KilledPort(name, rig, lambda data: self.before(data)), echo=False)
            for name, rig in self.rigs.items()
        }
        return Robot(read_text(self.path.read_text(encoding="utf-8"), self.path), buses)


def _settings(servo: VirtualServo) -> list[Any]:
    return [row for row in servo.model.registers.values() if row.writable and row.area.value == "eeprom"]
