"""Buses that another process owns: here a thread, which shares nothing with the client but a socket."""

import asyncio

import pytest

from samples import factory_baud
from servobus import MODELS, RX28, NoReply, PortError, deg
from servobus.families.registry import FAMILIES
from unit.remote.hosted import Hosted

SPEC = "virtual:rx28@1-3,lx16a@7,drs0602@219?baud=115200"


def test_a_register_is_read_as_on_the_port_itself() -> None:
    with Hosted({"arm": SPEC}) as hosted, hosted.bus("arm") as bus:
        assert bus.attach(RX28, 1, baud=115_200).read("present_temperature") == 25.0
        assert bus.stats[1].sent == bus.stats[1].received == 1


def test_a_servo_that_is_not_there_is_silent() -> None:
    with Hosted({"arm": SPEC}) as hosted, hosted.bus("arm") as bus:
        with pytest.raises(NoReply, match="id 9"):
            bus.attach(RX28, 9, baud=115_200).ping()
        assert bus.stats[9].sent == bus.stats[9].timeouts == 2


def test_the_asyncio_driver_reads_and_moves() -> None:
    async def main(hosted: Hosted) -> float:
        async with hosted.async_bus("arm") as bus:
            servo = bus.attach(RX28, 1, baud=115_200)
            async with servo.torque():
                await servo.move(140 * deg, speed=300 * deg).wait()
            position: float = await servo.read("present_position")
            return position

    with Hosted({"arm": SPEC}) as hosted:
        assert asyncio.run(main(hosted)) == pytest.approx(140 * deg, abs=1 * deg)


def test_a_wrong_name_or_token_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with Hosted({"arm": SPEC}) as hosted:
        with pytest.raises(PortError, match="no such bus there; there are: arm"):
            hosted.bus("leg")
        monkeypatch.setenv("SERVOBUS_TOKEN", "guessed")
        with pytest.raises(PortError, match="the token is not one of this server"):
            hosted.bus("arm")


@pytest.mark.parametrize("family", list(FAMILIES))
def test_all_families_are_found(family: str) -> None:
    model = next(model for model in MODELS.values() if model.family.name == family)
    with Hosted({"arm": f"virtual:{model.key()}@1-2"}) as hosted, hosted.bus("arm") as bus:
        found = bus.scan(family=family, ids=range(1, 4), bauds=factory_baud(model))
        assert [servo.id for servo in found] == [1, 2]
