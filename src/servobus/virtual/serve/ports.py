"""Virtual servos behind a port of the operating system, for other people's programs.

    PtyPort    a pseudo terminal, which programs open like a serial port; with a link of your choice to it
    TcpPort    a TCP port, as of a serial device server

Both are context managers that `serve` one rig in real time until they are told to stop.
"""

import errno
import itertools
import os
import select
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from servobus.errors import PortError
from servobus.transports.symlink import claimed
from servobus.virtual.serve.rig import Rig

if sys.platform != "win32":
    import fcntl
    import termios
    import tty

GRAIN = 200e-6
"""s; bytes that are due within this time of each other go out in one piece."""
PULSE = 0.02
"""s after which a request to stop is noticed, and resting servos are looked after, at the latest."""
SPARE = 0.0005
"""s that looking after servos may take at once: a request that comes meanwhile waits no longer."""
LOOKOUT = 0.005
"""s between two looks whether somebody has opened the pseudo terminal."""
CHUNK = 4096


class Port(ABC):
    """What a client sees of a rig. `name` is what it opens."""

    name: str

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self._stack = ExitStack()
        self._turns = itertools.cycle(rig.servos)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._open(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def serve(self, stop: threading.Event) -> None:
        """Carry bytes until `stop` is set. The rig's time 0 is now."""
        started = time.monotonic()
        while not stop.is_set():
            now = time.monotonic() - started
            if self.rig.gone(now):
                self._stay_away(stop, started)
                continue
            if replies := self.rig.receive(now):
                self._send(replies)
            look = self.rig.next_look(GRAIN)
            if data := self._wait(PULSE if look is None else min(max(look - now, 0), PULSE)):
                self.rig.client_baud = self._baud()
                self.rig.send(data, time.monotonic() - started)
            elif look is None:
                self._keep_up(time.monotonic() - started)

    def _stay_away(self, stop: threading.Event, started: float) -> None:
        """Be no port, as the faults ask for, and then another one under the same name. Raises PortError."""
        self.__exit__()
        while self.rig.gone(time.monotonic() - started):
            if stop.wait(PULSE):
                return
        self.rig.receive(time.monotonic() - started)  # for nobody
        self.__enter__()

    def _keep_up(self, now: float) -> None:
        """While nothing is on the wire, let servos live up to now: who is asked next need not catch up first."""
        end = time.monotonic() + SPARE
        for servo in itertools.islice(self._turns, len(self.rig.servos)):
            servo.advance(now)
            if time.monotonic() > end:
                break

    @abstractmethod
    def _open(self, stack: ExitStack) -> None:
        """Open it; what must be undone goes on the stack. Sets `name`. Raises PortError."""

    @abstractmethod
    def _wait(self, timeout: float) -> bytes:
        """Wait for bytes of the client and give them; empty if none came or there is no client."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Give bytes to the client; they are lost if there is none, or if it does not read. Never waits."""

    @abstractmethod
    def _baud(self) -> float | None:
        """Give the speed that the client talks at; None if there is no such thing."""


class Terminal:
    """A pseudo terminal. It passes bytes at once; the speed that its client sets can be read."""

    name: str

    def __init__(self, baud: int, link: Path | None = None) -> None:
        self._link = link
        self._master = -1
        self._client = False
        """Whether somebody has the terminal open."""
        self._first_baud = baud
        self._last_baud: float = baud

    def _open(self, stack: ExitStack) -> None:
        if sys.platform == "win32":
            raise PortError("there are no pseudo terminals on Windows; use --tcp")
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise PortError(f"no pseudo terminal: {error.strerror or error}; use --tcp") from error
        self._client = False
        stack.callback(os.close, self._master)
        stack.callback(os.close, slave) if not _TELLS_LEAVING else None
        os.set_blocking(self._master, False)
        self._terminal = self.name = os.ttyname(slave)
        self._prepare(slave)
        if _TELLS_LEAVING:
            os.close(slave)
        if self._link is not None:
            stack.enter_context(claimed(self._link, self._terminal))
            self.name = str(self._link)

    def _wait(self, timeout: float) -> bytes:
        if not select.select([self._master], [], [], timeout)[0]:
            self._client = True  # without one, the terminal says so at once
            return b""
        try:
            data = os.read(self._master, CHUNK)
        except BlockingIOError:
            return b""  # the client took back what it had written (tcflush)
        except OSError as error:
            if error.errno != errno.EIO:
                raise PortError(f"{self.name}: {error.strerror or error}") from error
            data = b""
        if data:
            self._client = True
            return data
        if self._client:
            self._client = False
            self._forget_client()
        time.sleep(min(timeout, LOOKOUT))
        return b""

    def _send(self, data: bytes) -> None:
        if not self._client:
            return
        try:
            os.write(self._master, data)
        except BlockingIOError:
            pass  # the client reads nothing: a real port's buffer overruns too
        except OSError as error:
            if error.errno != errno.EIO:
                raise PortError(f"{self.name}: {error.strerror or error}") from error

    def _baud(self) -> float | None:
        baud = _terminal_baud(self._master)
        if baud:  # 0 means hang up
            self._last_baud = baud
        return self._last_baud

    def _forget_client(self) -> None:
        """Drop what this client did not read.

        Its settings stay, as on a real port. The next client may be there already: it has been sent
        nothing yet, but what it has sent or set must not be touched.
        """
        if sys.platform != "win32":
            slave = os.open(self._terminal, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(slave, termios.TCIFLUSH)
            finally:
                os.close(slave)

    def _prepare(self, slave: int) -> None:
        """Pass bytes as they are, at the factory speed for clients that set none."""
        if sys.platform != "win32":
            tty.setraw(slave)  # no echo, no line ends, no signals
            settings = termios.tcgetattr(slave)
            settings[4] = settings[5] = getattr(termios, f"B{self._first_baud}", settings[4])
            termios.tcsetattr(slave, termios.TCSANOW, settings)


class PtyPort(Terminal, Port):
    """Servos behind a pseudo terminal; the client's speed setting is read, and must be right."""

    def __init__(self, rig: Rig, link: Path | None = None) -> None:
        Port.__init__(self, rig)
        Terminal.__init__(self, rig.default_baud, link)


class TcpPort(Port):
    """A TCP port for one client at a time; another may come when it has gone, and until then is hung up on.

    Port 0 takes any free one.
    """

    def __init__(self, rig: Rig, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__(rig)
        self._address = host, port
        self._client: socket.socket | None = None

    def _open(self, stack: ExitStack) -> None:
        host, port = self._address
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._listener = stack.enter_context(socket.create_server((host, port), family=family, backlog=1))
        except (OSError, OverflowError) as error:
            raise PortError(f"cannot listen on {host} port {port}: {error}") from error
        stack.callback(self._leave)
        shown = f"[{host}]" if ":" in host else host
        self._address = host, self._listener.getsockname()[1]
        self.name = f"socket://{shown}:{self._address[1]}"

    def _wait(self, timeout: float) -> bytes:
        waiting = [self._listener] if self._client is None else [self._client, self._listener]
        ready = select.select(waiting, [], [], timeout)[0]
        if not ready:
            return b""
        if self._client is None:
            self._client, _ = self._listener.accept()
            self._client.setblocking(False)
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A client that lost its network must not keep others out for ever.
            self._client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            return b""
        if self._client not in ready:
            # What the present client has sent, its end too, comes before the next one is looked at.
            self._listener.accept()[0].close()
            return b""
        try:
            data = self._client.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def _send(self, data: bytes) -> None:
        if self._client is not None:
            try:
                self._client.send(data)
            except BlockingIOError:
                pass  # the client reads nothing: a real port's buffer overruns too
            except OSError:
                self._leave()

    def _baud(self) -> float | None:
        return None

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


def serve_pty(rig: Rig, link: Path | None, stop: threading.Event, ready: Callable[[str], None]) -> None:
    """Serve a rig behind a pseudo terminal until told to stop; `ready` is told its name. Raises PortError."""
    with PtyPort(rig, link) as port:
        ready(port.name)
        port.serve(stop)


def serve_tcp(rig: Rig, host: str, port: int, stop: threading.Event, ready: Callable[[str], None]) -> None:
    """Serve a rig behind a TCP port until told to stop; `ready` is told its name. Raises PortError."""
    with TcpPort(rig, host, port) as served:
        ready(served.name)
        served.serve(stop)


_TELLS_LEAVING = sys.platform == "linux"
"""Whether reading fails while no client has the terminal open, and the settings outlive the clients.

Elsewhere the terminal would go back to its cooked state with each client that leaves, so it is held open.
"""

_TCGETS2 = 0x802C542A
"""Linux ioctl (asm-generic/termbits.h): the settings with the speeds as plain numbers, any speed."""
_TERMIOS2_SIZE = 44


def _terminal_baud(terminal: int) -> float:
    """Read the speed set on a terminal; 0 if there is none."""
    if sys.platform == "win32":
        return 0.0
    if sys.platform == "linux":
        settings = bytearray(_TERMIOS2_SIZE)
        try:
            fcntl.ioctl(terminal, _TCGETS2, settings)
        except OSError:
            pass  # an architecture with another number: the standard speeds must do
        else:
            return float(int.from_bytes(settings[-4:], sys.byteorder))
    speed = termios.tcgetattr(terminal)[5]
    for name in dir(termios):
        if name[:1] == "B" and name[1:].isdigit() and getattr(termios, name) == speed:
            return float(name[1:])
    return 0.0
