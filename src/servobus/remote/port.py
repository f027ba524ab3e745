"""A port that another process owns, as a transport of this one: lines of messages instead of bytes of servos.

Whoever reads takes in what came and puts the answers where those look that wait for them, so it does not matter which
thread reads. A thread sends a sign of life again and again, and takes in what nobody waits for.
"""

import json
import os
import select
import socket
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from typing import Any

from servobus.errors import PortError, PortLost, UsageError
from servobus.remote.address import Address, token_of_environment
from servobus.remote.faults import error_of
from servobus.remote.messages import LONGEST, Malformed, decode, encode, text
from servobus.remote.protocol import Beat, Beaten, BusInfo, Failed, Hello, Refused, Supersede, Welcome
from servobus.remote.runtime import find_server, token_for
from servobus.transports.base import Transport

DEADMAN = 1.0
"""s after which a server takes a program for hung of which it hears nothing."""
CONNECT = 3.0
"""s within which a server must have answered the first words."""
SILENCE = 3.0
"""s after which a server is given up that answers not even a sign of life."""
LOOK = 0.25
"""s after which a wait for an answer looks whether the server is still there."""
STUCK = 1.0
"""s after which a connection is given up that takes no bytes."""
CHUNK = 65536
BEATS = 64
"""Signs of life whose answers tell the server's clock: the best of the last so many."""
FIRST_BAUD = 115_200
"""Speed of a bus until the first servo is spoken to, at its own."""


class RemotePort(Transport):
    """A bus of a server, as a port. Opening it asks no servo anything.

    address  where it is
    name     what the server tells people of this client; that of the program by default
    session  id of a session that this port belongs to; it has one of its own by default
    token    what lets it in; that of the environment, or of the runtime file of a server here, by default
    """

    remote = True

    def __init__(
        self, address: Address, *, name: str = "", session: str = "", deadman: float = DEADMAN, token: str = ""
    ) -> None:
        self.name = str(address)
        self.address = address
        self.baud = FIRST_BAUD
        self.about = BusInfo("", "", "", baud_elsewhere=False, open=False)
        self.quoted = ""
        """The name of the bus as it stands in a line."""
        self.welcome: Welcome
        """What the server said at first."""
        self._token = token
        self._hello = Hello("", name or _program(), "program", deadman, session)
        self._socket: socket.socket | None = None
        self._wait: Callable[[float], Any] = _nothing
        self._receiving, self._sending = threading.Lock(), threading.Lock()
        self._buffer = b""
        self._awaited: dict[int, Any] = {}
        """Number of a request -> its answer, or None as long as there is none."""
        self._numbers = count(1)
        self._heard = 0.0
        self._why = ""
        """Why the server has ended the connection, if it said so."""
        self._behind: deque[float] = deque(maxlen=BEATS)
        self._beats: threading.Event | None = None
        self.told: Callable[[Any], object] = _ignore
        """Gets what the server says without being asked, in whichever thread takes it in."""
        self._open()

    # The transport

    def write(self, data: bytes) -> None:
        with self._sending:
            self._push(data)

    def read(self, timeout: float) -> bytes:
        if self._socket is None:
            raise self._gone()
        if not self._wait(max(timeout, 0.0)):
            return b""
        with self._receiving:
            return self._receive()

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        if self._beats is not None:
            self._beats.set()
        own, self._socket = self._socket, None
        self._wait = _nothing
        if own is not None:
            with suppress(OSError):
                own.shutdown(socket.SHUT_RDWR)  # wakes a thread that reads
            own.close()

    def reopen(self) -> None:
        self.close()
        self._open()

    @property
    def lasting_name(self) -> str:
        return self.about.lasting_name

    def fileno(self) -> int | None:
        # On Windows a loop cannot watch it; a thread reads then.
        return None if sys.platform == "win32" or self._socket is None else self._socket.fileno()

    def ask(self, kind: Callable[..., Any], **fields: Any) -> Any:
        """Ask the server something beside the servos, and wait for the answer. Raises the error that comes instead.

        `kind` is a class of messages with a number `n`, `fields` its other fields.
        """
        n = self.request(lambda n: text(kind(n=n, **fields)))
        try:
            while (answer := self.take(n)) is None:
                self.read(LOOK)
        finally:
            self.forget(n)
        if isinstance(answer, Failed):
            raise error_of(answer.fault)
        return answer

    # For the link: requests and their answers

    def request(self, line: Callable[[int], str], check: Callable[[], None] = lambda: None) -> int:
        """Send a request, the line with a number; give that number. Its answer is kept from now on.

        `check` raises what keeps it from being sent, at the last moment: behind a stop nothing of before goes out.
        """
        with self._receiving:  # what nobody waits for is taken in elsewhere
            n = next(self._numbers)
            self._awaited[n] = None
        try:
            with self._sending:
                check()
                self._push(line(n).encode() + b"\n")
        except BaseException:
            self.forget(n)
            raise
        return n

    def take(self, n: int) -> Any:
        """Give the answer to a request if it has come, else None. Raises PortLost if the server is silent."""
        answer = self._awaited.get(n)
        if answer is not None:
            del self._awaited[n]
        elif time.monotonic() - self._heard > SILENCE:
            raise PortLost(f"{self.name}: the server answers no more; does it still run?")
        return answer

    def forget(self, n: int) -> None:
        """Wait for the answer to this request no more."""
        self._awaited.pop(n, None)

    def server_time(self) -> float:
        """Give the time of the server's clock, s; too late by the time that the way there takes, never too soon."""
        return time.monotonic() + min(self._behind, default=0.0)

    def supersede(self) -> None:
        """Have the server break off what is under way for this port."""
        with suppress(PortError):  # it ends by itself then
            self.write(encode(Supersede(self.about.name)))

    # The connection

    def _open(self) -> None:
        host, port, token = (self.address.host, self.address.port, self._token) if self._token else where(self.address)
        try:
            own = socket.create_connection((host, port), CONNECT)
        except OSError as error:
            reason = error.strerror or str(error)
            raise PortError(f"{self.name}: no server answers at {host}:{port} ({reason})") from error
        try:
            own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._buffer, self._why = b"", ""
            hello = self._hello
            own.sendall(encode(Hello(token, hello.name, hello.client, hello.deadman, hello.session)))
            self.welcome = self._welcomed(own)
            self.about = self._named(self.welcome.buses)
            own.setblocking(False)
        except BaseException:
            own.close()
            raise
        self.baud_elsewhere = self.about.baud_elsewhere
        self.quoted = json.dumps(self.about.name)
        self._socket, self._wait = own, _waiting_on(own)
        self._awaited.clear()
        self._numbers = count(1)
        self._heard = time.monotonic()
        self._behind.clear()
        self._behind.append(self.welcome.time - self._heard)
        self._beats = threading.Event()
        threading.Thread(
            target=_beat, args=(weakref.ref(self), self._beats, hello.deadman / 4), name="servobus beats", daemon=True
        ).start()

    def _welcomed(self, own: socket.socket) -> Welcome:
        """Give the server's answer to the first words. Raises PortError."""
        end = time.monotonic() + CONNECT
        while b"\n" not in self._buffer:
            try:
                own.settimeout(max(end - time.monotonic(), 0.001))
                chunk = own.recv(CHUNK)
            except OSError as error:
                raise PortError(f"{self.name}: what answers there is no server of servobus ({error})") from error
            if not chunk or len(self._buffer) > LONGEST:
                raise PortError(f"{self.name}: what answers there is no server of servobus")
            self._buffer += chunk
        line, _, self._buffer = self._buffer.partition(b"\n")
        try:
            said = decode(line)
        except Malformed as error:
            raise PortError(f"{self.name}: what answers there is no server of servobus ({error})") from error
        if isinstance(said, Refused):
            raise PortError(f"{self.name}: {said.why}")
        if not isinstance(said, Welcome):
            raise PortError(f"{self.name}: what answers there is no server of servobus")
        return said

    def _named(self, buses: tuple[BusInfo, ...]) -> BusInfo:
        names = ", ".join(bus.name for bus in buses) or "none"
        if not self.address.bus:
            if len(buses) != 1:
                raise UsageError(f"{self.name}: name one of the buses there: {names}")
            return buses[0]
        for bus in buses:
            if bus.name == self.address.bus:
                if not bus.open:
                    raise PortError(f"{self.name}: the port of that bus, {bus.port}, is gone")
                return bus
        raise PortError(f"{self.name}: no such bus there; there are: {names}")

    def _receive(self) -> bytes:
        """Take in what has come. The lock for it is held."""
        if self._socket is None:
            raise self._gone()
        try:
            chunk = self._socket.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error) from error
        if not chunk:
            raise self._gone()
        self._heard = time.monotonic()
        *lines, self._buffer = (self._buffer + chunk).split(b"\n")
        if len(self._buffer) > LONGEST:
            raise PortLost(f"{self.name}: the server sends a line without an end")
        for line in lines:
            self._sort(line)
        return chunk

    def _sort(self, line: bytes) -> None:
        try:
            said = decode(line)
        except Malformed as error:
            raise PortLost(f"{self.name}: the server says what is not understood here ({error})") from error
        if isinstance(said, Beaten):
            self._behind.append(said.server - said.time)
        elif isinstance(said, Refused):
            self._why = said.why
        elif (n := getattr(said, "n", None)) in self._awaited:
            self._awaited[n] = said
        else:
            self.told(said)

    def _push(self, data: bytes) -> None:
        own = self._socket
        if own is None:
            raise self._gone()
        deadline = time.monotonic() + STUCK
        while data:
            try:
                data = data[own.send(data) :]
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise PortLost(f"{self.name}: the server takes no more; does it still run?") from None
                select.select((), (own,), (), 0.1)
            except OSError as error:
                raise self._gone(error) from error

    def beat(self) -> None:
        """Give a sign of life, and take in what nobody waits for."""
        if not self._awaited and self._receiving.acquire(blocking=False):
            try:
                if not self._awaited:
                    self._receive()
            finally:
                self._receiving.release()
        self.write(encode(Beat(time.monotonic())))

    def _gone(self, error: Exception | None = None) -> PortError:
        if self._socket is None:
            return PortError(f"{self.name} is closed")
        if self._why:
            return PortLost(f"{self.name}: {self._why}")
        why = f" ({getattr(error, 'strerror', None) or error})" if error is not None else ""
        return PortLost(f"{self.name}: the server has ended the connection{why}; does it still run?")


def where(address: Address) -> tuple[str, int, str]:
    """Give host, port and token of the server at an address. Raises PortError if none of this user runs here."""
    if not address.host:
        server = find_server(address.bus)
        return server.host, server.port, server.token
    return address.host, address.port, token_of_environment() or token_for(address.host, address.port)


def _beat(port: "weakref.ref[RemotePort]", over: threading.Event, period: float) -> None:
    """Give signs of life for a port until it is closed or nobody has it any more."""
    while not over.wait(period or DEADMAN / 4):
        here = port()
        if here is None:
            return
        try:
            here.beat()
        except PortError:  # whoever uses the port is told
            return
        del here


def _waiting_on(own: socket.socket) -> Callable[[float], Any]:
    """Make the function that waits for bytes, s."""
    if hasattr(select, "epoll"):
        epoll = select.epoll()
        epoll.register(own.fileno(), select.EPOLLIN)
        return epoll.poll
    return lambda timeout: select.select((own,), (), (), timeout)[0]


def _ignore(_: Any) -> None:
    """Pass over what is of no use here."""


def _nothing(_: float) -> bool:
    """Stand in for waiting on a port that was closed: there is something to find out, at once."""
    return True


def _program() -> str:
    """Name this program as people know it."""
    name = os.path.basename(sys.argv[0] if sys.argv else "") or "python"  # noqa: PTH119 - no path is meant
    verb = f" {sys.argv[1]}" if name in ("servobus", "__main__.py") and len(sys.argv) > 1 else ""
    return f"{'servobus' if name == '__main__.py' else name}{verb} ({os.getpid()})"
