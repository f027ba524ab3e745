import math
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus import deg
from servobus.robots.calibration.flow import Calibration
from servobus.robots.calibration.joint import Key, Step, key_of
from servobus.robots.calibration.sweep import Ends, Track
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_text
from servobus.robots.file.writing import edited
from unit.robots.arms import SIX

PERIOD = 0.05
BAUD = {"rx28": 57_600, "lx16a": 115_200, "drs0602": 115_200, "mx28at": 57_600}


def rx28(angle: float) -> float:
    """Read as the potentiometer of an RX-28: 0..300°, in the gap as the nearer end (manual: 300° and 1023 steps)."""
    within = angle % 360
    return within if within <= 300 else (300.0 if within < 330 else 0.0)


def mx(angle: float) -> float:
    return angle % 360


def lx(angle: float) -> float:
    """Read as an LX-16A: below 0 and above 240° a little, and jump on the other side."""
    return (angle + 60) % 360 - 60


class Hand:
    """Turns shafts, angles in degrees as a protractor shows them, while a flow takes what their sensors tell."""

    def __init__(
        self, flow: Calibration, sensors: dict[Key, Callable[[float], float]], start: dict[Key, float]
    ) -> None:
        self.flow, self.sensors, self.shafts = flow, sensors, dict(start)
        self.now = 0.0
        self.lost: set[Key] = set()
        self.messages: list[str] = []

    def tick(self) -> None:
        self.now += PERIOD
        readings = {key: self.sensors[key](angle) * deg for key, angle in self.shafts.items() if key not in self.lost}
        self.flow.take(self.now, readings)
        if self.flow.message and self.flow.message not in self.messages[-1:]:
            self.messages.append(self.flow.message)

    def rest(self, seconds: float = 0.6) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.tick()

    def turn(self, goals: dict[Key, float], speed: float = 120.0) -> None:
        ways = {key: goal - self.shafts[key] for key, goal in goals.items()}
        ticks = max(1, math.ceil(max(map(abs, ways.values())) / speed / PERIOD))
        start = dict(self.shafts)
        for n in range(1, ticks + 1):
            self.shafts.update({key: start[key] + way * n / ticks for key, way in ways.items()})
            self.tick()

    def visit(self, *goals: dict[Key, float]) -> None:
        for goal in goals:
            self.turn(goal)
            self.rest(0.2)


def file_of(*joints: str, model: str = "rx28") -> RobotFile:
    """Make a robot file of joints of one model with ids from 1 on; what is given is added to each."""
    text = '[robot]\nformat = 1\n[port.a]\npath = "virtual:rx28@1"\n'
    for n, joint in enumerate(joints, 1):
        name, _, more = joint.partition("\n")
        text += f'[joint.{name}]\nport = "a"\nmodel = "{model}"\nid = {n}\n{more}\n'
    return read_text(text)


def key(id: int, model: str = "rx28") -> Key:
    return "a", id, BAUD[model]


def hand_for(file: RobotFile, names: Iterable[str], sensor: Callable[[float], float], **more: object) -> Hand:
    flow = Calibration(file, list(names), **more)  # type: ignore[arg-type]
    keys = [key_of(servo) for joint in file.joints.values() for servo in joint.servos]
    return Hand(flow, dict.fromkeys(keys, sensor), dict.fromkeys(keys, 150.0))


def step_of(hand: Hand, name: str) -> Step:
    return hand.flow.joints[name].step


def calibrate(hand: Hand, one: Key, low: float, high: float, zero: float, *, positive: int = 1) -> None:
    """Do with one servo what the flow asks for; angles of the servo in degrees."""
    start = (low + high) / 2
    hand.turn({one: start - 20})
    hand.rest()
    hand.turn({one: start})
    hand.rest()
    hand.turn({one: start + 20 * positive})
    hand.turn({one: start})
    hand.visit({one: low}, {one: high}, {one: low}, {one: high}, {one: start})
    hand.visit({one: zero})
    hand.rest()


def test_one_joint_from_finding_it_to_its_limits() -> None:
    file = file_of("shoulder\nzero = '10deg'", "elbow")
    hand = hand_for(file, ["shoulder"], rx28)
    calibrate(hand, key(1), 60.0, 240.0, 100.0, positive=-1)
    flow = hand.flow
    assert (
        flow.prompt == "SHOULDER: bring it to 0.0° of the joint, a known pose or a mark, hold it there and press ENTER"
    )
    flow.confirm()
    # 100° is no multiple of 15° and 105° is 5° off: nothing is offered.
    assert flow.over
    (result,) = flow.results()
    assert result.directions == (-1,)
    assert result.zeros[0] == pytest.approx(100 * deg)
    assert result.travel == pytest.approx((-140 * deg, 40 * deg))
    assert result.limits == pytest.approx((-138 * deg, 38 * deg))
    assert flow.changes() == {
        ("joint", "shoulder", "zero"): "100deg",
        ("joint", "shoulder", "direction"): -1,
        ("joint", "shoulder", "limits"): ["-138deg", "38deg"],
    }
    read_text(edited(file, flow.changes()))
    assert hand.messages == [
        "shoulder has id 1 on a",
        "shoulder: positive is against its servo",
        "shoulder: both ends are known",
    ]


def test_prompts_say_what_is_to_be_done() -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    flow, one = hand.flow, key(1)
    assert flow.prompt == "SHOULDER: hold the arm still"
    hand.rest()
    assert flow.prompt == "SHOULDER: move this joint to and fro, and no other"
    hand.turn({one: 170})
    assert flow.prompt == "SHOULDER: hold the arm still"
    hand.rest()
    assert flow.prompt == "SHOULDER: push it to where its angle shall grow"
    hand.turn({one: 150})
    assert flow.prompt == "SHOULDER: push it back, to where its angle shall get smaller"
    hand.turn({one: 170})
    assert flow.prompt == "SHOULDER: move it to both ends, twice (lower end 0 of 2, upper end 0 of 2)"
    hand.visit({one: 240}, {one: 150})
    # The joint counts against its servo: the upper end of the servo is the lower one of the joint.
    assert flow.prompt == "SHOULDER: move it to both ends, twice (lower end 1 of 2, upper end 0 of 2)"


def test_an_end_that_is_1_degree_off_counts_and_one_that_is_2_off_does_not() -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    one = key(1)
    calibrate(hand, one, 60.0, 240.0, 150.0)
    assert hand.flow.joints["shoulder"].step is Step.ZERO
    hand.flow.redo()
    hand.rest()
    hand.turn({one: 170})
    hand.rest()
    hand.turn({one: 190})
    hand.turn({one: 170})
    hand.visit({one: 60}, {one: 238}, {one: 60}, {one: 240}, {one: 150})
    assert hand.flow.joints["shoulder"].ends.touched == (2, 1)
    hand.visit({one: 239.2}, {one: 150})
    assert hand.flow.joints["shoulder"].step is Step.ZERO


@pytest.mark.parametrize("zero", ["known pose", "typed"])
def test_a_known_pose_is_where_the_zero_comes_from(zero: str) -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28, zeros={"shoulder": 90 * deg})
    calibrate(hand, key(1), 60.0, 240.0, 200.0)
    hand.flow.confirm(45 * deg if zero == "typed" else None)
    (result,) = hand.flow.results()
    assert result.zeros[0] == pytest.approx((155 if zero == "typed" else 110) * deg)


@pytest.mark.parametrize("taken", [True, False])
def test_a_round_zero_is_offered(taken: bool) -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    calibrate(hand, key(1), 60.0, 240.0, 148.6)
    hand.flow.confirm()
    assert hand.flow.asks
    assert "its zero is at 148.6° of the servo, 150.0° is near. Take 150.0° (y), or 148.6° (n)?" in hand.flow.prompt
    hand.flow.answer(taken)
    assert hand.flow.results()[0].zeros[0] == pytest.approx((150 if taken else 148.6) * deg)


def test_the_zero_is_never_the_middle_of_the_sweep_and_has_to_lie_in_it() -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    calibrate(hand, key(1), 60.0, 240.0, 250.0)
    hand.flow.confirm()
    assert hand.messages[-1] != "shoulder is calibrated"
    assert hand.flow.joints["shoulder"].step is Step.SWEEP
    assert "outside of what it was swept over" in hand.flow.message
    assert not hand.flow.results()


def test_a_sweep_through_the_dead_zone_is_refused_with_the_remedy() -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    one = key(1)
    calibrate(hand, one, 200.0, 380.0, 300.0)
    assert hand.flow.over
    assert not hand.flow.changes()
    why = hand.flow.failures["shoulder"]
    assert "reaches into the dead zone of the RX-28, beyond 0.0° .. 300.0°, where it is blind" in why
    assert "put it on again so that the middle of the travel lies near 150.0° of the servo" in why


def test_a_jump_over_the_dead_zone_between_two_readings_is_seen() -> None:
    hand = hand_for(file_of("grip", model="lx16a"), ["grip"], lx)
    one = key(1, "lx16a")
    hand.shafts[one] = 200.0
    hand.rest()
    hand.turn({one: 220})
    hand.rest()
    hand.turn({one: 240})
    hand.turn({one: 220})
    hand.turn({one: 330})
    why = hand.flow.failures["grip"]
    assert "crosses the dead zone of the LX-16A, 120.0° beyond 0.0° .. 240.0°" in why
    assert "what it reads jumps from 2" in why


def test_the_seam_of_a_full_turn_is_named() -> None:
    hand = hand_for(file_of("base", model="mx28at"), ["base"], mx)
    calibrate(hand, key(1, "mx28at"), 100.0, 400.0, 150.0)
    why = hand.flow.failures["base"]
    assert "crosses the seam of the MX-28 (what it reads jumps from 35" in why
    assert "the middle of the travel lies near 180.0° of the servo" in why


def test_what_is_swept_beyond_what_a_servo_can_be_sent_to_is_told() -> None:
    hand = hand_for(file_of("grip", model="lx16a"), ["grip"], lx)
    calibrate(hand, key(1, "lx16a"), -20.0, 200.0, 100.0)
    hand.flow.confirm()
    (result,) = hand.flow.results()
    assert result.travel[0] == pytest.approx(-120 * deg)
    assert result.limits == pytest.approx((-100 * deg, 98 * deg))
    assert "goes beyond what the LX-16A can be sent to" in result.notes[0]


def test_swapped_ids_are_exchanged_and_both_joints_are_done() -> None:
    file = file_of("shoulder", "elbow")
    hand = hand_for(file, ["shoulder", "elbow"], rx28)
    hand.rest()
    hand.turn({key(2): 170})
    assert hand.flow.prompt == (
        "SHOULDER: the servo of elbow turned. Was it shoulder that you moved (y), or elbow (n)?"
    )
    hand.flow.answer(False)
    calibrate(hand, key(2), 60.0, 240.0, 100.0)
    assert hand.flow.asks
    hand.flow.answer(True)
    calibrate_from_push(hand, key(2), 60.0, 240.0, 100.0)
    hand.flow.confirm()
    assert hand.flow.current is hand.flow.joints["elbow"]
    assert not hand.flow.changes()  # of two that have each other's servos both or none
    calibrate(hand, key(1), 50.0, 200.0, 100.0)
    hand.flow.confirm()
    assert hand.flow.over
    changes = hand.flow.changes()
    assert (changes["joint", "shoulder", "id"], changes["joint", "elbow", "id"]) == (2, 1)
    made = read_text(edited(file, changes))
    assert made.joints["elbow"].limits == pytest.approx((-48 * deg, 98 * deg))


def calibrate_from_push(hand: Hand, one: Key, low: float, high: float, zero: float) -> None:
    hand.rest()
    start = hand.shafts[one]
    hand.turn({one: start + 20})
    hand.turn({one: start})
    hand.visit({one: low}, {one: high}, {one: low}, {one: high}, {one: 150}, {one: zero})
    hand.rest()


def test_a_swap_with_a_joint_that_is_not_calibrated_is_told() -> None:
    hand = hand_for(file_of("shoulder", "elbow"), ["shoulder"], rx28)
    hand.rest()
    hand.turn({key(2): 170})
    hand.flow.answer(True)
    assert "calibrate both, `servobus robot calibrate FILE shoulder elbow`" in hand.flow.failures["shoulder"]


def test_two_servos_that_turn_together_are_one_joint() -> None:
    hand = hand_for(file_of("lift", "other", "third"), ["lift"], rx28)
    hand.rest()
    hand.turn({key(1): 170, key(2): 130})
    assert "LIFT: id 1 on a and id 2 on a turned together. Are they on one axis" in hand.flow.prompt
    hand.flow.answer(True)
    assert 'write [joint.lift.mirror] with port = "a", id = 2' in hand.flow.failures["lift"]


PAIR = "lift\n[joint.lift.mirror]\nid = 9\nzero = '300deg'\n"


def test_a_double_joint_learns_direction_and_zero_of_each_servo() -> None:
    file = file_of(PAIR)
    hand = hand_for(file, ["lift"], rx28)
    one, two = key(1), key(9)

    def at(angle: float) -> dict[Key, float]:
        return {one: angle, two: 290 - angle}

    hand.shafts.update(at(150))
    hand.rest()
    hand.turn(at(170))
    hand.rest()
    hand.turn(at(150))
    hand.turn(at(170))
    hand.visit(at(60), at(240), at(60), at(240), at(150), at(121))
    hand.rest()
    hand.flow.confirm()
    hand.flow.answer(True)  # 120° instead of 121°, and the other one goes along
    changes = hand.flow.changes()
    assert changes == {
        ("joint", "lift", "zero"): "120deg",
        ("joint", "lift", "direction"): -1,
        ("joint", "lift", "mirror", "zero"): "170deg",
        ("joint", "lift", "limits"): ["-118deg", "58deg"],
    }
    made = read_text(edited(file, changes)).joints["lift"]
    first, second = (servo.axis.to_joint(angle * deg) for servo, angle in zip(made.servos, (200, 90), strict=True))
    assert first == pytest.approx(second)


def test_a_servo_of_a_pair_that_stands_still_is_told() -> None:
    hand = hand_for(file_of(PAIR), ["lift"], rx28)
    hand.rest()
    hand.turn({key(1): 180})
    assert "id 1 on a turned alone, and id 9 on a did not" in hand.flow.failures["lift"]


def test_several_joints_that_move_are_no_finding() -> None:
    hand = hand_for(file_of("shoulder", "elbow"), ["shoulder"], rx28)
    hand.rest()
    hand.turn({key(1): 170, key(2): 160})
    assert hand.messages == ["several servos turned, not alike: move one joint alone"]
    assert hand.flow.joints["shoulder"].step is Step.FIND


def test_a_joint_that_is_not_read_for_a_while_begins_its_step_where_it_was() -> None:
    hand = hand_for(file_of("shoulder"), ["shoulder"], rx28)
    hand.rest()
    hand.lost.add(key(1))
    hand.turn({key(1): 250})
    assert step_of(hand, "shoulder") is Step.FIND
    hand.lost.clear()
    hand.tick()
    assert step_of(hand, "shoulder") is Step.PUSH


def test_redo_begins_one_joint_anew_and_leaves_the_others() -> None:
    hand = hand_for(file_of("shoulder", "elbow"), ["shoulder", "elbow"], rx28)
    calibrate(hand, key(1), 60.0, 240.0, 100.0)
    hand.flow.confirm()
    hand.rest()
    hand.turn({key(2): 170})
    hand.flow.redo()
    assert hand.flow.joints["elbow"].step is Step.FIND
    assert hand.flow.joints["shoulder"].step is Step.DONE


def test_a_travel_without_room_is_told() -> None:
    hand = hand_for(file_of("grip"), ["grip"], rx28, margin=100 * deg)
    calibrate(hand, key(1), 60.0, 240.0, 100.0)
    hand.flow.confirm()
    assert "a travel of 180.0° leaves no room for limits with a margin of 100.0°" in hand.flow.failures["grip"]


@given(
    low=st.floats(5, 120), span=st.floats(60, 170), positive=st.sampled_from([1, -1]), share=st.floats(0.1, 0.9),
    ratio=st.floats(0.5, 3),
)  # fmt: skip
def test_what_comes_out_fits_the_shafts_whatever_they_are(
    low: float, span: float, positive: int, share: float, ratio: float
) -> None:
    """The file that is written gives back the angles that the hand made, and its limits lie in what was swept."""
    file = file_of(f"j\nratio = {ratio!r}")
    hand = hand_for(file, ["j"], rx28)
    high, zero = low + span, low + share * span
    calibrate(hand, key(1), low, high, zero, positive=positive)
    hand.flow.confirm()
    if hand.flow.asks:
        hand.flow.answer(False)
    (result,) = hand.flow.results()
    made = read_text(edited(file, hand.flow.changes())).joints["j"]
    assert made.axis.to_joint(zero * deg) == pytest.approx(0, abs=1e-5)
    assert made.limits is not None
    ends = sorted((made.axis.to_joint(low * deg), made.axis.to_joint(high * deg)))
    assert ends[0] < made.limits[0] < ends[0] + 2.2 * deg
    assert ends[1] - 2.2 * deg < made.limits[1] < ends[1]
    assert result.directions == (positive,)


@given(st.lists(st.floats(-170, 170), min_size=1, max_size=60))
def test_a_track_follows_any_steps_below_half_a_turn(steps: list[float]) -> None:
    file = file_of("j", model="mx28at")
    track = Track(file.joints["j"].model)
    angle = 100.0
    track.add(angle * deg)
    for step in steps:
        angle += step
        track.add(angle % 360 * deg)
    assert track.angle == pytest.approx(angle * deg, abs=1e-6)


def test_ends_that_are_touched_from_one_side_only_are_not_complete() -> None:
    ends = Ends(1 * deg)
    for angle in (0, 50, 100, 50, 100, 50, 100, 50):
        ends.add(angle * deg)
    assert ends.touched == (0, 3)
    assert not ends.complete


def test_the_six_joint_arm_is_taken_as_a_whole() -> None:
    file = read_text(SIX)
    flow = Calibration(file, list(file.joints))
    assert flow.current is flow.joints["base"]
    assert not flow.over
