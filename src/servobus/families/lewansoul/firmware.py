"""The firmware of LewanSoul bus servos, as the maker's protocol document ("manual") describes it.

Points and replies are those of the manual's section 4, EL entries those of docs/decisions.md, L numbers
those of docs/behaviours.md.

The manual says little about motion and torque together. What holds here beside the L numbers, all of it
assumption:

    A protection lets go of the shaft as command 31 does, and its end takes hold as command 31 does: of the
    angle where the shaft is, not of the goal. Command 32 tells the state of the motor, so it answers 0 then.
    In motor mode the motor turns on when torque returns; command 12 means nothing there, and a kept move is
    used up by command 11 without moving anything.
    Motor mode is an output, not a speed: what becomes of it is up to the motor, and 0 brakes.
    A locked rotor (output nearly full, and no motion for a second) flashes the light and does no more: the manual
    unloads for voltage and temperature only. It ends as soon as the rotor turns or the output falls.
    Voltage protects at once and lets go of its alarm a tenth of a second after the voltage is back, so that a weak
    supply that the motor itself pulls down does not make it rattle.
    New angle limits act on moves that begin after them. Command 2 and 8 give a move back as it came, cut to
    0 .. 1000 and 0 .. 30000 only; before any command 7 the latter answers as L-20 has it for the former.
"""

import math
from functools import lru_cache
from typing import Any

from servobus.core.framing import Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.core.registers import Area, Register
from servobus.families.lewansoul.control import GAINS, LOCKED_TIME, UNIT, Follower
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import (
    FRAMING,
    Alarm,
    Command,
    Mode,
    Request,
    encode,
    length_of,
    parse_request,
    without_surplus,
)
from servobus.virtual.device.options import ON_OFF, OneOf, Option, Span
from servobus.virtual.device.servo import Replies, VirtualServo

TURN = 2 * math.pi
FLASH = 0.5
"""s; assumption: one on and off of a light that flashes."""
BACK_TIME = 0.1
"""s that the voltage has to be good again; assumption."""
LOOK = 50
"""Ticks between two looks at a servo that stands, and at what no packet has changed; its heat flows no more often."""


_parse = lru_cache(maxsize=16)(parse_request)
"""All servos of a line hear the same broadcast."""


class LewansoulServo(VirtualServo):
    """Angles: `shaft.position` is where the shaft is, offset included (L-45); 0 is position 0 at offset 0."""

    tick = 0.002
    """s; assumption."""
    gains = GAINS
    """Of the position loop."""
    garbage_timeout = 0.1
    """Longest pause between two bytes of a packet, s; assumption (L-12)."""

    goal_torque = Option(
        ON_OFF, practice=True, manual=False, decision="EL-08",
        text="whether a move (command 1, or 7 and 11) and motor mode switch the torque on; else they wait until it is",
    )  # fmt: skip
    goal_after_limp = Option(
        OneOf(("present", "kept")), practice="present", manual="present", decision="EL-22",
        text="what it holds when the torque comes back, or motor mode ends: where the shaft is, or the last goal",
    )  # fmt: skip
    surplus = Option(
        OneOf(("obeyed", "ignored")), practice="obeyed", manual="ignored", decision="EL-23",
        text="what a command with more parameter bytes than it has is: obeyed without them, or ignored",
    )  # fmt: skip
    out_of_range = Option(
        OneOf(("limited", "ignored")), practice="limited", manual="limited", decision="EL-15",
        text="what a number outside its range does: the nearest one in the range counts, or the command is ignored",
    )  # fmt: skip
    wait_read = Option(
        OneOf(("answered", "silent")), practice="answered", manual="answered", decision="EL-04",
        text="whether command 8, the kept move, is answered",
    )  # fmt: skip
    voltage_recovery = Option(
        ON_OFF, practice=True, manual=True, decision="EL-11",
        text="whether the torque comes back by itself when the supply is inside its limits again",
    )  # fmt: skip
    mask_saved = Option(
        ON_OFF, practice=True, manual=True, decision="EL-13",
        text="whether the alarm mask of command 35 survives power-off",
    )  # fmt: skip
    answer_time = VirtualServo.answer_time.but(
        practice=Span(0.002, 0.003), manual=Span(0.0005, 0.0005), decision="EL-24"
    )
    eeprom_pause = VirtualServo.eeprom_pause.but(decision="EL-25")
    boot_time = VirtualServo.boot_time.but(decision="EL-26")
    sensor = -190, 1194
    """Lowest and highest angle that the sensor tells, in position units; what lies between them on the other
    side reads as the nearer end. Measured by users: the manual only says that readings may be negative."""

    _faults = Alarm(0)
    _waiting = False
    """Whether a move of command 7 waits for command 11."""
    _late: tuple[int, int] | None = None
    """A move that came while the torque was off: position and time."""

    # Life

    def start(self) -> None:
        self._rows: dict[Command, list[Register[Any]]] = {}
        """Read command -> the registers in its answer."""
        for row in self.model.registers.values():
            assert isinstance(row.place, Pair)
            self._rows.setdefault(Command(row.place.read), []).append(row)
        self.id = self.get("id")
        self.baud = self.model.factory_baud
        self._late = None
        self._waiting = False
        self._follower = Follower(self.gains, self.tick, self.shaft.position)
        self._count = self._owed = self._good = 0
        self._seen: tuple[float, float] | None = None
        self._calm: tuple[float, float, float] | None = None
        self._patience = round(LOCKED_TIME / self.tick)
        self._orders = False, 0.0
        if not self.mask_saved:
            mask = self.row("led_error")
            self.memory.store(mask, mask.default or 0)
        # L-20: until a move is given, present position and time 0 stand in its place.
        self._ungiven = {"goal_position", "wait_goal_position"}
        self._faults = Alarm(0)

    @property
    def led(self) -> str:
        """On and off: the manual names no colour."""
        if not self.powered:
            return "off"
        on = self.get("led") == 0  # EL-09
        if self.alarms & self.get("led_error"):
            on = self.time % FLASH < FLASH / 2  # L-74
        return "on" if on else "off"

    # Packets

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:  # noqa: ARG002 - no command asks for the time
        if isinstance(event, Corrupt):
            return []  # L-10
        try:
            request = _parse(without_surplus(event) if self.surplus == "obeyed" else event)
        except ValueError:
            return []  # L-10
        if self.out_of_range == "ignored" and not self._in_range(request):
            return []
        command = request.command
        if not command.reply:
            self._obey(request)
            self._hold()
            self._seen = self._calm = None
            self._look()
            return []
        if request.id == BROADCAST and command is not Command.SERVO_ID_READ:
            return []  # L-5
        if command is Command.SERVO_MOVE_TIME_WAIT_READ and self.wait_read == "silent":
            return []
        return [(0.0, FRAMING.frame(Packet(self.id, command, self._answer(command))))]

    def _answer(self, command: Command) -> bytes:
        self._sense()
        data = bytearray(length_of(command.reply))
        for row in self._rows[command]:
            assert isinstance(row.place, Pair)
            raw = self.memory[row]
            if row.name == "torque_enable":
                raw = int(self.torque)
            data[row.place.at : row.place.at + row.layout.size] = row.layout.pack(raw)
        return bytes(data)

    def _obey(self, request: Request) -> None:
        match request.command, request.values:
            case Command.SERVO_MOVE_TIME_WRITE, (angle, time):
                self._move(self._set("goal_position", angle), self._set("goal_time", time))
            case Command.SERVO_MOVE_TIME_WAIT_WRITE, (angle, time):
                self._set("wait_goal_position", angle)
                self._set("wait_goal_time", time)
                self._waiting = True
            case Command.SERVO_MOVE_START, _:
                if self._waiting:  # L-23
                    self._waiting = False
                    self._move(self.get("wait_goal_position"), self.get("wait_goal_time"))
            case Command.SERVO_MOVE_STOP, _:
                self._stop()
            case Command.SERVO_ID_WRITE, (id,):
                if self.row("id").accepts(id):  # L-37
                    self.id = self._set("id", id)
            case Command.SERVO_ANGLE_OFFSET_ADJUST, (offset,):
                self._adjust(offset)
            case Command.SERVO_ANGLE_OFFSET_WRITE, _:
                self.memory.store(self.row("angle_offset"), self.get("angle_offset"))
            case Command.SERVO_ANGLE_LIMIT_WRITE, (low, high):
                self._limit("min_position", low, "max_position", high)
            case Command.SERVO_VIN_LIMIT_WRITE, (low, high):
                self._limit("min_voltage", low, "max_voltage", high)
            case Command.SERVO_TEMP_MAX_LIMIT_WRITE, (celsius,):
                self._set("max_temperature", celsius)
            case Command.SERVO_OR_MOTOR_MODE_WRITE, (mode, _, speed):
                if self.row("mode").accepts(mode):  # L-65
                    self._set_mode(Mode(mode), speed)
            case Command.SERVO_LOAD_OR_UNLOAD_WRITE, (load,):
                self._set("torque_enable", load)
            case Command.SERVO_LED_CTRL_WRITE, (led,):
                self._set("led", led)
            case Command.SERVO_LED_ERROR_WRITE, (mask,):
                self._set("led_error", mask)

    # Settings

    def _set(self, name: str, raw: int) -> int:
        """Set a register to the nearest value that it accepts (EL-15), for good if it is saved; give that."""
        row = self.row(name)
        low, high = row.limits
        raw = max(low, min(raw, high))
        if row.area is Area.EEPROM:
            self.memory.store(row, raw)
        else:
            self.memory[row] = raw
        self._ungiven.discard(name)
        return raw

    def _limit(self, lower: str, low: int, upper: str, high: int) -> None:
        """Set a pair of limits, or leave both as they are (L-47)."""
        rows = (self.row(lower), self.row(upper))
        low, high = (max(row.limits[0], min(raw, row.limits[1])) for row, raw in zip(rows, (low, high), strict=True))
        if low < high:
            self._set(lower, low)
            self._set(upper, high)

    def _in_range(self, request: Request) -> bool:
        """Tell whether the registers that a command sets accept its numbers."""
        numbers = encode(request)[5:-1]
        places = [(row, row.place) for row in self.model.registers.values() if isinstance(row.place, Pair)]
        return all(
            row.accepts(row.layout.unpack(numbers[place.at : place.at + row.layout.size]))
            for row, place in places
            if place.write == request.command
        )

    def _set_mode(self, mode: Mode, speed: int) -> None:
        if mode == Mode.MOTOR:
            self._late = None  # what comes back to position mode holds where it is (L-63)
            if speed and self.goal_torque:
                self.put("torque_enable", 1)
        self._set("mode", mode)
        self._set("motor_speed", speed if mode == Mode.MOTOR else 0)  # L-62

    def _adjust(self, offset: int) -> None:
        """Shift the zero until power-off: what holds its angle turns by as much, as fast as it can (L-40)."""
        row = self.row("angle_offset")
        low, high = row.limits
        offset = max(low, min(offset, high))
        change = row.decode(offset - self.get("angle_offset"))
        self.memory[row] = offset
        follower = self._follower
        if follower.target is not None:
            if follower.target == follower.point:
                follower.point += change
            follower.target += change

    def _sense(self) -> None:
        """Bring the registers that are measured up to date."""
        self.put("present_position", self.present)
        self.put("present_voltage", self._millivolts)
        self.put("present_temperature", self._celsius)
        for name in self._ungiven:
            low, high = self.row(name).limits
            self.put(name, max(low, min(self.present, high)))

    # Protections

    def _protect(self) -> None:
        """See what is wrong, and let go of the shaft or take hold of it accordingly."""
        seen = self.shaft.rail.voltage, self.shaft.case
        if seen == self._seen and not self._good:
            return
        self._seen = seen
        faults = Alarm(0)
        if not self.get("min_voltage") <= self._millivolts <= self.get("max_voltage"):
            self._good = 0
            faults |= Alarm.OVER_VOLTAGE  # EL-11
        elif Alarm.OVER_VOLTAGE in self._faults:
            self._good += 1
            if self._good * self.tick < BACK_TIME:
                faults |= Alarm.OVER_VOLTAGE
            else:
                self._good = 0
        # Point 16: off above the limit, on again below it; at the limit it stays as it is.
        was_hot = Alarm.OVER_TEMPERATURE in self._faults
        if self._celsius > self.get("max_temperature") - was_hot:
            faults |= Alarm.OVER_TEMPERATURE
        if faults != self._faults:
            self._faults = faults
            if Alarm.OVER_VOLTAGE in faults and not self.voltage_recovery:
                self.put("torque_enable", 0)
            self._hold()
            self._look()

    def _look(self) -> None:
        """Look at the registers that say what the motor is for; every tick would be too often for Python."""
        orders = self.torque, self.output
        if orders != self._orders:
            self._orders = orders
            self._calm = None

    @property
    def _millivolts(self) -> int:
        return max(0, min(self.row("present_voltage").scale.encode(self.voltage), 0xFFFF))

    @property
    def _celsius(self) -> int:
        return max(0, min(self.row("present_temperature").scale.encode(self.temperature), 0xFF))

    # Motion: what the firmware commands

    def control(self, ticks: int) -> None:
        while ticks:
            count = min(ticks, LOOK - self._count)
            if self._calm is not None and self._resting:
                self._owed += count
            else:
                if self._owed:
                    self._pay()
                count = self._run(count)
            ticks -= count
            self._count += count
            if self._count == LOOK:
                self._count = 0
                self._pay()
                self._look()

    @property
    def _resting(self) -> bool:
        """Whether nothing but heat goes on: the shaft stands, and so does all that could change the output."""
        return self._calm == self._scene() and self.shaft.at_rest

    def _scene(self) -> tuple[float, float, float]:
        return self.shaft.position, self.shaft.rail.voltage, self.shaft.case

    def _pay(self) -> None:
        """Let the heat flow of the ticks for which the shaft stood."""
        owed, self._owed = self._owed, 0
        # A shaft that something new pulls at has its own ticks; the heat of the old ones is no matter then.
        if owed and self.shaft.at_rest:
            self.shaft.tick(owed)

    def _run(self, ticks: int) -> int:
        """Let up to so many ticks of the control loop pass; give how many did."""
        self._protect()
        shaft, follower = self.shaft, self._follower
        loaded, follower.fixed = self._orders
        if loaded and not shaft.at_rest:
            # What the protections look at does not change within a run; a voltage that is back is counted by ticks.
            passed = shaft.run(1 if self._good else ticks, follower.output)
            follower.watch(shaft.position)
            self._calm = None
            return passed
        before = shaft.duty, follower.total, follower.point
        if loaded:
            shaft.drive(follower.output(shaft.position))
        else:
            shaft.release()
            follower.release()
        shaft.tick()
        follower.watch(shaft.position)
        calm = shaft.at_rest and before == (shaft.duty, follower.total, follower.point)
        pending = self._good or 0 < follower.stuck < self._patience
        self._calm = self._scene() if calm and not pending else None
        return 1

    @property
    def torque(self) -> bool:
        return self.get("torque_enable") == 1 and not self._faults

    @property
    def alarms(self) -> Alarm:
        """What is wrong, whether the light tells it or not."""
        return self._faults | Alarm.LOCKED_ROTOR if self._follower.stuck >= self._patience else self._faults

    @property
    def turning(self) -> bool:
        """Whether it is in motor mode."""
        return self.get("mode") == Mode.MOTOR

    @property
    def output(self) -> float:
        """Share of full output in motor mode, with direction. Assumption: forward is to higher positions."""
        return self.model.turn_scale.decode(self.get("motor_speed")) if self.torque else 0.0

    @property
    def present(self) -> int:
        """Position as measured, less the offset (L-45)."""
        low, high = self.sensor
        measured = self.row("present_position").scale.encode(self._angle)
        return max(low, min(measured, high)) - self.get("angle_offset")

    @property
    def _angle(self) -> float:
        """Shaft angle within one turn, around the middle of what the sensor covers."""
        low, high = self.sensor
        middle: float = self.row("present_position").decode(low + high) / 2
        return math.remainder(self.shaft.position - middle, TURN) + middle

    def _move(self, goal: int, time: int) -> None:
        """Begin a move, or keep it until the torque comes on."""
        follower = self._follower
        if self.turning:
            return  # L-64
        if self.goal_torque:
            self.put("torque_enable", 1)
        if follower.target is None:
            self._late = goal, time
            return
        goal = max(self.get("min_position"), min(goal, self.get("max_position")))  # L-31
        wanted: float = self.row("goal_position").decode(goal + self.get("angle_offset"))
        distance = wanted - self._angle
        follower.target = self.shaft.position + distance
        if time:
            follower.point = self.shaft.position  # L-30
            follower.speed = abs(distance) / self.row("goal_time").decode(time)
        else:
            follower.point = follower.target  # L-32

    def _stop(self) -> None:
        """End a move where the shaft is (L-28), and forget one that has not begun."""
        follower, self._late = self._follower, None
        if follower.target is None:
            return
        here = self.shaft.position
        # L-29: a servo at its goal stays there.
        if follower.target != follower.point or abs(follower.target - here) > UNIT:
            follower.target = follower.point = here

    def _hold(self) -> None:
        """Let go of the shaft when the torque goes off; take hold of it where it is when it comes on (L-70)."""
        follower = self._follower
        if not self.torque or self.turning:
            follower.target = None
        elif follower.target is None:
            follower.take_hold(self.shaft.position)
            if self._late is not None:  # L-69
                late, self._late = self._late, None
                self._move(*late)
            elif self.goal_after_limp == "kept" and "goal_position" not in self._ungiven:
                self._move(self.get("goal_position"), 0)
