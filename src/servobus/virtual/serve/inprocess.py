"""Virtual servos as a port of this process: `servobus.open("virtual:rx28@1-4,lx16a@7")`.

With `clock=virtual` time passes only while someone waits, as fast as the computer can: a simulation runs
faster than real time, and twice the same is the same to the byte.
"""

import math
import threading
import time

from servobus.errors import BadValue, PortError, PortLost
from servobus.transports.base import Transport
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import parse_url
from servobus.virtual.wire.faults import Faults
from servobus.virtual.wire.uart import EPSILON


class VirtualPort(Transport):
    """A rig of virtual servos as a transport. The clock starts at 0."""

    timed = True

    def __init__(self, name: str, rig: Rig, *, real: bool = True) -> None:
        self.name = name
        self.rig = rig
        self._real = real
        self._now = 0.0
        self._started = time.monotonic()
        self._open = True
        self._gone = False
        self._changed = threading.Condition(rig.lock)
        """Held by the thread that lets something happen on the line; on the real clock several may use the port. What
        is written wakes a thread that reads: its next look may be sooner now."""
        self.set_baud(rig.default_baud)

    @property
    def servos(self) -> list[VirtualServo]:
        """The servos, up to date."""
        with self._changed:
            self.rig.advance(self.now())
            return self.rig.servos

    def inject(self, faults: Faults | str | None) -> None:
        """Let these faults happen from now on; None mends everything. Raises BadValue."""
        with self._changed:
            self.rig.inject(faults, self.now())
            self._tell_latency()

    def write(self, data: bytes) -> None:
        with self._changed:
            self._check()
            self.rig.send(data, self.now())
            self._check()
            self._changed.notify_all()

    def read(self, timeout: float) -> bytes:
        with self._changed:
            self._check()
            now = self.now()
            deadline = now + timeout
            while True:
                data = self.rig.receive(now)
                self._check()
                if data:
                    return data
                if now >= deadline:
                    return b""
                look = self.rig.next_look()
                if look is not None and -math.inf < look <= now:
                    look = max(now + EPSILON, math.nextafter(now, math.inf))  # after months a bit time rounds to 0
                now = self._wait_until(deadline if look is None else min(look, deadline))

    def set_baud(self, baud: int) -> None:
        if baud <= 0:
            raise BadValue(f"{baud} is not a speed in baud")
        with self._changed:
            self.baud = baud
            self.rig.client_baud = baud
            self._tell_latency()

    def close(self) -> None:
        self._open = False
        self.rig.close()

    def reopen(self) -> None:
        self.rig.open()
        self._gone, self._open = False, True
        self._check()
        self.rig.receive(self.now())  # what came while the port was away is lost

    def blocking(self) -> bool:
        return self._real

    def now(self) -> float:
        return time.monotonic() - self._started if self._real else self._now

    def sleep(self, seconds: float) -> None:
        if seconds <= 0:
            return
        if self._real:
            time.sleep(seconds)  # without the line: others may use it meanwhile
            with self._changed:
                self.rig.run(self.now())
        else:
            now = self._wait_until(self.now() + seconds)
            self.rig.advance(now)  # what a test changes from here on must not act on the time that has passed

    def _wait_until(self, moment: float) -> float:
        if self._real:
            self._changed.wait(max(moment - self.now(), 0))
            return self.now()
        self._now = max(self._now, moment)
        return self._now

    def _tell_latency(self) -> None:
        # A servo may be 3 % slower than the client believes; on the real clock a thread that waits may be woken late.
        own = 0.005 if self._real else 0.001
        self.latency = own + self.rig.handing_over  # so much an adapter's settings tell

    def _check(self) -> None:
        if not self._open:
            raise PortError(f"{self.name} is closed")
        # What was open when the port went away stays dead until it is opened again, even if the port comes back.
        self._gone = self._gone or self.rig.gone(self.now())
        if self._gone:
            raise PortLost(f"{self.name} is gone, as the faults asked for")


def connect(spec: str) -> VirtualPort:
    """Make a port of virtual servos: "virtual:rx28@1-4?clock=virtual&voltage=12". Raises UsageError."""
    setup = parse_url(spec)
    return VirtualPort(spec, build_rig(setup), real=setup.clock == "real")
