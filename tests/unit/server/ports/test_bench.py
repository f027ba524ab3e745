"""The bench of virtual servos: what surrounds them is changed, and they feel it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servobus.errors import BadValue, UsageError
from servobus.remote.managing import Bench, LookAtBench, SetBench
from servobus.remote.session import RemoteSession
from unit.remote.hosted import TOKEN, VIEWER, Owned
from unit.server.ports.test_owner import talk, truth


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Owned]:
    with Owned({"arm": "virtual:rx28@1,2,lx16a@7"}, tmp_path / "boxes") as hosted:
        yield hosted


def change(server: Owned, token: str = TOKEN, **changes: Any) -> Bench:
    async def work(client: RemoteSession) -> Bench:
        bench: Bench = await client.ask(SetBench, bus="arm", **changes)
        return bench

    return talk(server, work, token)


def test_a_viewer_sees_all_servos_as_they_are(server: Owned) -> None:
    bench = talk(server, lambda client: client.ask(LookAtBench, bus="arm"), VIEWER)
    assert [(one.family, one.id) for one in bench.servos] == [("dynamixel", 1), ("dynamixel", 2), ("lewansoul", 7)]
    assert [one.title for one in bench.servos] == ["RX-28", "RX-28", "LX-16A"]
    assert not bench.servos[0].blocked
    assert bench.servos[0].stall > 0.5  # N·m; the manual of the RX-28 says 2.8 at 12 V
    with pytest.raises(UsageError, match="takes the token of operator"):
        change(server, VIEWER, voltage=9.0)


def test_what_is_set_for_one_leaves_the_others_alone(server: Owned) -> None:
    bench = change(server, servos=(1,), load="torque=0.3,blocked", voltage=11.0, temperature=70.0)
    first, second, _ = bench.servos
    assert (second.load, second.blocked, second.source) == (0.3, True, 11.0)
    assert second.temperature == pytest.approx(70.0, abs=0.5)
    assert (first.load, first.blocked) == (0.0, False)
    assert truth(server, 2).shaft.load.torque == 0.3
    assert change(server, servos=(1,), load="none").servos[1].load == 0.0


def test_a_servo_without_supply_answers_nobody(server: Owned) -> None:
    assert [one.plugged for one in change(server, servos=(0,), plugged=False).servos] == [False, True, True]
    assert not truth(server, 1).powered
    assert all(one.plugged for one in change(server, plugged=True).servos)


def test_faults_in_words(server: Owned) -> None:
    bench = change(server, faults="mute=0.5,latency=4ms")
    assert bench.faults == "mute=0.5,latency=4ms"
    assert change(server, faults="none").faults == ""


def test_bad_input_changes_nothing(server: Owned) -> None:
    before = talk(server, lambda client: client.ask(LookAtBench, bus="arm"))
    for bad, error in (
        ({"voltage": 9.0, "temperature": 900.0}, BadValue),
        ({"voltage": 9.0, "load": "torque=much"}, BadValue),
        ({"voltage": 9.0, "faults": "nonsense=1"}, BadValue),
        ({"voltage": 9.0, "servos": (9,)}, UsageError),
        ({"voltage": 9.0, "position": 1e9}, BadValue),
    ):
        with pytest.raises(error):
            change(server, **bad)
    after = talk(server, lambda client: client.ask(LookAtBench, bus="arm"))
    assert [one.source for one in after.servos] == [one.source for one in before.servos]


def test_a_shaft_is_turned_by_hand_unless_the_motor_holds_it(server: Owned) -> None:
    assert change(server, servos=(0,), position=1.0).servos[0].position == pytest.approx(1.0)
    with server.bus("arm") as bus:
        bus.attach("rx28", 1).torque_on()
        with pytest.raises(UsageError, match="holds its shaft"):
            change(server, servos=(1, 0), position=2.0)
        assert truth(server, 2).position != pytest.approx(2.0)
