"""Tables that inherit, and what stands with a model."""

from typing import Any

import pytest

import servobus
from servobus import DRS0602, LX16A, RX28, BadValue, UnknownName, UsageError, deg
from servobus.core.registers import U8, U16, Access, Area, Motion, Register
from servobus.core.units import RAW, Count, Quantity, Switch
from servobus.families import registry
from servobus.families.base import Answers, Model, Performance, ServoRef, SpecSheet
from servobus.families.dynamixel.models.table import DynamixelTable, UnknownDynamixel
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.verbs import Dynamixel1
from servobus.families.registry import MODELS
from servobus.virtual.device.motor_set import MotorData
from servobus.virtual.device.motors import motor, motor_sets
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.physics.motor import no_load_speed, stall_torque
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import Rig
from servobus.virtual.wire.line import VirtualLine

EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))


class AX812(RX28):
    title = "AX-812"
    number = 812
    factory_baud = 1_000_000
    sheet = SpecSheet("Nobody", (Performance(12.0, 1.5, 354 * deg),), (9.0, 12.0), 300 * deg, 300 * deg / 1023)
    highest_limit_temperature = RX28.highest_limit_temperature.with_(default=70)


NAMED = {
    "named": MotorData({"manual": motor_sets(LX16A)["manual"], "lossless": motor_sets(RX28)["lossless"]}),
}
"""Motor data of a model that names them."""


class Fine(RX28):
    """4096 steps for the whole turn."""

    title = "Fine-1"
    number = 829
    angle = Quantity("rad", 360 * deg / 4096)
    cw_angle_limit = RX28.cw_angle_limit.with_(scale=angle, limits=(0, 4095))
    ccw_angle_limit = RX28.ccw_angle_limit.with_(scale=angle, limits=(0, 4095), default=4095)
    goal_position = RX28.goal_position.with_(scale=angle, limits=(0, 4095))
    present_position = RX28.present_position.with_(scale=angle)


def bus_of(model: type[Model], **surroundings: Any) -> tuple[servobus.BusServo, Any]:
    """Give a servo of a model that no registry knows, on a virtual clock, and the virtual servo itself."""
    real = virtual_servo(model, 1, **surroundings)
    bus = servobus.Bus(VirtualPort("virtual:", Rig([VirtualLine([real])]), real=False), echo=False)
    return bus.attach(model, 1), real


# Rows


def test_a_table_has_the_rows_of_its_parent_in_their_order() -> None:
    assert list(AX812.registers) == list(RX28.registers)
    assert AX812.aliases == RX28.aliases
    assert AX812.register("max_temperature") is AX812.max_temperature is AX812.highest_limit_temperature
    assert AX812.max_temperature.aliases == ("max_temperature",)


def test_an_inherited_row_belongs_to_the_child() -> None:
    assert repr(AX812.goal_position) == "<AX-812 goal_position>"
    assert AX812.goal_position is not RX28.goal_position
    assert AX812.registers["goal_position"] is AX812.goal_position
    assert repr(RX28.goal_position) == "<RX-28 goal_position>"
    with pytest.raises(BadValue, match="AX-812 led"):
        AX812.led.parse("perhaps")


def test_one_row_differs() -> None:
    assert (AX812.highest_limit_temperature.default, RX28.highest_limit_temperature.default) == (70, 80)
    mine, other = AX812.highest_limit_temperature, RX28.highest_limit_temperature
    for name in ("place", "layout", "scale", "meaning", "limits", "allowed", "access", "area", "note"):
        assert getattr(mine, name) == getattr(other, name)


def test_a_row_can_be_added_replaced_and_taken_out() -> None:
    class Child(RX28):
        punch = None  # type: ignore[assignment]
        max_voltage = None  # type: ignore[assignment] # the second name alone
        lock = Register(Address(47), U8, Switch(), "something else")
        extra = Register(Address(50), U16, Count(), "one more", area=Area.EEPROM)

    assert "punch" not in Child.registers
    assert "max_voltage" not in Child.aliases
    assert "highest_limit_voltage" in Child.registers
    assert Child.lock.meaning == "something else"
    assert list(Child.registers)[-1] == "extra"

    class Grandchild(Child):
        extra = Child.extra.with_(default=7)

    assert Grandchild.extra.default == 7
    assert "punch" not in Grandchild.registers
    assert "punch" in RX28.registers


def test_a_row_that_is_taken_out_takes_its_second_names_along() -> None:
    class Child(RX28):
        moving_speed = None  # type: ignore[assignment]

    assert "goal_speed" not in Child.aliases
    assert Child.optional("goal_speed") is None


def test_a_second_name_can_mean_another_row() -> None:
    class Child(RX28):
        output_limit = RX28.max_torque

    assert Child.register("output_limit") is Child.registers["max_torque"]
    assert RX28.register("output_limit") is RX28.torque_limit


def test_several_parents() -> None:
    class Extra(RX28):
        extra = Register(Address(50), U8, Count(), "one more")

    class Cool(RX28):
        highest_limit_temperature = RX28.highest_limit_temperature.with_(default=70)

    class Both(Extra, Cool):
        pass

    assert Both.extra.owner is Both
    assert Both.max_temperature.default == 70


def test_a_wrong_change_cannot_be_imported() -> None:
    with pytest.raises(TypeError, match="has no colour; it has place, layout"):
        RX28.led.with_(colour="red")
    with pytest.raises(TypeError, match=r"<Child max_torque>: default 2000 is outside its limits"):

        class Child(RX28):
            title = "Child"
            max_torque = RX28.max_torque.with_(default=2000)

    with pytest.raises(TypeError, match="both claim table byte 24"):

        class Twice(RX28):
            light = RX28.led.with_(place=Address(24))


def test_with_takes_limits_from_a_new_layout_unless_they_were_set() -> None:
    assert RX28.present_voltage.with_(layout=U16).limits == (0, 0xFFFF)
    assert RX28.torque_enable.with_(layout=U16).limits == (0, 1)


# Rows of relatives


def test_a_row_of_a_parent_stands_for_the_own_one() -> None:
    assert AX812.own(RX28.goal_position) is AX812.goal_position
    assert RX28.own(AX812.goal_position) is RX28.goal_position
    servo, real = bus_of(AX812, position=90 * deg)
    assert servo.read(RX28.present_position) == pytest.approx(90 * deg, abs=0.2 * deg)
    servo.write(RX28.led, True)
    assert real.memory[AX812.led] == real.memory[RX28.led] == 1
    assert servo.read_many([RX28.led, AX812.torque_enable]) == {"led": True, "torque_enable": False}


def test_the_value_counts_not_the_raw_number() -> None:
    servo, real = bus_of(Fine, position=90 * deg)
    servo.torque_on()
    assert servo.read(RX28.present_position) == pytest.approx(90 * deg, abs=0.1 * deg)
    servo.write(RX28.goal_position, 180 * deg)
    assert real.memory[Fine.goal_position] == 2048


def test_the_limits_are_those_of_the_own_row() -> None:
    servo, _ = bus_of(Fine)
    servo.torque_on()
    servo.write(RX28.goal_position, 330 * deg)  # which an RX-28 has not
    with pytest.raises(BadValue, match="Fine-1 goal_position"):
        servo.write(RX28.goal_position, 361 * deg)


def test_a_row_that_means_something_else_is_refused() -> None:
    class Strange(RX28):
        title = "Strange"
        punch = Register(Address(48), U16, Quantity("rad/s", deg), "something else")

    for table, register in (
        (Strange, RX28.punch),
        (RX28, LX16A.goal_position),
        (RX28, DRS0602.max_voltage),
        (Strange, Register(Address(30), U16, Count(), "of no table")),
    ):
        given: Any = register
        with pytest.raises(UsageError, match="is not a register of"):
            table.own(given)


# What every model must have


@EVERY
def test_the_registers_that_verbs_rely_on(model: type[Model]) -> None:
    for name in ("goal_position", "present_voltage", "torque_enable", *model.family.needs):
        assert model.register(name).meaning
    with pytest.raises(UnknownName, match="no name that models may have"):
        model.optional("present_sped")


REQUIRED = (
    "id", "goal_position", "present_position", "present_voltage", "present_temperature", "torque_enable",
    "min_position", "max_position", "min_voltage", "max_voltage", "max_temperature",
)  # fmt: skip


@EVERY
@pytest.mark.parametrize("name", REQUIRED)
def test_a_table_without_one_of_them_cannot_be_imported(model: type[Model], name: str) -> None:
    row = model.register(name).name
    with pytest.raises(TypeError, match=rf"Lame lacks the registers? .*{name}"):
        type("Lame", (model,), {"title": "Lame", row: None})


@EVERY
def test_nor_without_one_that_its_family_needs(model: type[Model]) -> None:
    for name in model.family.needs:
        with pytest.raises(TypeError, match=rf"Lame lacks the registers? .*{name}"):
            type("Lame", (model,), {"title": "Lame", model.register(name).name: None})


def test_a_parent_of_models_may_lack_them() -> None:
    class Parent(RX28):
        lock = None  # type: ignore[assignment]

    with pytest.raises(TypeError, match="Child lacks the register lock"):

        class Child(Parent):
            title = "Child"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"present_voltage": RX28.present_voltage.with_(scale=Count())}, "is in V, not in no unit"),
        ({"present_temperature": RX28.present_temperature.with_(scale=Quantity("V", 1.0))}, "is in degC, not in V"),
        (
            {"ccw_angle_limit": RX28.ccw_angle_limit.with_(scale=Quantity("rad", 1.0))},
            "another scale than goal_position",
        ),
        ({"output_limit": RX28.max_torque}, "output_limit can be written in RAM"),
        ({"factory_baud": 12_345}, "12345 is not among its bauds"),
        ({"moving_speed": RX28.moving_speed.with_(place=Address(60))}, "does not stand right behind goal_position"),
    ],
)
def test_what_contradicts_itself_cannot_be_imported(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        type("Lame", (RX28,), {"title": "Lame", **changes})


def test_what_a_model_must_say() -> None:
    with pytest.raises(TypeError, match="Bare: a model says its number, sheet, factory_baud, bauds, turn_scale"):

        class Bare(Model):
            title = "Bare"
            family = Dynamixel1()


@EVERY
def test_a_motion_row_is_known_by_its_row(model: type[Model]) -> None:
    goals = [row.name for row in model.registers.values() if row.motion is Motion.GOAL]
    expected = {"dynamixel": ["goal_position"], "lewansoul": ["goal_position", "wait_goal_position"], "herkulex": []}
    assert goals == expected[model.family.name]


# Numbers that are the model's


def test_a_servo_with_4096_steps_says_where_it_is() -> None:
    servo, real = bus_of(Fine, position=180 * deg)
    assert servo.look().position == pytest.approx(180 * deg, abs=0.1 * deg)
    assert servo.read_raw([Fine.present_position]) == [2048]
    servo.torque_on()
    servo.move(350 * deg, speed=120 * deg).wait()
    assert real.position == pytest.approx(350 * deg, abs=1 * deg)


def test_position_mode_gives_it_its_own_full_range() -> None:
    servo, real = bus_of(Fine, position=180 * deg)
    servo.torque_on()
    servo.turn(output=0.5)
    assert (real.get("cw_angle_limit"), real.get("ccw_angle_limit"), real.get("moving_speed")) == (0, 0, 512)
    servo.position_mode()
    assert (real.get("cw_angle_limit"), real.get("ccw_angle_limit")) == (0, 4095)


def test_sync_write_takes_servos_of_several_models_together() -> None:
    refs = [reference(model, id) for id, model in enumerate((RX28, AX812, Fine))]
    (packet,) = RX28.family.goals(dict.fromkeys(refs, 0x123), 0.0)
    assert packet.request.hex(" ") == "ff ff fe 0d 83 1e 02 00 23 01 01 23 01 02 23 01 e2"

    class Elsewhere(RX28):
        title = "Elsewhere"
        goal_position = RX28.goal_position.with_(place=Address(60))
        moving_speed = RX28.moving_speed.with_(place=Address(62))

    two = RX28.family.goals({reference(RX28, 1): 1, reference(Elsewhere, 2): 2}, 0.0)
    assert [exchange.request[5] for exchange in two] == [30, 60]


def reference(model: type[Model], id: int) -> ServoRef:
    return ServoRef(id, model, Answers.EVERYTHING)


def test_reset_goes_to_the_speed_of_the_model() -> None:
    servo, real = bus_of(AX812)
    assert servo.baud == 1_000_000
    servo.change_baud(115_200)
    servo.reset()
    assert (servo.baud, round(real.baud)) == (1_000_000, 1_000_000)


def test_number_and_factory_speed_are_said_once() -> None:
    assert (AX812.model_number.default, AX812.baud_rate.default) == (812, 1)
    for changes in ({"model_number": RX28.model_number.with_(default=13)}, {"baud_rate": RX28.baud_rate.with_()}):
        with pytest.raises(TypeError, match=r"is not .* as the model says"):
            type("Lame", (AX812,), {"title": "Lame", **changes})
    with pytest.raises(TypeError, match=r"its rows say model number \[6, 2\], the model says 0x0601"):
        type("Lame", (DRS0602,), {"title": "Lame", "number": 0x0601})


# Motors


def test_a_sheet_of_its_own_makes_a_motor_of_its_own() -> None:
    made = motor(AX812)
    assert stall_torque(made, 12.0) == pytest.approx(1.5)
    assert no_load_speed(made, 12.0) == pytest.approx(354 * deg)
    assert list(motor_sets(AX812)) == ["manual"]
    with pytest.raises(UnknownName, match="no motor data 'measured' for AX-812; there are manual"):
        motor(AX812, "measured")


def test_without_one_the_motor_is_inherited() -> None:
    assert motor(Fine) is motor(RX28)
    assert list(motor_sets(Fine)) == ["manual", "measured", "lossless"]


def test_a_motor_that_is_named_wins_over_the_sheet() -> None:
    class Named(AX812):
        title = "Named"
        motors = f"{__name__}:NAMED"

    assert motor(Named) is motor(LX16A)
    assert list(motor_sets(Named)) == ["manual", "lossless"]


# Several models of a family


@pytest.fixture
def with_ax12() -> Any:
    """Let the registry know the AX-812 too, for one test."""
    registry.add(AX812)
    yield
    del registry.MODELS.entries[AX812.key()]


@pytest.mark.usefixtures("with_ax12")
def test_a_scan_asks_at_the_factory_speed_of_every_model() -> None:
    assert registry.factory_bauds(RX28.family) == (57_600, 1_000_000)
    assert registry.bauds(RX28.family)[:2] == (57_600, 1_000_000)
    with servobus.open("virtual:ax812@1,rx28@2?clock=virtual") as bus:
        found = bus.scan(family="dynamixel", ids=range(4))
        assert [(servo.model, servo.id, servo.baud) for servo in found] == [(RX28, 2, 57_600), (AX812, 1, 1_000_000)]
        assert bus.find(1).model is AX812
        bus.torque_on()
        bus.move({1: 100 * deg, 2: 100 * deg}).wait()


class TestSlips:
    def test_a_plain_value_in_place_of_a_row(self) -> None:
        with pytest.raises(TypeError, match=r"highest_limit_temperature = 70 is no register; change .*with_\(\.\.\.\)"):

            class Slip(RX28):
                title = "Slip"
                highest_limit_temperature = 70  # type: ignore[assignment]

    def test_a_row_taken_out_that_no_parent_has(self) -> None:
        with pytest.raises(TypeError, match="ledd = None takes out a row that no parent of it has"):

            class Slip(RX28):
                title = "Slip"
                ledd = None

    def test_a_number_that_another_model_reports(self) -> None:
        class Slip(RX28):
            title = "Slip"

        with pytest.raises(servobus.UsageError, match="RX-28 reports number 28 too"):
            registry.add(Slip)

    def test_firmware_that_needs_a_row_that_was_taken_out(self) -> None:
        class Slip(RX28):
            title, number = "Slip", 65_000
            punch = None  # type: ignore[assignment]

        with pytest.raises(servobus.UsageError, match="Slip cannot be a virtual servo: its firmware"):
            virtual_servo(Slip)

    @pytest.mark.parametrize("access", [Access.READ, Access.RESERVED])
    def test_a_torque_that_cannot_be_switched(self, access: Access) -> None:
        with pytest.raises(TypeError, match=r"torque_enable.* must be a register that can be"):

            class Slip(RX28):
                title, number = "Slip", 65_000
                torque_enable = RX28.torque_enable.with_(access=access)


def test_a_row_of_another_model_is_no_second_name() -> None:
    with pytest.raises(TypeError, match=r"flash = <LX-16A led> is a row of another model; .*LX16A\.led\.with_\(\)"):

        class Foreign(RX28):
            flash = LX16A.led

    with pytest.raises(TypeError, match="row of another model"):

        class Taken(RX28):
            led = LX16A.led


def test_a_new_row_stands_behind_the_one_before_it() -> None:
    class Longer(RX28):
        led = RX28.led.with_(default=1)
        extra = Register(Address(50), U8, Count(), "one more")

    names = list(Longer.registers)
    assert names[names.index("led") + 1] == "extra"


def test_only_a_generic_model_may_lack_units() -> None:
    with pytest.raises(
        TypeError, match="the unit of registered_instruction is not said; only a generic model may lack it"
    ):

        class Vague(RX28):
            title, number = "Vague-1", 901
            registered_instruction = DynamixelTable.registered_instruction.with_(scale=RAW)

    with pytest.raises(TypeError, match="punch can only be read as long as the unit is not known"):

        class Bold(UnknownDynamixel):
            title, generic = "Bold, model unknown", True
            punch = UnknownDynamixel.punch.with_(scale=RAW)


@pytest.mark.parametrize("name", ["xl320", "mx540", "drs9999", "hts99h", "rx777"])
def test_another_model_is_no_slip(name: str) -> None:
    with pytest.raises(UnknownName, match=f"no model '{name}'; `servobus models` lists all {len(MODELS)}$"):
        registry.model(name)


@pytest.mark.parametrize(
    ("name", "near"), [("rx-2", "rx28"), ("lx16", "lx16a"), ("DRS602", "drs0602"), ("rx82", "rx28")]
)
def test_a_slip_is_seen(name: str, near: str) -> None:
    with pytest.raises(UnknownName, match=f"did you mean {near}"):
        registry.model(name)


@pytest.mark.parametrize("name", ["xl430", "dynamixel", "lx"])
def test_only_what_can_be_simulated_is_offered_to_be(name: str) -> None:
    with pytest.raises(UnknownName, match=f"'{name}'; (known are|`servobus models` lists)") as caught:
        registry.simulated(name)
    assert "herkulex" not in str(caught.value)
    assert registry.simulated("RX-28") is registry.model("rx28")
