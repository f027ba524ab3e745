"""The wire by itself: servos here say what they are told to say."""

import itertools
import random
from collections.abc import Sequence

import pytest

from servobus.core.framing import Corrupt, Packet
from servobus.errors import UsageError
from servobus.families.base import Model
from servobus.families.registry import DRS0602, LX16A, RX28
from servobus.virtual.device.servo import Replies, VirtualServo, virtual_servo
from servobus.virtual.wire.adapter import Adapter
from servobus.virtual.wire.line import VirtualLine

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
PING_2 = bytes.fromhex("FF FF 02 02 01 FA")


class Parrot(VirtualServo):
    """Hears everything for its id, and answers as told."""

    tick = 1.0
    garbage_timeout = 0.1
    torque = False
    led = "off"

    def __init__(self, id: int, replies: Replies, *, baud: float = 1e6, model: type[Model] = RX28) -> None:
        self.replies = replies
        self.own_id, self.own_baud = id, baud
        self.heard: list[tuple[float, Packet | Corrupt]] = []
        self.dropped: list[float] = []
        super().__init__(model)

    def start(self) -> None:
        self.id, self.baud = self.own_id, self.own_baud

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:
        self.heard.append((now, event))
        return self.replies

    def garbage(self, now: float) -> None:
        self.dropped.append(now)

    def control(self, ticks: int) -> None:
        pass


def line(
    servos: Sequence[VirtualServo], *, echo: bool = False, baud: float | None = 1e6, adapter: str = "none"
) -> VirtualLine:
    made = VirtualLine(servos, echo=echo, adapter=Adapter.parse(adapter))
    made.client_baud = baud
    return made


def test_one_family_on_a_line() -> None:
    with pytest.raises(UsageError, match="one family"):
        VirtualLine([virtual_servo(RX28, 1), virtual_servo(LX16A, 1)])
    with pytest.raises(UsageError, match="at least one"):
        VirtualLine([])


def test_bytes_take_their_time() -> None:
    wire = line([Parrot(1, [(100e-6, b"abc")])])
    wire.send(PING, 0.0)
    assert wire.receive(169e-6) == b""
    assert wire.receive(170.1e-6) == b"a"
    assert wire.receive(180.1e-6) == b"b"
    assert wire.receive(1.0) == b"c"
    assert wire.next_event() is None


@pytest.mark.parametrize("adapter", ["none", "whole", "usb:1ms", "fifo:8"])
def test_how_time_is_cut_makes_no_difference(adapter: str) -> None:
    def talk(cuts: list[float]) -> tuple[bytes, list[tuple[float, Packet | Corrupt]]]:
        servos = [Parrot(1, [(50e-6, bytes(range(40)))]), Parrot(2, [(80e-6, b"\xf0" * 30)], baud=0.97e6)]
        servos.append(Parrot(1, [(300e-6, b"\x33" * 9)], baud=500_000))
        wire = line(servos, adapter=adapter)
        plan = {0.0: PING + PING_2, 200e-6: PING, 0.001: PING_2[:3], 0.2: PING}
        heard = b""
        for now in sorted({*cuts, *plan, 1.0}):
            heard += wire.receive(now)
            if now in plan:
                wire.send(plan[now], now)
        return heard, [event for servo in servos for event in servo.heard]

    generator = random.Random(1)
    whole = talk([])
    for steps in (10, 100, 3000):
        assert talk([generator.random() * 0.002 for _ in range(steps)]) == whole


def test_client_bytes_queue() -> None:
    servo = Parrot(1, [])
    wire = line([servo])
    wire.send(PING, 0.0)
    wire.send(PING, 10e-6)
    wire.run(1.0)
    assert [now for now, _ in servo.heard] == pytest.approx([60e-6, 120e-6])


def test_next_event_leads_through_everything() -> None:
    wire = line([Parrot(1, [(100e-6, b"abc")])])
    wire.send(PING, 0.0)
    heard, times = b"", []
    while (event := wire.next_event()) is not None:
        times.append(event)
        heard += wire.receive(event)
    assert heard == b"abc"
    assert times == sorted(times)
    assert times[-1] == pytest.approx(190e-6)


def test_a_packet_goes_to_its_id_or_to_all() -> None:
    servos = [Parrot(1, []), Parrot(2, []), Parrot(2, [])]
    wire = line(servos)
    wire.send(PING_2, 0.0)
    wire.send(bytes.fromhex("FF FF FE 02 01 FE"), 0.001)
    wire.run(1.0)
    assert [len(servo.heard) for servo in servos] == [1, 2, 2]


def test_corrupt_packets_are_heard_too() -> None:
    servo = Parrot(1, [])
    wire = line([servo])
    wire.send(PING[:-1] + b"\x00", 0.0)
    wire.run(1.0)
    ((_, event),) = servo.heard
    assert isinstance(event, Corrupt)


def test_equal_replies_at_once_stay_intact_and_others_merge() -> None:
    wire = line([Parrot(1, [(1e-4, b"\xff\x0f")]), Parrot(1, [(1e-4, b"\xff\x0f")])])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == b"\xff\x0f"
    wire = line([Parrot(1, [(1e-4, b"\xff\x0f")]), Parrot(1, [(1e-4, b"\xff\x3c")])])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == b"\xff\x0c"


def test_replies_in_turn_stay_apart() -> None:
    wire = line([Parrot(1, [(1e-4, b"abc")]), Parrot(1, [(2e-4, b"def")])])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == b"abcdef"


def test_one_servo_sends_one_thing_after_the_other() -> None:
    wire = line([Parrot(1, [(1e-4, b"abc"), (1e-4, b"def")])])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == b"abcdef"


def test_echo() -> None:
    wire = line([Parrot(1, [(1e-4, b"abc")])], echo=True)
    wire.send(PING, 0.0)
    assert wire.receive(60.1e-6) == PING
    assert wire.receive(1.0) == b"abc"


def test_half_duplex_client_and_servo_collide() -> None:
    servo = Parrot(1, [(10e-6, b"\x0f" * 8)])
    wire = line([servo], echo=True)
    wire.send(PING + PING, 0.0)
    heard = wire.receive(1.0)
    assert heard[:7] == PING + PING[:1]
    assert heard[7:12] == bytes(byte & 0x0F for byte in PING[1:])
    assert len(servo.heard) == 1
    deaf = line([Parrot(1, [(10e-6, b"\x0f" * 8)])])
    deaf.send(PING + PING, 0.0)
    assert deaf.receive(1.0) == b"\x0f" * 3  # what comes after its own last byte


def test_full_duplex_does_not_collide() -> None:
    request = bytes.fromhex("FF FF 07 01 07 00 FE")
    servos = [Parrot(1, [(10e-6, b"abc")], model=DRS0602), Parrot(2, [], model=DRS0602)]
    wire = line(servos)
    wire.send(request * 3, 0.0)
    assert wire.receive(1.0) == b"abc" * 3
    assert [len(servo.heard) for servo in servos] == [3, 0]


def test_other_servos_replies_are_no_requests() -> None:
    first, second = Parrot(1, [(1e-4, PING_2)]), Parrot(2, [])
    wire = line([first, second])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == PING_2
    assert not second.heard


def test_speeds() -> None:
    right, wrong = Parrot(1, [(0.0, PONG)], baud=1e6), Parrot(1, [(0.0, PONG)], baud=57142.9)
    wire = line([wrong, right])
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == PONG
    wire.client_baud = 57600
    wire.send(PING, 1.0)
    assert wire.receive(2.0) == PONG
    wire.client_baud = 9600
    wire.send(PING, 2.0)
    assert wire.receive(3.0) == b""
    assert (len(right.heard), len(wrong.heard)) == (1, 1)


def test_client_without_speed_reaches_all() -> None:
    wire = line([Parrot(1, [(0.0, b"abc")], baud=1e6), Parrot(2, [(0.0, b"def")], baud=9600)], baud=None)
    for request, reply in ((PING, b"abc"), (PING_2, b"def")):
        wire.send(request, wire.now)
        assert wire.receive(wire.now + 1) == reply


def test_new_settings_are_noticed() -> None:
    servo = Parrot(1, [(0.0, b"abc")])
    wire = line([servo])
    servo.id = 2
    wire.send(PING, 0.0)
    assert wire.receive(1.0) == b""
    servo.baud = 57600
    wire.client_baud = 57600
    wire.send(PING_2, 1.0)
    assert wire.receive(2.0) == b"abc"


def test_pauses() -> None:
    servo = Parrot(1, [])
    wire = line([servo])
    wire.send(PING[:4], 0.0)
    wire.send(PING[4:], 40e-6 + 0.1)
    wire.run(1.0)
    assert (len(servo.heard), servo.dropped) == (1, [])
    wire.send(PING[:4], 1.0)
    wire.run(1.2)
    assert servo.dropped == pytest.approx([1.0 + 40e-6 + 0.1], abs=1e-6)
    wire.send(PING[4:] + PING, 1.2)
    wire.run(2.0)
    assert len(servo.heard) == 2


def test_deaf_and_dead_servos() -> None:
    servo = Parrot(1, [(0.0, b"abc")])
    wire = line([servo])
    servo.deaf_until = 0.5
    for now, reply in ((0.1, b""), (0.49999, b""), (0.6, b"abc")):
        wire.send(PING, now)
        assert wire.receive(now + 0.01) == reply
    servo.power_off()
    wire.send(PING, 0.7)
    assert wire.receive(1.0) == b""


def test_a_full_bus_is_cheap() -> None:
    """No work for each servo and byte: a packet for one of 254 servos is decoded once."""
    servos = [Parrot(id, []) for id in range(254)]
    wire = line(servos)
    assert len(wire._groups) == 1
    for id in range(254):
        wire.send(bytes((255, 255, id, 2, 1, ~(id + 3) & 0xFF)), id * 1e-3)
    wire.run(1.0)
    assert [len(servo.heard) for servo in servos] == [1] * 254
    assert not wire._to_servos


def test_nothing_is_kept() -> None:
    wire = line([Parrot(1, [(1e-4, b"abc")]), Parrot(2, [], baud=57600), Parrot(3, [], baud=9600)])
    for now in itertools.accumulate([0.001] * 300):
        wire.send(PING, now)
    wire.receive(2.0)
    assert (len(wire._to_servos), len(wire._to_client)) == (0, 0)
