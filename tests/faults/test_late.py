"""Late is not silent: servos whose answers come later than they were waited for are found, and it is said (T8)."""

import json
import re
from typing import Any

import pytest

from drivers import result_of
from samples import goal_range, one_model_of_each_family
from servobus import MODELS, Bus, NoReply
from servobus.bus.asyncio import AsyncBus
from servobus.doctor import Finding, SearchPlan, Severity, examine
from servobus.families import registry
from servobus.jobs.scan import LATE
from servobus.transports.serial_port import LATENCY, NETWORK_LATENCY
from servobus.virtual.serve.inprocess import VirtualPort, connect
from unit.cli.conftest import load, run  # noqa: F401 - fixtures
from unit.lossy import ASYNC, CHOSEN_DRIVERS, DRIVERS

DELAYS = ["40ms", "100ms", "200ms", "280ms"]


def late_port(servos: str, delay: str, latency: float = LATENCY) -> VirtualPort:
    """A port whose answers are late, and that tells no more of that than a usual adapter does."""
    port = connect(f"virtual:{servos}?clock=virtual&faults=latency={delay}")
    port.latency = latency
    return port


def bus_on(port: VirtualPort, driver: str, **options: Any) -> Any:
    return (AsyncBus if driver == ASYNC else Bus)(port, **options)


@CHOSEN_DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("delay", DELAYS)
def test_F11_T8_a_scan_finds_all(key: str, delay: str, driver: str) -> None:
    """Few ids or all, the servo first or last, alone or among others."""
    for servos, ids in (
        (f"{key}@1-4", range(8)),
        (f"{key}@3", [3]),
        (f"{key}@253", range(254)),
        (f"{key}@0", range(99)),
    ):
        port = late_port(servos, delay)
        bus = bus_on(port, driver)
        found = result_of(bus.scan(family=MODELS[key].family, ids=ids))
        assert sorted(servo.id for servo in found) == [servo.id for servo in port.servos]
        assert not bus.survey.troubles
        assert bus.survey.late == pytest.approx(float(delay.removesuffix("ms")) / 1000, rel=0.2)


@DRIVERS
@pytest.mark.parametrize("delay", DELAYS)
def test_T8_a_scan_finds_all_families(delay: str, driver: str) -> None:
    port = late_port("rx28@1,2,drs0602@4,lx16a@7", delay)
    found = result_of(bus_on(port, driver, models="lx16a").scan(ids=range(10)))
    assert sorted((servo.model.key(), servo.id) for servo in found) == [
        ("drs0602", 4), ("lx16a", 7), ("rx28", 1), ("rx28", 2),
    ]  # fmt: skip


@DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("delay", DELAYS)
def test_F11_T8_one_servo_is_found_and_read(key: str, delay: str, driver: str) -> None:
    port = late_port(f"{key}@5", delay)
    bus = bus_on(port, driver)
    servo = result_of(bus.find(5))
    row = servo.model.register("present_position")
    low, high = goal_range(servo.model)
    for share in (0.3, 0.6, 0.4):
        angle = row.decode(low + round(share * (high - low)))
        port.servos[0].turn_shaft(angle)
        assert result_of(servo.read(row)) == pytest.approx(angle)


@DRIVERS
def test_T8_a_silent_line_costs_little_more(driver: str) -> None:
    """The scan of a line on which nobody answers listens once, at its end."""
    port = connect("virtual:rx28@1?clock=virtual&baud=1000000")
    port.latency = LATENCY
    bus = bus_on(port, driver)
    assert result_of(bus.scan(family="dynamixel", bauds=57600)) == []
    batches = 254 / 32
    assert port.now() < 254 * 0.006 + (batches + 2) * LATENCY + LATE + 0.05
    start = port.now()
    with pytest.raises(NoReply):
        result_of(bus.find(7))
    assert port.now() - start < 1.0


@DRIVERS
def test_T8_who_is_prompt_is_not_waited_for(driver: str) -> None:
    """Once an answer has come the link knows how long they take."""
    port = connect("virtual:rx28@1?clock=virtual")
    port.latency = LATENCY
    bus = bus_on(port, driver)
    result_of(bus.scan(family="dynamixel", ids=range(4)))
    start = port.now()
    assert bus.survey.late == 0
    with pytest.raises(NoReply):
        result_of(bus.find(9, family="dynamixel"))
    assert port.now() - start < LATE


@one_model_of_each_family
@pytest.mark.parametrize("delay", ["40ms", "200ms"])
def test_T8_doctor_names_the_lateness(key: str, delay: str, monkeypatch: pytest.MonkeyPatch) -> None:
    port = late_port(f"{key}@1-2", delay)
    monkeypatch.setattr("servobus.connect.transport", lambda *_: port)
    family = MODELS[key].family
    plan = SearchPlan([(family, registry.factory_bauds(family))], ids=range(1, 5), reads=10)
    findings: dict[str, Finding] = {one.check: one for one in examine("virtual:late", plan)}
    late = findings["lateness"]
    assert late.level is Severity.WARN
    milliseconds = int(late.what.removeprefix("answers come ").removesuffix(" ms late"))
    assert milliseconds == pytest.approx(int(delay.removesuffix("ms")), rel=0.2)
    assert "ids 1, 2" in findings["servos"].what
    assert findings["reads"].what.startswith("10, none lost")
    assert not any(one.level is Severity.FAIL for one in findings.values())


def test_T8_the_command_line_says_so(run: Any, load: Any, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr(VirtualPort, "_tell_latency", lambda port: setattr(port, "latency", LATENCY))
    url = "virtual:rx28@1-2,lx16a@7?clock=virtual&faults=latency=40ms"
    said = run("scan", url, "--ids", "0-9")
    assert said.stdout.count("\n") == 3
    assert re.search(r"answers come (3|4)\d ms late; waited longer", said.stderr)
    assert len(load("scan", url, "--ids", "0-9")) == 3
    assert load("read", url, 2, "id")["id"]["value"] == 2
    assert any(
        "late" in one["what"] for one in json.loads(run("doctor", url, "--ids", "0-9", "--reads", "9", "--json").stdout)
    )


def test_T8_a_network_is_given_more_time() -> None:
    """A round trip of 200 ms is nothing unusual there: the first question is answered."""
    port = late_port("rx28@1", "200ms", NETWORK_LATENCY)
    bus = Bus(port)
    bus.attach(MODELS["rx28"], 1).ping()
    assert bus.stats.total.timeouts == 0


def stand_still(port: VirtualPort, *stalls: tuple[bytes, float]) -> None:
    """Hold what is sent from these bytes on for some seconds, and then send it on at once: a busy computer."""
    write, read, sleep = port.write, port.read, port.sleep
    held: list[bytes] = []
    until = [-1.0]
    to_come = dict(stalls)

    def go_on() -> None:
        if held and port.now() >= until[0]:
            write(b"".join(held))
            held.clear()

    def writing(data: bytes) -> None:
        go_on()
        for first in [first for first in to_come if first in data]:
            until[0] = max(until[0], port.now() + to_come.pop(first))
        if port.now() < until[0]:
            held.append(data)
        else:
            write(data)

    def reading(timeout: float) -> bytes:
        if held and (left := until[0] - port.now()) < timeout:
            heard = read(max(left, 0.0))
            go_on()
            return heard or read(max(timeout - max(left, 0.0), 0.0))
        return read(timeout)

    def sleeping(seconds: float) -> None:
        end = port.now() + seconds
        if held and until[0] < end:
            sleep(max(until[0] - port.now(), 0.0))
            go_on()
        sleep(max(end - port.now(), 0.0))

    port.write, port.read, port.sleep = writing, reading, sleeping  # type: ignore[method-assign]


@pytest.mark.parametrize("seconds", [0.0, 0.005, 0.010, 0.020, 0.040])
@one_model_of_each_family
def test_T8_a_scan_finds_those_whose_questions_piled_up(key: str, seconds: float) -> None:
    """A computer that stands still sends several questions at once, so that answers meet; a late one tells of it."""
    port = connect(f"virtual:{key}@1-15?clock=virtual")
    ping = MODELS[key].family.ping
    stand_still(port, (ping(1).request, seconds), (ping(15).request, 0.005))
    bus = Bus(port)
    assert [servo.id for servo in bus.scan(family=MODELS[key].family, ids=range(16))] == [*range(1, 16)]
    assert not bus.survey.troubles


@one_model_of_each_family
def test_T8_a_prompt_line_is_scanned_once(key: str) -> None:
    """Once at each speed that the models of a family have from the factory."""
    port = connect(f"virtual:{key}@1,3?clock=virtual")
    asked: list[bytes] = []
    write = port.write
    port.write = lambda data: (asked.append(data), write(data))[1]  # type: ignore[method-assign,func-returns-value]
    bus = Bus(port)
    assert len(bus.scan(family=MODELS[key].family, ids=range(8))) == 2
    silent = MODELS[key].family.ping(5).request
    assert sum(data.count(silent) for data in asked) == len(registry.factory_bauds(MODELS[key].family))
