"""Any bytes, written in any of the usual ways, read back as the same bytes (T5); and no text makes the reader fail."""

from collections.abc import Callable

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from servobus.errors import UsageError
from servobus.families.registry import FAMILIES
from servobus.traffic.pasted import Pasted, read
from servobus.traffic.streams import good_bytes


def pasted(text: str) -> Pasted:
    return read(text, lambda data: good_bytes(data, tuple(FAMILIES.values())))


def xxd(data: bytes) -> str:
    rows = []
    for at in range(0, len(data), 16):
        row = data[at : at + 16]
        groups = " ".join(row[n : n + 2].hex() for n in range(0, len(row), 2))
        rows.append(f"{at:08x}: {groups:<39}  {letters(row)}")
    return "\n".join(rows) + "\n"


def hexdump(data: bytes) -> str:
    rows = []
    for at in range(0, len(data), 16):
        row = data[at : at + 16]
        halves = f"{row[:8].hex(' ')}  {row[8:].hex(' ')}"
        rows.append(f"{at:08x}  {halves:<48}  |{letters(row)}|")
    return "\n".join([*rows, f"{len(data):08x}"]) + "\n"


def od(data: bytes) -> str:
    rows = [f"{at:07o} {data[at : at + 16].hex(' ')}" for at in range(0, len(data), 16)]
    return "\n".join([*rows, f"{len(data):07o}"]) + "\n"


def letters(row: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in row)


def per_line(form: str) -> Callable[[bytes], str]:
    return lambda data: "\n".join(form.format(n=n, t=n * 0.0001, byte=byte) for n, byte in enumerate(data))


WAYS: dict[str, Callable[[bytes], str]] = {
    "0x": lambda data: " ".join(f"0x{byte:02X}" for byte in data),
    "0x, short": lambda data: ",".join(f"0x{byte:x}" for byte in data),
    "$": lambda data: " ".join(f"${byte:02x}" for byte in data),
    "h": lambda data: " ".join(f"{byte:03X}h" for byte in data),
    "\\x": lambda data: "".join(f"\\x{byte:02x}" for byte in data),
    "C array": lambda data: f"uint8_t b[{len(data)}] = {{{', '.join(f'0x{byte:02X}' for byte in data)}}};",
    "C array on lines": lambda data: "const unsigned char b[] = {\n" + per_line("0x{byte:02x},  // {n}")(data) + "\n};",
    "python bytes": repr,
    "python bytearray": lambda data: repr(bytearray(data)),
    "python fromhex": lambda data: f"bytes.fromhex('{data.hex()} 0xff')".replace(" 0xff", ""),
    "python write": lambda data: f"port.write({data!r})",
    "hex list": lambda data: str([hex(byte) for byte in data]),
    "xxd": xxd,
    "hexdump -C": hexdump,
    "od -t x1": od,
    "TX:": per_line("TX: 0x{byte:02X}"),
    "time": per_line("{t:.6f} 0x{byte:02X}"),
    "Logic 1": lambda data: "Time [s],Value,Parity Error,Framing Error\n" + per_line("{t:.9f},0x{byte:02X},,")(data),
    "Logic 2": lambda data: "name,type,start_time,duration,data\n" + per_line('A,"data",{t:.9f},0,0x{byte:02X}')(data),
    "sigrok": per_line("uart-1: rx-data: {byte:02X}"),
    "PulseView": per_line("{n}-{n} UART: RX: {byte:02X}"),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
@given(data=st.binary(min_size=1, max_size=50))
@example(data=b"+")  # no sign that joins strings
def test_T5_what_is_marked_as_hexadecimal_reads_back(way: str, data: bytes) -> None:
    assert pasted(WAYS[way](data)).data == data


@pytest.mark.parametrize("separator", [" ", ",", ";", ":", "-", "|", "\n", "\t", ", "])
@given(data=st.binary(min_size=1, max_size=50))
@example(data=bytes((0, 10, 10, 100)))  # with colons between them they look like a time with milliseconds
def test_T5_hexadecimal_and_decimal_read_back_if_they_can_be_told(separator: str, data: bytes) -> None:
    text = data.hex(separator[0]).replace(separator[0], separator)
    try:
        given_bytes = pasted(text)
    except UsageError as error:
        assert "decimal" in str(error)  # noqa: PT017 - any other exception fails the test
    else:
        assert given_bytes.data == data or "as only so there are packets" in given_bytes.said()
    decimal = separator.join(map(str, data))
    if any(byte >= 100 for byte in data):
        assert pasted(decimal).data == data


@given(st.binary(min_size=2, max_size=50))
def test_T5_glued_hexadecimal_reads_back(data: bytes) -> None:
    given_bytes = pasted(data.hex().zfill(4) + "ff")
    assert given_bytes.data == data + b"\xff"


@given(st.text(max_size=80) | st.text("0123456789abcdefxhTRX:;,.<>-[](){}'\"\\#/= \n", max_size=80))
def test_T5_any_text_is_read_or_refused(text: str) -> None:
    try:
        assert pasted(text).data
    except UsageError as error:
        assert str(error)  # noqa: PT017 - any other exception fails the test
