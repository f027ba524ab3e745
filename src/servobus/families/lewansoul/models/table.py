"""What all LX and HTS bus servos share, and the servo of which nothing more is known.

Source: the LewanSoul bus servo protocol document, section 4 and table 4; it names no model. Its units are those of all
models: 1000 steps over 240°, in the lists of the makers and of other drivers alike.

What the protocol keeps in pairs of commands stands here as registers; the servo has no table of its own.
"""

from servobus.core.registers import S8, S16, U8, U16, Access, Area, Motion, Register
from servobus.core.units import Choice, Count, Flags, Quantity, Switch, deg, ms
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import BAUD, FULL_OUTPUT, Alarm, Command, Mode
from servobus.families.lewansoul.verbs import LEWANSOUL
from servobus.families.model import Confidence, Model, Performance, SpecSheet

EEPROM, READ = Area.EEPROM, Access.READ

KGF_CM = 0.0980665
"""One kgf·cm in N·m."""
THREE_CELLS = "Its range of supply is that of three lithium cells, 11.1 V nominal: assumption."


def at(
    volts: float, kgf_cm: float, per_60_degrees: float | None = None, *, stall_current: float | None = None
) -> Performance:
    """Make a line of a data sheet from the units of product pages: kgf·cm, and s for 60°."""
    return Performance(volts, kgf_cm * KGF_CM, per_60_degrees and 60 * deg / per_60_degrees, stall_current)


def lx_sheet(
    *performance: Performance,
    voltage: tuple[float, float] | None = None,
    weight: float | None = None,
    size: tuple[float, float, float] | None = None,
    confidence: Confidence = Confidence.HIGH,
    remarks: tuple[str, ...] = (),
) -> SpecSheet:
    """Make the sheet of a model: what they have in common, 240° in 1000 steps (EL-30), is filled in.

    The nominal voltage is that of two or three lithium cells, by the range of the supply.
    """
    return SpecSheet(
        maker="Hiwonder (LewanSoul)",
        performance=performance,
        voltage=voltage,
        nominal_voltage=voltage and (7.4 if voltage[1] < 9 else 11.1),
        angle=240 * deg,
        resolution=0.24 * deg,
        weight=weight,
        size=size,
        link="one data wire, half duplex, 8N1, 115200 bit/s",
        confidence=confidence,
        remarks=remarks,
    )


class LxTable(Model):
    """Rows of all models."""

    family = LEWANSOUL
    motors = "servobus.families.lewansoul.motors:MOTORS"
    number = None
    factory_baud = BAUD
    bauds = (BAUD,)
    max_move_time = 30.0
    turn_scale = Quantity("1", 1 / FULL_OUTPUT)
    firmware = "servobus.families.lewansoul.firmware:LewansoulServo"

    angle = Quantity("rad", 0.24 * deg)
    time = Quantity("s", ms)
    volts = Quantity("V", 0.001)
    celsius = Quantity("degC", 1.0)

    goal_position = Register(
        Pair(Command.SERVO_MOVE_TIME_WRITE, Command.SERVO_MOVE_TIME_READ), U16, angle, "target position",
        limits=(0, 1000), volatile=True, motion=Motion.GOAL,
        note="EL-02: 0 .. 1000, not 0 .. 100; L-20: the present position before any move",
    )  # fmt: skip
    goal_time = Register(
        Pair(Command.SERVO_MOVE_TIME_WRITE, Command.SERVO_MOVE_TIME_READ, 2, alone=False), U16, time,
        "time to reach the target position; 0 is as fast as possible",
        default=0, limits=(0, 30000), volatile=True, note="EL-16, L-20",
    )  # fmt: skip
    wait_goal_position = Register(
        Pair(Command.SERVO_MOVE_TIME_WAIT_WRITE, Command.SERVO_MOVE_TIME_WAIT_READ), U16, angle,
        "target position kept until MOVE_START",
        limits=(0, 1000), volatile=True, motion=Motion.GOAL,
        note="EL-04: not every LX-16A lets the kept move be read",
    )  # fmt: skip
    wait_goal_time = Register(
        Pair(Command.SERVO_MOVE_TIME_WAIT_WRITE, Command.SERVO_MOVE_TIME_WAIT_READ, 2, alone=False), U16,
        time, "time of the kept move; 0 is as fast as possible", limits=(0, 30000),
        volatile=True, note="EL-04, EL-16",
    )  # fmt: skip
    id = Register(
        Pair(Command.SERVO_ID_WRITE, Command.SERVO_ID_READ), U8, Count(), "bus id",
        default=1, limits=(0, 253), area=EEPROM,
    )  # fmt: skip
    angle_offset = Register(
        Pair(Command.SERVO_ANGLE_OFFSET_ADJUST, Command.SERVO_ANGLE_OFFSET_READ), S8, angle,
        "shift of the zero; the servo turns by it at once; saved by a command of its own",
        default=0, limits=(-125, 125), area=EEPROM, motion=Motion.ZERO, note="EL-05, EL-14",
    )  # fmt: skip
    min_position = Register(
        Pair(Command.SERVO_ANGLE_LIMIT_WRITE, Command.SERVO_ANGLE_LIMIT_READ), U16, angle,
        "lowest goal position, below max_position", default=0, limits=(0, 1000), area=EEPROM,
        motion=Motion.LIMIT,
    )  # fmt: skip
    max_position = Register(
        Pair(Command.SERVO_ANGLE_LIMIT_WRITE, Command.SERVO_ANGLE_LIMIT_READ, 2), U16, angle,
        "highest goal position, above min_position", default=1000, limits=(0, 1000), area=EEPROM,
        motion=Motion.LIMIT,
    )  # fmt: skip
    min_voltage = Register(
        Pair(Command.SERVO_VIN_LIMIT_WRITE, Command.SERVO_VIN_LIMIT_READ), U16, volts,
        "supply below which the torque goes off", default=6500, limits=(4500, 12000), area=EEPROM,
        note="EL-07: 4.5 .. 12 V as for writing, not the narrower ranges of the answer",
    )  # fmt: skip
    max_voltage = Register(
        Pair(Command.SERVO_VIN_LIMIT_WRITE, Command.SERVO_VIN_LIMIT_READ, 2), U16, volts,
        "supply above which the torque goes off", default=12000, limits=(4500, 12000), area=EEPROM,
        note="EL-07: servos with 14 V set have been seen; as printed here",
    )  # fmt: skip
    max_temperature = Register(
        Pair(Command.SERVO_TEMP_MAX_LIMIT_WRITE, Command.SERVO_TEMP_MAX_LIMIT_READ), U8, celsius,
        "temperature above which the torque goes off until it is cooler",
        default=85, limits=(50, 100), area=EEPROM,
    )  # fmt: skip
    present_temperature = Register(
        Pair(None, Command.SERVO_TEMP_READ), U8, celsius, "internal temperature", access=READ
    )
    present_voltage = Register(
        Pair(None, Command.SERVO_VIN_READ), U16, volts, "supply voltage", access=READ, note="EL-18: in mV"
    )
    present_position = Register(
        Pair(None, Command.SERVO_POS_READ), S16, angle, "position; may be negative", access=READ, note="EL-18"
    )
    mode = Register(
        Pair(Command.SERVO_OR_MOTOR_MODE_WRITE, Command.SERVO_OR_MOTOR_MODE_READ), U8, Choice(Mode),
        "position control or endless turn; position after power-on", default=Mode.POSITION, limits=(0, 1),
        volatile=True, motion=Motion.MODE,
    )  # fmt: skip
    motor_speed = Register(
        Pair(Command.SERVO_OR_MOTOR_MODE_WRITE, Command.SERVO_OR_MOTOR_MODE_READ, 2), S16,
        turn_scale, "share of full output in motor mode; negative is reverse",
        default=0, limits=(-FULL_OUTPUT, FULL_OUTPUT), volatile=True, motion=Motion.SPEED,
        note="a duty in fact, not a controlled speed",
    )  # fmt: skip
    torque_enable = Register(
        Pair(Command.SERVO_LOAD_OR_UNLOAD_WRITE, Command.SERVO_LOAD_OR_UNLOAD_READ), U8, Switch(),
        "torque on or off", default=0, limits=(0, 1), note="EL-08: off at power-on, as printed",
    )  # fmt: skip
    led = Register(
        Pair(Command.SERVO_LED_CTRL_WRITE, Command.SERVO_LED_CTRL_READ), U8, Switch(on=0),
        "light on or off; raw 0 is on", default=0, limits=(0, 1), area=EEPROM, note="EL-09",
    )  # fmt: skip
    led_error = Register(
        Pair(Command.SERVO_LED_ERROR_WRITE, Command.SERVO_LED_ERROR_READ), U8, Flags(Alarm),
        "faults that make the light flash", default=7, limits=(0, 7), area=EEPROM,
        note="EL-13: saved, and 7 from the factory, are assumptions",
    )  # fmt: skip

    # Other names for the same rows: the manual's word for torque, and the name other families have.
    load = torque_enable
    alarm_led = led_error
    calibration = angle_offset


class HighVoltage(LxTable):
    """Rows of the models for three lithium cells."""

    min_voltage = LxTable.min_voltage.with_(
        default=4500, limits=(4500, 14000), note="EL-29: as an HTD-45H reports; of the others an assumption"
    )
    max_voltage = LxTable.max_voltage.with_(
        default=14000, limits=(4500, 14000), note="EL-29: as an HTD-45H reports; of the others an assumption"
    )


class UnknownLx(HighVoltage):
    """An LX or HTS servo: none of them can say of which model it is. All that the protocol gives works."""

    title = "LX/HTS bus servo, model unknown"
    generic = True

    @classmethod
    def key(cls) -> str:
        return "lx"
