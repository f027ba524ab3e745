"""What the firmware of all HerkuleX servos does with motor and registers, as the manual of the DRS-0602 describes it.

Section and register (NO) numbers are those of the DRS-0602 user's manual, EH entries those of
docs/decisions.md, H numbers those of docs/behaviours.md.

The series differ in the sensor of the position, in what endless turn controls,
and in the registers that tell of both: see `series`. All else, such as the size of a step and the unit of a
measured value, stands in the table of the model. Plans are kept in radians and become steps when they are read.

A loop of control measures, checks what may be wrong, moves the plan on and sets the bridge until the next loop. So
a JOG counts from the loop before it was heard. The laws of control are in servobus.families.herkulex.control.
"""

from collections.abc import Iterable
from typing import ClassVar, cast

from servobus.core.ids import BROADCAST
from servobus.core.units import Flags
from servobus.families.herkulex.control import (
    OverloadTimer,
    PositionControl,
    Sensor,
    SpeedControl,
    Speedometer,
    Stages,
)
from servobus.families.herkulex.firmware.answering import AnsweringServo
from servobus.families.herkulex.protocol import (
    TICK,
    ControlMode,
    Jog,
    Led,
    StatusDetail,
    StatusError,
    TorqueControl,
)
from servobus.virtual.device.options import ON_OFF, OneOf, Option, Span
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.trajectory import GoalTrajectory, Profile, Ramp, StopDetection, ramp_time

CLOCK = 2_000_000
"""bit/s = CLOCK / (code + 1): fits all codes of NO 5. 0x10 is really 117647, 0x22 really 57143 (within the 3 %)."""
LOOPS = 4
"""Control loops in one unit of 11.2 ms; assumption: a loop of 2.8 ms is fast enough for the factory gains."""
WARMING = 36
"""Loops in which a standing shaft is left alone while it gets warmer or colder: 0.1 s."""
BLINK = 0.25
"""s; assumption: how long the light is on at power-on (3-3 only says that it blinks once)."""
SPEED_GAINS = 100, 12000
"""Gains of speed control where no register holds them: assumption EH-57, the factory settings of the DRS-0602."""

WATCHED = StatusError.INPUT_VOLTAGE, StatusError.TEMPERATURE, StatusError.OVERLOAD, StatusError.DRIVER_FAULT
CAUSES = StatusDetail(0x3C)
"""Bits of Status Detail that stay until they are cleared; the others show what is (4-2 NO 44)."""


class HerkulexServo(AnsweringServo):
    """What all series have. Where the manual says nothing about motion, these assumptions hold.

    - A new profile starts where the present one is, even if the shaft is late; out of infinite turn, where
      the shaft is.
    - Without torque the goal stays, and the trajectory is where the shaft is, for there it will start (H-51).
    - The moving flag is up from the JOG on, and then tells what is measured: a shaft that is held has stopped.
    - Overload is a matter of the output alone (NO 23), so speed that cannot be reached is one too.
    - Torque that goes off leaves the shaft to its own momentum.
    - Inposition is told only while the position is controlled: the ACKs of 6-1, 6-8 and 6-9 print 00 00.
    - Disable VOR in infinite turn ramps the speed up from 0; the stop flag there stops without a ramp.
    """

    tick = TICK / LOOPS

    goal_after_limp = Option(
        OneOf(("present", "kept")), practice="present", manual="present", decision="EH-43",
        text="what the goal is when the torque comes on in position control: where the shaft is, or the last goal",
    )  # fmt: skip
    position_flags = Option(
        ON_OFF, practice=False, manual=False, decision="EH-44",
        text="whether position words carry flags in the bits above the position",
    )  # fmt: skip
    brake_jog = Option(
        ON_OFF, practice=False, manual=False, decision="EH-15",
        text="whether a JOG moves a servo that is braked: it switches the torque on",
    )  # fmt: skip
    goal_limits = Option(
        OneOf(("calibrated", "absolute")), practice="calibrated", manual="calibrated", decision="EH-36",
        text="which goal is compared to the position limits: the one in the JOG, or that with Calibration Difference",
    )  # fmt: skip
    turn_playtime = Option(
        OneOf(("ramp", "ignored")), practice="ramp", manual="ramp", decision="EH-40",
        text="what playtime does in infinite turn: it sets the length of the ramp to the new speed, or nothing",
    )  # fmt: skip
    answer_time = VirtualServo.answer_time.but(
        practice=Span(0.0005, 0.0005), manual=Span(0.0005, 0.0005), decision="EH-45"
    )
    eeprom_pause = VirtualServo.eeprom_pause.but(decision="EH-46")
    boot_time = VirtualServo.boot_time.but(practice=Span(0.25, 0.45), manual=Span(0.25, 0.25), decision="EH-47")

    # Life

    driver_faulty = False
    """Whether the motor driver is broken; set it to see what the servo does about it, if its model reports that."""
    position_marks = 0x8000
    """What `position_flags` sets above a position."""

    sensor: ClassVar[type[Sensor]]
    """How the series senses its position."""

    def start(self) -> None:
        super().start()
        self._full: int = self.row("max_pwm").limits[1]
        """pwm that is full output (NO 64 and NO 22)."""
        scale = self.row("absolute_position").scale
        steps = self.row("goal_position").limits[1] + 1
        self._counter = self.sensor(scale.decode(1) - scale.decode(0), scale.encode(0.0), steps)
        self._find()
        self._per_step = 1 / self._counter.step
        self._speed_unit = self.row("differential_position").scale.decode(1)
        lasts = round(self._counter.step / self._speed_unit / self.tick)  # EH-58
        self._slowest = self._counter.step / (lasts * self.tick)  # rad/s
        self._loops = 0
        self._goal = self._here
        self._trajectory = GoalTrajectory(self.tick, Profile(self._goal, self._goal))
        count = round(self.shaft.position * self._per_step)
        self._stop = StopDetection(count)
        self._meter = Speedometer(lasts, count)
        self._position, self._turning = PositionControl(self.tick, self._full), SpeedControl(self.tick)
        self._watches = {error: OverloadTimer() for error in WATCHED}
        self._driven = self._alert = False
        self._pwm = 0
        self.baud = CLOCK / (self.get("baud_rate") + 1)  # EEP only: a new one waits for this moment (H-37)
        self._settle()

    @property
    def home(self) -> float:
        return 0.0  # the middle of the range

    @property
    def torque(self) -> bool:
        return self.get("torque_control") != TorqueControl.FREE  # a braked shaft is held as well (H-48)

    @property
    def led(self) -> str:
        if not self.powered:
            return "off"
        if self.get("alarm_led_policy") & self.get("status_error"):
            period = self._value("led_blink_period")
            # Assumption: half of the period is light, and period 0 is steady.
            return "red" if not period or self.time % period < period / 2 else "off"
        if self.time < self.started + BLINK:
            return "green"  # assumption: the colour is not in the manual
        shown = Led(self.get("led_control"))
        return "+".join(colour.name.lower() for colour in Led if colour & shown and colour.name) or "off"

    @property
    def alarms(self) -> StatusError:
        """What Status Error holds: each stays until a host clears it (H-19)."""
        return StatusError(self.get("status_error"))

    @property
    def trajectory(self) -> float | None:
        return self._trajectory.position if self._driven else None

    # Registers

    def options_changed(self) -> None:
        self._settle()

    def _settle(self) -> None:
        """Do what follows from the values of RAM."""
        self.id = self.get("id")
        self.garbage_timeout = self._value("packet_garbage_check_period")
        volts, celsius, overload, _ = self._watches.values()  # a broken driver is told at once (assumption)
        volts.limit = celsius.limit = self.get("adc_fault_check_period") * LOOPS
        period = self._overload_period()
        overload.limit = int(period / self.tick + 1e-6)
        # Without a period there is no output that would be too high (H-64).
        self._too_high = self.get("overload_pwm_threshold") if period else self._full
        self._limits = tuple(  # what still reads as allowed
            (self._value(name) + self.row(name).scale.decode(self.get(name) + beyond)) / 2
            for name, beyond in (("min_voltage", -1), ("max_voltage", 1), ("max_temperature", 1))
        )
        self._stop.loops = self.get("stop_detection_period") * LOOPS
        self._stop.threshold = self.get("stop_threshold")
        forward = (self.get(f"position_feedforward_{name}_gain") for name in ("1st", "2nd"))
        self._position.tune(*(self.get(f"position_k{name}") for name in "pdi"), *forward)
        self._turning.tune(*self._speed_gains())
        names = "dead_zone", "pwm_offset", "min_pwm", "max_pwm", "saturator_offset", "saturator_slope"
        self._stages = Stages(*(self.get(name) for name in names))
        known = sum(cast("Flags[StatusError]", self.row("status_error").scale).used)
        self.put("status_error", self.get("status_error") & known)  # H-59
        self._tells_driver = bool(known & StatusError.DRIVER_FAULT)
        self._switch(self.get("torque_control"))

    def _overload_period(self) -> float:
        """Give the time in seconds that an overload must last."""
        return self._value("overload_detection_period")

    def _speed_gains(self) -> tuple[int, int]:
        """Give the P and I gains of speed control."""
        return SPEED_GAINS

    def _sense(self) -> None:
        here, trajectory = self._here, self._trajectory
        set_point = trajectory.position if self._driven and trajectory.position is not None else here
        absolute, goal = self._counter.read(here), self._counter.read(self._goal)
        self._measured("voltage", self.voltage)
        self._measured("temperature", self.temperature)
        self.put("tick", self._loops // LOOPS & 0xFF)
        marks = self.position_marks if self.position_flags else 0
        self.put("absolute_position", absolute | marks)
        self.put("calibrated_position", self._counter.told(absolute - self.get("calibration_difference")) | marks)
        self._measured("differential_position", self._meter.way * self._slowest)
        self.put("pwm", self._pwm)
        self.put("absolute_goal_position", goal)
        self.put("absolute_desired_trajectory_position", self._counter.read(set_point))
        self._measured("desired_velocity", self._planned_speed if self._driven else 0.0)
        state = self._stop.moving * StatusDetail.MOVING | self._driven * StatusDetail.TORQUE_ON
        if self._driven and trajectory.position is not None and abs(goal - absolute) < self.get("inposition_margin"):
            state |= StatusDetail.INPOSITION
        self.put("status_detail", self.get("status_detail") & CAUSES | state)

    def _fault(self, error: StatusError, cause: int = 0) -> None:
        self.put("status_error", self.get("status_error") | error)
        self.put("status_detail", self.get("status_detail") | cause)
        self._switch(self.get("torque_control"))

    def _switch(self, state: int) -> None:
        """Bring the motor into a state of Torque Control, unless an error forbids it (NO 10)."""
        if self.get("torque_policy") & self.get("status_error"):
            state = TorqueControl.FREE
        self.put("torque_control", state)
        driven = state == TorqueControl.ON
        if driven and not self._driven:
            self.shaft.brake()  # until the next loop
            if self.get("current_control_mode") == ControlMode.POSITION:
                goal = self._goal
                self._hold()
                if self.goal_after_limp == "kept":
                    self._goal = goal
                    self._begin(Profile(self._here, goal))
            else:
                self._begin(Ramp())  # assumption: it waits for a JOG that says how fast
        if not driven:
            self._pwm = 0
            (self.shaft.brake if state == TorqueControl.BRAKE else self.shaft.release)()
        self._driven = driven

    def _value(self, name: str) -> float:
        return float(self.row(name).decode(self.get(name)))

    def _measured(self, name: str, value: float) -> None:
        """Put a value into a register, as far as it goes there."""
        low, high = self.row(name).limits
        self.put(name, max(low, min(self.row(name).scale.encode(value), high)))

    def _find(self) -> None:
        """Find out at power-on where the shaft is."""

    @property
    def _here(self) -> float:
        """Where the sensor takes the shaft to be, rad."""
        return self._counter.where(self.shaft.position)

    # What is to be done: plans

    def _begin(self, plan: Profile | Ramp) -> None:
        if not self._driven or type(plan) is not type(self._trajectory.plan):
            self._position.reset()
            self._turning.reset()
        self._trajectory.begin(plan)
        if self._trajectory.moving or (isinstance(plan, Profile) and plan.start != plan.goal):
            self._stop.start()

    def _hold(self) -> None:
        """Make the present position the goal (H-51, H-82)."""
        self._goal = here = self._here
        self._counter.wrap(here)
        self._begin(Profile(here, here))

    def _jog(self, entries: Iterable[tuple[Jog, int]]) -> None:
        """Obey the last entry that is for this servo and not invalid (H-74)."""
        own = [entry for entry in entries if entry[0].id in (self.id, BROADCAST) and not entry[0].invalid]
        if own:
            jog, playtime = own[-1]
            self.put("led_control", jog.led)
            self.put("current_control_mode", jog.mode)
            if self.brake_jog and self.get("torque_control") == TorqueControl.BRAKE:
                self._switch(TorqueControl.ON)
            if self._driven:  # EH-15, EH-16: otherwise nothing more happens
                (self._go if jog.mode is ControlMode.POSITION else self._turn)(jog, playtime * TICK)

    def _go(self, jog: Jog, duration: float) -> None:
        start, speed = self._trajectory.position, 0.0 if jog.no_override else self._speed
        if start is None or jog.stop:
            self._hold()
            start = self._here
        if jog.stop:
            return
        # The number asked for is what is compared, not the absolute goal (EH-36).
        shift = self.get("calibration_difference") if self.goal_limits == "absolute" else 0
        value = max(self.get("min_position") - shift, min(jog.value, self.get("max_position") - shift))
        if value != jog.value:
            self._fault(StatusError.POSITION_LIMIT)
            if not self._driven:
                return
        goal = max(0, min(value + self.get("calibration_difference"), self._counter.size - 1))
        self._goal = self._counter.angle(goal)
        self._begin(Profile(start, self._goal, duration, self._ramp_time(duration), speed))

    def _turn(self, jog: Jog, duration: float) -> None:
        """Change the speed; the playtime sets how long that takes (assumption EH-40)."""
        before = 0.0 if jog.no_override else self._in_turn(self._speed)
        after = self.model.turn_scale.decode(jog.value)
        ramp = self._ramp_time(duration if self.turn_playtime == "ramp" else 0.0)
        self._begin(Ramp() if jog.stop else Ramp(before, after, ramp))

    def _in_turn(self, speed: float) -> float:
        """Give a speed as a plan of endless turn has it."""
        return speed

    @property
    def _planned_speed(self) -> float:
        """Speed of the plan, rad/s."""
        return self._trajectory.speed

    @property
    def _speed(self) -> float:
        """Speed of the plan, as far as the supply allows it."""
        return max(-self.top_speed, min(self._planned_speed, self.top_speed))

    def _ramp_time(self, duration: float) -> float:
        return ramp_time(duration, self._value("acceleration_ratio"), self._value("max_acceleration_time"))

    def _turn_output(self) -> float:
        """Give the pwm that endless turn asks for: what controls the speed."""
        error = (self._trajectory.speed - self._meter.way * self._slowest) / self.model.turn_scale.decode(1)
        return self._turning.output(error)

    # The control loop

    def control(self, ticks: int) -> None:
        ticks -= self._loop()  # by itself, as surroundings may have changed
        while ticks > 0:
            ticks -= self._wait(ticks) if self._quiet else self._loop()

    def _loop(self) -> int:
        shaft = self.shaft
        shaft.tick()
        self._loops += 1
        position = shaft.state.output
        count = round(position * self._per_step)
        self._meter.step(count)
        self._check()
        self._stop.step(count, planned=False)
        trajectory = self._trajectory
        trajectory.step()
        if self._driven:
            setpoint = trajectory.position
            if setpoint is None:
                self._pwm = self._stages.speed(self._turn_output())
            else:
                error = round((setpoint - self._counter.where(position)) * self._per_step)
                speed = trajectory.speed / self._speed_unit if self._position.forward else 0.0
                self._pwm = self._stages.position(self._position.output(error, speed), error)
            shaft.drive(self._pwm / self._full)
        return 1

    def _check(self) -> None:
        """Report what has been wrong for too long (NO 12 to 14, 23)."""
        lowest, highest, hottest = self._limits
        volts = not lowest <= self.shaft.rail.voltage < highest
        celsius = self.shaft.state.case >= hottest
        overload = abs(self._pwm) > self._too_high
        driver = self.driver_faulty and self._tells_driver
        if volts or celsius or overload or driver or self._alert:
            self._alert = volts or celsius or overload or driver
            for wrong, (error, watch) in zip((volts, celsius, overload, driver), self._watches.items(), strict=True):
                if watch.step(wrong) and not self.get("status_error") & error:
                    self._fault(error)

    @property
    def _quiet(self) -> bool:
        """Whether more of the same would change nothing but temperatures."""
        if not self.shaft.at_rest or self._stop.moving or not self._meter.steady:
            return False
        if self._alert and any(watch.waiting for watch in self._watches.values()):
            return False
        if not self._driven:
            return True
        setpoint = self._trajectory.position
        if not self._trajectory.over:
            return False
        if setpoint is None:
            return self._trajectory.speed == 0
        return self._position.steady(round((setpoint - self._here) * self._per_step))

    def _wait(self, ticks: int) -> int:
        """Let up to this many quiet loops pass at once; tell how many."""
        state = self.shaft.state
        to_go = WARMING - self._loops % WARMING
        warming = abs(state.winding - state.case) > 0.5 or abs(state.current) > 0.1
        # Ending where temperatures are looked at anyway, it makes no difference how time is cut.
        loops = ticks if ticks < to_go else to_go if warming else ticks - (ticks - to_go) % WARMING
        self.shaft.tick(loops)
        self._loops += loops
        self._check()
        return loops
