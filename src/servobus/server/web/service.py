"""What the server offers, by functions: the API and the pages call these, and nothing else.

A bus is asked through an `AsyncBus`, whatever is behind it: servos in this process, a port, or a port that another
process owns.
"""

import asyncio
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from servobus import connect
from servobus.bus.asyncio import AsyncBus
from servobus.bus.blocking import Bus
from servobus.core.ids import LAST_ID, check_ids
from servobus.errors import ServobusError, StopFailed, UnknownName, UsageError
from servobus.families import registry
from servobus.families.present import model_entry, servo_entry, servo_key
from servobus.jobs.scan import ScanProgress
from servobus.remote.managing import Happened
from servobus.server.web.audit import Audit
from servobus.server.web.entries import snapshot_entry
from servobus.server.web.errors import TooMany
from servobus.server.web.feeds import Events, Feed
from servobus.server.web.holders import Driven, Holder, Holders
from servobus.server.web.jobs import Jobs, ServerJob
from servobus.server.web.owner_link import SESSION, OwnerLink, event_data
from servobus.server.web.served_bus import Actor, ServedBus
from servobus.server.web.served_robot import ServedRobot
from servobus.server.web.values import key_of

MOST_BUSES = 32
MOST_READS = 100_000
"""Reads in which an examination counts losses, at most."""


class Service:
    """All buses and robots of the server.

    opened  opens a port by its name
    """

    def __init__(
        self,
        *,
        audit: Path | None = None,
        recordings: Path | None = None,
        opened: Callable[[str], AsyncBus] = connect.open_async,
    ) -> None:
        self.events = Events()
        self.jobs = Jobs(self.events)
        self.audit = Audit(audit)
        self.holders = Holders()
        self.buses: dict[str, ServedBus] = {}
        self.robots: dict[str, ServedRobot] = {}
        self._recordings, self._opened = recordings, opened
        self._owner: OwnerLink | None = None
        self._taking: set[asyncio.Future[None]] = set()

    async def close(self) -> None:
        """Make safe what this process drives, and give all ports back."""
        await self.jobs.close()
        for name in list(self.buses):
            with suppress(ServobusError):
                await self._leave(name)
        if self._owner is not None:
            await self._owner.close()

    # Buses

    def bus(self, name: str) -> ServedBus:
        """Give a bus. Raises UnknownName."""
        if name not in self.buses:
            raise UnknownName(f"there is no bus {name[:40]!r} (there are: {', '.join(self.buses) or 'none'})")
        return self.buses[name]

    async def join(self, owner: OwnerLink) -> None:
        """Take the buses of the process that owns the ports, and all that it tells. Raises PortError."""
        self._owner = owner
        for name, port in (await owner.connect(self._happened)).items():
            await self._take(name, port)

    async def open_bus(self, by: str, name: str, port: str) -> ServedBus:
        """Open a port. Asks nothing, moves nothing. Raises UsageError for a name that is taken, PortError."""
        if name in self.buses:
            raise UsageError(f"there is a bus {name!r} already")
        if len(self.buses) >= MOST_BUSES:
            raise TooMany(f"{MOST_BUSES} buses are open already")
        if self._owner is None:
            self._add(name, port, self._opened(port))
        else:
            await self._owner.open_bus(name, port)
            await self._take(name, port)
        self.audit.note(by, "open", name, "", {"port": port})
        self.events.tell("opened", bus=name, port=port)
        return self.buses[name]

    async def _take(self, name: str, port: str) -> None:
        """Have a bus of the owner of the ports here too."""
        assert self._owner is not None
        bus = await self._owner.bus(name)
        if name not in self.buses:
            self._add(name, port, bus)

    def _add(self, name: str, port: str, bus: AsyncBus) -> None:
        self.buses[name] = ServedBus(
            name,
            port,
            bus,
            events=self.events,
            jobs=self.jobs,
            audit=self.audit,
            holders=self.holders,
            owner=self._owner,
        )

    def _happened(self, event: Happened) -> None:
        """Pass on what the owner of the ports tells, and follow it."""
        served = self.buses.get(event.bus)
        data = event_data(event)
        if event.what == "opened":
            if served is None:
                task = asyncio.ensure_future(self._take(event.bus, str(data.get("port", ""))))
                self._taking.add(task)
                task.add_done_callback(self._taking.discard)
            return
        if served is not None:
            served.follow(event.what, data)
            if event.what == "stopped" and data.get("by") == SESSION:
                data["by"] = served.stopped_by
        self.events.tell(event.what, **data)

    async def close_bus(self, by: str, name: str) -> None:
        """Make safe what a bus drives, and give its port back. Raises UsageError while a robot uses it."""
        bus = self.bus(name)
        if users := [robot.name for robot in self.robots.values() if name in robot.ports and by != "server"]:
            raise UsageError(f"the robot {', '.join(users)} uses the bus {name}")
        await self._leave(bus.name)
        if self._owner is not None:
            await self._owner.close_bus(name)
        self.audit.note(by, "close", name, "", {})
        self.events.tell("closed", bus=name)

    async def _leave(self, name: str) -> None:
        self.jobs.break_off(name)
        await self.buses.pop(name).close()

    # Stopping

    async def stop(self, actor: Actor) -> dict[str, dict[str, str]]:
        """Stop everything: bus -> key -> what was done. Raises StopFailed, when all had their turn."""
        names = list(self.buses)
        if self._owner is not None:
            for served in self.buses.values():
                served.latch(actor)
            await self._owner.stop()
            for name in names:
                self.audit.note(actor.name, "stop", name, "", {})
            return {name: {} for name in names}
        outcomes = await asyncio.gather(*(self.buses[name].stop(actor) for name in names), return_exceptions=True)
        failures = {name: one for name, one in zip(names, outcomes, strict=True) if isinstance(one, Exception)}
        done = {name: one for name, one in zip(names, outcomes, strict=True) if isinstance(one, dict)}
        if failures:
            why = "; ".join(f"{name}: {error}" for name, error in failures.items())
            raise StopFailed(f"some servos may still move: {why}", failures, done)
        return done

    def holder(self, name: str) -> Holder:
        """Make a holder: someone who drives servos and is watched while he does."""
        holder = Holder(name, self._lapsed)
        self.holders.add(holder)
        return holder

    async def _lapsed(self, driven: Driven, why: str) -> None:
        for name in {bus for bus, _ in driven}:
            if name in self.buses:
                await self.buses[name].stop_driven([key for bus, key in driven if bus == name], why)

    def leave(self, feed: Feed) -> None:
        """Send nothing more to a client."""
        self.events.leave(feed)
        for bus in self.buses.values():
            bus.unsubscribe(feed)

    # Scans and examinations

    def scan(
        self,
        actor: Actor,
        name: str,
        *,
        families: Sequence[str] | None = None,
        bauds: Sequence[int] | None = None,
        ids: Iterable[int] | None = None,
    ) -> ServerJob:
        """Look for servos; what is found is known from then on. Moves nothing. Raises UnknownName, BadValue."""
        served = self.bus(name)
        asked = [registry.family(one) for one in families] if families else list(registry.FAMILIES.values())
        wanted = check_ids(range(LAST_ID + 1) if ids is None else ids)
        speeds = {family.name: tuple(bauds) if bauds else registry.factory_bauds(family) for family in asked}
        total = len(wanted) * sum(map(len, speeds.values()))

        async def run(job: ServerJob) -> dict[str, Any]:
            done = 0

            def watch(progress: ScanProgress) -> None:
                nonlocal done
                done += 1
                text = f"{progress.family.name} id {progress.id} at {progress.baud} baud"
                self.jobs.progress(job, done, total, text)
                if progress.found is not None:
                    found = progress.found
                    entry = servo_entry(found.family, found.model, found.id, found.baud, found.identity.firmware)
                    state = None if found.state is None else snapshot_entry(found.state)
                    job.found.append({"key": servo_key(found.family, found.id, found.baud), **entry, "state": state})

            for family in asked:
                servos = await served.bus.scan(family=family, bauds=speeds[family.name], ids=wanted, watch=watch)
                for servo in servos:
                    self.events.tell("appeared", bus=name, servo=key_of(servo), alarms=[])
            survey = served.bus.survey
            return {"servos": len(job.found), "unclear": [str(one) for one in survey.troubles][:100]}

        return self.jobs.start("scan", name, actor.name, run)

    def doctor(self, actor: Actor, name: str, *, ids: Iterable[int] | None = None, reads: int = 1000) -> ServerJob:
        """Find out what is wrong with a port and its servos. Moves nothing, changes nothing."""
        from servobus.doctor import SearchPlan, examine  # noqa: PLC0415 - seldom wanted

        served = self.bus(name)
        if not 0 <= reads <= MOST_READS:
            raise UsageError(f"reads {reads} is not in 0 .. {MOST_READS}")
        wanted = check_ids(range(LAST_ID + 1) if ids is None else ids)
        rounds = [(family, registry.factory_bauds(family)) for family in registry.FAMILIES.values()]
        plan = SearchPlan(rounds, (), wanted, reads)

        async def run(job: ServerJob) -> dict[str, Any]:
            loop, over = asyncio.get_running_loop(), threading.Event()

            def watch(stage: str, done: int, total: int) -> None:
                if over.is_set():
                    raise asyncio.CancelledError
                loop.call_soon_threadsafe(self.jobs.progress, job, done, total, stage)

            owner = self._owner

            def opened(port: str) -> Bus:
                return connect.open(port) if owner is None else Bus(owner.port(name))

            def work() -> None:
                # A port that another process owns is examined through that process.
                port = served.port if owner is None else owner.address(name)
                for finding in examine(port, plan, watch, opened):
                    loop.call_soon_threadsafe(job.found.append, finding.entry())

            try:
                await asyncio.to_thread(work)
            finally:
                over.set()
            await asyncio.sleep(0)  # what the thread has found is here then
            return {"findings": len(job.found)}

        return self.jobs.start("doctor", name, actor.name, run)

    # Robots

    def open_robot(self, name: str, file: str, ports: Mapping[str, str] | None = None) -> ServedRobot:
        """Take a robot whose ports are buses: port of the file -> bus, the same names by default."""
        self.robots[name] = ServedRobot(name, file, self.buses, ports, events=self.events, audit=self.audit)
        return self.robots[name]

    def robot(self, name: str) -> ServedRobot:
        """Give a robot. Raises UnknownName."""
        if name not in self.robots:
            raise UnknownName(f"there is no robot {name[:40]!r} (there are: {', '.join(self.robots) or 'none'})")
        return self.robots[name]

    def joints(self, bus: str) -> dict[str, str]:
        """Name the servos of a bus as the robot files do: key -> joint."""
        return {
            part["key"]: name
            for robot in self.robots.values()
            for name, joint in robot.entry()["joints"].items()
            for part in joint["servos"]
            if part["bus"] == bus
        }

    # Models and recordings

    @staticmethod
    def models() -> list[dict[str, Any]]:
        return [model_entry(model) for model in registry.MODELS.values()]

    def recordings(self) -> list[dict[str, Any]]:
        """List the files in the folder of recordings, the newest first."""
        if self._recordings is None or not self._recordings.is_dir():
            return []
        files = [path for path in self._recordings.iterdir() if path.is_file() and not path.name.startswith(".")]
        entries = [
            {"name": path.name, "size": about.st_size, "time": round(about.st_mtime, 3)}
            for path in files
            for about in [path.stat()]
        ]
        return sorted(entries, key=lambda entry: -entry["time"])

    def recording(self, name: str) -> Path:
        """Give a file of the folder of recordings, and no other. Raises UnknownName."""
        if self._recordings is None or name not in {entry["name"] for entry in self.recordings()}:
            raise UnknownName(f"there is no recording {name[:60]!r}")
        return self._recordings / name
