"""Paths and trajectories: states, exact extremes, slow motion, one after another, limits."""

import pytest

from servobus import BadValue, deg
from servobus.errors import UnknownName
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import QUANTITIES, Path, State, Trajectory, resting, standing
from servobus.robots.trajectory.profile import quickest, synchronised
from servobus.robots.trajectory.spline import Shape, spline

LIMITS = JointLimits(3.0, 10.0, 100.0)
TIMES = [0.0, 0.5, 0.9, 1.5, 2.0]
POSES = {"elbow": [0.0, 0.5, -0.2, 0.8, 0.3], "wrist": [0.1, 0.1, 0.2, 0.3, 0.3]}


def sampled(path: Path, quantity: str, count: int = 4000) -> list[float]:
    return [getattr(path.at(path.duration * n / count), quantity) for n in range(count)]


def test_a_joint_rests_before_and_after() -> None:
    path = quickest(0.2, 1.2, LIMITS)
    assert path.at(-1.0) == State(0.2)
    assert path.at(path.duration) == path.at(1e9) == State(1.2)
    assert path.at(float("nan")) == State(0.2)
    assert path.at(0.0) == State(0.2, 0.0, 0.0)
    assert path.at(0.05).acceleration == pytest.approx(5.0)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("quantity", QUANTITIES[:3])
def test_extremes_are_those_of_dense_samples_and_exact(shape: Shape, quantity: str) -> None:
    path = spline(TIMES, POSES, shape).paths["elbow"]
    low, high = path.extremes(quantity)
    values = sampled(path, quantity)
    width = (high.value - low.value) * 0.01
    assert low.value <= min(values) + 1e-9
    assert high.value >= max(values) - 1e-9
    if not (shape is Shape.PCHIP and quantity == "acceleration"):  # that jumps, and a sample sees one side alone
        assert (low.value, high.value) == pytest.approx((min(values), max(values)), abs=width)
        for extreme in (low, high):
            seen = getattr(path.at(min(extreme.time, path.duration - 1e-9)), quantity)
            assert seen == pytest.approx(extreme.value, abs=1e-6)


def test_the_peak_is_a_magnitude() -> None:
    path = quickest(1.0, 0.0, LIMITS)
    assert path.peak("speed").value == pytest.approx(-path.extremes("speed")[0].value)
    assert standing(0.5, 2.0).peak("speed").value == 0.0
    assert standing(0.5, 0.0).extremes()[1].value == 0.5
    with pytest.raises(UnknownName, match="'velocity' is not a quantity of a path: use position, speed"):
        path.peak("velocity")


def test_slow_motion_scales_each_quantity_by_its_power() -> None:
    motion = spline(TIMES, POSES, "quintic")
    slow = motion.slowed(2.0)
    assert slow.duration == 4.0
    for time in (0.3, 0.7, 1.9):
        quick, other = motion.at(time)["elbow"], slow.at(2 * time)["elbow"]
        assert other.position == pytest.approx(quick.position)
        assert other.speed == pytest.approx(quick.speed / 2)
        assert other.acceleration == pytest.approx(quick.acceleration / 4)
    jerks = [one.paths["elbow"].peak("jerk").value for one in (motion, slow)]
    assert jerks[0] == pytest.approx(8 * jerks[1])
    for factor in (0.0, -1.0, 1e300, float("nan")):
        with pytest.raises(BadValue, match=r"is no factor of time: give 0\.001 to"):
            motion.slowed(factor)


def test_motions_follow_one_another() -> None:
    motion = spline(TIMES, POSES, "pchip")
    limits = {"elbow": LIMITS, "wrist": LIMITS}
    here = {"elbow": -1.0, "wrist": 0.0}
    first = synchronised(here, motion.start, limits).slowed(3.0)
    whole = first.then(resting(motion.start, 0.5), motion)
    assert whole.duration == pytest.approx(first.duration + 0.5 + 2.0)
    assert (whole.start, whole.goal) == (here, motion.goal)
    assert whole.at(first.duration + 0.25)["elbow"] == State(0.0)
    assert whole.at(first.duration + 0.5 + 0.9)["elbow"].position == pytest.approx(-0.2)


def test_a_jump_between_motions_is_refused() -> None:
    motion = spline(TIMES, POSES, "pchip")
    with pytest.raises(
        BadValue, match=r"elbow: the next motion begins at 0\.000°, and the one before ends at 17\.189°"
    ):
        motion.then(motion)
    with pytest.raises(BadValue, match="only one of them has wrist"):
        motion.then(Trajectory({"elbow": motion.paths["elbow"]}))
    with pytest.raises(BadValue, match="the paths last 1 s, 2 s"):
        Trajectory({"a": standing(0.0, 1.0), "b": standing(0.0, 2.0)})


def test_a_demand_names_joint_quantity_and_time() -> None:
    motion = spline(TIMES, POSES, "cubic")
    demand = motion.demand({"elbow": LIMITS, "wrist": LIMITS})
    assert (demand.joint, demand.quantity, demand.limit) == ("elbow", "acceleration", 10.0)
    assert demand.value == pytest.approx(motion.paths["elbow"].peak("acceleration").value)
    assert demand.factor == pytest.approx((demand.value / 10.0) ** 0.5)
    assert str(demand) == "elbow: acceleration 1050°/s² at 0.900 s is more than 573°/s²"
    slowed = motion.stretched({"elbow": LIMITS, "wrist": LIMITS})
    assert slowed.duration == pytest.approx(2.0 * demand.factor)
    assert slowed.demand({"elbow": LIMITS, "wrist": LIMITS}).factor == pytest.approx(1.0)
    wide = {"elbow": JointLimits(50.0, 500.0), "wrist": JointLimits(50.0, 500.0)}
    assert motion.stretched(wide) is motion
    assert "is within" in str(motion.demand(wide))


def test_a_swing_beyond_position_limits_is_named() -> None:
    motion = spline(TIMES, POSES, "cubic")
    lowest, highest = motion.paths["elbow"].extremes()
    motion.check_positions({"elbow": (lowest.value, highest.value)})
    with pytest.raises(BadValue, match=r"elbow: 46\.18° at 1\.529 s is above the limit 45\.95°"):
        motion.check_positions({"elbow": (-1.0, 0.802)})
    with pytest.raises(BadValue, match=r"elbow: -11\.80° at 0\.926 s is below the limit -11\.50°"):
        motion.check_positions({"elbow": (-11.5 * deg, 1.0)})
    spline(TIMES, POSES, "pchip").check_positions({"elbow": (-0.2, 0.8)})
    motion.check_positions({})
