"""The live connection: events and telemetry to a client, and its heartbeat while it drives.

Every message is one JSON object in a text frame; `k` says what it is. The server begins:

    welcome      connection: the id for the header Servobus-Connection; name, role, time
    telemetry    bus, t, servos: key -> {values: register -> SI value, or null where it does not answer; alarms}, lost
    event        number, time, what, ...; see GET /events
    beat         time: answer to a beat
    ok, error    answer to a message that has an `n`: the same n, and the error of the API

A client may send:

    subscribe    bus, period in s, and servos: key -> registers, or none for an overview; in place of what it asked for
    unsubscribe  bus
    hold         deadman in s: from now on it is watched, and may drive
    beat         every quarter of the deadman or more often
    drive        bus, goals: key -> rad, time in s, seq that grows, sent: the time of the server, as reckoned from beats
    stop         bus, or none for all

Who holds and is silent for as long as its deadman, or goes away, stops what it drives. A client that reads slowly
loses telemetry and never events; where too many of those wait the connection is closed, with the reason.
"""

import asyncio
import contextlib
import json
from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import Field, TypeAdapter, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from servobus.errors import ServobusError
from servobus.server.web.api.answers import Context, role_of
from servobus.server.web.api.shapes import Body, Finite, Goals, Name, Seconds, ServoKey, Text
from servobus.server.web.auth import Login, Role
from servobus.server.web.errors import RoleTooLow, TooMany, error_entry
from servobus.server.web.feeds import Feed
from servobus.server.web.holders import Holder
from servobus.server.web.rates import Bucket
from servobus.server.web.served_bus import Actor

router = APIRouter(tags=["live"])

MESSAGES = 200.0
"""Messages a second of one client: beats, and goals that are streamed at 100 Hz."""
PATIENCE = 10.0
"""s for which a client may take nothing of what is sent."""
POLICY, AGAIN = 1008, 1013
"""Codes with which a connection is closed: it did what it must not; try again later."""


class Subscribe(Body):
    k: Literal["subscribe"]
    n: int | None = None
    bus: Name
    period: Finite
    servos: dict[ServoKey, Annotated[list[Text], Field(max_length=100)]] | None = None


class Unsubscribe(Body):
    k: Literal["unsubscribe"]
    n: int | None = None
    bus: Name


class Hold(Body):
    k: Literal["hold"]
    n: int | None = None
    deadman: Finite


class Beat(Body):
    k: Literal["beat"]
    n: int | None = None


class Drive(Body):
    k: Literal["drive"]
    n: int | None = None
    bus: Name
    goals: Goals
    time: Seconds
    seq: int
    sent: Finite


class Stop(Body):
    k: Literal["stop"]
    n: int | None = None
    bus: Name | None = None


Asked = Annotated[Subscribe | Unsubscribe | Hold | Beat | Drive | Stop, Field(discriminator="k")]
_ASKED: TypeAdapter[Any] = TypeAdapter(Asked)


class _Client:
    """One connection."""

    def __init__(self, socket: WebSocket, context: Context, login: Login, role: Role) -> None:
        self._socket, self._context, self._login, self._role = socket, context, login, role
        self._service = context.service
        self.feed = Feed(login.name)
        self.holder: Holder = self._service.holder(login.name)
        self._bucket = Bucket(MESSAGES)
        self._stops: set[asyncio.Task[None]] = set()

    def welcome(self) -> dict[str, Any]:
        return {
            "k": "welcome",
            "connection": self.holder.id,
            "name": self._login.name,
            "role": str(self._role),
            "time": asyncio.get_running_loop().time(),
        }

    async def listen(self) -> None:
        """Take messages until the client goes away."""
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text is None or self._bucket.take():
                why = "messages are texts" if text is None else f"more than {MESSAGES:g} messages a second"
                await self._close(POLICY, why)
                return
            await self._take(text)

    async def speak(self) -> None:
        """Send what waits until the client goes away, or reads too slowly."""
        while True:
            messages = await self.feed.next()
            if self.feed.full:
                await self._close(AGAIN, self.feed.full)
                return
            for message in messages:
                async with asyncio.timeout(PATIENCE):
                    await self._socket.send_text(json.dumps(message, allow_nan=False, separators=(",", ":")))

    async def _close(self, code: int, why: str) -> None:
        async with asyncio.timeout(PATIENCE):
            await self._socket.close(code, why)

    async def _take(self, text: str) -> None:
        number: Any = None
        try:
            data = json.loads(text)
            number = data.get("n") if isinstance(data, dict) else None
            asked = _ASKED.validate_python(data)
        except ValidationError as error:
            first = error.errors(include_input=False, include_url=False)[0]
            where = ".".join(map(str, first["loc"]))
            self._answer(number, {"type": "BadRequest", "message": f"{where}: {first['msg']}"[:300]})
            return
        except (ValueError, RecursionError):
            self._answer(None, {"type": "BadRequest", "message": "a message is one JSON object"})
            return
        if isinstance(asked, Stop):  # by itself: what is asked before must not keep it waiting
            task = asyncio.ensure_future(self._carry_out(asked))
            self._stops.add(task)
            task.add_done_callback(self._stops.discard)
        else:
            await self._carry_out(asked)

    async def _carry_out(self, asked: Any) -> None:
        try:
            result = await self._do(asked)
        except ServobusError as error:
            self._answer(asked.n, error_entry(error))
        else:
            if asked.n is not None or result is not None:
                self.feed.answer({"k": "ok", "n": asked.n, **(result or {})})

    async def _do(self, asked: Any) -> dict[str, Any] | None:
        match asked:
            case Beat():
                self.holder.beat()
                return {"k": "beat", "time": asyncio.get_running_loop().time()}
            case Stop():
                actor = Actor(self._login.name)
                done: Any = await (
                    self._service.stop(actor) if asked.bus is None else self._service.bus(asked.bus).stop(actor)
                )
                return {"stopped": done}
            case Subscribe():
                self._service.bus(asked.bus).subscribe(self.feed, asked.servos, asked.period)
            case Unsubscribe():
                self._service.bus(asked.bus).unsubscribe(self.feed)
            case Hold():
                self._check_operator()
                self.holder.watch(asked.deadman)
                self._context.holders[self.holder.id] = self._login, self.holder
            case Drive():
                self._check_operator()
                self.holder.check(asked.sent, asked.seq)
                await self._service.bus(asked.bus).stream(Actor(self._login.name, self.holder), asked.goals, asked.time)
        return None

    def _check_operator(self) -> None:
        if self._role < Role.OPERATOR:
            raise RoleTooLow(f"this needs the role operator, and {self._login.name} is {self._role} here")

    def _answer(self, number: Any, error: dict[str, Any]) -> None:
        self.feed.answer({"k": "error", "n": number if isinstance(number, int) else None, "error": error})

    async def gone(self) -> None:
        """Stop what this client drives, and forget it."""
        self._context.holders.pop(self.holder.id, None)
        self._service.leave(self.feed)
        self.holder.leave()
        await self.holder.settled()


@router.websocket("/live")
async def live(socket: WebSocket) -> None:
    """Open the live connection."""
    context: Context = socket.app.state.context
    client = _Client(socket, context, socket.state.login, role_of(socket.state))
    await socket.accept()
    try:
        context.service.events.join(client.feed)
    except TooMany as error:
        await socket.close(AGAIN, str(error))
        return
    tasks: list[asyncio.Task[None]] = []
    try:
        await socket.send_text(json.dumps(client.welcome()))
        tasks = [asyncio.ensure_future(client.listen()), asyncio.ensure_future(client.speak())]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        await client.gone()
        for task in tasks:
            task.cancel()
        for task in tasks:
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, TimeoutError, RuntimeError, OSError):
                await task  # it could not send any more
