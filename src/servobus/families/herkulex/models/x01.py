"""The large models with a potentiometer: DRS-0401 and DRS-0601. Sources: those of all potentiometer models."""

from servobus.core.registers import S16, Access, Motion, Register
from servobus.core.units import Quantity, deg
from servobus.core.values import replace
from servobus.families.herkulex.models.potentiometer import PotentiometerTable
from servobus.families.herkulex.places import EepRam
from servobus.families.model import Confidence, Performance, SpecSheet

READ_WRITE = Access.READ_WRITE


class X01Table(PotentiometerTable):
    """2048 steps; position 1024 is 0°. Supply in 0.1 V and temperature in °C, as in the magnetic models."""

    series = "DRS x01"
    turn_scale = Quantity("rad/s", 0.62 * deg)  # EH-57

    angle = Quantity("rad", 0.163 * deg, zero=1024)
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)

    alarm_led_policy = PotentiometerTable.alarm_led_policy.with_(scale=PotentiometerTable.errors_but_driver)
    torque_policy = PotentiometerTable.torque_policy.with_(scale=PotentiometerTable.errors_but_driver)
    max_temperature = PotentiometerTable.max_temperature.with_(
        scale=celsius, default=80, limits=(0, 110), access=READ_WRITE, note="EH-65"
    )
    min_voltage = PotentiometerTable.min_voltage.with_(
        scale=volts, default=95, limits=(92, 200), access=READ_WRITE, note="EH-65"
    )
    max_voltage = PotentiometerTable.max_voltage.with_(
        scale=volts, default=170, limits=(92, 200), access=READ_WRITE, note="EH-65"
    )
    overload_pwm_threshold = PotentiometerTable.overload_pwm_threshold.with_(default=1022, note="EH-50; EH-13")
    min_position = PotentiometerTable.min_position.with_(
        scale=angle, default=42, limits=(0, 2047), access=READ_WRITE, note="EH-52"
    )
    max_position = PotentiometerTable.max_position.with_(
        scale=angle, default=2004, limits=(0, 2047), access=READ_WRITE, note="EH-52"
    )
    reserved_40 = PotentiometerTable.reserved_40
    calibration_difference = Register(
        EepRam(52, 46), S16, PotentiometerTable.steps, "absolute less calibrated position; NO 41 and 42", default=0,
        limits=(-255, 255), motion=Motion.ZERO, note="EH-51",
    )  # fmt: skip
    status_error = PotentiometerTable.status_error.with_(
        scale=PotentiometerTable.errors_but_driver, note="EH-22: bit 0x20 is not used"
    )
    voltage = PotentiometerTable.voltage.with_(scale=volts, limits=(0, 200))
    temperature = PotentiometerTable.temperature.with_(scale=celsius, limits=(0, 110))
    calibrated_position = PotentiometerTable.calibrated_position.with_(scale=angle, note="EH-53, EH-62")
    absolute_position = PotentiometerTable.absolute_position.with_(scale=angle, note="EH-53, EH-62")
    differential_position = PotentiometerTable.differential_position.with_(
        scale=Quantity("rad/s", 3.634 * deg), note="EH-58: one position unit in 44.8 ms; EH-35: signed"
    )
    absolute_goal_position = PotentiometerTable.absolute_goal_position.with_(scale=angle, limits=(0, 2047))
    absolute_desired_trajectory_position = PotentiometerTable.absolute_desired_trajectory_position.with_(scale=angle)

    calibration = calibration_difference


class DRS0401(X01Table):
    title = "DRS-0401"
    number = 0x0401
    sheet = SpecSheet(
        maker="Dongbu Robot",
        performance=(Performance(14.8, 5.1),),
        voltage=(9.5, 14.8),
        nominal_voltage=12.0,
        temperature=(0.0, 80.0),
        angle=320 * deg,
        resolution=0.163 * deg,
        weight=0.123,
        size=(0.056, 0.035, 0.038),
        gear_ratio=202,
        gear="metal",
        motor="Faulhaber coreless DC, potentiometer",
        standby_current=0.030,
        link="TTL level, full duplex, 8N1, 57.6 kbit/s to 1 Mbit/s",
        confidence=Confidence.MEDIUM,
        remarks=("Its stall torque is 5.1 or 5.2 N·m (EH-56).", "Its speed without load is open (EH-61)."),
    )
    model_no1 = X01Table.model_no1.with_(default=0x04, note="EH-54")
    model_no2 = X01Table.model_no2.with_(default=0x01)


class DRS0601(X01Table):
    title = "DRS-0601"
    number = 0x0601
    sheet = replace(
        DRS0401.sheet,
        performance=(Performance(14.8, 7.6),),
        weight=0.145,
        size=(0.056, 0.035, 0.046),
        remarks=("Its speed without load is open (EH-61).",),
    )
    model_no1 = X01Table.model_no1.with_(default=0x06, note="EH-54")
    model_no2 = X01Table.model_no2.with_(default=0x01)
