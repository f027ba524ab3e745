"""DRS-0602. Source: DRS-0602 user's manual, sections 2-3 (specification) and 4-2 (register map, NO 1 to 60)."""

from servobus.core.registers import S16, U8, U16, Access, Motion, Register
from servobus.core.units import Choice, Count, Quantity, deg, ms
from servobus.families.herkulex.models.table import GAIN, PERIOD, HerkulexTable
from servobus.families.herkulex.places import Eep, EepRam, Ram
from servobus.families.herkulex.protocol import Aux
from servobus.families.model import Performance, SpecSheet

READ, READ_WRITE, RESERVED = Access.READ, Access.READ_WRITE, Access.RESERVED


class DRS0602(HerkulexTable):
    """Position 16384 is 0°; 12962 steps are one turn, so that 0 .. 32767 is 2.5 turns.

    Which direction grows is not in the manual.
    """

    title = "DRS-0602"
    series = "DRS magnetic"
    number = 0x0602
    factory_baud = 115_200
    turn_scale = Quantity("rad/s", 0.62 * deg)  # 6-5
    firmware = "servobus.families.herkulex.firmware:HerkulexServo"
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
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)
    steps = HerkulexTable.steps
    sixteenths = HerkulexTable.sixteenths

    model_no1 = HerkulexTable.model_no1.with_(
        default=0x06, note="EH-03: 0x06 as the row's own example says, not the 0x04 of the DRS-0402"
    )
    model_no2 = HerkulexTable.model_no2.with_(default=0x02)
    version1 = HerkulexTable.version1.with_(default=0x00)
    version2 = HerkulexTable.version2.with_(
        default=0x90, note="EH-41: its access is not printed; read-only like version1"
    )
    baud_rate = HerkulexTable.baud_rate
    reserved_6 = Register(Eep(5), U8, Count(), "reserved, NO 6", access=RESERVED)
    id = HerkulexTable.id.with_(default=219, note="EH-05: 219; the 253 of all examples is the default of older models")
    alarm_led_policy = HerkulexTable.alarm_led_policy.with_(default=0x5F)
    torque_policy = HerkulexTable.torque_policy.with_(default=0x15)
    reserved_11 = Register(EepRam(10, 4), U8, Count(), "reserved, NO 11", access=RESERVED)
    max_temperature = HerkulexTable.max_temperature.with_(
        scale=celsius, default=80, limits=(0, 110), access=READ_WRITE,
        note="EH-06: 80 °C as in the table; 0xDF is a raw reading of older models",
    )  # fmt: skip
    min_voltage = HerkulexTable.min_voltage.with_(
        scale=volts, default=95, limits=(92, 200), access=READ_WRITE, note="EH-07: 9.5 V as in the table, not 9.2 V"
    )
    max_voltage = HerkulexTable.max_voltage.with_(
        scale=volts, default=170, limits=(92, 200), access=READ_WRITE, note="EH-07: 17.0 V as in the table, not 18.0 V"
    )
    acceleration_ratio = HerkulexTable.acceleration_ratio.with_(
        default=25, note="EH-14: at 50 % the speed profile is a triangle, at 0 a rectangle"
    )
    max_acceleration_time = HerkulexTable.max_acceleration_time.with_(default=45)
    dead_zone = HerkulexTable.dead_zone.with_(default=0)
    saturator_offset = HerkulexTable.saturator_offset.with_(default=0)
    saturator_slope = HerkulexTable.saturator_slope.with_(default=0)
    pwm_offset = HerkulexTable.pwm_offset.with_(default=0)
    min_pwm = HerkulexTable.min_pwm.with_(default=0)
    overload_pwm_threshold = HerkulexTable.overload_pwm_threshold.with_(default=1022)
    min_position = HerkulexTable.min_position.with_(
        scale=angle, default=10627, limits=(0, 32767), access=READ_WRITE,
        note="EH-10: 10627 as in the table; 0x2A belongs to 11-bit models",
    )  # fmt: skip
    max_position = HerkulexTable.max_position.with_(
        scale=angle, default=22129, limits=(0, 32767), access=READ_WRITE,
        note="EH-10: 22129 as in the table; 0x7D5 belongs to 11-bit models",
    )  # fmt: skip
    position_kp = HerkulexTable.position_kp.with_(default=70)
    position_kd = HerkulexTable.position_kd.with_(default=0)
    position_ki = HerkulexTable.position_ki.with_(default=0)
    position_feedforward_1st_gain = HerkulexTable.position_feedforward_1st_gain.with_(default=0)
    position_feedforward_2nd_gain = HerkulexTable.position_feedforward_2nd_gain.with_(default=0)
    velocity_kp = Register(
        EepRam(40, 34), U16, Quantity("", 1 / 64), "speed control, P gain", default=100, limits=GAIN,
        note="EH-19: its access is not printed; the maker's PC tool writes it",
    )  # fmt: skip
    velocity_ki = Register(
        EepRam(42, 36), U16, sixteenths, "speed control, I gain", default=12000, limits=GAIN,
        note="EH-19: printed 0x02EE0, access not printed; the maker's PC tool writes it",
    )  # fmt: skip
    adc_fault_check_period = HerkulexTable.adc_fault_check_period.with_(default=45)
    overload_detection_period = HerkulexTable.overload_detection_period.with_(
        scale=Quantity("s", 4 * ms), default=150, limits=PERIOD, access=READ_WRITE,
        note="EH-08: 4 ms as in the table, not 11.2 ms",
    )  # fmt: skip
    stop_threshold = HerkulexTable.stop_threshold.with_(default=6)
    inposition_margin = HerkulexTable.inposition_margin.with_(default=6)
    reserved_40 = Register(EepRam(51, 45), U8, Count(), "reserved, NO 40", access=RESERVED)
    calibration_difference = Register(
        EepRam(52, 46), S16, steps, "absolute less calibrated position; NO 41 and 42", default=0,
        limits=(-1495, 1495), motion=Motion.ZERO,
        note="EH-11: one signed 16-bit value; -255 .. 255 fits the older models",
    )  # fmt: skip
    status_error = HerkulexTable.status_error.with_(note="EH-22: bit 0x20 is never set")
    status_detail = HerkulexTable.status_detail
    aux_1 = Register(
        Ram(50), U8, Choice(Aux), "sets absolute_position anew", default=0, limits=(0, 6), volatile=True,
        live=0xFF,  # it is 0 again as soon as that is done
        motion=Motion.ZERO,
    )  # fmt: skip
    reserved_46 = Register(Ram(51), U8, Count(), "reserved, NO 46", default=0, access=RESERVED)
    voltage = HerkulexTable.voltage.with_(scale=volts, limits=(0, 200))
    temperature = HerkulexTable.temperature.with_(scale=celsius, limits=(0, 110))
    calibrated_position = HerkulexTable.calibrated_position.with_(
        scale=angle,
        note="EH-09: 0° is 16384, as in the maker's PC tool; the manual's formula counts from -180°",
    )
    absolute_position = HerkulexTable.absolute_position.with_(scale=angle, note="EH-09")
    differential_position = HerkulexTable.differential_position.with_(scale=turn_scale)
    pwm = HerkulexTable.pwm
    absolute_2nd_position = Register(
        Ram(66), U16, second_angle, "position by the potentiometer", access=READ,
        note="its zero, 1024, is from another driver; the manual gives none",
    )  # fmt: skip
    absolute_goal_position = HerkulexTable.absolute_goal_position.with_(scale=angle, limits=(0, 32767))
    absolute_desired_trajectory_position = HerkulexTable.absolute_desired_trajectory_position.with_(scale=angle)
    desired_velocity = HerkulexTable.desired_velocity.with_(
        scale=Quantity("rad/s", 0.034 * deg),
        note="EH-34: unit as printed, origin unknown; EH-35: signed is an assumption",
    )

    calibration = calibration_difference
