import pytest

from servobus.virtual.wire.uart import Receiver, Transmission, distort, understands

PING = bytes.fromhex("FF FF 01 02 01 FB")


@pytest.mark.parametrize(("heard", "sent", "fits"), [(57600, 57142.9, True), (103, 100, True), (104, 100, False)])
def test_3_percent(heard: float, sent: float, fits: bool) -> None:
    assert understands(heard, sent) is fits


@pytest.mark.parametrize("share", [0.97, 0.99, 1.0, 1.01, 1.03])
def test_nearly_the_same_speed(share: float) -> None:
    everything = bytes(range(256))
    assert distort(everything, 1e6, 1e6 * share) == everything


def test_sender_at_half_the_speed() -> None:
    # 0x00 is 9 low bits and a high one: 18 low samples. The first byte is all low and its stop bit is low
    # too; after that nothing falls before the next byte begins.
    assert distort(b"\x00\x00", 57600, 115200) == b"\x00\x00"
    # 0x55 is 0 1010 1010 1; at twice the speed 00 11 00 11 00 11 00 11 00 11. The second byte begins at the
    # fourth 00, because the stop bit of the first is low, and its last bit is the idle line.
    assert distort(b"\x55", 57600, 115200) == b"\x66\xe6"


def test_sender_at_twice_the_speed() -> None:
    # 0xFF is one low bit in ten: half a start bit for a slow receiver, which then sees only high levels.
    assert distort(b"\xff", 115200, 57600) == b"\xff"
    # One slow byte takes as long as two fast ones, and the second's start bit falls on a sample.
    assert distort(b"\xff\xff", 115200, 57600) in (b"\xff", b"\xef", b"\xdf")
    assert len(distort(PING, 115200, 57600)) < len(PING)


@pytest.mark.parametrize("baud", [9600, 19200, 38400, 115200, 250000, 1e6])
def test_garbage_is_deterministic_and_not_the_message(baud: float) -> None:
    assert distort(PING, 57142.9, baud) == distort(PING, 57142.9, baud) != PING


def hear(waves: list[Transmission], baud: float | None = 1e6) -> list[bytes]:
    receiver, runs = Receiver(baud, 0.0), []
    while run := receiver.next_run(waves):
        receiver.since = run.resume
        runs.append(run.data)
    return runs


def test_waves_in_turn_stay_apart() -> None:
    first = Transmission(0.0, 1e6, b"abc")
    assert hear([first, Transmission(first.end, 1e6, b"de")]) == [b"abc", b"de"]


def test_equal_waves_at_once_are_one() -> None:
    assert b"".join(hear([Transmission(0.0, 1e6, PING), Transmission(0.0, 1e6, PING)])) == PING


def test_aligned_bytes_merge_to_their_and() -> None:
    waves = [Transmission(0.0, 1e6, b"\xff\x0f\xf3"), Transmission(0.0, 1e6, b"\xff\x3c\x35")]
    assert b"".join(hear(waves)) == b"\xff\x0c\x31"


def test_what_comes_before_and_after_a_collision_is_heard() -> None:
    waves = [Transmission(0.0, 1e6, b"abcdef"), Transmission(20e-6, 1e6, b"\x00")]
    assert b"".join(hear(waves)) == b"ab\x00def"


def test_a_later_byte_merges_into_the_one_it_meets() -> None:
    heard = b"".join(hear([Transmission(0.0, 1e6, b"\xff"), Transmission(5e-6, 1e6, b"\xff")]))
    # 5 bits late, the start bit falls on data bit 4.
    assert heard == b"\xef"


def test_receiver_without_speed_understands_all() -> None:
    assert b"".join(hear([Transmission(0.0, 9600, b"abc"), Transmission(1.0, 1e6, b"def")], None)) == b"abcdef"


def test_plain_waves_are_understood_by_all() -> None:
    assert b"".join(hear([Transmission(0.0, 9600, b"abc", plain=True)])) == b"abc"


def test_limit_and_until() -> None:
    receiver, waves = Receiver(1e6, 0.0), [Transmission(0.0, 1e6, b"abcdef")]
    limited = receiver.next_run(waves, limit=2)
    early = receiver.next_run(waves, until=39e-6)
    assert limited is not None
    assert early is not None
    assert (limited.data, early.data) == (b"ab", b"abc")
    assert limited.end == pytest.approx(20e-6)
    assert receiver.next_run(waves, until=9e-6) is None
