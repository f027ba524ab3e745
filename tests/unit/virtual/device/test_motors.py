"""The motors of all models: which printed figures they meet, and where their numbers come from."""

import itertools
from collections.abc import Iterator
from dataclasses import fields

import pytest

from samples import every_model
from servobus import MODELS
from servobus.core.units import deg, rpm
from servobus.families.model import Performance, SpecSheet
from servobus.virtual.device.derivation import Sibling, derive
from servobus.virtual.device.motor_set import ALWAYS, Source, assumed, motor_set
from servobus.virtual.device.motors import misses, motor_data, motor_sets, supply
from servobus.virtual.physics.motor import MotorParams, no_load_speed, stall_torque

WITHIN = 0.02
"""How far a motor may be from a printed figure."""
Figure = tuple[str, float, float]
"""What it is, V, and what is printed."""


def figures(sheet: SpecSheet) -> Iterator[Figure]:
    for at in sheet.performance:
        if at.stall_torque is not None:
            yield "stall torque", at.voltage, at.stall_torque
        if at.speed is not None:
            yield "speed", at.voltage, at.speed


def reached(params: MotorParams, what: str, volts: float) -> float:
    return stall_torque(params, volts) if what == "stall torque" else no_load_speed(params, volts)


def can_be_met(some: tuple[Figure, ...]) -> bool:
    """Tell whether a motor with any friction, from none to a tenth of the stall torque, meets all within 2 %."""
    top = max(volts for _, volts, _ in some)
    for tenths in range(0, 101, 5):
        idle = top * tenths / 1000
        ratios = [value / (volts - idle) for _, volts, value in some]
        if max(ratios) * (1 - WITHIN) <= min(ratios) * (1 + WITHIN):
            return True
    return False


def most(all: list[Figure]) -> int:
    """Give how many figures of a kind one motor can meet at most."""
    return next(
        count
        for count in range(len(all), -1, -1)
        if not count or any(map(can_be_met, itertools.combinations(all, count)))
    )


@every_model
def test_the_motor_meets_all_printed_figures_that_a_motor_can_meet(key: str) -> None:
    model = MODELS[key]
    params = motor_sets(model)["manual"].params
    left_out = {(miss.what, miss.voltage) for miss in misses(model) if not miss.text}
    for kind in ("stall torque", "speed"):
        printed = [figure for figure in figures(model.sheet) if figure[0] == kind]
        good = [one for one in printed if reached(params, kind, one[1]) == pytest.approx(one[2], rel=WITHIN)]
        assert len(good) == most(printed)
        assert {(what, volts) for what, volts, _ in printed} - {(what, volts) for what, volts, _ in good} == {
            known for known in left_out if known[0] == kind
        }


@every_model
def test_a_printed_stall_current_is_met_unless_torque_and_speed_take_more(key: str) -> None:
    """No gear gives power: stall current * voltage is at least stall torque * speed without load."""
    model = MODELS[key]
    left_out = {miss.voltage for miss in misses(model) if not miss.text and miss.what == "stall current"}
    for at in model.sheet.performance:
        if at.stall_current is not None and at.stall_torque is not None and at.speed is not None:
            too_little = at.stall_current * at.voltage < at.stall_torque * at.speed * (1 - WITHIN)
            assert (at.voltage in left_out) == too_little


@every_model
def test_every_number_says_where_it_comes_from(key: str) -> None:
    for one in motor_sets(MODELS[key]).values():
        told = {name for name, origin in one.origins.items() if origin.text and origin.source in Source}
        assert told >= set(ALWAYS)
        assert one.text
        for field in fields(MotorParams):
            assert getattr(one.params, field.name) == field.default or field.name in told


@every_model
def test_what_a_sheet_lacks_is_taken_over_from_a_sibling_with_a_name(key: str) -> None:
    model = MODELS[key]
    one = motor_sets(model)["manual"]
    for name, known in (("resistance", model.sheet.stall_torque), ("torque_constant", model.sheet.speed)):
        if known is None:
            assert one.origins[name].source is Source.TAKEN_OVER
            assert any(other.title in one.origins[name].sibling for other in MODELS.values())


@every_model
def test_a_servo_without_a_known_supply_has_that_of_its_sibling(key: str) -> None:
    model = MODELS[key]
    volts, sibling = supply(model)
    assert volts > 0
    assert bool(sibling) == (model.sheet.supply is None)


@every_model
def test_siblings_are_models_that_are_known(key: str) -> None:
    data = motor_data(MODELS[key])
    assert not data.like or data.like in MODELS
    assert bool(data.like) == bool(data.why)


@pytest.mark.parametrize(
    ("key", "constant", "resistance", "inertia", "coulomb", "viscous"),
    [
        # Rhoban BAM (github.com/Rhoban/bam), bam/params/mx64/m1.json and mx106/m1.json; all at the output.
        ("mx64", 1.62, 3.95, 0.0120, 0.090, 0.012),
        ("mx106", 2.19, 2.96, 0.0266, 0.104, 0.035),
    ],
)
def test_measured_sets_are_what_was_identified(
    key: str, constant: float, resistance: float, inertia: float, coulomb: float, viscous: float
) -> None:
    params = motor_sets(MODELS[key])["measured"].params
    assert params.constant == pytest.approx(constant, rel=0.005)
    assert params.gear_loss == params.stiction == 0
    assert params.resistance == pytest.approx(resistance, rel=0.005)
    assert params.inertia == pytest.approx(inertia, rel=0.01)
    assert (params.coulomb, params.viscous) == pytest.approx((coulomb, viscous), rel=0.03)


def test_what_was_measured_is_not_far_from_what_is_printed() -> None:
    """A real MX-64 at 12 V: 6.0 N·m and 63 rpm in the e-manual."""
    params = motor_sets(MODELS["mx64"])["measured"].params
    assert 0.75 < stall_torque(params, 12.0) / 6.0 < 1
    assert 1 < no_load_speed(params, 12.0) / (63 * rpm) < 1.15


# The derivation, on sheets made up here


def sheet(*performance: Performance, **more: float) -> SpecSheet:
    return SpecSheet("Nobody", performance, (9.0, 15.0), 300 * deg, 0.3 * deg, **more)  # type: ignore[arg-type]


OTHER = Sibling(
    "Other",
    motor_set(
        MotorParams(
            gear_ratio=200, torque_constant=0.01, resistance=8.0, inertia=0.004, coulomb=0.06, gear_loss=0.1,
            winding_to_case=10.0, case_to_ambient=30.0, winding_capacity=0.5, case_capacity=9.0,
        ),
        "made up", gear_ratio=assumed("so"), torque_constant=assumed("so"), resistance=assumed("so"),
        inertia=assumed("so"), coulomb=assumed("so"), gear_loss=assumed("so"), heat=assumed("so"),
    ),
    12.0,
    0.070,
)  # fmt: skip


def test_one_point_is_met_exactly() -> None:
    for sibling in (None, OTHER):
        made = derive("New", sheet(Performance(12.0, 1.5, 6.0)), sibling).params
        assert stall_torque(made, 12.0) == pytest.approx(1.5)
        assert no_load_speed(made, 12.0) == pytest.approx(6.0)


def test_the_stall_current_says_what_the_gear_keeps() -> None:
    """AX-12A, e-manual: 1.5 N·m, 59 rpm and 1.5 A at 12 V: 0.77 A would do if the gear kept nothing."""
    made = derive("New", sheet(Performance(12.0, 1.5, 59 * rpm, 1.5)), None).params
    assert 12.0 / made.resistance == pytest.approx(1.5)
    assert stall_torque(made, 12.0) == pytest.approx(1.5)
    assert made.gear_loss == pytest.approx(1 - 0.77 / 1.5, rel=0.05)


def test_a_stall_current_that_is_too_small_is_not_bent() -> None:
    """RX-24F, e-manual: 2.6 N·m and 126 rpm need 2.86 A at 12 V, and 2.4 A are printed."""
    one = derive("New", sheet(Performance(12.0, 2.6, 126 * rpm, 2.4)), OTHER)
    assert one.params.gear_loss == OTHER.motor.params.gear_loss
    assert one.origins["gear_loss"].source is Source.TAKEN_OVER
    assert stall_torque(one.params, 12.0) == pytest.approx(2.6)


def test_several_points_share_what_is_left() -> None:
    """MX-28, e-manual: 2.3, 2.5 and 3.1 N·m, 50, 55 and 67 rpm at 11.1, 12 and 14.8 V."""
    points = [Performance(volts, torque, speed * rpm) for volts, torque, speed in (
        (11.1, 2.3, 50), (12.0, 2.5, 55), (14.8, 3.1, 67))]  # fmt: skip
    made = derive("New", sheet(*points), OTHER).params
    for at in points:
        assert stall_torque(made, at.voltage) == pytest.approx(at.stall_torque, rel=0.015)
        assert no_load_speed(made, at.voltage) == pytest.approx(at.speed, rel=0.015)


def test_of_points_that_contradict_each_other_the_most_are_met_and_those_near_the_nominal_voltage() -> None:
    """MX-106, e-manual: 8.0, 8.4 and 10.0 N·m at 11.1, 12 and 14.8 V: torque grows more slowly than voltage."""
    points = [Performance(11.1, 8.0, 4.3), Performance(12.0, 8.4, 4.7), Performance(14.8, 10.0, 5.8)]
    made = derive("New", sheet(*points, nominal_voltage=12.0), OTHER).params
    off = [abs(stall_torque(made, at.voltage) / at.stall_torque - 1) for at in points if at.stall_torque]
    assert off[0] < WITHIN
    assert off[1] < WITHIN
    assert off[2] > WITHIN


def test_the_bare_shaft_runs_up_as_the_siblings() -> None:
    """Inertia * speed / torque is the time in which a DC motor runs up to 63 %."""
    made, there = derive("New", sheet(Performance(12.0, 1.5, 6.0)), OTHER).params, OTHER.motor.params
    one, other = (params.inertia * no_load_speed(params, 12.0) / stall_torque(params, 12.0) for params in (made, there))
    assert one == pytest.approx(other)
    assert made.coulomb / stall_torque(made, 12.0) == pytest.approx(there.coulomb / stall_torque(there, 12.0))


def test_what_is_heavier_warms_more_slowly() -> None:
    made, there = derive("New", sheet(Performance(12.0, 1.5, 6.0), weight=0.140), OTHER).params, OTHER.motor.params
    assert made.case_capacity == pytest.approx(2 * there.case_capacity)
    assert made.winding_capacity == pytest.approx(2 * there.winding_capacity)
    assert made.case_to_ambient == pytest.approx(there.case_to_ambient / 2 ** (2 / 3))


def test_without_a_torque_it_is_the_siblings_motor_behind_another_gear() -> None:
    made, there = derive("New", sheet(Performance(12.0, None, 470 * rpm)), OTHER).params, OTHER.motor.params
    assert no_load_speed(made, 12.0) == pytest.approx(470 * rpm)
    assert stall_torque(made, 12.0) * 470 * rpm == pytest.approx(stall_torque(there, 12.0) * no_load_speed(there, 12.0))


def test_without_a_speed_it_is_the_siblings_at_its_own_voltage() -> None:
    made = derive("New", sheet(Performance(7.4, 1.2)), OTHER).params
    assert no_load_speed(made, 7.4) == pytest.approx(no_load_speed(OTHER.motor.params, 12.0))
    assert stall_torque(made, 7.4) == pytest.approx(1.2)


def test_without_any_figure_it_is_the_siblings_motor() -> None:
    one = derive("New", sheet(), OTHER)
    assert one.params == OTHER.motor.params
    assert {origin.source for origin in one.origins.values()} == {Source.TAKEN_OVER}


def test_without_a_sibling_a_sheet_needs_torque_and_speed() -> None:
    for points in ((), (Performance(12.0, 1.5),), (Performance(12.0, None, 6.0),)):
        with pytest.raises(ValueError, match="the data sheet of the New lacks what a motor is made of"):
            derive("New", sheet(*points), None)


def test_a_set_without_origins_is_refused() -> None:
    params = MotorParams(gear_ratio=1, torque_constant=1, resistance=1, inertia=1, viscous=0.1)
    with pytest.raises(TypeError, match=r"the origin of .*viscous is not told"):
        motor_set(params, "x", **dict.fromkeys(ALWAYS, assumed("so")))


def test_friction_that_is_assumed_takes_the_place_of_the_siblings() -> None:
    one = derive("New", sheet(Performance(12.0, 1.5, 6.0)), OTHER, (0.05, "so"))
    assert one.params.coulomb == pytest.approx(0.05 * 1.5)
    assert one.origins["coulomb"].source is Source.ASSUMED
    assert stall_torque(one.params, 12.0) == pytest.approx(1.5)
    assert no_load_speed(one.params, 12.0) == pytest.approx(6.0)
