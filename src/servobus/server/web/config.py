"""What the web process is told at its start: one line of JSON on its standard input, which no other user can read."""

import ipaddress
import json
import re
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from servobus.errors import UsageError

WARNING = (
    "This server can be reached from other computers without encryption or a password: "
    "whoever reads along on the network can move the servos."
)


@dataclass(frozen=True, slots=True)
class WebConfig:
    """Where the web process listens, whom it lets in, and what it serves.

    host, port    the address; port 0 takes a free one
    names         further names under which browsers reach it, such as "robot.local"
    start_token   the token of the link that is printed
    local_token   the token of programs of the same user
    password      as `auth.hash_password` gives it
    tokens_file   where named tokens are kept
    certificate, key   files for TLS
    exposed       whether it may be reached from other computers without TLS and a password; pages show a warning
    read_only     whether nobody may move or change anything; stopping works
    owner, owner_token   address of the process that owns the ports, and what lets this one in; without them the ports
                  of `buses` are opened here
    buses         name -> port
    robots        name -> robot file, whose ports are buses of the same names
    recordings    folder of recordings
    audit         file to which it is written who changed what
    """

    host: str = "127.0.0.1"
    port: int = 7380
    names: tuple[str, ...] = ()
    start_token: str | None = field(default=None, repr=False)
    local_token: str | None = field(default=None, repr=False)
    password: str | None = field(default=None, repr=False)
    tokens_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    exposed: bool = False
    read_only: bool = False
    owner: tuple[str, int] | None = None
    owner_token: str = field(default="", repr=False)
    buses: dict[str, str] = field(default_factory=dict)
    robots: dict[str, str] = field(default_factory=dict)
    recordings: Path | None = None
    audit: Path | None = None

    @property
    def loopback(self) -> bool:
        """Whether only programs of this computer reach it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def tls(self) -> bool:
        return self.certificate is not None

    @property
    def scheme(self) -> str:
        return "https" if self.tls else "http"

    @property
    def warning(self) -> str:
        """What pages must show; empty where nothing is the matter."""
        return "" if self.loopback or (self.tls and self.password) else WARNING

    def check(self) -> None:
        """Raise UsageError for an address that would be open to others, unless that is said."""
        if (self.certificate is None) is not (self.key is None):
            raise UsageError("TLS needs both, a certificate and its key")
        if self.warning and not self.exposed:
            raise UsageError(
                f"{self.host} can be reached from other computers: that needs a certificate with its key and a "
                "password, or the flag `exposed`, which gives the servos to whoever reads along on the network"
            )

    def goes_by(self, host: str, port: int) -> bool:
        """Tell whether the header Host names this server, where it listens at this port.

        Where it can be reached from other computers any address of digits will do: what a foreign page can make lead
        here is a name of its own.
        """
        usual = {"http": 80, "https": 443}[self.scheme]
        name, _, number = host.rpartition(":") if re.search(r":\d+$", host) else (host, ":", f"{usual}")
        if number != f"{port}":
            return False
        if name in {"127.0.0.1", "localhost", "[::1]", self.host, *(known.lower() for known in self.names)}:
            return True
        return not self.loopback and _is_address(name)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


_PATHS = ("tokens_file", "certificate", "key", "recordings", "audit")


def parse(line: str) -> WebConfig:
    """Read what the web process is told. Raises UsageError, which repeats no value: some are secret."""
    try:
        data = json.loads(line)
    except ValueError:
        data = None
    if not isinstance(data, dict):
        raise UsageError("the web process is told what to serve by one line of JSON on its standard input, an object")
    known = {one.name for one in fields(WebConfig)}
    if unknown := sorted(set(data) - known):
        raise UsageError(f"the web process is told things that it does not know: {', '.join(unknown)}")
    values: dict[str, Any] = dict(data)
    for name in _PATHS:
        if values.get(name) is not None:
            values[name] = Path(str(values[name]))
    if "names" in values:
        values["names"] = tuple(map(str, values["names"]))
    if values.get("owner") is not None:
        host, port = values["owner"]
        values["owner"] = str(host), int(port)
    config = WebConfig(**values)
    config.check()
    return config
