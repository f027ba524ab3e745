"""What is said between the process that owns the ports and its clients, up to the steps of procedures.

A client says `Hello` first, and is answered with `Welcome`, or with `Refused` and the end of the connection. What asks
for something has a number `n`, which grows from request to request on a connection; the answer has the same, or is a
`Failed`. Times are those of the server's clock, s.

Several connections may belong to one session: those that give its id in their `Hello`, with the same token. Leases and
the deadman are a session's; the connection that began the session feeds the deadman, and ends the session by its end.
"""

from typing import Any

from servobus.core.values import frozen
from servobus.remote.faults import Fault
from servobus.remote.messages import VERSION, decode, message
from servobus.remote.steps import Outcome, SentExchange, SentLateness, SentStep

KINDS_OF_CLIENTS = ("program", "page", "api", "web")
FEW = 2000
"""Bytes of a step that is worth keeping."""
ROLES = ("viewer", "operator", "admin")
"""What a session may do, each all that those before it may: look; move and set servos; open ports and the like."""


@message("hello")
@frozen
class Hello:
    """The first words of a client.

    token     what the server gave to those that may use it
    name      what people know the client by
    client    what it is: one of KINDS_OF_CLIENTS
    deadman   s after which the session is taken for hung if nothing is heard of it; 0 if nothing hangs on that
    session   id of the session that this connection belongs to; empty for a session of its own
    """

    token: str
    name: str
    client: str
    deadman: float
    session: str = ""
    version: int = VERSION


@frozen
class BusInfo:
    """A bus of the server.

    name            what clients call it
    port            what the server has opened
    lasting_name    name under which its servos are remembered
    baud_elsewhere  see `Transport.baud_elsewhere`
    open            whether its port is there
    """

    name: str
    port: str
    lasting_name: str
    baud_elsewhere: bool
    open: bool


@message("welcome")
@frozen
class Welcome:
    """The answer to a `Hello` that was accepted. `time` is that of the server's clock."""

    session: str
    role: str
    time: float
    buses: tuple[BusInfo, ...]
    version: int = VERSION


@message("refused")
@frozen
class Refused:
    """Why the connection ends now."""

    why: str


@message("beat")
@frozen
class Beat:
    """A sign of life of a client; `time` is that of the client's clock."""

    time: float


@message("beaten")
@frozen
class Beaten:
    """The answer to a `Beat`: its time again, and that of the server's clock."""

    time: float
    server: float


@message("step")
@frozen
class SentRequest:
    """Carry out one step on a bus.

    baud      speed on the line, bit/s
    priority  how urgent it is where several want the line; see `Priority`
    hold      0, or the number of the procedure that this is a step of: the line stays with it until it is released.
              These numbers grow; one that was released, or had the line for too long without a step, is over
    time      when it was asked for, by the client's idea of the server's clock
    """

    n: int
    bus: str
    baud: int
    priority: int
    hold: int
    time: float
    step: SentStep


class RequestReader:
    """Reads lines. The step of a `SentRequest`, which most programs send again and again, is made once."""

    MANY = 1000

    def __init__(self) -> None:
        self._steps: dict[bytes, SentStep] = {}
        """The text of a step -> the step."""

    def read(self, line: bytes) -> Any:
        """Give the message of a line. Raises Malformed."""
        head, found, rest = line.partition(b',"step":')
        if not found or not head.startswith(b'{"k":"step",'):
            return decode(line)
        step = self._steps.get(rest)
        if step is not None:
            # Quotes inside of a text are escaped, so what was found is a key; one further inside leaves no JSON here.
            return decode(head + b"}", step=step)
        request = decode(line)
        if len(self._steps) > self.MANY:
            self._steps.clear()
        if isinstance(request.step, SentExchange) and len(rest) < FEW:
            self._steps[rest] = request.step
        return request


@message("release")
@frozen
class Release:
    """End the hold that a procedure has on the line of a bus."""

    bus: str


@message("supersede")
@frozen
class Supersede:
    """Break off what this connection has under way on a bus, and end its hold."""

    bus: str


@frozen
class Counted:
    """What counters of a servo have grown by; see `Counts`. `worst` is their worst, s."""

    family: str
    id: int
    grown: tuple[int, ...]
    worst: float


@message("answer")
@frozen
class Answer:
    """What came of a step.

    outcomes  of an exchange one; of a group those of its parts; of a batch those of the exchanges that were sent
    counts    of servos for which more happened than one request and, where one is due, one reply
    echo      whether the adapter gives back what it sends, if that was not known before
    """

    n: int
    outcomes: tuple[Outcome, ...] = ()
    counts: tuple[Counted, ...] = ()
    lateness: SentLateness | None = None
    echo: bool | None = None


@message("failed")
@frozen
class Failed:
    """Why a request came to nothing. `n` is 0 where it could not be told which."""

    n: int
    fault: Fault
    counts: tuple[Counted, ...] = ()
