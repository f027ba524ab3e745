"""The last minute of a port, always kept: bytes, events and what was read, to be saved when something has happened.

What led to a fault is seldom recorded, for nobody expected it. So each port keeps its last traffic in memory, bounded
in time and in size, and a save writes it as a recording (servobus.traffic.recording), which `servobus decode` shows,
`servobus replay` plays back and `decode --mcap` turns into MCAP.
"""

import asyncio
import os
import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from servobus.errors import PortError
from servobus.traffic.recording import Chunk, Header, Line, Note, RecordingFile, Speed, TapEnd

SECONDS = 60.0
"""s of traffic that are kept."""
MOST = 16 << 20
"""Bytes of memory at most that the kept traffic takes, about; a line at 1 Mbit/s carries 6 MB a minute."""
COST = 200
"""Bytes that a line takes in memory beside what it carries. Assumption: measured as 150 to 250 on 64-bit CPython."""
SLICE = 500
"""Lines that are written before the event loop has its turn: about 2 ms."""


class BlackBox:
    """Keeps what happened on one port lately.

    header  what is recorded; its speed is that at the beginning
    clock   gives s since the port's tap was made, on whose clock all times are
    """

    def __init__(
        self, header: Header, clock: Callable[[], float], *, seconds: float = SECONDS, most: int = MOST
    ) -> None:
        self._header, self._clock, self._seconds, self._most = header, clock, seconds, most
        self._lines: deque[Line] = deque()
        self._size = 0

    def __len__(self) -> int:
        return len(self._lines)

    def add(self, line: Line) -> None:
        """Keep a line; what is too old, or too much, goes."""
        self._lines.append(line)
        self._size += _size(line)
        oldest = line.time - self._seconds
        while self._lines[0].time < oldest or self._size > self._most:
            gone = self._lines.popleft()
            self._size -= _size(gone)
            if isinstance(gone, Speed):
                self._header = replace(self._header, baud=gone.baud)
            if not self._lines:
                return

    def note(self, kind: str, data: Mapping[str, Any]) -> None:
        """Keep an event, or what was read, as of now."""
        self.add(Note(self._clock(), kind, data))

    def window(self) -> tuple[Header, list[Line]]:
        """Give what is kept, as a recording that begins at 0."""
        lines = list(self._lines)
        now = self._clock()
        began = lines[0].time if lines else now
        started = datetime.now().astimezone().timestamp() - (now - began)
        said = datetime.fromtimestamp(started).astimezone().isoformat(timespec="milliseconds")
        header = replace(self._header, started=said)
        end = TapEnd(max(now, lines[-1].time if lines else now) - began)
        return header, [*(_shifted(line, began) for line in lines), end]

    async def save(self, folder: Path, name: str, why: str) -> Path:
        """Write what is kept to a new file in a folder; gives its path. The loop goes on meanwhile.

        The name holds the bus, the time and the reason. Raises PortError if the file cannot be written.
        """
        header, lines = self.window()
        try:
            path = _new_path(folder, name, why)
            with RecordingFile(path, header) as file:
                for at in range(0, len(lines), SLICE):
                    for line in lines[at : at + SLICE]:
                        file.write(line)
                    await asyncio.sleep(0)
        except OSError as error:
            raise PortError(f"{folder}: cannot be written: {error.strerror or error}") from None
        if file.failure is not None:
            raise file.failure
        return path


def _size(line: Line) -> int:
    if isinstance(line, Chunk):
        return COST + len(line.data)
    return COST * (1 + len(line.data)) if isinstance(line, Note) else COST


def _shifted(line: Line, began: float) -> Line:
    return replace(line, time=max(line.time - began, 0.0))


def _new_path(folder: Path, name: str, why: str) -> Path:
    """Give a path for a new recording, in a folder that is there; what people named may hold what no file name can."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", f"{name} {why}").strip("-")[:60].lower()
    folder.mkdir(parents=True, exist_ok=True)
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    for number in range(1000):
        path = folder / f"{stamp}-{words}{f'-{number}' if number else ''}.rec"
        if not os.path.lexists(path):
            return path
    raise PortError(f"{folder}: 1000 recordings of this second are there already")
