"""What a page works on: the bus that is looked at, telemetry, events, and who asks.

One browser tab has one context, however many pages are shown in it one after the other. What a page has asked to be
told of ends when another page takes its place.
"""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, TypeVar
from urllib.parse import urlencode

from nicegui import Client, background_tasks, ui
from nicegui.element import Element

from servobus.errors import ServobusError
from servobus.server.web.api.answers import Context
from servobus.server.web.auth import Login, Role
from servobus.server.web.errors import RoleTooLow
from servobus.server.web.feeds import Feed
from servobus.server.web.page.parts import toast
from servobus.server.web.served_bus import Actor, ServedBus
from servobus.server.web.service import Service

T = TypeVar("T")
Told = Callable[[dict[str, Any]], object]
"""Takes an event, or a sample of telemetry, as the live connection of the API gives them."""


class PageContext:
    """What the pages of one browser tab work on.

    service      what the server offers
    login, role  who looks, and what he may do here
    query        what stands in the address after the "?"
    content      the element that the page is built in
    """

    def __init__(self, application: Context, login: Login, role: Role, client: Client) -> None:
        self.application, self.login, self.role, self.client = application, login, role, client
        self.service: Service = application.service
        self.query: dict[str, str] = {}
        self.content: Element = client.content
        self.connection = ""
        """The live connection of this tab, whose heartbeat is watched while it drives; "" as long as there is none."""
        self._feed = Feed(login.name)
        self._task: asyncio.Task[None] | None = None
        self._wanted: dict[str, tuple[Mapping[str, Sequence[str]] | None, float]] = {}
        self._samples: list[tuple[str, Told]] = []
        self._events: list[Told] = []
        self._shell_events: list[Told] = []
        self._leaving: list[Callable[[], object]] = []

    # Who asks

    @property
    def may_change(self) -> bool:
        """Whether this login may move servos and change settings; what it may not do is refused in any case."""
        return self.role >= Role.OPERATOR

    def check_may_change(self) -> None:
        """Raise RoleTooLow for those who may look only: a page asks here whatever it shows or hides."""
        if not self.may_change:
            raise RoleTooLow(f"this needs the role operator, and {self.login.name} is {self.role} here")

    @property
    def viewer(self) -> Actor:
        """Who asks, for what everybody may do who has logged in: stop."""
        return Actor(self.login.name)

    @property
    def actor(self) -> Actor:
        """Who asks, with the heartbeat of this tab, to move or change something. Raises RoleTooLow."""
        self.check_may_change()
        owner, holder = self.application.holders.get(self.connection, (None, None))
        if holder is None or owner is not self.login:
            return Actor(self.login.name)
        return Actor(self.login.name, holder)

    # Where the page is

    @property
    def bus(self) -> ServedBus | None:
        """The bus that is looked at: that of the address, else the first; None where there is none."""
        buses = self.service.buses
        return buses.get(self.query.get("bus", "")) or next(iter(buses.values()), None)

    @staticmethod
    def link(page: str, **query: str) -> str:
        """Give the address of a page, such as `link("servo", bus="arm", servo="dynamixel:1@57600")`."""
        path = "/" if page == "overview" else f"/{page}"
        return f"{path}?{urlencode(query)}" if query else path

    def go(self, page: str, **query: str) -> None:
        """Show another page, or this one for something else; the bus stays the same where none is named."""
        bus = {"bus": self.query["bus"]} if "bus" in self.query else {}
        with self.client.layout:
            ui.navigate.to(self.link(page, **{**bus, **query}))

    # What a page asks to be told of

    def telemetry(
        self, bus: str, wanted: Mapping[str, Sequence[str]] | None, period: float, tell: Told, *, first: bool = True
    ) -> None:
        """Have registers of a bus read again and again, in place of what was asked of it before.

        wanted   key of a servo -> registers; None for an overview of all servos
        period   s
        tell     called with {"bus", "t", "servos": {key: {"values": {register: SI value} | None, "alarms": [...]}}}
        first    whether nobody else on this page is to be told of this bus any more
        """
        self._wanted[bus] = wanted, period
        if first:
            self._samples = [(name, one) for name, one in self._samples if name != bus]
        self._samples.append((bus, tell))
        if self._task is not None:
            self._subscribe(bus)

    def events(self, tell: Told) -> None:
        """Have a function called with each event of the server, as long as this page is shown."""
        self._events.append(tell)

    def leaving(self, end: Callable[[], object]) -> None:
        """Have a function called when another page takes the place of this one, or the tab is closed."""
        self._leaving.append(end)

    # What a button does

    async def attempt(self, work: Awaitable[T], done: str = "") -> T | None:
        """Do something, and say what has come of it: `done`, or the error with what to do. None after an error."""
        try:
            result = await work
        except ServobusError as error:
            with self.content:
                toast.failed(error)
            return None
        if done:
            with self.content:
                toast.told(done)
        return result

    def attempt_now(self, work: Callable[[], T], done: str = "") -> T | None:
        """As `attempt`, for what needs no waiting."""
        try:
            result = work()
        except ServobusError as error:
            with self.content:
                toast.failed(error)
            return None
        if done:
            with self.content:
                toast.told(done)
        return result

    def fault(self, error: Exception) -> None:
        """Say what has gone wrong where nobody has caught it."""
        with self.content:
            if isinstance(error, ServobusError):
                toast.failed(error)
            else:
                toast.fault()

    # For the shell

    def shell_events(self, tell: Told) -> None:
        """As `events`, as long as the tab is open."""
        self._shell_events.append(tell)

    def turn_to(self, query: Mapping[str, str]) -> None:
        """Forget what the page before has asked for."""
        self._leave()
        self.query = dict(query)

    def start(self) -> None:
        """Begin to tell: the browser is there."""
        if self._task is None:
            self._task = asyncio.ensure_future(self._run())

    def close(self) -> None:
        """Tell no more: the browser has gone."""
        self._leave()
        if self._task is not None:
            self._task.cancel()
        self.service.leave(self._feed)

    def _leave(self) -> None:
        for end in self._leaving:
            with contextlib.suppress(ServobusError):
                end()
        for bus in self._wanted:
            if bus in self.service.buses:
                self.service.buses[bus].unsubscribe(self._feed)
        self._wanted.clear()
        for listed in (self._samples, self._events, self._leaving):
            listed.clear()

    def _subscribe(self, bus: str) -> None:
        wanted, period = self._wanted[bus]
        try:
            self.service.bus(bus).subscribe(self._feed, wanted, period)
        except ServobusError as error:
            with self.content:
                toast.failed(error)

    async def _run(self) -> None:
        try:
            self.service.events.join(self._feed)
        except ServobusError as error:
            with self.content:
                toast.failed(error)
            return
        for bus in list(self._wanted):
            self._subscribe(bus)
        while True:
            for message in await self._feed.next():
                self._tell(message)
            if self._feed.full:  # begin anew, for what was missed is known to nobody
                with self.client.layout:
                    ui.navigate.reload()
                return

    def _tell(self, message: dict[str, Any]) -> None:
        if message["k"] == "telemetry":
            tells = [tell for bus, tell in self._samples if bus == message["bus"]]
        else:
            tells = [*self._shell_events, *self._events]
        for tell in tells:
            try:
                with self.content:
                    result = tell(message)
                    if asyncio.iscoroutine(result):
                        background_tasks.create(result)
            except Exception:  # one part of a page that fails leaves the others alone
                logging.getLogger("servobus").exception("a part of a page has failed")
