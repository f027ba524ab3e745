"""How the API answers: JSON that every text survives, errors in one shape, and who asks."""

import json
import logging
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import Depends, FastAPI, Header, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from servobus.errors import ServobusError, UnknownName
from servobus.server.web.api.shapes import Error
from servobus.server.web.auth import Authority, Login, LoginRefused, Role
from servobus.server.web.config import WebConfig
from servobus.server.web.errors import error_entry, status_of
from servobus.server.web.holders import Holder
from servobus.server.web.served_bus import Actor
from servobus.server.web.service import Service


class Json(Response):
    """JSON in UTF-8. Half a surrogate, which a text of JSON may hold, has no place there and becomes a "?"."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(errors="replace")


class Context:
    """What the routes work on; the application has one.

    base  the address under which people reach the server
    """

    def __init__(self, config: WebConfig, authority: Authority, service: Service) -> None:
        self.config, self.authority, self.service = config, authority, service
        self.base = ""
        self.port = config.port
        self.holders: dict[str, tuple[Login, Holder]] = {}
        """Connections that may drive, by their id."""

    @property
    def cookie(self) -> str:
        """The name of the cookie: cookies do not tell the ports of a computer apart."""
        return f"servobus_{self.port}"


def _context(request: Request) -> Context:
    found: Context = request.app.state.context
    return found


def _service(request: Request) -> Service:
    return _context(request).service


def _login(request: Request) -> Login:
    login: Login = request.state.login  # the guard lets nobody else come this far
    return login


def _actor(
    request: Request,
    connection: Annotated[
        str | None,
        Header(alias="Servobus-Connection", max_length=64, description="the live connection that is watched meanwhile"),
    ] = None,
) -> Actor:
    login = _login(request)
    if connection is None:
        return Actor(login.name)
    owner, holder = _context(request).holders.get(connection, (None, None))
    if holder is None or owner is not login:
        raise UnknownName("Servobus-Connection: no such connection of this login is open")
    holder.check()
    return Actor(login.name, holder)


Ctx = Annotated[Context, Depends(_context)]
Svc = Annotated[Service, Depends(_service)]
LoggedIn = Annotated[Login, Depends(_login)]
By = Annotated[Actor, Depends(_actor)]

_WORDS = {
    400: "The request is no HTTP or JSON that can be read.",
    401: "Nobody has logged in.",
    403: "The role of the login is too low, or another page has sent the request.",
    404: "There is no such bus, servo, register, job, ...",
    409: "Not in the state that things are in: torque off, stopped, id taken, ...",
    413: "The body is too long.",
    422: "A value that cannot be.",
    424: "The servo, the line or the port has failed: no answer, garbage, unplugged.",
    429: "Too many requests, jobs or clients at once.",
}
ERRORS: dict[int | str, dict[str, Any]] = {
    status: {"model": Error, "description": words} for status, words in _WORDS.items()
}


def gives(shape: Any, description: str, status: int = 200) -> dict[int | str, dict[str, Any]]:
    """Describe what a route gives."""
    return {status: {"model": shape, "description": description}}


def role_of(state: Any) -> Role:
    """Give the role that the guard has found, which a read-only server lowers."""
    role: Role = state.role
    return role


def handle_errors(app: FastAPI) -> None:
    """Answer every error in one shape."""

    async def refused(_: Request, error: Exception) -> Response:
        assert isinstance(error, ServobusError)
        return problem(status_of(error), error_entry(error))

    async def no_login(_: Request, error: Exception) -> Response:
        assert isinstance(error, LoginRefused)
        entry = {"type": "LoginRefused", "message": str(error)}
        if error.wait:
            return problem(429, entry, {"retry-after": f"{error.wait:.0f}"})
        return problem(401, entry)

    async def invalid(_: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        # What was sent is not repeated: it may be a password.
        found = [
            {"where": ".".join(map(str, one["loc"])), "problem": str(one["msg"])[:200]} for one in error.errors()[:20]
        ]
        told = f"{found[0]['where']}: {found[0]['problem']}" if found else "the request makes no sense"
        return problem(422, {"type": "BadRequest", "message": told, "detail": found})

    async def http(_: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        kind = {404: "NotFound", 405: "NotAllowed"}.get(error.status_code, "BadRequest")
        return problem(error.status_code, {"type": kind, "message": str(error.detail)}, error.headers)

    async def fault(_: Request, error: Exception) -> Response:
        logging.getLogger("servobus").error("a fault of the server", exc_info=error)
        return problem(500, {"type": "InternalError", "message": "a fault of the server: its log says more"})

    app.add_exception_handler(ServobusError, refused)
    app.add_exception_handler(LoginRefused, no_login)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(Exception, fault)


def problem(status: int, entry: Mapping[str, Any], headers: Mapping[str, str] | None = None) -> Json:
    """Answer with an error."""
    return Json({"error": dict(entry)}, status_code=status, headers=headers)
