"""A servo: its id, its model, and the jobs one can ask of it.

`Servo` builds jobs and performs none. The drivers bind it: on their servos each operation carries its job
out and gives the result, or an awaitable of it.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext, suppress
from enum import IntFlag
from typing import Any, TypeVar

from servobus.bus.meant_registers import by_row, own_row, own_rows
from servobus.core.arguments import check_baud
from servobus.core.closed import Closed
from servobus.core.exchange import Exchange, Job, Procedure
from servobus.core.ids import check_id
from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.registers import Register
from servobus.core.units import Flags
from servobus.core.values import replace
from servobus.errors import BusError, NotRestored, Restarted, UsageError
from servobus.families.base import (
    Answers,
    Family,
    KnownServo,
    Model,
    ServoRef,
    StopOutcome,
    policy_register,
)
from servobus.families.record import MotionPermit, SafeAction, ServoRecord, check_max_step
from servobus.jobs import endless_turn, reconfigure
from servobus.jobs.backup import Backup, backup, restore
from servobus.jobs.look import Snapshot, identify_at, look, verify
from servobus.jobs.make_safe import give_back, let_go, stop
from servobus.jobs.move import PlannedMove, goal_from_here, plan_and_start
from servobus.jobs.torque import rearm, torque_on
from servobus.safety.safe_stop import check_safe_action

T = TypeVar("T")
V = TypeVar("V")


class Servo(Closed):
    """One servo on a bus.

    `state` is what was last seen of it (None before the first look), `alarms` the alarm bits of its last
    reply, `latched` all that were seen since it was last rearmed. Printing a servo shows them; it asks nothing.
    `record` is what was written to it, `permit` whether and how far it may be moved.
    """

    def __init__(self, target: KnownServo, firmware: str = "") -> None:
        self.target = target
        self.firmware = firmware
        self.state: Snapshot | None = None
        self.alarms: int = 0
        self.latched: int = 0
        self.on_new_id: Callable[[int, int], None] = _nothing
        """Is told the old and the new id when `change_id` has changed it."""
        self._asked: ServoRef | None = None
        self._questions: dict[Register[Any] | str, Exchange[Any]] = {}
        """Questions for single registers, made when first asked, for `_asked`."""
        self._close()

    @property
    def id(self) -> int:
        return self.target.id

    @property
    def baud(self) -> int:
        """Speed at which it is spoken to, bit/s; `change_baud` sets it."""
        return self.target.baud

    @property
    def record(self) -> ServoRecord:
        """What was written to it: EEPROM writes, and what its RAM should hold."""
        return self.target.record

    @property
    def permit(self) -> MotionPermit:
        """Whether, how fast and how far it may be moved, and whether it is being moved."""
        return self.target.permit

    @property
    def model(self) -> type[Model]:
        return self.target.model

    @property
    def family(self) -> Family:
        return self.target.model.family

    @property
    def eeprom_writes(self) -> int:
        """Values that were really written to the EEPROM; those it had already are not among them."""
        return self.record.eeprom_writes

    @property
    def restarted(self) -> bool:
        """Whether `verify` found that it lost its RAM; until `torque_on` or `rearm` it is not moved."""
        return self.record.restarted

    @property
    def max_step(self) -> float | None:
        """Farthest that one goal may lie from where the servo is, rad; None for no limit.

        Goals beyond it are refused with BadValue, by moves and by writes of a goal position.
        """
        return self.permit.max_step

    @max_step.setter
    def max_step(self, step: float | None) -> None:
        self.permit.max_step = check_max_step(step)

    @property
    def safe_action(self) -> SafeAction:
        """What is done with the servo on Ctrl-C, SIGTERM, a crash, or a trip of the watch, if this bus has driven it.

        "hold" ends its motion and holds the present position, "free" switches the torque off, "brake" shorts its motor
        (HerkuleX only; UsageError elsewhere).
        """
        return self.permit.safe_action or "hold"

    @safe_action.setter
    def safe_action(self, action: SafeAction) -> None:
        self.permit.safe_action = check_safe_action(action, [self.target])

    # Who and what

    @bus_method
    def ping(self) -> Job[None]:
        """Ask whether the servo is there. Raises NoReply."""
        return self.family.ping(self.id)

    @bus_method
    def look(self) -> Procedure[Snapshot]:
        """Read position, voltage, temperature and torque; the result is kept in `state`."""
        self.state = yield from look(self.target)
        return self.state

    @bus_method
    def read_alarms(self) -> Procedure[int]:
        """Ask which alarms stand now; they are kept in `alarms` and `latched` too.

        No packet of an LX-16A tells them: its temperature and supply are compared with its limits there.
        """
        alarms = yield from self.family.read_alarms(self.target)
        self.note_alarms(alarms)
        return self.alarms

    def note_alarms(self, alarms: int) -> None:
        """Take note of the alarm bits of a reply."""
        self.alarms = alarms and self.family.known_alarms(self.model, alarms)
        self.latched |= self.alarms

    def clear_latched(self) -> None:
        """Forget the alarms that are over. Asks nothing, and clears nothing in the servo; `rearm` does."""
        self.latched = self.alarms

    @bus_method
    def verify(self) -> Procedure[None]:
        """Make sure that the servo still has in RAM what was written there, the torque included.

        Raises Restarted if not. Then it is not moved until `torque_on` or `rearm`. Only writes of this object are
        known; without any there is nothing to tell a restart by.
        """
        try:
            yield from verify(self.target)
        except Restarted:
            self.state = None
            yield from self._meet_again(self.id)
            raise

    # Registers

    @bus_method
    def read(self, register: Register[T] | str) -> Job[T]:
        """Read one register, in its unit: `servo.read(RX28.present_position)` gives radians.

        Here and everywhere a name or an alias stands for the register: `servo.read("present_position")`.
        """
        if self._asked is not self.target:
            self._asked, self._questions = self.target, {}
        try:
            question = self._questions.get(register)
        except TypeError:  # a list, perhaps
            raise UsageError(f"read() reads one register, not {register!r:.60}; read_many() reads several") from None
        if question is None:
            question = self._questions[register] = self.family.question(self.target, own_row(self.model, register))
        return question

    @bus_method
    def read_many(self, registers: Iterable[Register[Any] | str] | Register[Any] | str) -> Procedure[dict[str, Any]]:
        """Read several registers in as few exchanges as possible; gives name -> value."""
        rows = own_rows(self.model, registers)
        values = yield from self.family.read(self.target, rows)
        return {row.name: row.decode(raw, self.target) for row, raw in zip(rows, values, strict=True)}

    @bus_method
    def read_raw(self, registers: Iterable[Register[Any] | str] | Register[Any] | str) -> Procedure[list[int]]:
        """Read several registers as raw integers."""
        return self.family.read(self.target, own_rows(self.model, registers))

    @bus_method
    def write(self, register: Register[T] | str, value: T) -> Procedure[None]:
        """Write one register so that it acts at once. Raises BadValue before anything is sent.

        What moves the servo obeys the rules of moves: it needs torque, limits and `max_step` hold, and the servo counts
        as driven. A setting that would move a servo with torque as a side effect is a UsageError.

        A register in EEPROM is read first, and written only if it differs; after ten writes within a minute
        EepromWear is raised.
        """
        row = own_row(self.model, register)
        return self._write({row: row.encode(value)})

    @bus_method
    def write_many(self, values: Mapping[Any, Any]) -> Procedure[None]:
        """Write several registers in as few exchanges as possible. Raises BadValue before anything is sent."""
        return self._write({row: row.encode(value) for row, value in by_row(self.target, values).items()})

    @bus_method
    def write_raw(self, values: Mapping[Any, int]) -> Procedure[None]:
        """Write raw integers. Raises BadValue before anything is sent."""
        return self._write({row: row.check(raw) for row, raw in by_row(self.target, values).items()})

    @bus_method
    def store(self, values: Mapping[Any, Any]) -> Procedure[None]:
        """Write registers so that they survive power-off. Raises BadValue before anything is sent."""
        return self._write({row: row.encode(value) for row, value in by_row(self.target, values).items()}, keep=True)

    # Motion

    @bus_method
    @urgent(Priority.MOTION)
    def start_move(
        self, angle: float, *, time: float | None = None, speed: float | None = None
    ) -> Procedure[PlannedMove]:
        """Start a move and give what is needed to wait for its end; see `move`."""
        return plan_and_start({self.target: angle}, time=time, speed=speed)

    @bus_method
    @urgent(Priority.MOTION)
    def start_move_by(
        self, angle: float, *, time: float | None = None, speed: float | None = None
    ) -> Procedure[PlannedMove]:
        """Start a move by an angle in rad from where the servo is, and give what is needed to wait for its end."""
        goal = yield from goal_from_here(self.target, angle)
        return (yield from plan_and_start({self.target: goal}, time=time, speed=speed))

    @bus_method
    @urgent(Priority.MOTION)
    def torque_on(self, *, to_limit: bool = False, speed: float | None = None) -> Procedure[None]:
        """Switch the torque on; the goal becomes the present position first, so that nothing moves.

        Raises TorqueOff if the servo keeps its torque off, as after an alarm: `rearm` brings it back. Raises
        OutsideLimits if it stands outside the limits set in it and would run to the nearest; with `to_limit` it is
        brought there at `speed` in rad/s (TO_LIMIT_SPEED by default), and the call ends when it is there.
        """
        yield from torque_on(self.target, to_limit=to_limit, speed=speed)

    @bus_method
    @urgent(Priority.MOTION)
    def torque_off(self) -> Procedure[None]:
        """Switch the torque off: the shaft turns freely. Raises BusError if nothing shows that it is off."""
        return let_go(self.target)

    @bus_method
    @urgent(Priority.MOTION)
    def rearm(self, *, to_limit: bool = False, speed: float | None = None) -> Procedure[None]:
        """Switch the torque on again after the servo itself has switched it off, by the rule of its family.

        Nothing moves: the goal becomes the present position first. Raises Refused, with the alarms as `flags`, if the
        cause is still there; then the torque stays off. Outside its limits it is as with `torque_on`.
        """
        yield from rearm(self.target, to_limit=to_limit, speed=speed)
        self.note_alarms((yield from self.family.read_alarms(self.target)))
        self.latched = self.alarms
        self.record.restarted = False

    @bus_method
    @urgent(Priority.STOP)
    def stop(self) -> Procedure[StopOutcome]:
        """End the motion: hold the present position, or else switch the torque off. Gives what was done, in words.

        The torque goes off where the servo stands more than 2° outside its limits, or where holding it fails: an answer
        is lost or makes no sense, or it refuses. Raises BusError, NoReply among them, only if nothing shows that even
        this has arrived: then it may still move. One whose torque is off already is left so.
        """
        outcome = yield from stop(self.target)
        if not outcome.let_go:
            yield from give_back(self.target)
        return outcome

    @bus_method
    @urgent(Priority.MOTION)
    def turn(
        self, *, speed: float | None = None, output: float | None = None, current: float | None = None
    ) -> Procedure[None]:
        """Turn without end: `speed` in rad/s, `output` as a share -1 .. 1, or `current` in A, whichever it controls.

        HerkuleX and Dynamixel MX control the speed, LX, AX, RX and EX servos the output, the DX series does not turn
        without end. MX-64 and MX-106 control the current too, and push with it against whatever holds the shaft. The
        torque must be on already. Raises TorqueOff, BadValue or UsageError before anything moves.
        """
        return endless_turn.turn(self.target, speed=speed, output=output, current=current)

    @bus_method
    @urgent(Priority.MOTION)
    def position_mode(self, limits: tuple[float, float] | None = None, *, multi_turn: bool = False) -> Procedure[None]:
        """Come back from `turn`, or from several turns to one, and hold the present position: nothing moves.

        Dynamixel servos turn without end because their angle limits are 0; `limits` (rad) are the ones to set again,
        the full range by default. With `multi_turn` the goals of an MX servo lie up to seven turns either way from now
        on. Its angles are counted from multi_turn_offset then, in units that resolution_divider makes larger: with a
        divider of 2, what reads as 90° are 180° of the shaft. Without `multi_turn` it goes back to one turn.

        Dynamixel and LX servos, which endless turn at speed 0 does not hold, are without torque for a moment. Raises
        OutsideLimits, before anything is written, if the servo would run to one of these limits.
        """
        return endless_turn.position_mode(self.target, limits, multi_turn=multi_turn)

    @bus_method
    def led(self, colour: str) -> Procedure[None]:
        """Set the light: "on", "off", or a colour where the model has one."""
        return self.family.led(self.target, colour)

    # Identity and life

    @bus_method
    def reboot(self) -> Procedure[None]:
        """Restart the servo: RAM registers get their start values, torque goes off."""
        yield from reconfigure.reboot(self.target)
        self.permit.mark_idle()
        yield from self._meet_again(self.id)

    @bus_method
    def reset(self, *, keep: frozenset[str] = frozenset()) -> Procedure[None]:
        """Restore factory settings, less what is kept ("id", "baud", "calibration").

        Raises UsageError if another servo has the factory id that this one would get.
        """
        self.family.check_reset(self.target, keep)
        before = yield from reconfigure.read_settings(self.target)
        was = f"it was id {self.id} at {self.baud} baud before; its settings as they were are in `before` of this error"
        with reconfigure.telling_before(before, was):
            end = yield from reconfigure.reset(self.target, keep)
            self._follow(end.id, end.baud)
            self.record.forget()
            self.permit.mark_idle()
            yield from self._meet_again(self.id)

    @bus_method
    def change_id(self, id: int) -> Procedure[None]:
        """Give the servo another id. Raises UsageError if some servo answers to it already.

        If the line fails on the way the servo is looked for under both ids: BusError says that it has the old one,
        NoReply that it has neither. The id here is the one under which it was found. A model that was remembered for
        the old id goes along.
        """
        old = self.id
        yield from reconfigure.change_id(self.target, check_id(id))
        self._follow(id, self.baud)
        if id != old:
            self.on_new_id(old, id)

    @bus_method
    def change_baud(self, baud: int) -> Procedure[None]:
        """Set the servo to another speed and check that it answers there; see `change_id` for a line that fails."""
        old = self.baud
        self._follow(self.id, (yield from reconfigure.change_baud(self.target, check_baud(baud))))
        said = f"it talks at {self.baud} baud now, and talked at {old} before: change_baud({old}) undoes that"
        with reconfigure.telling_before({"baud": old}, said) if self.baud != old else nullcontext():
            yield from self._meet_again(self.id)

    @bus_method
    def backup(self) -> Procedure[Backup]:
        """Read all settings that survive power-off."""
        return backup(self.target, self.firmware, self.baud)

    @bus_method
    def restore(self, saved: Backup, *, torque_off: bool = False) -> Procedure[list[str]]:
        """Write the settings of a backup that differ; gives their names. Id and speed stay as they are.

        It moves nothing: settings can move a servo that holds (limits, offset, gains), so the torque must be off, or
        `torque_off` switches it off first. The angles that are read may change with an offset; the shaft stays.

        Raises UsageError for a backup of another model, or if the torque is on, before anything is written; and
        NotRestored, when all the rest is written, with the settings that the servo cannot have or did not take. Which
        requests the servo answers is set last.
        """
        given: object = saved
        if not isinstance(given, Backup):
            raise UsageError(f"restore() takes a Backup, as Backup.parse(text) gives, not {given!r:.60}")
        policy = policy_register(self.model)
        level = None if policy is None else saved.values.get(policy.name)
        wanted = {policy: level} if policy is not None and level is not None and policy.accepts(level) else {}
        return (yield from under_new_policy(self, wanted, restore(self.target, saved, torque_off=torque_off)))

    # Printing

    def alarm_text(self) -> str:
        """Say the alarms of the last reply: "overheating+overload", or "" if there are none."""
        return self._flags_text(self.alarms)

    def __str__(self) -> str:
        text = f"{self.target} at {self.baud}"
        if self.state is not None:
            text += f": {self.state}"
        if self.alarms:
            text += f", ALARM {self.alarm_text()}"
        if over := self.latched & ~self.alarms:
            text += f", had ALARM {self._flags_text(over)}"
        if self.restarted:
            text += ", RESTARTED"
        return text

    def __repr__(self) -> str:
        return f"<{self}>"

    def _no_attribute(self, name: str) -> str:
        """Say what to do instead of setting this attribute: most often a register is meant."""
        verb = {"id": "change_id(...)", "baud": "change_baud(...)"}.get(name)
        if verb is not None:
            return f"{self.target}: {name} is not set like this; use servo.{verb}"
        row = self.model.registers.get(self.model.aliases.get(name, name))
        example = f"servo.write({self.model.__name__}.{'goal_position' if row is None else row.name}, ...)"
        if row is not None:
            return f"{self.target}: to write a register: {example}; nothing was sent"
        if hasattr(type(self), name):
            return f"{self.target}: {name} cannot be set; to write a register: {example}"
        return f"{self.target} has no attribute {name!r}; to write a register: {example}"

    def _no_such_attribute(self, name: str) -> str:
        """Say how a register is read that was taken for an attribute."""
        row = self.model.registers.get(self.model.aliases.get(name, name))
        if row is None:
            return f'{self.target} has no attribute {name!r}; to read a register: servo.read("present_position")'
        return f'{self.target}: to read a register: servo.read("{name}"); nothing was asked'

    def _meet_again(self, id: int) -> Procedure[None]:
        """Learn by what policy the servo answers now that it may have restarted."""
        identity = yield from identify_at(self.family, id, self.baud)
        self.target = replace(self.target, id=id, answers=identity.answers)

    def _follow(self, id: int, baud: int) -> None:
        """Take note of where the servo is now."""
        self.target = replace(self.target, id=id, baud=baud)

    @staticmethod
    def _flags_text(flags: int) -> str:
        if not flags:
            return ""
        return Flags(type(flags)).show(flags) if isinstance(flags, IntFlag) else hex(flags)

    def _no_identity(self, registers: Iterable[Register[Any]]) -> None:
        """Refuse what would lose the servo. Raises UsageError."""
        verbs = {self.model.register("id"): "change_id", self.model.optional("baud"): "change_baud"}
        for register in registers:
            if verb := verbs.get(register):
                raise UsageError(
                    f"{self.target}: a write of {register.name} would lose the servo; use {verb}(), "
                    "which makes sure that it is found again"
                )

    def _write(self, raw: Mapping[Register[Any], int], *, keep: bool = False) -> Procedure[None]:
        self._no_identity(raw)
        torque = self.model.register("torque_enable")
        write = self.family.store if keep else self.family.write
        yield from under_new_policy(self, raw, write(self.target, raw))
        if torque in raw and not self.family.torque_on(raw[torque]):
            self.permit.mark_idle()


def under_new_policy(servo: Servo, raw: Mapping[Register[Any], int], job: Procedure[T]) -> Procedure[T]:
    """Carry out a job that may set which requests a servo answers; from its end on answers are expected so.

    The values are raw: those that the job may write. Without the register for it among them nothing is special.
    """
    policy = policy_register(servo.model)
    if policy is None or policy not in raw:
        return (yield from job)
    try:
        result = yield from job
    except (BusError, NotRestored):
        # Nothing tells whether the policy was written before the failure: ask, and if that fails too, stay.
        with suppress(BusError):
            yield from servo._meet_again(servo.id)
        raise
    servo.target = replace(servo.target, answers=Answers(raw[policy]))
    return result


def _nothing(_old: int, _new: int) -> None:
    """Take no note of a new id."""
