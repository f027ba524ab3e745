"""Servos that hear nothing for a while, after a write to their EEPROM or a restart: the driver asks until they do."""

import time

import pytest

from samples import can_change_baud, can_reset, models_that, other_bauds, sample_models
from servobus import DRS0602, MODELS, NoReply
from servobus.jobs.backup import Backup
from servobus.virtual.device.options import Span
from unit.lossy import ASYNC, SYNC, Bench
from unit.served import Arm

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
PAUSES = pytest.mark.parametrize("pause", [0.006, 0.009, 0.015])
"""s of deafness for each byte: as measured on an AX-12 (6 +- 1, 9 at most), and worse."""


def deaf(key: str, driver: str, pause: float) -> Bench:
    bench = Bench(key, driver)
    bench.real.eeprom_pause = Span(pause, pause)
    return bench


@DRIVERS
@PAUSES
@sample_models
def test_P5_a_servo_that_is_deaf_after_each_eeprom_byte_is_restored_whole(key: str, driver: str, pause: float) -> None:
    """Several blocks, one behind the other: each comes when the servo hears again."""
    model = MODELS[key]
    bench = deaf(key, driver, pause)
    saved: Backup = bench.do(lambda servo: servo.backup())
    low, high, hot = (model.register(name) for name in ("min_position", "max_position", "max_temperature"))
    volts = model.register("min_voltage")
    other = dict(saved.values)
    for row, raw in ((low, (low.default or 0) + 40), (high, (high.default or 0) - 40)):
        other[row.name] = raw
    other[hot.name], other[volts.name] = 60, (volts.default or 0) + 2
    assert set(bench.do(lambda servo: servo.restore(Backup(model, "", 5, saved.baud, other)))) == {
        low.name, high.name, hot.name, volts.name,
    }  # fmt: skip
    bench.line.sleep(1.0)
    assert {name: bench.stored(name) for name in other} == other
    bench.do(lambda servo: servo.look())


@DRIVERS
@PAUSES
@sample_models
def test_P5_what_follows_a_write_to_the_eeprom_is_heard(key: str, driver: str, pause: float) -> None:
    bench = deaf(key, driver, pause)
    hot = MODELS[key].register("max_temperature")
    bench.do(lambda servo: servo.store({hot: 60.0}))
    bench.do(lambda servo: servo.led("on"))  # of an LX-16A nothing tells whether it was heard
    bench.line.sleep(1.0)
    assert bench.stored(hot.name) == hot.encode(60.0)
    assert bench.real.led != "off"


@DRIVERS
@PAUSES
@sample_models
def test_P5_id_speed_and_reset_of_a_deaf_servo(key: str, driver: str, pause: float) -> None:
    model = MODELS[key]
    bench = deaf(key, driver, pause)
    bench.do(lambda servo: servo.change_id(7))
    assert bench.at() == bench.really_at() == (7, model.factory_baud)
    if can_change_baud(model):
        new = other_bauds(model)[0]
        bench.do(lambda servo: servo.change_baud(new))
        assert bench.at() == bench.really_at() == (7, new)
    if can_reset(model):
        bench.do(lambda servo: servo.reset())
        assert bench.at() == bench.really_at() == (model.register("id").default, model.factory_baud)


@sample_models
def test_P5_the_bound_is_named(key: str) -> None:
    """A servo that never hears again is not waited for without end."""
    bench = Bench(key, SYNC)
    family = MODELS[key].family
    hot = MODELS[key].register("max_temperature")
    bench.real.eeprom_pause = Span(60.0, 60.0)
    began = bench.line.now()
    with pytest.raises(NoReply, match=rf"does not answer within {family.patience:g} s after a write to its EEPROM"):
        bench.do(lambda servo: servo.store({hot: 60.0}))
    assert family.patience <= bench.line.now() - began < family.patience + 2.0


@pytest.mark.parametrize("key", ["rx28", "drs0602", "lx16a"])
def test_P5_on_real_time_behind_a_terminal(key: str) -> None:
    with Arm(f"{key}@1") as arm:
        arm.servos[0].eeprom_pause = Span(0.009, 0.009)
        model = MODELS[key]
        low, hot = model.register("min_position"), model.register("max_temperature")
        with arm.open() as bus:
            servo = bus.find(1, family=model.family)
            saved = servo.backup()
            values = saved.values | {low.name: (low.default or 0) + 40, hot.name: 60}
            assert set(servo.restore(Backup(model, "", 1, saved.baud, values))) == {low.name, hot.name}
            servo.change_id(2)
            assert servo.backup().values == values | {"id": 2}


@DRIVERS
@pytest.mark.parametrize("boot", [0.25, 0.6, 1.0, 2.0, 3.5])
@pytest.mark.parametrize("what", ["reboot", "change_baud", "reset", "reset, id kept"])
def test_P6_a_herkulex_boots_as_long_as_it_takes(driver: str, boot: float, what: str) -> None:
    bench = Bench("drs0602", driver)
    bench.real.boot_time = Span(boot, boot)
    began = bench.line.now()
    if what == "reboot":
        bench.do(lambda servo: servo.reboot())
    elif what == "change_baud":
        bench.do(lambda servo: servo.change_baud(1_000_000))
        assert bench.really_at() == (5, 1_000_000)
    else:
        keep = frozenset({"id", "baud"}) if "kept" in what else frozenset()
        bench.do(lambda servo: servo.reset(keep=keep))
    bench.do(lambda servo: servo.read(DRS0602.voltage))
    assert boot <= bench.line.now() - began < boot + 0.8  # about as long as it takes
    assert bench.at() == bench.really_at()


def test_P6_the_bound_is_named() -> None:
    bench = Bench("drs0602", SYNC)
    bench.real.boot_time = Span(60.0, 60.0)
    with pytest.raises(NoReply, match="does not answer within 4 s after its restart: is it powered"):
        bench.do(lambda servo: servo.reboot())
    bench = Bench("drs0602", SYNC)
    bench.real.boot_time = Span(60.0, 60.0)
    with pytest.raises(NoReply, match="answers neither there nor at id 5 at 115200 baud within 4 s"):
        bench.do(lambda servo: servo.change_baud(1_000_000))


def test_P6_on_real_time_a_quick_servo_is_not_waited_for() -> None:
    with Arm("drs0602@219") as arm:
        arm.servos[0].boot_time = Span(0.1, 0.1)
        with arm.open() as bus:
            servo = bus.find(219, family="herkulex")
            began = time.monotonic()
            servo.reboot()
            servo.read(DRS0602.voltage)
            assert time.monotonic() - began >= 0.1  # how much longer is up to the computer


@models_that(can_reset)
def test_P6_a_servo_that_comes_from_a_reset_late_is_found(key: str) -> None:
    bench = Bench(key, SYNC)
    bench.real.boot_time = Span(0.8, 0.8)
    bench.real.eeprom_pause = Span(0.009, 0.009)
    bench.do(lambda servo: servo.reset())
    assert bench.servo.id == MODELS[key].register("id").default
