"""Virtual servos that other programs find behind a port, served by a thread of this process: for tests.

    with serve("virtual:rx28@1-4") as port:
        program_under_test(port)            # the port is its own name, such as /tmp/servobus-k3x/servos
        port.servo(3).block()
        port.inject("drop=0.01")

Everything that is asked of the port or of its servos happens in the thread that serves them, between two events of the
bus; the one who asks waits for it. Any thread may ask.
"""

import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeVar

from servobus.errors import PortError, UnknownName, UsageError
from servobus.families.model import Model
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.device.snapshot import VirtualSnapshot, take_snapshot
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.ports import Port, PtyPort, TcpPort
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import check_temperature, check_voltage, parse_load, parse_url
from servobus.virtual.wire.faults import Faults, Injected

PATIENCE = 5.0
"""s that a port may take to end."""

T = TypeVar("T")


class ServedServo:
    """A servo behind a port that is being served: what is true of it, whatever its replies say."""

    def __init__(self, port: "ServedPort", servo: VirtualServo) -> None:
        self._port = port
        self._servo = servo

    def __repr__(self) -> str:
        return repr(self._servo)

    def do(self, job: Callable[[VirtualServo], T]) -> T:
        """Have something done with the servo itself, up to date, such as `lambda servo: servo.get("led")`."""

        def act(_: Rig, now: float) -> T:
            self._servo.advance(now)
            return job(self._servo)

        return self._port.do(act)

    def look(self) -> VirtualSnapshot:
        """Give all that can be seen of the servo at one moment, in rad, rad/s, A, degC and V."""
        return self.do(take_snapshot)

    @property
    def id(self) -> int:
        """The id that the servo answers to now."""
        return self._servo.id

    @property
    def model(self) -> type[Model]:
        return self._servo.model

    @property
    def angle(self) -> float:
        """Where the shaft is, rad."""
        return self.look().angle

    @property
    def torque(self) -> bool:
        """Whether the motor holds the shaft."""
        return self.look().torque

    @property
    def powered(self) -> bool:
        """Whether the servo is on the bus and has its supply."""
        return self._servo.powered

    @property
    def temperature(self) -> float:
        """Of the case, degC. Setting it brings the servo and its surroundings to that temperature. Raises BadValue."""
        return self.look().temperature

    @temperature.setter
    def temperature(self, celsius: float) -> None:
        self._set("temperature", check_temperature(celsius))

    @property
    def voltage(self) -> float:
        """Supply at the servo's plug, V. Setting it sets the source's voltage, without load. Raises BadValue."""
        return self.look().voltage

    @voltage.setter
    def voltage(self, volts: float) -> None:
        self._set("voltage", check_voltage(volts))

    @property
    def load(self) -> Load:
        """What hangs on the shaft. It may be set in words too: "mass=0.2,length=0.1". Raises BadValue."""
        return self.do(lambda servo: servo.shaft.load)

    @load.setter
    def load(self, load: Load | str) -> None:
        self._load(lambda _: parse_load(load) if isinstance(load, str) else load)

    def block(self) -> None:
        """Hold the shaft as in a vice."""
        self._load(lambda load: replace(load, blocked=1.0))

    def release(self) -> None:
        """Let the shaft turn again."""
        self._load(lambda load: replace(load, blocked=0.0))

    def turn(self, angle: float) -> None:
        """Turn the shaft by hand to an angle, rad. Raises UsageError while the motor holds it, BadValue if too far."""
        self.do(lambda servo: servo.turn_shaft(angle))

    def unplug(self) -> None:
        """Take the servo off the bus, its supply too."""
        self._port.do(lambda rig, now: rig.unplug([self._servo], now))

    def plug(self) -> None:
        """Put the servo on the bus again: it starts anew."""
        self._port.do(lambda rig, now: rig.plug([self._servo], now))

    def _set(self, name: str, value: Any) -> None:
        self.do(lambda servo: setattr(servo, name, value))

    def _load(self, change: Callable[[Load], Load]) -> None:
        def act(servo: VirtualServo) -> None:
            servo.shaft.load = change(servo.shaft.load)

        self.do(act)


class ServedPort(str):
    """The name of a port of virtual servos, for whatever opens serial ports, and a handle to what is behind it."""

    __slots__ = ("_rig", "_server", "servos")

    _rig: Rig
    _server: threading.Thread
    servos: list[ServedServo]
    """All servos, in the order in which they were named."""

    @property
    def served(self) -> bool:
        """Whether it is being served."""
        return self._server.is_alive()

    def __new__(cls, name: str, rig: Rig, server: threading.Thread) -> Self:
        port = super().__new__(cls, name)
        port._rig, port._server = rig, server
        port.servos = [ServedServo(port, servo) for servo in rig.servos]
        return port

    def do(self, job: Callable[[Rig, float], T]) -> T:
        """Have something done by the thread that serves, with the rig and its time in s; give what comes of it.

        Raises what the job raises, and PortError if the port is no longer served.
        """
        results: list[T] = []
        errors: list[BaseException] = []
        done = threading.Event()

        def task(now: float) -> None:
            try:
                results.append(job(self._rig, now))
            except BaseException as error:  # noqa: BLE001 - whatever it is, it belongs to the one who asked
                errors.append(error)
            done.set()

        self._rig.post(task)
        while not done.wait(0.1):
            if not self._server.is_alive() and not done.is_set():
                raise PortError(f"{self}: the servos are no longer served")
        if errors:
            raise errors[0]
        return results[0]

    def servo(self, id: int, model: str | type[Model] | None = None) -> ServedServo:
        """Give the servo that answers to this id now; the model tells apart servos of several families with one id.

        Raises UnknownName if there is none, UsageError if there are several.
        """
        key = model.key() if isinstance(model, type) else model
        found = [one for one in self.servos if one.id == id and key in (None, one.model.key())]
        if len(found) == 1:
            return found[0]
        said = f"id {id}" if key is None else f"{key}@{id}"
        if not found:
            known = ", ".join(f"{one.model.key()}@{one.id}" for one in self.servos)
            raise UnknownName(f"there is no servo {said} here; there are {known}")
        raise UsageError(f"several servos are {said}: say the model too, such as servo({id}, {found[0].model.key()!r})")

    def inject(self, faults: Faults | str | None) -> None:
        """Let these faults happen from now on, instead of any others; None mends everything. Raises BadValue.

        With "gone#0s" the port itself goes away at once, and comes back under its own name with None.
        """
        self.do(lambda rig, now: rig.inject(faults, now))

    @property
    def injected(self) -> list[Injected]:
        """The latest faults that have happened since the last call of `inject`."""
        return self.do(lambda rig, _: rig.injected)

    @property
    def fault_counts(self) -> Counter[str]:
        """Kind of fault -> how often it has happened since the last call of `inject`."""
        return self.do(lambda rig, _: rig.fault_counts)

    def unplug(self, *ids: int) -> None:
        """Take servos off the bus, their supply too: those with these ids, or all. Raises UnknownName."""
        self.do(lambda rig, now: rig.unplug(self._with(ids), now))

    def plug(self, *ids: int) -> None:
        """Put servos on the bus again: those with these ids, or all. They start anew. Raises UnknownName."""
        self.do(lambda rig, now: rig.plug(self._with(ids), now))

    def _with(self, ids: tuple[int, ...]) -> list[VirtualServo]:
        servos = self._rig.servos
        for id in ids:
            if id not in [servo.id for servo in servos]:
                raise UnknownName(f"there is no servo id {id} here")
        return [servo for servo in servos if not ids or servo.id in ids]


@contextmanager
def serve(url: str, *, tcp: bool = False, faults: Faults | str | None = None) -> Iterator[ServedPort]:
    """Serve virtual servos, named as in "virtual:rx28@1-4?voltage=12", from a thread of this process.

    On a pseudo terminal; with `tcp`, and on Windows always, on a TCP port. The clock is the real one. Raises UsageError
    for what cannot be served, PortError.
    """
    rig = build_rig(parse_url(url))
    with ExitStack() as stack:
        stack.callback(rig.close)
        if faults is not None:
            rig.inject(faults, 0.0)
        if tcp or sys.platform == "win32":
            port: Port = TcpPort(rig)
        else:
            # The link keeps its name even if the terminal behind it goes away and another one comes.
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="servobus-"))
            port = PtyPort(rig, Path(folder) / "servos")
        yield stack.enter_context(serving(port))


@contextmanager
def serving(port: Port) -> Iterator[ServedPort]:
    """Serve the servos behind a port, from a thread of this process, until the block ends. Raises PortError."""
    with port, ExitStack() as stack:
        stop = threading.Event()
        server = threading.Thread(target=port.serve, args=[stop], name=port.name, daemon=True)
        server.start()
        stack.callback(server.join, PATIENCE)
        stack.callback(stop.set)
        yield ServedPort(port.name, port.rig, server)
