"""What holds for the verbs of all families: long packets are split (F20), positions at and beyond the ends (F24)."""

from collections.abc import Iterator
from typing import Any

import pytest

from samples import SAMPLE_KEYS, ends, factory_answers, goal_range, sample_of, zero
from servobus import DRS0602, LX16A, MODELS, RX28, BadValue, deg, dynamixel1, herkulex
from servobus.core.exchange import Exchange
from servobus.families.base import Answers, AxisMove, Family, KnownServo, Model, ServoRef
from servobus.families.registry import FAMILIES
from unit.lossy import ASYNC, SYNC, Bench


def packets(model: type[Model], count: int, durations: list[float]) -> Iterator[bytes]:
    """Give the packets that start moves of so many servos, ids from 0 on, goals 100 + id."""
    axes = [
        AxisMove(
            KnownServo.of(ServoRef(id, model, Answers.READS), 57_600), 100 + id, 1.0, durations[id % len(durations)]
        )
        for id in range(count)
    ]
    for step in model.family.start_moves(axes):
        assert isinstance(step, Exchange)
        yield step.request


# Long packets

COUNTS = [2, 27, 28, 43, 44, 53, 54, 107, 200]


@pytest.mark.parametrize("count", COUNTS)
def test_sync_write_is_split_at_27_servos(count: int) -> None:
    seen: dict[int, int] = {}
    sizes = []
    for packet in packets(RX28, count, [1.0]):
        assert len(packet) <= 143  # 3-5-7
        assert (packet[2], packet[4], packet[5], packet[6]) == (254, 0x83, 30, 4)
        assert packet[3] == len(packet) - 4
        entries = packet[7:-1]
        assert len(entries) % 5 == 0
        sizes.append(len(entries) // 5)
        seen.update((entries[i], entries[i + 1] | entries[i + 2] << 8) for i in range(0, len(entries), 5))
    assert seen == {id: 100 + id for id in range(count)}
    assert max(sizes) == min(count, 27)  # D-53


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(("durations", "code", "entry", "most"), [([1.0], 6, 4, 53), ([1.0, 1.5], 5, 5, 43)])
def test_jogs_are_split_at_53_and_43_servos(
    count: int, durations: list[float], code: int, entry: int, most: int
) -> None:
    seen: dict[int, int] = {}
    sizes = []
    for packet in packets(DRS0602, count, durations):
        assert len(packet) == packet[2] <= 223  # 4-1
        assert (packet[3], packet[4]) == (254, code)
        entries = packet[8:] if code == 6 else packet[7:]  # S_JOG begins with the playtime
        assert len(entries) % entry == 0
        sizes.append(len(entries) // entry)
        seen.update((entries[i + 3], entries[i] | entries[i + 1] << 8) for i in range(0, len(entries), entry))
    assert seen == {id: 100 + id for id in range(count)}
    assert max(sizes) == min(count, most)  # H-70, H-71


def test_what_does_not_fit_one_packet_is_refused_where_it_is_made_by_hand() -> None:
    with pytest.raises(BadValue, match="143 bytes"):
        dynamixel1.sync_write(30, {id: bytes(4) for id in range(28)})
    with pytest.raises(BadValue, match="I_JOG"):
        herkulex.i_jog(254, [herkulex.Jog(id, 0, playtime=1) for id in range(44)])
    with pytest.raises(BadValue, match="S_JOG"):
        herkulex.s_jog(254, 1, [herkulex.Jog(id, 0) for id in range(54)])


# Ends of the range


def angle(model: type[Model], raw: int) -> float:
    """Give the angle in rad of a raw position, by the resolution in the data sheet of the model."""
    return (raw - zero(model)) * model.sheet.resolution


def bench_at(key: str, raw: int, driver: str = SYNC) -> Any:
    """Make a bench whose free shaft stands at a raw position."""
    bench = Bench(key, driver, factory_answers(MODELS[key]))
    bench.real.turn_shaft(angle(MODELS[key], raw))
    return bench


@pytest.mark.parametrize(
    ("model", "unit", "middle"),
    # Degrees of a unit and raw value of 0°: RX-28 manual 3-4-2, DRS-0602 manual 2-2 and EH-09, LX-16A point 20.
    [(RX28, 300 / 1023, 0), (DRS0602, 360 / 12962, 16384), (LX16A, 0.24, 0)],
)
def test_angles_are_those_of_the_manuals(model: type[Model], unit: float, middle: int) -> None:
    row = model.register("present_position")
    for raw in ends(model):
        assert row.decode(raw) == pytest.approx((raw - middle) * unit * deg)


@pytest.mark.parametrize("driver", [SYNC, ASYNC])
@pytest.mark.parametrize(("key", "raw"), [(key, raw) for key in SAMPLE_KEYS for raw in ends(MODELS[key])])
def test_positions_at_the_ends_are_read_right_and_held(key: str, raw: int, driver: str) -> None:
    model = MODELS[key]
    bench = bench_at(key, raw, driver)
    row = model.register("present_position")
    assert bench.do(lambda servo: servo.read_raw([row])) == [raw]
    assert bench.do(lambda servo: servo.read(row)) == pytest.approx(angle(model, raw))
    here = bench.real.position
    (low, high), beyond = goal_range(model), sample_of(key).beyond
    if not low - beyond <= raw <= high + beyond:
        return  # outside its limits a DRS-0602 holds as well, but is not asked to here
    bench.do(lambda servo: servo.torque_on())
    for _ in range(50):
        bench.line.sleep(0.02)
        assert bench.real.position == pytest.approx(here, abs=0.6 * deg)
    near = max(2, 0.23 * deg // model.sheet.resolution)
    assert bench.do(lambda servo: servo.read_raw([row]))[0] == pytest.approx(raw, abs=near)


def test_a_position_below_0_of_an_lx16a_comes_as_the_manual_prints_it() -> None:
    bench = bench_at("lx16a", -12)
    packet = bench.bus.do(LX16A.family.read(bench.servo.target, [LX16A.present_position]))
    assert packet == [-12]  # F4 FF, reply 10
    assert LX16A.present_position.layout.unpack(b"\xf4\xff") == -12
    assert LX16A.present_position.layout.unpack(b"\xff\x7f") == 32767


@pytest.mark.parametrize("raw", [-125, -1, 1001])
def test_a_move_from_beyond_the_end_takes_the_short_way(raw: int) -> None:
    bench = bench_at("lx16a", raw)
    bench.do(lambda servo: servo.torque_on())
    goal = 10 * deg if raw < 0 else 230 * deg
    course = bench.do(lambda servo: servo.start_move(goal, time=0.5))
    assert course.axes[0].distance == pytest.approx(abs(goal - raw * 0.24 * deg), abs=0.3 * deg)
    seen = []
    for _ in range(60):
        bench.line.sleep(0.02)
        seen.append(bench.real.position)
    low, high = sorted((goal, raw * 0.24 * deg))
    assert all(low - 2 * deg < position < high + 2 * deg for position in seen)
    assert seen[-1] == pytest.approx(goal, abs=1 * deg)


def test_a_herkulex_counts_more_than_one_turn() -> None:
    bench = bench_at("drs0602", 16384)
    bench.do(lambda servo: servo.write_many({DRS0602.min_position: -455 * deg, DRS0602.max_position: 455 * deg}))
    bench.do(lambda servo: servo.torque_on())
    for turns in (-1.2, 0.0, 1.2):
        bench.do(lambda servo, goal=turns * 360 * deg: servo.start_move(goal, time=2.8))
        bench.line.sleep(4.0)
        assert bench.real.position == pytest.approx(turns * 360 * deg, abs=1 * deg)
        assert bench.do(lambda servo: servo.read(DRS0602.present_position)) == pytest.approx(
            turns * 360 * deg, abs=1 * deg
        )


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_packets_are_named_after_their_family(family: Family) -> None:
    """Counters are kept under the name of the packets, users ask for them under that of the family."""
    assert family.framing.name == family.name
