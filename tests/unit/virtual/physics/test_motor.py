"""The motor against closed forms. Times in s, angles in rad, everything at the output shaft."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from samples import SAMPLE_KEYS
from servobus.core.units import deg, rpm
from servobus.families.registry import DRS0602, MODELS, RX28
from servobus.virtual.device.motors import motor_sets, supply
from servobus.virtual.physics.motor import (
    CLOSED,
    OPEN,
    REFERENCE,
    Load,
    MotorParams,
    MotorState,
    Supply,
    no_load_speed,
    operating_point,
    prepare,
    shaft_torque,
    stall_torque,
    step,
    temperatures,
    warm,
)

MS = 1e-3
SETS = {key: {name: one.params for name, one in motor_sets(model).items()} for key, model in MODELS.items()}
ALL = [(key, name) for key, sets in SETS.items() for name in sets]
CHOSEN = [(key, name) for key, name in ALL if key in SAMPLE_KEYS or name != "manual"]
"""The sets of the chosen models, and all that are not derived from a data sheet."""
DTS = [0.1 * MS, 0.5 * MS, 1 * MS, 4 * MS, 11.2 * MS, 20 * MS]
LOSSLESS, FRICTION, AS_MEASURED = SETS["rx28"]["lossless"], SETS["rx28"]["manual"], SETS["rx28"]["measured"]
GOOD_GEAR, LOSSY_GEAR = SETS["drs0602"]["manual"], SETS["drs0602"]["lossy"]
LX = SETS["lx16a"]["manual"]
FULL = MotorParams(  # one of everything
    gear_ratio=200, torque_constant=10e-3, resistance=5.0, inertia=0.01,
    coulomb=0.08, viscous=0.03, stiction=0.05, stribeck=0.2, gear_loss=0.25,
)  # fmt: skip
every_set = pytest.mark.parametrize(("key", "name"), ALL, ids=[f"{key}-{name}" for key, name in ALL])
chosen_sets = pytest.mark.parametrize(("key", "name"), CHOSEN, ids=[f"{key}-{name}" for key, name in CHOSEN])
"""For what takes seconds with every set."""
every_dt = pytest.mark.parametrize("dt", DTS)


def top_voltage(key: str) -> float:
    return max((point.voltage for point in MODELS[key].sheet.performance), default=supply(MODELS[key])[0])


def run(
    params: MotorParams,
    duration: float,
    *,
    voltage: float = 0.0,
    duty: Callable[[float], float] = lambda _: 1.0,
    load: Load = Load(),  # noqa: B008 - frozen
    closed: int = CLOSED,
    dt: float = MS,
    state: MotorState | None = None,
) -> Iterator[MotorState]:
    """Step from a state, or from rest at 0; yield the one and same state after every step."""
    state = state or MotorState()
    plan = prepare(params, load, dt=dt)
    for n in range(round(duration / dt)):
        step(plan, state, duty(n * dt), voltage, closed)
        yield state


def last(states: Iterable[MotorState]) -> MotorState:
    *_, state = states
    return state


def near(figure: float, expected: float, absolute: float = 1e-12) -> bool:
    """Tell whether a figure is right to one part in 10⁹: `pytest.approx` costs ten times as much for each step."""
    return abs(figure - expected) <= max(1e-9 * abs(expected), absolute)


def energy(params: MotorParams, load: Load, state: MotorState) -> float:
    """J, 0 for an arm that hangs at rest."""
    height = load.pull * (1 - math.cos(state.position - load.down))
    return (params.inertia + load.total_inertia) * state.velocity**2 / 2 + height


# Specification sheets


@pytest.mark.parametrize("params", [LOSSLESS, LOSSY_GEAR])
def test_so_are_sets_that_explain_the_sheet_otherwise(params: MotorParams) -> None:
    sheet = RX28.sheet if params is LOSSLESS else DRS0602.sheet
    for point in sheet.performance:
        assert no_load_speed(params, point.voltage) == pytest.approx(point.speed, rel=0.01)
        assert stall_torque(params, point.voltage) == pytest.approx(point.stall_torque, rel=0.01)


def test_the_measured_rx28_is_the_point_at_18_5_volts() -> None:
    assert stall_torque(AS_MEASURED, 18.5) == pytest.approx(3.7, rel=0.01)
    assert no_load_speed(AS_MEASURED, 18.5) == pytest.approx(85 * rpm, rel=0.01)
    assert stall_torque(AS_MEASURED, 12.0) < 0.9 * 2.775  # N·m, manual 1-3: 28.3 kgf·cm at 12 V


@every_set
def test_a_stall_cannot_give_more_power_than_it_takes(key: str, name: str) -> None:
    """Stall current * voltage >= stall torque * speed without load: true of any motor, with any gear."""
    params, volts = SETS[key][name], top_voltage(key)
    assert volts**2 / params.resistance >= stall_torque(params, volts) * no_load_speed(params, volts) * (1 - 1e-12)


# The analytic line


@chosen_sets
def test_steady_state_is_on_the_line_at_20_loads(key: str, name: str) -> None:
    params, volts = SETS[key][name], top_voltage(key)
    stall, top = stall_torque(params, volts), no_load_speed(params, volts)
    for n in range(20):
        torque = -stall * n / 20
        end = last(run(params, 2.0, voltage=volts, load=Load(torque=torque)))
        speed, current = operating_point(params, volts, torque)
        assert (end.velocity, end.current) == pytest.approx((speed, current), rel=1e-9)
        assert speed == pytest.approx(top * (1 - n / 20), rel=1e-9)  # a straight line from no load to stall
        assert shaft_torque(params, end.current, end.velocity) == pytest.approx(-torque, rel=1e-9, abs=1e-9)


@given(
    voltage=st.floats(-16, 16), torque=st.floats(-4, 4), loss=st.floats(0, 0.5), coulomb=st.floats(0, 0.3),
    viscous=st.floats(0, 0.1),
)  # fmt: skip
def test_any_operating_point_is_where_the_motor_ends(
    voltage: float, torque: float, loss: float, coulomb: float, viscous: float
) -> None:
    """Driving, at rest, and driven by the load, in both senses."""
    params = replace(FULL, gear_loss=loss, coulomb=coulomb, viscous=viscous, stiction=0.0)
    end = last(run(params, 2.0, voltage=voltage, load=Load(torque=torque), dt=2 * MS))
    assert (end.velocity, end.current) == pytest.approx(operating_point(params, voltage, torque), rel=1e-6, abs=1e-9)


def test_all_is_the_same_in_the_other_sense() -> None:
    load = Load(mass=0.2, length=0.1, torque=0.1)
    other = replace(load, torque=-0.1)
    there = run(FULL, 0.5, voltage=12.0, duty=lambda t: math.cos(20 * t), load=load)
    back = run(FULL, 0.5, voltage=12.0, duty=lambda t: -math.cos(20 * t), load=other)
    for a, b in zip(there, back, strict=True):
        assert (a.position, a.velocity, a.current) == pytest.approx((-b.position, -b.velocity, -b.current), abs=1e-12)


@every_dt
@pytest.mark.parametrize("params", [*(SETS[k][n] for k, n in CHOSEN), replace(FULL, stiction=0.0)])
@pytest.mark.parametrize("start", [0.0, 2.0])
def test_constant_duty_is_exact(params: MotorParams, start: float, dt: float) -> None:
    volts, load = 0.7 * 12.0, Load(inertia=0.004, torque=-0.1)
    inertia, share = params.inertia + load.inertia, 1 - params.gear_loss
    rate = (share * params.constant**2 / params.resistance + params.viscous) / inertia
    end = (share * params.constant * volts / params.resistance - params.coulomb - 0.1) / (rate * inertia)
    state = MotorState(velocity=start)
    for n, now in enumerate(run(params, 0.2, voltage=12.0, duty=lambda _: 0.7, load=load, dt=dt, state=state), 1):
        decay = math.exp(-rate * n * dt)
        assert near(now.velocity, end + (start - end) * decay)
        assert near(now.position, end * n * dt + (start - end) * (1 - decay) / rate)
        assert near(now.current, (volts - params.constant * now.velocity) / params.resistance, absolute=1e-9)


@every_set
def test_the_same_number_of_seconds_in_any_steps(key: str, name: str) -> None:
    params, volts = SETS[key][name], top_voltage(key)
    one = last(run(params, 0.1, voltage=volts, dt=0.1))
    many = last(run(params, 0.1, voltage=volts, dt=0.1 * MS))
    assert (one.position, one.velocity) == pytest.approx((many.position, many.velocity), rel=1e-9)


# Free motion


@given(
    coulomb=st.floats(0, 0.3), stiction=st.floats(0, 0.2), viscous=st.floats(0, 0.1), loss=st.floats(0, 0.9),
    closed=st.sampled_from([OPEN, CLOSED]), mass=st.floats(0, 1), length=st.floats(0.02, 0.3),
    position=st.floats(-4, 4), velocity=st.floats(-10, 10), dt=st.sampled_from([0.2 * MS, 1 * MS, 5 * MS]),
)  # fmt: skip
def test_energy_never_grows(
    coulomb: float, stiction: float, viscous: float, loss: float, closed: int, mass: float, length: float,
    position: float, velocity: float, dt: float,
) -> None:  # fmt: skip
    params = replace(LOSSLESS, coulomb=coulomb, stiction=stiction, viscous=viscous, gear_loss=loss, resistance=20.0)
    load = Load(mass=mass, length=length)
    state = MotorState(position=position, velocity=velocity)
    most = energy(params, load, state)
    # What drift, kick, drift conserves differs from the energy by this much at most, there and back.
    inertia = params.inertia + load.total_inertia
    ripple = dt**2 * load.pull * (2 * most / inertia + load.pull / inertia) / 8
    for now in run(params, 200 * dt, load=load, closed=closed, dt=dt, state=state):
        assert energy(params, load, now) <= most + ripple + 1e-12
    flat = Load(inertia=load.total_inertia)  # no gravity, no ripple
    state = MotorState(velocity=velocity)
    speed = abs(velocity)
    for now in run(params, 200 * dt, load=flat, closed=closed, dt=dt, state=state):
        assert abs(now.velocity) <= speed
        speed = abs(now.velocity)


@pytest.mark.parametrize("start", [0.1, 1.5, 3.1])
@pytest.mark.parametrize("load", [Load(mass=0.3, length=0.15), Load(mass=1.0, length=0.05, inertia=0.001, tilt=0.5)])
def test_without_losses_a_pendulum_keeps_its_energy(start: float, load: Load) -> None:
    state = MotorState(position=start)
    whole = energy(LOSSLESS, load, state)
    for now in run(LOSSLESS, 10.0, load=load, closed=OPEN, state=state):
        assert energy(LOSSLESS, load, now) == pytest.approx(whole, rel=1e-3)


def test_a_small_swing_takes_the_time_it_should() -> None:
    load = Load(mass=0.4, length=0.2, down=1.0)
    rate = math.sqrt(load.pull / (LOSSLESS.inertia + load.total_inertia))
    for n, now in enumerate(run(LOSSLESS, 5.0, load=load, closed=OPEN, state=MotorState(position=1.001)), 1):
        assert now.position == pytest.approx(1 + 0.001 * math.cos(rate * n * MS), abs=2e-6)


def test_gravity_pulls_in_full_on_a_horizontal_axis_only() -> None:
    assert Load(mass=2.0, length=0.1).pull == pytest.approx(1.96133)
    assert Load(mass=2.0, length=0.1, tilt=60 * deg).pull == pytest.approx(1.96133 / 2)
    assert Load(mass=2.0, length=0.1).total_inertia == pytest.approx(0.02)


# Friction


@every_dt
def test_friction_alone_stops_where_it_should(dt: float) -> None:
    params = replace(FRICTION, viscous=0.0)
    end = last(run(params, 1.0, closed=OPEN, dt=dt, state=MotorState(velocity=6.0)))
    assert end.velocity == 0
    assert end.position == pytest.approx(params.inertia * 6.0**2 / (2 * params.coulomb), rel=1e-9)


@pytest.mark.parametrize("params", [FRICTION, AS_MEASURED, GOOD_GEAR, LX, FULL])
@pytest.mark.parametrize("at", [90 * deg, -30 * deg])
def test_stiction_holds_an_arm_for_a_minute(params: MotorParams, at: float) -> None:
    breakaway = params.coulomb + params.stiction

    def arm(torque: float) -> Load:
        return Load(mass=torque / (9.80665 * 0.1 * abs(math.sin(at))), length=0.1)

    state = MotorState(position=at)
    assert all(
        now.position == at and now.velocity == 0
        for now in run(params, 60.0, load=arm(0.999 * breakaway), closed=OPEN, state=state)
    )
    assert last(run(params, 0.1, load=arm(1.001 * breakaway), closed=OPEN, state=state)).position != at


@every_dt
@pytest.mark.parametrize("params", [LOSSY_GEAR, LX, FULL])
def test_a_loaded_gear_holds_more_than_it_drives(params: MotorParams, dt: float) -> None:
    volts = 3.0
    motor, rest = params.constant * volts / params.resistance, params.coulomb + params.stiction
    least, most = motor * (1 - params.gear_loss) - rest, motor * (1 + params.gear_loss) + rest
    for torque in (1.001 * least, motor, 0.999 * most):
        assert all(now.position == 0 for now in run(params, 2.0, voltage=volts, load=Load(torque=-torque), dt=dt))
    assert last(run(params, 0.1, voltage=volts, load=Load(torque=-0.999 * least), dt=dt)).position > 0
    assert last(run(params, 0.1, voltage=volts, load=Load(torque=-1.001 * most), dt=dt)).position < 0


@every_dt
def test_a_swing_ends_in_rest_and_stays_there(dt: float) -> None:
    state = MotorState(position=2.0)
    load = Load(mass=0.5, length=0.1)
    last(run(FULL, 20.0, load=load, closed=OPEN, dt=dt, state=state))
    rest = state.position
    assert state.velocity == 0
    assert all(now.position == rest for now in run(FULL, 20.0, load=load, closed=OPEN, dt=dt, state=state))
    assert load.pull * abs(math.sin(rest)) <= FULL.coulomb + FULL.stiction


@every_dt
def test_a_braked_arm_creeps_down_without_a_limit_cycle(dt: float) -> None:
    state = MotorState(position=2.0)
    load = Load(mass=0.5, length=0.1)
    fall = [now.velocity for now in run(FULL, 40.0, load=load, dt=dt, state=state)]
    creep = fall[round(5 / dt) :]
    assert all(a <= b <= 0 for a, b in itertools.pairwise(creep))
    # It ends where friction at rest holds it, and comes there ever slower as no impact ends the creep.
    assert load.pull * math.sin(state.position) == pytest.approx(FULL.coulomb + FULL.stiction, rel=1e-6)


def test_it_takes_more_to_start_than_to_go_on() -> None:
    push = Load(torque=FULL.coulomb + 0.8 * FULL.stiction)
    assert last(run(FULL, 1.0, load=push, closed=OPEN)).velocity == 0
    assert last(run(FULL, 1.0, load=push, closed=OPEN, state=MotorState(velocity=1.0))).velocity > 1.0


# Step size


def disc(stall: float) -> Load:
    return Load(inertia=0.003 * stall)


def arm(stall: float) -> Load:
    return Load(mass=0.08 * stall, length=0.15)


@chosen_sets
@pytest.mark.parametrize("loaded", [lambda _: Load(), disc, arm], ids=["bare", "disc", "arm"])
def test_half_the_step_changes_less_than_a_register_unit(key: str, name: str, loaded: Callable[[float], Load]) -> None:
    """The load is as heavy as the motor is strong, with its stall torque in N·m."""
    params, volts, unit = SETS[key][name], top_voltage(key), MODELS[key].sheet.resolution
    load = loaded(stall_torque(params, volts))
    way = (state.position for state in run(params, 0.5, voltage=volts, load=load, dt=MS))
    against = next(n for n, position in enumerate(way) if position > 80 * deg) * MS

    def bang_bang(t: float) -> float:
        """Full output for 80°, 50 ms against it, which turns the shaft round, then brake."""
        return (t < against - 1e-9) - (against - 1e-9 <= t < against + 0.05 - 1e-9)

    def path(dt: float, *, swing: bool) -> list[float]:
        if swing:
            states = run(params, 3.0, load=load, closed=OPEN, dt=dt, state=MotorState(position=2.0))
        else:
            states = run(params, 0.6, voltage=volts, duty=bang_bang, load=load, dt=dt)
        return [now.position for now in itertools.islice(states, round(MS / dt) - 1, None, round(MS / dt))]

    # What turning round adds to the 80° is less than full speed for as long.
    assert 70 * deg < max(path(MS, swing=False)) < 80 * deg + no_load_speed(params, volts) * 0.055
    for swing in (False, True):
        whole, half = path(MS, swing=swing), path(MS / 2, swing=swing)
        # A fifth of a unit; of servos geared for wheels, what they turn in 25 µs, which is less than one.
        bound = max(0.2 * unit, no_load_speed(params, volts) * 25e-6)
        assert max(abs(a - b) for a, b in zip(whole, half, strict=True)) < bound < unit


@every_dt
@chosen_sets
def test_it_is_stable_with_any_step(key: str, name: str, dt: float) -> None:
    params, volts = SETS[key][name], top_voltage(key)
    load = Load(mass=0.3, length=0.1)
    bound = volts / params.constant + 2 * math.sqrt(2 * load.pull / params.inertia)
    for closed in (OPEN, CLOSED):
        states = run(params, 2.0, voltage=volts, duty=lambda t: math.sin(40 * t), load=load, closed=closed, dt=dt)
        assert all(abs(now.velocity) < bound for now in states)
    end = last(run(params, 2.0, voltage=volts, load=Load(torque=-0.3), dt=dt))
    assert end.velocity == pytest.approx(operating_point(params, volts, -0.3)[0], rel=1e-9)


# What holds the shaft


def test_a_blocked_shaft_stalls_at_once() -> None:
    state = MotorState(position=0.3, velocity=5.0)
    load = Load(mass=1.0, length=0.2, torque=5.0, blocked=1.0)
    for now in run(AS_MEASURED, 1.0, voltage=12.0, load=load, state=state):
        assert (now.position, now.velocity) == (0.3, 0.0)
        assert now.current == pytest.approx(12.0 / 8.86)
    assert shaft_torque(AS_MEASURED, state.current) == pytest.approx(stall_torque(AS_MEASURED, 12.0))


@every_dt
def test_hard_stops_catch_the_shaft_without_bounce(dt: float) -> None:
    params = replace(FRICTION, low_stop=-0.5, high_stop=1.0)
    state = MotorState()
    for now in run(params, 1.0, voltage=12.0, dt=dt, state=state):
        assert now.position <= 1.0
    assert (state.position, state.velocity) == (1.0, 0.0)
    assert state.current == pytest.approx(12.0 / params.resistance)
    first = next(run(params, dt, voltage=-12.0, dt=dt, state=state))
    assert first.position < 1.0
    assert first.velocity < 0
    last(run(params, 1.0, voltage=-12.0, dt=dt, state=state))
    assert (state.position, state.velocity) == (-0.5, 0.0)


def test_the_output_lags_by_the_backlash() -> None:
    params = replace(FRICTION, backlash=0.02)
    state = MotorState()
    last(run(params, 0.3, voltage=12.0, state=state))
    assert state.output == pytest.approx(state.position - 0.01)
    rest = state.output
    for now in run(params, 0.3, voltage=-12.0, state=state):
        assert now.position - 0.01 <= now.output + 1e-15 <= now.position + 0.01 + 2e-15
    assert state.output == pytest.approx(state.position + 0.01)
    assert state.output < rest
    assert last(run(LOSSLESS, 0.1, voltage=12.0)).play == 0


@every_dt
def test_a_free_shaft_runs_on_and_a_braked_one_does_not(dt: float) -> None:
    start, time = 5.0, LOSSLESS.inertia * LOSSLESS.resistance / LOSSLESS.constant**2
    free = last(run(LOSSLESS, 0.2, closed=OPEN, dt=dt, state=MotorState(velocity=start)))
    assert free.velocity == pytest.approx(start)
    assert free.current == free.heat == 0
    for n, now in enumerate(run(LOSSLESS, 0.06, dt=dt, voltage=12.0, duty=lambda _: 0.0, state=free), 1):
        assert now.velocity == pytest.approx(start * math.exp(-n * dt / time))
        assert now.current * now.velocity < 0


def test_a_push_for_a_single_step_is_an_impulse() -> None:
    state = MotorState()
    step(prepare(LOSSLESS, dt=MS), state, 0.0, 0.0, OPEN, torque=0.32)
    assert state.velocity == pytest.approx(0.32 * MS / LOSSLESS.inertia)


def test_impossible_motors_are_refused() -> None:
    for change in (
        {"resistance": 0.0}, {"inertia": -1.0}, {"gear_loss": 1.0}, {"coulomb": -0.1}, {"stribeck": 0.0},
        {"low_stop": 1.0, "high_stop": -1.0},
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"must|cannot|can keep"):
            replace(LOSSLESS, **change)


# Supply


Motors = list[tuple[float, float, float]]


def drawn(motors: Motors, voltage: float) -> float:
    return sum(duty * (duty * voltage - emf) / resistance for duty, emf, resistance in motors)


@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-16, 16), st.floats(2, 10)), max_size=20),
    st.floats(0, 2), st.floats(0, 0.5),
)  # fmt: skip
def test_the_supply_sags_as_iteration_finds(motors: Motors, resistance: float, standby: float) -> None:
    supply = Supply(12.0, resistance)
    low, high = -1000.0, 1000.0
    for _ in range(100):  # bisection: what is left for the line falls with the voltage assumed on it
        middle = (low + high) / 2
        if 12.0 - resistance * (drawn(motors, middle) + standby) > middle:
            low = middle
        else:
            high = middle
    assert supply.voltage(motors, standby) == pytest.approx(max(0.0, min(low, 12.0)), abs=1e-9)


def test_every_stalled_servo_pulls_the_line_down() -> None:
    supply, stalled = Supply(14.8, 0.4), (1.0, 0.0, 4.25)
    volts = [supply.voltage([stalled] * n) for n in range(6)]
    assert volts == pytest.approx([14.8 * 4.25 / (4.25 + 0.4 * n) for n in range(6)])
    assert volts[5] < 10.1
    # At half the duty half the current is drawn for half the time.
    assert 14.8 - supply.voltage([(0.5, 0.0, 4.25)]) == pytest.approx(0.4 * 14.8 / 4.25 / 4, rel=0.03)


def test_what_a_motor_feeds_back_helps_others_but_does_not_raise_the_line() -> None:
    supply = Supply(12.0, 1.0)
    driven, stalled = (1.0, 20.0, 4.0), (1.0, 0.0, 4.0)
    assert supply.voltage([driven]) == 12.0
    assert supply.voltage([stalled]) < supply.voltage([stalled, driven]) < 12.0


def test_a_good_supply_does_not_sag() -> None:
    assert Supply(12.0).voltage([(1.0, 0.0, 2.0)] * 254, standby=9.0) == 12.0
    assert Supply(12.0, 0.1).voltage([], standby=2.0) == pytest.approx(11.8)
    assert Supply(12.0, 5.0).voltage([], standby=9.0) == 0.0


def test_a_plan_says_what_the_supply_must_know() -> None:
    plan = prepare(LOSSLESS, dt=MS, winding=REFERENCE + 100)
    assert plan.resistance == pytest.approx(8.30 * 1.39)
    assert plan.constant == pytest.approx(193 * 9.92e-3)


# Heat


@every_set
def test_heat_settles_where_the_resistances_say(key: str, name: str) -> None:
    params, power = SETS[key][name], 3.0
    case = 20.0 + power * params.case_to_ambient
    winding = case + power * params.winding_to_case
    assert temperatures(params, 25.0, 25.0, power, 20.0, 1e5) == pytest.approx((winding, case))
    assert temperatures(params, winding, case, power, 20.0, 1234.5) == pytest.approx((winding, case))


@every_set
def test_heat_flows_as_a_fine_integration_finds(key: str, name: str) -> None:
    params, power, ambient = SETS[key][name], 5.0, 25.0

    def slope(w: float, c: float) -> tuple[float, float]:
        flow = (w - c) / params.winding_to_case
        out = (c - ambient) / params.case_to_ambient
        return (power - flow) / params.winding_capacity, (flow - out) / params.case_capacity

    w, c, h = 60.0, 40.0, 0.01
    for _ in range(10_000):
        a = slope(w, c)
        b = slope(w + h / 2 * a[0], c + h / 2 * a[1])
        w, c = w + h * b[0], c + h * b[1]
    assert temperatures(params, 60.0, 40.0, power, ambient, 100.0) == pytest.approx((w, c), abs=1e-4)


@every_set
def test_time_constants_are_those_of_the_nodes(key: str, name: str) -> None:
    params = SETS[key][name]
    inner, outer = params.winding_to_case, params.case_to_ambient
    # The winding against a case too heavy to warm up; the case with a winding too light to matter.
    heavy = replace(params, case_capacity=1e12)
    time = inner * params.winding_capacity
    assert temperatures(heavy, 125.0, 25.0, 0.0, 25.0, time)[0] == pytest.approx(25 + 100 / math.e, rel=1e-6)
    light = replace(params, winding_capacity=1e-9)
    time = outer * params.case_capacity
    assert temperatures(light, 125.0, 125.0, 0.0, 25.0, time)[1] == pytest.approx(25 + 100 / math.e, rel=1e-6)


@pytest.mark.parametrize(("dt", "steps"), [(0.1 * MS, 300_000), (20 * MS, 1500), (1.0, 30), (30.0, 1)])
def test_heat_does_not_depend_on_the_step(dt: float, steps: int) -> None:
    """Nor does a rise of a nanokelvin in each step vanish in rounding."""
    winding = case = 25.0
    for _ in range(steps):
        winding, case = temperatures(LOSSLESS, winding, case, 1e-3, 25.0, dt)
    exact = temperatures(LOSSLESS, 25.0, 25.0, 1e-3, 25.0, 30.0)
    assert (winding - 25, case - 25) == pytest.approx((exact[0] - 25, exact[1] - 25), rel=1e-6)


@given(st.floats(-40, 200), st.floats(-40, 120), st.floats(0, 50), st.floats(1e-4, 1e9))
def test_heat_is_stable_for_any_step(winding: float, case: float, power: float, dt: float) -> None:
    low, high = min(winding, case, 25.0), max(winding, case, 25.0)
    after = temperatures(LX, winding, case, power, 25.0, dt)
    assert low - 1e-9 <= min(after) <= max(after) <= high + power * 30.0 + 1e-9


def test_a_stall_warms_the_winding_long_before_the_case() -> None:
    state, ambient = MotorState(), 25.0
    plan = prepare(LOSSLESS, Load(blocked=1.0), dt=MS)
    power = 12.0**2 / 8.30
    for _ in range(10):
        for _ in range(100):
            step(plan, state, 1.0, 12.0)
        assert state.heat == pytest.approx(0.1 * power)
        warm(LOSSLESS, state, ambient, 0.1)
        assert state.heat == 0
    assert state.winding - ambient == pytest.approx(power / 0.5, rel=0.15)
    assert state.case - ambient < 1.0
    hot = prepare(LOSSLESS, Load(blocked=1.0), dt=MS, winding=state.winding)
    step(hot, state, 1.0, 12.0)
    assert state.current == pytest.approx(12.0 / (8.30 * (1 + 0.0039 * (state.winding - REFERENCE))))
    assert shaft_torque(LOSSLESS, state.current) == pytest.approx(stall_torque(LOSSLESS, 12.0, state.winding))
