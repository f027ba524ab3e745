"""What a link asks a driver to do between two looks at the line: wait for bytes, or let time pass."""

from collections.abc import Generator
from typing import TypeAlias, TypeVar

from servobus.core.values import frozen

T = TypeVar("T")


@frozen
class Receive:
    """Wait up to this many seconds for bytes; the generator is sent what came."""

    seconds: float


@frozen
class Rest:
    """Let this many seconds pass. `shared` lets others use the line meanwhile."""

    seconds: float
    shared: bool = False


Waits: TypeAlias = Generator[Receive | Rest, bytes, T]
