"""What a servo is: what it says itself, what it was attached as, what `models` says, and what is guessed."""

from collections.abc import Iterator

import pytest

import servobus
from servobus import LX16A, RX28, BadValue, UnknownName, UsageError, deg
from servobus.families import registry
from servobus.families.lewansoul.models.table import UnknownLx
from servobus.jobs.scan import Models
from unit.cli.test_model import AX912, LX924

SPEC = "virtual:lx16a@1,2,rx28@1?clock=virtual"


@pytest.fixture(autouse=True)
def more_models() -> Iterator[None]:
    """Let the registry know two models more."""
    registry.add(LX924, AX912)
    yield
    for model in (LX924, AX912):
        del registry.MODELS.entries[model.key()]


@pytest.mark.parametrize(
    ("models", "expected"),
    [
        (None, [UnknownLx, UnknownLx, RX28]),
        ("lx924", [LX924, LX924, RX28]),
        (LX924, [LX924, LX924, RX28]),
        ({1: "lx924"}, [LX924, UnknownLx, RX28]),
        ({1: "lx16a", 2: LX924, 7: "rx28"}, [LX16A, LX924, RX28]),
        ("ax912", [UnknownLx, UnknownLx, RX28]),  # an RX-28 says that it is one
    ],
)
def test_what_cannot_say_it_is_what_it_is_said_to_be(models: Models | None, expected: list[type]) -> None:
    with servobus.open(SPEC, models=models) as bus:
        found = bus.scan(ids=range(4))
        assert [servo.model for servo in sorted(found, key=lambda one: (one.baud != 115_200, one.id))] == expected
        assert bus.find(2, family="lewansoul").model is expected[1]


def test_models_are_checked_before_the_port_is_opened() -> None:
    with pytest.raises(UnknownName, match="no model 'lx999'"):
        servobus.open("/dev/nowhere", models="lx999")
    with pytest.raises(UnknownName, match="no model 'lx999'"):
        servobus.open("/dev/nowhere", models={1: "lx999"})
    with pytest.raises(BadValue, match="id 254"):
        servobus.open_async("/dev/nowhere", models={254: "lx16a"})


def test_attach_wins_over_guesses_and_the_object_stays() -> None:
    with servobus.open(SPEC) as bus:
        mine = bus.attach(LX924, 1)
        found = bus.scan(family="lewansoul", ids=range(3))
        assert found[0] is mine
        assert [servo.model for servo in found] == [LX924, UnknownLx]
        assert bus.survey.conflicts == []
        assert mine.state is not None
        mine.torque_on()
        bus.make_safe()
        assert not mine.permit.driven  # the object in hand is the one that a safe stop touches


def test_attach_wins_over_models() -> None:
    with servobus.open(SPEC, models="lx16a") as bus:
        assert bus.attach(LX924, 2) is bus.find(2, family="lewansoul")
        assert bus.find(2, family="lewansoul").model is LX924


def test_a_servo_that_says_something_else_is_told_of_and_stays() -> None:
    with servobus.open("virtual:ax912@1?clock=virtual") as bus:
        mine = bus.attach(RX28, 1, baud=1_000_000)
        (found,) = bus.scan(ids=range(3))
        assert found is mine
        assert mine.model is RX28
        assert mine.state is None  # it was not looked at as what it is not
        (conflict,) = bus.survey.conflicts
        assert str(conflict) == (
            "id 1 at 1000000 baud was attached as RX-28 and says that it is AX-912; "
            "it stays RX-28 until it is attached anew"
        )
        anew = bus.attach(AX912, 1)
        assert bus.scan(ids=range(3)) == [anew]
        assert bus.survey.conflicts == []


def test_a_number_that_nobody_knows() -> None:
    with servobus.open("virtual:ax912@1?clock=virtual") as bus:
        bus.transport.servos[0].memory[AX912.model_number] = 4242  # type: ignore[attr-defined] # a virtual port
        (found,) = bus.scan(ids=[1])
        assert str(found).startswith("Dynamixel servo, model 4242, id 1 at 1000000: position 511 (raw), 11.1 V, 25 °C")
        with pytest.raises(UsageError, match=r"model 4242, id 1 cannot be moved .*--model"):
            found.move(0.1)
        bus.models = "ax912"
        assert bus.find(1).model is AX912


def test_a_model_of_thirty_lines_is_all_there() -> None:
    with servobus.open("virtual:ax912@1,2?clock=virtual") as bus:
        one, two = bus.scan(ids=range(4))
        assert str(one).startswith("AX-912 id 1 at 1000000: 149.9°, 11.1 V")
        with one.torque(), two.torque():
            bus.move({one: 60 * deg, two: 240 * deg}, speed=60 * deg).wait()
            assert one.read(RX28.present_position) == pytest.approx(60 * deg, abs=2 * deg)
        assert one.read(AX912.max_temperature) == 70
        one.change_baud(57_600)
        one.change_id(5)
        one.reset()
        assert (one.id, one.baud) == (1, 1_000_000)
        saved = two.backup()
        with pytest.raises(UsageError, match="RX-28"):
            two.restore(servobus.Backup(RX28, "", 2, 57_600, saved.values))


def test_a_speed_that_was_assumed_goes_with_the_model() -> None:
    with servobus.open("virtual:ax912@1?clock=virtual") as bus:
        assert bus.attach(RX28, 1).baud == 57_600
        servo = bus.attach(AX912, 1)
        assert servo.baud == 1_000_000
        servo.ping()
        assert bus.attach(RX28, 1, baud=1_000_000).model is RX28
