"""`replay`: play a recording into virtual servos."""

from collections.abc import Iterator
from pathlib import Path

import click

from servobus.cli import complete
from servobus.cli.decode import read_recording
from servobus.cli.options import as_json, verb
from servobus.cli.output import compact
from servobus.connect import VIRTUAL, transport
from servobus.errors import UsageError
from servobus.traffic.mcap_recording import is_mcap
from servobus.traffic.playing import Played, play
from servobus.traffic.present import packet_entries
from servobus.traffic.recording import is_recording

INDENT = " " * 14


@verb(
    "replay",
    "servobus replay arm.rec virtual:rx28@1-6",
    "servobus replay fault.mcap 'virtual:ax12a@1?clock=virtual' --json",
)
@click.argument("recording", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("port", shell_complete=complete.ports)
@as_json
def replay(recording: Path, port: str, json: bool) -> None:
    """Play a RECORDING into virtual servos, and show what they answer in another way.

    The requests of the recording (.rec or .mcap) are sent at the times at which they were sent; with ?clock=virtual as
    fast as the computer can. Answers that differ from the recorded ones are shown; virtual servos begin where their
    SPEC says, so the first positions may differ. PORT is virtual: a real servo would move as it was moved then.

    --json gives one object a request.
    """
    if not port.startswith(VIRTUAL):
        raise UsageError(f"{port}: a recording is played into virtual servos only, such as virtual:rx28@1-4")
    content = recording.read_bytes()
    if not (is_recording(content) or is_mcap(content)):
        raise UsageError(f"{recording} is no recording; `servobus sniff --save` and `servobus serve` write them")
    recorded = read_recording(content, str(recording))
    line = transport(port)
    line.set_baud(recorded.header.baud)
    asked = same = 0
    try:
        for played in play(recorded.entries, line):
            asked += 1
            same += played.same
            if json:
                click.echo(compact(_entry(played)))
            elif not played.same:
                click.echo("\n".join(_difference(played)))
    finally:
        line.close()
    if not json:
        click.echo(f"{asked} requests played: {same} answered as recorded, {asked - same} in another way")


def _entry(played: Played) -> dict[str, object]:
    return {
        "time": played.time,
        "request": played.request.hex(" ").upper(),
        "recorded": played.recorded.hex(" ").upper(),
        "heard": played.heard.hex(" ").upper(),
        "same": played.same,
    }


def _difference(played: Played) -> Iterator[str]:
    rows = (f"{played.time:12.6f}", played.request), ("recorded", played.recorded), ("now", played.heard)
    for head, data in rows:
        said = "; ".join(entry["text"] for entry in packet_entries(data)) or "nothing"
        yield click.wrap_text(said, 80, f"{head:>12}  ", INDENT)
