"""One bus as people and programs use it through the server: everything that the API and the pages do with servos.

Whoever asks is an `Actor`: a name for the audit log, and the holder that is watched while he drives, if there is one.
What moves is refused for everybody for a while after a stop, and until somebody resumes.
"""

import asyncio
import math
from collections.abc import Awaitable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from servobus.bus.asyncio import AsyncBus, AsyncBusServo
from servobus.core.present import si_entry, si_register_entry
from servobus.core.registers import Motion, Register
from servobus.errors import BadValue, Held, PortError, PortLost, ServobusError, Stopped, UsageError
from servobus.families.base import Answers, Family, Model, StopOutcome, require_model
from servobus.families.motion import counts_turns
from servobus.families.present import servo_entry
from servobus.jobs.backup import Backup, compare
from servobus.jobs.look import read_table
from servobus.remote.managing import Bench
from servobus.server.web.audit import Audit
from servobus.server.web.entries import alarm_names, change_entry, latched_names, snapshot_entry, texts_of
from servobus.server.web.feeds import Events, Feed
from servobus.server.web.holders import Holder, Holders
from servobus.server.web.jobs import Jobs, ServerJob
from servobus.server.web.owner_link import SESSION, OwnerLink
from servobus.server.web.poller import LONGEST, OVERVIEW, SHORTEST, Poller, Rows
from servobus.server.web.traffic import TrafficWatch
from servobus.server.web.values import (
    Content,
    decoded,
    key_of,
    optional_row,
    raw_value,
    raws_of,
    readable_row,
    servo_of,
)

T = TypeVar("T")

WINDOW = 5.0
"""s after a stop in which nothing moves, whoever resumes."""
AGAIN = 1.0
"""s between two tries to open a port that has gone."""


@dataclass(frozen=True, slots=True)
class Actor:
    """Who asks. Without a holder one can start what ends by itself, such as a move, and nothing that goes on."""

    name: str
    holder: Holder | None = None


class ServedBus:
    """A bus of the server.

    name, port  what it is called, and what it was opened by
    gone        why the port cannot be used; "" if it can
    stopped_by  who stopped it last, until somebody resumes; "" if nobody
    """

    def __init__(
        self,
        name: str,
        port: str,
        bus: AsyncBus,
        *,
        events: Events,
        jobs: Jobs,
        audit: Audit,
        holders: Holders,
        owner: OwnerLink | None = None,
    ) -> None:
        self.name, self.port, self.bus = name, port, bus
        self.events, self.jobs, self.audit = events, jobs, audit
        self._owner, self._holders = owner, holders
        self.gone = ""
        self.stopped_by = ""
        self._stopped_at = -math.inf
        self._poller = Poller(name, bus, self._tell_servo, self._port_failed)
        self._opening: asyncio.Task[None] | None = None
        self.traffic = TrafficWatch(name, owner, self._models)
        """The packets on this bus, for those who look at them."""

    async def close(self) -> None:
        """Make safe what this bus drives, and give the port back."""
        await self._poller.close()
        if self._opening is not None:
            self._opening.cancel()
        try:
            await self.bus.make_safe(interrupt=True)
        finally:
            self.bus.close()

    # What there is

    def entry(self) -> dict[str, Any]:
        """Give the bus for JSON."""
        counts = self.bus.stats.total
        return {
            "name": self.name,
            "port": self.port,
            "gone": self.gone or None,
            "stopped_by": self.stopped_by or None,
            "servos": len(self.bus),
            "sent": counts.sent,
            "failed": counts.failed,
        }

    def servo_entries(self) -> list[dict[str, Any]]:
        return [self.servo_entry(servo) for servo in self.bus]

    def servo_entry(self, servo: AsyncBusServo) -> dict[str, Any]:
        """Give a servo for JSON, as it was seen last; nothing is asked."""
        return {
            "key": key_of(servo),
            **servo_entry(servo.family, servo.model, servo.id, servo.baud, servo.firmware),
            "title": servo.model.title,
            "state": None if servo.state is None else snapshot_entry(servo.state),
            "alarms": alarm_names(servo),
            "latched": latched_names(servo),
            "lost": self._poller.lost(servo),
            "driven": servo.permit.driven,
            "holder": None if (holder := self._holders.of(self.name, key_of(servo))) is None else holder.name,
            "restarted": servo.restarted,
            "eeprom_writes": servo.eeprom_writes,
        }

    def servo(self, key: str) -> AsyncBusServo:
        """Give a servo by its key or its id. Raises UnknownName."""
        return servo_of(self.bus, key)

    def servos(self, keys: Iterable[str] | None) -> list[AsyncBusServo]:
        """Give servos by their keys, all where none are given. Raises UnknownName."""
        return list(self.bus) if keys is None else list(dict.fromkeys(map(self.servo, keys)))

    async def look(self, key: str) -> dict[str, Any]:
        """Look at a servo now."""
        servo = self.servo(key)
        await self._asked(servo.look())
        return self.servo_entry(servo)

    def attach(self, actor: Actor, model: str, id: int, baud: int | None) -> dict[str, Any]:
        """Name a servo that is there, without asking it anything."""
        servo = self.bus.attach(model, id, baud=baud)
        self.audit.note(actor.name, "attach", self.name, key_of(servo), {"model": servo.model.key()})
        self._tell_servo("appeared", servo)
        return self.servo_entry(servo)

    def forget(self, actor: Actor, key: str) -> None:
        """Know a servo no more. Raises UsageError while it is driven."""
        servo = self.servo(key)
        self.bus.forget(servo)
        self.audit.note(actor.name, "forget", self.name, key_of(servo), {})
        self._tell_servo("forgotten", servo)

    # Registers

    def table(self, key: str) -> list[dict[str, Any]]:
        """Give the table of a servo, the rows that can be read; nothing is asked."""
        return [si_register_entry(row) for row in self.servo(key).model.registers.values() if row.readable]

    async def held(self, key: str) -> dict[Register[Any], Content]:
        """Read the whole table of a servo: each row that can be read, with what acts and what survives power-off."""
        servo = self.servo(key)
        raws = await self._asked(self.bus.do(read_table(servo.target), servo.baud))
        copied = [row for row, raw in raws.items() if raw is not None and row.place.has_working_copy]
        stored = await self._read(servo, copied, stored=True)
        return {row: Content(raw, stored.get(row)) for row, raw in raws.items()}

    async def registers(self, key: str) -> list[dict[str, Any]]:
        """Give the whole table of a servo: each row with its value, None where this servo lacks it.

        `stored` is what survives power-off, where that is a copy of its own.
        """
        return [
            {
                **si_register_entry(row),
                "now": None if held.now is None else si_entry(row, held.now),
                "stored": None if held.stored is None else si_entry(row, held.stored),
            }
            for row, held in (await self.held(key)).items()
        ]

    async def read(self, key: str, names: Sequence[str], *, stored: bool = False) -> dict[str, Any]:
        """Read registers: name -> value. `stored` gives what survives power-off."""
        servo = self.servo(key)
        rows = {name: readable_row(servo, name) for name in names}
        raws = await self._read(servo, list(dict.fromkeys(rows.values())), stored=stored)
        return {name: si_entry(row, raws[row]) for name, row in rows.items()}

    async def preview(self, key: str, values: Mapping[str, Any], *, save: bool) -> dict[str, Any]:
        """Say what a write would change, and how many values of it would go to the EEPROM. Writes nothing."""
        servo = self.servo(key)
        raws, names = raws_of(servo, values)
        old = await self._read(servo, list(raws), stored=save)
        changes = {names[row]: change_entry(row, old[row], raw) for row, raw in raws.items()}
        worn = [row for row, raw in raws.items() if servo.family.wears(row, keep=save) and old[row] != raw]
        return {"changes": changes, "eeprom_writes": len(worn)}

    async def write(self, actor: Actor, key: str, values: Mapping[str, Any], *, save: bool) -> dict[str, Any]:
        """Write registers, read them back, and give old and new values; `taken` is whether they are as asked for.

        With `save` the values survive power-off. Raises BadValue, before anything is written, if one cannot be.
        """
        servo = self.servo(key)
        raws, names = raws_of(servo, values)
        torque = servo.model.register("torque_enable")
        if any(row.motion is not None or (row is torque and raw) for row, raw in raws.items()):
            self.begin(actor, [servo])
        await self._check_watched(actor, servo, raws)
        told = servo.target.answers is not Answers.NOTHING
        old = await self._read(servo, list(raws), stored=save) if told else {}
        try:
            if save:
                await self._asked(servo.store({row: decoded(row, raw) for row, raw in raws.items()}))
            else:
                await self._asked(servo.write_raw(raws))
        except Exception as error:
            self.audit.note(actor.name, "write", self.name, key_of(servo), texts_of(raws), str(error))
            raise
        told = servo.target.answers is not Answers.NOTHING  # this may have been written
        new = await self._read(servo, list(raws), stored=save) if told else {}
        changes = {}
        for row, raw in raws.items():
            now = new.get(row)
            changes[names[row]] = {
                **change_entry(row, old.get(row), raw if now is None else now),
                "taken": None if now is None else row.took(raw, now),
            }
        refused = [name for name, one in changes.items() if one["taken"] is False]
        result = f"not taken: {', '.join(refused)}" if refused else "done"
        self.audit.note(actor.name, "write", self.name, key_of(servo), changes, result)
        return {"changes": changes, "saved": save}

    # Motion

    async def motion(self, key: str) -> dict[str, Any]:
        """Ask what a move must know of a servo: where it is, what bounds it, and how else it can turn.

        Angles in rad. `turn` is None for a servo that does not turn without end. Raises UsageError where it is not
        known which model it is.
        """
        servo = self.servo(key)
        require_model(servo.target, "be moved")
        model, family = servo.model, servo.family
        row = model.register("goal_position")
        status = await self._asked(self.bus.do(family.motion_status(servo.target), servo.baud))
        least, most = row.limits
        if several := counts_turns(servo.target, status):
            least, most = status.low, status.high
        return {
            "position": status.position,
            "torque": status.torque,
            "shutdown": status.shutdown,
            "turning": status.turning,
            "several_turns": several,
            "limits": None if status.turning else [row.decode(status.low), row.decode(status.high)],
            "range": [row.decode(least), row.decode(most)],
            "speed": model.sheet.speed if not model.generic else None,
            "turn": {"unit": model.turn_scale.unit, "stores": any(pair.equal for pair in model.limit_pairs)}
            if model.turns
            else None,
            "can_count_turns": family.multi_turn_limits(model) is not None,
        }

    def has_torque(self, key: str, enabled: Any) -> bool:
        """Tell from a value of torque_enable, as telemetry gives it, whether a servo is driven."""
        servo = self.servo(key)
        row = servo.model.register("torque_enable")
        return servo.family.torque_on(raw_value(row, enabled))

    async def move(
        self, actor: Actor, goals: Mapping[str, float], *, time: float | None, speed: float | None
    ) -> ServerJob:
        """Start a move, key -> angle in rad; the job ends when all have arrived. Breaking it off stops them."""
        servos = {self.servo(key): goal for key, goal in goals.items()}
        if len(servos) != len(goals):
            raise UsageError("one of the servos is given two goals, by its key and by its id")
        self.begin(actor, servos)
        planned = await self._asked(self.bus.start_move(servos, time=time, speed=speed))
        said = {key_of(servo): goal for servo, goal in servos.items()}
        self.audit.note(actor.name, "move", self.name, ", ".join(said), said)
        self.events.tell("moved", bus=self.name, by=actor.name, goals=said)

        async def arrive(job: ServerJob) -> dict[str, Any]:
            job.text = str(planned)
            await self._asked(self.bus.wait_arrival(planned))
            return {"arrived": True}

        job = self.jobs.start("move", self.name, actor.name, arrive)
        job.on_cancel = lambda: self.bus.cancel(planned)
        job.result = {"duration": planned.duration}
        return job

    async def stream(self, actor: Actor, goals: Mapping[str, float], time: float) -> None:
        """Give goals to servos that move already, again and again: key -> rad, to be there in `time` s."""
        servos = {self.servo(key): goal for key, goal in goals.items()}
        if actor.holder is None:
            raise UsageError("goals that come again and again are given over a connection that is watched")
        self.begin(actor, servos)
        await self._asked(self.bus.start_move(servos, time=time))

    async def torque(self, actor: Actor, keys: Iterable[str] | None, *, on: bool, to_limit: bool = False) -> None:
        """Switch torque on, where each servo stands, or off."""
        servos = self.servos(keys)
        if on:
            self.begin(actor, servos)
        said = ", ".join(map(key_of, servos))
        try:
            await self._asked(self.bus.torque_on(servos, to_limit=to_limit) if on else self.bus.torque_off(servos))
        except Exception as error:
            self.audit.note(actor.name, "torque", self.name, said, {"on": on}, str(error))
            raise
        if not on:
            self._holders.free(self.name, [key_of(servo) for servo in servos])
        self.audit.note(actor.name, "torque", self.name, said, {"on": on})
        self.events.tell("torque", bus=self.name, by=actor.name, servos=[key_of(servo) for servo in servos], on=on)

    async def turn(self, actor: Actor, key: str, **how: float | None) -> None:
        """Turn without end. Only for a client that is watched: nothing else would ever stop it."""
        servo = self.servo(key)
        if actor.holder is None:
            raise _unwatched(servo)
        self.begin(actor, [servo])
        await self._asked(servo.turn(**how))
        self._changed(actor, "turn", servo, {name: value for name, value in how.items() if value is not None})

    async def position_mode(self, actor: Actor, key: str, limits: tuple[float, float] | None, multi: bool) -> None:
        """Come back from endless turn."""
        servo = self.servo(key)
        self.begin(actor, [servo])
        await self._asked(servo.position_mode(limits, multi_turn=multi))
        self._changed(actor, "position mode", servo, {})

    async def rearm(self, actor: Actor, key: str) -> None:
        """Switch the torque on again after the servo has switched it off by itself."""
        servo = self.servo(key)
        self.begin(actor, [servo])
        await self._asked(servo.rearm())
        self._changed(actor, "rearm", servo, {})

    async def led(self, actor: Actor, key: str, colour: str) -> None:
        servo = self.servo(key)
        await self._asked(servo.led(colour))
        self._changed(actor, "led", servo, {"colour": colour})

    # Stopping

    async def stop(self, actor: Actor, keys: Iterable[str] | None = None) -> dict[str, str]:
        """Stop servos, by default all: key -> what was done. Breaks off whatever uses the line.

        Nothing moves on this bus any more before WINDOW is over and somebody resumes. Raises StopFailed, when all had
        their turn.
        """
        servos = self.servos(keys)
        self.latch(actor)
        said = [key_of(servo) for servo in servos]
        self._holders.free(self.name, said)
        try:
            if self._owner is not None:
                await self._owner.stop(self.name, () if keys is None else said)
                outcomes: Mapping[Any, Any] = dict.fromkeys(servos, "stopped")
            else:
                outcomes = await self._stop(servos)
        except Exception as error:
            self.audit.note(actor.name, "stop", self.name, ", ".join(said), {}, str(error))
            self.events.tell("stopped", bus=self.name, by=actor.name, servos=said, failed=str(error))
            raise
        self.audit.note(actor.name, "stop", self.name, ", ".join(said), {})
        self.events.tell("stopped", bus=self.name, by=actor.name, servos=said, failed=None)
        return {key_of(servo): str(outcome) for servo, outcome in outcomes.items()}

    def latch(self, actor: Actor) -> None:
        """Let nothing be moved from here any more, and break off what is under way."""
        self.stopped_by, self._stopped_at = actor.name, asyncio.get_running_loop().time()
        self.jobs.break_off(self.name)

    def follow(self, what: str, data: Mapping[str, Any]) -> None:
        """Take note of what the owner of the ports tells of this bus."""
        if what == "stopped" and data.get("servos") is None:
            by = str(data.get("by", ""))
            if by != SESSION or not self.stopped_by:  # of a stop from here it is known which person asked for it
                self.stopped_by = by
            self._stopped_at = asyncio.get_running_loop().time()
        elif what == "resumed":
            self.stopped_by, self._stopped_at = "", -math.inf
        elif what == "gone":
            self.gone = str(data.get("why", "gone"))
        elif what == "back":
            self.gone = ""

    async def take_over(self, actor: Actor, keys: Iterable[str]) -> None:
        """Hold servos that another one may hold: they are made safe first. Only for a client that is watched."""
        said = [key_of(servo) for servo in self.servos(keys)]
        if actor.holder is None:
            raise UsageError("only a client that is watched can hold servos: open /api/v1/live, and send `hold`")
        actor.holder.check()
        others = [key for key in said if self._holders.of(self.name, key) not in (None, actor.holder)]
        self._holders.free(self.name, others)
        actor.holder.driven |= {(self.name, key) for key in said}
        await self.stop_driven(others, f"{actor.name} has taken over", "taken over")

    async def stop_driven(self, keys: Iterable[str], why: str, what: str = "deadman") -> None:
        """Stop what somebody drove who is not there any more; what others drive goes on."""
        known = {key_of(servo): servo for servo in self.bus}
        servos = [known[key] for key in keys if key in known and known[key].permit.driven]
        said = [key_of(servo) for servo in servos]
        if not servos:
            return
        await self.bus._beside_the_loop(partial(self.bus.safety.make_safe, None, servos))
        moving = [key_of(servo) for servo in servos if servo.permit.driven]
        failed = f"{', '.join(moving)} may still move" if moving else None
        self.audit.note("server", what, self.name, ", ".join(said), {"why": why}, failed or "done")
        self.events.tell(what, bus=self.name, servos=said, why=why, failed=failed)

    async def resume(self, actor: Actor) -> None:
        """Let servos be moved again after a stop, once WINDOW is over. Moves nothing."""
        if self._owner is not None:
            await self._owner.resume(self.name)
        if self.stopped_by:
            self.stopped_by = ""
            self.audit.note(actor.name, "resume", self.name, "", {})
            self.events.tell("resumed", bus=self.name, by=actor.name)

    async def _stop(self, servos: Sequence[AsyncBusServo]) -> Mapping[AsyncBusServo, StopOutcome]:
        """Hold what this bus drives at once, whatever uses the line; then ask each, for others may drive it."""
        hold = partial(self.bus.safety.make_safe, "hold", servos, interrupt=True)
        await self.bus._beside_the_loop(hold)
        return await self.bus.stop(servos)

    def begin(self, actor: Actor, servos: Iterable[AsyncBusServo]) -> None:
        """Take note that somebody is about to drive servos.

        Raises Stopped if nothing is to move now, Held if somebody else holds one of them.
        """
        left = self._stopped_at + WINDOW - asyncio.get_running_loop().time()
        if self.stopped_by:
            raise Stopped(f"{self.name} was stopped by {self.stopped_by}: nothing moves until somebody resumes")
        if left > 0:
            raise Stopped(f"{self.name} was stopped: nothing moves for another {left:.1f} s")
        keys = [key_of(servo) for servo in servos]
        for key in keys:
            other = self._holders.of(self.name, key)
            if other is not None and other is not actor.holder:
                raise Held(f"{key} is held by {other.name}: wait until it is let go, or take it over", other.name)
        if actor.holder is not None:
            actor.holder.check()
            actor.holder.driven |= {(self.name, key) for key in keys}

    async def _check_watched(self, actor: Actor, servo: AsyncBusServo, raws: Mapping[Register[Any], int]) -> None:
        """Raise UsageError for a write that makes a servo turn without end, where nobody is watched meanwhile."""
        going = {row.motion for row, raw in raws.items() if raw}
        if actor.holder is not None or going.isdisjoint({Motion.MODE, Motion.SPEED}):
            return
        status = await self._asked(self.bus.do(servo.family.motion_status(servo.target), servo.baud))
        if Motion.MODE in going or status.turning:
            raise _unwatched(servo)

    # Settings that stay

    async def backup(self, key: str) -> dict[str, Any]:
        """Read all settings that survive power-off: as a file, and value by value."""
        servo = self.servo(key)
        saved = await self._asked(servo.backup())
        rows = servo.model.registers
        return {
            **servo_entry(servo.family, saved.model, saved.id, saved.baud, saved.firmware),
            "text": saved.text(),
            "settings": {name: si_entry(rows[name], raw) for name, raw in saved.values.items()},
        }

    async def preview_restore(self, key: str, text: str) -> dict[str, Any]:
        """Say what restoring a backup would change. Writes nothing."""
        servo = self.servo(key)
        found = await self._asked(self.bus.do(compare(servo.target, Backup.parse(text)), servo.baud))
        return {
            "changes": {row.name: change_entry(row, found.present[row], raw) for row, raw in found.changes.items()},
            "impossible": {row.name: why for row, why in found.impossible.items()},
            "eeprom_writes": len(found.changes),
            "torque": found.driven,
        }

    async def restore(self, actor: Actor, key: str, text: str, *, torque_off: bool) -> list[str]:
        """Write the settings of a backup that differ; gives their names. See `Servo.restore`."""
        servo = self.servo(key)
        saved = Backup.parse(text)
        names = await self._audited(actor, "restore", servo, servo.restore(saved, torque_off=torque_off))
        return list(names)

    async def change_identity(self, actor: Actor, key: str, id: int | None, baud: int | None) -> dict[str, Any]:
        """Give a servo another id, another speed, or both: first the id."""
        servo = self.servo(key)
        if id is not None:
            await self._audited(actor, f"id {id}", servo, servo.change_id(id))
        if baud is not None:
            await self._audited(actor, f"baud {baud}", servo, servo.change_baud(baud))
        self._tell_servo("appeared", servo)
        return self.servo_entry(servo)

    async def reset(self, actor: Actor, key: str, keep: Iterable[str]) -> dict[str, Any]:
        """Restore factory settings, less what is kept: "id", "baud", "calibration"."""
        servo = self.servo(key)
        await self._audited(actor, "factory reset", servo, servo.reset(keep=frozenset(keep)))
        return self.servo_entry(servo)

    async def reboot(self, actor: Actor, key: str) -> None:
        servo = self.servo(key)
        await self._audited(actor, "reboot", servo, servo.reboot())

    # Virtual servos

    async def bench(self) -> Bench:
        """Give the virtual servos of this bus, and what surrounds them. Raises UsageError for a bus of real ones."""
        return await self._with_owner().bench(self.name)

    async def set_bench(self, actor: Actor, servos: Iterable[int] = (), **changes: Any) -> Bench:
        """Change what surrounds virtual servos, by number, or all. Raises BadValue, UsageError."""
        del actor  # nobody's servo is told anything: what surrounds it is everybody's
        return await self._with_owner().set_bench(self.name, servos=tuple(servos), **changes)

    def _with_owner(self) -> OwnerLink:
        if self._owner is None:
            raise UsageError(f"the bench of {self.name} is where its port is open, and here it is not")
        return self._owner

    # Telemetry

    def subscribe(self, feed: Feed, wanted: Mapping[str, Sequence[str]] | None, period: float) -> None:
        """Read registers for a client again and again: key -> names, or an overview of all servos.

        Raises UnknownName, BadValue.
        """
        if not SHORTEST <= period <= LONGEST:
            raise BadValue(f"period {period:g} s is not in {SHORTEST:g} .. {LONGEST:g} s")
        if wanted is None:
            self._poller.subscribe(feed, self._overview, period)
            return
        rows = {
            self.servo(key): [readable_row(self.servo(key), name) for name in names] for key, names in wanted.items()
        }
        self._poller.subscribe(feed, lambda: {servo: some for servo, some in rows.items() if servo in self.bus}, period)

    def unsubscribe(self, feed: Feed) -> None:
        self._poller.unsubscribe(feed)

    def _overview(self) -> Mapping[AsyncBusServo, Rows]:
        return {
            servo: [row for name in OVERVIEW if (row := optional_row(servo, name)) is not None and row.readable]
            for servo in self.bus
        }

    # Helpers

    def _models(self) -> list[tuple[Family, int, type[Model]]]:
        return [(one.family, one.id, one.model) for one in self.bus]

    async def _read(
        self, servo: AsyncBusServo, rows: Sequence[Register[Any]], *, stored: bool
    ) -> dict[Register[Any], int]:
        if not rows:
            return {}
        family = servo.family
        job = family.read_stored(servo.target, rows) if stored else family.read(servo.target, rows)
        return dict(zip(rows, await self._asked(self.bus.do(job, servo.baud)), strict=True))

    async def _audited(self, actor: Actor, what: str, servo: AsyncBusServo, work: Awaitable[T]) -> T:
        """Carry out a change of settings, and take note of what came of it."""
        key = key_of(servo)
        try:
            result = await self._asked(work)
        except Exception as error:
            self.audit.note(actor.name, what, self.name, key, {}, str(error))
            raise
        self.audit.note(actor.name, what, self.name, key, {"names": result} if isinstance(result, list) else {})
        self.events.tell("changed", bus=self.name, by=actor.name, servo=key, now=key_of(servo), change=what)
        return result

    async def _asked(self, work: Awaitable[T]) -> T:
        try:
            return await work
        except PortLost as error:
            self._port_failed(error)
            raise

    def _changed(self, actor: Actor, what: str, servo: AsyncBusServo, values: Mapping[str, Any]) -> None:
        self.audit.note(actor.name, what, self.name, key_of(servo), values)
        self.events.tell("changed", bus=self.name, by=actor.name, servo=key_of(servo), now=key_of(servo), change=what)

    def _tell_servo(self, what: str, servo: AsyncBusServo) -> None:
        self.events.tell(what, bus=self.name, servo=key_of(servo), alarms=alarm_names(servo))

    def _port_failed(self, error: PortError) -> None:
        """Say that the port has gone, and try to open it again until it is back."""
        if self.gone:
            return
        self.gone = str(error)
        self.events.tell("port gone", bus=self.name, why=self.gone)
        self._opening = asyncio.ensure_future(self._open_again())

    async def _open_again(self) -> None:
        while self.gone:
            await asyncio.sleep(AGAIN)
            try:
                await self.bus.reopen()
            except PortError:
                continue
            except ServobusError:
                pass  # the port is there, though some servo on it is not
            self.gone = ""
            self.events.tell("port back", bus=self.name)


def _unwatched(servo: AsyncBusServo) -> UsageError:
    return UsageError(
        f"{servo.target}: endless turn needs a client that is watched: open /api/v1/live, send `hold`, and name that "
        "connection in the header Servobus-Connection"
    )
