"""The EEPROM of virtual servos in a file, so that they remember like real ones.

One readable JSON file holds all servos of a rig. It is written whenever an EEPROM value changes, before
the servo answers, and it is replaced as a whole: a crash leaves the old file or the new one.
"""

import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from servobus.errors import BadValue, UsageError
from servobus.virtual.device.servo import VirtualServo

KIND = "servobus: EEPROM of virtual servos"
VERSION = 1


class StateFile:
    """Keeps the EEPROM contents of these servos, which are as specified, in a file.

    If the file exists, the servos get its contents and start again. Raises UsageError for a file that is
    damaged, for other servos, or cannot be read or written.
    """

    def __init__(self, path: Path, servos: Sequence[VirtualServo]) -> None:
        self.path = path.resolve()  # a link stays a link
        self._servos = {f"{number}: {servo.model.key()}@{servo.id}": servo for number, servo in enumerate(servos, 1)}
        if self.path.exists():
            self._load()
        else:
            self.save()
        for servo in servos:
            servo.memory.on_store = self.save

    def save(self) -> None:
        """Write the file."""
        content = {
            "kind": KIND,
            "version": VERSION,
            "servos": {name: servo.memory.stored() for name, servo in self._servos.items()},
        }
        try:
            _replace(self.path, json.dumps(content, indent=1) + "\n")
        except OSError as error:
            raise UsageError(f"state file {self.path} cannot be written: {error.strerror or error}") from error

    def _load(self) -> None:
        for name, values in self._read().items():
            servo = self._servos[name]
            missing = servo.memory.stored().keys() - values.keys()
            if missing:
                names = ", ".join(sorted(missing))
                raise UsageError(f"state file {self.path} is damaged: {name}: no value for {names}")
            try:
                servo.memory.restore(values)
            except BadValue as error:
                raise UsageError(f"state file {self.path} is damaged: {name}: {error}") from None
            servo.power_on(servo.time)

    def _read(self) -> dict[str, dict[str, Any]]:
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except OSError as error:
            raise UsageError(f"state file {self.path} cannot be read: {error.strerror or error}") from error
        except ValueError as error:
            raise UsageError(f"state file {self.path} is damaged: {error}") from None
        if not isinstance(content, dict) or content.get("kind") != KIND:
            raise UsageError(f"{self.path} is no state file of virtual servos")
        if content.get("version") != VERSION:
            raise UsageError(f"state file {self.path} is of version {content.get('version')}, not {VERSION}")
        kept = content.get("servos")
        if not isinstance(kept, dict) or not all(isinstance(values, dict) for values in kept.values()):
            raise UsageError(f"state file {self.path} is damaged: it lists no servos")
        if list(kept) != list(self._servos):
            raise UsageError(
                f"state file {self.path} is for other servos: {_names(kept)}, not {_names(self._servos)}; "
                "name the same ones in the same order, or another file"
            )
        return kept


def _names(servos: Any) -> str:
    return ",".join(name.partition(": ")[2] or name for name in servos)


def _replace(path: Path, text: str) -> None:
    """Put a file in the place of another in one step that survives a crash."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink()
        raise
    if os.name == "posix":
        # The new name is in the directory, which is written to the disk on its own.
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
