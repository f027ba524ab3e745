"""`servobus serve`: one process that owns the ports, and beside it the one that serves pages and the API.

The web process may die or hang: the ports, the programs on them and their safe actions are here, and a new web process
is started. When this process ends, its servos are left as their safe actions say, and the web process ends with it.
"""

import asyncio
import json
import os
import re
import secrets
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from servobus.errors import PortError, ServobusError, UsageError
from servobus.remote.runtime import Server
from servobus.robots.file.reading import read_file
from servobus.server.ports.foreign import ForeignPort, ForeignPty, ForeignTcp
from servobus.server.ports.hosting import Host
from servobus.server.ports.owner import PortOwner

LOOPBACK = "127.0.0.1"
START = 20.0
"""s within which the web process must be ready."""
AGAIN = 1.0
"""s before a web process is started anew; doubled each time it ends soon, up to LONGEST_AGAIN."""
LONGEST_AGAIN = 30.0


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be served.

    ports     name of a bus -> its port
    robots    name of a robot -> its file, whose ports are among the buses
    ptys      (bus, link): pseudo terminals for programs of other makes; tcps (bus, host, port): TCP ports for them
    web       what the web process is told beside the buses; None: no web process
    record    folder in which the traffic of each bus is recorded all the time
    state     folder for the audit log and the black boxes
    """

    ports: Mapping[str, str]
    robots: Mapping[str, Path] = field(default_factory=dict)
    ptys: Sequence[tuple[str, Path]] = ()
    tcps: Sequence[tuple[str, str, int]] = ()
    web: Mapping[str, Any] | None = None
    record: Path | None = None
    state: Path = Path()
    read_only: bool = False


def buses_of(sources: Sequence[str]) -> tuple[dict[str, str], dict[str, Path]]:
    """Give buses and robots of what is typed: ports, NAME=PORT, and robot files, whose ports they bring.

    Raises UsageError, RobotFileError.
    """
    ports: dict[str, str] = {}
    robots: dict[str, Path] = {}
    for source in sources:
        if source.endswith(".toml") and not source.startswith("virtual:"):
            path = Path(source)
            robots[_free(path.stem, robots)] = path
            for name, entry in read_file(path).ports.items():
                if ports.get(name, entry.path) != entry.path:
                    raise UsageError(f"{path}: port {name} is {entry.path} there, and {ports[name]} elsewhere")
                ports[name] = entry.path
            continue
        match = re.fullmatch(r"([A-Za-z][\w-]*)=(.+)", source)
        name, port = (match[1], match[2]) if match else (_free(_usual_name(source), ports), source)
        if name in ports:
            raise UsageError(f"two buses are called {name}")
        ports[name] = port
    return ports, robots


def _usual_name(port: str) -> str:
    """Give a short name for a port: the last word of a path, or its kind."""
    if port.startswith("virtual:"):
        return "virtual"
    words = re.findall(r"[A-Za-z][\w-]*", port.partition("://")[2] or port)
    return words[-1] if words else "bus"


def _free(name: str, taken: Mapping[str, Any]) -> str:
    names = (name, *(f"{name}{number}" for number in range(2, 1000)))
    return next(one for one in names if one not in taken)


async def serve(plan: Plan, say: Callable[[str], None], stop: asyncio.Event) -> None:
    """Serve until `stop` is set. `say` prints what people and programs wait for.

    Raises PortError and UsageError for what cannot be served.
    """
    token, web_token = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
    role = "viewer" if plan.read_only else "operator"
    if plan.record is not None:
        plan.record.mkdir(parents=True, exist_ok=True)
    owner = PortOwner({token: role, web_token: "admin"}, boxes=plan.state / "boxes", record=plan.record)
    async with AsyncExitStack() as stack:
        stack.push_async_callback(owner.close)
        for name, port in plan.ports.items():
            owner.open_bus(name, port)
        listener = await owner.service.listen(LOOPBACK, 0)
        stack.callback(listener.close)
        host, number = listener.sockets[0].getsockname()[:2]
        told = tuple(plan.ports.items())
        found = Host(owner.service, Server(os.getpid(), host, number, token, "", told))
        stack.callback(found.close)
        foreign = [await stack.enter_async_context(one) for one in _foreign_ports(plan, owner)]
        # The buses are told when everything is up, so that who waits for `ready` finds all of it.
        lines = [f"bus {name} {port}" for name, port in plan.ports.items()]
        lines += [f"port {one.port} for programs on bus {one.bus_name}" for one in foreign]
        if plan.web is None:
            say(f"ready servobus://{host}:{number}")
            for line in lines:
                say(line)
            await stop.wait()
            return
        settings = {
            **plan.web,
            "local_token": token,
            "owner": [host, number],
            "owner_token": web_token,
            "read_only": plan.read_only,
            "robots": {name: str(path) for name, path in plan.robots.items()},
            "audit": str(plan.state / "audit.jsonl"),
            "recordings": str(plan.record or plan.state / "boxes"),
        }
        web = WebProcess(settings)
        stack.push_async_callback(web.end)
        await web.keep(say, lines, found, stop)


def _foreign_ports(plan: Plan, owner: PortOwner) -> list[ForeignPort]:
    control = owner.control
    ports: list[ForeignPort] = []
    for bus, link in plan.ptys:
        ports.append(ForeignPty(control.bus(bus).bus, bus, control, link))
    for bus, host, number in plan.tcps:
        ports.append(ForeignTcp(control.bus(bus).bus, bus, control, host, number))
    return ports


class WebProcess:
    """The process beside this one that serves pages and the API, started anew when it ends by accident."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._settings = dict(settings)
        self._process: asyncio.subprocess.Process | None = None

    async def keep(self, say: Callable[[str], None], lines: Sequence[str], found: Host, stop: asyncio.Event) -> None:
        """Have a web process until `stop` is set. Raises UsageError if the first one cannot start."""
        wait, first = AGAIN, True
        while not stop.is_set():
            start_token = secrets.token_urlsafe(24)
            loop = asyncio.get_running_loop()
            began = loop.time()
            try:
                address = await self._start(start_token)
            except ServobusError as error:
                if first:
                    raise
                say(f"the web process could not start: {error}")
            else:
                found.tell(http=address)
                say(f"ready {address}/?token={start_token}")
                if first:
                    for line in lines:
                        say(line)
                first = False
                # From here on its port is known: the next one takes the same, so that open pages find it again.
                self._settings["port"] = int(address.rpartition(":")[2])
                await self._ended(stop)
                if stop.is_set():
                    return
                say("the web process has ended; the ports go on, and a new one is started")
            wait = AGAIN if loop.time() - began > LONGEST_AGAIN else min(2 * wait, LONGEST_AGAIN)
            with suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), wait)

    async def end(self) -> None:
        """End the web process: it sees that nobody holds its standard input any more."""
        process, self._process = self._process, None
        if process is None or process.returncode is not None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), 5.0)
        except TimeoutError:
            process.kill()
            await process.wait()

    async def _start(self, start_token: str) -> str:
        """Start a web process; give its address. Raises UsageError for what it could not do."""
        process = self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "servobus.server.web",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,  # Ctrl-C in the terminal is for this process, which ends the other one
        )
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(self._settings | {"start_token": start_token}).encode() + b"\n")
        try:
            async with asyncio.timeout(START):
                line = await process.stdout.readline()
            said = json.loads(line or b"{}")
        except (TimeoutError, ValueError):
            said = {}
        if "ready" in said:
            return str(said["ready"])
        await self.end()
        raise UsageError(said.get("failed", "the web process did not say that it is ready"))

    async def _ended(self, stop: asyncio.Event) -> None:
        assert self._process is not None
        tasks = [asyncio.ensure_future(self._process.wait()), asyncio.ensure_future(stop.wait())]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()


def state_folder() -> Path:
    """Give the folder for what servers keep: the audit log and black boxes. Raises PortError without a home folder."""
    said = os.environ.get("XDG_STATE_HOME", "")
    try:
        return (Path(said) if said else Path.home() / ".local" / "state") / "servobus"
    except RuntimeError as error:
        raise PortError(f"no home folder is known ({error}); XDG_STATE_HOME can name another one") from None
