"""`sniff`: the traffic between an application and its servos."""

import queue
import select
import shlex
import sys
import threading
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

import click

from servobus.cli import complete
from servobus.cli.decode import find_family_and_model
from servobus.cli.interrupts import stop_on_signals
from servobus.cli.options import FamilyOption, ModelOption, as_json, verb
from servobus.cli.output import compact, note
from servobus.cli.packets import print_events, print_summary
from servobus.cli.values import BAUD
from servobus.connect import FIRST_BAUD, transport
from servobus.core.framing import BITS_PER_BYTE
from servobus.errors import ServobusError, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.traffic.events import TrafficEvent
from servobus.traffic.recording import Direction, Entry, Header, RecordingFile, TapEnd
from servobus.traffic.tracker import Tracker
from servobus.transports.base import Transport
from servobus.transports.pty import LOOK_PERIOD, PseudoTerminal
from servobus.transports.tap import TapTransport

TICK = 0.02
"""s after which a request to stop is noticed, and the time is told while nothing is carried."""
POLL = 0.001
"""s that one side is waited for where the two cannot be waited for together."""
SWITCH_INTERVAL = 0.0001
"""s after which Python takes the processor from the printing; its 5 ms could be felt on the bus."""
PRINTED_TOGETHER = 100
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
@click.argument("port", shell_complete=complete.ports)
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
@click.option("--family", cls=FamilyOption, metavar="FAMILY", help="{families}; else all of them are looked for.")
@click.option(
    "--model", cls=ModelOption, metavar="MODEL", help="Whose registers; else those of the model that a servo reports."
)
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
    if app is None and port.startswith("virtual:"):
        raise UsageError(f"{port} has nobody that talks; --app gives an application a way to it")
    if port.startswith("servobus://"):
        raise UsageError(f"{port} is shared by a server, which alone sees its bytes; sniff a port of this computer")
    known_family, known_model = find_family_and_model(family, model)
    speed = baud or _factory_baud(known_family, known_model)
    head = Header(
        port,
        speed,
        known_family.name if known_family else None,
        known_model.key() if known_model else None,
        datetime.now(UTC).isoformat(timespec="milliseconds"),
    )
    stop = stop_on_signals()
    with ExitStack() as stack:
        wire = transport(port, (speed,))
        stack.callback(wire.close)
        terminal = None
        if app is not None:
            terminal = stack.enter_context(PseudoTerminal(speed, Path(app) if app else None))
        file = stack.enter_context(RecordingFile(Path(save), head, _note_failure)) if save else None
        _ready(port, speed, terminal, json=json)
        relay = Relay(wire, terminal, file, stop, once=once)
        relay.start()
        stack.callback(relay.end)
        tracker = Tracker(known_family, known_model, speed)
        failure = _follow(relay, tracker, json=json)
    print_events(tracker.finish(), json=json)
    print_summary(tracker, json=json)
    if failure is None and file:
        failure = file.failure
    if failure is not None:
        raise failure


def _note_failure(failure: ServobusError) -> None:
    note(f"servobus: {failure}")


def _factory_baud(family: Family | None, model: type[Model] | None) -> int:
    """Give the speed that a line most likely has."""
    if model is not None:
        return model.factory_baud
    return FIRST_BAUD if family is None else registry.factory_bauds(family)[0]


def _ready(port: str, speed: int, terminal: PseudoTerminal | None, *, json: bool) -> None:
    name = terminal.name if terminal else port
    if json:
        click.echo(compact({"kind": "ready", "port": name, "baud": speed}))
    elif terminal:
        click.echo(f"ready {name}")
    else:
        click.echo(f"listening on {name} at {speed} baud")
    sys.stdout.flush()  # a program that waits for this line may wait on a pipe
    if sys.stderr.isatty():
        hint = f"try: servobus scan {shlex.quote(name)}     (Ctrl-C here ends it)" if terminal else "Ctrl-C ends it"
        note(hint)


def _follow(relay: "Relay", tracker: Tracker, *, json: bool) -> Exception | None:
    """Show what is carried until it ends; give what made it end, unless that was planned."""
    while True:
        events: list[TrafficEvent] = []
        for _ in range(PRINTED_TOGETHER):
            news = relay.news.get()
            if news is None or isinstance(news, Exception):
                print_events(events, json=json)
                return news
            events += tracker.pass_time(news) if isinstance(news, float) else tracker.feed(news)
            if relay.news.empty():
                break
        print_events(events, json=json)


class Relay(threading.Thread):
    """Carries bytes between an application and the line, or only listens; `news` tells of them.

    Nothing that is printed holds it up: printing is another thread's. What a tap on the line tells is written to the
    file and published after the bytes were passed on, so that the application waits for neither.
    """

    def __init__(
        self,
        wire: Transport,
        app: PseudoTerminal | None,
        file: RecordingFile | None,
        stop: threading.Event,
        *,
        once: bool = False,
    ) -> None:
        super().__init__(name="relay", daemon=True)
        self.news: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._carried: list[Entry] = []
        """What the tap told and is not published yet."""
        heard = Direction.UNKNOWN if app is None else Direction.IN
        self._wire = TapTransport(wire, self._carried.append, heard=heard)
        self._app, self._file, self._stop_asked, self._once = app, file, stop, once
        self._published_at = 0.0
        self._busy_until = 0.0
        """s: until then what was sent is on the wire."""
        self._refused = 0
        """Speed that the port cannot be set to."""

    def end(self) -> None:
        """Have it end, and wait until it has."""
        self._stop_asked.set()
        self.join()

    def run(self) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL)
        failure: Exception | None = None
        try:
            if self._app is None:
                self._listen()
            else:
                self._carry(self._app)
        except Exception as error:  # noqa: BLE001 - whatever it is, the thread that waits for news must hear of it
            failure = error
        self._carried.append(TapEnd(self._wire.elapsed()))
        self._publish()
        self.news.put(failure)

    def _listen(self) -> None:
        while not self._stop_asked.is_set():
            self._wire.read(TICK)
            self._publish()

    def _carry(self, app: PseudoTerminal) -> None:
        port = self._wire.fileno()
        while not self._stop_asked.is_set():
            present = app.has_client
            if port is not None:
                # A terminal that no client has open is always readable: it is looked at now and then instead.
                wanted = [port, app.fileno()] if present else [port]
                ready = select.select(wanted, [], [], TICK if present else LOOK_PERIOD)[0]
            self._follow_speed(round(app.baud()))
            if data := app.read():
                self._busy_until = (
                    max(self._busy_until, self._wire.elapsed()) + len(data) * BITS_PER_BYTE / self._wire.baud
                )
                self._wire.write(data)
            elif present and not app.has_client and self._once:
                return
            if (port is None or port in ready) and (data := self._wire.read(POLL if port is None else 0)):
                app.write(data)
            self._publish()

    def _follow_speed(self, baud: int) -> None:
        """Set the port to the application's speed, after what was sent at the old one."""
        if baud in (self._wire.baud, self._refused):
            return
        self._wire.sleep(max(self._busy_until - self._wire.elapsed(), 0))
        try:
            self._wire.set_baud(baud)
        except ServobusError as error:
            self._refused = baud
            note(f"servobus: {error}; the line stays at {self._wire.baud} baud")

    def _publish(self) -> None:
        """Tell what was carried since; if it was nothing, tell the time now and then."""
        for entry in self._carried:
            if self._file is not None:
                self._file.write(entry)
            self._published_at = entry.time
            self.news.put(entry)
        self._carried.clear()
        now = self._wire.elapsed()
        if now - self._published_at >= TICK:
            self._published_at = now
            self.news.put(now)
