"""The models with a magnetic encoder: DRS-0402 and DRS-0602.

Source: DRS-0602 user's manual, sections 2-3 (specification) and 4-2 (register map, NO 1 to 60). Of the DRS-0402 the
model number, the motor and the torque are known; its rows are those of the DRS-0602. That manual prints 0402 as the
factory value of the model number, so its register map may be that of the DRS-0402 (EH-03).
"""

from servobus.core.registers import S16, U8, U16, Access, Motion, Register
from servobus.core.units import Choice, Quantity, deg, ms
from servobus.core.values import replace
from servobus.families.herkulex.models.table import GAIN, PERIOD, HerkulexTable
from servobus.families.herkulex.places import EepRam, Ram
from servobus.families.herkulex.protocol import Aux
from servobus.families.model import Confidence, Performance, SpecSheet

READ, READ_WRITE = Access.READ, Access.READ_WRITE


class MagneticTable(HerkulexTable):
    """Position 16384 is 0°; 12962 steps are one turn, so that 0 .. 32767 is 2.5 turns.

    Which direction grows is not in the manual.
    """

    series = "DRS magnetic"
    turn_scale = Quantity("rad/s", 0.62 * deg)  # 6-5
    firmware = "servobus.families.herkulex.firmware:MagneticServo"

    angle = Quantity("rad", 360 * deg / 12962, zero=16384)
    second_angle = Quantity("rad", 0.163 * deg, zero=1024)
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)

    id = HerkulexTable.id.with_(default=219, note="EH-05: 219; the 253 of all examples is the default of older models")
    alarm_led_policy = HerkulexTable.alarm_led_policy.with_(scale=HerkulexTable.errors_but_driver, default=0x5F)
    torque_policy = HerkulexTable.torque_policy.with_(scale=HerkulexTable.errors_but_driver, default=0x15)
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
        note="EH-14: at 50 % the speed profile is a triangle, at 0 a rectangle"
    )
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
    position_feedforward_2nd_gain = HerkulexTable.position_feedforward_2nd_gain
    velocity_kp = Register(
        EepRam(40, 34), U16, Quantity("", 1 / 64), "speed control, P gain", default=100, limits=GAIN,
        note="EH-19: its access is not printed; the maker's PC tool writes it; EH-55",
    )  # fmt: skip
    velocity_ki = Register(
        EepRam(42, 36), U16, HerkulexTable.sixteenths, "speed control, I gain", default=12000, limits=GAIN,
        note="EH-19: printed 0x02EE0, access not printed; the maker's PC tool writes it; EH-55",
    )  # fmt: skip
    overload_detection_period = HerkulexTable.overload_detection_period.with_(
        scale=Quantity("s", 4 * ms), default=150, limits=PERIOD, access=READ_WRITE,
        note="EH-08: 4 ms as in the table, not 11.2 ms",
    )  # fmt: skip
    stop_threshold = HerkulexTable.stop_threshold.with_(default=6)
    inposition_margin = HerkulexTable.inposition_margin.with_(default=6)
    reserved_40 = HerkulexTable.reserved_40
    calibration_difference = Register(
        EepRam(52, 46), S16, HerkulexTable.steps, "absolute less calibrated position; NO 41 and 42", default=0,
        limits=(-1495, 1495), motion=Motion.ZERO,
        note="EH-11: one signed 16-bit value; -255 .. 255 fits the older models",
    )  # fmt: skip
    status_error = HerkulexTable.status_error.with_(
        scale=HerkulexTable.errors_but_driver, note="EH-22: bit 0x20 is never set"
    )
    status_detail = HerkulexTable.status_detail
    aux_1 = Register(
        Ram(50), U8, Choice(Aux), "sets absolute_position anew", default=0, limits=(0, 6), volatile=True,
        live=0xFF,  # it is 0 again as soon as that is done
        motion=Motion.ZERO,
    )  # fmt: skip
    voltage = HerkulexTable.voltage.with_(scale=volts, limits=(0, 200))
    temperature = HerkulexTable.temperature.with_(scale=celsius, limits=(0, 110))
    calibrated_position = HerkulexTable.calibrated_position.with_(
        scale=angle,
        note="EH-09: 0° is 16384, as in the maker's PC tool; the manual's formula counts from -180°",
    )
    absolute_position = HerkulexTable.absolute_position.with_(scale=angle, note="EH-09")
    differential_position = HerkulexTable.differential_position.with_(
        scale=turn_scale, note="EH-35: signed, as other drivers read it; EH-58: one position unit in 44.8 ms"
    )
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


class DRS0602(MagneticTable):
    title = "DRS-0602"
    number = 0x0602
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
    model_no1 = MagneticTable.model_no1.with_(
        default=0x06, note="EH-03: 0x06 as the row's own example says, not the 0x04 of the DRS-0402"
    )
    model_no2 = MagneticTable.model_no2.with_(default=0x02)


class DRS0402(MagneticTable):
    title = "DRS-0402"
    number = 0x0402
    sheet = replace(
        DRS0602.sheet,
        performance=(Performance(14.8, 5.1),),
        weight=0.123,
        size=(0.056, 0.035, 0.038),
        confidence=Confidence.MEDIUM,
        remarks=(
            "Its factory settings are those of the DRS-0602, whose manual prints the model number of the DRS-0402.",
            "Its speed without load is open (EH-61).",
        ),
    )
    model_no1 = MagneticTable.model_no1.with_(default=0x04)
    model_no2 = MagneticTable.model_no2.with_(default=0x02)
    id = MagneticTable.id.with_(note="EH-48: 219 as in the map of the DRS-0602, 253 in another program")
