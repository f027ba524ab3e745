"""Who has logged in, and with which rights.

There are three ways in:

    start token   stands in the link that is printed at the start. It is exchanged once, for a session of a browser
    password      where one is set: the same session
    bearer token  a program's, in the header `Authorization: Bearer TOKEN`; each has a name and a role

Each gives a `Login`. Its end (log-out, 12 h, a token that is taken back) reaches the sockets that it has opened.
Secrets are kept as SHA-256 hashes and compared in constant time; tokens have 256 random bits, so a plain hash does. No
secret stands in an error, a log line or the text of an object.
"""

import asyncio
import base64
import hashlib
import ipaddress
import json
import math
import os
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from enum import IntEnum
from hmac import compare_digest
from pathlib import Path
from typing import Any

from servobus.errors import UnknownName, UsageError

SESSION_TIME = 12 * 3600.0
"""s after which a browser logs in again."""
FRESH = 300.0
"""s after a login in which settings can be changed where the server can be reached from other computers."""
LINK_TIME = 600.0
"""s for which a link that was made later than at the start is good."""
MOST_SESSIONS, MOST_LINKS, MOST_TOKENS = 64, 16, 64
"""Bounds against a program that logs in again and again; of sessions and links the oldest make room."""
TRIES, LOCKED = 10, 60.0
"""Wrong secrets of one peer within this time, s, after which no other is looked at for as long."""
MOST_PEERS = 1024
SCRYPT = {"n": 2**14, "r": 8, "p": 5}
"""Cost of a password; source: OWASP Password Storage Cheat Sheet, scrypt, the choice with 16 MiB."""
MOST_PASSWORD = 1024
"""Bytes of a password at most."""


class Role(IntEnum):
    """What a login may do; each role may do what those before it may."""

    VIEWER = 1
    """See everything, and stop."""
    OPERATOR = 2
    """Move servos and change their settings."""
    ADMIN = 3
    """Give others access."""

    @classmethod
    def named(cls, name: str) -> "Role":
        """Give the role of this name. Raises UsageError."""
        try:
            return cls[name.upper()]
        except KeyError:
            raise UsageError(f"{name[:40]!r} is no role: it is viewer, operator or admin") from None

    def __str__(self) -> str:
        return self.name.lower()


class LoginRefused(Exception):
    """A secret is wrong, was used already, or is not looked at now: `wait` says for how many seconds."""

    def __init__(self, message: str, wait: float = 0.0) -> None:
        super().__init__(message)
        self.wait = wait


class Login:
    """Someone who has logged in.

    name   for people and for the audit log
    kind   "browser" or "program"
    id     tells logins apart; it is no secret
    began  when the secret was shown last, by the clock of the `Authority`
    ends   when it ends by itself
    """

    def __init__(self, name: str, role: Role, kind: str, *, began: float, ends: float = math.inf) -> None:
        self.name, self.role, self.kind, self.began, self.ends = name, role, kind, began, ends
        self.id = secrets.token_hex(8)
        self.ended = ""
        """Why it has ended; "" as long as it has not."""
        self._watchers: list[Callable[[str], None]] = []

    def __repr__(self) -> str:
        return f"<Login {self.name}: {self.role}>"

    def end(self, why: str) -> None:
        """End it, and tell whoever asked to be told."""
        if not self.ended:
            self.ended = why
            for tell in self._watchers.copy():
                tell(why)

    def watch(self, tell: Callable[[str], None]) -> Callable[[], None]:
        """Have `tell` called with the reason when it ends; what is given takes that back."""
        self._watchers.append(tell)
        return lambda: self._watchers.remove(tell) if tell in self._watchers else None

    def entry(self) -> dict[str, Any]:
        """Give it for JSON."""
        return {"id": self.id, "name": self.name, "role": str(self.role), "kind": self.kind}


class LockOut:
    """Looks at no more secrets of a peer for a while that has shown too many wrong ones.

    It guards passwords. What has logged in already goes on, and so do right tokens, which nobody can guess: nobody
    else on the same computer can lock a user out.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._wrong: OrderedDict[str, list[float]] = OrderedDict()

    def wait(self, peer: str) -> float:
        """Give the seconds until secrets of a peer are looked at again; 0 if they are."""
        times = self._wrong.get(_network(peer), [])
        return max(0.0, times[-1] + LOCKED - self._now()) if len(times) >= TRIES else 0.0

    def failed(self, peer: str) -> None:
        """Take note of a wrong secret."""
        now, network = self._now(), _network(peer)
        lately = [at for at in self._wrong.pop(network, []) if now - at < LOCKED]
        self._wrong[network] = [*lately, now][-TRIES:]
        while len(self._wrong) > MOST_PEERS:
            self._wrong.popitem(last=False)


def _network(peer: str) -> str:
    """Give what stands for a peer: an address, of IPv6 the network of 64 bits that one computer has to itself."""
    try:
        address = ipaddress.ip_address(peer.partition("%")[0])
    except ValueError:
        return peer
    return str(address) if address.version == 4 else str(ipaddress.ip_network((address, 64), strict=False))


class Authority:
    """Logs in, and knows who is. Sessions end with the process: a restart logs browsers out.

    start_token    the one that the link at the start has; None for no such link
    local_token    that of programs of the same user on the same computer, with the role admin
    password       as `hash_password` gives it; None for no password
    tokens_file    where named tokens are kept, hashed; None for none that last
    now            s that never go back
    """

    def __init__(
        self,
        *,
        start_token: str | None = None,
        local_token: str | None = None,
        password: str | None = None,
        tokens_file: Path | None = None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.now = now
        self._password = password
        self._file = tokens_file
        self._sessions: OrderedDict[str, Login] = OrderedDict()
        self._links: OrderedDict[str, tuple[Role, float]] = OrderedDict()
        self._tokens: dict[str, Login] = {}
        self._local: dict[str, Login] = {}
        self._lock_out = LockOut(now)
        self._hashing = asyncio.Semaphore(1)
        if start_token:
            self._links[_hash(start_token)] = Role.ADMIN, math.inf
        if local_token:
            self._local[_hash(local_token)] = Login("local", Role.ADMIN, "program", began=now())
        for name, (role, hashed) in _read_tokens(tokens_file).items():
            self._tokens[hashed] = Login(name, role, "program", began=now())

    @property
    def has_password(self) -> bool:
        return self._password is not None

    # Who is it?

    def by_cookie(self, secret: str) -> Login | None:
        """Give the session of a browser; None if there is none, or none any more."""
        login = _found(self._sessions, secret)
        if login is not None and self.now() >= login.ends:
            self._end_session(login, "the session has ended: log in again")
            return None
        return login

    def by_bearer(self, secret: str, peer: str) -> Login:
        """Give the login of a program's token. Raises LoginRefused."""
        login = _found(self._local, secret) or _found(self._tokens, secret)
        if login is None:
            wait = self._lock_out.wait(peer)
            self._lock_out.failed(peer)
            raise LoginRefused("this token is not known here: it is wrong, or was taken back", wait)
        return login

    # Logging in

    async def exchange(self, token: str, peer: str) -> tuple[str, Login]:
        """Log a browser in by the token of a link, once: the secret of its cookie, and the login.

        Raises LoginRefused.
        """
        self._check_wait(peer)
        hashed = _hash(token)
        link = self._links.get(hashed)
        if link is None or self.now() >= link[1]:
            self._lock_out.failed(peer)
            raise LoginRefused("this link was used already, is too old, or is not one of this server")
        del self._links[hashed]
        return self._begin("browser", link[0])

    async def log_in(self, password: str, peer: str) -> tuple[str, Login]:
        """Log a browser in by the password. Raises LoginRefused."""
        self._check_wait(peer)
        async with self._hashing:  # one at a time, so that those who wait are refused once a peer is locked out
            self._check_wait(peer)
            if self._password is None:
                raise LoginRefused("no password is set for this server: use the link that it printed")
            if not await asyncio.to_thread(check_password, password, self._password):
                self._lock_out.failed(peer)
                raise LoginRefused("this password is wrong")
        return self._begin("browser", Role.ADMIN)

    def log_out(self, login: Login) -> None:
        """End a session at once, with the sockets that it has opened."""
        self._end_session(login, "logged out")

    def make_link(self, role: Role) -> str:
        """Make a token for a link that logs one browser in, within LINK_TIME."""
        token = secrets.token_urlsafe(32)
        while len(self._links) >= MOST_LINKS:
            self._links.popitem(last=False)
        self._links[_hash(token)] = role, self.now() + LINK_TIME
        return token

    # Sessions and tokens for who may give access

    def sessions(self) -> list[Login]:
        """List the browsers that are logged in."""
        for login in [one for one in self._sessions.values() if self.now() >= one.ends]:
            self._end_session(login, "the session has ended: log in again")
        return list(self._sessions.values())

    def end_session(self, id: str) -> None:
        """End the session with this id. Raises UnknownName."""
        for login in self.sessions():
            if login.id == id:
                self._end_session(login, "this session was ended by another login")
                return
        raise UnknownName(f"no session {id[:40]!r} is open")

    def tokens(self) -> list[Login]:
        """List the named tokens; the tokens themselves are known to nobody but those who have them."""
        return list(self._tokens.values())

    def make_token(self, name: str, role: Role) -> str:
        """Make a token for a program. Raises UsageError if the name is taken, or if there are too many."""
        if any(login.name == name for login in [*self._tokens.values(), *self._local.values()]):
            raise UsageError(f"there is a token {name!r} already: take it back first, or choose another name")
        if len(self._tokens) >= MOST_TOKENS:
            raise UsageError(f"there are {MOST_TOKENS} tokens already: take one back first")
        token = secrets.token_urlsafe(32)
        self._tokens[_hash(token)] = Login(name, role, "program", began=self.now())
        self._keep_tokens()
        return token

    def drop_token(self, name: str) -> None:
        """Take a token back, with the sockets that were opened by it. Raises UnknownName."""
        for hashed, login in self._tokens.items():
            if login.name == name:
                del self._tokens[hashed]
                self._keep_tokens()
                login.end(f"the token {name!r} was taken back")
                return
        raise UnknownName(f"there is no token {name[:40]!r}")

    # Helpers

    def _check_wait(self, peer: str) -> None:
        if wait := self._lock_out.wait(peer):
            raise LoginRefused(f"too many wrong logins: none is looked at for {math.ceil(wait)} s", wait)

    def _begin(self, name: str, role: Role) -> tuple[str, Login]:
        now = self.now()
        while len(self._sessions) >= MOST_SESSIONS:
            self._end_session(next(iter(self._sessions.values())), "too many sessions: this was the oldest")
        secret = secrets.token_urlsafe(32)
        login = Login(name, role, "browser", began=now, ends=now + SESSION_TIME)
        login.name = f"{name} {login.id[:4]}"
        self._sessions[_hash(secret)] = login
        return secret, login

    def _end_session(self, login: Login, why: str) -> None:
        for hashed in [hashed for hashed, one in self._sessions.items() if one is login]:
            del self._sessions[hashed]
        login.end(why)

    def _keep_tokens(self) -> None:
        if self._file is None:
            return
        data = {one.name: {"role": str(one.role), "sha256": hashed} for hashed, one in self._tokens.items()}
        write_private(self._file, json.dumps(data, indent=2) + "\n")


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()


def _found(known: dict[str, Login] | OrderedDict[str, Login], secret: str) -> Login | None:
    """Find by the hash: how long that takes tells nothing of the secret."""
    hashed, login = _hash(secret), None
    for one, meant in known.items():
        if compare_digest(one, hashed):
            login = meant
    return login


def _read_tokens(path: Path | None) -> dict[str, tuple[Role, str]]:
    """Read the named tokens. Raises UsageError for a file that is damaged, or that others may read."""
    if path is None:
        return {}
    try:
        text = path.read_text(encoding="utf-8")
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise UsageError(f"{path}: others may read this file of tokens; chmod 600 {path}")
        return {name: (Role.named(entry["role"]), str(entry["sha256"])) for name, entry in json.loads(text).items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{path}: this is no file of tokens ({type(error).__name__}); remove it") from None


def write_private(path: Path, text: str) -> None:
    """Write a file that only its owner may read, in one step."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}.new")
    handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    new.replace(path)


# Passwords


def hash_password(password: str) -> str:
    """Give what is kept of a password: the cost, the salt and the scrypt hash. Raises UsageError for none at all."""
    data = password.encode("utf-8", "surrogatepass")
    if not 8 <= len(data) <= MOST_PASSWORD:
        raise UsageError(f"a password has 8 to {MOST_PASSWORD} bytes, this one has {len(data)}")
    salt = os.urandom(16)
    hashed = hashlib.scrypt(data, salt=salt, **SCRYPT)
    cost = ":".join(str(SCRYPT[name]) for name in ("n", "r", "p"))
    return f"scrypt:{cost}:{_text(salt)}:{_text(hashed)}"


def check_password(password: str, kept: str) -> bool:
    """Tell whether a password is the one of which this was kept. Takes about 0.1 s."""
    data = password.encode("utf-8", "surrogatepass")
    if len(data) > MOST_PASSWORD:
        return False
    _, n, r, p, salt, hashed = kept.split(":")
    given = hashlib.scrypt(data, salt=base64.b64decode(salt), n=int(n), r=int(r), p=int(p))
    return compare_digest(given, base64.b64decode(hashed))


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()
