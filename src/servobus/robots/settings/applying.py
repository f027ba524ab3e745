"""Writing the settings of a robot file to its servos, and bringing back what was there before.

One servo after the other: what it holds is kept in a file, then it is written to and read back, then that is noted. So
a program that is killed, or a cable that is pulled, leaves servos that are as before, servos that are as the file says,
and at most one in between, whose backup is kept. `apply` again does the rest, `undo` brings back what was before.

Nothing moves: the torque of a servo that is written to is off.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus.base import BaseBus
from servobus.bus.servo import Servo, under_new_policy
from servobus.core.exchange import Job, Procedure, SetBaud
from servobus.core.registers import Register
from servobus.core.units import said as said_value
from servobus.core.values import frozen, replace
from servobus.errors import NotRestored, ServobusError, UsageError
from servobus.families.base import Answers, policy_register
from servobus.families.change import said, set_registers
from servobus.jobs.backup import Backup, backup, compare, restore
from servobus.jobs.make_safe import let_go
from servobus.robots.joints.joint import Joint
from servobus.robots.settings.backups import Backups, Before, Run, file_key
from servobus.robots.settings.planning import Plan, ServoSettings, Setting
from servobus.robots.steps import RobotJob, each

T = TypeVar("T")


@frozen
class Applied:
    """What became of a plan: what was written to which servo, and the folder with the backups."""

    written: Mapping[str, tuple[str, ...]]
    """Servo, for people -> names of the registers."""
    run: Run


def on(port: str, job: Job[T]) -> RobotJob[T]:
    """Carry out a job on one port. Raises what it raises."""
    (outcome,) = (yield from each({port: job})).values()
    if isinstance(outcome, ServobusError):
        raise outcome
    result: T = outcome
    return result


def apply(
    plan: Plan, joints: Sequence[Joint], backups: Backups, *, torque_off: bool = False, offsets: bool = False
) -> RobotJob[Applied]:
    """Write what differs by a plan, and read it back.

    torque_off  whether to switch the torque off of servos that are written to
    offsets     whether to write offsets of servos too, where the file names them

    Raises UsageError, before anything is written, where the torque of a servo is on and shall stay so. Where one servo
    fails the others have their turn all the same; then NotRestored names those that are not as the file says.
    """
    servos = {(one.joint, n): part.servo for one, n, part in _numbered(plan, joints)}
    todo = [(one, n) for one, n, _ in _numbered(plan, joints) if one.to_write(offsets=offsets)]
    if not torque_off and (driven := [one for one, _ in todo if one.driven]):
        who = ", ".join(one.who for one in driven)
        raise UsageError(
            f"the torque of {who} is on, and settings can move a servo: switch it off first, or say torque_off=True "
            "or --torque-off; nothing was written"
        )
    run = backups.open_run()
    written: dict[str, tuple[str, ...]] = {}
    failed: dict[str, str] = {one.who: one.problem for one in plan.servos if one.problem}
    for one, n in todo:
        servo, settings = servos[one.joint, n], one.to_write(offsets=offsets)
        try:
            saved = yield from on(one.port, _saved(servo))
            kept = [setting.row.name for setting in settings if setting.kept]
            ram = {setting.row.name: setting.now for setting in settings if not setting.kept}
            run.begin(one.joint, n, one.port, saved, kept, ram)
            yield from on(one.port, write_settings(servo, settings, torque_off=torque_off))
            run.end(one.joint, n)
        except ServobusError as error:
            failed[one.who] = str(error)
            continue
        written[one.who] = tuple(setting.row.name for setting in settings)
    for one, n, part in _numbered(plan, joints):
        if one.who not in failed:
            backups.keep_last(one.joint, n, (yield from on(one.port, _saved(part.servo))))
    for one in plan.servos:
        for name, why in one.impossible.items():
            failed.setdefault(one.who, f"{name} stays: {why}")
    if failed:
        if run.unfinished == 0:
            backups.close_run(run)
        done = f"written to {', '.join(written)}" if written else "nothing was written"
        rest = "; ".join(f"{who}: {why}" for who, why in failed.items())
        raise NotRestored(f"{plan.name}: {done}; not as the file says: {rest}", list(written), failed)
    backups.close_run(run)
    return Applied(written, run)


def _numbered(plan: Plan, joints: Sequence[Joint]) -> list[tuple[ServoSettings, int, Any]]:
    """Give the servos of a plan that could be compared, with their number in their joint and their part of it."""
    parts = [(n, part) for joint in joints for n, part in enumerate(joint.parts)]
    return [(one, n, part) for one, (n, part) in zip(plan.servos, parts, strict=True) if not one.problem]


def _saved(servo: Servo) -> Procedure[Backup]:
    yield SetBaud(servo.baud)
    return (yield from backup(servo.target, servo.firmware, servo.baud))


def write_settings(servo: Servo, settings: Sequence[Setting], *, torque_off: bool = False) -> Procedure[None]:
    """Write settings to a servo and read them back; which requests it answers comes last.

    Raises UsageError if its torque is on and shall stay so, NotRestored with what it did not take.
    """
    yield SetBaud(servo.baud)
    wanted = {one.row: one.wanted for one in settings if one.wanted is not None}
    kept = {one.row.name: wanted[one.row] for one in settings if one.kept and one.row in wanted}
    ram = {row: raw for row, raw in wanted.items() if row.name not in kept}
    yield from _write_ram(servo, ram, torque_off=torque_off)
    if kept:
        saved = Backup(servo.model, servo.firmware, servo.id, servo.baud, kept)
        yield from restore_servo(servo, saved, torque_off=torque_off)
    if kept and ram and servo.target.answers is not Answers.NOTHING:
        yield from _read_back(servo, ram)  # it may have restarted meanwhile


def restore_servo(servo: Servo, saved: Backup, *, torque_off: bool = False) -> Procedure[list[str]]:
    """Write the settings of a backup that differ; see `Servo.restore`."""
    yield SetBaud(servo.baud)
    policy = policy_register(servo.model)
    level = None if policy is None else saved.values.get(policy.name)
    changed = {policy: level} if policy is not None and level is not None and policy.accepts(level) else {}
    return (yield from under_new_policy(servo, changed, restore(servo.target, saved, torque_off=torque_off)))


def _write_ram(servo: Servo, values: Mapping[Register[Any], int], *, torque_off: bool) -> Procedure[list[str]]:
    """Write what differs of these RAM registers, and read it back; gives their names."""
    if not values:
        return []
    there = yield from servo.family.read(servo.target, list(values))
    differs = {row: raw for (row, raw), now in zip(values.items(), there, strict=True) if not row.took(raw, now)}
    if not differs:
        return []
    if (yield from servo.family.read_torque(servo.target)).on:
        if not torque_off:
            raise UsageError(f"{servo.target}: its torque is on, and settings can move it; nothing was written to it")
        yield from let_go(servo.target)
    yield from set_registers(servo.target, differs)
    yield from _read_back(servo, differs)
    return [row.name for row in differs]


def _read_back(servo: Servo, values: Mapping[Register[Any], int]) -> Procedure[None]:
    now = yield from servo.family.read(servo.target, list(values))
    wrong = {
        row.name: f"{said(row, values[row])} was not taken, it is {row.said(raw)}"
        for row, raw in zip(values, now, strict=True)
        if not row.took(values[row], raw)
    }
    if wrong:
        raise NotRestored(f"{servo.target}: {'; '.join(wrong.values())}", [], wrong)


def undo(
    buses: Mapping[str, BaseBus[Any]], backups: Backups, *, torque_off: bool = False
) -> RobotJob[dict[str, list[str]]]:
    """Bring back what the servos held before the last run that was not undone; gives servo -> names of registers.

    The same again goes back one run further. Raises UsageError if there is none, or if the torque of a servo is on;
    then nothing is written. Where one servo fails the others have their turn; then NotRestored is raised, and the same
    again does the rest.
    """
    run = backups.latest()
    if run is None:
        raise UsageError(f"{backups.folder}: there is no run that could be undone")
    before = run.servos()
    for one in before:
        if one.port not in buses:
            raise UsageError(f"{run.folder}: the robot file has no port {said_value(one.port)} any more")
    servos = {one.key: buses[one.port].attach(one.backup.model, one.backup.id, baud=one.backup.baud) for one in before}
    failed: dict[str, str] = {}
    driven: list[str] = []
    for one in before:
        try:
            if (yield from on(one.port, _would_move(servos[one.key], one))):
                driven.append(_who(one))
        except ServobusError as error:
            failed[_who(one)] = str(error)
    if driven and not torque_off:
        raise UsageError(
            f"the torque of {', '.join(driven)} is on, and settings can move a servo: switch it off first, or say "
            "torque_off=True or --torque-off; nothing was written"
        )
    run.mark("being undone")
    restored: dict[str, list[str]] = {}
    for one in before:
        if _who(one) in failed:
            continue
        try:
            restored[_who(one)] = yield from on(one.port, _bring_back(servos[one.key], one, torque_off=torque_off))
        except ServobusError as error:
            failed[_who(one)] = str(error)
            continue
    if failed:
        rest = "; ".join(f"{who}: {why}" for who, why in failed.items())
        raise NotRestored(f"not brought back: {rest}; the same again does the rest", list(restored), failed)
    run.mark("undone")
    return restored


def _who(one: Before) -> str:
    return f"{file_key(one.joint, one.n)} ({one.backup.model.named(f'id {one.backup.id}')} on {one.port})"


def _would_move(servo: Servo, one: Before) -> Procedure[bool]:
    """Tell whether a servo has torque and something of it is to be written."""
    yield SetBaud(servo.baud)
    if not (yield from servo.family.read_torque(servo.target)).on:
        return False
    found = yield from compare(servo.target, _written(one))
    rows = {servo.model.register(name): raw for name, raw in one.ram.items()}
    now = yield from servo.family.read(servo.target, list(rows)) if rows else _nothing()
    return bool(found.changes) or list(now) != list(rows.values())


def _nothing() -> Procedure[list[int]]:
    yield from ()
    return []


def _written(one: Before) -> Backup:
    """Give what a run has changed, as it was before."""
    return replace(one.backup, values={name: one.backup.values[name] for name in one.names})


def _bring_back(servo: Servo, one: Before, *, torque_off: bool) -> Procedure[list[str]]:
    yield SetBaud(servo.baud)
    ram = {servo.model.register(name): raw for name, raw in one.ram.items()}
    names = yield from _write_ram(servo, ram, torque_off=torque_off)
    return names + (yield from restore_servo(servo, _written(one), torque_off=torque_off))
