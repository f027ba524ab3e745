"""A bus through a server is the same bus: the same values, the same errors, the same bytes on the wire, no wrong value.

Each test does the same on the port itself and through a server, on virtual servos on a virtual clock.
"""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from faults.rig import POSITION, FaultRig
from samples import ONE_OF_EACH_FAMILY, goal_range, one_model_of_each_family, sample_of
from servobus import ServobusError
from servobus.core.exchange import Batch, LateAnswers, Procedure, SetBaud
from unit.lossy import DRIVERS
from unit.remote.hosted import Hosted
from unit.remote.rig import remote_rig


@pytest.fixture(scope="module")
def hosted() -> Iterator[Hosted]:
    with Hosted({}) as running:
        yield running


def came_of(work: Callable[[], Any]) -> Any:
    """Give what came of work, or the words of its error."""
    try:
        return work()
    except ServobusError as error:
        return type(error).__name__, str(error)


def everything(rig: FaultRig) -> list[Any]:
    """Do one of each with the servos of a rig; tell what came of it, and what was sent."""
    model, bus = rig.model, rig.bus
    light = next(name for name in ("led", "led_off", "led_control") if name in model.registers)
    rows = [row for row in model.registers.values() if row.readable]
    silent = bus.attach(model, 9)
    rig.inject(None)

    def batch() -> Procedure[Any]:
        yield SetBaud(bus[1].baud)
        answers = yield Batch([model.family.fences(id)[0] for id in (1, 2, 9, 3)])
        return [type(answer).__name__ if isinstance(answer, Exception) else answer for answer in answers]

    def lateness() -> Procedure[Any]:
        yield SetBaud(bus[1].baud)
        return (yield LateAnswers())

    steps: list[Callable[[Any], Any]] = [
        lambda bus: bus[1].read(POSITION),
        lambda bus: bus[1].ping(),
        lambda _: silent.ping(),
        lambda bus: bus[2].read_raw(rows),
        lambda bus: bus[2].write_raw({model.register(light): 1}),
        lambda bus: bus[2].read_raw([model.register(light)]),
        lambda bus: bus[2].read_alarms(),
        lambda bus: bus.read_all(POSITION),
        lambda bus: bus.do(batch()),
        lambda bus: bus.do(lateness()),
        lambda bus: bus[3].torque_on(),
        lambda bus: bus[3].look(),
        lambda bus: bus.cycle(POSITION).run({3: rig.model.register(POSITION).decode(sum(goal_range(model)) // 2)}),
        lambda bus: bus[3].torque_off(),
        lambda bus: bus.stop(),
        lambda bus: bus[1].change_id(7),
        lambda bus: bus[7].read(POSITION),
        lambda bus: bus[7].backup(),
        lambda bus: bus.forget(silent),
        lambda bus: bus.scan(family=model.family, ids=range(1, 9), bauds=bus[2].baud),
    ]
    done = [repr(came_of(lambda step=step: rig.do(step))) for step in steps]  # type: ignore[misc] # a default
    counted = {
        key: (counts.sent, counts.received, counts.timeouts, counts.retries) for key, counts in bus.stats.servos.items()
    }
    return [done, {key: counts for key, counts in counted.items() if any(counts)}, rig.port.sent]


@DRIVERS
@one_model_of_each_family
def test_all_is_the_same(hosted: Hosted, key: str, driver: str) -> None:
    alone = everything(FaultRig(key, driver))
    with remote_rig(hosted, key, driver) as rig:
        shared = everything(rig)
    for one, other in zip(alone[0], shared[0], strict=True):
        assert one == other
    assert alone[1] == shared[1]
    assert alone[2] == shared[2]


@DRIVERS
@pytest.mark.parametrize("key", ONE_OF_EACH_FAMILY)
def test_F1_a_lost_byte_costs_one_retry(hosted: Hosted, key: str, driver: str) -> None:
    with remote_rig(hosted, key, driver) as rig:
        for place in range(sample_of(key).answer_size):
            before = rig.bus.stats[1].retries
            rig.inject(f"drop@{place}#1")
            assert [rig.try_position(), rig.try_position()] == ["right", "right"]
            assert rig.bus.stats[1].retries == before + 1


MIXES = (
    "drop=0.03,flip=0.03,junk=0.03,split=0.03,mute=0.03,deaf=0.03,stranger=0.02,stall=0.01,twin=0.01",
    "latency=16ms,jitter=8ms,drop=0.05,mute=0.05",
    "late=0.05,late=0.02:3ms",
)


@DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("mix", MIXES)
def test_no_value_is_wrong_whatever_the_wire_does(hosted: Hosted, key: str, driver: str, mix: str) -> None:
    with remote_rig(hosted, key, driver) as rig:
        rig.inject(f"seed=5,{mix}")
        for number in range(60):
            rig.try_position(1 + number % 3)
    late = {"late"} if "late=" in mix else set()
    allowed = {
        "right",
        "provable",
        "NoReply",
        "BadChecksum",
        "ShortReply",
        "Garbled",
        "WrongReply",
        "DuplicateId",
        "BrokenEcho",
    }
    assert set(rig.verdicts) <= allowed | late
    assert rig.verdicts.count("right") > 30


def test_models_that_answer_together_do_so_here_too(hosted: Hosted) -> None:
    """BULK_READ of the MX series: the server makes the group."""
    sent = []
    for rig in (FaultRig("mx28"), None):
        if rig is not None:
            sent.append(bulk(rig))
        else:
            with remote_rig(hosted, "mx28") as shared:
                sent.append(bulk(shared))
    assert sent[0] == sent[1]


def bulk(rig: FaultRig) -> Any:
    rig.inject(None)
    found = rig.do(lambda bus: bus.read_all(POSITION))
    assert len(rig.port.sent) == 1
    assert rig.port.sent[0][4] == 0x92  # BULK_READ, e-manual of protocol 1.0
    return [*found.values()], rig.port.sent
