"""The verbs of HerkuleX. Packets and their sources: servobus.families.herkulex.protocol.

A JOG, the command that moves, sets the lights as well: without colours in it they go out (6-5).
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from servobus.core.effect import Effect
from servobus.core.exchange import Exchange, Pause, Procedure, ReplyPattern, ack_only, told
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST, check_id
from servobus.core.registers import Area, Register
from servobus.core.units import deg, show
from servobus.errors import BadValue, BusError, NoReply
from servobus.families.base import Family, Identity
from servobus.families.change import set_registers
from servobus.families.herkulex import listening, maps
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.herkulex.protocol import (
    ACK,
    ACK_POLICY,
    EEP_TIME,
    FRAMING,
    LONGEST_BOOT,
    LONGEST_PLAYTIME,
    MOST_I_JOG,
    MOST_S_JOG,
    SPEED_LAYOUT,
    TICK,
    Code,
    ControlMode,
    Jog,
    Keep,
    Led,
    Stat,
    StatusDetail,
    StatusError,
    TorqueControl,
    alarms_of,
    eep_read,
    exchange,
    i_jog,
    ram_read,
    reboot,
    rollback,
    s_jog,
    show_flags,
    stat,
)
from servobus.families.model import Model
from servobus.families.motion import AxisMove, MotionStatus, TorqueState, about_to_turn, nearest, raw_position
from servobus.families.reading import Reading, fetch
from servobus.families.refusal import cannot, check_output, stays_off
from servobus.families.stopping import LIMP, TRIES, TURNS_NO_MORE, StopOutcome, let_go_outside, reachable
from servobus.families.target import Answers, KnownServo, ServoRef

_COLOURS = {
    "off": Led.OFF, "on": Led.GREEN | Led.BLUE | Led.RED, "white": Led.GREEN | Led.BLUE | Led.RED,
    "green": Led.GREEN, "blue": Led.BLUE, "red": Led.RED,
    "cyan": Led.GREEN | Led.BLUE, "magenta": Led.BLUE | Led.RED, "yellow": Led.GREEN | Led.RED,
}  # fmt: skip
_KEEPS = {"id": Keep.ID, "baud": Keep.BAUD, "calibration": Keep.CALIBRATION}
LOOKS, WATCH, PLAY = 3, 0.03, 0.1 * deg
"""How often it is looked whether a shaft stands, s between two looks, and rad that count as none. Assumptions: a shaft
without load comes to rest from full speed within them; slower than 3°/s counts as rest."""
_TURN_PLAYTIME = 60
"""Playtime in the manual's example of infinite turn (6-5); what it does there is not said (EH-40)."""


class Herkulex(Family):
    name = "herkulex"
    title = "HerkuleX"
    framing = FRAMING
    full_duplex = True
    keepable = tuple(_KEEPS)
    driven = TorqueControl.ON
    torque_rows = ("torque_control", "torque_policy", "status_error")
    mode_rows = ("current_control_mode",)
    holds_outside_limits = True  # H-51
    patience = LONGEST_BOOT
    needs = (
        "ack_policy", "baud_rate", "current_control_mode", "led_control", "max_pwm", "pwm", "status_detail",
        "status_error", "torque_control", "torque_policy",
    )  # fmt: skip

    def check_model(self, model: type[Model]) -> None:
        """Make sure that the two bytes of the model number say what the model says (NO 1 and 2)."""
        if model.generic:
            return
        bytes_ = {row.place.within(EEP): row for row in model.registers.values()}
        said = [bytes_[at].default if at in bytes_ else None for at in (0, 1)]
        if said != [*(model.number or 0).to_bytes(2)]:
            raise TypeError(f"{model.title}: its rows say model number {said}, the model says {model.number:#06x}")

    def ping(self, id: int) -> Exchange[None]:
        """STAT: the one request that is always answered."""
        return exchange(f"STAT id {id}", Stat(check_id(id)), ack_only, ReplyPattern(id, Code.STAT | ACK, (2,)))

    def identify(self, id: int) -> Procedure[Identity]:
        """Read model, version and ACK Policy; a servo with policy 0 answers STAT alone (H-25)."""
        try:
            model = yield from eep_read(id, 0, 4)
        except NoReply:
            yield from stat(id)
            return Identity(None, "", Answers.NOTHING)
        try:
            (policy,) = yield from ram_read(id, ACK_POLICY, 1)
        except NoReply:
            policy = Answers.READS  # it has just answered one
        answers = Answers(min(policy, 2))
        # Version bytes 00 90 read as "0.90": an assumption, the manual does not say how they are written.
        return Identity(model[0] << 8 | model[1], f"{model[2]:x}.{model[3]:02x}", answers)

    def number_text(self, number: int | None) -> str:
        """Give the digits of the name: "0102" is a DRS-0102."""
        return super().number_text(number) if number is None else f"{number:04x}"

    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        """STAT, and reads: an ACK tells command, address and length of its request."""
        return (stat(id), ram_read(id, 0, 1), eep_read(id, 0, 1), ram_read(id, 0, 2))

    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        """Read from RAM what RAM has, the rest from EEP."""
        return maps.reading(target, registers, [row.place.locations[0] for row in registers])

    def read_stored(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read from EEP what EEP has, the rest from RAM."""
        return fetch(maps.reading(target, registers, [row.place.locations[-1] for row in registers]))

    def put(
        self, target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool, same: Collection[Register[Any]] = ()
    ) -> Procedure[None]:
        """For now: to RAM what RAM has, the rest to EEP, where it acts after the next start.

        For good: to EEP, and to RAM what RAM has too, so that it acts now and survives power-off. What RAM does not
        have (Baud Rate) acts after the next start.
        """
        parts = []
        for row, raw in values.items():
            spots = row.place.locations if keep else row.place.locations[:1]
            parts += [(spot, row.layout.pack(raw)) for spot in spots if spot[0] == RAM or row not in same]
        yield from maps.write(target, parts)

    def wears(self, register: Register[Any], *, keep: bool) -> bool:
        """EEP is written by `store`, and by `write` where RAM does not have the register."""
        return register.area is Area.EEPROM and (keep or not register.place.has_working_copy)

    def is_turning(self, values: Mapping[str, int]) -> bool:
        return values["current_control_mode"] == ControlMode.INFINITE_TURN

    def torque_state(self, values: Mapping[str, Any]) -> TorqueState:
        """Look at the errors too: those of Torque Policy keep the torque off until they are cleared (H-52 to H-54)."""
        if standing := values["torque_policy"] & values["status_error"]:
            return TorqueState(False, show_flags(StatusError(standing)))
        return TorqueState(values["torque_control"] == TorqueControl.ON)

    def start_moves(self, axes: Sequence[AxisMove]) -> Procedure[None]:
        """I_JOG for one servo; for several S_JOG if they take equally long, else I_JOG. The lights go out."""
        playtimes = [_playtime(axis) for axis in axes]
        if len(axes) == 1:
            yield from _jog(axes[0].target, Jog(axes[0].target.id, axes[0].goal, playtime=playtimes[0]))
        elif len(set(playtimes)) == 1:
            jogs = [Jog(axis.target.id, axis.goal) for axis in axes]
            for i in range(0, len(jogs), MOST_S_JOG):
                yield from s_jog(BROADCAST, playtimes[0], jogs[i : i + MOST_S_JOG])
        else:
            jogs = [Jog(axis.target.id, axis.goal, playtime=time) for axis, time in zip(axes, playtimes, strict=True)]
            for i in range(0, len(jogs), MOST_I_JOG):
                yield from i_jog(BROADCAST, jogs[i : i + MOST_I_JOG])

    def goals(self, goals: Mapping[ServoRef, int], time: float) -> list[Exchange[None]]:
        """S_JOG, up to 53 servos each. The lights go out."""
        jogs = [Jog(target.id, raw) for target, raw in goals.items()]
        runs = [jogs[start : start + MOST_S_JOG] for start in range(0, len(jogs), MOST_S_JOG)]
        return [s_jog(BROADCAST, round(time / TICK), run) for run in runs]

    def moving(self, target: ServoRef) -> Procedure[bool]:
        """Moving, and not yet in position: the moving flag alone stays for Stop Detection Period, 302 ms."""
        ack = yield from stat(target.id)
        return ack.status_detail & (StatusDetail.MOVING | StatusDetail.INPOSITION) == StatusDetail.MOVING

    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        """Send a JOG with the stop flag.

        By default nothing answers a JOG. That it has arrived shows in the goal, which is another then, or else in the
        shaft, which stands.
        """
        row = target.model.register("goal_position")
        for _ in range(TRIES):
            motion_status = yield from self.motion_status(target)
            if not motion_status.torque:
                return LIMP
            if motion_status.turning:
                yield from _stop_jog(target, motion_status)
                if (yield from self._stands(target)):
                    return TURNS_NO_MORE
                continue
            if reachable(target, motion_status) is None:
                return (yield from let_go_outside(target, motion_status))
            before = yield from self.read(target, [row])
            yield from _stop_jog(target, motion_status)
            if (yield from self.read(target, [row])) != before or (yield from self._stands(target)):
                return StopOutcome(f"held at {row.show(motion_status.position)}")
        raise BusError(f"{target} still moves: it did not take a JOG with the stop flag")

    def _stands(self, target: ServoRef) -> Procedure[bool]:
        """Compare positions until two are the same, but for the play of a shaft that is held."""
        row = target.model.register("present_position")
        (before,) = yield from self.read(target, [row])
        for _ in range(LOOKS):
            yield Pause(WATCH)
            (after,) = yield from self.read(target, [row])
            if abs(row.decode(after) - row.decode(before)) <= PLAY:
                return True
            before = after
        return False

    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Torque that comes on takes the present position as its goal by itself (H-51); a speed may be kept."""
        if motion_status.torque or motion_status.turning:
            yield from _stop_jog(target, motion_status)

    def _drive(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Send JOGs with the stop flag right behind, before the shaft can get far.

        That torque which comes on takes the present position as its goal is an assumption (H-51, EH-43). Nothing
        answers a JOG, so there are several: one at least should arrive.
        """
        if motion_status.torque:  # it may be on its way
            yield from super()._drive(target, motion_status)
            return
        (led,) = yield from self.read(target, [target.model.register("led_control")])
        yield from super()._drive(target, motion_status)
        for _ in range(TRIES):
            yield from told(_stop_jog(target, motion_status, Led(led)))

    def push(self, target: KnownServo) -> Procedure[float]:
        rows = [target.model.register(name) for name in ("pwm", "max_pwm")]
        pwm, limit = yield from self.read(target, rows)
        return abs(pwm) / limit if limit else 0.0

    def brake(self, target: KnownServo) -> Procedure[None]:
        """Torque Control 0x40 (5-2 RAM 52)."""
        row = target.model.register("torque_control")
        for _ in range(TRIES):
            yield from set_registers(target, {row: TorqueControl.BRAKE})
            if target.answers is Answers.NOTHING or (yield from self.read(target, [row])) == [TorqueControl.BRAKE]:
                return
        raise BusError(f"{target} did not brake")

    def known_alarms(self, model: type[Model], alarms: int) -> int:
        """Only the small models have a bit for a fault of the motor driver (EH-22)."""
        scale: Any = model.register("status_error").scale
        return StatusError(alarms & ~scale.unused)

    def read_alarms(self, target: ServoRef) -> Procedure[int]:
        """STAT: Status Error, in which every alarm stays until it is cleared (6-3 Example 2)."""
        return (yield from stat(target.id)).status_error

    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Clear Status Error and Status Detail.

        What is wrong shows in Status Error only after ADC Fault Check Period, so supply and temperature are compared
        with their limits here.
        """
        if motion_status.torque:
            yield from self._clear(target)
            return
        names = (
            "torque_policy", "present_voltage", "min_voltage", "max_voltage", "present_temperature", "max_temperature"
        )  # fmt: skip
        policy, volts, low, high, celsius, hottest = (yield from self.read_values(target, names)).values()
        standing = StatusError(0)
        if not low <= volts <= high:
            standing |= StatusError.INPUT_VOLTAGE
        if celsius > hottest:
            standing |= StatusError.TEMPERATURE
        if not standing & policy:
            standing = yield from self._clear(target)
        if standing & policy:
            raise stays_off(target, standing, show_flags(standing & policy))

    def _clear(self, target: KnownServo) -> Procedure[StatusError]:
        """Write 0 to Status Error and Status Detail; give what stands there afterwards."""
        clear = {target.model.register(name): 0 for name in ("status_error", "status_detail")}
        yield from set_registers(target, clear)
        ack = yield from stat(target.id)
        if ack.status_error:  # by default a write is not answered: it may have been lost
            yield from set_registers(target, clear)
            ack = yield from stat(target.id)
        return ack.status_error

    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Infinite turn: with controlled speed, or with a share of full output where the model knows no more (EH-57).

        Asked for more speed than it reaches, it obeys late (6-5).
        """
        raw = _turn_value(target, speed, output)
        yield from about_to_turn(target)
        yield from _jog(target, Jog(target.id, raw, ControlMode.INFINITE_TURN, playtime=_TURN_PLAYTIME))

    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:
        if limits is not None:
            low, high = (target.model.register(name) for name in ("min_position", "max_position"))
            yield from self.write(target, {low: limits[0], high: limits[1]})
        motion_status = yield from self.motion_status(target)
        if not motion_status.turning:
            return
        goal = nearest(target, motion_status)
        # Outside its limits the servo would run to the nearest one (H-66). But without torque a JOG changes
        # nothing except the mode (EH-16), and torque on holds whatever position it finds (H-51).
        free = motion_status.torque and goal != raw_position(target, motion_status)
        if free:
            yield from self.torque(target, on=False)
        yield from _jog(target, Jog(target.id, goal))
        if free:
            yield from self.torque(target, on=True)

    def led(self, target: KnownServo, colour: str) -> Procedure[None]:
        if colour not in _COLOURS:
            raise BadValue(f"{target} has no light {colour!r}, only {', '.join(_COLOURS)}")
        yield from set_registers(target, {target.model.register("led_control"): _COLOURS[colour]})

    def reboot(self, target: KnownServo) -> Procedure[None]:
        target.record.forget()
        yield from reboot(target.id, answered=target.answers_writes)

    def reset(self, target: KnownServo, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        self.check_reset(target, keep)
        id, baud = (target.model.register(name) for name in ("id", "baud_rate"))
        new_id, code = id.default, baud.default
        if "id" in keep:
            (new_id,) = yield from self.read_stored(target, [id])
        if "baud" in keep:
            (code,) = yield from self.read_stored(target, [baud])
        assert new_id is not None
        assert code is not None
        kept = Keep(sum(_KEEPS[name] for name in keep))
        yield from rollback(target.id, kept, answered=target.answers_writes)
        yield Pause(EEP_TIME)
        yield from self.await_eeprom(target, 0)
        yield from self.reboot(target)
        return new_id, baud.decode(code)

    def set_id(self, target: KnownServo, id: int) -> Procedure[None]:
        """Write EEP, then RAM, both under the old id: it changes with the second write (H-36).

        EEP is read back in between. So a servo that goes by the new id keeps it, and one that still goes by the old
        one can be given it again.
        """
        row = target.model.register("id")
        yield from maps.keep(target, row, check_id(id))
        if id != target.id:
            yield from self.put(target, {row: id}, keep=False)

    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        """Write EEP and restart: Baud Rate acts only then (H-37)."""
        register = target.model.register("baud_rate")
        yield from maps.keep(target, register, register.encode(baud))
        yield Pause(EEP_TIME)
        yield from self.reboot(target)

    def explain(
        self,
        packet: Packet,
        request: Packet | None = None,  # noqa: ARG002 - the command tells requests from ACKs
        model: type[Model] | None = None,
    ) -> str:
        return listening.explain(packet, model)

    def concerns(self, packet: Packet) -> tuple[int, ...]:
        return listening.concerns(packet)

    def told_number(self, packet: Packet, request: Packet) -> int | None:  # noqa: ARG002 - the ACK repeats the address
        return listening.told_number(packet)

    def effect(self, packet: Packet, model_of: Callable[[int], type[Model] | None]) -> Effect:
        return listening.effect(packet, model_of)

    def told_alarms(self, answer: Packet) -> int:
        return int(alarms_of(answer))

    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        return listening.replies_to(packet)


HERKULEX = Herkulex()
"""The one instance, which all models share."""


def _turn_value(target: KnownServo, speed: float | None, output: float | None) -> int:
    """Give the value of a JOG for infinite turn: a speed or a share of full output, as the model has it."""
    scale = target.model.turn_scale
    if not target.model.turns_at_speed():
        if output is None or speed is not None:
            raise cannot(target, "turn at a given speed", "its infinite turn has no speed control; give output=-1..1")
        return scale.encode(check_output(output))
    if speed is None or output is not None:
        raise cannot(target, "turn at a share of full output", "it controls its speed; give speed in rad/s")
    fastest = scale.decode(SPEED_LAYOUT.range[1])
    if not abs(speed) <= fastest:  # so that NaN is refused too
        raise BadValue(f"{target}: speed {show(speed, 'rad/s')} is beyond {show(fastest, 'rad/s')}")
    return scale.encode(speed)


def _jog(target: ServoRef, jog: Jog) -> Procedure[None]:
    yield from i_jog(target.id, [jog], answered=target.answers_writes)


def _stop_jog(target: ServoRef, status: MotionStatus, led: Led = Led.OFF) -> Procedure[None]:
    """Send a JOG with the stop flag; beside it speed 0 or the present position, in case they count (H-82)."""
    if status.turning:
        yield from _jog(target, Jog(target.id, 0, ControlMode.INFINITE_TURN, led, stop=True))
    else:
        yield from _jog(target, Jog(target.id, nearest(target, status), led=led, stop=True))


def _playtime(axis: AxisMove) -> int:
    """Give a leg's playtime, rounded up: a little slower rather than faster than asked."""
    playtime = math.ceil(axis.duration / TICK - 1e-6)  # less what the division may have added
    if playtime > LONGEST_PLAYTIME:
        longest = show(LONGEST_PLAYTIME * TICK, "s")
        raise BadValue(f"{axis.target}: a move of {show(axis.duration, 's')} is longer than {longest}")
    return max(playtime, 1)  # 0 would mean as fast as it can (H-85)
