"""Bytes as people write them: hex and decimal dumps, arrays, strings, logs with times and labels.

`read` takes a text and gives the bytes in it, with what the text says of times and directions, and how it was read.
Text that is no bytes is never taken for bytes: it is refused, with its line and its word. Exports of logic analysers
and hex dumps with offsets are read by servobus.traffic.exports. No port, no clock, no file.
"""

import ast
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from servobus.errors import UsageError
from servobus.traffic import exports
from servobus.traffic.labels import TIME_OR_BYTES, Label, direction_of, names_what_follows, strip_label, without_numbers
from servobus.traffic.recording import Chunk, Direction

HEX, DECIMAL, SIGNED, BINARY = "hexadecimal", "decimal", "signed decimal", "binary"
LONGEST_WORD = 40
"""Characters of a word that a message repeats."""
HOUR = 3600.0
SEPARATORS = re.compile(r"[\s,;|{}()\[\]]+")
JOINTS = re.compile(r"[:_]+|(?<=[0-9a-fA-F])-+")
"""What joins bytes to one word: FF:FF, FF-FF, FF_FF."""
EXPLICIT = re.compile(r"(?:0[xX]|[xX]|\$|#|&[hH]|16#)([0-9a-fA-F]+)[uUlL]*|([0-9a-fA-F]+)[hH]")
"""A word that says itself that it is hexadecimal."""
BARE = re.compile(r"-?[0-9a-fA-F]+")
BITS = re.compile(r"0[bB][01]{3,8}")
STRING = re.compile(r"""(?<![\w'"])([bBrRuU]{0,2})("(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')""")
CAST = re.compile(r"\(\s*(?:unsigned\s+char|signed\s+char|char|u?int8_t|byte|u8)\s*\)")
ASSIGNED = re.compile(
    r"(?<![\w$#\\])([A-Za-z_][\w .*&<>]{0,60})(?:\[\s*\w*\s*\][\w .*&<>]{0,60}){0,3}\s*=(?!=)"
    r"(?:\s*new\s+\w+\s*\[\s*\w*\s*\])?"
)
OF_HEX = re.compile(r"""(?:fromhex|unhexlify|a2b_hex)\s*\(\s*b?(["'])([0-9a-fA-F\s]*)\1""")
CALL = re.compile(r"(?<![\w$#\\])((?:\[\s*\])?[A-Za-z_&][\w:<>!&*. ]{0,60}?|&)\s*(?=[\[({])")
COMMENT = re.compile(
    r"/\*.*?\*/|//[^\n]*|(?<!\S)#(?!\s*\d|[0-9a-fA-F]{2}\b)[^\n]*"
    r"|(?<=\S)[ \t]+#(?![0-9a-fA-F]{1,2}\b)[^\n]*",
    re.DOTALL,
)
OFFSET = re.compile(
    r"\s*((?:0x)?[0-9a-fA-F]{4,16}(?:-[0-9a-fA-F]{4,16})?:|[0-9a-fA-F]{4,8}:[0-9a-fA-F]{4,8}(?=\s+\S))\s"
)
COUNTED = re.compile(
    r"[(\[]\s*(?:len\s*=?\s*)?\d+\s*(?:bytes?|B)\s*[)\]]|(?<!\w)(?:len|length|size|count)\s*=\s*\d+(?!\w)[,;]?"
    r"|(?<=\w)\(\d+\)(?=\s*[\[{])",
    re.IGNORECASE,
)
"""How many bytes there are: (6 bytes), len=6, Uint8Array(6) [...]."""
NUMBERED = re.compile(r"([0-9]{1,3}|[0-9a-fA-F]{2}):\s+(?=[^:]+$)")
"""A number before the bytes of a line: a count, an id, a channel."""
SYMBOLS = re.compile("[\u25a0-\u25ff]+|^[ \t]*```.*$", re.MULTILINE)
"""Squares and the like, with which terminal programs mark what they show; fences of Markdown."""
TWICE = re.compile(r"0[xX]([0-9a-fA-F]{1,2})\s*\(\s*([0-9]{1,3})\s*\)")
"""One byte both ways: 0xFF (255)."""
NO_BYTES = (
    r":\s*&?\s*(?:mut\s+)?\[\s*u8\s*(?:;\s*\w+\s*)?\](?=\s*=)",
    r"(?<=\d)_?u8\b",
    r"(?<=array)<[^<>\n]*>",
    r",\s*dtype\s*=\s*[\w.'\"]+",
    r"(?<=array\()\s*[\"'][bB][\"']\s*,",
    r"#\s*define\s+\w+(?=\s+[{(])",
    r"^[ \t]*(?:\$\s+)?(?:echo|printf)(?:\s+-\w+)*\s+(?=['\"])",
    r"(?<=['\"])\s*>\s*/\S+",
    # A plus between two strings, not one inside a string: the quote before it closes.
    r"(?<=[^(\[,=\s]['\"])(?<!\W[bB]['\"])(?<!^[bB]['\"])\s*\+(?=\s*[bB]?['\"])",
    r"(?<=['\"])\s*\\[ \t]*$",
)
"""What programs say of the type and the use of their bytes: [u8; 6], dtype=uint8, echo -ne "..." > /dev/ttyUSB0."""
TYPES = re.compile("|".join(NO_BYTES), re.MULTILINE)
TRACED = re.compile(
    r"""\b(write|read)\(\d+(?:<[^>\n]*>)?,\s*("(?:\\.|[^"\\\n])*")(\.\.\.)?,\s*\d+\)\s*=\s*\d+(?:\s*<[\d.]+>)?"""
)
"""A call that strace shows."""
BLANK_IN_STRING = re.compile(r"\\x[0-9a-fA-F]{2}\\x.* \S*\\x|\\x[0-9a-fA-F]{2} .*\\x[0-9a-fA-F]{2}\\x")
ESCAPED = re.compile(r"(?<![^\s,;|])(?:\\x[0-9a-fA-F]{2}|\\[0-7]{3}|\\[abfnrtv\\]|[!-+\--:<-\[\]-{}~])+(?![^\s,;|])")
"""What stands between the quotes of a string of bytes: \\xff\\xff\\x01$."""
GIVEN = re.compile(
    r"(?<![\w$#\\.])([A-Za-z_][\w.]*)(?:\[\s*\w*\s*\])*\s*(?:=(?!=)|\((?=\s*-?(?:0[xX])?[0-9a-fA-F]+\s*\)))"
)
"""A name that is given a value, or a call with one number."""
HEX_WORDS = re.compile(r"[0-9a-fA-F\s]*")
PLAIN = re.compile(r"[0-9a-fA-F\s,;]*")
"""A text of nothing but digits and what stands between them."""
BUFFER = re.compile(r"<Buffer\s+([0-9a-fA-F\s]*)>")


@dataclass(frozen=True, slots=True)
class Pasted:
    """Bytes that were read from a text.

    chunks  in the order of the text, or of time where it gives times, s
    how     how they were read: "decimal bytes"
    detail  what else is to be said of it, a comma before it
    timed   whether the times are those of the text; else all of them are 0
    """

    chunks: tuple[Chunk, ...]
    how: str
    detail: str = ""
    timed: bool = False

    @property
    def data(self) -> bytes:
        return b"".join(chunk.data for chunk in self.chunks)

    @property
    def directed(self) -> bool:
        """Whether the text says which bytes go to the servos and which come from them."""
        return {Direction.OUT, Direction.IN} <= {chunk.direction for chunk in self.chunks}

    def said(self) -> str:
        """Say how they were read, for people: "read as decimal bytes, 9 of them"."""
        return f"read as {self.how}, {len(self.data)} of them{self.detail}"


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    label: Label
    words: tuple[str, ...]
    labelled: bool
    """Whether something before the words was left out."""
    coded: bool
    """Whether the words stand in a list or a call of a program."""


def read(text: str, packets: Callable[[bytes], int]) -> Pasted:
    """Read the bytes that a text gives. Raises UsageError for what cannot be read, with its line and its word.

    `packets` counts the bytes of a reading that stand in good packets: it decides where digits may be hexadecimal as
    well as decimal.
    """
    export = exports.read(text)
    if export is not None:
        return _ordered(export.chunks, export.how, export.detail, timed=export.timed)
    lines = _lines(text)
    if not lines:
        raise UsageError("there are no bytes in it")
    base, detail = _base(lines, packets)
    chunks, last, known = list[Chunk](), Direction.UNKNOWN, dict[str, bytes]()
    timed = all(line.label.time is not None for line in lines)
    for line in lines:
        last = line.label.direction or last
        time = line.label.time if timed and line.label.time is not None else 0.0
        for word in line.words:
            if word not in known:
                known[word] = _bytes(word, base, line.number)
        data = b"".join([known[word] for word in line.words])
        chunks.append(Chunk(time, last, data))
    if any(line.labelled for line in lines):
        kept = [name for name, there in (("times", timed), ("directions", _directed(chunks))) if there]
        detail += (
            f", {' and '.join(kept)} from what stands before them" if kept else ", without what stands before them"
        )
    return _ordered(chunks, f"{base} bytes", detail, timed=timed)


def _directed(chunks: Sequence[Chunk]) -> bool:
    return {Direction.OUT, Direction.IN} <= {chunk.direction for chunk in chunks}


def _ordered(chunks: Sequence[Chunk], how: str, detail: str, *, timed: bool) -> Pasted:
    """Put chunks in the order of time; directions count only where there are two."""
    if not _directed(chunks):
        chunks = [replace(chunk, direction=Direction.UNKNOWN) for chunk in chunks]
    if timed:
        chunks = sorted(chunks, key=lambda chunk: chunk.time)
        first = chunks[0].time
        if first < 0 or first >= HOUR:  # before the trigger, of a clock, since 1970
            chunks = [replace(chunk, time=chunk.time - first) for chunk in chunks]
    return Pasted(tuple(chunks), how, detail, timed)


# Lines and words


def _lines(text: str) -> list[_Line]:
    """Take the words that are to be bytes out of each line, and what stands before them."""
    if PLAIN.fullmatch(text):  # much of it, perhaps: nothing to leave out
        split = ((number, tuple(SEPARATORS.split(line))) for number, line in enumerate(text.split("\n"), 1))
        filled = ((number, tuple(word for word in words if word)) for number, words in split)
        return [_Line(number, Label(), words, False, False) for number, words in filled if words]
    text = TYPES.sub(" ", TWICE.sub(_once, TRACED.sub(_traced, text)))
    text = BUFFER.sub(r" \1 ", COUNTED.sub(" ", SYMBOLS.sub(" ", OF_HEX.sub(_of_hex, text))))
    text = COMMENT.sub(lambda found: "\n" * found[0].count("\n"), STRING.sub(_unquoted, text))
    raws = text.split("\n")
    _one_name(raws)
    lines, doubtful, above = list[_Line](), list[_Line](), Label()
    for number, (raw, line) in enumerate(zip(raws, without_numbers(raws), strict=True), 1):
        if offset := OFFSET.match(raw):
            raise UsageError(
                f"line {number}: {offset[1]!r} looks like an offset and does not count the bytes before; leave it out"
            )
        if (named := names_what_follows(line)) is not None:
            above = named
            continue
        label, rest = strip_label(line)
        labelled = rest != raw.strip() or above != Label()
        if number_before := NUMBERED.match(rest):
            counted = rest[number_before.end() :]
            if not labelled or number_before[1] != str(len(SEPARATORS.split(counted.strip()))):
                raise UsageError(
                    f"line {number}: {number_before[1] + ':'!r} may be a number before the bytes or one of them; leave "
                    "it out, or the colon"
                )
            rest = counted
        if above != Label():
            label = replace(
                label,
                time=above.time if label.time is None else label.time,
                direction=label.direction or above.direction,
            )
        if re.search(r"[=\[({]", rest):
            rest = CALL.sub(_left_out, ASSIGNED.sub(_left_out, CAST.sub(" ", rest)))
        coded = bool(re.search(r"[{}()\[\]]", rest))
        if "\\" in rest:
            rest = _escapes(rest, number)
        words = tuple(rest.split()) if HEX_WORDS.fullmatch(rest) else _words(rest)
        if words:
            kind = doubtful if TIME_OR_BYTES.fullmatch(rest) else lines
            kind.append(_Line(number, label, words, labelled, coded))
    return _without_times(lines, doubtful)


def _without_times(lines: list[_Line], doubtful: list[_Line]) -> list[_Line]:
    """Tell what lines such as 12:34:56:100 are: bytes where there are no others, times beside hexadecimal bytes.

    Raises UsageError where both may be meant.
    """
    if not lines or not doubtful:
        return lines or doubtful
    others = {word for line in lines for word in line.words}
    hexadecimal = any(EXPLICIT.fullmatch(word) or re.search("[a-fA-F]", word) for word in others)
    if not hexadecimal and all(int(line.words[-1]) <= 255 for line in doubtful):
        first = doubtful[0]
        raise UsageError(
            f"line {first.number}: {':'.join(first.words)!r} may be a time or four decimal bytes; leave it out, or "
            "write blanks between its bytes"
        )
    return lines


def _words(rest: str) -> tuple[str, ...]:
    return tuple(part for word in SEPARATORS.split(rest) for part in _parts(word))


def _escapes(rest: str, number: int) -> str:
    """Read the inside of a string of bytes that lost its quotes."""
    if BLANK_IN_STRING.search(rest):
        raise UsageError(f"line {number}: a blank between bytes as \\xFF may be a byte itself; put quotes round them")

    def literal(found: re.Match[str]) -> str:
        if not re.search(r"\\x|\\[0-7]{3}", found[0]):
            return found[0]
        quoted = found[0].replace('"', '\\"')
        return "".join(f" 0x{byte:02X}" for byte in ast.literal_eval(f'b"{quoted}"')) + " "

    return re.sub(r"\\[xX]([0-9a-fA-F]{1,2})", r" 0x\1 ", ESCAPED.sub(literal, rest))


def _once(found: re.Match[str]) -> str:
    return f" 0x{found[1]} " if int(found[1], 16) == int(found[2]) else found[0]


def _traced(found: re.Match[str]) -> str:
    if found[3]:
        raise UsageError(f"{found[0]:.{LONGEST_WORD}} is cut off; run strace with -s 1000")
    return f" {'TX' if found[1] == 'write' else 'RX'}: {found[2]} "


def _one_name(lines: Sequence[str]) -> None:
    """Refuse numbers that a program gives to other names, or in other calls, than the bytes: id = 1, delay(10)."""
    single: dict[str, int] = {}
    names: dict[str, int] = {}
    for number, line in enumerate(lines, 1):
        if "=" not in line and "(" not in line:
            continue
        given = [*GIVEN.finditer(line)]
        for one in given:
            name = re.sub(r"\d+$", "", re.split(r"\W", one[1].strip())[-1])
            names.setdefault(name, number)
            if len(given) > 1 or re.match(r"\s*-?\w+\s*(?:[;,)].*)?$", line[one.end() :]):
                single.setdefault(name, number)
    if single and len(names) > 1 and not all(direction_of(name) and name not in ("from", "to") for name in names):
        odd = next(iter(single))
        raise UsageError(
            f"line {single[odd]}: {_short(odd)} is one name of several ({', '.join(names)}); keep only what is bytes"
        )


def _of_hex(found: re.Match[str]) -> str:
    """Mark what a call says to be hexadecimal."""
    return "(" + "".join(f" 0x{digits}" for digits in re.findall("[0-9a-fA-F]{1,2}", found[2]))


def _left_out(found: re.Match[str]) -> str:
    """Leave the name of a variable or a function out, unless some of it may be bytes."""
    words = re.findall(r"\w+", found[1])
    bytes_in_it = any(re.fullmatch("[0-9a-fA-F]{2}|[0-9]+", word) or EXPLICIT.fullmatch(word) for word in words)
    return found[0] if bytes_in_it or _is_hex(words) else " "


def _is_hex(words: Sequence[str]) -> bool:
    return bool(words) and all(re.fullmatch("[0-9a-fA-F]+", word) for word in words)


def _unquoted(found: re.Match[str]) -> str:
    """Give a string as bytes 0xNN if it is one of bytes; else what stands in it."""
    prefix, literal = found[1].lower(), found[2]
    if "b" in prefix or "\\" in literal:
        try:
            data = ast.literal_eval(f"b{'r' * ('r' in prefix)}{literal}")
        except (ValueError, SyntaxError):
            raise UsageError(f"{found[0]:.{LONGEST_WORD}} is no string of bytes that can be read") from None
        return "".join(f" 0x{byte:02X}" for byte in data) + " "
    inside = literal[1:-1].strip()
    if len(inside) == 1:
        raise UsageError(f"{literal} may be a letter or a byte; write it without quotes, with 0x before it")
    return f" {inside} "


def _parts(word: str) -> list[str]:
    """Part what is joined to one word."""
    return [part for part in JOINTS.split(word.strip("'\"`")) if part]


# Hexadecimal or decimal


def _base(lines: Sequence[_Line], packets: Callable[[bytes], int]) -> tuple[str, str]:
    """Tell what the digits mean, the same for all words, and how that is known if they leave it open."""
    seen: set[str] = set()
    for line in lines:
        for word in line.words:
            if word in seen:
                continue
            seen.add(word)
            if not BARE.fullmatch(word) and not EXPLICIT.fullmatch(word):
                raise UsageError(f"line {line.number}: {_short(word)} is no byte; text is not read as bytes")
    words = {word: None for line in lines for word in line.words}
    if all(BITS.fullmatch(word) for word in words):
        return BINARY, ""
    bare = [word for word in words if BARE.fullmatch(word)]
    mixed = ", but those marked as hexadecimal" if len(bare) < len(words) else ""
    if any(word.startswith("-") for word in bare):
        return SIGNED, mixed
    if not bare or any(re.search("[a-fA-F]", word) for word in bare):
        return HEX, ""
    if any(len(word) == 3 for word in bare):
        return DECIMAL, mixed
    if any(len(word) > 2 for word in bare) or all(int(word, 16) == int(word) for word in bare):
        return HEX, ""
    coded = any(line.coded for line in lines)
    if mixed and coded and not any(word.startswith("0") for word in bare if len(word) > 1):
        return DECIMAL, mixed
    return _by_packets(lines, packets, mixed=mixed, coded=coded)


def _by_packets(lines: Sequence[_Line], packets: Callable[[bytes], int], *, mixed: str, coded: bool) -> tuple[str, str]:
    """Choose the reading that has packets in it."""
    fits = {
        base: packets(b"".join(_bytes(word, base, line.number) for line in lines for word in line.words)) > 0
        for base in (HEX, DECIMAL)
    }
    if fits[HEX] and fits[DECIMAL]:
        raise UsageError("the digits make packets in hexadecimal and in decimal; write 0x before hexadecimal bytes")
    if fits[DECIMAL]:
        return DECIMAL, f"{mixed}, as only so there are packets in them"
    if mixed and not fits[HEX]:
        raise UsageError("some bytes are marked as hexadecimal and some are not; mark all of them, or none")
    return (DECIMAL if coded and not fits[HEX] else HEX), ""


def _bytes(word: str, base: str, line: int) -> bytes:
    """Give the bytes of one word. Raises UsageError."""
    if base == BINARY:
        return bytes((int(word, 2),))
    if marked := EXPLICIT.fullmatch(word):
        # 0FFh: assemblers want a digit first.
        digits = marked[1] or (marked[2][1:] if len(marked[2]) % 2 and marked[2][0] == "0" else "") or marked[2]
        return _hex(digits, word, line)
    if base == HEX:
        return _hex(word, word, line)
    value = int(word) if re.fullmatch("-?[0-9]{1,3}", word) else 256
    low, high = (-128, 127) if base == SIGNED else (0, 255)
    if not low <= value <= high:
        raise UsageError(f"line {line}: {_short(word)} is no byte: the others are {base}, {low} to {high}")
    return bytes((value & 0xFF,))


def _hex(digits: str, word: str, line: int) -> bytes:
    if len(digits) <= 2:
        return bytes((int(digits, 16),))
    if len(digits) % 2:
        raise UsageError(f"line {line}: {_short(word)} is no byte: {len(digits)} hexadecimal digits are no whole bytes")
    return bytes.fromhex(digits)


def _short(word: str) -> str:
    return repr(word if len(word) <= LONGEST_WORD else f"{word[:LONGEST_WORD]}...")
