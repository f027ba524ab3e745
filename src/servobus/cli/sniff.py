"""`sniff`: what goes on between an application and its servos."""

import queue
import select
import shlex
import sys
import threading
import time
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Self, TypeAlias

import click

from servobus.cli.decode import named
from servobus.cli.options import BAUD, as_json, stop_on_signals, verb
from servobus.cli.output import compact, note
from servobus.cli.packets import conclude, report
from servobus.connect import FIRST_BAUD, transport
from servobus.errors import BadValue, ServobusError, UsageError
from servobus.families import registry
from servobus.traffic import recording
from servobus.traffic.events import TrafficEvent
from servobus.traffic.recording import Chunk, Direction, End, Entry, Header, Speed
from servobus.traffic.tracker import BITS, Tracker
from servobus.transports.base import Transport
from servobus.virtual.serve.ports import LOOKOUT, PULSE, Terminal

TURN = 0.001
"""s that one side is waited for where the two cannot be waited for together."""
SWITCH = 0.0001
"""s after which Python takes the processor from the printing; its 5 ms could be felt on the bus."""

AT_ONCE = 100
"""Pieces of news after which what they say is printed, even if there are more."""

News: TypeAlias = Entry | float | Exception | None
"""What was carried; the time, while nothing is; an error; None at the planned end."""


@verb(
    "sniff",
    "servobus sniff /dev/ttyUSB0 --app /tmp/arm",
    "servobus sniff /dev/ttyUSB0 --baud 1000000 --save arm.rec",
    "servobus sniff virtual:rx28@1-4 --app /tmp/arm --once --json",
    "",
    "and then the application, in another terminal:",
    "servobus scan /tmp/arm",
)
@click.argument("port")
@click.option(
    "--baud", type=BAUD, metavar="N", help="Speed, until the application sets one; else the family's, or 115200."
)
@click.option(
    "--app",
    metavar="[LINK]",
    is_flag=False,
    flag_value="",
    help="Stand between an application and PORT; LINK becomes a link to its terminal.",
)
@click.option("--once", is_flag=True, help="With --app: end when the application closes its port.")
@click.option("--save", metavar="FILE", help="Write a recording, which `servobus decode FILE` shows again.")
@click.option("--family", metavar="FAMILY", help="dynamixel, herkulex or lewansoul; else found out piece by piece.")
@click.option("--model", metavar="MODEL", help="Whose registers; else those of the family's first model.")
@as_json
def sniff(
    port: str,
    baud: int | str | None,
    app: str | None,
    once: bool,
    save: str | None,
    family: str | None,
    model: str | None,
    json: bool,
) -> None:
    """Show the traffic on PORT packet by packet, with what is wrong with it, until interrupted.

    Alone it only listens, as with a second adapter on the wire, and never sends anything. With --app it opens
    a terminal for an application, prints `ready PATH`, and passes bytes both ways at the speed that the
    application sets. With --json, one object a line.
    """
    if isinstance(baud, str):
        raise click.UsageError("--baud: a line has one speed, not all")
    if once and app is None:
        raise click.UsageError("--once needs --app")
    if app is not None and sys.platform == "win32":
        raise UsageError("--app needs a pseudo terminal, and Windows has none; listen with a second adapter instead")
    if not port.strip():
        raise BadValue("PORT is empty; `servobus ports` lists what is plugged in")
    whose, table = named(family, model)
    speed = baud or (table.factory_baud if table else registry.factory_bauds(whose)[0] if whose else FIRST_BAUD)
    head = Header(
        port,
        speed,
        whose.name if whose else None,
        table.key() if table else None,
        datetime.now(UTC).isoformat(timespec="milliseconds"),
    )
    stop = stop_on_signals()
    with ExitStack() as stack:
        wire = transport(port, (speed,))
        stack.callback(wire.close)
        terminal = stack.enter_context(Application(speed, Path(app) if app else None)) if app is not None else None
        keeper = Keeper(Path(save), head) if save else None
        if keeper:
            stack.callback(keeper.close)
        _ready(port, speed, terminal, json=json)
        carrier = Carrier(wire, terminal, keeper, stop, once=once)
        carrier.start()
        stack.callback(carrier.end)
        tracker = Tracker(whose, table, speed)
        failure = _follow(carrier, tracker, json=json)
    report(tracker.finish(), json=json)
    conclude(tracker, json=json)
    if failure is None and keeper:
        failure = keeper.failure
    if failure is not None:
        raise failure


def _ready(port: str, speed: int, terminal: "Application | None", *, json: bool) -> None:
    name = terminal.name if terminal else port
    if json:
        click.echo(compact({"kind": "ready", "port": name, "baud": speed}))
    elif terminal:
        click.echo(f"ready {name}")
    else:
        click.echo(f"listening on {name} at {speed} baud")
    sys.stdout.flush()  # whoever waits for this line may wait on a pipe
    if sys.stderr.isatty():
        hint = f"try: servobus scan {shlex.quote(name)}     (Ctrl-C here ends it)" if terminal else "Ctrl-C ends it"
        note(hint)


def _follow(carrier: "Carrier", tracker: Tracker, *, json: bool) -> Exception | None:
    """Show what is carried until it ends; give what made it end, unless that was planned."""
    while True:
        sights: list[TrafficEvent] = []
        for _ in range(AT_ONCE):
            news = carrier.news.get()
            if news is None or isinstance(news, Exception):
                report(sights, json=json)
                return news
            sights += tracker.pass_time(news) if isinstance(news, float) else tracker.feed(news)
            if carrier.news.empty():
                break
        report(sights, json=json)


class Application(Terminal):
    """The terminal of an application. Waits for nothing: whoever carries bytes waits for both sides at once."""

    def __init__(self, baud: int, link: Path | None) -> None:
        super().__init__(baud, link)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._open(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def present(self) -> bool:
        """Whether the application has it open, as far as the last `read` could tell."""
        return self._client

    def fileno(self) -> int:
        return self._master

    def read(self) -> bytes:
        return self._wait(0)

    def write(self, data: bytes) -> None:
        self._send(data)

    def speed(self) -> int:
        """Give the speed that the application set, bit/s."""
        return round(self._baud() or 0)


class Keeper:
    """A recording that is being written. It is written past all buffers: what was said is there, whatever happens."""

    def __init__(self, path: Path, head: Header) -> None:
        self.failure: ServobusError | None = None
        """Why nothing more is written."""
        self._path = path
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise UsageError(f"{path} exists already and is not replaced; choose another name") from None
        self._write(head.line())

    def write(self, entry: Entry) -> None:
        self._write(recording.line(entry))

    def close(self) -> None:
        self._file.close()

    def _write(self, text: str) -> None:
        """Write a line. If the disk is full, the recording ends there, and nothing else does."""
        if self.failure is not None:
            return
        data = text.encode("ascii")
        try:
            why = "the disk is full" if (self._file.write(data) or 0) < len(data) else ""
        except OSError as error:
            why = error.strerror or str(error)
        if why:
            self.failure = ServobusError(f"{self._path}: {why}; the recording ends early, and can be read up to there")
            note(f"servobus: {self.failure}")


class Carrier(threading.Thread):
    """Carries bytes between an application and the line, or only listens; `news` tells of them.

    Nothing that is printed holds it up: printing is another thread's.
    """

    def __init__(
        self,
        wire: Transport,
        app: Application | None,
        keeper: Keeper | None,
        stop: threading.Event,
        *,
        once: bool = False,
    ) -> None:
        super().__init__(name="carrier", daemon=True)
        self.news: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._wire, self._app, self._keeper, self._stop_asked, self._once = wire, app, keeper, stop, once
        self._started_at = time.monotonic()
        self._told = 0.0
        self._busy = 0.0
        """s: until then what was sent is on the wire."""
        self._refused = 0
        """Speed that the port cannot be set to."""

    def end(self) -> None:
        self._stop_asked.set()
        self.join()

    def run(self) -> None:
        sys.setswitchinterval(SWITCH)
        try:
            if self._app is None:
                self._listen()
            else:
                self._carry(self._app)
            end: Exception | None = None
        except Exception as error:  # noqa: BLE001 - whatever it is, who waits for news must hear of it
            end = error
        self._tell(End(self._now()))
        self.news.put(end)

    def _listen(self) -> None:
        while not self._stop_asked.is_set():
            if data := self._wire.read(PULSE):
                self._tell(Chunk(self._now(), Direction.UNKNOWN, data))
            else:
                self._tell_time()

    def _carry(self, app: Application) -> None:
        port = self._wire.fileno()
        while not self._stop_asked.is_set():
            present = app.present
            if port is not None:
                # A terminal that nobody has open is always readable: it is looked at now and then instead.
                wanted = [port, app.fileno()] if present else [port]
                ready = select.select(wanted, [], [], PULSE if present else LOOKOUT)[0]
            self._follow_speed(app)
            if data := app.read():
                now = self._now()
                self._busy = max(self._busy, now) + len(data) * BITS / self._wire.baud
                self._wire.write(data)
                self._tell(Chunk(now, Direction.OUT, data))
            elif present and not app.present and self._once:
                return
            if (port is None or port in ready) and (data := self._wire.read(TURN if port is None else 0)):
                now = self._now()
                app.write(data)
                self._tell(Chunk(now, Direction.IN, data))
            self._tell_time()

    def _follow_speed(self, app: Application) -> None:
        """Set the port to the application's speed, behind what was sent at the old one."""
        baud = app.speed()
        if baud in (self._wire.baud, self._refused):
            return
        time.sleep(max(self._busy - self._now(), 0))
        try:
            self._wire.set_baud(baud)
        except ServobusError as error:
            self._refused = baud
            note(f"servobus: {error}; the line stays at {self._wire.baud} baud")
        else:
            self._tell(Speed(self._now(), baud))

    def _now(self) -> float:
        return time.monotonic() - self._started_at

    def _tell(self, entry: Entry) -> None:
        if self._keeper is not None:
            self._keeper.write(entry)
        self._told = entry.time
        self.news.put(entry)

    def _tell_time(self) -> None:
        now = self._now()
        if now - self._told >= PULSE:
            self._told = now
            self.news.put(now)
