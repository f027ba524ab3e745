"""What all models of HerkuleX share, and the servo of which nothing more is known.

Sources: DRS-0602 user's manual, section 4-2 (register map); the maps of DRS-0101 and 0201 in their manual, and of
DRS-0401, 0402 and 0601 as other drivers and the maker's PC tool have them, show these rows at the same addresses.
"""

from servobus.core.registers import S8, S16, U8, U16, Access, Int, Motion, Register
from servobus.core.units import RAW, Choice, Count, Flags, Quantity
from servobus.families.base import Answers
from servobus.families.herkulex.places import Eep, EepRam, Ram
from servobus.families.herkulex.protocol import (
    BAUD,
    LONGEST_PLAYTIME,
    TICK,
    ControlMode,
    Led,
    StatusDetail,
    StatusError,
    TorqueControl,
)
from servobus.families.herkulex.verbs import HERKULEX
from servobus.families.model import Model

READ, RESERVED = Access.READ, Access.RESERVED
POSITION = Int(2, flags=0x8000)
"""A position of 15 bits. Bit 15 is a flag of the servo's own; the maker's PC tool masks it off with 0x7FFF."""
GAIN = (0, 32767)
PERIOD = (0, 254)


class HerkulexTable(Model):
    """Rows of all models. Angles, speeds, supply and heat have another unit from model to model.

    A position has 1024, 2048 or 32768 steps, a volt 10 or 13.5 units; the small models tell a raw temperature.
    """

    family = HERKULEX
    factory_baud = 115_200
    motors = "servobus.families.herkulex.motors:MOTORS"
    bauds = tuple(BAUD.codes.values())
    max_move_time = LONGEST_PLAYTIME * TICK
    brakes = True

    ticks = Quantity("s", TICK)
    share = Quantity("1", 1 / 1023)
    percent = Quantity("1", 0.01)
    steps = Count("position unit")
    errors, errors_but_driver = Flags(StatusError), Flags(StatusError, unused=StatusError.DRIVER_FAULT)
    eighths, sixteenths = Quantity("", 1 / 8), Quantity("", 1 / 16384)

    model_no1 = Register(Eep(0), U8, Count(), "model number, upper two digits", access=READ)
    model_no2 = Register(Eep(1), U8, Count(), "model number, lower two digits", access=READ)
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
        EepRam(6, 0), U8, Count(), "bus id", limits=(0, 253),
        volatile=True,  # it is no setting that a restart would tell
    )  # fmt: skip
    ack_policy = Register(
        EepRam(7, 1), U8, Choice(Answers), "which requests are answered beside STAT: 0 none, 1 reads, 2 all",
        default=1, limits=(0, 2), note="EH-12: RAM address 1, not 14",
    )  # fmt: skip
    alarm_led_policy = Register(EepRam(8, 2), U8, errors, "errors that make the red light blink", limits=(0, 0x7F))
    torque_policy = Register(
        EepRam(9, 3), U8, errors, "errors that switch the torque off", limits=(0, 0x7F),
        note="EH-24: also called Servo Policy",
    )  # fmt: skip
    reserved_11 = Register(EepRam(10, 4), U8, Count(), "reserved, NO 11", access=RESERVED)
    max_temperature = Register(EepRam(11, 5), U8, RAW, "temperature above which an error is reported", access=READ)
    min_voltage = Register(EepRam(12, 6), U8, RAW, "supply below which an error is reported", access=READ)
    max_voltage = Register(EepRam(13, 7), U8, RAW, "supply above which an error is reported", access=READ)
    acceleration_ratio = Register(
        EepRam(14, 8),
        U8,
        percent,
        "share of a move spent speeding up, and as much slowing down",
        default=25,
        limits=(0, 50),
    )
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
        limits=(0, 1023), note="EH-13: compared strictly, so 1023 switches the detection off",
    )  # fmt: skip
    min_position = Register(EepRam(26, 20), U16, RAW, "lowest goal", access=READ, motion=Motion.LIMIT)
    max_position = Register(EepRam(28, 22), U16, RAW, "highest goal", access=READ, motion=Motion.LIMIT)
    position_kp = Register(EepRam(30, 24), U16, eighths, "position control, P gain", limits=GAIN)
    position_kd = Register(EepRam(32, 26), U16, eighths, "position control, D gain", limits=GAIN)
    position_ki = Register(EepRam(34, 28), U16, sixteenths, "position control, I gain", default=0, limits=GAIN)
    position_feedforward_1st_gain = Register(
        EepRam(36, 30), U16, Count(), "feed forward of the profile's speed; no scale is given", default=0, limits=GAIN
    )
    position_feedforward_2nd_gain = Register(
        EepRam(38, 32),
        U16,
        Count(),
        "feed forward of the profile's acceleration; no scale is given",
        default=0,
        limits=GAIN,
    )
    led_blink_period = Register(EepRam(44, 38), U8, ticks, "period of the alarm light", default=45, limits=PERIOD)
    adc_fault_check_period = Register(
        EepRam(45, 39),
        U8,
        ticks,
        "time a wrong voltage or temperature must last to be an error",
        default=45,
        limits=PERIOD,
    )
    packet_garbage_check_period = Register(
        EepRam(46, 40), U8, ticks, "age at which an unfinished packet is dropped", default=18, limits=PERIOD
    )
    stop_detection_period = Register(
        EepRam(47, 41), U8, ticks, "time without motion that counts as stopped", default=27, limits=PERIOD
    )
    overload_detection_period = Register(
        EepRam(48, 42), U8, RAW, "time an overload must last to be an error; 0 switches it off", access=READ
    )
    stop_threshold = Register(
        EepRam(49, 43), U8, steps, "position change below which it counts as standing", limits=(0, 254)
    )
    inposition_margin = Register(
        EepRam(50, 44), U8, steps, "distance to the goal that counts as arrived", limits=(0, 254)
    )
    reserved_40 = Register(EepRam(51, 45), U8, Count(), "reserved, NO 40", access=RESERVED)
    status_error = Register(
        Ram(48), U8, errors, "errors; each stays until it is written 0", default=0, limits=(0, 0x7F),
        volatile=True, latched=True,
    )  # fmt: skip
    status_detail = Register(
        Ram(49), U8, Flags(StatusDetail), "causes of invalid packets, to be cleared; moving, inposition, torque on",
        default=0, limits=(0, 0x7F), volatile=True, latched=True,
        live=StatusDetail.MOVING | StatusDetail.INPOSITION | StatusDetail.TORQUE_ON,
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
    voltage = Register(Ram(54), U8, RAW, "supply voltage", access=READ)
    temperature = Register(Ram(55), U8, RAW, "internal temperature", access=READ)
    current_control_mode = Register(
        Ram(56), U8, Choice(ControlMode), "position control or infinite turn; a JOG changes it", default=0,
        limits=(0, 1), access=READ, note="EH-16: a JOG changes it without torque too",
    )  # fmt: skip
    tick = Register(Ram(57), U8, ticks, "running time, wraps after 2.87 s", access=READ)
    calibrated_position = Register(Ram(58), POSITION, RAW, "position less calibration_difference", access=READ)
    absolute_position = Register(Ram(60), POSITION, RAW, "position", access=READ)
    differential_position = Register(
        Ram(62), S16, RAW, "speed", access=READ, note="EH-35: signed, as other drivers read it"
    )
    pwm = Register(
        Ram(64), S16, share, "output", default=0, access=READ, note="EH-35: signed, as other drivers read it"
    )
    absolute_goal_position = Register(Ram(68), POSITION, RAW, "goal, uncalibrated; a JOG sets it", access=READ)
    absolute_desired_trajectory_position = Register(
        Ram(70), POSITION, RAW, "where the profile is now, uncalibrated", access=READ
    )
    desired_velocity = Register(Ram(72), S16, RAW, "speed of the profile now", default=0, access=READ)

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


class UnknownHerkulex(HerkulexTable):
    """A HerkuleX of a model that is not known: what it has is what all models have."""

    title = "HerkuleX servo, model unknown"
    generic = True
    number = None

    @classmethod
    def key(cls) -> str:
        return "herkulex"
