"""A recording played into a port: its requests at their times, and the answers beside those of then."""

from servobus.connect import transport
from servobus.traffic.playing import play
from servobus.traffic.recording import Chunk, Direction, Entry, Speed, TapEnd
from servobus.transports.tap import ReplayTransport

PING = bytes.fromhex("FFFF010201FB")  # RX-28 manual 3-4: PING of id 1
STATUS = bytes.fromhex("FFFF010200FC")  # RX-28 manual 3-4: its answer
PING_2 = bytes.fromhex("FFFF020201FA")
SCRIPT: list[Entry] = [
    Chunk(0.5, Direction.IN, b"\x00"),
    Chunk(1.0, Direction.OUT, PING),
    Chunk(1.002, Direction.IN, STATUS[:2]),
    Chunk(1.003, Direction.IN, STATUS[2:]),
    Chunk(2.0, Direction.OUT, PING_2),
    TapEnd(3.0),
]


def test_a_recording_answers_itself() -> None:
    played = list(play(SCRIPT, ReplayTransport(SCRIPT)))
    assert [one.request for one in played] == [PING, PING_2]
    assert [one.heard for one in played] == [STATUS, b""]
    assert [one.time for one in played] == [1.0, 2.0]
    assert all(one.same for one in played)


def test_virtual_servos_answer_at_the_speed_of_the_recording() -> None:
    port = transport("virtual:rx28@1?clock=virtual")  # at 57600
    script = [Speed(0.0, 9_600), *SCRIPT[1:2], Speed(1.5, 57_600), Chunk(2.0, Direction.OUT, PING)]
    deaf, answered = play(script, port)
    assert deaf.heard == b""
    assert answered.heard == STATUS
    assert port.now() >= 2.0  # as long as the recording took
    port.close()


def test_nothing_recorded_is_nothing_played() -> None:
    assert list(play([], ReplayTransport([]))) == []
    assert list(play([TapEnd(5.0)], ReplayTransport([]))) == []
