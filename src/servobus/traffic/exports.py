"""What other programs write: exports of logic analysers, and hex dumps with offsets.

Saleae Logic 1       Time [s],Value,Parity Error,Framing Error
                     Time [s],Packet ID,Address,Data,Framing Error
Saleae Logic 2       name,type,start_time,duration,"data"
sigrok-cli           uart-1: rx-data: FF                 with --protocol-decoder-samplenum 10-90 before it
PulseView            10-90 UART: RX: FF
hexdump -C, xxd, od  00000000  ff ff 01 02 01 fb         |......|
"""

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

from servobus.errors import UsageError
from servobus.traffic.labels import direction_of
from servobus.traffic.recording import Chunk, Direction

HEX_COLUMN, DECIMAL_COLUMN = re.compile(r"0x[0-9a-fA-F]{1,2}"), re.compile(r"\d{1,3}")
ANNOTATION = re.compile(r"\s*(?:(\d+)-(\d+)\s+)?[\w .]*?(?:uart|serial)[\w .]*?(?:-\d+)?\s*:\s*(.*?)\s*", re.IGNORECASE)
ROW = re.compile(r"(rx|tx)\b[\s-]*([\w -]*?)\s*:\s*(.*)", re.IGNORECASE)
FRAME_PART = re.compile(
    r"start( bit)?|stop( bit)?|parity( bit| ok)?|[stp01]|frame( error)?|break( condition)?", re.IGNORECASE
)
DIGITS = re.compile(r"(?:0x)?[0-9a-fA-F]{2}|\d{1,3}")
OFFSET = re.compile(r"(?:0x)?([0-9a-fA-F]{4,16})(:\s+|\s{2,}|\s+)(?=\S)")
LETTERS = re.compile(r"[0-9a-fA-F]{2}\s{2,}\S*[^0-9a-fA-F\s]")
"""Bytes, and letters for them in a column behind two spaces."""
OCTAL_DIGITS = 7
"""Digits of the offsets of od, which are octal, and of hexdump without -C, which writes words of two bytes."""
TO_HEX = "set the display of its values to hexadecimal and export it again"


@dataclass(frozen=True, slots=True)
class Export:
    chunks: tuple[Chunk, ...]
    how: str
    detail: str = ""
    timed: bool = False


def read(text: str) -> Export | None:
    """Read an export; None for other texts. Raises UsageError for one that cannot be read."""
    lines = text.strip().split("\n")
    for reader in (_saleae, _annotations, _dump):
        found = reader(lines)
        if found is not None:
            if not found.chunks:
                raise UsageError("there are no bytes in it")
            return found
    return None


def _saleae(lines: Sequence[str]) -> Export | None:
    head = [name.strip().strip('"').lower() for name in lines[0].split(",")]
    if head[0] == "time [s]" and ("value" in head or "data" in head):
        kind, time_at, data_at = "Saleae Logic 1 export", 0, head.index("value" if "value" in head else "data")
        name_at, type_at = None, None
    elif "start_time" in head and "data" in head:
        kind, time_at, data_at = "Saleae Logic 2 export", head.index("start_time"), head.index("data")
        name_at = head.index("name") if "name" in head else None
        type_at = head.index("type") if "type" in head else None
    else:
        return None
    rows: list[tuple[float, str, str]] = []
    for number, row in enumerate(csv.reader(io.StringIO("\n".join(lines[1:]))), 2):
        if not row or (type_at is not None and row[type_at] not in ("data", "")):
            continue
        try:
            time, value = float(row[time_at]), row[data_at]
        except (ValueError, IndexError):
            raise UsageError(f"line {number} is no row of a {kind}: {','.join(row)[:60]!r}") from None
        rows.append((time, row[name_at] if name_at is not None else "", value.strip()))
        if not (HEX_COLUMN.fullmatch(rows[-1][2]) or DECIMAL_COLUMN.fullmatch(rows[-1][2])):
            raise UsageError(f"line {number}: {value[:20]!r} is no byte in a {kind}; {TO_HEX}")
    base = _column_base([value for _, _, value in rows], kind)
    names = list(dict.fromkeys(name for _, name, _ in sorted(rows, key=lambda row: row[0])))
    sides = _sides(names, kind)
    chunks = [Chunk(time, sides[name], bytes((_byte(value, base),))) for time, name, value in rows]
    return Export(tuple(chunks), f"{_base_name(base)} bytes of a {kind}", _who(sides), timed=True)


def _annotations(lines: Sequence[str]) -> Export | None:
    """Read annotations of sigrok's UART decoder: what is no data is a part of its frame, and is left out."""
    kind = "sigrok UART annotations"
    found = [ANNOTATION.fullmatch(line) for line in lines]
    if not any(found) or not all(match or not line.strip() for match, line in zip(found, lines, strict=True)):
        return None
    said: list[tuple[int, Direction, str, str]] = []
    for number, match in enumerate(found, 1):
        if match is None:
            continue
        side, what, value = Direction.UNKNOWN, "", match[3]
        if row := ROW.fullmatch(match[3]):
            side, what, value = (Direction.OUT if row[1].lower() == "tx" else Direction.IN), row[2].lower(), row[3]
        value = value.strip().strip('"')
        if what in ("", "data"):
            if not DIGITS.fullmatch(value) and not FRAME_PART.fullmatch(value):
                raise UsageError(f"line {number}: {value[:20]!r} is no byte in {kind}; {TO_HEX} (format=hex)")
            said.append((int(match[1] or 0), side, what, value))
    three = any(re.fullmatch(r"\d{3}", value) for *_, value in said)
    one = any(re.fullmatch(r"\d", value) and what == "data" for _, _, what, value in said)
    base = 10 if three or one else 16
    if base == 16:
        said = [row for row in said if len(row[3]) > 1]
    said = [row for row in said if DIGITS.fullmatch(row[3])]
    if any(match and match[1] for match in found):
        said.sort(key=lambda row: row[0])
    chunks = [Chunk(0.0, side, bytes((_byte(value, base),))) for _, side, _, value in said]
    samples = ", whose sample numbers tell their order and no times" if any(m and m[1] for m in found) else ""
    return Export(tuple(chunks), f"{_base_name(base)} bytes of {kind}", samples)


def _dump(lines: Sequence[str]) -> Export | None:
    """Read a hex dump whose offsets count the bytes before them."""
    filled = [line.rstrip() for line in lines if line.strip()]
    heads = [OFFSET.match(line.strip()) for line in filled]
    marked = any(head and head[2].startswith(":") for head in heads) or any(
        "|" in line or LETTERS.search(line) for line in filled
    )
    if not filled or heads[0] is None:
        return None
    if not (marked or len(filled) > 1 or re.fullmatch("0{6,}", heads[0][1])):
        return None
    if not marked and not re.fullmatch("0+", heads[0][1]):
        return None
    octal_first = len(heads[0][1]) == OCTAL_DIGITS
    if all(re.match(r"\S+:\s+[01]{8}(\s|$)", line.strip()) for line in filled):
        raise UsageError("this dump is of bits; make it with xxd without -b")
    if (
        octal_first
        and not marked
        and all(re.match(r"\S+\s+[0-9a-fA-F]{4}(\s|$)", line.strip()) for line in filled[:-1])
    ):
        raise UsageError(
            "this dump has words of two bytes, whose order it does not tell; make it with hexdump -C or xxd"
        )
    for base in (8, 16, 10) if octal_first else (16, 8, 10):
        data = _dumped(filled, base)
        if data is not None:
            return Export((Chunk(0.0, Direction.UNKNOWN, data),), "hexadecimal bytes of a dump with offsets")
    return None


def _dumped(lines: Sequence[str], base: int) -> bytes | None:
    """Read the lines of a dump; None if the first numbers are not offsets in this base."""
    data, first, row = bytearray(), None, b""
    repeated = False
    for line in (line.strip() for line in lines):
        if line == "*" and row:
            repeated = True
            continue
        ends = re.fullmatch(r"(?:0x)?[0-9a-fA-F]{4,16}:?", line) is not None
        whole = OFFSET.match(line.removesuffix(":") + " .") if ends else OFFSET.match(line)
        try:
            offset = int(whole[1], base) if whole else -1
        except ValueError:
            return None
        first = offset if first is None else first
        if repeated and row and offset > 0:
            while first + len(data) < offset:
                data += row
            repeated = False
        if whole is None or offset != first + len(data):
            return None
        rest = "" if ends else line[whole.end() :]
        # od, whose offsets have seven digits, writes no letters, and elsewhere more than one space.
        row = _dump_row(rest, letters=len(whole[1]) != OCTAL_DIGITS)
        if rest and not row:
            return None
        data += row
    return bytes(data)


def _dump_row(rest: str, *, letters: bool = True) -> bytes:
    """Take the bytes of one line of a dump, without the column of letters; nothing if there are none.

    That column stands behind two spaces or a bar, and has one letter for each byte. Half a line of bytes, which may
    stand behind two spaces too, is longer.
    """
    if not letters and re.fullmatch(r"(?:[0-9a-fA-F]{2}\s*)+", rest):
        return bytes.fromhex(rest)
    data, barred = b"", "|" in rest
    for part in re.split(r"\s{2,}", rest.split("|", maxsplit=1)[0].rstrip()):
        if not re.fullmatch(r"(?:(?:[0-9a-fA-F]{2})+\s?)+", part) or (data and not barred and len(part) <= len(data)):
            break
        data += bytes.fromhex(part)
    return data


def _column_base(values: Sequence[str], kind: str) -> int:
    if all(HEX_COLUMN.fullmatch(value) for value in values):
        return 16
    if all(DECIMAL_COLUMN.fullmatch(value) for value in values) and any(len(value) > 1 for value in values):
        if any(int(value) > 255 for value in values):
            raise UsageError(f"a value of this {kind} is above 255")
        return 10
    raise UsageError(f"the values of this {kind} may be letters as well as numbers; {TO_HEX}")


def _byte(value: str, base: int) -> int:
    byte = int(value, base)
    if byte > 255:
        raise UsageError(f"{value!r} is no byte: it is above 255")
    return byte


def _base_name(base: int) -> str:
    return "hexadecimal" if base == 16 else "decimal"


def _sides(names: Sequence[str], kind: str) -> dict[str, Direction]:
    """Tell which channel goes to the servos; of two without a telling name the one that speaks first."""
    if len(names) == 1:
        return {names[0]: Direction.UNKNOWN}
    if len(names) > 2:
        listed = ", ".join(names)
        raise UsageError(f"this {kind} has {len(names)} channels, {listed}; export one, or the two directions")
    said = [direction_of(name) for name in names]
    if {*said} == {Direction.OUT, Direction.IN}:
        return {name: side for name, side in zip(names, said, strict=True) if side is not None}
    return {names[0]: Direction.OUT, names[1]: Direction.IN}


def _who(sides: dict[str, Direction]) -> str:
    out = next((name for name, side in sides.items() if side is Direction.OUT), None)
    return "" if out is None else f", channel {out!r} to the servos"
