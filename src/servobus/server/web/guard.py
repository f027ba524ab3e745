"""The guard: stands around the whole application, HTTP and WebSocket, and lets in what may come in.

    Host            421 for a name that is not ours: a foreign page that points its own name at this computer
    origin          403 for a request that another page has sent, a page on another port of this computer too
    login           401 without one: a cookie of this server, or a bearer token
    role            403 for more than the login may do
    size            413 for a body beyond its bound, without reading it all
    rate            429 for more commands a second than anybody needs

Cookies do not tell the ports of a computer apart, so that the origin has to be compared with its port. A program
has no origin; it shows a bearer token, which no page of a browser can send by itself.

The guard writes nothing to any log: addresses may hold the token of a link.
"""

import asyncio
import json
import secrets
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from servobus.server.web import entrance
from servobus.server.web.auth import FRESH, Authority, Login, LoginRefused, Role
from servobus.server.web.headers import protected, with_nonces
from servobus.server.web.rates import Rates
from servobus.server.web.rules import SMALL, Rule, is_known, rule_for

Headers: TypeAlias = dict[bytes, bytes]

BODY_TIME = 10.0
"""s within which the body of a request must have come."""
REVOKED = 4401
"""Code with which a socket is closed whose login has ended."""
FORWARDED = (b"forwarded", b"x-forwarded-for", b"x-forwarded-host", b"x-forwarded-proto", b"x-forwarded-prefix")
"""Headers that anybody can send, and that are believed by nobody here."""


class Refusal(Exception):
    """A request is not let in: the status, the kind of error, and the sentence."""

    def __init__(self, status: int, kind: str, message: str, remedy: str = "", **headers: str) -> None:
        super().__init__(message)
        self.status, self.kind, self.message, self.remedy, self.headers = status, kind, message, remedy, headers

    def body(self) -> bytes:
        error = {"type": self.kind, "message": self.message} | ({"remedy": self.remedy} if self.remedy else {})
        return json.dumps({"error": error}).encode()


class Guard:
    """An ASGI application around another one.

    is_ours       tells whether the header Host names this server
    scheme        "http" or "https"
    cookie        name of the cookie; cookies do not tell ports apart, so it has the port in it
    local         whether only programs of this computer reach the server: then no login has to be a fresh one
    read_only     whether everybody is a viewer
    """

    def __init__(
        self,
        app: ASGIApp,
        authority: Authority,
        *,
        is_ours: Callable[[str], bool],
        scheme: str,
        cookie: str,
        local: bool = True,
        read_only: bool = False,
    ) -> None:
        self._app, self._authority, self._is_ours = app, authority, is_ours
        self._scheme, self._cookie, self._local, self._read_only = scheme, cookie, local, read_only
        self._rates = Rates(authority)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._socket(scope, receive, send)
        elif scope["type"] == "http":
            await self._http(scope, receive, send)

    # HTTP

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        nonce = secrets.token_urlsafe(16)
        guarded = protected(send, nonce, scope["path"])
        headers: Headers = dict(scope["headers"])
        try:
            login, rule = self._let_in(scope, headers, scope["method"])
            body = await _body(headers, receive, rule.size)
        except Refusal as refusal:
            if refusal.status == 401 and entrance.is_page(scope["method"], scope["path"], headers):
                await entrance.answer(guarded, nonce, has_password=self._authority.has_password)
            else:
                await _refuse(guarded, refusal)
            return
        if login is not None and entrance.has_token(scope):  # it is in already: away with the token
            await entrance.move_on(guarded, scope["path"])
            return
        await self._app(self._cleaned(scope, login, nonce), _replayed(body, receive), with_nonces(guarded, nonce))

    # WebSocket

    async def _socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            login, _ = self._let_in(scope, dict(scope["headers"]), "WEBSOCKET")
        except Refusal as refusal:
            await _refuse_socket(scope, receive, send, refusal)
            return
        assert login is not None  # no socket is open to everybody
        ended = asyncio.Event()
        forget = login.watch(lambda _: ended.set())
        timer = _end_at(login, self._authority)
        inner = _Ending(receive, send, login, ended)
        try:
            await self._app(self._cleaned(scope, login, ""), inner.receive, inner.send)
        finally:
            forget()
            inner.close()
            if timer is not None:
                timer.cancel()

    # The questions, in their order

    def _let_in(self, scope: Scope, headers: Headers, method: str) -> tuple[Login | None, Rule]:
        """Ask everything but the size. Raises Refusal."""
        host = self._check_host(scope)
        rule = rule_for(method, scope["path"])
        self._check_origin(scope, headers, host, method)
        login = self._login(scope, headers)
        if rule is None:
            if login is None:
                raise _no_login()
            status, kind = (405, "NotAllowed") if is_known(scope["path"]) else (404, "NotFound")
            raise Refusal(status, kind, f"{method} is not possible here")
        if rule.role is None:
            return login, rule
        if login is None:
            raise _no_login()
        if self._role(login) < rule.role:
            why = "this server is read-only" if login.role >= rule.role else f"{login.name} is {login.role}"
            raise Refusal(403, "RoleTooLow", f"this needs the role {rule.role}, and {why}")
        if rule.fresh and not self._local and login.kind == "browser" and self._authority.now() > login.began + FRESH:
            raise Refusal(
                401,
                "LoginTooOld",
                f"this needs a login of the last {FRESH / 60:.0f} min",
                "log in again, then repeat it",
            )
        if rule.rated and (wait := self._rates.take(login, changes=method not in ("GET", "HEAD"))):
            raise Refusal(429, "TooMany", f"too many requests a second of {login.name}", **{"retry-after": f"{wait}"})
        return login, rule

    def _check_host(self, scope: Scope) -> str:
        """Give the value of the only header Host."""
        given = [value for name, value in scope["headers"] if name == b"host"]
        host = given[0].decode("latin-1").lower() if len(given) == 1 else ""
        if not self._is_ours(host):
            raise Refusal(421, "WrongHost", "this server does not go by that name", "use the address that it printed")
        return host

    def _check_origin(self, scope: Scope, headers: Headers, host: str, method: str) -> None:
        """Refuse what another page has sent, and what a browser sends without saying which page it comes from."""
        given = [value.decode("latin-1") for name, value in scope["headers"] if name == b"origin"]
        ours = f"{self._scheme}://{host}"
        reads = method in ("GET", "HEAD")
        if given and given != [ours]:
            raise Refusal(403, "WrongOrigin", "another page has sent this request")
        site = headers.get(b"sec-fetch-site", b"none")
        if site not in (b"same-origin", b"none"):
            # A link on another page may lead here: to a page, and as one, in a tab of its own.
            goes_to = (headers.get(b"sec-fetch-mode"), headers.get(b"sec-fetch-dest"))
            if not (
                method == "GET" and goes_to == (b"navigate", b"document") and not scope["path"].startswith("/api/")
            ):
                raise Refusal(403, "WrongOrigin", "another page has sent this request")
        if not given and not reads and b"authorization" not in headers and b"cookie" in headers:
            raise Refusal(403, "WrongOrigin", "a request with a cookie must say which page it comes from")

    def _login(self, scope: Scope, headers: Headers) -> Login | None:
        """Give the login of a request. Raises Refusal for a bearer token that is wrong."""
        peer = scope["client"][0] if scope.get("client") else ""
        if (authorization := headers.get(b"authorization")) is not None:
            kind, _, token = authorization.decode("latin-1").partition(" ")
            if kind.lower() != "bearer" or not token.strip():
                raise _no_login()
            try:
                return self._authority.by_bearer(token.strip(), peer)
            except LoginRefused as error:
                if error.wait:
                    raise Refusal(
                        429, "TooMany", "too many wrong tokens", **{"retry-after": f"{error.wait:.0f}"}
                    ) from None
                raise Refusal(401, "NoLogin", str(error), **_BEARER) from None
        found = map(self._authority.by_cookie, _cookies(scope, self._cookie))
        return next((login for login in found if login is not None), None)

    def _role(self, login: Login) -> Role:
        return Role.VIEWER if self._read_only else login.role

    def _cleaned(self, scope: Scope, login: Login | None, nonce: str) -> Scope:
        """Give the scope for the application: who asks in it, and no header that claims another sender."""
        dropped = {*FORWARDED, b"authorization"}
        if nonce and scope["method"] == "GET" and not scope["path"].startswith("/_nicegui/"):
            dropped.add(b"accept-encoding")  # into a page the nonce has to be written
        headers = [(name, value) for name, value in scope["headers"] if name not in dropped]
        who = {"login": login, "role": None if login is None else self._role(login), "nonce": nonce}
        return {**scope, "headers": headers, "state": {**scope.get("state", {}), **who}}


_BEARER = {"www-authenticate": "Bearer"}


def _no_login() -> Refusal:
    remedy = "send `Authorization: Bearer TOKEN`, or open the link that `servobus serve` printed"
    return Refusal(401, "NoLogin", "nobody has logged in", remedy, **_BEARER)


def _cookies(scope: Scope, name: str) -> Iterator[str]:
    """Give the values of a cookie: other programs of this computer can set one of the same name, and odd ones."""
    for header, value in scope["headers"]:
        if header == b"cookie":
            for part in value.decode("latin-1").split(";"):
                found, _, secret = part.strip().partition("=")
                if found == name:
                    yield secret


# Bodies


async def _body(headers: Headers, receive: Receive, most: int) -> bytes:
    """Read a body up to its bound. Raises Refusal for a longer one, most often before a byte of it was read."""
    too_large = Refusal(413, "TooLarge", f"the body is longer than {most} bytes", connection="close")
    length = headers.get(b"content-length", b"")
    if length.isdigit() and (len(length) > 12 or int(length) > most):
        raise too_large
    parts, size = [], 0
    try:
        async with asyncio.timeout(BODY_TIME):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise Refusal(400, "BrokenOff", "the request broke off", connection="close")
                part = message.get("body", b"")
                size += len(part)
                if size > most:
                    raise too_large
                parts.append(part)
                if not message.get("more_body", False):
                    return b"".join(parts)
    except TimeoutError:
        raise Refusal(408, "TooSlow", f"the body did not come within {BODY_TIME:g} s", connection="close") from None


def _replayed(body: bytes, receive: Receive) -> Receive:
    """Give the body that was read to the application; then what comes, which is the end of the connection."""
    given = False

    async def again() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


# Sockets


class _Ending:
    """A socket that ends with its login, and that takes no message beyond the bound."""

    def __init__(self, receive: Receive, send: Send, login: Login, ended: asyncio.Event) -> None:
        self._receive, self._send, self._login, self._ended = receive, send, login, ended
        self._end: asyncio.Task[Any] = asyncio.ensure_future(ended.wait())
        self._next: asyncio.Future[Message] | None = None
        self._closed = False

    async def receive(self) -> Message:
        if self._next is None:
            self._next = asyncio.ensure_future(self._receive())
        await asyncio.wait((self._next, self._end), return_when=asyncio.FIRST_COMPLETED)
        if self._end.done():
            return await self._give_up(REVOKED, self._login.ended or "the session has ended")
        message, self._next = self._next.result(), None
        if len(message.get("text") or message.get("bytes") or b"") > SMALL:
            return await self._give_up(1009, f"a message is longer than {SMALL} bytes")
        return message

    async def send(self, message: Message) -> None:
        if self._closed:
            return
        self._closed = message["type"] == "websocket.close"
        await self._send(message)

    async def _give_up(self, code: int, why: str) -> Message:
        await self.send({"type": "websocket.close", "code": code, "reason": why[:120]})
        return {"type": "websocket.disconnect", "code": code}

    def close(self) -> None:
        self._end.cancel()
        if self._next is not None:
            self._next.cancel()


def _end_at(login: Login, authority: Authority) -> asyncio.TimerHandle | None:
    left = login.ends - authority.now()
    if left > 1e6:
        return None
    return asyncio.get_running_loop().call_later(left, login.end, "the session has ended: log in again")


# Refusing


async def _refuse(send: Send, refusal: Refusal) -> None:
    body = refusal.body()
    headers = {"content-type": "application/json", "content-length": f"{len(body)}", **refusal.headers}
    raw = [(name.encode(), value.encode()) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": refusal.status, "headers": raw})
    await send({"type": "http.response.body", "body": body})


async def _refuse_socket(scope: Scope, receive: Receive, send: Send, refusal: Refusal) -> None:
    """Refuse a socket before it is open, with the status where the server can send one; else that is 403."""
    message = await receive()
    if message["type"] != "websocket.connect":
        return
    if "websocket.http.response" not in scope.get("extensions", {}):
        await send({"type": "websocket.close", "code": 1008})
        return
    body = refusal.body()
    raw = [(b"content-type", b"application/json"), (b"content-length", f"{len(body)}".encode())]
    await send({"type": "websocket.http.response.start", "status": refusal.status, "headers": raw})
    await send({"type": "websocket.http.response.body", "body": body})
