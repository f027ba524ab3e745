"""A servo is a family, an id and a speed: what is known of one is never that of another on the same line."""

import pytest

import servobus
from servobus import DRS0602, RX28, UnknownName
from servobus.jobs.scan import ScanProgress
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort


def servos_of(bus: servobus.Bus) -> list[VirtualServo]:
    assert isinstance(bus.transport, VirtualPort)
    return list(bus.transport.servos)


class TestAlarms:
    def test_an_answer_of_the_other_family_does_not_hide_that_an_alarm_is_over(self) -> None:
        with servobus.open("virtual:rx28@1,drs0602@1?clock=virtual") as bus:
            (rx,) = bus.scan(ids=[1], family="dynamixel")
            (hx,) = bus.scan(ids=[1], family="herkulex")
            hot = servos_of(bus)[0]
            hot.temperature = 95.0
            rx.read(RX28.present_temperature)
            assert rx.alarms
            hx.read(DRS0602.temperature)
            assert rx.alarms
            assert not hx.alarms
            hot.temperature = 25.0
            rx.read(RX28.present_temperature)
            assert not rx.alarms

    def test_an_alarm_that_ended_while_the_port_was_away_is_over(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus:
            (servo,) = bus.scan(ids=[1])
            (device,) = servos_of(bus)
            device.temperature = 95.0
            servo.read(RX28.present_temperature)
            assert servo.alarms
            device.temperature = 25.0
            bus.reopen()
            servo.read(RX28.present_temperature)
            assert not servo.alarms

    def test_an_alarm_that_a_scan_saw_is_over_with_the_next_good_answer(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus:
            (device,) = servos_of(bus)
            device.temperature = 95.0
            (servo,) = bus.scan(ids=[1])
            assert servo.alarms
            device.temperature = 25.0
            servo.read(RX28.present_temperature)
            assert not servo.alarms


class TestCounters:
    def test_they_are_kept_apart(self) -> None:
        with servobus.open("virtual:rx28@1,drs0602@1?clock=virtual") as bus:
            (rx,) = bus.scan(ids=[1], family="dynamixel")
            (hx,) = bus.scan(ids=[1], family="herkulex")
            before = bus.stats["dynamixel", 1, rx.baud].received
            hx.read(DRS0602.temperature)
            assert bus.stats["dynamixel", 1, rx.baud].received == before
            with pytest.raises(UnknownName, match="id 1 is not unique here"):
                bus.stats[1]
            assert f"herkulex 1 at {hx.baud}" in str(bus.stats)

    def test_after_a_scan_of_all_families_an_id_is_that_of_the_servo_there(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus:
            (servo,) = bus.scan(ids=[1, 2])
            assert bus.stats[1] is bus.stats["dynamixel", 1, servo.baud]
            assert bus.stats[2].received == 0


class TestSpeed:
    """The speed belongs to the job: what else uses the line meanwhile cannot derail it."""

    def test_a_scan_whose_watcher_reads_a_servo_at_another_speed_finds_the_same(self) -> None:
        with servobus.open("virtual:rx28@1,2,3,40?clock=virtual") as bus:
            servos_of(bus)[3].store_baud(1_000_000)
            (far,) = bus.scan(bauds=[1_000_000], ids=[40], family="dynamixel")
            seen = []

            def watch(progress: ScanProgress) -> None:
                if progress.id % 7 == 1:
                    seen.append(far.read(RX28.present_position))

            found = bus.scan(bauds=[57_600], ids=range(1, 60), family="dynamixel", watch=watch)
            assert [(servo.id, servo.baud) for servo in found] == [(1, 57_600), (2, 57_600), (3, 57_600)]
            assert len(seen) == 9
            assert far.baud == 1_000_000
