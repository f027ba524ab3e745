"""Endless turn, and the way back to holding a position."""

import math
from typing import Any

from servobus.core.exchange import Procedure
from servobus.core.registers import Register
from servobus.errors import BadValue, UsageError
from servobus.families.base import KnownServo, check_output, require_model, require_turning
from servobus.families.change import value
from servobus.jobs.reconfigure import telling_before


def turn(target: KnownServo, *, speed: float | None, output: float | None, current: float | None) -> Procedure[None]:
    """Turn without end; see `Servo.turn`.

    Where that overwrites the angle limits, an error that breaks it off half-way tells what they were.
    """
    family, model = target.model.family, target.model
    require_turning(target)
    if current is not None:
        if speed is not None or output is not None:
            raise UsageError(f"{target}: current= goes without speed= and output=")
        yield from family.turn_by_current(target, current)
        return
    if speed is None and output is None:
        example = "speed=20 * rpm" if model.turns_at_speed() else "output=0.3"
        raise UsageError(f"{target}: say how fast, as in turn({example})")
    lost: dict[Register[Any], int] = {}
    overwrites = [pair.rows(model) for pair in model.limit_pairs if pair.equal]
    if output is not None:
        check_output(output)  # before anything is asked
    for low, high in overwrites:
        raws = yield from family.read_stored(target, [low, high])
        if raws != [0, 0]:
            lost |= dict(zip((low, high), raws, strict=True))
    if not lost:
        yield from family.turn(target, speed=speed, output=output)
        return
    ends = [math.degrees(value(row, raw)) for row, raw in lost.items()]
    said = " .. ".join(row.said(raw) for row, raw in lost.items())
    call = f"position_mode(({ends[0]:.1f} * deg, {ends[1]:.1f} * deg))"
    if tuple(lost.values()) == family.multi_turn_limits(model):
        call = "position_mode(multi_turn=True)"
    text = (
        f"its angle limits were {said} before, and may be 0 now, which is endless turn: "
        f"{call} ends that and sets them again"
    )
    with telling_before({row.name: value(row, raw) for row, raw in lost.items()}, text):
        yield from family.turn(target, speed=speed, output=output)


def position_mode(target: KnownServo, limits: tuple[float, float] | None, *, multi_turn: bool) -> Procedure[None]:
    """Come back from endless turn; `limits` in rad are those to set again; see `Servo.position_mode`."""
    require_model(target, "count its angles over several turns" if multi_turn else "come back from endless turn")
    raw = None
    if multi_turn:
        raw = target.model.family.multi_turn_limits(target.model)
        if raw is None or limits is not None:
            why = "its limits cannot say so" if raw is None else "limits= are those of one turn"
            raise UsageError(f"{target} cannot count its goals over several turns: {why}")
    elif limits is not None:
        given: object = limits
        if not isinstance(given, tuple | list) or len(given) != 2:
            raise UsageError(f"limits {given!r:.60} are not two angles, as in (20 * deg, 280 * deg)")
        low, high = (target.model.register(name) for name in ("min_position", "max_position"))
        raw = low.encode(limits[0]), high.encode(limits[1])
        if raw[0] >= raw[1]:
            raise BadValue(f"{target}: {low.show(limits[0])} is not below {high.show(limits[1])}")
    yield from target.model.family.position_mode(target, raw)
