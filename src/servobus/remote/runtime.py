"""Which servers of this user run on this computer: a file for each, of mode 0600, in the runtime folder.

A server keeps its file locked while it lives, so a file that nobody has locked is that of a server that was killed.
"""

import json
import os
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from servobus.core.values import frozen
from servobus.errors import PortError
from servobus.remote.address import Address
from servobus.transports import usb_adapter
from servobus.transports.file_lock import lock, open_locked

NAME = "server-{}.json"


@frozen
class Server:
    """A server that runs.

    pid    its process
    host   where it listens, with `port`
    token  what lets programs of this user in
    http   address of its pages; empty if it has none
    buses  (name of a bus, its port)
    """

    pid: int
    host: str
    port: int
    token: str
    http: str
    buses: tuple[tuple[str, str], ...]


def runtime_folder() -> Path:
    """Give the folder for what belongs to running programs of this user, for their eyes only; make it if need be.

    Raises PortError if it cannot be had, or others may write there.
    """
    own = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = Path(own) / "servobus" if own else Path(tempfile.gettempdir()) / f"servobus-{_user()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError as error:
        raise PortError(f"{folder}: no runtime folder ({error.strerror or error})") from error
    if os.name == "posix" and (
        not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid() or stat.S_IMODE(about.st_mode) & 0o077
    ):
        raise PortError(f"{folder}: others may look into this folder or it is theirs; remove it, or chmod 700 it")
    return folder


class RuntimeFile:
    """The file of a server that runs, in this process. It is gone when it is closed, or the process ends."""

    def __init__(self, server: Server) -> None:
        self._path = runtime_folder() / NAME.format(server.pid)
        with suppress(FileNotFoundError):
            self._path.unlink()  # of another process that had this number
        old = os.umask(0o077)
        try:
            self._handle = open_locked(self._path, os.O_RDWR | os.O_CREAT)
        finally:
            os.umask(old)
        self.tell(server)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def tell(self, server: Server) -> None:
        """Say what is so now."""
        named = {name: getattr(server, name) for name in Server.__match_args__}
        text = (json.dumps(named | {"buses": dict(server.buses)}) + "\n").encode()
        os.lseek(self._handle, 0, os.SEEK_SET)
        os.write(self._handle, text)
        os.ftruncate(self._handle, len(text))

    def close(self) -> None:
        """Remove the file."""
        if self._handle >= 0:
            with suppress(OSError):
                self._path.unlink()
            os.close(self._handle)
            self._handle = -1


def servers() -> Iterator[Server]:
    """Give the servers of this user that run; files of dead ones are removed."""
    try:
        paths = sorted(runtime_folder().glob(NAME.format("*")))
    except PortError:
        return
    for path in paths:
        if not _is_dead(path):
            with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):  # what is no such file
                yield _read(json.loads(path.read_text(encoding="utf-8")))


def token_for(host: str, port: int) -> str:
    """Give what lets programs of this user into a server of this user; empty if none of them listens there."""
    return next((one.token for one in servers() if one.port == port and host in (one.host, "localhost")), "")


def find_server(bus: str) -> Server:
    """Give the server of this user that has a bus of this name. Raises PortError."""
    running = list(servers())
    found = [one for one in running if bus in ("", *dict(one.buses))]
    if len(found) == 1:
        return found[0]
    there = ", ".join(f"servobus:///{name}" for one in running for name, _ in one.buses)
    if not running:
        raise PortError(f"servobus:///{bus}: no server of yours runs here; `servobus serve PORT` starts one")
    said = "several servers have such a bus; write servobus://HOST:PORT/NAME" if found else "no such bus"
    raise PortError(f"servobus:///{bus}: {said}; there are: {there or 'none'}")


@frozen
class Shared:
    """A port that a server of this user has opened for others: its process, and what to open instead."""

    pid: int
    address: str


def sharing(port: str) -> Shared | None:
    """Tell which server of this user has a port open, whatever its name is; None if none has."""
    running = list(servers())
    wanted = _real(port)
    for server in running:
        for name, opened in server.buses:
            if _real(opened) == wanted:
                unique = sum(name in dict(one.buses) for one in running) == 1
                where = Address("", 0, name) if unique else Address(server.host, server.port, name)
                return Shared(server.pid, str(where))
    return None


def _real(port: str) -> str:
    return usb_adapter.real_name(port) if usb_adapter.is_device(port) else port


def _is_dead(path: Path) -> bool:
    """Tell whether the server of a file has ended without removing it, and remove it then."""
    if sys.platform == "win32":
        return False  # no locks; a connection tells
    try:
        handle = os.open(path, os.O_RDWR)
    except OSError:
        return True
    try:
        lock(handle)
    except BlockingIOError:
        return False
    else:
        with suppress(OSError):
            path.unlink()
        return True
    finally:
        os.close(handle)


def _read(found: Mapping[str, Any]) -> Server:
    buses = tuple((str(name), str(port)) for name, port in found["buses"].items())
    return Server(
        int(found["pid"]), str(found["host"]), int(found["port"]), str(found["token"]), str(found["http"]), buses
    )


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
