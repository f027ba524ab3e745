"""The doctor on made-up systems and on virtual servos that have something wrong with them."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from samples import factory_bauds, sample_models
from servobus import DRS0602, FAMILIES, MODELS, RX28, Bus, connect, deg
from servobus.doctor import Finding, SearchPlan, Severity, examine
from servobus.doctor.findings import duplicate_id
from servobus.doctor.losses import count
from servobus.doctor.port import check_open_port, check_system
from servobus.errors import PortLost
from servobus.families import registry
from servobus.transports import usb_adapter as facts
from servobus.transports.usb_adapter import Adapter
from servobus.virtual.serve import inprocess
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from unit.scripted import Scripted

FACTORY = [(family, factory_bauds(family)) for family in FAMILIES.values()]


def told(findings: Iterator[Finding] | list[Finding]) -> dict[str, Finding]:
    """Give the findings by what was looked at; the last of each."""
    return {finding.check: finding for finding in findings}


def wrong(findings: Iterator[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.level in (Severity.WARN, Severity.FAIL)]


def visit(spec: str, reads: int = 10, ids: range = range(4), plan: SearchPlan | None = None) -> list[Finding]:
    return list(examine(f"virtual:{spec}", plan or SearchPlan(FACTORY, ids=ids, reads=reads)))


class Thinking(VirtualPort):
    """Takes 5 ms before each request, as a slow program does."""

    def write(self, data: bytes) -> None:
        self.sleep(0.005)
        super().write(data)


class TestPort:
    """What the system tells, on a made-up one."""

    @pytest.fixture
    def root(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        for folder in ("dev", "proc/4711/fd", "sys/class/tty/ttyUSB0/device", "sys/bus/usb-serial/devices/ttyUSB0"):
            (tmp_path / folder).mkdir(parents=True)
        (tmp_path / "dev/ttyUSB0").touch()
        (tmp_path / "dev/arm").symlink_to("ttyUSB0")
        (tmp_path / "proc/4711/cmdline").write_bytes(b"python3\0arm.py\0")
        (tmp_path / "sys/class/tty/ttyUSB0/device/driver").symlink_to("../drivers/ftdi_sio")
        (tmp_path / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").write_text("16\n")
        ftdi = Adapter("/dev/ttyUSB0", 0x0403, 0x6014, "FTDI", "USB <-> Serial", "FT1", "1-1.2")
        monkeypatch.setattr(facts, "adapters", lambda: [ftdi])
        monkeypatch.setattr("sys.platform", "linux")
        return tmp_path

    def test_that_is_not_there(self, root: Path) -> None:
        (finding,) = check_system("/dev/ttyUSB1", root)
        assert (finding.level, finding.check) == (Severity.FAIL, "port")
        assert finding.mend[0] == "servobus ports"

    def test_that_may_not_be_opened(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(os, "access", lambda *_: False)
        monkeypatch.setattr(facts, "_group", lambda _: ("dialout", False))
        (root / "dev/ttyUSB0").chmod(0o660)
        *_, finding = check_system("/dev/ttyUSB0", root)
        assert (finding.level, finding.check) == (Severity.FAIL, "permission")
        assert "group dialout" in finding.cause
        assert finding.mend == ("sudo usermod -aG dialout $USER",)
        monkeypatch.setattr(facts, "_group", lambda _: ("dialout", True))
        *_, finding = check_system("/dev/ttyUSB0", root)
        assert (finding.level, finding.mend) == (Severity.FAIL, ())
        assert "log out and in again" in finding.cause

    def test_that_another_program_has(self, root: Path) -> None:
        (root / "proc/4711/fd/3").symlink_to("/dev/ttyUSB0")
        finding = told(check_system("/dev/arm", root))["in use"]
        assert (finding.level, finding.what) == (Severity.FAIL, "by python3 arm.py (pid 4711)")
        assert finding.mend == ("kill 4711",)

    def test_with_a_slow_adapter(self, root: Path) -> None:
        findings = told(check_system("/dev/arm", root))
        assert findings["port"].what == "/dev/arm is a link to /dev/ttyUSB0"
        assert findings["in use"].level is Severity.OK
        assert findings["adapter"].what.endswith("(0403:6014) serial number FT1, driver ftdi_sio, at 1-1.2")
        timer = findings["latency timer"]
        assert (timer.level, timer.what) == (Severity.WARN, "16 ms")
        assert "some 62 reads a second" in timer.cause  # 1 / 16 ms
        assert timer.mend[0] == "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"
        assert all(len(line) <= 68 for command in timer.mend for line in command.splitlines())
        # The rule is the one line of udev, folded at its commas.
        rule = timer.mend[1].partition("'")[2].partition("'")[0].replace("\\\n  ", "")
        found = facts.adapter("/dev/ttyUSB0", root)
        assert found is not None
        assert rule == found.udev_rule

    def test_with_a_fast_adapter(self, root: Path) -> None:
        (root / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").write_text("1\n")
        assert wrong(check_system("/dev/arm", root)) == []

    def test_of_which_nothing_is_known(self, root: Path) -> None:
        assert list(check_system("virtual:rx28@1", root)) == []
        assert list(check_system("socket://robot:3333", root)) == []

    @pytest.mark.parametrize(("on", "level"), [(True, Severity.OK), (False, Severity.UNKNOWN)])
    def test_low_latency_mode(self, on: bool, level: Severity) -> None:
        port = Scripted()
        port.adapter = Adapter("/dev/ttyUSB0", driver="ftdi_sio", latency_timer=1)  # type: ignore[attr-defined]
        port.low_latency = on  # type: ignore[attr-defined]
        (finding,) = check_open_port(Bus(port))
        assert (finding.level, finding.check) == (level, "low latency")
        assert list(check_open_port(Bus(Scripted()))) == []

    def test_that_cannot_be_opened(self) -> None:
        *_, finding = examine("socket://127.0.0.1:1", SearchPlan(FACTORY))
        assert finding.level is Severity.FAIL
        assert "127.0.0.1:1: cannot be opened" in finding.what

    def test_that_is_lost_while_it_is_looked_at(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class MissedReply(Scripted):
            def write(self, data: bytes) -> None:
                raise PortLost(f"/dev/ttyUSB0: the port went away while writing {data.hex()}")

        monkeypatch.setattr(connect, "open", lambda _: Bus(MissedReply()))
        *_, finding = examine("virtual:rx28@1", SearchPlan(FACTORY))
        assert (finding.level, finding.check) == (Severity.FAIL, "port")
        assert "went away" in finding.what


class TestServos:
    @pytest.mark.parametrize("spec", ["rx28@1-3", "drs0602@1-3", "lx16a@1-3", "rx28@1,drs0602@1,lx16a@1"])
    def test_nothing_is_wrong_with_new_ones(self, spec: str) -> None:
        findings = visit(f"{spec}?clock=virtual")
        assert wrong(iter(findings)) == []
        assert [finding.check for finding in findings if finding.level is Severity.OK][:4] == [
            "echo", "servos", "speed", "ids",
        ]  # fmt: skip
        assert told(findings)["reads"].what.startswith("10, none lost; answers after median ")

    def test_echo(self) -> None:
        assert told(visit("rx28@1?clock=virtual&echo=on"))["echo"].what.startswith("the adapter hears what it sends")
        assert told(visit("rx28@1?clock=virtual"))["echo"].what == "none"

    def test_nobody(self) -> None:
        (finding,) = wrong(iter(visit("rx28@9?clock=virtual")))
        assert (finding.level, finding.check) == (Severity.FAIL, "servos")
        assert "no power" in finding.cause
        assert finding.mend == ("servobus doctor 'virtual:rx28@9?clock=virtual' --baud all",)

    def test_another_speed_is_found(self) -> None:
        dynamixel = FAMILIES["dynamixel"]
        plan = SearchPlan(
            FACTORY, [(dynamixel, (19_200,)), (dynamixel, (500_000,)), (dynamixel, (9_600,))], range(3), 0
        )
        findings = told(visit("rx28@1?clock=virtual&baud=500000", plan=plan))
        assert findings["speed"].what == f"dynamixel at 500000 (from the factory {RX28.factory_baud})"
        assert findings["speed"].cause == "other commands find them with --baud 500000"

    def test_different_speeds_on_one_wire(self, monkeypatch: pytest.MonkeyPatch) -> None:
        port = inprocess.connect("virtual:rx28@1-3?clock=virtual")
        Bus(port).find(3).change_baud(500_000)
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        plan = SearchPlan([(FAMILIES["dynamixel"], (57_600, 500_000))], ids=range(5), reads=30)
        findings = told(examine("virtual:", plan))
        assert (
            findings["speed"].what == f"dynamixel at 57600, dynamixel at 500000 (from the factory {RX28.factory_baud})"
        )
        assert findings["speed"].mend == (f"servobus set-baud '{port.name}' 3 57600 --family dynamixel --baud 500000",)
        assert findings["reads"].what.startswith("30, none lost")

    def test_one_that_speaks_protocol_2(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The question and its answer are those that the ROBOTIS e-manual prints on its page Protocol 2.0."""
        port = inprocess.connect("virtual:rx28@2?clock=virtual")
        question = bytes.fromhex("FF FF FD 00 FE 03 00 01 31 42")
        answers = [bytes.fromhex("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D")]
        write, read, asked = port.write, port.read, list[bytes]()

        def note_and_write(data: bytes) -> None:
            asked.append(data)
            write(data)

        def answer_or_read(timeout: float) -> bytes:
            if not (answers and question in asked):
                return read(timeout)
            port.sleep(0.01)  # as long as the bits take
            return answers.pop()

        monkeypatch.setattr(port, "write", note_and_write)
        monkeypatch.setattr(port, "read", answer_or_read)
        monkeypatch.setattr(connect, "open", lambda _: Bus(port, echo=False))
        plan = SearchPlan([(FAMILIES["dynamixel"], (57_600,))], ids=range(254), reads=0)
        (finding,) = wrong(examine("virtual:", plan))
        assert (finding.level, finding.check) == (Severity.WARN, "ids")
        assert finding.what.startswith(
            "id 1, model 1030 with firmware 38: Dynamixel protocol 2.0, not understood here; "
        )
        assert finding.cause == "a servo whose firmware speaks another protocol"

    @pytest.mark.parametrize(("spec", "id", "free"), [("drs0602@219,219", 219, 1), ("lx16a@1,1,2", 1, 3)])
    def test_two_with_one_id(self, monkeypatch: pytest.MonkeyPatch, spec: str, id: int, free: int) -> None:
        port = inprocess.connect(f"virtual:{spec}?clock=virtual")
        port.servos[0].turn_shaft(90 * deg)  # they answer at once; where the answers differ, they collide
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        (finding,) = wrong(examine("virtual:", SearchPlan(FACTORY, ids=[1, 2, 219], reads=0)))
        assert (finding.level, finding.check) == (Severity.FAIL, "ids")
        assert f"two servos with id {id}?" in finding.cause
        assert finding.mend == (f"servobus set-id '{port.name}' {id} {free}",)

    def test_two_with_one_id_that_only_reading_shows(self, monkeypatch: pytest.MonkeyPatch) -> None:
        # 90° is raw 0x133, 150° is 0x1FF: on the wire a 0 wins, so 0x133 is heard, and C6 & FA as its checksum. In a
        # longer block the checksums happen to agree, so the scan sees one servo.
        port = inprocess.connect("virtual:rx28@1,1,2?clock=virtual")
        port.servos[0].turn_shaft(90 * deg)
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        findings = wrong(examine("virtual:", SearchPlan(FACTORY, ids=range(4), reads=100)))
        ids = told(findings)["ids"]
        assert ids.what == "RX-28 id 1: its answers are garbled again and again"
        assert ids.mend == (f"servobus set-id '{port.name}' 1 3",)
        reads = told(findings)["reads"]
        assert reads.level is Severity.FAIL
        # 50 of 100 are for each; after 20 that are lost in a row id 1 is asked no more.
        assert reads.what.startswith("20 of 70 lost (28.6 %): 20 with a wrong checksum; worst is RX-28 id 1 with 20")

    @sample_models
    def test_two_with_one_id_that_answer_one_after_the_other(self, monkeypatch: pytest.MonkeyPatch, key: str) -> None:
        """F8: two answers to one question, each of them whole, are two servos and no refusal. A program
        takes a moment before it asks on; else it would talk over the second answer.
        """
        port = Thinking(f"virtual:{key}@1-2?clock=virtual", build_rig(parse_url(f"virtual:{key}@1-2")), real=False)
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))

        def watch(stage: str, done: int, total: int) -> None:
            if (stage, done) == ("reading", 1):
                port.inject("twin")

        findings = wrong(examine("virtual:", SearchPlan(FACTORY, ids=range(4), reads=40, models=key), watch))
        doubled = [one for one in findings if one.check == "ids"]
        title = MODELS[key].title
        assert [one.what for one in doubled] == [
            f"{title} id {id}: two answers come to one question again and again" for id in (1, 2)
        ]
        assert [one.mend for one in doubled] == [(f"servobus set-id '{port.name}' {id} {id + 2}",) for id in (1, 2)]
        assert "answered twice" in told(findings)["reads"].what
        assert "two servos with one id" in told(findings)["reads"].cause

    def test_two_with_one_id_that_answer_the_search_one_after_the_other(self, monkeypatch: pytest.MonkeyPatch) -> None:
        port = Thinking("virtual:lx16a@1-2?clock=virtual", build_rig(parse_url("virtual:lx16a@1-2")), real=False)
        port.inject("twin")
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        (finding,) = wrong(examine("virtual:", SearchPlan(FACTORY, ids=[1, 2], reads=0)))
        assert "two answers came" in finding.what
        assert finding.cause.startswith("two servos with id 2?")
        assert finding.mend == (f"servobus set-id '{port.name}' 2 3",)

    def test_one_that_answers_nothing(self) -> None:
        port = inprocess.connect("virtual:rx28@1?clock=virtual")
        bus = Bus(port)
        bus.find(1).write(RX28.status_return_level, 0)
        from servobus.doctor.search import search  # noqa: PLC0415 - the stage under test

        (finding,) = wrong(search(bus, SearchPlan(FACTORY, ids=[1]), lambda *_: None))
        assert finding.mend == (f"servobus write '{port.name}' 1 status_return_level=2",)


class TestHealth:
    @pytest.mark.parametrize(
        ("spec", "level", "words"),
        [
            # RX-28 manual 1-3: 12 to 16 V; 3-4-1: the limits are 6.0 and 24.0 V from the factory.
            ("rx28@1-2?voltage=9", Severity.WARN, "RX-28 ids 1, 2: 9.0 V is outside 12.0 V .. 16.0 V, what its maker"),
            ("rx28@1-2?voltage=5", Severity.FAIL, "RX-28 ids 1, 2: 5.0 V is outside 6.0 V .. 24.0 V, the limits set"),
            # DRS-0602 manual 4-2: 9.5 V is the lowest from the factory.
            ("drs0602@1?voltage=8", Severity.FAIL, "DRS-0602 id 1: 8.0 V is outside 9.5 V .. 17.0 V, the limits set"),
            # The protocol document, point 12: 6500 mV is the lowest from the factory.
            (
                "lx16a@1?voltage=6",
                Severity.FAIL,
                "LX/HTS bus servo, model unknown, id 1: 6.0 V is outside 6.5 V .. 12.0 V, the limits set in it",
            ),
        ],
    )
    def test_voltage(self, spec: str, level: Severity, words: str) -> None:
        finding = told(visit(f"{spec}&clock=virtual"))["voltage"]
        assert finding.level is level
        assert finding.what.startswith(words)
        assert "supply" in finding.cause

    @pytest.mark.parametrize(
        ("spec", "limit", "level"),
        [
            ("rx28@1-2?temperature=75", 80, Severity.WARN),
            ("rx28@1-2?temperature=90", 80, Severity.FAIL),
            ("lx16a@1-2?temperature=80", 85, Severity.WARN),
        ],
    )
    def test_temperature(self, spec: str, limit: int, level: Severity) -> None:
        finding = told(visit(f"{spec}&clock=virtual"))["temperature"]
        assert finding.level is level
        assert finding.what.endswith(f"where {limit} °C is the limit set in it")
        (command,) = finding.mend
        assert command.startswith("for id in 1 2; do servobus torque 'virtual:")
        assert command.endswith(" $id off; done")

    def test_errors_that_stay(self, monkeypatch: pytest.MonkeyPatch) -> None:
        port = inprocess.connect("virtual:drs0602@1-2?clock=virtual&temperature=95")
        port.sleep(1.0)  # the firmware needs a while to notice
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        finding = told(examine("virtual:", SearchPlan(FACTORY, ids=[1, 2], reads=0)))["errors"]
        assert (finding.level, finding.what) == (Severity.FAIL, "DRS-0602 ids 1, 2: temperature")
        clear, rearm = finding.mend
        assert clear.endswith("$id status_error=0 status_detail=0; done")
        assert rearm == f"for id in 1 2; do servobus rearm '{port.name}' $id; done"
        assert "rearm clears it too and switches the torque on" in finding.cause

    def test_the_error_that_a_search_may_cause(self) -> None:
        # The PING of a Dynamixel with id 7, FF FF 07 02 01 F5, is the start of a packet for a HerkuleX with id 2.
        plan = SearchPlan([(FAMILIES[name], (115_200,)) for name in ("dynamixel", "herkulex")], ids=range(12), reads=0)
        finding = told(visit("drs0602@2?clock=virtual", plan=plan))["errors"]
        assert (finding.level, finding.what) == (Severity.WARN, "DRS-0602 id 2: invalid_packet")
        assert "meant for another family" in finding.cause

    def test_errors_that_end_with_their_cause(self) -> None:
        finding = told(visit("rx28@1?clock=virtual&voltage=5"))["errors"]
        assert (finding.level, finding.what, finding.mend) == (Severity.FAIL, "RX-28 id 1: input_voltage", ())

    def test_a_shutdown(self, monkeypatch: pytest.MonkeyPatch) -> None:
        port = inprocess.connect("virtual:rx28@1?clock=virtual")
        Bus(port).find(1).write(RX28.torque_limit, 0.0)
        monkeypatch.setattr(connect, "open", lambda _: Bus(port))
        finding = told(examine("virtual:", SearchPlan(FACTORY, ids=[1], reads=0)))["errors"]
        assert finding.level is Severity.FAIL
        assert finding.what == "RX-28 id 1: the torque limit is 0, so nothing moves"
        assert "rearm switches the torque on" in finding.cause
        assert finding.mend == (f"servobus rearm '{port.name}' 1",)

    def test_servos_that_cannot_be_asked_for_errors(self) -> None:
        errors = [finding for finding in visit("rx28@1,lx16a@2?clock=virtual") if finding.check == "errors"]
        assert [(finding.level, finding.what) for finding in errors] == [
            (Severity.OK, "none"),
            (Severity.UNKNOWN, "LX/HTS bus servo, model unknown cannot be asked for them"),
        ]


class Lossy(VirtualPort):
    """Swallows every tenth READ_DATA from when it is told to."""

    requests = 0
    lossy = False

    def write(self, data: bytes) -> None:
        reads = self.lossy and data[4] == 0x02
        self.requests += reads
        if not reads or self.requests % 10:
            super().write(data)


class TestLosses:
    @pytest.fixture
    def port(self) -> Lossy:
        plain = inprocess.connect("virtual:rx28@1-2?clock=virtual&answer_time=off")
        return Lossy(plain.name, plain.rig, real=False)

    def test_are_counted_and_not_asked_again(self, port: Lossy) -> None:
        bus = Bus(port)
        servos = bus.scan(ids=[1, 2], family="dynamixel", bauds=[57_600])
        port.lossy = True
        tally = count(bus, servos, 98)
        # 49 reads of each, of which the 10th, 20th ... 90th are swallowed.
        assert port.requests == 98
        assert (tally.reads, tally.lost) == (98, {"silent": 9})
        assert {servo.id: lost.total() for servo, lost in tally.by_servo.items()} == {1: 4, 2: 5}
        # 8 bytes out, 500 µs return delay, 8 bytes back at 2 Mbit/s / 35 (RX-28 manual 3-4-1)
        assert tally.quantile(0.5) == pytest.approx(80 / 57_600 + 500e-6 + 80 * 35 / 2e6, abs=50e-6)

    def test_make_a_finding(self, port: Lossy, monkeypatch: pytest.MonkeyPatch) -> None:
        bus = Bus(port)
        monkeypatch.setattr(connect, "open", lambda _: bus)
        seen: list[tuple[str, int, int]] = []

        def watch(stage: str, done: int, total: int) -> None:
            seen.append((stage, done, total))
            port.lossy = stage == "reading"

        finding = told(examine("virtual:", SearchPlan(FACTORY, ids=[1, 2], reads=200), watch))["reads"]
        assert finding.level is Severity.FAIL
        assert " of 200 lost" in finding.what
        assert "silent" in finding.what
        assert "loose plug" in finding.cause
        assert seen[0] == ("scanning", 1, 2 * sum(len(bauds) for _, bauds in FACTORY))  # two ids
        assert seen[-1] == ("reading", 200, 200)


@pytest.mark.parametrize(
    ("spec", "where", "harmless"),
    [
        # Dynamixel: PING and READ_DATA (RX-28 manual 3-5). HerkuleX: EEP_READ, RAM_READ, STAT (manual chapter 6).
        ("rx28@1", 4, {0x01, 0x02}),
        ("drs0602@1", 4, {0x02, 0x04, 0x07}),
        # LX-16A: all the READ commands, by their numbers in the manual's table.
        ("lx16a@1", 4, {2, 8, 14, 19, 21, 23, 25, 26, 27, 28, 30, 32, 34, 36}),
    ],
)
def test_only_asks(monkeypatch: pytest.MonkeyPatch, spec: str, where: int, harmless: set[int]) -> None:
    sent: list[bytes] = []
    write = VirtualPort.write

    def record(self: VirtualPort, data: bytes) -> None:
        sent.append(data.removeprefix(b"\x00"))  # which finds out whether there is an echo
        write(self, data)

    monkeypatch.setattr(VirtualPort, "write", record)
    servo = connect.open(f"virtual:{spec}?clock=virtual").find(1)
    sent.clear()
    visit(
        f"{spec}?clock=virtual&voltage=9&temperature=70", plan=SearchPlan([(servo.family, (servo.baud,))], ids=range(3))
    )
    assert len(sent) > 1000
    assert {request[where] for request in sent} <= harmless


def test_the_limits_have_one_name_in_all_models() -> None:
    assert RX28.register("min_voltage") is RX28.lowest_limit_voltage
    assert RX28.register("max_temperature") is RX28.highest_limit_temperature
    assert DRS0602.register("min_voltage") is DRS0602.min_voltage


class TestNoise:
    """N15, and the part of N13 that is doctor's."""

    def test_N15_many_garbled_ids_are_noise(self) -> None:
        findings = visit("rx28@1-4?clock=virtual&faults=flip=0.9", reads=200)
        ids = [finding for finding in findings if finding.check == "ids"]
        assert ids
        assert all("noise" in finding.cause or "more" in finding.what for finding in ids)
        assert not any(mend.startswith("servobus set-id") for finding in findings for mend in finding.mend)

    def test_N15_no_id_is_offered_that_something_answers_at(self) -> None:
        taken = {1, 2, 3}
        offered = [duplicate_id("P", "", (registry.family("dynamixel"), id, 57_600), taken).mend[0] for id in (1, 2)]
        assert offered == ["servobus set-id P 1 4", "servobus set-id P 2 5"]
        full = set(range(254))
        assert duplicate_id("P", "", (registry.family("dynamixel"), 7, 57_600), full).mend == ()

    def test_N13_an_id_of_two_families_is_told_as_what_it_is(self) -> None:
        found = told(visit("rx28@1,lx16a@1?clock=virtual"))["ids"]
        assert found.level is Severity.OK
        assert "id 1 is that of RX-28 and LX/HTS bus servo, model unknown: --family tells which is meant" in found.what

    def test_T10_a_servo_for_another_supply_is_judged_by_its_own_limits(self) -> None:
        # A high-voltage servo of the LX series at three cells; the protocol takes limits up to 12 V (point 12).
        assert told(visit("lx16a@1?clock=virtual&voltage=11.1"))["voltage"].level is Severity.OK


def test_N13_families_are_asked_in_the_order_of_a_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """At one speed those come first whose requests are spoiled by those to others: the slowest speed first."""
    asked: list[tuple[int, bool]] = []
    write = VirtualPort.write

    def noted(self: VirtualPort, data: bytes) -> None:
        asked.append((self.baud, data.startswith(b"\xff\xff\x07")))  # a STAT, DRS-0602 manual 6-7
        write(self, data)

    monkeypatch.setattr(VirtualPort, "write", noted)
    visit("rx28@9", plan=SearchPlan([(one, (115_200, 57_600)) for one in FAMILIES.values()], ids=range(2), reads=1))
    assert list(dict.fromkeys(asked)) == [(57_600, True), (57_600, False), (115_200, True), (115_200, False)]


def test_N15_nobody_is_to_be_ended_who_uses_what_is_no_port(tmp_path: Path) -> None:
    plain = tmp_path / "notes.txt"
    plain.write_text("nothing")
    with plain.open() as held:
        assert not held.closed
        for port in ("/dev/null", str(plain)):
            said = list(check_system(port))
            assert said
            assert not any("kill" in str(finding) for finding in said)
