"""What the page of one servo works out: groups, edits, conditions, limits, zero. Figures come from the manuals."""

from math import isclose

import pytest

from servobus import MODELS
from servobus.core.units import deg
from servobus.errors import BadValue, UsageError
from servobus.families.base import Answers
from servobus.families.model import Model
from servobus.server.web.page.settings import conditions, gauges, zero
from servobus.server.web.page.settings.draft import Draft, is_default, place
from servobus.server.web.page.settings.purposes import Purpose, grouped, matches, purpose, title
from servobus.server.web.values import Content

RX28, DRS0602, LX16A = MODELS["rx28"], MODELS["drs0602"], MODELS["lx16a"]


def as_from_the_factory(model: type[Model]) -> dict[str, Content]:
    """Give a servo that has its factory settings, where these are known."""
    return {
        row.name: Content(row.default or 0, (row.default or 0) if row.place.has_working_copy else None)
        for row in model.registers.values()
        if row.readable
    }


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.key())
def test_each_register_stands_in_one_group_and_no_setting_among_what_is_measured(model: type[Model]) -> None:
    groups = grouped(model.registers.values())
    names = [row.name for rows in groups.values() for row in rows]
    assert len(names) == len(set(names))
    shown = {row.name for row in model.registers.values() if row.readable and not row.name.startswith("reserved")}
    assert set(names) == shown
    assert not any(row.writable for row in groups[Purpose.MEASURED])
    assert {row.name for row in groups[Purpose.MEASURED]} >= {model.register("present_position").name}


def test_registers_stand_where_people_look_for_them() -> None:
    assert purpose(RX28.register("max_temperature")) is Purpose.PROTECTION
    assert purpose(RX28.register("min_position")) is Purpose.RANGE
    assert purpose(DRS0602.register("position_kp")) is Purpose.CONTROL
    assert purpose(DRS0602.register("calibration")) is Purpose.RANGE
    assert purpose(LX16A.register("mode")) is Purpose.MOTION
    assert title(RX28.register("cw_angle_limit")) == "CW angle limit"
    assert title(RX28.register("id")) == "ID"
    assert matches(RX28.register("max_temperature"), "overheat limit")
    assert not matches(RX28.register("max_temperature"), "voltage")


def test_an_edit_is_taken_as_typed_and_counts_what_goes_to_the_eeprom() -> None:
    draft = Draft(RX28, as_from_the_factory(RX28))
    draft.type("max_torque", "50")
    draft.type("led", "on")
    draft.type("highest_limit_temperature", "raw 70")
    assert [one.row.name for one in draft.edits()] == ["highest_limit_temperature", "max_torque", "led"]
    assert draft.eeprom(keep=True) == draft.eeprom(keep=False) == ["highest_limit_temperature", "max_torque"]
    assert draft.writes(keep=True) == (
        (True, {"highest_limit_temperature": {"raw": 70}, "max_torque": {"raw": 512}}),
        (False, {"led": {"raw": 1}}),
    )
    assert not draft.choosable
    assert draft.undoing(keep=True) == (
        (True, {"highest_limit_temperature": {"raw": 80}, "max_torque": {"raw": 1023}}),
        (False, {"led": {"raw": 0}}),
    )


def test_a_value_that_is_there_already_is_no_edit() -> None:
    draft = Draft(RX28, as_from_the_factory(RX28))
    draft.type("highest_limit_temperature", "70")
    draft.type("highest_limit_temperature", "80")
    assert len(draft) == 0
    draft.type("led", "on")
    draft.learn({"led": Content(1)})
    assert len(draft) == 0


def test_a_wrong_value_changes_nothing() -> None:
    draft = Draft(RX28, as_from_the_factory(RX28))
    draft.type("max_torque", "50")
    for name, text in (("max_torque", "500"), ("max_torque", "raw x"), ("max_torque", "much"), ("present_load", "1")):
        with pytest.raises(BadValue):
            draft.type(name, text)
    assert draft.raw("max_torque") == 512


def test_limits_that_cross_are_told_before_anything_is_written() -> None:
    draft = Draft(RX28, as_from_the_factory(RX28))
    draft.type("cw_angle_limit", "200")
    assert draft.problem() == ""
    draft.type("ccw_angle_limit", "100")
    assert "cw_angle_limit" in draft.problem()


def test_a_herkulex_can_be_changed_until_power_off_alone() -> None:
    draft = Draft(DRS0602, as_from_the_factory(DRS0602))
    draft.type("position_kp", "raw 100")
    assert draft.choosable
    assert draft.eeprom(keep=False) == []
    assert draft.eeprom(keep=True) == ["position_kp"]
    assert draft.writes(keep=False) == ((False, {"position_kp": {"raw": 100}}),)
    assert place(DRS0602.register("position_kp")) == "EEPROM + RAM"


def test_what_acts_and_what_is_stored_are_brought_back_apart() -> None:
    held = {**as_from_the_factory(DRS0602), "position_kp": Content(now=90, stored=70)}
    draft = Draft(DRS0602, held)
    draft.set("position_kp", 90)  # keep what acts now
    assert draft.eeprom(keep=True) == ["position_kp"]
    assert draft.undoing(keep=True) == ((True, {"position_kp": {"raw": 70}}), (False, {"position_kp": {"raw": 90}}))


def test_the_goal_is_not_brought_back() -> None:
    draft = Draft(RX28, {**as_from_the_factory(RX28), "goal_position": Content(512)})
    draft.type("goal_position", "10")
    assert draft.edits()[0].warning
    assert draft.undoing(keep=True) == ()


def test_marks_of_the_factory_setting() -> None:
    row = RX28.register("max_temperature")
    assert is_default(row, Content(80)) is True
    assert is_default(row, Content(70)) is False
    assert is_default(RX28.register("present_load"), Content(0)) is None


def test_the_grid_of_conditions() -> None:
    found = {one.name: one for one in conditions.conditions(RX28)}
    assert (found["overheating"].light, found["overheating"].torque) == (0x04, 0x04)  # bit 2 of both, manual 3-4
    assert [row.name for row in found["input_voltage"].limits] == ["lowest_limit_voltage", "highest_limit_voltage"]
    small = {one.name for one in conditions.conditions(MODELS["drs0101"])}
    assert "driver_fault" in small
    assert "driver_fault" not in {one.name for one in conditions.conditions(DRS0602)}  # 0101 and 0201 alone have one
    lx = {one.name: one for one in conditions.conditions(LX16A)}
    assert lx["locked_rotor"].light == 4
    assert lx["locked_rotor"].torque is None
    assert conditions.with_bit(36, 4, on=False) == 32
    assert conditions.with_bit(32, 1, on=True) == 33


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.key())
def test_each_alarm_has_a_name_and_a_mend(model: type[Model]) -> None:
    found = conditions.conditions(model)
    assert found
    assert all(one.title and one.mend for one in found)


def test_which_requests_are_answered() -> None:
    assert set(conditions.ANSWERS) == set(Answers)
    assert conditions.answer_policy(LX16A) is None
    row = conditions.answer_policy(DRS0602)
    assert row is not None
    assert row.name == "ack_policy"


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.key())
def test_limits_lie_on_their_scale(model: type[Model]) -> None:
    for gauge in gauges.gauges(model):
        for row in (gauge.low, gauge.high):
            if row is not None and row.default is not None:
                assert 0 <= gauge.share(row.scale.decode(row.default)) <= 1
    assert {one.title for one in gauges.gauges(model)} >= {"Position", "Supply"}


def test_inside_and_outside_of_limits() -> None:
    heat = next(one for one in gauges.gauges(RX28) if one.title == "Temperature")
    assert heat.inside(79.0, {"highest_limit_temperature": 80.0})
    assert not heat.inside(81.0, {"highest_limit_temperature": 80.0})
    assert heat.text(31.0) == "31 °C"


def test_a_new_zero_of_an_lx() -> None:
    """The manual: a unit is 0.24°, and the offset is -125 to 125 units, which is -30° to 30°."""
    found = zero.shifted(LX16A, present=510, shift=0, wanted=120 * deg)
    assert (found.row.name, found.raw, found.reads) == ("angle_offset", 10, 500)
    with pytest.raises(BadValue, match=r"92.4° .. 152.4°"):
        zero.shifted(LX16A, present=510, shift=0, wanted=0.0)


def test_a_servo_without_a_zero_of_its_own_says_who_has_one() -> None:
    assert zero.shift_row(RX28) is None
    with pytest.raises(UsageError, match="robot file"):
        zero.shifted(RX28, present=512, shift=0, wanted=0.0)
    assert isclose(RX28.register("present_position").scale.decode(1023), 300 * deg)
