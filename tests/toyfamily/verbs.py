"""The verbs of the toy family."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from servobus.core.exchange import Exchange, Procedure, ReplyPattern
from servobus.core.framing import Packet
from servobus.core.registers import Register
from servobus.errors import BadValue
from servobus.families.base import (
    Answers,
    AxisMove,
    Family,
    Identity,
    KnownServo,
    Model,
    MotionStatus,
    Reading,
    ServoRef,
    StopOutcome,
    cannot,
)
from servobus.families.explain import addressed, show_values
from toyfamily.places import CELLS, Cell
from toyfamily.protocol import ANSWER, FRAMING, Code, Trouble, ask, ping, read, trouble, write


def cell(register: Register[Any]) -> int:
    assert isinstance(register.place, Cell)
    return register.place.cell


class Toy(Family):
    name = "toy"
    title = "Toy protocol"
    framing = FRAMING
    one_table = True
    needs = ("speed",)

    def ping(self, id: int) -> Exchange[None]:
        return ping(id)

    def identify(self, id: int) -> Procedure[Identity]:
        data = yield from read(id, 0, 1)
        return Identity(int.from_bytes(data), "", Answers.EVERYTHING)

    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        return (ping(id), read(id, 0, 1), read(id, 0, 2))

    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        exchanges = tuple(read(target.id, cell(row), 1) for row in registers)
        return Reading(exchanges, tuple((n, slice(0, 2), row.layout) for n, row in enumerate(registers)))

    def put(
        self,
        target: ServoRef,
        values: Mapping[Register[Any], int],
        *,
        keep: bool,  # noqa: ARG002 - a value is kept or it is not
        same: Collection[Register[Any]] = (),
    ) -> Procedure[None]:
        for row, raw in values.items():
            if row not in same:
                yield from write(target.id, cell(row), row.layout.pack(raw))

    def motion_status(self, target: ServoRef) -> Procedure[MotionStatus]:
        names = ("present_position", "torque_enable", "min_position", "max_position")
        rows = [target.model.register(name) for name in names]
        here, torque, low, high = yield from self.read(target, rows)
        return MotionStatus(rows[0].decode(here), bool(torque), low, high, turning=False)

    def start_moves(self, axes: Sequence[AxisMove]) -> Procedure[None]:
        for axis in axes:
            model = axis.target.model
            speed = model.register("speed")
            pace = max(1, min(speed.scale.encode(axis.distance / axis.duration), speed.limits[1]))
            yield from self.put(axis.target, {speed: pace, model.register("goal_position"): axis.goal}, keep=False)

    def goals(self, goals: Mapping[ServoRef, int], time: float) -> list[Exchange[None]]:  # noqa: ARG002 - it has a speed
        rows = [(target, target.model.register("goal_position"), raw) for target, raw in goals.items()]
        return [write(target.id, cell(row), row.layout.pack(raw)) for target, row, raw in rows]

    def moving(self, target: ServoRef) -> Procedure[bool]:
        rows = [target.model.register(name) for name in ("goal_position", "present_position", "torque_enable")]
        goal, here, torque = yield from self.read(target, rows)
        return bool(torque and abs(goal - here) > 2)

    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        row = target.model.register("present_position")
        (here,) = yield from self.read(target, [row])
        yield from self.put(target, {target.model.register("goal_position"): here}, keep=False)
        return StopOutcome(f"held at {row.show(row.decode(here))}")

    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:  # noqa: ARG002 - no turn
        yield from self.hold(target)

    def push(self, target: KnownServo) -> Procedure[float]:
        return float((yield from self.moving(target)))

    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        alarms: Trouble = yield ping(target.id).mapped(trouble)
        return alarms

    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:  # noqa: ARG002
        yield from ()  # it never switches its torque off by itself

    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:  # noqa: ARG002
        yield from ()
        raise cannot(target, "turn", "it has a stop at either end")

    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:  # noqa: ARG002
        yield from ()

    def led(self, target: KnownServo, colour: str) -> Procedure[None]:
        yield from ()
        raise BadValue(f"{target} has no light {colour!r}")

    def reboot(self, target: KnownServo) -> Procedure[None]:
        yield from ()
        raise cannot(target, "be rebooted", "it has no such command")

    def reset(self, target: KnownServo, keep: frozenset[str]) -> Procedure[tuple[int, int]]:  # noqa: ARG002
        yield from ask(target.id, Code.RESET, b"", 0, repeatable=False)
        return 1, target.model.factory_baud

    def set_id(self, target: KnownServo, id: int) -> Procedure[None]:
        yield from self.write(target, {target.model.register("id"): id})

    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        yield from ()
        raise cannot(target, f"talk at {baud} baud", "it has one speed")

    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        code = Code(packet.code & ~ANSWER)
        head = f"{'answer to ' if packet.code & ANSWER else ''}{code.name} {addressed(packet.id)}"
        if code is Code.WRITE and not packet.code & ANSWER:
            return f"{head}: {show_values(model, CELLS, 2 * packet.data[0], packet.data[1:])}"
        if packet.code & ANSWER and request is not None and code is Code.READ:
            return f"{head}: {show_values(model, CELLS, 2 * request.data[0], packet.data[1:])}"
        return head

    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        if packet.code & ANSWER or packet.code not in list(Code):
            return None
        sizes = (2 * packet.data[1] + 1, 1) if packet.code == Code.READ else (1,)
        return (ReplyPattern(packet.id, packet.code | ANSWER, sizes),)


TOY = Toy()
