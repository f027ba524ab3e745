"""Routes: logging in and out, and giving others access."""

from typing import Annotated

from fastapi import APIRouter, Path, Request

from servobus.errors import BadValue
from servobus.server.web.api import shapes
from servobus.server.web.api.answers import Ctx, Json, LoggedIn, gives
from servobus.server.web.auth import LINK_TIME, SESSION_TIME, Login, Role

router = APIRouter(tags=["access"])


@router.post("/session", responses=gives(shapes.Who, "Who has logged in; the cookie is set."))
async def log_in(request: Request, context: Ctx, body: shapes.LoginBody) -> Json:
    """Log a browser in by the token of a link, or by the password: sets the cookie.

    The token of a link is good once. Where the browser is logged in already nothing happens: the same link opened again
    leads on.
    """
    before: Login | None = request.state.login
    peer = request.client.host if request.client is not None else ""
    if (body.token is None) is (body.password is None):
        raise BadValue("give one of both: the token of a link, or the password")
    if body.token is not None:
        if before is not None:
            return Json(before.entry())
        secret, login = await context.authority.exchange(body.token, peer)
    else:
        secret, login = await context.authority.log_in(body.password or "", peer)
        if before is not None and before.kind == "browser":
            context.authority.log_out(before)
    answer = Json(login.entry())
    answer.set_cookie(
        context.cookie,
        secret,
        max_age=int(SESSION_TIME),
        path="/",
        secure=context.config.tls,
        httponly=True,
        samesite="strict",
    )
    context.service.audit.note(login.name, "log in", "", "", {"role": str(login.role)})
    return answer


@router.delete("/session", responses=gives(shapes.Ok, "Logged out."))
async def log_out(context: Ctx, login: LoggedIn) -> Json:
    """Log this browser out, with all its tabs. What it drives is stopped."""
    if login.kind == "browser":
        context.authority.log_out(login)
    answer = Json({"ok": True})
    answer.delete_cookie(context.cookie, path="/", httponly=True, samesite="strict", secure=context.config.tls)
    return answer


@router.get("/sessions", responses=gives(list[shapes.Who], "The browsers that are logged in."))
async def sessions(context: Ctx) -> Json:
    """List the browsers that are logged in."""
    return Json([login.entry() for login in context.authority.sessions()])


@router.delete("/sessions/{session}", responses=gives(shapes.Ok, "It has ended."))
async def end_session(context: Ctx, login: LoggedIn, session: Annotated[str, Path(max_length=40)]) -> Json:
    """Log a browser out."""
    context.authority.end_session(session)
    context.service.audit.note(login.name, "end session", "", "", {"session": session})
    return Json({"ok": True})


@router.post("/links", responses=gives(shapes.Link, "The link."))
async def make_link(context: Ctx, login: LoggedIn, body: shapes.LinkBody) -> Json:
    """Make a link that logs one browser in, once and within some minutes."""
    token = context.authority.make_link(Role.named(body.role))
    context.service.audit.note(login.name, "make link", "", "", {"role": body.role})
    return Json({"url": f"{context.base}/?token={token}", "seconds": LINK_TIME})


@router.get("/tokens", responses=gives(list[shapes.Who], "The names and roles."))
async def tokens(context: Ctx) -> Json:
    """List the named tokens of programs, without the tokens themselves."""
    return Json([login.entry() for login in context.authority.tokens()])


@router.post("/tokens", responses=gives(shapes.Secret, "The token, shown this once."))
async def make_token(context: Ctx, login: LoggedIn, body: shapes.TokenBody) -> Json:
    """Make a token for a program, which sends it as `Authorization: Bearer TOKEN`."""
    token = context.authority.make_token(body.name, Role.named(body.role))
    context.service.audit.note(login.name, "make token", "", "", {"name": body.name, "role": body.role})
    return Json({"token": token})


@router.delete("/tokens/{name}", responses=gives(shapes.Ok, "It is good no more."))
async def drop_token(context: Ctx, login: LoggedIn, name: Annotated[str, Path(max_length=40)]) -> Json:
    """Take a token back; connections that were opened by it are closed."""
    context.authority.drop_token(name)
    context.service.audit.note(login.name, "drop token", "", "", {"name": name})
    return Json({"ok": True})
