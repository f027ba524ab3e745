"""What the families share works the same for all: moves, turns, ids and backups, on virtual time."""

import asyncio

import pytest

import servobus
from samples import can_turn, every_model, models_that, slack, turning
from servobus import (
    MODELS,
    BadValue,
    NoReply,
    TorqueOff,
    UsageError,
    deg,
)
from servobus.jobs.backup import Backup


class Found:
    def servo(self, key: str) -> servobus.BusServo:
        return servobus.open(f"virtual:{key}@5?clock=virtual", models=key).find(5, family=MODELS[key].family)


@models_that(can_turn)
class TestTurning(Found):
    """Endless turn, of all models that can."""

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


@models_that(lambda model: not can_turn(model))
class TestNotTurning(Found):
    def test_a_model_that_cannot_turn_says_so_and_keeps_its_limits(self, key: str) -> None:
        servo = self.servo(key)
        before = servo.read_raw(["min_position", "max_position"])
        servo.torque_on()
        for how in ({"speed": 1.0}, {"output": 0.3}, {}):
            with pytest.raises(UsageError, match="cannot turn without end"):
                servo.turn(**how)
        assert servo.read_raw(["min_position", "max_position"]) == before


@every_model
class TestEveryModel(Found):
    """What the families share works the same for all."""

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
            assert port.now() - begin == pytest.approx(1.0, abs=0.3)  # what lags behind its set point comes later
            assert servo.look().position == pytest.approx(start + 45 * deg, abs=slack(servo.model))
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

    def test_change_id(self, key: str) -> None:
        servo = self.servo(key)
        servo.change_id(6)
        servo.ping()
        assert servo._bus[6] is servo
        with pytest.raises(NoReply):
            servo._bus.do(servo.family.ping(5))

    def test_change_id_to_one_that_is_taken_is_refused(self, key: str) -> None:
        with servobus.open(f"virtual:{key}@5,6?clock=virtual", models=key) as bus:
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
            async with servobus.open_async(f"virtual:{key}@5?clock=virtual", models=key) as bus:
                servo = await bus.find(5, family=MODELS[key].family)
                start = (await servo.look()).position
                async with servo.torque():
                    await servo.move(start + 20 * deg, time=0.5).wait()
                assert (await bus.read_all("present_position"))[5] == pytest.approx(
                    start + 20 * deg, abs=slack(MODELS[key])
                )

        asyncio.run(main())
