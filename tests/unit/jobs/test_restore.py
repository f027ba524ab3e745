"""Restoring: nothing moves, and what a servo held can be restored to it."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import pytest

import extent
from samples import SAMPLE_KEYS, one_model_of_each_family, sample_models, turning, widest_range
from servobus import DRS0602, LX16A, MODELS, RX28, Backup, NoReply, NotRestored, UsageError
from servobus.families.base import Model
from servobus.jobs.backup import settings
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC, Bench


def edited(saved: Backup, values: Mapping[str, int]) -> Backup:
    return Backup(saved.model, saved.firmware, saved.id, saved.baud, {**saved.values, **values})


def restore(backup: Backup, servo: Any) -> Any:
    return servo.restore(backup)


def saved(bench: Bench) -> Backup:
    """Give a backup as a file gives it back."""
    backup: Backup = bench.do(lambda servo: servo.backup())
    return Backup.parse(backup.text())


def others(model: type[Model]) -> dict[str, dict[str, int]]:
    """Give backups that would move a servo that holds: what is other in them, by what it is."""
    low, high = model.register("min_position").name, model.register("max_position").name
    first, last = widest_range(model)
    far = {low: first + (last - first) // 10, high: first + (last - first) // 5}
    found = {"limits elsewhere": far}
    if model is RX28:
        found["endless turn"] = {low: 0, high: 0}
    shift = model.optional("calibration")
    if shift is not None:
        found["zero"] = {shift.name: shift.limits[1] // 2}
    if model is DRS0602:
        found["gains"] = {"position_kp": 7, "position_ki": 3000, "min_pwm": 200, "pwm_offset": 90, "max_pwm": 100}
    return found


CASES = [(key, name) for key in SAMPLE_KEYS for name in others(MODELS[key])]


@DRIVERS
@pytest.mark.parametrize(("key", "name"), CASES)
@pytest.mark.parametrize("state", ["on", "off", "turning", "turning off"])
def test_N4_restore_moves_nothing(key: str, name: str, state: str, driver: str) -> None:
    """With the torque on it is refused, and nothing is written; with torque_off the shaft stays as well."""
    model = MODELS[key]
    if state.startswith("turning") and not model.turns:
        return
    bench = Bench(key, driver)
    backup = edited(saved(bench), others(model)[name])
    bench.do(lambda servo: servo.torque_on())
    if state.startswith("turning"):
        bench.do(lambda servo: servo.turn(**turning(model)))
        bench.do(lambda servo: servo.stop())
    if state.endswith("off"):
        bench.do(lambda servo: servo.torque_off())
    bench.line.sleep(1.0)
    before, shaft = bench.real.memory.stored(), bench.real.position
    if all(before[row] == raw for row, raw in others(model)[name].items()):
        return  # it turns, so its limits are these already
    if not state.endswith("off"):
        with pytest.raises(UsageError, match=r"its torque is on, .* torque_off=True; nothing was written"):
            bench.do(lambda servo: servo.restore(backup))
        bench.line.sleep(1.0)
        assert bench.real.memory.stored() == before
        assert bench.real.position == pytest.approx(shaft, abs=1e-9)
    changed = bench.do(lambda servo: servo.restore(backup, torque_off=True))
    assert changed == [row.name for row in settings(model) if before[row.name] != backup.values[row.name]]
    bench.line.sleep(1.0)
    assert bench.real.position == pytest.approx(shaft, abs=1e-9)
    kept = bench.real.memory.stored()
    assert all(kept[row] == backup.values[row] for row in changed)
    assert not bench.real.torque
    assert not bench.servo.permit.driven


@sample_models
def test_N4_nothing_to_write_leaves_the_torque_on(key: str) -> None:
    bench = Bench(key, SYNC)
    backup = saved(bench)
    bench.do(lambda servo: servo.torque_on())
    assert bench.do(lambda servo: servo.restore(backup)) == []
    assert bench.do(lambda servo: servo.restore(backup, torque_off=True)) == []
    assert bench.real.torque


def test_N4_a_torque_that_would_come_back_does_not() -> None:
    """An LX-16A is limp while it is too hot, and a higher limit would wake it (point 16): it goes off for good."""
    bench = Bench("lx16a", SYNC)
    backup = edited(saved(bench), {"max_temperature": 100})
    bench.do(lambda servo: servo.torque_on())
    bench.real.temperature = 90.0
    bench.line.sleep(0.1)
    assert not bench.do(lambda servo: servo.look()).torque
    assert bench.do(lambda servo: servo.restore(backup)) == ["max_temperature"]
    bench.line.sleep(1.0)
    assert not bench.real.torque


@DRIVERS
def test_T4_what_an_lx16a_held_can_be_restored_to_it(driver: str) -> None:
    """HV types have 14 V set; such a value is in the backup, unchanged it is skipped, on another servo it is named."""
    bench = Bench("lx16a", driver)
    bench.real.memory.store(LX16A.max_voltage, 14_000)
    backup = saved(bench)
    assert backup.values["max_voltage"] == 14_000
    assert "max_voltage = 14000" in backup.text()
    assert "# 14.0 V, not in 4.5 V (raw 4500) .. 12.0 V (raw 12000): " in backup.text()
    assert bench.do(lambda servo: servo.restore(backup)) == []
    bench.do(lambda servo: servo.store({LX16A.max_temperature: 60.0}))
    assert bench.do(lambda servo: servo.restore(backup)) == ["max_temperature"]
    other = Bench("lx16a", driver)
    other.real.memory.store(LX16A.max_temperature, 60)
    with pytest.raises(NotRestored, match=r"restored max_temperature; not restored: max_voltage = 14\.0 V") as caught:
        other.do(lambda servo: servo.restore(backup))
    assert caught.value.restored == ["max_temperature"]
    assert list(caught.value.failed) == ["max_voltage"]
    assert "is not in 4.5 V" in caught.value.failed["max_voltage"]
    assert (other.stored("max_temperature"), other.stored("max_voltage")) == (85, 12_000)


@DRIVERS
def test_T4_an_angle_limit_without_meaning_is_kept_skipped_and_named(driver: str) -> None:
    """AX-12 have been seen with ccw_angle_limit FFFF."""
    bench = Bench("rx28", driver)
    bench.real.memory.store(RX28.ccw_angle_limit, 0xFFFF)
    backup = saved(bench)
    assert backup.values["ccw_angle_limit"] == 0xFFFF
    bench.do(lambda servo: servo.store({RX28.max_torque: 0.5}))
    assert bench.do(lambda servo: servo.restore(backup)) == ["max_torque"]
    assert bench.stored("ccw_angle_limit") == 0xFFFF
    bench.real.memory.store(RX28.ccw_angle_limit, 1023)
    bench.do(lambda servo: servo.store({RX28.max_torque: 0.5}))
    with pytest.raises(NotRestored, match=r"restored max_torque; not restored: ccw_angle_limit = .*is not in 0\.0°"):
        bench.do(lambda servo: servo.restore(backup))
    assert (bench.stored("max_torque"), bench.stored("ccw_angle_limit")) == (1023, 1023)


@sample_models
def test_T4_whatever_a_servo_holds_is_restored_to_it(key: str) -> None:
    """Any value that the bytes of any one setting can hold: unchanged it is no hindrance to the others."""
    model = MODELS[key]
    limit = model.register("max_temperature")
    for row in settings(model):
        kept = model.register("id"), model.optional("baud"), model.optional("answer_level"), limit
        if row in kept or row.name.startswith("reserved"):  # what is reserved has no value to keep
            continue
        bench = Bench(key, SYNC)
        low, high = row.layout.range
        for raw in (low, high):
            if row.accepts(raw):
                continue
            if row.place.has_working_copy:
                bench.real.memory.eeprom[row] = raw
            else:
                bench.real.memory.store(row, raw)
            backup = saved(bench)
            assert backup.values[row.name] == raw
            bench.real.memory.store(limit, limit.limits[0] + 20)
            assert bench.do(partial(restore, backup)) == [limit.name], (row, raw)
            bench.line.sleep(0.01)
            assert bench.stored(row.name) == raw


@sample_models
@pytest.mark.parametrize("pair", [("min_position", "max_position"), ("min_voltage", "max_voltage")])
def test_T4_crossed_limits_of_a_backup_are_named_and_the_rest_is_restored(key: str, pair: tuple[str, str]) -> None:
    bench = Bench(key, SYNC)
    model = MODELS[key]
    low, high = model.register(pair[0]), model.register(pair[1])
    hot = model.register("max_temperature")
    crossed = {low.name: (low.default or 0) + 60, high.name: (low.default or 0) + 50, hot.name: hot.limits[0] + 5}
    before = bench.real.memory.stored()
    backup = edited(saved(bench), crossed)
    with pytest.raises(NotRestored, match="would not be below") as caught:
        bench.do(lambda servo: servo.restore(backup))
    assert set(caught.value.failed) == {low.name, high.name}
    bench.line.sleep(0.01)
    assert bench.real.memory.stored() == before | {hot.name: hot.limits[0] + 5}


@one_model_of_each_family
def test_T4_a_value_that_the_servo_does_not_take_is_named_and_the_rest_is_restored(key: str) -> None:
    """The servo minds one value of several that go out in one packet: all others are there in the end."""
    bench = Bench(key, SYNC)
    model = MODELS[key]
    low, high = model.register("min_voltage"), model.register("max_voltage")
    hot = model.register("max_temperature")
    changes = {low.name: (low.default or 0) + 1, high.name: (high.default or 0) - 1, hot.name: hot.limits[0] + 5}
    backup = edited(saved(bench), changes)
    real, line = bench.real.memory, bench.line
    stubborn = hot.default or 0

    def keep(_request: bytes) -> bool:
        real.store(hot, stubborn)
        return True

    line.on_request = keep
    with pytest.raises(NotRestored, match=f"not restored: {hot.name} = .*the servo did not take it") as caught:
        bench.do(lambda servo: servo.restore(backup))
    assert list(caught.value.failed) == [hot.name]
    assert caught.value.restored == [low.name, high.name]
    assert (bench.stored(low.name), bench.stored(high.name)) == (changes[low.name], changes[high.name])


@CHOSEN_DRIVERS
@sample_models
def test_T4_a_restore_that_breaks_off_is_taken_up_again(key: str, driver: str) -> None:
    """The line goes at each packet in turn, without `--all` at some; the same call once more makes it whole."""
    bench = Bench(key, driver)
    model = MODELS[key]
    hot, low = model.register("max_temperature"), model.register("min_position")
    backup = edited(saved(bench), {hot.name: hot.limits[0] + 5, low.name: (low.default or 0) + 30})
    bench.line.lose()
    assert set(bench.do(lambda servo: servo.restore(backup))) == {hot.name, low.name}
    for number in extent.spread(range(1, len(bench.line.requests) + 1), 12):
        bench = Bench(key, driver)
        left = number

        def cut(_request: bytes) -> bool:
            nonlocal left
            left -= 1
            return left > 0

        bench.line.on_request = cut
        with pytest.raises(NoReply):
            bench.do(lambda servo: servo.restore(backup))
        bench.line.on_request = None
        bench.line.sleep(1.0)
        bench.do(lambda servo: servo.restore(backup))
        bench.line.sleep(0.01)
        assert (bench.stored(hot.name), bench.stored(low.name)) == (hot.limits[0] + 5, (low.default or 0) + 30)


def test_a_backup_may_be_of_another_id_from_python() -> None:
    """It goes into a replacement; the command line asks."""
    bench = Bench("rx28", SYNC, id=6)
    backup = edited(saved(Bench("rx28", SYNC)), {"max_torque": 500})
    assert backup.id == 5
    assert bench.do(lambda servo: servo.restore(backup)) == ["max_torque"]
    assert bench.servo.id == 6
