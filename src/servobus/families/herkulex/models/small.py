"""The small models: DRS-0101 with plastic gears, DRS-0201 with metal ones. They differ in nothing else on the bus.

Sources beside those of the potentiometer models: DRS-0101/0201 user's manual, pages 24 and 25 (ranges), 26 (volts),
32 (angles) and 48 (JOG); sweetie-bot-project/sweetie_bot_herkulex and cesarvandevelde/HerkulexServo.
"""

from servobus.core.registers import S8, U8, Access, Int, Motion, Register
from servobus.core.units import Count, Quantity, Thermistor, deg
from servobus.core.values import replace
from servobus.families.herkulex.models.potentiometer import PotentiometerTable
from servobus.families.herkulex.places import EepRam
from servobus.families.model import Confidence, Performance, SpecSheet

READ_WRITE, RESERVED = Access.READ_WRITE, Access.RESERVED
POSITION = Int(2, flags=0xE000)
"""A position of 10 bits. What stands above bit 12 are flags: real servos send 0x6000 there, and the maker's PC tool
masks with 0x1FFF (EH-62)."""
MEASURED = (0, 254)
"""Raw values that a limit of what the 8-bit converter measures can have (page 24)."""


class SmallTable(PotentiometerTable):
    """1024 steps; position 512 is 0°. Supply and temperature are readings of a converter of 8 bits."""

    series = "DRS small"
    bauds = tuple(baud for baud in PotentiometerTable.bauds if baud != 1_000_000)  # EH-59
    turn_scale = PotentiometerTable.share  # EH-57
    firmware = "servobus.families.herkulex.firmware:SmallServo"
    practice = {"position_flags": True}  # noqa: RUF012 - EH-44

    angle = Quantity("rad", 0.325 * deg, zero=512)
    volts = Quantity("V", 0.074)
    celsius = Thermistor(beta=3380, full=256)

    baud_rate = PotentiometerTable.baud_rate.with_(
        limits=(0x02, 0x22), allowed=(0x02, 0x03, 0x04, 0x07, 0x09, 0x10, 0x22), note="EH-59: no 1 Mbit/s"
    )
    max_temperature = PotentiometerTable.max_temperature.with_(
        scale=celsius, default=222, limits=MEASURED, access=READ_WRITE,
        note="EH-63: 0xDE as printed, 84 °C; the text beside it has 0xDF, 85 °C",
    )  # fmt: skip
    min_voltage = PotentiometerTable.min_voltage.with_(scale=volts, default=91, limits=MEASURED, access=READ_WRITE)
    max_voltage = PotentiometerTable.max_voltage.with_(scale=volts, default=137, limits=MEASURED, access=READ_WRITE)
    overload_pwm_threshold = PotentiometerTable.overload_pwm_threshold.with_(
        default=1022, limits=(0, 32766), note="EH-50: 0x03FE as printed; EH-13: compared strictly"
    )
    min_position = PotentiometerTable.min_position.with_(
        scale=angle, default=21, limits=(0, 1023), access=READ_WRITE, note="EH-53"
    )
    max_position = PotentiometerTable.max_position.with_(
        scale=angle, default=1002, limits=(0, 1023), access=READ_WRITE, note="EH-53"
    )
    reserved_40 = PotentiometerTable.reserved_40
    reserved_41 = Register(EepRam(52, 46), U8, Count(), "reserved, NO 41", access=RESERVED)
    calibration_difference = Register(
        EepRam(53, 47), S8, PotentiometerTable.steps, "absolute less calibrated position", default=0,
        motion=Motion.ZERO, note="EH-51: one byte, of which two bytes became in the larger models",
    )  # fmt: skip
    status_error = PotentiometerTable.status_error.with_(note="EH-22: bit 0x20 is a fault of the motor driver")
    voltage = PotentiometerTable.voltage.with_(scale=volts, limits=MEASURED)
    temperature = PotentiometerTable.temperature.with_(scale=celsius, limits=MEASURED, note="EH-63")
    calibrated_position = PotentiometerTable.calibrated_position.with_(
        layout=POSITION, scale=angle, note="EH-53, EH-62"
    )
    absolute_position = PotentiometerTable.absolute_position.with_(layout=POSITION, scale=angle, note="EH-53, EH-62")
    differential_position = PotentiometerTable.differential_position.with_(
        scale=Quantity("rad/s", 29.09 * deg), note="EH-58: one position unit in 11.2 ms; EH-35: signed"
    )
    absolute_goal_position = PotentiometerTable.absolute_goal_position.with_(
        layout=POSITION, scale=angle, limits=(0, 1023)
    )
    absolute_desired_trajectory_position = PotentiometerTable.absolute_desired_trajectory_position.with_(
        layout=POSITION, scale=angle
    )

    calibration = calibration_difference


class DRS0101(SmallTable):
    title = "DRS-0101"
    number = 0x0101
    sheet = SpecSheet(
        maker="Dongbu Robot",
        performance=(Performance(7.4, 1.2, 60 * deg / 0.166),),
        voltage=None,
        nominal_voltage=7.4,
        temperature=(0.0, 85.0),
        angle=320 * deg,
        resolution=0.325 * deg,
        weight=0.045,
        size=(0.024, 0.032, 0.045),
        gear_ratio=266,
        gear="engineering plastic",
        motor="cored DC, potentiometer",
        link="TTL level, full duplex, 8N1, 57.6 to 666.7 kbit/s",
        confidence=Confidence.MEDIUM,
        remarks=("Its speed without load, 0.166 s for 60° at 7.4 V, is what sellers print (EH-61).",),
    )
    model_no1 = SmallTable.model_no1.with_(default=0x01, note="EH-54")
    model_no2 = SmallTable.model_no2.with_(default=0x01)


class DRS0201(SmallTable):
    title = "DRS-0201"
    number = 0x0201
    sheet = replace(
        DRS0101.sheet,
        performance=(Performance(7.4, 2.4, 60 * deg / 0.147),),
        voltage=(7.0, 12.0),
        weight=0.060,
        gear="metal",
        motor="coreless DC, potentiometer",
        remarks=("Its speed without load, 0.147 s for 60° at 7.4 V, is what sellers print (EH-61).",),
    )
    model_no1 = SmallTable.model_no1.with_(default=0x02, note="EH-54")
    model_no2 = SmallTable.model_no2.with_(default=0x01)
