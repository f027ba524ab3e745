"""`servobus virtual --show`: every servo of the rig in a table that is drawn again and again.

A thread draws; the snapshots of the servos are taken between two events of the bus, few at a time, so that no reply
waits for them. The table goes to standard error: standard output is for programs that wait for `ready`.
"""

import math
import sys
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from servobus.virtual.device.snapshot import VirtualSnapshot, take_snapshot
from servobus.virtual.serve.rig import Rig

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live
    from rich.text import Text

PERIOD = 0.1
"""s between two drawings."""
CPU_SHARE = 0.2
"""Of the processor, that drawing may take: large tables are drawn less often."""
BUDGET = 0.001
"""s that taking snapshots may hold the bus up; then it has its turn."""
SWITCH_INTERVAL = 0.0005
"""s after which Python takes the processor from the thread that draws; its 5 ms could be felt on the bus."""
OTHER_LINES = 6
"""Lines of the terminal beside those of the servos."""

_COLOURS = {
    "on": "bright_white", "red": "red", "green": "green", "blue": "bright_blue", "green+red": "yellow",
    "blue+green": "cyan", "blue+red": "magenta", "blue+green+red": "bright_white",
}  # fmt: skip
"""What an LED shows, its colours in the order of the alphabet -> how a terminal shows it."""


class LiveTable:
    """Draws a rig that is being served until `stop`; a note stands below the table."""

    def __init__(self, rig: Rig, stop: threading.Event, console: "Console | None" = None) -> None:
        self.rig = rig
        self._stop = stop
        self._console = console
        self._name = self._note = ""
        self._typed = 0
        """Lines typed since the table was drawn."""
        self._thread = threading.Thread(target=self._run, name="live table", daemon=True)

    def show_note(self, text: str) -> None:
        """Have a line or more stand below the table."""
        self._note = text

    def line_typed(self) -> None:
        """Take note that a line was typed on the terminal, which has moved the cursor down below the table."""
        self._typed += 1

    def start(self, name: str) -> None:
        """Begin to draw; the servos are served under this name."""
        self._name = name
        sys.setswitchinterval(SWITCH_INTERVAL)
        self._thread.start()

    def join(self) -> None:
        """Wait until the table is drawn for the last time, after `stop`."""
        if self._thread.is_alive():
            self._thread.join()

    def snapshots(self, timeout: float = 5.0) -> list[VirtualSnapshot]:
        """Take a snapshot of every servo; none if the rig is not served for `timeout` s, or `stop` is set."""
        servos, taken, done = self.rig.servos, list[VirtualSnapshot](), threading.Event()

        def some(now: float) -> None:
            started = time.monotonic()
            while len(taken) < len(servos) and time.monotonic() - started < BUDGET:
                servo = servos[len(taken)]
                servo.advance(now)
                taken.append(take_snapshot(servo))
            if len(taken) < len(servos):
                self.rig.post(some)
            else:
                done.set()

        self.rig.post(some)
        deadline = time.monotonic() + timeout
        while not done.wait(0.05):
            if self._stop.is_set() or time.monotonic() > deadline:
                return []
        return taken

    def _run(self) -> None:
        from rich.console import Console  # noqa: PLC0415 - rich is slow to import and not always wanted
        from rich.live import Live  # noqa: PLC0415

        console = self._console or Console(file=sys.stderr, highlight=False, emoji=False)
        with Live(console=console, auto_refresh=False, transient=False, redirect_stdout=False) as live:
            while not self._stop.is_set():
                due = time.monotonic() + PERIOD
                taken = self.snapshots()
                started = time.monotonic()
                if taken:
                    rows = max(1, console.height - OTHER_LINES - self._note.count("\n"))
                    self._draw(live, servo_table(taken, self._name, self._note, rows))
                now = time.monotonic()
                self._stop.wait(max(due - now, (now - started) * (1 / CPU_SHARE - 1)))

    def _draw(self, live: "Live", table: "RenderableType") -> None:
        """Draw over the last table, which rich takes to end where the cursor is."""
        from rich.control import Control  # noqa: PLC0415 - as above

        typed, self._typed = self._typed, 0
        if typed:
            live.console.control(Control.move(0, -typed))
        live.update(table, refresh=True)


def servo_table(
    servos: Sequence[VirtualSnapshot], name: str = "", note: str = "", rows: int = 1000
) -> "RenderableType":
    """Draw servos, at most so many, for a terminal of 80 columns or more."""
    from rich.console import Group  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=None, padding=(0, 1, 0, 0), expand=True, header_style="bold", pad_edge=False)
    for header, width in (("servo", 8), ("id", 3), ("angle", 8), ("speed", 9), ("duty", 6), ("current", 7), ("°C", 3)):
        table.add_column(header, width=width, justify="left" if header == "servo" else "right", no_wrap=True)
    table.add_column("light", width=12, no_wrap=True, overflow="ellipsis")
    table.add_column("errors", ratio=1, min_width=8, overflow="ellipsis", no_wrap=True)
    for one in servos[:rows]:
        table.add_row(
            one.title,
            str(one.id),
            f"{math.degrees(one.angle) + 0.0:.1f}°",
            f"{math.degrees(one.speed) + 0.0:.0f}°/s",
            "off" if not one.powered else "free" if one.duty is None else f"{100 * one.duty + 0.0:.0f} %",
            f"{one.current + 0.0:.2f} A",
            f"{one.temperature:.0f}",
            led_text(one.led),
            Text(", ".join(one.errors), style="bold red"),
        )
    supplies = dict.fromkeys(f"{one.voltage:.2f} V" for one in servos)  # each of them once
    head = f"{name}   supply {', '.join(supplies)}"
    parts: list[RenderableType] = [Text(head.strip(), style="dim"), table]
    if len(servos) > rows:
        parts.append(Text(f"... and {len(servos) - rows} more", style="dim"))
    if note:
        parts.append(Text(note))
    return Group(*parts)


def led_text(led: str) -> "Text":
    """Write what an LED shows, in its colour."""
    from rich.text import Text  # noqa: PLC0415

    if led == "off":
        return Text("○ off", style="dim")
    return Text(f"● {led}", style=_COLOURS.get("+".join(sorted(led.split("+"))), "bright_white"))
