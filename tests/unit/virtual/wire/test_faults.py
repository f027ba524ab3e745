"""Every kind of fault, by the bytes that come and the times at which they come.

The packets are those of the manuals: RX-28 PING and its answer (3-5-5), HerkuleX EEP_READ of two gains (6-1), LX-16A
ID read (built from its manual, 3 and 8). Times are counted by hand: a byte lasts ten bits, an RX-28 at "57600" sends
2 Mbit/s / 35, and its answer begins 500 µs (Return Delay Time 250, 3-4-1) behind the request's last bit.
"""

import itertools
import re
from pathlib import Path
from typing import Any

import pytest

from samples import one_model_of_each_family, sample_of
from servobus.errors import BadValue, PortLost
from servobus.families.registry import DRS0602
from servobus.virtual.serve.inprocess import VirtualPort, connect
from servobus.virtual.serve.rig import Rig
from servobus.virtual.wire.faults import KINDS, SETTINGS, Fault, Faults, Which, explain

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
FAMILIES = {
    "rx28@1": (PING, PONG),
    "drs0602@253": (
        bytes.fromhex("FF FF 09 FD 02 EC 12 1E 04"),
        bytes.fromhex("FF FF 0F FD 42 4C B2 1E 04 B8 01 40 1F 00 00"),
    ),
    "lx16a@1": (bytes.fromhex("55 55 01 03 0E ED"), bytes.fromhex("55 55 01 04 0E 01 EB")),
}
BYTE_OUT, BYTE_BACK = 10 / 57600, 10 * 35 / 2e6
"""s of a byte from the client, and from an RX-28 at its factory speed."""
BEGIN = 6 * BYTE_OUT + 500e-6
"""s until the answer to a PING begins."""
QUIET = 0.03

every_family = pytest.mark.parametrize("servos", FAMILIES)


def equip(rig: Rig) -> None:
    """Give a DRS-0602 the gains of the manual's example."""
    for servo in rig.servos:
        if servo.model is DRS0602:
            servo.memory.store(DRS0602.position_kp, 440)
            servo.memory.store(DRS0602.position_kd, 8000)


def port(faults: str | Faults | None = None, servos: str = "rx28@1", options: str = "") -> VirtualPort:
    made = connect(f"virtual:{servos}?clock=virtual&as=manual&boot_time=off{options}")
    equip(made.rig)
    made.inject(faults)
    return made


def ask(client: VirtualPort, request: bytes = PING, quiet: float = QUIET) -> bytes:
    """Send a request and give all that comes until the line is quiet."""
    client.write(request)
    heard = b""
    while chunk := client.read(quiet):
        heard += chunk
    return heard


def timed(client: VirtualPort, request: bytes = PING, quiet: float = QUIET) -> list[tuple[Any, bytes]]:
    """Do the same; give the pieces with their times from the beginning of the request on."""
    start, pieces = client.now(), []
    client.write(request)
    while chunk := client.read(quiet):
        pieces.append((pytest.approx(client.now() - start, abs=1e-7), chunk))
    return pieces


def replies(faults: str, count: int = 3, options: str = "") -> list[str]:
    client = port(faults, options=options)
    return [ask(client).hex(" ").upper() for _ in range(count)]


GOOD = "FF FF 01 02 00 FC"
OURS = "FF FF 01 02 01 FB"


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ("drop@3", ["FF FF 01 00 FC"] * 3),
        ("drop@0#2", [GOOD, "FF 01 02 00 FC", GOOD]),
        ("drop@6", [GOOD] * 3),  # there is no such byte
        ("flip@12", ["FF EF 01 02 00 FC"] * 3),
        ("flip@12#2-", [GOOD, "FF EF 01 02 00 FC", "FF EF 01 02 00 FC"]),
        ("flip@47#1-2", ["FF FF 01 02 00 7C", "FF FF 01 02 00 7C", GOOD]),
        ("flip@0,flip@8,drop@5", ["FE FE 01 02 00"] * 3),
        ("junk@before:0xFFFF", ["FF FF " + GOOD] * 3),
        ("junk@inside#3:0x55", None),
        ("junk@after:0x5555", [GOOD + " 55 55"] * 3),
        ("junk@2:0xFF", ["FF FF FF 01 02 00 FC"] * 3),
        ("stranger@5#2", [GOOD, "FF FF 05 02 00 F8", GOOD]),
        ("mute#2", [GOOD, "", GOOD]),
        ("deaf#2", [GOOD, "", GOOD]),
        ("glue#1", ["", GOOD + " " + GOOD, GOOD]),
        ("glue#1:10ms", [GOOD, GOOD, GOOD]),
        ("late#1:40ms", ["", GOOD + " " + GOOD, GOOD]),
        ("twin#2", [GOOD, GOOD + " " + GOOD, GOOD]),
        ("echo#2", [GOOD, OURS + " " + GOOD, GOOD]),
        ("echo@part#2:4", [GOOD, "FF FF 01 02 " + GOOD, GOOD]),
        ("unplug@1#2", [GOOD, "", GOOD]),
        ("unplug@2-9#2", [GOOD] * 3),
        ("unplug@1#2-", [GOOD, "", ""]),
        ("reboot#2:1ms", [GOOD, GOOD, GOOD]),  # it is back before the request is over
        ("reboot#2:10ms", [GOOD, "", GOOD]),
        ("skew@1=-5%", ["", "", ""]),  # 3 % is what a receiver takes (3-4-1)
        ("skew@2-9=-5%", [GOOD] * 3),
        ("split@3", [GOOD] * 3),
        ("stall:20ms", [GOOD] * 3),
        ("latency=16ms jitter=8ms", [GOOD] * 3),
        ("drop=0,mute=0,deaf=0,junk=0", [GOOD] * 3),
    ],
)
def test_bytes(faults: str, expected: list[str] | None) -> None:
    heard = replies(faults)
    if expected is None:  # somewhere inside the third
        assert heard[:2] == [GOOD, GOOD]
        assert re.sub(" 55", "", heard[2], count=1) == GOOD
        assert heard[2].startswith("FF ")
        assert heard[2].endswith(" FC")
    else:
        assert heard == expected


def test_echo_of_a_line_that_has_one() -> None:
    assert replies("echo@none#2", options="&echo=on") == [f"{OURS} {GOOD}", GOOD, f"{OURS} {GOOD}"]
    assert replies("echo@part#1:1,deaf#1", options="&echo=on") == ["FF", f"{OURS} {GOOD}", f"{OURS} {GOOD}"]
    bad = bytes.fromhex(replies("echo@bad:2", count=1)[0])
    assert bad[:2] + bad[3:] == (PING + PONG)[:2] + (PING + PONG)[3:]
    assert (bad[2] ^ PING[2]).bit_count() == 1


@every_family
def test_every_byte_dropped(servos: str) -> None:
    request, reply = FAMILIES[servos]
    assert ask(port(servos=servos), request) == reply
    for k in range(len(reply)):
        assert ask(port(f"drop@{k}", servos), request) == reply[:k] + reply[k + 1 :]


@every_family
def test_every_bit_flipped(servos: str) -> None:
    request, reply = FAMILIES[servos]
    client = port(servos=servos)
    for bit in range(8 * len(reply)):
        client.inject(f"flip@{bit}")
        heard = ask(client, request)
        assert int.from_bytes(heard, "little") ^ int.from_bytes(reply, "little") == 1 << bit


@every_family
def test_two_bits_that_the_checksum_does_not_see(servos: str) -> None:
    request, reply = FAMILIES[servos]
    client, sample = port("pair", servos), sample_of(servos.partition("@")[0])
    seen = set()
    for _ in range(50):
        heard = ask(client, request)
        changed = [bit for bit in range(8 * len(reply)) if (heard[bit // 8] ^ reply[bit // 8]) >> bit % 8 & 1]
        assert len(heard) == len(reply)
        assert len(changed) == 2
        assert changed[0] % 8 == changed[1] % 8
        assert sample.fits(heard)
        seen.add(tuple(changed))
    assert len(seen) > 5


@every_family
def test_a_stranger_has_a_right_checksum(servos: str) -> None:
    request, reply = FAMILIES[servos]
    client, sample = port("stranger", servos), sample_of(servos.partition("@")[0])
    for _ in range(20):
        heard = ask(client, request)
        assert sample.fits(heard)
        assert heard[sample.id_at] != reply[sample.id_at]
        assert heard[sample.id_at] <= 253
        assert len(heard) == len(reply)


def test_junk_as_much_as_asked_for_with_headers_in_it() -> None:
    client = port("junk:1-64")
    sizes, junk = set(), b""
    for _ in range(200):
        heard = ask(client)
        sizes.add(len(heard) - len(PONG))
        junk += heard
    assert min(sizes) >= 1
    assert max(sizes) <= 64
    assert len(sizes) > 40
    assert junk.count(b"\xff\xff") > 400
    places = {re.sub(r"\d+", "N", one.where) for one in client.rig.injected}
    assert places == {"N bytes before", "N bytes before byte N", "N bytes after"}


# Times


def test_split() -> None:
    third = BEGIN + 3 * BYTE_BACK
    assert timed(port("split@3:5ms")) == [(third, PONG[:3]), (third + BYTE_BACK + 0.005, PONG[3:])]


def test_stall_holds_up_all_that_comes_behind() -> None:
    client = port("stall#1:50ms", "rx28@1-2")
    start = client.now()
    client.write(PING)
    assert client.read(0.02) == b""
    client.write(bytes.fromhex("FF FF 02 02 01 FA"))
    assert client.read(1.0) == PONG + bytes.fromhex("FF FF 02 02 00 FB")
    assert client.now() - start == pytest.approx(BEGIN + BYTE_BACK + 0.05, abs=1e-7)


def test_late_replies_are_overtaken_and_never_mixed_in() -> None:
    """The second answer is on the wire from 21.542 ms to 22.592 ms; the first would be let in at 22.1 ms."""
    client = port(f"late#1:{0.0221 - BEGIN - 6 * BYTE_BACK:.7f}s", "rx28@1-2")
    client.write(PING)
    assert client.read(0.02) == b""
    client.write(bytes.fromhex("FF FF 02 02 01 FA"))
    assert client.read(1.0) == bytes.fromhex("FF FF 02 02 00 FB") + PONG
    assert client.now() == pytest.approx(0.02 + BEGIN + 6 * BYTE_BACK, abs=1e-7)


def test_latency_hands_over_a_piece_at_a_time() -> None:
    first = BEGIN + BYTE_BACK + 0.0004  # bytes 1, 2 and 3 come within 0.4 ms, the others within the next
    second = BEGIN + 4 * BYTE_BACK + 0.0004
    assert timed(port("latency=0.4ms")) == [(first, PONG[:3]), (second, PONG[3:])]
    assert timed(port("latency=16ms")) == [(BEGIN + BYTE_BACK + 0.016, PONG)]


def test_reading_ends_where_rounding_is_as_long_as_a_bit() -> None:
    client = port("split=0.5:1ms")
    client.sleep(56490591.1)  # 650 days: a clock of 64 bits has steps of 7 ns there
    start = client.now()
    assert sum(ask(client)[:2] == b"\xff\xff" for _ in range(50)) >= 40
    assert client.now() - start > 50 * QUIET


def test_jitter_is_drawn_for_each_reply() -> None:
    client, waits = port("latency=2ms,jitter=4ms"), []
    for _ in range(200):
        start = client.now()
        assert ask(client, quiet=0.01) == PONG
        waits.append(client.now() - 0.01 - start - BEGIN - BYTE_BACK)
    assert min(waits) >= 0.002 - 1e-9
    assert max(waits) <= 0.006 + 1e-9
    assert max(waits) - min(waits) > 0.0035
    assert port("latency=2ms,jitter=4ms").latency == pytest.approx(port().latency + 0.006)


def test_skew_shortens_bytes() -> None:
    assert timed(port("skew=2%"))[-1][0] == BEGIN + 6 * BYTE_BACK / 1.02


def test_twins_overlap_bit_by_bit() -> None:
    """The wire is the AND of what is sent: the same at once is one answer, the same a little later is none."""
    assert ask(port("twin:0s")) == PONG
    assert ask(port("twin:2ms")) == PONG + PONG
    overlapped = ask(port("twin:0.2ms"))
    assert overlapped != PONG
    assert not overlapped.startswith(PONG)


def test_two_servos_with_one_id() -> None:
    """ID 1 twice, with other temperatures: the answers collide (RX-28 manual 3-5-1, example)."""
    client = port(servos="rx28@1,rx28@1")
    client.servos[0].temperature, client.servos[1].temperature = 32, 65
    read = bytes.fromhex("FF FF 01 04 02 2B 01 CC")
    # 32 is 20 and 65 is 41: together 00; checksums DB and BA: together 9A.
    assert ask(client, read) == bytes.fromhex("FF FF 01 03 00 00 9A")


# Servos and the port


def test_a_reboot_loses_the_ram() -> None:
    torque_on = bytes.fromhex("FF FF 01 04 03 18 01 DE")
    read_torque = bytes.fromhex("FF FF 01 04 02 18 01 DF")
    client = port("reboot@1#3:0.1ms")
    assert ask(client, torque_on) == PONG
    assert ask(client, read_torque) == bytes.fromhex("FF FF 01 03 00 01 FA")
    assert ask(client, read_torque) == bytes.fromhex("FF FF 01 03 00 00 FB")


def test_reboot_and_outage_by_the_clock() -> None:
    client = port("unplug@2#1s-2s,reboot@1#1.5s:100ms", "rx28@1-2")
    ping2, pong2 = bytes.fromhex("FF FF 02 02 01 FA"), bytes.fromhex("FF FF 02 02 00 FB")
    there = []
    for moment in (0.9, 1.1, 1.45, 1.55, 1.7, 1.9, 2.1):
        client.sleep(moment - client.now())
        there.append((ask(client) == PONG, ask(client, ping2) == pong2))
    yes, no = True, False
    assert there == [(yes, yes), (yes, no), (yes, no), (no, no), (yes, no), (yes, no), (yes, yes)]
    assert [(one.kind, one.number, one.where, one.time) for one in client.rig.injected] == [
        ("unplug", 0, "ids 2", 1.0),
        ("reboot", 0, "ids 1", 1.5),
    ]


def test_a_cut_chain_and_one_servo_by_chance() -> None:
    client = port("unplug@3-9#1-6", "rx28@1-5")
    answered = [bool(ask(client, b"\xff\xff%c\x02\x01%c" % (id, 252 - id))) for id in (1, 2, 3, 4, 5, 1, 3, 5)]
    assert answered == [True, True, False, False, False, True, True, True]
    assert [one.where for one in client.rig.injected] == ["ids 3, 4, 5"]
    client.inject("unplug=0.1:0.2s")
    for id in itertools.islice(itertools.cycle((1, 2, 3, 4, 5)), 300):
        ask(client, b"\xff\xff%c\x02\x01%c" % (id, 252 - id))
    assert {one.where for one in client.rig.injected} == {f"ids {id}" for id in range(1, 6)}


def test_what_a_servo_was_going_to_say_is_not_said() -> None:
    """The answer would begin 1.54 ms after the request; a cut at 1.2 ms prevents it, one at 1.7 ms is too late."""
    assert ask(port("unplug#0.0012s-")) == b""
    assert ask(port("unplug#0.0017s-")) == PONG


@pytest.mark.parametrize("faults", ["gone#2", "gone@write#2", "gone#0.033s"])
def test_the_port_goes_away(faults: str) -> None:
    client = port(faults)
    assert ask(client) == PONG
    if "write" in faults:
        with pytest.raises(PortLost, match="gone"):
            client.write(PING)
    else:
        client.write(PING)
        start = client.now()
        with pytest.raises(PortLost, match="gone"):
            client.read(10)
        assert client.now() - start < 0.0015
    for _ in range(2):
        with pytest.raises(PortLost, match="gone"):
            client.read(0)
        with pytest.raises(PortLost, match="gone"):
            client.write(PING)
    client.close()


def test_a_port_that_comes_back_is_opened_again() -> None:
    client = port("gone#2:1s")
    assert ask(client) == PONG
    assert ask_in_vain(client)
    with pytest.raises(PortLost, match="gone"):
        client.reopen()
    client.sleep(1.1)
    assert ask_in_vain(client)
    client.reopen()
    assert ask(client) == PONG


def ask_in_vain(client: VirtualPort) -> bool:
    with pytest.raises(PortLost, match="gone"):
        ask(client)
    return True


# The same each time, everywhere

MIX = (
    "seed={},drop=0.2,flip=0.2,pair=0.1,junk=0.2:1-8,stranger=0.1,mute=0.1,deaf=0.1,echo@bad=0.1,split=0.1:1ms,"
    "twin=0.05,late=0.05:2ms"
)


def conversation(client: VirtualPort, count: int = 60) -> list[bytes]:
    return [ask(client) for _ in range(count)]


def test_one_seed_one_story() -> None:
    first, second = port(MIX.format(7)), port(MIX.format(7))
    heard = conversation(first, 200)
    assert heard == conversation(second, 200)
    assert first.rig.injected == second.rig.injected
    assert set(first.rig.fault_counts) == {part.split("=")[0].split("@")[0] for part in MIX.split(",")[1:]}
    assert heard != conversation(port(MIX.format(8)), 200)


@pytest.mark.parametrize(
    "more", ["", ",glue=0.2,stall=0.1:10ms,late=0.2:15ms", ",latency=0.3ms,jitter=2ms,twin=0.2:0.1ms"]
)
@every_family
def test_pieces_make_no_difference(servos: str, more: str) -> None:
    # What has been echoed or heard of a request before it is whole cannot be taken back.
    mix = MIX.format(3).replace("echo@bad=0.1,", "").replace("deaf=0.1,", "") + more
    request, _ = FAMILIES[servos]
    whole, cut = port(mix, servos), port(mix, servos)
    streams = b"", b""
    for _ in range(30):
        for byte in request:
            cut.write(bytes((byte,)))
        whole.write(request)
        streams = streams[0] + until(whole, 9.0), streams[1] + until(cut, 0.00013)
    assert streams[0] == streams[1]
    assert whole.rig.fault_counts == cut.rig.fault_counts
    assert [(one.kind, one.number, one.where) for one in whole.rig.injected] == [
        (one.kind, one.number, one.where) for one in cut.rig.injected
    ]


def until(client: VirtualPort, grain: float, length: float = 0.02) -> bytes:
    """Give all that comes within a time, looking for it this often."""
    heard, end = b"", client.now() + length
    while (left := end - client.now()) > 1e-9:
        heard += client.read(min(grain, left))
    return heard


def test_each_fault_has_dice_of_its_own() -> None:
    alone, together = port("seed=5,drop=0.2"), port("seed=5,drop=0.2,flip=0.5,junk@after=0.5")
    conversation(alone)
    conversation(together)
    assert [one for one in together.rig.injected if one.kind == "drop"] == alone.rig.injected


def test_how_often() -> None:
    client = port("seed=1,drop=0.1")
    conversation(client, 1000)
    assert 60 < client.rig.fault_counts["drop"] < 140  # 100 expected, ± 4 times the root of 90
    assert len(client.rig.injected) == client.rig.fault_counts["drop"]
    one = client.rig.injected[0]
    assert (one.kind, one.wire) == ("drop", "dynamixel")
    assert one.where in {f"byte {k}" for k in range(6)}
    client.inject(None)
    assert conversation(client, 10) == [PONG] * 10
    assert client.rig.injected == []


def test_each_wire_counts_for_itself() -> None:
    client = port("mute#2", "rx28@1,lx16a@1")
    client.rig.client_baud = None  # both understand
    lx_request, lx_reply = FAMILIES["lx16a@1"]
    heard = [ask(client, request) for request in (PING, lx_request, PING, lx_request, PING)]
    assert heard == [PONG, lx_reply, b"", b"", PONG]
    assert sorted(one.wire for one in client.rig.injected) == ["dynamixel", "lewansoul"]


# Words


def test_values() -> None:
    read = Faults.parse(
        "seed=7 drop=0.01, flip@12#5,junk@before#3-9=0.5:2-4 unplug@3-6#1.5s-3s latency=16ms,skew@2=-3%"
    )
    assert read == Faults(
        7,
        (
            Fault("drop", probability=0.01),
            Fault("flip", 12, Which(5, 5)),
            Fault("junk", "before", Which(3, 9), 0.5, (2, 4)),
            Fault("unplug", (3, 6), Which(1.5, 3.0, timed=True)),
        ),
        latency=0.016,
        skews=((2, 2, -0.03),),
    )
    assert read.text.startswith("seed=7 drop")
    assert not Faults.parse("seed=7")
    assert Faults.parse("jitter=1ms")
    assert connect("virtual:rx28@1?clock=virtual&faults=skew@1=3%,drop@3").rig.faults.skews == ((1, 1, 0.03),)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("lose=0.1", "mute, stranger, pair, flip, drop, junk, split, glue, stall, late, twin, deaf, echo, reboot"),
        ("lose@3", "unplug, gone, and seed, latency, jitter, skew"),
        ("drop=1.5", "not in 0 .. 1"),
        ("drop=nan", "not in 0 .. 1"),
        ("drop=often", "often"),
        ("drop@-3", "-3"),
        ("drop@x", "the first is 0"),
        ("drop:3", "no ARGUMENT"),
        ("mute@3", "no WHERE"),
        ("drop#0", "from 1 on"),
        ("drop#9-5", "from 1 on"),
        ("junk@nowhere", "before, inside, after"),
        ("junk:64-1", "backwards"),
        ("junk:0xF", "how many"),
        ("junk:1000000", "4096"),
        ("split:-5ms", "how long"),
        ("stall:1e999", "how long"),
        ("echo@half", "full, part"),
        ("unplug@254", "253"),
        ("gone", "say when"),
        ("reboot", "say when"),
        ("seed", "seed=N"),
        ("seed=x", "x"),
        ("latency=16V", "unit"),
        ("skew@2=90000%", "100 %"),
        ("=0.5", "KIND"),
        ("drop=0.1=0.2", "0.1=0.2"),
    ],
)
def test_what_makes_no_sense(text: str, why: str) -> None:
    for parse in (Faults.parse, lambda text: connect(f"virtual:rx28@1?faults={text}")):
        with pytest.raises(BadValue, match=re.escape(why)) as raised:
            parse(f"seed=1,{text}")
        assert repr(text) in str(raised.value)


def test_everything_is_explained() -> None:
    text = explain()
    assert {line.split()[0] for line in text.splitlines()[4:] if line[:1].strip()} == {*KINDS, *SETTINGS}


def test_the_page_has_them_all() -> None:
    page = (Path(__file__).parents[4] / "docs" / "virtual.md").read_text(encoding="utf-8")
    section = page.partition("## A line with faults")[2].partition("## In tests")[0]
    assert set(re.findall(r"^\| `(\w+)", section, re.MULTILINE)) == {*KINDS, *SETTINGS}


# All is well again


def alive(client: VirtualPort) -> list[int]:
    """Give the ids of the servos that have their supply."""
    return [servo.id for servo in client.servos if servo.powered]


@pytest.mark.parametrize(
    "faults", ["unplug@3-4", "unplug@3-4#1-", "unplug@3#1s-", "reboot@3-4#1:10s", "unplug=1", "unplug@3-4:10s"]
)
@one_model_of_each_family
def test_N17_without_faults_all_servos_are_plugged_in_again(key: str, faults: str) -> None:
    client = connect(f"virtual:{key}@1-4?clock=virtual&boot_time=off")
    framing = client.rig.lines[0].family
    client.inject(faults)
    client.write(framing.ping(1).request)
    client.sleep(2.0)
    assert len(alive(client)) < 4
    client.inject(None)
    assert alive(client) == [1, 2, 3, 4]
    for id in range(1, 5):
        assert ask(client, framing.ping(id).request)


def test_N17_other_faults_heal_those_before() -> None:
    client = port("unplug@1", "rx28@1-2")
    ask(client)
    assert alive(client) == [2]
    client.inject("drop#1000")
    assert alive(client) == [1, 2]


def test_N17_what_is_unplugged_for_a_time_comes_back() -> None:
    client = port("unplug@3-4:1ms", "rx28@1-4")
    client.write(PING)
    assert alive(client) == [1, 2]
    client.sleep(0.0015)
    assert alive(client) == [1, 2, 3, 4]


def test_N17_healing_leaves_alone_what_a_person_unplugged() -> None:
    client = port("unplug@1", "rx28@1-3")
    client.rig.lines[0].unplug([client.servos[2]], client.now())
    ask(client)
    assert alive(client) == [2]
    client.inject(None)
    assert alive(client) == [1, 2]
