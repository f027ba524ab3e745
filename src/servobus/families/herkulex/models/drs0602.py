"""DRS-0602. Source: DRS-0602 user's manual, sections 2-3 (specification) and 4-2 (register map, NO 1 to 60)."""

from servobus.core.registers import S8, S16, U8, U16, Access, Int, Motion, Register
from servobus.core.units import Choice, Count, Flags, Quantity, deg, ms
from servobus.families.base import Answers
from servobus.families.herkulex.places import Eep, EepRam, Ram
from servobus.families.herkulex.protocol import (
    BAUD,
    LONGEST_PLAYTIME,
    TICK,
    Aux,
    ControlMode,
    Led,
    StatusDetail,
    StatusError,
    TorqueControl,
)
from servobus.families.herkulex.verbs import HERKULEX
from servobus.families.model import Model, Performance, SpecSheet

READ, RESERVED = Access.READ, Access.RESERVED
POSITION = Int(2, flags=0x8000)
"""A position of 15 bits. Bit 15 is a flag of the servo's own; the maker's PC tool masks it off with 0x7FFF."""
GAIN = (0, 32767)
PERIOD = (0, 254)


class DRS0602(Model):
    """Position 16384 is 0°; 12962 steps are one turn, so that 0 .. 32767 is 2.5 turns.

    Which direction grows is not in the manual.
    """

    title = "DRS-0602"
    family = HERKULEX
    number = 0x0602
    factory_baud = 115_200
    bauds = tuple(BAUD.codes.values())
    max_move_time = LONGEST_PLAYTIME * TICK
    turn_scale = Quantity("rad/s", 0.62 * deg)  # 6-5
    brakes = True
    firmware = "servobus.families.herkulex.firmware:HerkulexServo"
    motors = "servobus.families.herkulex.motors:DRS0602_SETS"
    sheet = SpecSheet(
        maker="Dongbu Robot",
        performance=(Performance(14.8, 7.6, 60 * deg / 0.164),),
        voltage=(9.5, 14.8),
        nominal_voltage=12.0,
        temperature=(0.0, 80.0),
        angle=900 * deg,
        resolution=360 * deg / 12962,
        weight=0.145,
        size=(0.056, 0.035, 0.046),
        gear_ratio=202,
        gear="metal",
        motor="Faulhaber coreless DC, magnetic encoder",
        standby_current=0.033,
        link="TTL level, full duplex, 8N1, 57.6 kbit/s to 1 Mbit/s",
    )

    angle = Quantity("rad", 360 * deg / 12962, zero=16384)
    second_angle = Quantity("rad", 0.163 * deg, zero=1024)
    ticks = Quantity("s", TICK)
    share = Quantity("1", 1 / 1023)
    percent = Quantity("1", 0.01)
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)
    steps = Count("position unit")
    errors = Flags(StatusError)
    eighths, sixteenths = Quantity("", 1 / 8), Quantity("", 1 / 16384)

    model_no1 = Register(
        Eep(0), U8, Count(), "model number, upper two digits", default=0x06, access=READ,
        note="EH-03: 0x06 as the row's own example says, not the 0x04 of the DRS-0402",
    )  # fmt: skip
    model_no2 = Register(Eep(1), U8, Count(), "model number, lower two digits", default=0x02, access=READ)
    version1 = Register(Eep(2), U8, Count(), "firmware version, high part", default=0x00, access=READ)
    version2 = Register(
        Eep(3), U8, Count(), "firmware version, low part", default=0x90, access=READ,
        note="EH-41: its access is not printed; read-only like version1",
    )  # fmt: skip
    baud_rate = Register(
        Eep(4), U8, BAUD, "bus speed; acts after a restart", default=0x10, limits=(0x01, 0x22),
        allowed=(0x01, 0x02, 0x03, 0x04, 0x07, 0x09, 0x10, 0x22),
    )  # fmt: skip
    reserved_6 = Register(Eep(5), U8, Count(), "reserved, NO 6", access=RESERVED)
    id = Register(
        EepRam(6, 0), U8, Count(), "bus id", default=219, limits=(0, 253),
        volatile=True,  # it is no setting that a restart would tell
        note="EH-05: 219; the 253 of all examples is the default of older models",
    )  # fmt: skip
    ack_policy = Register(
        EepRam(7, 1), U8, Choice(Answers), "which requests are answered beside STAT: 0 none, 1 reads, 2 all",
        default=1, limits=(0, 2), note="EH-12: RAM address 1, not 14",
    )  # fmt: skip
    alarm_led_policy = Register(
        EepRam(8, 2), U8, errors, "errors that make the red light blink", default=0x5F, limits=(0, 0x7F)
    )
    torque_policy = Register(
        EepRam(9, 3), U8, errors, "errors that switch the torque off", default=0x15, limits=(0, 0x7F),
        note="EH-24: also called Servo Policy",
    )  # fmt: skip
    reserved_11 = Register(EepRam(10, 4), U8, Count(), "reserved, NO 11", access=RESERVED)
    max_temperature = Register(
        EepRam(11, 5), U8, celsius, "temperature above which an error is reported", default=80, limits=(0, 110),
        note="EH-06: 80 °C as in the table; 0xDF is a raw reading of older models",
    )  # fmt: skip
    min_voltage = Register(
        EepRam(12, 6), U8, volts, "supply below which an error is reported", default=95, limits=(92, 200),
        note="EH-07: 9.5 V as in the table, not 9.2 V",
    )  # fmt: skip
    max_voltage = Register(
        EepRam(13, 7), U8, volts, "supply above which an error is reported", default=170, limits=(92, 200),
        note="EH-07: 17.0 V as in the table, not 18.0 V",
    )  # fmt: skip
    acceleration_ratio = Register(
        EepRam(14, 8), U8, percent, "share of a move spent speeding up, and as much slowing down",
        default=25, limits=(0, 50), note="EH-14: at 50 % the speed profile is a triangle, at 0 a rectangle",
    )  # fmt: skip
    max_acceleration_time = Register(
        EepRam(15, 9),
        U8,
        ticks,
        "longest time spent speeding up; 0 is a rectangular profile",
        default=45,
        limits=PERIOD,
    )
    dead_zone = Register(EepRam(16, 10), U8, steps, "position error without output", default=0, limits=(0, 254))
    saturator_offset = Register(
        EepRam(17, 11), U8, share, "output allowed by the saturator at the goal", default=0, limits=(0, 254)
    )
    saturator_slope = Register(
        EepRam(18, 12), U16, Quantity("pwm per position unit", 1 / 256),
        "output allowed more with each step from the goal; 0 is no saturator", default=0, limits=(0, 32767),
    )  # fmt: skip
    pwm_offset = Register(
        EepRam(20, 14), S8, share, "output added in position control", default=0, motion=Motion.OUTPUT
    )
    min_pwm = Register(EepRam(21, 15), U8, share, "lowest output", default=0, limits=(0, 254), motion=Motion.OUTPUT)
    max_pwm = Register(EepRam(22, 16), U16, share, "highest output", default=1023, limits=(0, 1023))
    overload_pwm_threshold = Register(
        EepRam(24, 18), U16, share, "output above which it counts as overload; full output is never above 1023",
        default=1022, limits=(0, 1023), note="EH-13: compared strictly, so 1023 switches the detection off",
    )  # fmt: skip
    min_position = Register(
        EepRam(26, 20), U16, angle, "lowest goal", default=10627, limits=(0, 32767), motion=Motion.LIMIT,
        note="EH-10: 10627 as in the table; 0x2A belongs to 11-bit models",
    )  # fmt: skip
    max_position = Register(
        EepRam(28, 22), U16, angle, "highest goal", default=22129, limits=(0, 32767), motion=Motion.LIMIT,
        note="EH-10: 22129 as in the table; 0x7D5 belongs to 11-bit models",
    )  # fmt: skip
    position_kp = Register(EepRam(30, 24), U16, eighths, "position control, P gain", default=70, limits=GAIN)
    position_kd = Register(EepRam(32, 26), U16, eighths, "position control, D gain", default=0, limits=GAIN)
    position_ki = Register(EepRam(34, 28), U16, sixteenths, "position control, I gain", default=0, limits=GAIN)
    position_feedforward_1st_gain = Register(
        EepRam(36, 30),
        U16,
        Count(),
        "feed forward of the profile's speed; no scale is given",
        default=0,
        limits=GAIN,
    )
    position_feedforward_2nd_gain = Register(
        EepRam(38, 32), U16, Count(), "feed forward of the profile's acceleration; no scale is given",
        default=0, limits=GAIN,
    )  # fmt: skip
    velocity_kp = Register(
        EepRam(40, 34), U16, Quantity("", 1 / 64), "speed control, P gain", default=100, limits=GAIN,
        note="EH-19: its access is not printed; the maker's PC tool writes it",
    )  # fmt: skip
    velocity_ki = Register(
        EepRam(42, 36), U16, sixteenths, "speed control, I gain", default=12000, limits=GAIN,
        note="EH-19: printed 0x02EE0, access not printed; the maker's PC tool writes it",
    )  # fmt: skip
    led_blink_period = Register(EepRam(44, 38), U8, ticks, "period of the alarm light", default=45, limits=PERIOD)
    adc_fault_check_period = Register(
        EepRam(45, 39), U8, ticks, "time a wrong voltage or temperature must last to be an error",
        default=45, limits=PERIOD,
    )  # fmt: skip
    packet_garbage_check_period = Register(
        EepRam(46, 40), U8, ticks, "age at which an unfinished packet is dropped", default=18, limits=PERIOD
    )
    stop_detection_period = Register(
        EepRam(47, 41), U8, ticks, "time without motion that counts as stopped", default=27, limits=PERIOD
    )
    overload_detection_period = Register(
        EepRam(48, 42), U8, Quantity("s", 4 * ms), "time an overload must last to be an error; 0 switches it off",
        default=150, limits=PERIOD, note="EH-08: 4 ms as in the table, not 11.2 ms",
    )  # fmt: skip
    stop_threshold = Register(
        EepRam(49, 43),
        U8,
        steps,
        "position change below which it counts as standing",
        default=6,
        limits=(0, 254),
    )
    inposition_margin = Register(
        EepRam(50, 44), U8, steps, "distance to the goal that counts as arrived", default=6, limits=(0, 254)
    )
    reserved_40 = Register(EepRam(51, 45), U8, Count(), "reserved, NO 40", access=RESERVED)
    calibration_difference = Register(
        EepRam(52, 46), S16, steps, "absolute less calibrated position; NO 41 and 42", default=0,
        limits=(-1495, 1495), motion=Motion.ZERO,
        note="EH-11: one signed 16-bit value; -255 .. 255 fits the older models",
    )  # fmt: skip
    status_error = Register(
        Ram(48), U8, errors, "errors; each stays until it is written 0", default=0, limits=(0, 0x7F),
        volatile=True, latched=True, note="EH-22: bit 0x20 is never set",
    )  # fmt: skip
    status_detail = Register(
        Ram(49), U8, Flags(StatusDetail), "causes of invalid packets, to be cleared; moving, inposition, torque on",
        default=0, limits=(0, 0x7F), volatile=True, latched=True,
        live=StatusDetail.MOVING | StatusDetail.INPOSITION | StatusDetail.TORQUE_ON,
    )  # fmt: skip
    aux_1 = Register(
        Ram(50), U8, Choice(Aux), "sets absolute_position anew", default=0, limits=(0, 6), volatile=True,
        live=0xFF,  # it is 0 again as soon as that is done
        motion=Motion.ZERO,
    )  # fmt: skip
    reserved_46 = Register(Ram(51), U8, Count(), "reserved, NO 46", default=0, access=RESERVED)
    torque_control = Register(
        Ram(52), U8, Choice(TorqueControl), "free, brake or on", default=0, limits=(0, 0x60), allowed=(0, 0x40, 0x60),
        note="EH-15: a JOG moves nothing while braked",
    )  # fmt: skip
    led_control = Register(
        Ram(53),
        U8,
        Flags(Led),
        "lights",
        default=0,
        limits=(0, 7),
        volatile=True,  # a JOG sets it
        note="EH-04: bit 0x04 is red, not green",
    )
    voltage = Register(Ram(54), U8, volts, "supply voltage", limits=(0, 200), access=READ)
    temperature = Register(Ram(55), U8, celsius, "internal temperature", limits=(0, 110), access=READ)
    current_control_mode = Register(
        Ram(56), U8, Choice(ControlMode), "position control or infinite turn; a JOG changes it", default=0,
        limits=(0, 1), access=READ, note="EH-16: a JOG changes it without torque too",
    )  # fmt: skip
    tick = Register(Ram(57), U8, ticks, "running time, wraps after 2.87 s", access=READ)
    calibrated_position = Register(
        Ram(58), POSITION, angle, "position less calibration_difference", access=READ,
        note="EH-09: 0° is 16384, as in the maker's PC tool; the manual's formula counts from -180°",
    )  # fmt: skip
    absolute_position = Register(Ram(60), POSITION, angle, "position", access=READ, note="EH-09")
    differential_position = Register(
        Ram(62), S16, turn_scale, "speed", access=READ, note="EH-35: signed, as other drivers read it"
    )
    pwm = Register(
        Ram(64), S16, share, "output", default=0, access=READ, note="EH-35: signed, as other drivers read it"
    )
    absolute_2nd_position = Register(
        Ram(66), U16, second_angle, "position by the potentiometer", access=READ,
        note="its zero, 1024, is from another driver; the manual gives none",
    )  # fmt: skip
    absolute_goal_position = Register(
        Ram(68), POSITION, angle, "goal, uncalibrated; a JOG sets it", limits=(0, 32767), access=READ
    )
    absolute_desired_trajectory_position = Register(
        Ram(70), POSITION, angle, "where the profile is now, uncalibrated", access=READ
    )
    desired_velocity = Register(
        Ram(72), S16, Quantity("rad/s", 0.034 * deg), "speed of the profile now", default=0, access=READ,
        note="EH-34: unit as printed, origin unknown; EH-35: signed is an assumption",
    )  # fmt: skip

    # The names that all families share, see servobus.families.model.
    baud = baud_rate
    answer_level = ack_policy
    torque_enable = torque_control
    goal_position = absolute_goal_position
    present_position = calibrated_position
    present_speed = differential_position
    present_load = pwm
    present_voltage = voltage
    present_temperature = temperature
    output_limit = max_pwm
    calibration = calibration_difference
