"""`decode`: explain bytes, packet by packet."""

import re
import sys
from pathlib import Path

import click

from servobus import FAMILIES
from servobus.cli import complete
from servobus.cli.options import FamilyOption, as_json, verb
from servobus.cli.output import note, print_json
from servobus.cli.packets import print_events, print_summary
from servobus.core.framing import Corrupt, Packet
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.families.present import packet_entries
from servobus.traffic.present import BYTES_PER_LINE
from servobus.traffic.recording import is_recording, parse
from servobus.traffic.tracker import Tracker

INDENT = " " * 8


@verb(
    "decode",
    "servobus decode FF FF 01 04 02 24 02 D2",
    "servobus decode 55550103 1CDF 0x55 0x55",
    "servobus decode --family herkulex sniffed.txt",
    "servobus decode --model rx28 sniffed.txt",
    "servobus decode arm.rec",
    "cat /tmp/capture.bin | servobus decode -",
)
@click.argument("source", metavar="HEX...|FILE|-", nargs=-1, required=True)
@click.option(
    "--family",
    cls=FamilyOption,
    metavar="FAMILY",
    shell_complete=complete.families,
    help="{families}; else what fits best.",
)
@click.option(
    "--model",
    metavar="MODEL",
    shell_complete=complete.models,
    help="Whose registers; else those of the family's first model.",
)
@as_json
def decode(source: tuple[str, ...], family: str | None, model: str | None, json: bool) -> None:
    """Explain bytes packet by packet, with what is broken or junk between them.

    Bytes are hex digits, with or without spaces and 0x, or a file of hex digits or of the bytes themselves. A
    file that `servobus sniff --save` wrote is shown as it was live; with --json one object a line.
    """
    data, name = _bytes(source)
    if is_recording(data):
        replay(data, name, family, model, json=json)
        return
    table = _model(data, family, model)
    entries = packet_entries(table, data)
    if json:
        print_json(entries)
        return
    click.echo(f"{table.family.title}, registers of {table.title}, {len(data)} bytes")
    for entry in entries:
        raw = bytes.fromhex(entry["hex"])
        for at in range(0, len(raw), BYTES_PER_LINE):
            click.echo(f"{entry['offset'] + at:6d}  {raw[at : at + BYTES_PER_LINE].hex(' ').upper()}")
        click.echo(click.wrap_text(entry["text"], 80, INDENT, INDENT))


def replay(content: bytes, name: str, family: str | None, model: str | None, *, json: bool) -> None:
    """Show a recording as it was shown live. Raises UsageError for one that cannot be read."""
    try:
        recording = parse(content)
        head = recording.header
        # What is said now counts more than what was said then, as a whole: another family has other models.
        said = (family, model) if family or model else (head.family, head.model)
        whose, table = find_family_and_model(*said)
    except UsageError as error:
        raise UsageError(f"{name}: {error}") from None
    if not json:
        click.echo(f"{head.port} at {head.baud} baud, recorded {head.started}")
    tracker = Tracker(whose, table, head.baud)
    for entry in recording.entries:
        print_events(tracker.feed(entry), json=json)
    print_events(tracker.finish(), json=json)
    print_summary(tracker, json=json)
    if recording.cut:
        note(f"{name}: the last line was cut off and is left out")


def find_family_and_model(family: str | None, model: str | None) -> tuple[Family | None, type[Model] | None]:
    """Find family and model as people name them. Raises UsageError if there is none, or they do not belong together."""
    known = registry.family(family) if family else None
    if not model:
        return known, None
    table = registry.model(model)
    if known and known.name != table.family.name:
        raise UsageError(f"{table.title} is of the family {table.family.name}, not {family}")
    return table.family, table


def _model(data: bytes, family: str | None, model: str | None) -> type[Model]:
    """Find whose packets and registers these are, from what is said of them or from the bytes."""
    known, table = find_family_and_model(family, model)
    return table or registry.first_model(known or likely_family(data))


def likely_family(data: bytes) -> Family:
    """Choose the family whose framing finds most packets in the bytes."""

    def score(family: Family) -> tuple[int, int]:
        events = family.framing.decode(data)
        packets = [event for event in events if isinstance(event, Packet)]
        return len(packets), sum(isinstance(event, Corrupt) for event in events)

    return max(FAMILIES.values(), key=score)


def _bytes(source: tuple[str, ...]) -> tuple[bytes, str]:
    """Give the bytes that are meant, and where they come from."""
    if source == ("-",):
        return _content(sys.stdin.buffer.read(), "standard input"), "standard input"
    typed = _hex(" ".join(source))
    if typed is not None:
        return typed, ""
    if len(source) > 1:
        raise UsageError(f"{' '.join(source)!r} is no row of hex bytes")
    if not source[0] or not Path(source[0]).exists():
        raise UsageError(f"{source[0]!r} is neither a row of hex bytes nor a file")
    return _content(Path(source[0]).read_bytes(), source[0]), source[0]


def _content(content: bytes, name: str) -> bytes:
    """Read a file: hex text if it is nothing but that, else the bytes themselves."""
    if not content.strip():
        raise UsageError(f"{name} is empty")
    try:
        text = content.decode("ascii")
    except UnicodeDecodeError:
        return content
    typed = _hex(text)
    return content if typed is None else typed


def _hex(text: str) -> bytes | None:
    """Read hex bytes, or give None if that is none."""
    words = re.split(r"[\s,;:]+", text.strip())
    digits = "".join(re.sub(r"^(0x|\\x)", "", word, flags=re.IGNORECASE) for word in words)
    digits = digits.replace("\\x", "")
    if len(digits) % 2 or not digits or not re.fullmatch(r"[0-9a-fA-F]+", digits):
        return None
    return bytes.fromhex(digits)
