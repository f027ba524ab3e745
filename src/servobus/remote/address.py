"""Where a bus is that another process owns.

It is written `servobus://HOST:PORT/NAME`, or `servobus:///NAME` for a server of this user on this computer.
"""

import os
import re
from typing import Self

from servobus.core.values import frozen
from servobus.errors import UsageError

SCHEME = "servobus://"
TOKEN = "SERVOBUS_TOKEN"  # noqa: S105 - the name of a variable
"""Variable of the environment with the token for servers of others."""


@frozen
class Address:
    """An address as it is written. `host` is empty for a server of this user, `bus` for the only bus of a server."""

    host: str
    port: int
    bus: str

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{SCHEME}{f'{host}:{self.port}' if host else ''}/{self.bus}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address. Raises UsageError."""
        match = re.fullmatch(r"servobus://(?:(\[[0-9A-Fa-f:.]+\]|[^/:?#\[\]]+):([0-9]{1,5}))?(?:/([^/?#]*))?", text)
        if match is None or (match[2] and not 0 < int(match[2]) < 1 << 16):
            raise UsageError(f"{text}: write {SCHEME}HOST:PORT/NAME, or {SCHEME}/NAME for a server of yours here")
        return cls((match[1] or "").strip("[]"), int(match[2] or 0), match[3] or "")


def token_of_environment() -> str:
    """Give the token for a server of another user or another computer; empty if none was given."""
    return os.environ.get(TOKEN, "")
