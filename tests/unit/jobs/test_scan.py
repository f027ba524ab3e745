"""Scans of virtual servos: who is found, what is told, and that nothing is changed by it."""

import pytest

import servobus
from servobus import DRS0602, RX28, NoReply
from servobus.families.registry import GENERIC
from servobus.jobs.scan import ScanProgress

MIXED = "virtual:rx28@1-3,drs0602@219,lx16a@7,8?clock=virtual"


def test_finds_all_families_and_says_where() -> None:
    with servobus.open(MIXED) as bus:
        found = {(servo.model, servo.id, servo.baud) for servo in bus.scan()}
        unknown = GENERIC["lewansoul"]
        assert found == {
            (RX28, 1, 57_600),
            (RX28, 2, 57_600),
            (RX28, 3, 57_600),
            (DRS0602, 219, 115_200),
            (unknown, 7, 115_200),
            (unknown, 8, 115_200),
        }
        assert bus.survey.troubles == []


def test_prints_as_people_read() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        (servo,) = bus.scan(family="dynamixel", ids=range(3))
        assert str(servo) == "RX-28 id 1 at 57600: 149.9°, 14.4 V, 25 °C, torque off"


def test_tells_how_far_it_is() -> None:
    seen: list[ScanProgress] = []
    with servobus.open("virtual:lx16a@2?clock=virtual") as bus:
        bus.scan(family="lewansoul", ids=range(4), watch=seen.append)
    assert [(step.done, step.total, step.id, step.found is not None) for step in seen] == [
        (1, 4, 0, False),
        (2, 4, 1, False),
        (3, 4, 2, True),
        (4, 4, 3, False),
    ]


def test_two_servos_with_one_id_and_different_answers_are_trouble() -> None:
    with servobus.open("virtual:rx28@1,1?clock=virtual") as bus:
        servos = bus.transport.servos  # type: ignore[attr-defined] # the virtual port shows its servos
        servos[1].voltage = 5.0  # its answers now differ: a voltage error
        assert bus.scan(family="dynamixel", ids=[1]) == []
        (trouble,) = bus.survey.troubles
        assert trouble.id == 1


def test_servo_that_answers_only_ping_is_found() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        bus.attach(RX28, 1).write(RX28.status_return_level, 0)
        (servo,) = bus.scan(family="dynamixel", ids=[1])
        assert servo.state is None


def test_moves_nothing_and_changes_nothing() -> None:
    with servobus.open(MIXED) as bus:
        servos = bus.transport.servos  # type: ignore[attr-defined]
        before = [(servo.memory.stored(), servo.position, servo.torque) for servo in servos]
        bus.scan()
        servos = bus.transport.servos  # type: ignore[attr-defined]
        assert [(servo.memory.stored(), servo.position, servo.torque) for servo in servos] == before


def test_nobody_there_names_what_was_tried() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus, pytest.raises(NoReply, match=r"dynamixel at 57600"):
        bus.find(9, family="dynamixel")
