"""Paths of ports in a robot file: one that is relative begins at the folder of the file, as those of its motions do."""

import os
import re
from pathlib import Path

from servobus.robots.file.entries import OPEN_PORT


def from_file(path: str, folder: Path | None) -> str:
    """Give the path of a port, as it stands in a robot file in this folder, to who opens it.

    `folder` is None for a robot file that is none: then the path stays as it is.
    """
    return path if folder is None or not _relative(path) else str(folder / path)


def for_file(path: str, folder: Path) -> str:
    """Give the path of a port, as a person wrote it here, for a robot file in this folder."""
    return os.path.relpath(path, folder) if _relative(path) else path


def _relative(path: str) -> bool:
    """Tell whether this is a relative path: no absolute one, no COM4, and nothing like socket://, virtual: or usb:."""
    windows = re.fullmatch(r"COM\d+", path, re.IGNORECASE)
    return not (windows or ":" in path or path == OPEN_PORT or Path(path).is_absolute())
