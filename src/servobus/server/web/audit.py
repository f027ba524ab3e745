"""Who changed what: the last entries in memory, all of them in a file where one is named."""

import json
import logging
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

KEPT = 1000
"""Entries in memory."""


class Audit:
    """A list of what was changed, by whom, and what came of it."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._entries: deque[dict[str, Any]] = deque(maxlen=KEPT)

    def note(self, who: str, what: str, bus: str, servo: str, values: Mapping[str, Any], result: str = "done") -> None:
        """Take note of a change. A disk that is full is told once, and is no reason to refuse the change."""
        entry = {
            "time": round(time.time(), 3),
            "who": who,
            "what": what,
            "bus": bus,
            "servo": servo,
            "values": dict(values),
            "result": result,
        }
        self._entries.append(entry)
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8", errors="replace") as file:
                file.write(json.dumps(entry, ensure_ascii=False) + "\n")
        except OSError:
            logging.getLogger("servobus").exception("%s: nothing more is written there", self._path)
            self._path = None

    def latest(self, count: int = 100) -> list[dict[str, Any]]:
        """Give the last entries, the newest first."""
        return list(self._entries)[::-1][:count]
