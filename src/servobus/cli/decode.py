"""`decode`: explain bytes, packet by packet."""

import sys
from pathlib import Path
from typing import Any

import click

from servobus import FAMILIES
from servobus.cli.options import FamilyOption, ModelOption, as_json, verb
from servobus.cli.output import compact, note, print_json
from servobus.cli.packets import print_events, print_summary
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.traffic import pasted
from servobus.traffic.mcap_recording import McapRecording, is_mcap, parse_mcap
from servobus.traffic.pasted import Pasted
from servobus.traffic.present import BYTES_PER_LINE, packet_entries
from servobus.traffic.recording import Chunk, Direction, Note, Recording, is_recording, parse
from servobus.traffic.streams import good_bytes
from servobus.traffic.tracker import Tracker

INDENT = " " * 8


@verb(
    "decode",
    "servobus decode FF FF 01 04 02 24 02 D2",
    "servobus decode 55550103 1CDF 0x55 0x55",
    "servobus decode '{255, 255, 1, 2, 1, 251}'",
    "servobus decode --family herkulex sniffed.txt",
    "servobus decode --model rx28 saleae.csv",
    "servobus decode arm.rec",
    "servobus decode arm.rec --mcap arm.mcap",
    "cat /tmp/capture.bin | servobus decode -",
)
@click.argument("source", metavar="BYTES...|FILE|-", nargs=-1, required=True)
@click.option("--family", cls=FamilyOption, metavar="FAMILY", help="{families}; else all of them are looked for.")
@click.option(
    "--model", cls=ModelOption, metavar="MODEL", help="Whose registers; else those of the model that a servo reports."
)
@click.option(
    "--mcap",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write a recording as MCAP too, for Foxglove and PlotJuggler; needs servobus[mcap].",
)
@as_json
def decode(source: tuple[str, ...], family: str | None, model: str | None, mcap: Path | None, json: bool) -> None:
    """Explain bytes packet by packet, with what is broken or junk between them.

    Bytes are taken as people have them: hex and decimal dumps, arrays and strings of programs, logs with times and
    labels, exports of Saleae Logic and sigrok, or a file of the bytes themselves. How they were read is said first;
    what cannot be read is refused. A recording (of `servobus sniff --save` or `servobus serve`, .rec or .mcap), and
    what has times or both directions, is shown as it was live; with --json one object a line.
    """
    content, name = _content(source)
    if is_recording(content) or is_mcap(content):
        recording = read_recording(content, name)
        if mcap is not None:
            _write_mcap(recording, mcap)
        show_recording(recording, name, family, model, json=json)
        return
    if mcap is not None:
        raise UsageError(f"--mcap writes recordings, and {name or 'what was typed'} is none")
    known, table = find_family_and_model(family, model)
    given = _read(content, name, source)
    if given.timed or given.directed:
        _follow(given, Tracker(known, table), json=json)
        return
    entries = packet_entries(given.data, known, table)
    if json:
        print_json([{**entry, "read_as": given.said()} for entry in entries])
        return
    click.echo(click.wrap_text(given.said(), 80))
    for line in _whose([entry["family"] for entry in entries], table):
        click.echo(click.wrap_text(line, 80))
    for entry in entries:
        _print_packet(entry)


def _print_packet(entry: dict[str, Any]) -> None:
    raw = bytes.fromhex(entry["hex"])
    for at in range(0, len(raw), BYTES_PER_LINE):
        click.echo(f"{entry['offset'] + at:6d}  {raw[at : at + BYTES_PER_LINE].hex(' ').upper()}")
    click.echo(click.wrap_text(entry["text"], 80, INDENT, INDENT))


def _whose(names: list[str | None], model: type[Model] | None) -> list[str]:
    """Say whose packets these are, and where units come from."""
    lines = []
    for name in dict.fromkeys(name for name in names if name is not None):
        family = FAMILIES[name]
        if model is not None and model.family.name == name:
            lines.append(f"{family.title}, registers of {model.title}")
        elif family.one_table:
            lines.append(f"{family.title}; all its models have the same registers")
        else:
            lines.append(f"{family.title}; values are bytes at addresses until the model is known, or named by --model")
    return lines


def _follow(given: Pasted, tracker: Tracker, *, json: bool) -> None:
    """Show bytes whose times or directions are known as they were on the line."""
    click.echo(compact({"kind": "read", "text": given.said()}) if json else click.wrap_text(given.said(), 80))
    for chunk in given.chunks:
        print_events(tracker.feed(chunk), json=json, timed=given.timed)
    print_events(tracker.finish(), json=json, timed=given.timed)
    print_summary(tracker, json=json, timed=given.timed)


def read_recording(content: bytes, name: str) -> Recording:
    """Read a recording, as text or as MCAP. Raises UsageError for one that cannot be read."""
    try:
        return parse_mcap(content) if is_mcap(content) else parse(content)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None


def show_recording(recording: Recording, name: str, family: str | None, model: str | None, *, json: bool) -> None:
    """Show a recording as it was shown live. Raises UsageError where family and model make no sense."""
    head = recording.header
    try:
        # What is said now counts more than what was said then, as a whole: another family has other models.
        said = (family, model) if family or model else (head.family, head.model)
        whose, table = find_family_and_model(*said)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None
    if not json:
        click.echo(f"{head.port} at {head.baud} baud, recorded {head.started}")
    tracker = Tracker(whose, table, head.baud)
    for line in recording.lines:
        if isinstance(line, Note):
            print_events(tracker.pass_time(line.time), json=json)
            _print_note(line, json=json)
        else:
            print_events(tracker.feed(line), json=json)
    print_events(tracker.finish(), json=json)
    print_summary(tracker, json=json)
    if recording.cut:
        note(f"{name}: the last line was cut off and is left out")


def _print_note(line: Note, *, json: bool) -> None:
    if json:
        click.echo(compact({"kind": line.kind, "time": line.time, **line.data}))
        return
    text = f"{line.time:10.6f}   {line.kind}: {compact(line.data)}"
    click.echo(click.wrap_text(text, 80, "", " " * 13))


def _write_mcap(recording: Recording, path: Path) -> None:
    with McapRecording(path, recording.header) as file:
        for line in recording.lines:
            file.write(line)
    if file.failure is not None:
        raise file.failure
    note(f"{path}: {len(recording.lines)} entries written as MCAP")


def find_family_and_model(family: str | None, model: str | None) -> tuple[Family | None, type[Model] | None]:
    """Find family and model as people name them. Raises UsageError if there is none, or they do not belong together."""
    known = registry.family(family) if family else None
    if not model:
        return known, None
    table = registry.model(model)
    if known and known.name != table.family.name:
        raise UsageError(f"{table.title} is of the family {table.family.name}, not {family}")
    return table.family, table


def _content(source: tuple[str, ...]) -> tuple[bytes, str]:
    """Give what is meant, and where it comes from; no name for what was typed."""
    if source == ("-",):
        content, name = sys.stdin.buffer.read(), "standard input"
    elif len(source) == 1 and source[0] and Path(source[0]).exists():
        content, name = Path(source[0]).read_bytes(), source[0]
    else:
        return "\n".join(source).encode(errors="surrogateescape"), ""
    if not content.strip():
        raise UsageError(f"{name} is empty")
    return content, name


def _read(content: bytes, name: str, source: tuple[str, ...]) -> Pasted:
    """Read a text that gives bytes, or take the bytes themselves."""
    text = _text(content)
    if text is None:
        return Pasted((Chunk(0.0, Direction.UNKNOWN, content),), "the bytes themselves")
    try:
        return pasted.read(text if name else " ".join(source), lambda data: good_bytes(data, tuple(FAMILIES.values())))
    except UsageError as error:
        said = name or repr(" ".join(source))
        if not name and len(source) == 1:
            raise UsageError(f"{said} is neither a row of bytes nor a file: {error}") from None
        raise UsageError(f"{said}: {error}" if name else f"{said} is no row of bytes: {error}") from None


def _text(content: bytes) -> str | None:
    """Give the text that a file is; None for bytes that are none."""
    code = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(code)
    except UnicodeDecodeError:
        return None
    if not all(letter.isprintable() or letter in "\t\r\n\f" for letter in text):
        return None
    return text.replace("\r\n", "\n").replace("\r", "\n")
