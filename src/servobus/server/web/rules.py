"""Which requests are let in, and what each needs: a list that ends with a refusal.

The first rule that fits counts. What no rule names is refused, so that a route that is added later is closed until
somebody has thought about it.
"""

import re
from dataclasses import dataclass

from servobus.server.web.auth import Role

SMALL, LARGE = 64 * 1024, 1024 * 1024
"""Bytes of a request: commands, and files such as backups."""
API = "/api/v1"
READS = ("GET", "HEAD")
CHANGES = ("POST", "PUT", "PATCH", "DELETE")
SOCKET = ("WEBSOCKET",)


@dataclass(frozen=True, slots=True)
class Rule:
    """What one kind of request needs.

    role    whom it is for; None for everybody, without a login
    size    bytes of its body at most
    fresh   whether it needs a login of the last minutes, where the server can be reached from other computers
    rated   whether it counts as a command
    """

    methods: tuple[str, ...]
    path: re.Pattern[str]
    role: Role | None
    size: int = SMALL
    fresh: bool = False
    rated: bool = True


def _rule(methods: tuple[str, ...], path: str, role: Role | None, **more: object) -> Rule:
    return Rule(methods, re.compile(path), role, **more)  # type: ignore[arg-type] # as Rule says


VIEWER, OPERATOR, ADMIN = Role

RULES = (
    # Whoever has logged in may stop, as often as he likes.
    _rule(("POST",), f"{API}/(buses/[^/]+/)?stop", VIEWER, rated=False),
    # Open: whether the server is there, and logging in.
    _rule(READS, f"{API}/health", None),
    _rule(("POST",), f"{API}/session", None),
    _rule(("DELETE",), f"{API}/session", VIEWER),
    # Giving access to others.
    _rule((*READS, *CHANGES), f"{API}/(tokens|links|sessions)(/.*)?", ADMIN, fresh=True),
    # Ports: whoever names one has this computer connect to what he likes.
    _rule(("POST",), f"{API}/buses", ADMIN),
    _rule(("DELETE",), f"{API}/buses/[^/]+", ADMIN),
    # What stays after power-off, and files.
    _rule(("POST",), f"{API}/buses/[^/]+/servos/[^/]+/(restore|restore/preview)", OPERATOR, size=LARGE, fresh=True),
    _rule(("POST",), f"{API}/buses/[^/]+/servos/[^/]+/(identity|reset)", OPERATOR, fresh=True),
    _rule(("POST",), f"{API}/robots/[^/]+/(apply|undo)", OPERATOR, fresh=True),
    # All else of the API.
    _rule(READS, f"{API}/.*", VIEWER),
    _rule(CHANGES, f"{API}/.*", OPERATOR),
    _rule(SOCKET, f"{API}/live", VIEWER),
    # Pages: what a button does is judged where it is done, for all of them come through one socket.
    _rule(READS, r"/(?!api/).*", VIEWER, rated=False),
    _rule(("POST",), r"/_nicegui_ws/socket\.io/", VIEWER, rated=False),
    _rule(("POST",), r"/_nicegui/client/[^/]+/upload/.*", OPERATOR, size=LARGE),
    _rule(SOCKET, r"/_nicegui_ws/socket\.io/", VIEWER),
)


def rule_for(method: str, path: str) -> Rule | None:
    """Give the rule for a request; None if nothing allows it."""
    return next((rule for rule in RULES if method in rule.methods and rule.path.fullmatch(path)), None)


def is_known(path: str) -> bool:
    """Tell whether there is a rule for a path at all."""
    return any(rule.path.fullmatch(path) for rule in RULES)
