"""Jobs of several steps, against virtual servos on virtual time."""

import asyncio

import pytest

import servobus
from samples import every_model, turning
from servobus import (
    DRS0602,
    LX16A,
    MODELS,
    RX28,
    BadValue,
    MoveTimeout,
    NoReply,
    Refused,
    TorqueOff,
    UnknownName,
    UsageError,
    deg,
    dynamixel1,
    herkulex,
    lewansoul,
)
from servobus.jobs.backup import Backup
from servobus.jobs.scan import ScanProgress

MIXED = "virtual:rx28@1-3,drs0602@219,lx16a@7,8?clock=virtual"


class TestScan:
    def test_finds_all_families_and_says_where(self) -> None:
        with servobus.open(MIXED) as bus:
            found = {(servo.model, servo.id, servo.baud) for servo in bus.scan()}
            assert found == {
                (RX28, 1, 57_600),
                (RX28, 2, 57_600),
                (RX28, 3, 57_600),
                (DRS0602, 219, 115_200),
                (LX16A, 7, 115_200),
                (LX16A, 8, 115_200),
            }
            assert bus.survey.troubles == []

    def test_prints_as_people_read(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus:
            (servo,) = bus.scan(family="dynamixel", ids=range(3))
            assert str(servo) == "RX-28 id 1 at 57600: 149.9°, 14.4 V, 25 °C, torque off"

    def test_tells_how_far_it_is(self) -> None:
        seen: list[ScanProgress] = []
        with servobus.open("virtual:lx16a@2?clock=virtual") as bus:
            bus.scan(family="lewansoul", ids=range(4), watch=seen.append)
        assert [(step.done, step.total, step.id, step.found is not None) for step in seen] == [
            (1, 4, 0, False),
            (2, 4, 1, False),
            (3, 4, 2, True),
            (4, 4, 3, False),
        ]

    def test_two_servos_with_one_id_and_different_answers_are_trouble(self) -> None:
        with servobus.open("virtual:rx28@1,1?clock=virtual") as bus:
            servos = bus.transport.servos  # type: ignore[attr-defined] # the virtual port shows its servos
            servos[1].voltage = 5.0  # its answers now differ: a voltage error
            assert bus.scan(family="dynamixel", ids=[1]) == []
            (trouble,) = bus.survey.troubles
            assert trouble.id == 1

    def test_servo_that_answers_only_ping_is_found(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus:
            bus.attach(RX28, 1).write(RX28.status_return_level, 0)
            (servo,) = bus.scan(family="dynamixel", ids=[1])
            assert servo.state is None

    def test_moves_nothing_and_changes_nothing(self) -> None:
        with servobus.open(MIXED) as bus:
            servos = bus.transport.servos  # type: ignore[attr-defined]
            before = [(servo.memory.stored(), servo.position, servo.torque) for servo in servos]
            bus.scan()
            servos = bus.transport.servos  # type: ignore[attr-defined]
            assert [(servo.memory.stored(), servo.position, servo.torque) for servo in servos] == before

    def test_nobody_there_names_what_was_tried(self) -> None:
        with servobus.open("virtual:rx28@1?clock=virtual") as bus, pytest.raises(NoReply, match=r"dynamixel at 57600"):
            bus.find(9, family="dynamixel")


@every_model
class TestEveryModel:
    """What the families share works the same for all."""

    def servo(self, key: str) -> servobus.BusServo:
        return servobus.open(f"virtual:{key}@5?clock=virtual").find(5, family=MODELS[key].family)

    def test_move_arrives_on_time(self, key: str) -> None:
        servo = self.servo(key)
        port = servo._bus.transport
        goal = 60 * deg
        with servo.torque():
            servo.move(goal, time=1.0).wait()
            start = servo.look().position
            begin = port.now()
            move = servo.move(start + 45 * deg, time=1.0)
            assert move.duration == pytest.approx(1.0)
            move.wait()
            assert port.now() - begin == pytest.approx(1.0, abs=0.15)
            assert servo.look().position == pytest.approx(start + 45 * deg, abs=1 * deg)
        assert servo.look().torque is False

    def test_torque_on_does_not_jump(self, key: str) -> None:
        servo = self.servo(key)
        before = servo.look().position
        with servo.torque():
            servo._bus.transport.sleep(1.0)
            assert servo.look().position == pytest.approx(before, abs=0.6 * deg)

    def test_move_without_torque_is_refused(self, key: str) -> None:
        with pytest.raises(TorqueOff):
            self.servo(key).move(10 * deg)

    def test_move_beyond_the_limits_set_in_the_servo_is_refused(self, key: str) -> None:
        servo = self.servo(key)
        model = servo.model
        here = servo.look().position
        servo.write_many(
            {model.register("min_position"): here - 10 * deg, model.register("max_position"): here + 10 * deg}
        )
        with servo.torque(), pytest.raises(BadValue, match="outside the limits set in it"):
            servo.move(here + 20 * deg)

    def test_stop_holds_where_it_is(self, key: str) -> None:
        servo = self.servo(key)
        port = servo._bus.transport
        start = servo.look().position
        with servo.torque():
            servo.move(start + 60 * deg, time=2.0)
            port.sleep(1.0)
            servo.stop()
            port.sleep(0.2)
            held = servo.look().position
            assert start + 5 * deg < held < start + 55 * deg
            port.sleep(1.0)
            assert servo.look().position == pytest.approx(held, abs=0.6 * deg)

    def test_turn_and_back_to_position_mode(self, key: str) -> None:
        servo = self.servo(key)
        port = servo._bus.transport
        with servo.torque():
            servo.turn(**turning(servo.model))
            port.sleep(0.5)
            with pytest.raises(UsageError, match="turns without end"):
                servo.move(90 * deg)
            servo.stop()
            port.sleep(0.5)
            shaft = port.servos[0].position  # type: ignore[attr-defined]
            servo.position_mode()
            port.sleep(0.5)
            assert port.servos[0].position == pytest.approx(shaft, abs=1 * deg)  # type: ignore[attr-defined]

    def test_turn_names_what_the_model_can(self, key: str) -> None:
        servo = self.servo(key)
        with pytest.raises(UsageError, match=r"give (speed|output)"):
            servo.turn(output=0.5) if "speed" in turning(servo.model) else servo.turn(speed=1.0)

    def test_change_id(self, key: str) -> None:
        servo = self.servo(key)
        servo.change_id(6)
        servo.ping()
        assert servo._bus[6] is servo
        with pytest.raises(NoReply):
            servo._bus.do(servo.family.ping(5))

    def test_change_id_to_one_that_is_taken_is_refused(self, key: str) -> None:
        with servobus.open(f"virtual:{key}@5,6?clock=virtual") as bus:
            servo = bus.find(5, family=MODELS[key].family)
            with pytest.raises(UsageError, match="id 6 is not free"):
                servo.change_id(6)
            servo.ping()

    def test_backup_is_readable_and_restores(self, key: str) -> None:
        servo = self.servo(key)
        model = servo.model
        limit = model.register("max_position")
        saved = servo.backup()
        again = Backup.parse(saved.text())
        assert again == saved
        assert f'model = "{key}"' in saved.text()
        servo.store({limit: limit.decode(saved.values[limit.name]) - 20 * deg})
        assert servo.restore(again) == [limit.name]
        assert servo.backup() == saved
        assert servo.restore(again) == []

    def test_backup_of_another_model_is_refused(self, key: str) -> None:
        servo = self.servo(key)
        other = next(model for model in MODELS.values() if model is not servo.model)
        with pytest.raises(UsageError, match="another model; nothing was written"):
            servo.restore(Backup(other, "", 1, 1, {}))

    def test_async_twin(self, key: str) -> None:
        async def main() -> None:
            async with servobus.open_async(f"virtual:{key}@5?clock=virtual") as bus:
                servo = await bus.find(5, family=MODELS[key].family)
                start = (await servo.look()).position
                async with servo.torque():
                    await servo.move(start + 20 * deg, time=0.5).wait()
                assert (await bus.read_all("present_position"))[5] == pytest.approx(start + 20 * deg, abs=1 * deg)

        asyncio.run(main())


def test_damaged_backups_are_refused() -> None:
    for text in ("", "model = 3", 'model = "rx28"', "not toml at all ["):
        with pytest.raises(UsageError, match="not a backup file"):
            Backup.parse(text)
    text = 'model = "rx28"\nfirmware = "8"\nid = 1\nbaud = 57600\n[settings]\nmax_torque = 2000\n'
    with pytest.raises(UsageError, match="damaged"):
        Backup.parse(text)


def test_change_baud_of_an_rx28() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        servo.change_baud(1_000_000)
        assert servo.read(RX28.baud) == 1_000_000
        assert bus.transport.baud == 1_000_000


def test_change_baud_of_a_drs0602() -> None:
    with servobus.open("virtual:drs0602@1?clock=virtual") as bus:
        servo = bus.find(1, family="herkulex")
        servo.change_baud(500_000)
        assert servo.read(DRS0602.baud) == 500_000
        assert bus.transport.baud == 500_000


def test_the_lx16a_has_one_speed() -> None:
    with servobus.open("virtual:lx16a@1?clock=virtual") as bus, pytest.raises(UsageError, match="115200"):
        bus.find(1, family="lewansoul").change_baud(9600)


def test_reset_of_an_rx28() -> None:
    with servobus.open("virtual:rx28@9?clock=virtual") as bus:
        servo = bus.find(9, family="dynamixel")
        servo.write(RX28.highest_limit_temperature, 50)
        servo.reset()
        assert servo.id == 1
        assert servo.read(RX28.highest_limit_temperature) == 80


def test_reset_of_a_drs0602_keeps_what_is_named() -> None:
    with servobus.open("virtual:drs0602@9?clock=virtual") as bus:
        servo = bus.find(9, family="herkulex")
        servo.store({DRS0602.max_temperature: 60.0})
        servo.reset(keep=frozenset({"id"}))
        assert servo.id == 9
        assert servo.read(DRS0602.max_temperature) == 80.0
        servo.reset()
        assert servo.id == 219


def test_group_moves_start_and_arrive_together() -> None:
    with servobus.open(MIXED) as bus:
        bus.scan()
        start = bus.read_all("present_position")
        goals = {servo: position + (10 + servo.id % 5) * deg for servo, position in start.items()}
        with bus.torque():
            bus.move(goals, time=1.0).wait()
            for servo, position in bus.read_all("present_position").items():
                assert position == pytest.approx(goals[servo], abs=1 * deg)


def test_a_servo_that_cannot_arrive_is_named() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        with servo.torque():
            move = servo.move(10 * deg, time=2.0)
            servo.write(RX28.torque_limit, 0.0)  # free run: it will not go on
            with pytest.raises(MoveTimeout, match="RX-28 id 1 is at"):
                move.wait()


def test_native_operations_are_values_too() -> None:
    with servobus.open("virtual:rx28@1-2?clock=virtual") as bus:
        bus.do(dynamixel1.reg_write(1, 25, b"\x01"), baud=57_600)
        bus.do(dynamixel1.reg_write(2, 25, b"\x01"))
        bus.do(dynamixel1.action())
        assert bus.do(dynamixel1.read_data(1, 25, 1)) == b"\x01"
        with pytest.raises(Refused):
            bus.do(dynamixel1.action(1))
    with servobus.open("virtual:drs0602@219?clock=virtual") as bus:
        assert bus.do(herkulex.stat(219)).status_error == herkulex.StatusError(0)
    with servobus.open("virtual:lx16a@1?clock=virtual") as bus:
        assert bus.do(lewansoul.query(1, lewansoul.Command.SERVO_ID_READ)) == (1,)


def test_a_speed_where_the_id_is_taken_is_refused() -> None:
    with servobus.open("virtual:rx28@1,2?clock=virtual") as bus:
        one, two = bus.scan(family="dynamixel", ids=[1, 2])
        two.change_baud(1_000_000)
        two.change_id(1)  # not the same speed: nobody is in the way
        with pytest.raises(UsageError, match="another servo answers to id 1 at 57600"):
            two.change_baud(57_600)
        two.ping()
        one.ping()


def test_a_reset_that_would_make_twins_is_refused() -> None:
    with servobus.open("virtual:rx28@1,2?clock=virtual") as bus:
        one, two = bus.scan(family="dynamixel", ids=[1, 2])
        two.change_baud(1_000_000)
        with pytest.raises(UsageError, match="would get id 1 at 57600 baud"):
            two.reset()
        two.ping()
        one.ping()


def test_position_mode_sets_limits_that_are_given() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        servo.position_mode((20 * deg, 120 * deg))
        with servo.torque(), pytest.raises(BadValue, match="outside the limits set in it"):
            servo.move(10 * deg)


def test_a_name_or_an_alias_stands_for_a_register() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        assert servo.read("present_position") == servo.read(RX28.present_position)
        assert servo.read_raw(["present_position", RX28.moving]) == servo.read_raw([RX28.present_position, "moving"])
        servo.write("led", True)
        servo.write_many({"max_temperature": 70.0, RX28.punch: 0.1})
        servo.write_raw({"highest_limit_temperature": 71})
        servo.store({"max_temperature": 72.0})
        seen = servo.read_many(["led", "max_temperature", RX28.punch])
        assert seen == {"led": True, "highest_limit_temperature": 72.0, "punch": pytest.approx(0.1, abs=0.001)}


def test_a_name_that_is_none_sends_nothing() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.attach(RX28, 1)
        with pytest.raises(UnknownName, match="RX-28 has no register 'present_positon'; did you mean present_position"):
            servo.read("present_positon")
        with pytest.raises(
            UsageError, match=r"36 is no register: give one such as RX28\.present_position, or its name"
        ):
            servo.read(36)  # type: ignore[arg-type] # what a reader of the manual tries
        with pytest.raises(UsageError, match="highest_limit_temperature is given twice"):
            servo.write_many({"max_temperature": 70.0, RX28.highest_limit_temperature: 71.0})
        assert bus.stats.total.sent == 0
