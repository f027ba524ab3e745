"""Virtual servos behind a pseudo terminal, in a thread of the test, that write down every packet they get."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Self

from samples import sample_of
from servobus import Bus, open
from servobus.core.framing import Corrupt, Packet
from servobus.virtual.device.servo import Replies, VirtualServo
from servobus.virtual.serve.ports import Port, PtyPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url

PATIENCE = 30.0
"""s; a limit against hanging, and never a measurement."""


def wait_for(done: Callable[[], bool]) -> None:
    """Wait until something is so; fail if it never is."""
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, "this never happened"
        time.sleep(0.005)


@contextmanager
def served(port: Port) -> Iterator[Port]:
    """Serve what is behind a port, in a thread, while it is open."""
    stop = threading.Event()
    with port:
        thread = threading.Thread(target=port.serve, args=(stop,))
        thread.start()
        try:
            yield port
        finally:
            stop.set()
            thread.join(5)
            assert not thread.is_alive()


class Arm:
    """Serves virtual servos while it is open. `name` is what a client opens, `heard` the packets so far."""

    def __init__(self, spec: str) -> None:
        self.rig = build_rig(parse_url(f"virtual:{spec}"))
        self.heard: list[Packet] = []
        for servo in self.rig.servos:
            self._write_down(servo)
        self._stop = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        port = self._stack.enter_context(PtyPort(self.rig))
        self.name = port.name
        server = threading.Thread(target=port.serve, args=[self._stop], daemon=True)
        server.start()
        self._stack.callback(server.join, PATIENCE)
        self._stack.callback(self._stop.set)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def servos(self) -> list[VirtualServo]:
        return self.rig.servos

    def open(self) -> Bus:
        return open(self.name, echo=False)

    def settled(self) -> list[Packet]:
        """Give what was heard, all that a client sent before it ended included: bytes keep their order."""
        count = len(self.heard)
        with self.open() as bus:
            for servo in self.servos:
                bus.attach(servo.model, servo.id).ping()
        heard = self.heard[count:]
        pings = [packet for servo in self.servos for packet in [servo.model.family.framing.unframe(ping(servo))[0]]]
        for one in pings:
            heard.remove(one)
        return self.heard[:count] + heard

    def _write_down(self, servo: VirtualServo) -> None:
        hear = servo.hear

        def wrapped(event: Packet | Corrupt, now: float) -> Replies:
            if isinstance(event, Packet):
                self.heard.append(event)
            return hear(event, now)

        servo.hear = wrapped  # type: ignore[method-assign]


def ping(servo: VirtualServo) -> bytes:
    return servo.model.family.ping(servo.id).request


def stops(heard: list[Packet], key: str, id: int) -> int:
    """Count the commands that end the motion of a servo and leave its torque on."""
    return sum(packet.id == id and sample_of(key).stops(packet) for packet in heard)


def frees(heard: list[Packet], key: str, id: int) -> int:
    """Count the commands that switch the torque of a servo off."""
    return sum(packet.id == id and sample_of(key).frees(packet) for packet in heard)
