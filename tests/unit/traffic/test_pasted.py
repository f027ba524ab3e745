"""Bytes as people write them (T5). Formats of programs are those that their documentation and public files show."""

from collections.abc import Sequence

import pytest

from servobus.errors import UsageError
from servobus.families.registry import FAMILIES
from servobus.traffic.pasted import Pasted, read
from servobus.traffic.recording import Direction
from servobus.traffic.streams import good_bytes

PING, PONG = bytes.fromhex("FF FF 01 02 01 FB"), bytes.fromhex("FF FF 01 02 00 FC")
READ = bytes.fromhex("FF FF 01 04 02 24 02 D2")
POS_READ = bytes.fromhex("55 55 01 03 1C DF")


def pasted(text: str) -> Pasted:
    return read(text, lambda data: good_bytes(data, tuple(FAMILIES.values())))


def lines(text: str) -> list[tuple[float, str, bytes]]:
    """Give times, directions and bytes."""
    return [(round(chunk.time, 6), str(chunk.direction), chunk.data) for chunk in pasted(text).chunks]


def said(text: str) -> str:
    return pasted(text).said()


@pytest.mark.parametrize(
    ("text", "data"),
    [
        # separators, prefixes, short bytes
        ("FF FF 1 4 2 24 2 D2", READ),
        ("ff ff 01 04 02 24 02 d2", READ),
        ("55:55:1:3:1C:DF:", POS_READ),
        ("55-55-01-03-1C-DF", POS_READ),
        ("55_55_01_03_1C_DF", POS_READ),
        ("55,55, 01 ,03;1C|DF", POS_READ),
        ("0xFF 0xFF 0x1 0x2 0x1 0xFB", PING),
        ("0XFF,0XFF,0X01,0X02,0X01,0XFB,", PING),
        ("xFF xFF x01 x02 x01 xFB", PING),
        ("$FF $FF $01 $02 $01 $FB", PING),
        ("#FF #FF #01 #02 #01 #FB", PING),
        ("#01 #02 #FF", b"\x01\x02\xff"),
        ("&hFF &hFF &h1 &h2 &h1 &hFB", PING),
        ("0FFh 0FFh 1h 2h 1h 0FBh", PING),
        ("FFh,FFh,01h,02h,01h,FBh", PING),
        (r"\xff\xff\x01\x02\x01\xfb", PING),
        ("[FF][FF][01][02][01][FB]", PING),
        ("[01][02][03]", b"\x01\x02\x03"),
        ("<FF FF>".strip("<>"), b"\xff\xff"),
        ("FF FF 1 2 1 FB\nFF FF 1 2 0 FC\n", PING + PONG),
        # glued
        ("FFFF010402 2402D2", READ),
        ("0xFFFF01020 1FB".replace(" ", ""), PING),
        ("FFFF0102 01FB\nFFFF010200FC", PING + PONG),
        ("55550103 1CDF 0x55 0x55", POS_READ + b"\x55\x55"),
        # decimal
        ("255 255 1 2 1 251", PING),
        ("255,255,1,2,1,251", PING),
        ("255:255:1:2:1:251", PING),
        ("255.255.1.2.1.251".replace(".", "\t"), PING),
        ("085 085 001 003 028 223", POS_READ),
        ("[255, 255, 1, 2, 1, 251]", PING),
        ("-1 -1 1 2 1 -5", PING),
        ("[-1, -1, 1, 2, 1, -5]", PING),
        ("0b11111111 0b11111111 0b00000001", b"\xff\xff\x01"),
        # programs
        ("{0xFF, 0xFF, 1, 2, 1, 251}", PING),
        ("uint8_t buf[] = {0xFF, 0xFF, 0x01, 2, 1, 0xFB}; // ping id 1", PING),
        ("const unsigned char ping[6] = {\n  0xFF, 0xFF, /* header */\n  0x01, 0x02, 0x01, 0xFB };", PING),
        ("byte[] b = new byte[] { (byte) 0xFF, (byte)0xFF, 1, 2, 1, (byte) 0xFB };".replace("new byte[] ", ""), PING),
        ("(uint8_t)0xff, (uint8_t)0xff, 1, 2, 1, (uint8_t)0xfb", PING),
        ("0xFFu, 0xFFU, 0x01u", b"\xff\xff\x01"),
        (r"b'\xff\xff\x01\x02\x01\xfb'", PING),
        (r"b'\xff\xffA\n'", b"\xff\xffA\n"),
        (r'b"UU\x01\x03\x1c\xdf"', POS_READ),
        (r"ser.write(b'\xff\xff\x01\x02\x01\xfb')", PING),
        (r'"\xFF\xFF\x01\x02\x01\xFB"', PING),
        (r'char *s = "\377\377\001\002\001\373";', PING),
        ("bytearray([255, 255, 1, 2, 1, 251])", PING),
        (r"bytearray(b'\xff\xff\x01\x02\x01\xfb')", PING),
        ("bytes.fromhex('FFFF010201FB')", PING),
        ("packet = [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB]  # a ping", PING),
        ("['0xff', '0xff', '0x1', '0x2', '0x1', '0xfb']", PING),
        ("Serial.write(0xFF); Serial.write(0xFF); Serial.write(1);", b"\xff\xff\x01"),
        ("new Uint8Array([255, 255, 1, 2, 1, 251])", PING),
        ("vec![0xFF, 0xFF, 0x01, 2, 1, 0xfb]", PING),
        ("&[0xff, 0xff]", b"\xff\xff"),
        ("[]byte{0xFF, 0xFF, 0x01}", b"\xff\xff\x01"),
        ("std::vector<uint8_t> v{0xFF, 0xFF, 0x01};", b"\xff\xff\x01"),
        ("<Buffer ff ff 01 02 01 fb>", PING),
        ("0xFF (0x01)", b"\xff\x01"),
        # labels
        ("DEBUG:root:TX FF FF 01 02 01 FB", PING),
        ("INFO - sent: ff ff 01 02 01 fb", PING),
        ("[TX] FF FF 01 02 01 FB (6 bytes)", PING),
        ("wrote 6 bytes: FF FF 01 02 01 FB", PING),
        ("A: FF FF 01 02 01 FB\nB: FF FF 01 02 00 FC", PING + PONG),
        ("TX: FF FF 01 02 01 FB", PING),
        ("Sent packet: FF FF 01 02 01 FB", PING),
        ("tx = FF FF 01 02 01 FB", PING),
        ("> FF FF 01 02 01 FB", PING),
        ("#3 FF FF 01 02 01 FB", PING),
        ("[3] FF FF 01 02 01 FB", PING),
        ("[12:00:01] FF FF 01 02 01 FB", PING),
        ("12:00:01 FF FF 01 02 01 FB", PING),
        ("2026-01-02 12:00:01.250 FF FF 01 02 01 FB", PING),
        ("2026-01-02T12:00:01.250Z TX FF FF 01 02 01 FB", PING),
        ("# what my program sent\nFF FF 01 02 01 FB", PING),
        ("1: 55 55 01\n2: 03 1C DF", POS_READ),
        # dumps with offsets
        ("0000: FF FF 01 02 01 FB", PING),
        ("0x0000: FF FF 01 02 01 FB", PING),
        ("00000000  ff ff 01 02 01 fb  ......", PING),
        ("0000  ff ff 01 02\n0004  01 fb", PING),
        ("00000000  ff ff 01 02 01 fb                                 |......|\n00000006\n", PING),
        ("00000000: ffff 0102 01fb                           ......\n", PING),
        ("00000000: 4142 4344  ABCD\n", b"ABCD"),
        ("0000000 ff ff 01 02 01 fb ff ff 01 02 01 fb ff ff 01 02\n0000020 01 fb\n0000022\n", PING * 3),
        ("0000000 ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff\n*\n0000060 01\n", b"\xff" * 48 + b"\x01"),
    ],
)  # fmt: skip
def test_T5_the_ways_of_writing_bytes(text: str, data: bytes) -> None:
    assert pasted(text).data == data


def test_T5_a_line_of_hexdump_C_has_two_halves() -> None:
    text = "00000000  ff ff 01 02 01 fb ff ff  01 02 00 fc 41 42 43 44  |..............AB|\n"
    assert pasted(text).data == PING + PONG + b"ABCD"


@pytest.mark.parametrize(
    ("text", "how"),
    [
        ("FF FF 1 4 2 24 2 D2", "read as hexadecimal bytes, 8 of them"),
        ("255 255 1 2 1 251 0 0 0", "read as decimal bytes, 9 of them"),
        ("255 255 1 2 1 0xFB", "read as decimal bytes, 6 of them, but those marked as hexadecimal"),
        ("85 85 1 3 28 22 85 85 1 2 3", "read as hexadecimal bytes, 11 of them"),
        ("85 85 2 3 35 87 85 85 1 3 28", "read as hexadecimal bytes, 11 of them"),
        ("TX: 55 55", "read as hexadecimal bytes, 2 of them, without what stands before them"),
    ],
)
def test_T5_it_says_how_it_read_them(text: str, how: str) -> None:
    assert said(text) == how


def test_T5_digits_that_may_be_either_are_read_as_what_has_packets() -> None:
    # 55 55 0A 03 1C D6 in decimal, where no word has three digits: 85 85 10 3 28 and a checksum of D6 = 214 has.
    assert said("255 255 10 2 1 242") == "read as decimal bytes, 6 of them"
    # HerkuleX STAT of id 2, FF FF 07 02 07 02 FC, has none either; LX MOVE_STOP of id 200: 55 55 C8 03 0C 28.
    text = "85 85 98 3 99 3"  # no packet in either reading: the usual one
    assert said(text) == "read as hexadecimal bytes, 6 of them"
    # LX, id 98, command 92: ~(98 + 3 + 92) = 62. All of it has two digits.
    assert said("85 85 98 3 92 62") == "read as decimal bytes, 6 of them, as only so there are packets in them"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("hello", "line 1: 'hello' is no byte"),
        ("FF FF 01\nping id 1\n", "line 2: 'ping' is no byte"),
        ("FF FF GG", "line 1: 'GG' is no byte"),
        ("FF FF 100", "line 1: '100' is no byte: 3 hexadecimal digits are no whole bytes"),
        ("255 255 1 FB", "line 1: '255' is no byte: 3 hexadecimal digits"),
        ("255 255 1 256", "line 1: '256' is no byte: the others are decimal, 0 to 255"),
        ("255 255 1 2512", "line 1: '2512' is no byte: the others are decimal"),
        ("0xFF 0x1FF", "line 1: '0x1FF' is no byte"),
        ("-1 -1 200", "line 1: '200' is no byte: the others are signed decimal, -128 to 127"),
        ("0xFF 20 30", "some bytes are marked as hexadecimal and some are not"),
        ("{0xFF, 'A'}", "'A' may be a letter or a byte"),
        ("FF FF TX: 01", "line 1: 'TX' is no byte"),
        ("", "there are no bytes in it"),
        ("# nothing\n\n", "there are no bytes in it"),
        ("0000: FF FF 01 02\n0010: 01 FB\n", "line 1: '0000:' looks like an offset"),
        ("0000-0005: FF FF", "'0000-0005:' looks like an offset"),
        ("FF FF 01 02 01 FB PING id 1", "line 1: 'PING' is no byte"),
        ("1.5", "there are no bytes in it"),
        ("0000000 ffff 0201 fb01\n0000006\n", "make it with hexdump -C"),
        (r"b'\xff\x'", "is no string of bytes that can be read"),
    ],
)
def test_T5_what_cannot_be_read_is_refused_with_line_and_word(text: str, why: str) -> None:
    with pytest.raises(UsageError) as refused:
        pasted(text)
    assert why in str(refused.value)


# Times and directions


def test_T5_lines_of_both_directions_with_times() -> None:
    text = "[12:00:01.123] TX: FF FF 01 02 01 FB\n[12:00:01.125] RX <- FF FF 01 02 00 FC\n"
    assert lines(text) == [(0.0, ">", PING), (0.002, "<", PONG)]
    assert pasted(text).timed
    assert said(text).endswith(", times and directions from what stands before them")


@pytest.mark.parametrize(
    ("out", "into"),
    [
        ("TX:", "RX:"), ("TX ->", "RX <-"), (">", "<"), (">>", "<<"), ("->", "<-"), ("Send:", "Received:"),
        ("PC -> servo:", "servo -> PC:"), ("request", "response"), ("[TX]", "[RX]"), ("→", "←"), ("OUT=", "IN="),
        ("Instruction packet:", "Status packet:"), ("#1 host:", "#2 servo 1:"),
    ],
)  # fmt: skip
def test_T5_names_and_arrows_of_the_two_directions(out: str, into: str) -> None:
    text = f"{out} FF FF 01 02 01 FB\n{into} FF FF 01 02 00 FC"
    assert lines(text) == [(0.0, ">", PING), (0.0, "<", PONG)]
    assert not pasted(text).timed


@pytest.mark.parametrize(
    "text",
    [
        "2026-01-02 03:04:05,123 DEBUG TX FF FF 01 02 01 FB\n2026-01-02 03:04:05,125 DEBUG RX FF FF 01 02 00 FC",
        "[03:04:05.123]# SEND HEX>\nFF FF 01 02 01 FB\n\n[03:04:05.125]# RECV HEX>\nFF FF 01 02 00 FC",
        "12:00:01.5;TX;FF FF 01 02 01 FB\n12:00:01.502;RX;FF FF 01 02 00 FC",
        "[10:11:12.345]\u53d1\u2192\u25c7FF FF 01 02 01 FB \u25a1\n[10:11:12.347]\u6536\u2190\u25c6FF FF 01 02 00 FC",
    ],
)
def test_T5_logs_of_programs(text: str) -> None:
    assert lines(text) == [(0.0, ">", PING), (0.002, "<", PONG)]


def test_T5_long_texts_take_no_longer_than_they_are() -> None:
    data = PING * 5000
    assert pasted(data.hex(" ")).data == data
    assert pasted(data.hex()).data == data


def test_T5_a_line_without_a_label_goes_on_as_the_one_before() -> None:
    assert [one[1] for one in lines("TX: FF FF 01\n02 01 FB\nRX: FF FF 01 02 00 FC")] == [">", ">", "<"]


def test_T5_one_direction_alone_is_one_stream() -> None:
    assert lines("RX: FF FF 01 02 01 FB\nRX: FF FF 01 02 00 FC") == [(0.0, "-", PING), (0.0, "-", PONG)]


def test_T5_seconds_before_the_bytes() -> None:
    text = "0.001042 > FF FF 01 02 01 FB\n0.002314 < FF FF 01 02 00 FC\n"
    assert lines(text) == [(0.001042, ">", PING), (0.002314, "<", PONG)]


# Logic analysers


def rows(data: bytes, start: float, form: str, every: float = 0.000174) -> list[str]:
    return [form.format(time=start + n * every, byte=byte) for n, byte in enumerate(data)]


def times(chunks: Sequence[tuple[float, str, bytes]]) -> list[float]:
    return [time for time, _, _ in chunks]


def test_T5_saleae_logic_1() -> None:
    text = "\n".join(["Time [s],Value,Parity Error,Framing Error", *rows(PING, 0.0429, "{time:.15f},0x{byte:02X},,")])
    given = pasted(text)
    assert given.data == PING
    assert given.timed
    assert given.said() == "read as hexadecimal bytes of a Saleae Logic 1 export, 6 of them"
    assert times(lines(text))[:2] == [0.0429, 0.043074]
    text = "\n".join(["Time [s],Value,Parity Error,Framing Error", *rows(PING, -0.001, "{time:.9f},{byte},,")])
    assert pasted(text).data == PING
    assert times(lines(text))[0] == 0.0  # the trigger came later
    text = "\n".join(
        ["Time [s],Packet ID,Address,Data,Framing Error", *rows(PING, 0.1, "{time:.9f},0,0x00,0x{byte:02X},")]
    )
    assert pasted(text).data == PING


def test_T5_saleae_logic_2() -> None:
    head = 'name,type,start_time,duration,"data"'
    text = "\n".join([head, *rows(PING, 0.5, '"Async Serial","data",{time:.7f},0.0000087,0x{byte:02X}')])
    assert pasted(text).data == PING
    assert pasted(text).said() == "read as hexadecimal bytes of a Saleae Logic 2 export, 6 of them"


def test_T5_two_channels_are_two_directions() -> None:
    head = "name,type,start_time,duration,data"
    both = [
        *rows(PONG, 0.503, "RX,data,{time:.7f},0.0000087,0x{byte:02X}"),
        *rows(PING, 0.5, "TX,data,{time:.7f},0.0000087,0x{byte:02X}"),
    ]
    given = pasted("\n".join([head, *both]))
    assert b"".join(chunk.data for chunk in given.chunks if chunk.direction is Direction.OUT) == PING
    assert b"".join(chunk.data for chunk in given.chunks if chunk.direction is Direction.IN) == PONG
    unnamed = [line.replace("RX", "Async Serial").replace("TX", "Async Serial [1]") for line in both]
    given = pasted("\n".join([head, *unnamed]))
    assert given.said().endswith(", channel 'Async Serial [1]' to the servos")
    assert given.chunks[0].direction is Direction.OUT


@pytest.mark.parametrize("value", ["t", "'255'", "\\n", "COMMA", "0b1111 1111"])
def test_T5_letters_of_a_logic_analyser_are_refused(value: str) -> None:
    with pytest.raises(UsageError, match="set the display of its values to hexadecimal"):
        pasted(f"Time [s],Value,Parity Error,Framing Error\n0.1,0xFF,,\n0.2,{value},,\n")


def test_T5_sigrok_and_pulseview() -> None:
    plain = "".join(f"uart-1: rx-data: {byte:02X}\n" for byte in PING)
    assert pasted(plain).data == PING
    assert pasted(plain).said() == "read as hexadecimal bytes of sigrok UART annotations, 6 of them"
    framed = "".join(f"uart-1: TX: Start bit\nuart-1: TX: 0x{byte:02X}\nuart-1: TX: Stop bit\n" for byte in PING)
    assert pasted(framed).data == PING
    view = "".join(f"{10 * n}-{10 * n + 8} UART: RX: {byte:02X}\n" for n, byte in enumerate(PING))
    assert pasted(view).data == PING
    answer = "".join(f"{100 + 10 * n}-{108 + 10 * n} UART: RX: {byte:02X}\n" for n, byte in enumerate(PONG))
    both = lines(answer + view.replace("RX", "TX"))
    assert b"".join(data for _, side, data in both[:6]) == PING
    assert [side for _, side, _ in both] == [">"] * 6 + ["<"] * 6
    decimal = "".join(f"uart-1: rx-data: {byte}\n" for byte in PING)
    assert pasted(decimal).data == PING


def test_T5_letters_of_sigrok_are_refused() -> None:
    with pytest.raises(UsageError, match=r"line 2: 'A\?' is no byte in sigrok UART annotations.*format=hex"):
        pasted("uart-1: rx-data: [FF]\n".replace("[FF]", "FF") + "uart-1: rx-data: A?\n")


# What people paste besides: nothing of it is taken for a byte that is none


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("packet[0]: 255\npacket[1]: 255\npacket[2]: 1\npacket[3]: 2\npacket[4]: 1\npacket[5]: 251\n", PING),
        ("rx len=6 data=FF FF 01 02 00 FC", PONG),
        ("[TX] 6: FF FF 01 02 01 FB", PING),
        ("Uint8Array(6) [ 255, 255, 1, 2, 1, 251 ]", PING),
        ("byte[] b = new byte[6] {0xFF, 0xFF, 1, 2, 1, 0xFB};", PING),
        ("array('B', [255, 255, 1, 2, 1, 251])", PING),
        ("array([255, 255,   1,   2,   1, 251], dtype=uint8)", PING),
        ("std::array<uint8_t, 6> p = {0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB};", PING),
        ("let p: [u8; 6] = [0xff, 0xff, 0x01, 0x02, 0x01, 0xfb];", PING),
        ("vec![255u8, 255, 1, 2, 1, 251]", PING),
        ("#define PING {0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB}", PING),
        ("```c\n{0xFF, 0xFF, 1, 2, 1, 0xFB}\n```", PING),
        ("0xff (255) 0x01 (1)", b"\xff\x01"),
        ("29/11/2026 12:01:02.123 [TX] - FF FF 01 02 01 FB", PING),
        ("[09:00:01:234] FF FF 01 02 01 FB", PING),
        (r"echo -ne '\xff\xff\x01\x02\x01\xfb' > /dev/ttyUSB0", PING),
        (r"\377\377\001\002\001\373", PING),
        (r"\xff\xff\x01\x04\x02$\x02\xd2", READ),
        (r"b'\xff\xff\x01\x04\x02$' + b'\x02\xd2'", READ),
        ('"\\xff\\xff\\x01\\x04" \\\n"\\x02$\\x02\\xd2"', READ),
        (r'write(3, "\377\377\1\2\1\373", 6)         = 6', PING),
        ("0000  ff ff 01 04 02 24 02 d2                           .....$..", READ),
        ("0000000  ff  ff  01  02  01  fb\n0000006\n", PING),
        ("0000000    ff  ff  01  02  01  fb\n0000006\n", PING),
    ],
)  # fmt: skip
def test_T5_more_ways_of_writing_bytes(text: str, data: bytes) -> None:
    assert pasted(text).data == data


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Send FF FF 01 02 01 FB -> recv FF FF 01 02 00 FC", "'->' is no byte"),
        ("int id = 1;\nuint8_t p[] = {0xFF, 0xFF};", "line 1: 'id' is one name of several (id, p)"),
        ("Serial.write(0xFF);\ndelay(10);\nSerial.write(0x01);", "one name of several"),
        (" length=6 from=0 to=5\n ff ff 01 02 01 fb", "line 1: 'from' is one name of several"),
        ("6: FF FF 01 02 01 FB", "line 1: '6:' may be a number before the bytes"),
        ("[TX] 5: FF FF 01 02 01 FB", "line 1: '5:' may be a number before the bytes"),
        (r"\xff\xff\x01\x04\x02 \x02\xd2", "a blank between bytes as \\xFF may be a byte itself"),
        ('write(3, "\\377\\377"..., 60) = 60', "is cut off; run strace with -s 1000"),
        ("0000000 255 255   1   2   1 251\n0000006\n", "'0000000' is no byte"),
        ("00000000: 11111111 11111111 00000001  ...", "this dump is of bits"),
        ("0000:0000  ff ff 01 02 01 fb", "'0000:0000' looks like an offset"),
        ("12:34:56:100\n255 255 1 2 1 251", "line 1: '12:34:56:100' may be a time or four decimal bytes; leave it out"),
        ("1 2 3\nTX: 12:34:56:100", "line 2: '12:34:56:100' may be a time or four decimal bytes"),
    ],
)
def test_T5_numbers_that_may_be_no_bytes_are_refused(text: str, why: str) -> None:
    with pytest.raises(UsageError) as refused:
        pasted(text)
    assert why in str(refused.value)


def test_T5_what_strace_shows_has_directions() -> None:
    text = '[pid 12] write(3, "\\377\\377\\1\\2\\1\\373", 6) = 6\n[pid 12] read(3, "\\377\\377\\1\\2\\0\\374", 6) = 6'
    assert lines(text) == [(0.0, ">", PING), (0.0, "<", PONG)]


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("0:10:10:100", bytes((0, 10, 10, 100))),
        ("TX: 0:10:10:100", bytes((0, 10, 10, 100))),
        ("0:10:10:100\n12:34:56:200", bytes((0, 10, 10, 100, 12, 34, 56, 200))),
        ("0:10:10:100 12:34:56:200", bytes((0, 10, 10, 100, 12, 34, 56, 200))),
        ("12:34:56:100\nFF FF 01 02 01 FB", PING),
        ("12:34:56:789\n255 255 1 2 1 251", PING),
        ("12:34:56:100 255 255 1 2 1 251", PING),
        ("2026-01-02 12:34:56:100\n255 255 1 2 1 251", PING),
    ],
)
def test_T5_four_numbers_that_colons_join_are_bytes_or_a_time(text: str, data: bytes) -> None:
    assert pasted(text).data == data
