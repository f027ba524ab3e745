"""One bus, several programs at once: nobody's procedure is broken into, and who goes leaves the line to the others."""

import threading
from contextlib import suppress
from typing import Any

import pytest

from samples import ONE_OF_EACH_FAMILY, factory_baud, goal_range
from servobus import MODELS, PortError, PortLost, ServobusError, Stopped
from servobus.core.exchange import Exchange, Pause, Procedure
from servobus.server.ports import service
from servobus.server.ports.gate import PermitAll
from servobus.server.ports.leases import Holder
from unit.remote.hosted import PATIENCE, Hosted
from unit.remote.rig import RemoteRig
from unit.served import wait_for

READS = 60


@pytest.mark.parametrize("key", ONE_OF_EACH_FAMILY)
def test_threads_and_programs_read_side_by_side(key: str) -> None:
    """Each servo stands elsewhere; four programs, two threads each, read all: each value is that of its servo."""
    model = MODELS[key]
    row = model.register("present_position")
    low, high = goal_range(model)
    wrong: list[Any] = []
    with Hosted({}) as hosted:
        rig = RemoteRig(hosted, key, ids="1-4")
        truth = {}
        for id in (1, 2, 3, 4):
            truth[id] = row.decode(low + id * (high - low) // 5)
            rig.real(id).turn_shaft(truth[id])
        buses = [rig.bus, *(hosted.bus("bus0") for _ in range(3))]

        def read(bus: Any, first: int) -> None:
            for id in (1, 2, 3, 4):
                bus.attach(model, id)
            for number in range(READS):
                id = 1 + (first + number) % 4
                value = bus[id].read(row)
                if value != pytest.approx(truth[id]):
                    wrong.append((id, value))

        def safely(bus: Any, first: int) -> None:
            try:
                read(bus, first)
            except BaseException as error:  # noqa: BLE001 - a thread cannot tell it otherwise
                wrong.append(error)

        threads = [threading.Thread(target=safely, args=(bus, n)) for n, bus in enumerate(buses * 2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        for bus in buses:
            bus.close()
    assert not wrong


class Cut(PermitAll):
    """Ends all connections when the request with this number was carried out."""

    def __init__(self, at: int) -> None:
        self.left_to_go = at
        self.service: service.Service

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:  # noqa: ARG002
        self.left_to_go -= 1
        if self.left_to_go == 0:
            self.service.close("cut")


@pytest.mark.parametrize("at", range(1, 9))
@pytest.mark.parametrize("key", ONE_OF_EACH_FAMILY)
def test_a_client_that_goes_in_the_middle_of_a_change_of_id(key: str, at: int) -> None:
    """Whichever request was the last one: the servo has the old id or the new one, and the line serves the next."""
    gate = Cut(at + 1)  # the first read is that of the rig
    with Hosted({}, gate) as hosted:
        gate.service = hosted.service
        rig = RemoteRig(hosted, key, ids="1")
        with suppress(ServobusError):
            rig.bus[1].change_id(5)
        with suppress(PortError):
            rig.bus.close()
        wait_for(lambda: hosted.service.buses["bus0"].line.holder is None)
        gate.left_to_go = 0
        with hosted.bus("bus0") as bus:
            (found,) = bus.scan(family=rig.model.family, ids=range(8), bauds=factory_baud(rig.model))
            assert found.id == rig.reals[0].id
            assert found.id in (1, 5)
            found.read("present_position")


def test_what_a_program_was_doing_ends_with_port_lost_when_the_server_goes() -> None:
    with Hosted({}) as hosted:
        rig = RemoteRig(hosted, "rx28")
        hosted.told(lambda: hosted.service.close("the server ends"))
        with pytest.raises(PortLost, match="the server ends"):
            rig.read()
        rig.bus.reopen()
        rig.read()
        rig.bus.close()
        with pytest.raises(PortError, match="is closed"):
            rig.read()


def test_a_stop_breaks_off_what_this_program_does_and_nothing_else() -> None:
    """A procedure that holds the line is superseded at the server too, so that the stop has the line at once."""
    ping = MODELS["rx28"].family.ping(1)
    with Hosted({"arm": "virtual:rx28@1"}) as hosted, hosted.bus("arm") as bus:
        ended: list[BaseException] = []

        def long() -> Procedure[None]:
            yield ping
            yield Pause(30.0)

        def run() -> None:
            try:
                bus.do(long(), factory_baud(MODELS["rx28"]))
            except ServobusError as error:
                ended.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        line = hosted.service.buses["arm"].line
        wait_for(lambda: line.holder is not None)
        with bus._take_over(True) as (link, _, _):
            assert bus.link is link
        thread.join(PATIENCE)
        assert [type(error) for error in ended] == [Stopped]
        wait_for(lambda: line.holder is None)
        bus.do(ping)


def test_shared_pauses_let_others_have_the_line() -> None:
    with Hosted({}) as hosted:
        rig = RemoteRig(hosted, "rx28")
        line = hosted.service.buses["bus0"].line
        seen: list[bool] = []

        def resting() -> Procedure[None]:
            yield rig.model.family.ping(1)
            seen.append(line.holder is not None)
            yield Pause(0.01, shared=True)
            wait_for(lambda: line.holder is None)
            yield rig.model.family.ping(1)
            seen.append(line.holder is not None)

        rig.bus.do(resting())
        assert seen == [True, True]
        wait_for(lambda: line.holder is None)
        rig.bus.close()


def test_a_callback_of_a_job_may_use_the_bus() -> None:
    """What a callback asks goes with the hold of the job around it, which goes on afterwards."""
    with Hosted({}) as hosted:
        rig = RemoteRig(hosted, "rx28")
        line = hosted.service.buses["bus0"].line

        def inner() -> Procedure[None]:
            yield rig.model.family.ping(2)
            yield Pause(0.0, shared=True)  # it keeps the line: the job around it has it
            yield rig.model.family.ping(2)

        def outer() -> Procedure[bool]:
            yield rig.model.family.ping(1)
            holder = line.holder
            rig.bus.do(inner())
            rig.bus.do(rig.model.family.ping(3))
            yield rig.model.family.ping(1)
            return line.holder is holder is not None

        assert rig.bus.do(outer())
        rig.bus.close()
