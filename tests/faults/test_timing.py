"""Answers that come late, not at all, twice, from somebody else, or at another speed (F7 to F11)."""

import pytest

import extent
from faults.rig import POSITION, FaultRig
from samples import (
    SAMPLE_KEYS,
    answer_levels,
    can_change_baud,
    factory_bauds,
    goal_range,
    keys_that,
    models_that,
    one_model_of_each_family,
    other_bauds,
    sample_models,
    steady,
    unusual_baud,
)
from servobus import MODELS, NoReply, WrongReply
from servobus.doctor import SearchPlan, Severity, examine
from servobus.errors import BusError, DuplicateId, Garbled
from servobus.families.base import Answers
from servobus.transports.serial_port import LATENCY
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC

CALM = 30
"""Answers after which the driver has got used to a line."""


def two_questions(rig: FaultRig, rounds: int) -> None:
    """Read two registers in turn; where the family allows it their answers look alike. Count what is wrong."""
    other = steady(rig.model)
    for _ in range(rounds):
        rig.try_position()
        try:
            if rig.read(1, other) != rig.real().get(other):
                rig.verdicts.append("wrong")
        except BusError as error:
            rig.verdicts.append(type(error).__name__)


@CHOSEN_DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("stall", ["12ms", "120ms", "400ms"])
def test_F7_an_adapter_that_stands_still_never_gives_an_old_value(key: str, stall: str, driver: str) -> None:
    """Replies that come after their time-out, all at once and in order: not one is taken for the answer to a later
    question, of the same length or not."""
    rig = FaultRig(key, driver, ids="1")
    rig.inject(f"seed=7,stall=0.2:{stall}")
    two_questions(rig, 100)
    assert rig.port.rig.fault_counts["stall"] > 20
    assert "wrong" not in rig.verdicts
    assert (rig.bus.stats.total.late > 0) is (rig.bus.stats.total.timeouts > 0)
    rig.inject(None)
    assert [rig.try_position() for _ in range(2)][-1] == "right"


@CHOSEN_DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("late", ["3ms", "15ms", "50ms"])
def test_F7_a_reply_that_others_overtake_is_told_and_then_waited_for(key: str, late: str, driver: str) -> None:
    """Single replies held back while others pass, which no adapter does: at most the first is taken for an answer.

    Then it is told with the next exchange that there were two, and from then on such replies are waited for. The servos
    answer as fast as the manual has it: where an answer may take some milliseconds, one that is older by 50 cannot be
    told from it.
    """
    rig = FaultRig(key, driver, ids="1", options="&as=manual")
    for _ in range(100):
        rig.try_position()
    rig.inject(f"seed=7,{','.join(f'late#{number}:{late}' for number in range(10, 300, 40))}")
    for _ in range(300):
        doubled = rig.bus.stats.total.doubled
        rig.try_position()
        if rig.verdicts[-2] == "wrong":
            assert rig.verdicts[-1] == "DuplicateId" or rig.bus.stats.total.doubled > doubled
    assert rig.verdicts.count("wrong") <= 1
    assert rig.port.rig.fault_counts["late"] > 5
    assert rig.verdicts[-1] == "right"


@DRIVERS
@sample_models
def test_F8_silence(key: str, driver: str) -> None:
    """A servo that says nothing: NoReply, after two tries."""
    rig = FaultRig(key, driver)
    rig.inject("mute")
    with pytest.raises(NoReply):
        rig.read()
    assert rig.bus.stats[1].timeouts >= 2


@DRIVERS
@sample_models
def test_F8_a_stranger_answers(key: str, driver: str) -> None:
    """An answer from another id: WrongReply, which names it; asked again if it was only one."""
    rig = FaultRig(key, driver)
    rig.inject("stranger@77#1")
    assert rig.try_position() == "right"
    assert rig.bus.stats[77].strangers == 1
    rig.inject("stranger@77")
    with pytest.raises(WrongReply, match="77"):
        rig.read()


@CHOSEN_DRIVERS
@sample_models
def test_F8_two_answers_one_behind_the_other(key: str, driver: str) -> None:
    """A second servo with the id answers behind the first: told with the next exchange, and only with that."""
    rig = FaultRig(key, driver)
    for _ in range(80):
        rig.try_position()  # by now the driver knows how soon an answer can come
    rig.inject("twin#1")
    verdicts = []
    for _ in range(3):
        verdicts.append(rig.try_position())
        rig.port.sleep(0.005)
    assert verdicts == ["right", "DuplicateId", "right"]
    assert rig.bus.stats[1].doubled == 1


@DRIVERS
@sample_models
def test_F8_two_servos_with_one_id_are_said_to_be(key: str, driver: str) -> None:
    """Two servos of one id stand apart and answer over each other: no value, and the scan asks whether there are
    two."""
    rig = FaultRig(key, driver, ids="2,2", settle=False)
    low, high = goal_range(rig.model)
    for share, real in zip((0.3, 0.7), rig.reals, strict=True):
        real.turn_shaft(rig.model.register(POSITION).decode(low + round(share * (high - low))))
    with pytest.raises((Garbled, DuplicateId), match="two servos"):
        rig.read(2)


@DRIVERS
def test_F8_two_servos_with_one_id_and_other_delays(driver: str) -> None:
    """Two RX-28 of one id whose return delays differ answer one behind the other: DuplicateId."""
    rig = FaultRig("rx28", driver, ids="2,2", settle=False)
    slow = rig.reals[1]
    slow.memory.store(rig.model.register("return_delay_time"), 254)  # 508 µs
    rig.reals[0].memory.store(rig.model.register("return_delay_time"), 0)
    rig.port.set_baud(1_000_000)
    for real in rig.reals:
        real.store_baud(1_000_000)
    rig.bus.forget(2)
    rig.bus.attach(rig.model, 2, baud=1_000_000)
    with pytest.raises(DuplicateId, match="two servos with id 2"):
        for _ in range(2):
            rig.read(2)
            rig.port.sleep(0.001)  # a program that asks at once, as on a virtual clock, talks over the second answer


@DRIVERS
@pytest.mark.parametrize(
    ("key", "baud"), [(key, baud) for key in keys_that(can_change_baud) for baud in other_bauds(MODELS[key])]
)
def test_F9_a_servo_at_another_speed_is_found(key: str, baud: int, driver: str) -> None:
    """Asked at the wrong speed it gives no value; a scan over the speeds finds it, and reads go on there."""
    rig = FaultRig(key, driver, ids="3", options=f"&baud={baud}", settle=False)
    with pytest.raises((NoReply, Garbled)):
        rig.read(3)
    (servo,) = rig.do(lambda bus: bus.scan(family=rig.model.family, bauds=rig.model.bauds, ids=range(5)))
    assert (servo.id, servo.baud) == (3, baud)
    assert rig.try_position(3) == "right"


@models_that(can_change_baud)
def test_F9_the_doctor_names_the_speed(key: str) -> None:
    """`doctor` with the other speeds to spare says at which one they answer."""
    family = MODELS[key].family
    factory, baud = factory_bauds(family), unusual_baud(family)
    plan = SearchPlan([(family, factory)], [(family, MODELS[key].bauds)], ids=range(3), reads=5)
    findings = list(examine(f"virtual:{key}@1?clock=virtual&baud={baud}", plan))
    assert [one.what for one in findings if one.check == "speed"] == [
        f"{family.name} at {baud} (from the factory {MODELS[key].factory_baud})"
    ]
    assert all(one.level is not Severity.FAIL for one in findings)


@CHOSEN_DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("skew", ["-2.5%", "2.5%"])
def test_F9_a_speed_that_is_a_little_off(key: str, skew: str, driver: str) -> None:
    """A servo whose clock is off by what it may (RX-28 manual 3-4-1: 3 %, less what its divisor takes): no trouble."""
    rig = FaultRig(key, driver)
    rig.inject(f"skew@1={skew}")
    for _ in range(100):
        rig.try_position()
    assert rig.verdicts == ["right"] * 100
    assert rig.bus.stats.total.retries == 0


@DRIVERS
def test_F9_two_speeds_on_one_bus(driver: str) -> None:
    """Each servo is spoken to at its own speed; what the other one makes of that costs no wrong value."""
    rig = FaultRig("rx28", driver, ids="1-2", settle=False)
    rig.real(2).store_baud(1_000_000)
    servos = rig.do(lambda bus: bus.scan(family="dynamixel", bauds=(57_600, 1_000_000), ids=range(4)))
    assert sorted((servo.id, servo.baud) for servo in servos) == [(1, 57_600), (2, 1_000_000)]
    for id in (1, 2) * 10:
        rig.try_position(id)
    assert rig.verdicts == ["right"] * 20


ANSWERED = [(key, level) for key in SAMPLE_KEYS for level in answer_levels(MODELS[key])]


@DRIVERS
@pytest.mark.parametrize(("key", "answers"), ANSWERED)
def test_F10_a_write_is_awaited_only_where_an_answer_can_come(key: str, answers: Answers, driver: str) -> None:
    """A write takes its bits where nothing answers it, and its answer's bits and delay where something does."""
    rig = FaultRig(key, driver, ids="1", answers=answers, settle=False, echo=False)
    rig.inject(None)
    torque = {rig.model.register("torque_enable"): 0}
    start = rig.port.now()
    # As it is: torque that is written off is made sure of with a read.
    rig.do(lambda bus: bus.do(rig.model.family.put(bus[1].target, torque, keep=False)))
    (request,) = rig.port.sent
    took = rig.port.now() - start
    bits = 10 * len(request) / rig.port.baud
    assert bool(rig.port.heard) is (answers is Answers.EVERYTHING)
    if rig.port.heard:
        assert bits < took < 2 * bits + 0.001
    else:
        assert took <= bits
    assert rig.bus.stats.total.timeouts == 0


READS = 1000 if extent.everything else 400


def false_alarms(rig: FaultRig, delay: str, faults: str) -> int:
    """Count reads that failed or were asked again, after the first few, on a line that only has delays."""
    rig.port.inject(faults)
    rig.port.latency = LATENCY  # what is assumed of an adapter that tells nothing
    rig.bus.link.latency.review()
    for _ in range(8):
        rig.try_position()
    retries = rig.bus.stats.total.retries
    rig.verdicts.clear()
    for _ in range(READS):
        rig.try_position()
    assert "wrong" not in rig.verdicts, delay
    failed = READS - rig.verdicts.count("right")
    return int(rig.bus.stats.total.retries - retries + failed)


@pytest.mark.parametrize("delay", [0, 127, 254])
def test_F11_return_delays(delay: int) -> None:
    """An RX-28's Return Delay Time from none to 508 µs: never taken for silence."""
    rig = FaultRig("rx28", ids="1")
    rig.do(lambda bus: bus[1].write_raw({rig.model.register("return_delay_time"): delay}))
    assert false_alarms(rig, f"{delay}", "") == 0


@one_model_of_each_family
@pytest.mark.parametrize("latency", ["1ms", "16ms", "40ms"])
def test_F11_slow_adapters_with_jitter(key: str, latency: str) -> None:
    """An adapter that holds bytes back for 1, 16 or 40 ms, and up to half as long again by chance: after the first few
    reads no more than one in a thousand is taken for lost, and none is wrong."""
    rig = FaultRig(key, ids="1", settle=False)
    jitter = int(latency.removesuffix("ms")) / 2
    assert false_alarms(rig, latency, f"seed=11,latency={latency},jitter={jitter}ms") <= READS // 1000


@DRIVERS
def test_F11_one_slow_moment_after_calm(driver: str) -> None:
    """A line that was quick for long and stands still once: silence until that is over, and then right at once."""
    rig = FaultRig("rx28", driver, ids="1")
    for _ in range(CALM):
        rig.try_position()
    rig.inject("stall#1:60ms")
    over = rig.port.now() + 0.06
    rig.verdicts.clear()
    while rig.port.now() < over:
        rig.try_position()
    assert [rig.try_position(), rig.try_position()] == ["right", "right"]
    assert not {"wrong", "DuplicateId"} & set(rig.verdicts)


def test_F11_patience_has_a_limit() -> None:
    """However late answers have been, silence is told within half a second."""
    rig = FaultRig("rx28", SYNC, ids="1")
    rig.inject("seed=1,stall=0.5:120ms,stall=0.5:600ms")
    for _ in range(50):
        rig.try_position()
    rig.inject("mute")
    start = rig.port.now()
    with pytest.raises(NoReply):
        rig.read()
    assert rig.port.now() - start < 2 * 0.5
