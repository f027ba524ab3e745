"""The models of the toy family."""

from servobus.core.registers import Access, Area, Int, Motion, Register
from servobus.core.units import Count, Quantity, Switch, deg
from servobus.families.model import Model, Performance, SpecSheet
from toyfamily.places import Cell
from toyfamily.verbs import TOY

EEPROM, READ = Area.EEPROM, Access.READ


WORD = Int(2, order="big")
"""High byte first, as no built-in family has it."""


class TOY1(Model):
    """Position 0 .. 3600 is 0° .. 360°."""

    title = "Toy-1"
    family = TOY
    number = 4711
    factory_baud = 38_400
    bauds = (38_400,)
    turn_scale = Quantity("1", 0.001)
    firmware = "toyfamily.firmware:ToyServo"
    sheet = SpecSheet(
        maker="Nobody",
        performance=(Performance(6.0, 0.5, 300 * deg),),
        voltage=(5.0, 7.0),
        angle=360 * deg,
        resolution=0.1 * deg,
    )

    tenths = Quantity("rad", 0.1 * deg)
    volts = Quantity("V", 0.01)
    celsius = Quantity("degC", 0.1)

    model_number = Register(Cell(0), WORD, Count(), "model number", default=4711, access=READ, area=EEPROM)
    id = Register(Cell(1), WORD, Count(), "bus id", default=1, limits=(0, 253), area=EEPROM)
    lowest = Register(Cell(2), WORD, tenths, "lowest goal", default=0, limits=(0, 3600), area=EEPROM)
    highest = Register(Cell(3), WORD, tenths, "highest goal", default=3600, limits=(0, 3600), area=EEPROM)
    min_voltage = Register(Cell(4), WORD, volts, "lowest supply", default=450, limits=(0, 1000), area=EEPROM)
    max_voltage = Register(Cell(5), WORD, volts, "highest supply", default=750, limits=(0, 1000), area=EEPROM)
    max_temperature = Register(Cell(6), WORD, celsius, "hottest", default=700, limits=(0, 1000), area=EEPROM)
    torque_enable = Register(Cell(7), WORD, Switch(), "torque", default=0, limits=(0, 1))
    goal_position = Register(Cell(8), WORD, tenths, "goal", limits=(0, 3600), volatile=True, motion=Motion.GOAL)
    speed = Register(Cell(9), WORD, Quantity("rad/s", deg), "speed of moves", limits=(0, 300), volatile=True)
    present_position = Register(Cell(10), WORD, tenths, "where it is", access=READ)
    present_voltage = Register(Cell(11), WORD, volts, "supply", access=READ)
    present_temperature = Register(Cell(12), WORD, celsius, "how hot it is", access=READ)

    min_position = lowest
    max_position = highest
    goal_speed = speed
