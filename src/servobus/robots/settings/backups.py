"""What the servos of a robot held before something was written to them: files in a folder beside the robot file.

    arm.toml
    arm.backups/
        2026-11-28_14-05-33-120000/   a run of `apply`
            run.json                  what it is about to do, and what is done
            shoulder.toml             the settings of a servo as they were before, as `servobus backup` writes them
            lift-2.toml               those of the second servo of a joint
        last/
            shoulder.toml             the settings of a servo as they were known last, for a new one in its place
        new/
            shoulder_<moment>.toml    the settings of a new servo as they were before it was adopted
        adopting/
            shoulder.toml             the settings that a new servo is to have; gone once it has them

A run says what it is going to do before it does so. A program that is killed leaves a run that has not ended: the next
one goes on with it, and keeps the backups that were made first.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal, TypeAlias

from servobus.core.values import frozen
from servobus.errors import NotRestored, UsageError
from servobus.jobs.backup import Backup
from servobus.robots.file.entries import RobotFile
from servobus.transports.file_lock import replace_text

STAMP = "%Y-%m-%d_%H-%M-%S-%f"
"""How the moment at which a run began, UTC, stands in the name of its folder."""
RUN = "run.json"
LAST = "last"
NEW = "new"
ADOPTING = "adopting"
KEPT = 20
"""Runs that are kept; older ones that have ended are removed."""

State: TypeAlias = Literal["under way", "done", "being undone", "undone"]


@frozen
class Before:
    """What one servo held before a run wrote to it.

    backup  all its settings that survive power-off
    names   those of them that the run writes
    ram     registers in RAM, raw, that the run writes
    """

    joint: str
    n: int
    port: str
    backup: Backup
    names: tuple[str, ...]
    ram: Mapping[str, int]

    @property
    def key(self) -> str:
        """The name of its file, without the ending."""
        return file_key(self.joint, self.n)


def file_key(joint: str, n: int) -> str:
    """Give the name under which the settings of a servo are kept: that of its joint, with a number from the second."""
    return joint if n == 0 else f"{joint}-{n + 1}"


class Run:
    """A run: what it wrote to, and how far it came. Each change of it is on the disk when the call returns."""

    def __init__(self, folder: Path, state: State, servos: Mapping[str, Mapping[str, Any]]) -> None:
        self.folder = folder
        self.state: State = state
        self._servos = {key: dict(entry) for key, entry in servos.items()}

    def __contains__(self, key: str) -> bool:
        return key in self._servos

    @property
    def unfinished(self) -> int:
        """Servos that were begun with and not ended."""
        return sum(not entry["done"] for entry in self._servos.values())

    def begin(self, joint: str, n: int, port: str, saved: Backup, names: Iterable[str], ram: Mapping[str, int]) -> None:
        """Say that a servo is going to be written to, and what it holds now. What is kept of it already stays.

        `names` are the registers of the backup that are written, `ram` those in RAM with what they hold.
        """
        key = file_key(joint, n)
        if key not in self._servos:
            self.folder.mkdir(parents=True, exist_ok=True)
            replace_text(self.folder / f"{key}.toml", saved.text())
            self._servos[key] = {"joint": joint, "n": n, "port": port, "names": [], "ram": {}}
        entry = self._servos[key]
        entry["names"] = list(dict.fromkeys([*entry["names"], *names]))
        entry["ram"] = {**ram, **entry["ram"]}
        entry["done"] = False
        self._write()

    def end(self, joint: str, n: int) -> None:
        """Say that a servo has been written to and read back."""
        self._servos[file_key(joint, n)]["done"] = True
        self._write()

    def mark(self, state: State) -> None:
        """Say how far all of it is. A run that wrote to no servo leaves nothing."""
        self.state = state
        if self._servos:
            self._write()

    def servos(self) -> list[Before]:
        """Give what the servos held before, the last written first. Raises UsageError for a file that is damaged."""
        found = []
        for key, entry in reversed(self._servos.items()):
            path = self.folder / f"{key}.toml"
            try:
                saved = Backup.parse(path.read_text(encoding="utf-8"))
            except (OSError, UsageError) as error:
                raise UsageError(f"{path}: {error}") from None
            names = tuple(name for name in entry["names"] if name in saved.values)
            found.append(Before(entry["joint"], entry["n"], entry["port"], saved, names, entry["ram"]))
        return found

    def _write(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        data = {"state": self.state, "servos": self._servos}
        replace_text(self.folder / RUN, json.dumps(data, indent=2) + "\n")


class Backups:
    """The folder of a robot file with the runs that wrote to its servos."""

    def __init__(self, file: RobotFile) -> None:
        if file.path is None:
            raise UsageError(f"{file.name} was not read from a file, so there is no place beside it to keep backups")
        path = file.path.resolve()  # a link stays a link
        self.folder = path.with_name(f"{path.stem}.backups")

    def runs(self) -> list[Run]:
        """Give the runs, the oldest first."""
        if not self.folder.is_dir():
            return []
        return [_read(at.parent) for at in sorted(self.folder.glob(f"*/{RUN}"))]

    def latest(self) -> Run | None:
        """Give the last run that was not undone."""
        return next((run for run in reversed(self.runs()) if run.state != "undone"), None)

    def open_run(self) -> Run:
        """Give the run that was broken off, or a new one. Raises UsageError while an undo has not ended."""
        latest = self.latest()
        if latest is not None and latest.state == "being undone":
            raise UsageError(
                f"{latest.folder}: an undo of this run was broken off; finish it with `servobus robot apply FILE "
                "--undo` first"
            )
        if latest is not None and latest.state == "under way":
            return latest
        return Run(self._new_folder(), "under way", {})

    def close_run(self, run: Run) -> None:
        """Say that all of a run is done, and remove the oldest runs."""
        run.mark("done")
        ended = [old for old in self.runs() if old.state in ("done", "undone")]
        for old in ended[:-KEPT]:
            for one in old.folder.iterdir():
                one.unlink()
            old.folder.rmdir()

    def keep_last(self, joint: str, n: int, saved: Backup) -> None:
        """Keep the settings of a servo, for a new one in its place."""
        path = self.last_path(joint, n)
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, saved.text())

    def last(self, joint: str, n: int) -> Backup | None:
        """Give the settings of a servo as they were known last. Raises UsageError for a file that is damaged."""
        return _kept(self.last_path(joint, n))

    def keep_new(self, joint: str, n: int, saved: Backup) -> Path:
        """Keep the settings of a new servo as they were before it was adopted; give the file."""
        folder = self.folder / NEW
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{file_key(joint, n)}_{datetime.now(UTC).strftime(STAMP)}.toml"
        replace_text(path, saved.text())
        return path

    @contextmanager
    def adopting(self, joint: str, n: int, wanted: Backup) -> Iterator[None]:
        """Keep what a new servo is to hold while the block runs; it stays kept where the block is broken off.

        A servo that does not take a setting (NotRestored) was given all the same: then nothing is left to be done.
        """
        path = self._adopting(joint, n)
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, wanted.text())
        try:
            yield
        except NotRestored:
            path.unlink()
            raise
        path.unlink()

    def adoption(self, joint: str, n: int) -> Backup | None:
        """Give what a servo is to hold whose adoption was broken off. Raises UsageError for a file that is damaged."""
        return _kept(self._adopting(joint, n))

    def _adopting(self, joint: str, n: int) -> Path:
        return self.folder / ADOPTING / f"{file_key(joint, n)}.toml"

    def last_path(self, joint: str, n: int) -> Path:
        """Give the file in which the settings of a servo are kept as they were known last."""
        return self.folder / LAST / f"{file_key(joint, n)}.toml"

    def _new_folder(self) -> Path:
        now = datetime.now(UTC)
        while (folder := self.folder / now.strftime(STAMP)).exists() or any(
            run.folder.name >= folder.name for run in self.runs()
        ):
            now += timedelta(seconds=1)  # the clock was set back, perhaps
        return folder


def _kept(path: Path) -> Backup | None:
    try:
        return Backup.parse(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _read(folder: Path) -> Run:
    path = folder / RUN
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return Run(folder, data["state"], data["servos"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} is damaged, or no file of servobus: {error}; move its folder away") from None
