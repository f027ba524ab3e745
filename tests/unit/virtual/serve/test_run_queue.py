"""When bytes came, on a computer that is too busy to look at them at once."""

import threading
from types import SimpleNamespace

import pytest

from servobus.virtual.serve import ports
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.run_queue import RunQueue
from servobus.virtual.serve.spec import parse_url

PING = bytes.fromhex("FF FF 01 02 01 FB")


class OneRequest(ports.Port):
    """A port whose only request is read this long after the wait began; its thread waited so long for a processor."""

    def __init__(self, read_after: float, waited: float) -> None:
        super().__init__(build_rig(parse_url("rx28@1")))
        self.read_after, self.waited = read_after, waited
        self.now = self.in_queue = 0.0
        self.stop = threading.Event()

    def _open(self, _: object) -> None: ...

    def _wait(self, _: float) -> bytes:
        self.stop.set()
        self.now, self.in_queue = self.read_after, self.waited
        return PING

    def _send(self, _: bytes) -> None: ...

    def _baud(self) -> None:
        return None


@pytest.mark.parametrize(
    ("read_after", "waited", "came"),
    [
        (0.010, 0.0, 0.010),
        (0.010, 0.004, 0.006),  # this thread could have run at 6 ms: that is when the bytes came
        (0.010, 0.015, 0.0),  # never before the wait
        (0.030, 0.005, 0.030),  # the wait was over at 20 ms; they came at some time since then
    ],
)
def test_a_request_counts_from_when_it_came(
    read_after: float, waited: float, came: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = OneRequest(read_after, waited)
    told: list[float] = []
    monkeypatch.setattr(port.rig, "send", lambda _data, now: told.append(now))
    monkeypatch.setattr(ports, "time", SimpleNamespace(monotonic=lambda: port.now))
    monkeypatch.setattr(RunQueue, "waited", lambda _: port.in_queue)
    port.serve(port.stop)
    assert told == [pytest.approx(came)]


def test_waiting_for_a_processor_is_counted_where_the_system_does() -> None:
    with RunQueue() as queue:
        assert 0 <= queue.waited() <= queue.waited()
    assert queue.waited() == 0
