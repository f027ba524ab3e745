"""The verbs of Dynamixel protocol 1.0. Packets and their sources: servobus.families.dynamixel.protocol."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from servobus.core.effect import Effect
from servobus.core.exchange import Exchange, GroupExchange, Pause, Procedure, ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import check_id
from servobus.core.registers import Area, Motion, Register
from servobus.core.units import Flags
from servobus.core.values import replace
from servobus.errors import BadValue, BusError, NoReply, OutsideLimits, UsageError
from servobus.families.base import Family, Identity, Stranger
from servobus.families.change import set_registers
from servobus.families.dynamixel import listening, protocol2
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.protocol import (
    ALARMS,
    FRAMING,
    RX_BUFFER,
    Error,
    alarms_of,
    joined_reads,
    ping,
    read_data,
    reset,
    sync_write,
    write_data,
)
from servobus.families.model import Model
from servobus.families.motion import (
    AxisMove,
    MotionStatus,
    Reach,
    TorqueState,
    about_to_turn,
    check_inside,
    counts_turns,
    inside_limits,
    nearest,
    show_limits,
)
from servobus.families.reading import Reading, adjacent, blocks, place
from servobus.families.refusal import cannot, check_output, mute, not_taken, stays_off
from servobus.families.stopping import LIMP, TRIES, TURNS_NO_MORE, StopOutcome, let_go_outside, reachable
from servobus.families.target import Answers, KnownServo, ServoRef


def _address(register: Register[Any]) -> int:
    assert isinstance(register.place, Address)
    return register.place.address


class Dynamixel1(Family):
    name = "dynamixel"
    title = "Dynamixel protocol 1.0"
    framing = FRAMING
    torque_rows = ("torque_enable", "torque_limit")
    mode_rows = ("torque_control_mode_enable", "resolution_divider")
    # Measured by a user on an AX-12: 6 ms, give or take 1, 9 at most. The manual says nothing of it.
    eeprom_time = 0.009
    needs = (
        "alarm_shutdown", "led", "lock", "max_torque", "moving", "moving_speed", "torque_limit",
    )  # fmt: skip

    @property
    def joins(self) -> Callable[[Sequence[Exchange[Any]]], GroupExchange[Any]]:
        return joined_reads

    def check_model(self, model: type[Model]) -> None:
        """Make sure that a goal and its speed can be sent in one piece, which is how several servos start at once."""
        goal, speed = model.register("goal_position"), model.register("moving_speed")
        if _address(speed) != _address(goal) + goal.layout.size:
            raise TypeError(f"{speed} does not stand right behind {goal.name}, with which it is written")

    def ping(self, id: int) -> Exchange[None]:
        return ping(check_id(id))

    def identify(self, id: int) -> Procedure[Identity]:
        """Read model number, firmware and return level; a servo at level 0 answers PING alone (D-22).

        Where no answer comes the servo is asked for less, so that it takes more than one lost packet to count as mute.
        """
        try:
            # In all models of protocol 1.0 the model number is at 0, the version at 2, the return level at 16.
            data = yield from read_data(check_id(id), 0, 17)
        except NoReply:
            yield from ping(id)
            try:
                data = (yield from read_data(id, 0, 3)) + bytes(13) + (yield from read_data(id, 16, 1))
            except NoReply:
                return Identity(None, "", Answers.NOTHING)
        return Identity(int.from_bytes(data[:2], "little"), str(data[2]), Answers(min(data[16], 2)))

    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        """PING, and reads of different lengths: a status packet tells nothing of the question but its length."""
        return (ping(id), *(read_data(id, 0, length) for length in (1, 3, 5, 7)))

    def strangers(self) -> Sequence[Exchange[Stranger]]:
        return (protocol2.ping_all(),)

    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        if target.answers is Answers.NOTHING:
            raise mute(target, "Status Return Level", "status_return_level=1")
        # A second exchange costs 14 bytes of frames and the return delay: rather bridge a gap as wide.
        spans = blocks(
            ((_address(register), register.layout.size) for register in registers), gap=16, longest=RX_BUFFER - 6
        )
        places = tuple(place(spans, _address(register), register.layout) for register in registers)
        bulk = target.model.answers_together
        return Reading(tuple(read_data(target.id, *span, bulk=bulk) for span in spans), places)

    def put(
        self,
        target: ServoRef,
        values: Mapping[Register[Any], int],
        *,
        keep: bool,  # noqa: ARG002 - a register is in EEPROM or in RAM, never in both
        same: Collection[Register[Any]] = (),
    ) -> Procedure[None]:
        fresh = {register: raw for register, raw in values.items() if register not in same}
        parts = {_address(register): register.layout.pack(raw) for register, raw in fresh.items()}
        # The EEPROM wears, and a second write of id or speed would reach no servo: only RAM may be written twice.
        in_ram = all(register.area is Area.RAM for register in fresh)
        id, baud = target.model.register("id"), target.model.optional("baud")
        for address, data in adjacent(parts):
            yield _write(target, address, data, repeatable=in_ram)
            worn = [row for row in fresh if row.area is Area.EEPROM and address <= _address(row) < address + len(data)]
            size = sum(row.layout.size for row in worn)
            if baud in worn:  # it answers at another speed now
                yield Pause(size * self.eeprom_time)
            elif worn:
                yield from self.await_eeprom(replace(target, id=fresh[id]) if id in worn else target, size)

    def check_unlocked(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[None]:
        """Ask for Lock: once it is on, only addresses 24 to 35 can be written until power-off (3-4-2 Lock)."""
        if target.answers is Answers.NOTHING:
            return
        (locked,) = yield from self.read(target, [target.model.register("lock")])
        if locked:
            names = ", ".join(register.name for register in registers)
            open_ = open_while_locked(target.model)
            raise UsageError(
                f"{target} is locked, so {names} cannot be written: until its power goes off only addresses "
                f"{open_[0]} to {open_[-1]} (torque_enable to torque_limit) can; switch it off and on first"
            )

    def status_of(self, target: ServoRef, raw: Mapping[str, int]) -> MotionStatus:
        """In multi-turn mode a unit of goals and positions is as many steps of the sensor as resolution_divider says.

        That speeds are those of the shaft all the same is an assumption.
        """
        status = super().status_of(target, raw)
        return replace(status, shaft=float(raw["resolution_divider"])) if counts_turns(target, status) else status

    def reach(self, model: type[Model], low: int, high: int) -> Reach:
        """Both limits 0 are endless turn (3-4-3), which the DX series lacks; for those of multi-turn mode see ED-48."""
        if low == high == 0 and model.turns:
            return Reach(low, high, turning=True)
        if (low, high) == self.multi_turn_limits(model):
            return Reach(*model.register("goal_position").limits)
        return Reach(low, high)

    def multi_turn_limits(self, model: type[Model]) -> tuple[int, int] | None:
        """Give the highest limit twice, where goals can lie beyond it: in the MX series."""
        last = model.register("max_position").limits[1]
        return (last, last) if model.register("goal_position").limits[1] > last else None

    def is_turning(self, values: Mapping[str, int]) -> bool:
        return values.get("torque_control_mode_enable", 0) != 0

    def torque_state(self, values: Mapping[str, Any]) -> TorqueState:
        """Look at Torque Limit too: a shutdown sets it to 0, and leaves Torque Enable on (3-4-1 Alarm Shutdown)."""
        if not values["torque_limit"]:
            return TorqueState(False, "torque limit 0")
        return TorqueState(bool(values["torque_enable"]))

    def check_axis(self, axis: AxisMove) -> None:
        """Refuse what would be slower than speed code 1: it would take longer than asked."""
        speed = axis.target.model.register("moving_speed")
        slowest = speed.scale.decode(1)
        if axis.distance > axis.target.model.sheet.resolution and axis.distance / axis.duration < 0.5 * slowest:
            raise BadValue(f"{axis.target}: slower than {speed.show(slowest)} is not possible; go in steps")

    def start_moves(self, axes: Sequence[AxisMove]) -> Procedure[None]:
        if len(axes) == 1:
            goal = _address(axes[0].target.model.register("goal_position"))
            yield _write(axes[0].target, goal, _goal_and_speed(axes[0]), repeatable=True)
            return
        yield from _sync_writes([(axis.target, _goal_and_speed(axis)) for axis in axes])

    def goals(self, goals: Mapping[ServoRef, int], time: float) -> list[Exchange[None]]:  # noqa: ARG002 - it has a speed
        """SYNC_WRITE, as many as 143 bytes each can hold (3-5-7)."""
        return _sync_writes(
            [(target, target.model.register("goal_position").layout.pack(raw)) for target, raw in goals.items()]
        )

    def moving(self, target: ServoRef) -> Procedure[bool]:
        (moving,) = yield from self.read(target, [target.model.register("moving")])
        return bool(moving)

    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        """In endless turn Moving Speed 0 ends the motion (3-4-3); else a goal, behind the end of torque control."""
        goal = target.model.register("goal_position")
        for _ in range(TRIES):
            motion_status = yield from self.motion_status(target)
            if motion_status.turning:
                row, raw = (yield from self._turned_by(target)), 0
                if motion_status.torque and row.name == "goal_torque":
                    return (yield from self._hold_by_position(target, motion_status))
                outcome = TURNS_NO_MORE if motion_status.torque else LIMP
            elif not motion_status.torque:
                return LIMP  # and a goal would switch it on
            elif (here := reachable(target, motion_status)) is None:
                return (yield from let_go_outside(target, motion_status))
            else:
                row, raw, outcome = goal, here, StopOutcome(f"held at {goal.show(goal.decode(here))}")
            if (yield from self._took(target, row, raw)):
                return outcome
        raise not_taken(target, row, raw)

    def _hold_by_position(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[StopOutcome]:
        """End torque control, in which a current of 0 holds nothing, and hold what the angle limits allow.

        For a moment the shaft is let go of, so that it makes no difference what became of the goal in torque control.
        One that coasts over the end of its turn meanwhile would run the whole way back: it is given another goal.
        """
        model = target.model
        goal, mode, torque = map(model.register, ("goal_position", "torque_control_mode_enable", "torque_enable"))
        yield from self._make(target, model.register("goal_torque"), 0)
        if self.reach(model, motion_status.low, motion_status.high).turning:
            yield from self._make(target, model.register("moving_speed"), 0)
            yield from self._make(target, mode, 0)
            return TURNS_NO_MORE
        yield from self._make(target, torque, 0)
        yield from self._make(target, mode, 0)
        for _ in range(TRIES):
            motion_status = yield from self.motion_status(target)
            if (here := reachable(target, motion_status)) is None:
                return (yield from let_go_outside(target, motion_status))
            yield from self._make(target, goal, here)
            yield from self._make(target, torque, 1)
            (now,) = yield from self.read(target, [model.register("present_position")])
            if abs(now - here) * 2 <= model.register("max_position").limits[1]:
                return StopOutcome(f"held at {goal.show(goal.decode(here))}")
        raise BusError(f"{target} turns too fast to be held")

    def _make(self, target: KnownServo, row: Register[Any], raw: int) -> Procedure[None]:
        """Write a value as it is, until the servo has it. Raises BusError if it does not take it."""
        for _ in range(TRIES):
            if (yield from self._took(target, row, raw)):
                if not row.volatile:
                    target.record.set({row: raw})
                target.record.modes += row.motion is Motion.MODE
                return
        raise not_taken(target, row, raw)

    def _took(self, target: ServoRef, row: Register[Any], raw: int) -> Procedure[bool]:
        """Write a value as it is, and tell whether the servo has it then."""
        yield from self.put(target, {row: raw}, keep=False)
        return target.answers_writes or (yield from self.read(target, [row])) == [raw]

    def give_back(self, target: KnownServo) -> Procedure[None]:
        """In endless turn the same register is an output (3-4-3)."""
        if target.record.lent and not (yield from self.motion_status(target)).turning:
            yield from super().give_back(target)

    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """A written goal may switch the torque on by itself: here it moves nothing."""
        if motion_status.turning:
            row, raw = (yield from self._turned_by(target)), 0
        else:
            row, raw = target.model.register("goal_position"), nearest(target, motion_status)
        yield from self._make(target, row, raw)

    def push(self, target: KnownServo) -> Procedure[float]:
        rows = [target.model.register(name) for name in ("present_load", "torque_limit")]
        load, limit = yield from self.read(target, rows)
        return abs(load) / limit if limit else 0.0

    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        """PING: the alarms stand in the error byte of its answer."""
        asking: Exchange[Any] = self.ping(target.id)
        alarms: Error = yield asking.mapped(lambda packet: Error(packet.code) & ALARMS)
        return alarms

    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Give Torque Limit back, which the shutdown has set to 0 (3-4-1 Alarm Shutdown).

        Torque Enable, which the shutdown leaves on, goes off first. Else the servo would run to its old goal.
        """
        if motion_status.torque:
            return
        model = target.model
        rows = [model.register(name) for name in ("max_torque", "alarm_shutdown")]
        most, mask = yield from self.read(target, rows)
        yield from self.let_go(target)
        yield from set_registers(target, {model.register("torque_limit"): most})
        standing = (yield from self.read_alarms(target)) & mask
        if standing:
            done = "torque_enable is off now, so it goes nowhere when that is over"
            raise stays_off(target, standing, f"{Flags(Error).show(Error(standing))}; {done}")

    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Wheel mode: both angle limits 0. Moving Speed is a share of full output (3-4-3), or a speed in the MX series.

        Torque control ends before that: its current is 0 from then on, until the wheel turns.
        """
        model = target.model
        speed_row = model.register("moving_speed")
        raw = speed_row.check(_turn_value(target, speed, output))
        motion_status = yield from about_to_turn(target)
        if not self.reach(model, motion_status.low, motion_status.high).turning:
            # A speed left over from position mode would spin it as soon as the limits are 0.
            yield from self.borrow(target)
            yield from self._write_raw_speed(target, 1)
            yield from set_registers(target, {model.register("min_position"): 0, model.register("max_position"): 0})
        yield from self._end_torque_control(target)
        yield from self._write_raw_speed(target, raw)

    def check_current(self, target: ServoRef, current: float) -> int:
        goal = target.model.registers.get("goal_torque")
        return super().check_current(target, current) if goal is None else goal.encode(current)

    def turn_by_current(self, target: KnownServo, current: float) -> Procedure[None]:
        """Torque control (ROBOTIS e-manual, MX-64 and MX-106, Torque Ctrl Mode Enable), begun with a current of 0."""
        raw = self.check_current(target, current)
        goal, mode = map(target.model.register, ("goal_torque", "torque_control_mode_enable"))
        yield from about_to_turn(target)
        (controls,) = yield from self.read(target, [mode])
        if not controls:
            yield from set_registers(target, {goal: 0})
            yield from set_registers(target, {mode: 1})
        yield from set_registers(target, {goal: raw})

    def _end_torque_control(self, target: KnownServo) -> Procedure[None]:
        """End torque control where the model has it and is in it, with a current of 0 first."""
        rows = target.model.registers
        mode = rows.get("torque_control_mode_enable")
        if mode is not None and (yield from self.read(target, [mode])) != [0]:
            yield from set_registers(target, {rows["goal_torque"]: 0})
            yield from set_registers(target, {mode: 0})

    def _turned_by(self, target: ServoRef) -> Procedure[Register[Any]]:
        """Give the register that turns a servo which turns without end: 0 in it ends that."""
        rows = target.model.registers
        mode = rows.get("torque_control_mode_enable")
        if mode is not None and (yield from self.read(target, [mode])) != [0]:
            return rows["goal_torque"]
        return target.model.register("moving_speed")

    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:
        """Let go of the shaft, which endless turn without speed does not hold either, until limits and goal are set.

        So it makes no difference whether the servo keeps its old goal (D-78), or what it makes of a goal in endless
        turn (D-77), nor that angles are counted otherwise in multi-turn mode.
        """
        model = target.model
        motion_status = yield from self.motion_status(target)
        low, high = model.register("min_position"), model.register("max_position")
        wheel = self.reach(model, motion_status.low, motion_status.high).turning
        several = counts_turns(target, motion_status)
        if limits is None and (wheel or several):
            limits = low.limits[0], high.limits[1]
        if limits is None and not motion_status.turning:
            return
        # In torque control the limits are those from before.
        wanted = {} if limits is None else {low: limits[0], high: limits[1]}
        reach = self.reach(model, *(limits or (motion_status.low, motion_status.high)))
        after = replace(motion_status, low=reach.low, high=reach.high, turning=False)
        if not motion_status.turning and several == counts_turns(target, after):
            yield from self.write(target, wanted)
            return
        if motion_status.torque:
            if several and not inside_limits(target, after):
                here = model.register("present_position").show(motion_status.position)
                raise OutsideLimits(
                    f"{target} is at {here}, outside the limits that it would get, {show_limits(target, after)}, and "
                    "where it would count itself to be then is not sure; move it inside first, or switch its torque off"
                )
            check_inside(target, after, whose="that it would get")
        if wanted:
            target.record.check_wear(str(target), wanted)
            yield from self.check_unlocked(target, list(wanted))
        if wheel:  # else 0 is full speed to a goal
            yield from self._write_raw_speed(target, 0)
        if motion_status.torque:
            yield from self.let_go(target)
        yield from self._end_torque_control(target)
        if wanted:
            yield from set_registers(target, wanted)
        if motion_status.torque:
            yield from self.torque(target, on=True)
        yield from self.give_back(target)

    def led(self, target: KnownServo, colour: str) -> Procedure[None]:
        if colour not in ("on", "off", "red"):
            raise BadValue(f"{target} has one red light: on or off, not {colour!r}")
        yield from set_registers(target, {target.model.register("led"): int(colour != "off")})

    def reboot(self, target: KnownServo) -> Procedure[None]:
        yield from ()  # a procedure without steps
        raise cannot(target, "be rebooted", "protocol 1.0 has no such instruction; switch its power off and on")

    def reset(self, target: KnownServo, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        self.check_reset(target, keep)
        yield from reset(target.id, answered=target.answers_writes)
        factory_id = target.model.register("id").default
        return target.id if factory_id is None else factory_id, target.model.factory_baud

    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        register = target.model.register("baud")
        yield from set_registers(target, {register: register.encode(baud)})

    def explain(self, packet: Packet, request: Packet | None = None, model: type[Model] | None = None) -> str:
        return listening.explain(packet, request, model)

    def explain_to_several(self, packet: Packet, models: Sequence[type[Model] | None]) -> str:
        return listening.explain_to_several(packet, models)

    def concerns(self, packet: Packet) -> tuple[int, ...]:
        return listening.concerns(packet)

    def told_number(self, packet: Packet, request: Packet) -> int | None:
        return listening.told_number(packet, request)

    def effect(self, packet: Packet, model_of: Callable[[int], type[Model] | None]) -> Effect:
        return listening.effect(packet, model_of)

    def told_alarms(self, answer: Packet) -> int:
        return int(alarms_of(answer))

    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        return listening.replies_to(packet)

    def _write_raw_speed(self, target: ServoRef, raw: int) -> Procedure[None]:
        row = target.model.register("moving_speed")
        yield _write(target, _address(row), row.layout.pack(raw), repeatable=True)


DYNAMIXEL1 = Dynamixel1()
"""The one instance, which all models share."""


def open_while_locked(model: type[Model]) -> range:
    """Give the addresses that can be written while Lock is on: Torque Enable to Torque Limit (3-4-2 Lock)."""
    first, last = model.register("torque_enable"), model.register("torque_limit")
    return range(_address(first), _address(last) + last.layout.size)


def _write(target: ServoRef, address: int, data: bytes, *, repeatable: bool) -> Exchange[None]:
    return write_data(target.id, address, data, answered=target.answers_writes, repeatable=repeatable)


def _turn_value(target: ServoRef, speed: float | None, output: float | None) -> int:
    """Give Moving Speed for endless turn, raw. Raises UsageError for what the model does not control."""
    model = target.model
    if model.turns_at_speed():
        if speed is None or output is not None:
            raise cannot(
                target, "turn with a given output", "its endless turn controls the speed; give speed= in rad/s"
            )
        return model.register("moving_speed").encode(speed)
    if output is None or speed is not None:
        raise cannot(target, "turn at a given speed", "endless turn has no speed control (3-4-3); give output=-1..1")
    return model.turn_scale.encode(check_output(output))


def _goal_and_speed(axis: AxisMove) -> bytes:
    goal, speed = (axis.target.model.register(name) for name in ("goal_position", "moving_speed"))
    raw = speed.scale.encode(axis.distance / axis.duration)
    # 0 would mean full speed; above the highest code there is nothing to ask for.
    return goal.layout.pack(axis.goal) + speed.layout.pack(max(1, min(raw, speed.limits[1])))


def _sync_writes(parts: Sequence[tuple[ServoRef, bytes]]) -> list[Exchange[None]]:
    """Give the SYNC_WRITEs that bring each servo its bytes from its goal position on, each as long as one can be."""
    groups: dict[tuple[int, int], dict[int, bytes]] = {}
    for target, data in parts:  # one packet writes the same addresses of all
        groups.setdefault((_address(target.model.register("goal_position")), len(data)), {})[target.id] = data
    packets = []
    for (address, size), block in groups.items():
        most, ids = (RX_BUFFER - 8) // (size + 1), list(block)
        runs = [ids[start : start + most] for start in range(0, len(ids), most)]
        packets += [sync_write(address, {id: block[id] for id in run}) for run in runs]
    return packets
