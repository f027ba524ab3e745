"""Several servos that are read by one request: what goes wrong with one reply costs that servo alone (F1 to F11)."""

from contextlib import suppress
from itertools import chain, combinations
from typing import Any

import pytest

import extent
from drivers import result_of
from faults.rig import POSITION, FaultRig
from samples import keys_that, models_that
from servobus import BusError
from servobus.errors import BadChecksum, DuplicateId, Garbled, NoReply
from servobus.families.base import Model
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC

IDS = (1, 2, 3, 4, 5, 6)
SUBSETS = list(chain.from_iterable(combinations(IDS, count) for count in range(len(IDS) + 1)))


def can(model: type[Model]) -> bool:
    return model.answers_together


FIRST = keys_that(can)[0]
"""For what depends on packets alone."""


class GroupRig(FaultRig):
    """Six servos, or those with these ids; `bus` knows all six."""

    def __init__(self, key: str, driver: str = SYNC, *, there: str = "1-6", options: str = "") -> None:
        super().__init__(key, driver, ids=there, options=options, settle=False)
        for id in IDS:
            self.bus.attach(self.model, id)
        self.order = sorted(self.bus, key=lambda servo: servo.id)
        self.cycle = self.bus.cycle([POSITION], write=(), servos=self.order)
        self.do(lambda bus: bus[self.reals[0].id].ping())  # finds out about the echo
        self.truth = {real.id: self.turn(real.id) for real in self.reals}

    def read_all(self) -> tuple[dict[int, int], dict[int, BusError]]:
        return self._judged(self.do(lambda bus: bus.read_all(POSITION, self.order)), lambda value: value)

    def run_cycle(self) -> tuple[dict[int, int], dict[int, BusError]]:
        return self._judged(result_of(self.cycle.run()), lambda value: value[POSITION])

    def _judged(self, seen: Any, position: Any) -> tuple[dict[int, int], dict[int, BusError]]:
        row = self.model.register(POSITION)
        values = {servo.id: row.scale.encode(position(value)) for servo, value in seen.items()}
        wrong = {id: value for id, value in values.items() if value != self.truth[id]}
        assert not wrong, f"{self.truth} were {values}"
        lost = {servo.id: error for servo, error in seen.lost.items()}
        assert sorted([*values, *lost]) == list(IDS)
        return values, lost

    @property
    def groups(self) -> int:
        """How often several were asked by one request since the last faults."""
        return sum(request[4] == 0x92 for request in self.port.sent)


@DRIVERS
@models_that(can)
def test_all_are_right_by_one_request(key: str, driver: str) -> None:
    rig = GroupRig(key, driver)
    rig.inject(None)
    assert rig.read_all() == rig.run_cycle() == (rig.truth, {})
    assert rig.groups == len(rig.port.sent) == 2


@pytest.mark.parametrize("absent", extent.spread(SUBSETS[1:-1], 20), ids=str)
def test_any_of_them_may_be_absent(absent: tuple[int, ...]) -> None:
    """A servo waits for the answer of the one before it, so those behind an absent one stay silent: they are asked."""
    rig = GroupRig(FIRST, there=",".join(str(id) for id in IDS if id not in absent))
    for _ in range(3):
        for read in (rig.read_all, rig.run_cycle):
            values, lost = read()
            assert (values, tuple(lost)) == (rig.truth, absent)
            assert all(isinstance(error, NoReply) for error in lost.values())


@pytest.mark.parametrize("absent", [(1,), (3,), (6,), (2, 5)], ids=str)
def test_what_absent_servos_cost(absent: tuple[int, ...]) -> None:
    """In a cycle each of them is waited for once, then for one each 0.25 s; the others are read by one request."""
    rig = GroupRig(FIRST, there=",".join(str(id) for id in IDS if id not in absent))
    for _ in range(4):
        rig.run_cycle()
    rig.inject(None)
    began = rig.port.now()
    for _ in range(5):
        rig.run_cycle()
    assert rig.groups == 5
    bits = (7 + 3 * 6 + 6 * 8) * 10 / rig.port.baud
    assert rig.port.now() - began < 5 * (bits + 6 * 0.001) + 0.05


@pytest.mark.parametrize("mute", extent.spread(SUBSETS[1:], 20), ids=str)
def test_any_answers_may_be_lost_on_their_way(mute: tuple[int, ...]) -> None:
    """What is lost in a cycle is named and comes again with the next one; `read_all` asks again.

    Where three answers running are lost on the way to the driver alone, the servos still talk when it asks again.
    """
    for cycle in (True, False):
        rig = GroupRig(FIRST)
        rig.inject(",".join(f"mute#{n}" for n in mute))
        _, lost = rig.run_cycle() if cycle else rig.read_all()
        assert len(lost) <= len(mute)
        assert cycle or not lost or len(mute) > 2
        rig.inject(None)
        assert rig.run_cycle() == (rig.truth, {})


FAULTS = [
    "drop#N", "flip#N", "junk@before#N", "junk@inside#N", "junk@after#N", "split#N", "glue#N", "twin#N", "twin#N:100us",
    "stranger#N", "late#N:2ms", "late#N:20ms",
]  # fmt: skip
"""What hits answer N."""


@CHOSEN_DRIVERS
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_one_answer_costs_one_servo(fault: str, driver: str) -> None:
    """Whichever answer is hit: no value is wrong, and none but its servo is lost, or the one whose turn was next."""
    for n in IDS:
        rig = GroupRig(FIRST, driver)
        rig.inject(f"seed={n},{fault}".replace("N", str(n)))
        _, lost = rig.run_cycle()
        assert lost.keys() <= {n, n + 1}, n
        rig.inject(None)
        rig.port.sleep(0.3)
        for _ in range(3):
            _, lost = rig.run_cycle()
        assert not lost, n


@CHOSEN_DRIVERS
@pytest.mark.parametrize("fault", FAULTS)
def test_reading_once_gets_over_a_fault_of_one_answer(fault: str, driver: str) -> None:
    for n in IDS:
        rig = GroupRig(FIRST, driver)
        rig.inject(f"seed={n},{fault}".replace("N", str(n)))
        _, lost = rig.read_all()
        told = "twin" in fault or fault.startswith("late") or fault == "glue"
        assert {type(error) for error in lost.values()} <= ({DuplicateId} if told else set()), n
        rig.inject(None)
        rig.port.sleep(0.3)
        rig.read_all()
        assert rig.read_all() == (rig.truth, {}), n


@CHOSEN_DRIVERS
@pytest.mark.parametrize("stall", ["5ms", "30ms", "120ms"])
def test_an_adapter_that_stands_still_gives_no_old_value(stall: str, driver: str) -> None:
    """All answers behind one come late, in order: to the next request when the servos stand elsewhere."""
    for n in IDS:
        rig = GroupRig(FIRST, driver)
        rig.inject(f"stall#{n}:{stall}")
        for read in (rig.run_cycle, rig.run_cycle, rig.read_all):
            with suppress(BusError):  # none of them answered in time
                read()
            rig.truth = {id: rig.turn(id) for id in IDS}
        rig.port.sleep(0.5)
        rig.run_cycle()
        assert rig.read_all() == (rig.truth, {}), n


@DRIVERS
def test_faults_without_end_give_no_wrong_value(driver: str) -> None:
    rig = GroupRig(FIRST, driver)
    rig.inject(
        "seed=5,mute=0.03,drop=0.03,flip=0.03,junk@inside=0.03,split=0.03,late=0.03,stall=0.01,twin=0.02,deaf=0.02"
    )
    came = 0
    for _ in range(60):
        rig.truth |= {id: rig.turn(id) for id in (2, 5)}
        came += len(rig.run_cycle()[0]) + len(rig.read_all()[0])
    assert came > 400
    rig.inject(None)
    rig.port.sleep(2.5)
    rig.read_all()
    for _ in range(8):
        rig.run_cycle()
    assert rig.read_all() == rig.run_cycle() == (rig.truth, {})


@DRIVERS
def test_a_request_that_nobody_hears(driver: str) -> None:
    rig = GroupRig(FIRST, driver)
    rig.inject("deaf#1")
    assert rig.read_all() == (rig.truth, {})
    rig.inject("deaf#1")
    assert rig.run_cycle() == (rig.truth, {})


@DRIVERS
def test_an_echo_is_no_answer(driver: str) -> None:
    rig = GroupRig(FIRST, driver, options="&echo=on")
    assert rig.bus.echo is True
    rig.inject(None)
    assert rig.read_all() == rig.run_cycle() == (rig.truth, {})
    assert rig.groups == 2
    for fault in ("echo@part#1", "echo@bad#1", "echo@none#1"):
        rig.inject(f"seed=3,{fault}")
        assert rig.read_all() == (rig.truth, {}), fault


@DRIVERS
@pytest.mark.parametrize("twice", IDS)
def test_two_servos_with_one_id_cost_that_id(twice: int, driver: str) -> None:
    """Both answer at once, in the same way or not; the one behind them may hear neither."""
    rig = GroupRig(FIRST, driver, there=f"1-6,{twice}")
    for _ in range(2):
        _, lost = rig.read_all()
        assert lost.keys() <= {twice}
    rig.reals[-1].turn_shaft(rig.model.register(POSITION).decode(rig.truth[twice] ^ 0x155))
    rig.reals[-1].memory[rig.model.register("return_delay_time")] = 0
    _, lost = rig.read_all()
    assert lost.keys() <= {twice}
    assert all(isinstance(error, Garbled | BadChecksum | DuplicateId) for error in lost.values())
