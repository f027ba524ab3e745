"""What the models with a potentiometer share: DRS-0101, 0201, 0401 and 0601.

Sources: DRS-0101/0201 user's manual, pages 22 to 32 (register map and its details); for all four the tables of
emericg/SmartServoFramework (ControlTablesHerkuleX.h), guenhael/pyHerkuleX and the maker's PC tool
(wookbin/HerkuleX_manager_MFC).
"""

from servobus.core.registers import U8, U16, Access, Register
from servobus.core.units import Count, Quantity, deg
from servobus.families.herkulex.models.table import PERIOD, HerkulexTable
from servobus.families.herkulex.places import EepRam, Ram

READ_WRITE, RESERVED = Access.READ_WRITE, Access.RESERVED


class PotentiometerTable(HerkulexTable):
    """One turn less the gap of the potentiometer. The speed of endless turn has no gains of its own."""

    firmware = "servobus.families.herkulex.firmware:PotentiometerServo"

    id = HerkulexTable.id.with_(default=253, note="EH-48")
    alarm_led_policy = HerkulexTable.alarm_led_policy.with_(default=0x7F, note="EH-49")
    torque_policy = HerkulexTable.torque_policy.with_(default=0x35, note="EH-49; EH-24: also called Servo Policy")
    position_kp = HerkulexTable.position_kp.with_(default=440)
    position_kd = HerkulexTable.position_kd.with_(default=8000)
    position_feedforward_2nd_gain = HerkulexTable.position_feedforward_2nd_gain
    reserved_31 = Register(EepRam(40, 34), U16, Count(), "reserved, NO 31", access=RESERVED)
    reserved_32 = Register(EepRam(42, 36), U16, Count(), "reserved, NO 32", access=RESERVED)
    overload_detection_period = HerkulexTable.overload_detection_period.with_(
        scale=HerkulexTable.ticks, default=150, limits=PERIOD, access=READ_WRITE,
        note="11.2 ms in the map of the DRS-0101; 4 ms is that of the DRS-0602 (EH-08)",
    )  # fmt: skip
    stop_threshold = HerkulexTable.stop_threshold.with_(default=3, note="EH-60")
    inposition_margin = HerkulexTable.inposition_margin.with_(default=3, note="EH-60")
    status_detail = HerkulexTable.status_detail
    reserved_45 = Register(Ram(50), U8, Count(), "reserved, NO 45", access=RESERVED)
    pwm = HerkulexTable.pwm
    reserved_57 = Register(Ram(66), U16, Count(), "reserved, NO 57", access=RESERVED)
    desired_velocity = HerkulexTable.desired_velocity.with_(
        scale=Quantity("rad/s", 0.199 * deg), note="its unit is from pyHerkuleX alone; EH-35: signed is an assumption"
    )
