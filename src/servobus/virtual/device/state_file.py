"""The EEPROM of virtual servos in a file, so that they remember like real ones.

One readable JSON file holds all servos of a rig. It is written whenever an EEPROM value changes, before
the servo answers, and it is replaced as a whole: a crash leaves the old file or the new one.

Whoever keeps servos in a file holds a lock on the file itself, and locks each new file before it takes the place of the
old one. The system releases the lock when the process ends, however it ends. Windows has no such lock.
"""

import gc
import json
import os
import stat
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from servobus.errors import BadValue, UsageError
from servobus.transports.file_lock import is_at, lock, open_locked
from servobus.transports.usb_adapter import holders
from servobus.virtual.device.servo import VirtualServo

KIND = "servobus: EEPROM of virtual servos"
VERSION = 1
FLAGS = os.O_RDONLY | os.O_CREAT | getattr(os, "O_NONBLOCK", 0)  # opening a named pipe would wait for who writes it


class StateFile:
    """Keeps the EEPROM contents of these servos, which are as specified, in a file, from `open` to `close`.

    If the file exists and is not empty, the servos get its contents and start again. Raises UsageError for a file that
    is damaged, for other servos, in use by another program, or cannot be read or written.
    """

    def __init__(self, path: Path, servos: Sequence[VirtualServo]) -> None:
        self._handle: int | None = None
        """Of the file, locked."""
        self.path = path.resolve()  # a link stays a link
        self._servos = {f"{number}: {servo.model.key()}@{servo.id}": servo for number, servo in enumerate(servos, 1)}
        self._is_open = False
        self._text = ""
        """What the file holds, as far as is known here."""
        self.open()
        for servo in servos:
            servo.memory.on_store = self.save

    def __del__(self) -> None:
        self.close()

    def open(self) -> None:
        """Take the file, and what somebody else has put into it meanwhile."""
        try:
            self._take()
            if self._handle is not None:
                _new(self.path).unlink(missing_ok=True)  # a killed process may have left one
            text = self._read()
            self._is_open = True
            if text.strip() and text != self._text:
                self._load(text)
                self._text = text
            else:
                self.save()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let others have the file; what changes from here on is not kept, unless it is opened again."""
        self._is_open = False
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)

    def save(self) -> None:
        """Write the file, unless it holds the same already or is closed."""
        content = {
            "kind": KIND,
            "version": VERSION,
            "servos": {name: servo.memory.stored() for name, servo in self._servos.items()},
        }
        text = json.dumps(content, indent=1) + "\n"
        if not self._is_open or text == self._text:
            return
        self._take()  # again, if somebody has removed the file or put another in its place
        try:
            handle = _replace(self.path, text)
        except OSError as error:
            raise UsageError(f"state file {self.path} cannot be written: {error.strerror or error}") from error
        old, self._handle, self._text = self._handle, handle, text
        if old is not None:
            os.close(old)

    def _take(self) -> None:
        """Lock the file that bears the name, unless this is done."""
        if sys.platform == "win32" or (self._handle is not None and is_at(self._handle, self.path)):
            return
        try:
            try:
                handle = open_locked(self.path, FLAGS)
            except BlockingIOError:
                gc.collect()  # a port of this process that was dropped and never closed has no use for the file
                handle = open_locked(self.path, FLAGS)
        except BlockingIOError:
            raise UsageError(
                f"state file {self.path} is kept by {holders(str(self.path))}; end that first, or name another file"
            ) from None
        except OSError as error:
            done = "read" if self.path.exists() else "written"
            raise UsageError(f"state file {self.path} cannot be {done}: {error.strerror or error}") from error
        if self._handle is not None:
            os.close(self._handle)
        self._handle = handle

    def _load(self, text: str) -> None:
        for name, values in self._parse(text).items():
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

    def _read(self) -> str:
        """Give what is in the file; nothing if there is none yet."""
        try:
            if not stat.S_ISREG(self.path.stat().st_mode):
                raise UsageError(f"state file {self.path} cannot be read: it is no regular file")
            return self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise UsageError(f"state file {self.path} cannot be read: {error.strerror or error}") from error
        except UnicodeDecodeError as error:
            raise UsageError(f"state file {self.path} is damaged: {error}") from None

    def _parse(self, text: str) -> dict[str, dict[str, Any]]:
        try:
            content = json.loads(text)
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


def _replace(path: Path, text: str) -> int | None:
    """Put a file in the place of another in one step that survives a crash; give the handle of the new one, locked.

    Only who has the old one locked may do this, so the new one has a fixed name until then: what a killed process has
    left there is replaced by the next.
    """
    temporary = _new(path)
    temporary.unlink(missing_ok=True)
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        lock(handle)
        with os.fdopen(handle, "w", encoding="utf-8", closefd=False) as file:
            file.write(text)
            file.flush()
            os.fsync(handle)
        if sys.platform == "win32":
            os.close(handle)  # an open file cannot be renamed there
            temporary.replace(path)
            return None
        temporary.replace(path)
        # The new name is in the directory, which is written to the disk on its own.
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
    except BaseException:
        with suppress(OSError):
            os.close(handle)
        temporary.unlink(missing_ok=True)
        raise
    return handle


def _new(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")
