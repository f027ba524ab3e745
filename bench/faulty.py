"""A servo on a pseudo terminal whose replies suffer: a process of its own, seeded.

    python -m bench.faulty KIND SEED RATE

It prints the name of the terminal, then takes lines: `on` and `off` switch the faults (answered with `ok`),
`end` prints the log, one line for each position that was asked for: when the request was complete (s, monotonic
clock), the position in the reply, 1 if the reply suffered; then an empty line. RATE is the share of replies that do.

The position of each reply is another one, so that a reply to an earlier request shows. Both protocols are told
apart by their header: Dynamixel 1.0 (RX-28 manual 3-2, 3-5) and LX-16A (protocol document, 2 to 4).
"""

import os
import random
import select
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

DXL, LX = b"\xff\xff", b"\x55\x55"
DXL_PING, DXL_READ, DXL_POSITION, DXL_TABLE = 1, 2, 36, 256
LX_POSITION = 28
LX_SIZES = {2: 4, 8: 4, 14: 1, 19: 1, 21: 4, 23: 4, 25: 1, 26: 1, 27: 2, 28: 2, 30: 4, 32: 1, 34: 1, 36: 1}
"""Bytes the LX-16A gives to each command that reads."""
BROADCAST = 254
STALL = 0.120
GAP = 0.005
"""s between two halves, as where an adapter splits a reply over two of its packets."""
COPY = 0.0003
"""s after a reply its copy comes, while nobody asks."""

BAD_ECHO = "echo, bad bit"

Pieces = list[tuple[float, bytes]]
"""What goes out for one request: s to wait, and bytes; never out of turn."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The reply to a request, and what another servo would reply."""

    reply: bytes
    strange: bytes


def junk(rng: random.Random, asked: Asked, most: int) -> bytes:
    """Give 1 to `most` random bytes, with a header among them in half of the cases."""
    noise = rng.randbytes(rng.randint(1, most))
    return noise + asked.reply[: rng.randint(1, 3)] if rng.random() < 0.5 else noise


def clean(_: random.Random, asked: Asked) -> Pieces:
    return [(0, asked.reply)]


def drop_byte(rng: random.Random, asked: Asked) -> Pieces:
    at = rng.randrange(len(asked.reply))
    return [(0, asked.reply[:at] + asked.reply[at + 1 :])]


def flip_bit(rng: random.Random, asked: Asked) -> Pieces:
    return [(0, flipped(rng, asked.reply))]


def flipped(rng: random.Random, data: bytes) -> bytes:
    bad = bytearray(data)
    bad[rng.randrange(len(bad))] ^= 1 << rng.randrange(8)
    return bytes(bad)


def junk_before(rng: random.Random, asked: Asked) -> Pieces:
    return [(0, junk(rng, asked, 16) + asked.reply)]


def junk_inside(rng: random.Random, asked: Asked) -> Pieces:
    at = rng.randrange(1, len(asked.reply))
    return [(0, asked.reply[:at] + junk(rng, asked, 4) + asked.reply[at:])]


def junk_after(rng: random.Random, asked: Asked) -> Pieces:
    return [(0, asked.reply + junk(rng, asked, 16))]


def late(_: random.Random, asked: Asked) -> Pieces:
    return [(STALL, asked.reply)]


def lost(_: random.Random, __: Asked) -> Pieces:
    return []


def other_id(_: random.Random, asked: Asked) -> Pieces:
    return [(0, asked.strange)]


def truncated(rng: random.Random, asked: Asked) -> Pieces:
    return [(0, asked.reply[: rng.randrange(1, len(asked.reply))])]


def two_halves(rng: random.Random, asked: Asked) -> Pieces:
    at = rng.randrange(1, len(asked.reply))
    return [(0, asked.reply[:at]), (GAP, asked.reply[at:])]


def twice(_: random.Random, asked: Asked) -> Pieces:
    return [(0, asked.reply), (COPY, asked.reply)]


KINDS: dict[str, Callable[[random.Random, Asked], Pieces]] = {
    "none": clean,
    "byte dropped": drop_byte,
    "bit flipped": flip_bit,
    "junk before": junk_before,
    "junk inside": junk_inside,
    "junk after": junk_after,
    "echo": clean,
    BAD_ECHO: clean,
    "120 ms late": late,
    "lost": lost,
    "other id": other_id,
    "cut short": truncated,
    "in two halves": two_halves,
    "sent twice": twice,
}
ECHOING = ("echo", BAD_ECHO)
"""Here every byte comes back, from the start on: that is how such adapters are."""


def framed(header: bytes, id: int, rest: bytes) -> bytes:
    """Put header, id, length and checksum around error byte or command, and data."""
    length = len(rest) + (1 if header == DXL else 2)
    body = bytes([id, length]) + rest
    return header + body + bytes([~sum(body) & 0xFF])


def requests(heard: bytearray) -> list[bytes]:
    """Take the complete packets off the front of what was heard."""
    found: list[bytes] = []
    while len(heard) >= 6:
        header = bytes(heard[:2])
        size = heard[3] + (4 if header == DXL else 3)
        if header not in (DXL, LX) or not 6 <= size <= 64:
            del heard[0]
        elif len(heard) < size:
            break
        elif ~sum(heard[2 : size - 1]) & 0xFF == heard[size - 1]:
            found.append(bytes(heard[:size]))
            del heard[:size]
        else:
            del heard[0]
    return found


@dataclass(slots=True)
class Servo:
    """Answers on one side of a pseudo terminal."""

    kind: str
    seed: str
    rate: float
    suffers: bool = False
    log: list[tuple[float, int, bool]] = field(default_factory=list)
    heard: bytearray = field(default_factory=bytearray)
    pieces: deque[tuple[float, bytes]] = field(default_factory=deque)
    """What is still to go out, each with its time."""

    def hear(self, data: bytes, now: float) -> None:
        self.heard += data
        pieces: Pieces = []
        for request in requests(self.heard):
            # Another position each time, for a thousand times; and the same faults for each driver.
            position, rng = len(self.log) * 7919 % 1000, random.Random(f"{self.seed} {len(self.log)}")
            asks = asks_position(request)
            suffers = asks and self.suffers and rng.random() < self.rate
            if asks:
                self.log.append((now, position, suffers))
            if suffers and self.kind == BAD_ECHO:
                data = flipped(rng, data)
            reply = reply_to(request, request[2], position)
            strange = reply_to(request, request[2] + 1, (position + 500) % 1000)
            if reply and strange:
                pieces += (KINDS[self.kind] if suffers else clean)(rng, Asked(reply, strange))
        self._queue([(0, data), *pieces] if self.kind in ECHOING else pieces, now)

    def _queue(self, pieces: Pieces, now: float) -> None:
        for wait, data in pieces:
            earliest = self.pieces[-1][0] if self.pieces else now
            self.pieces.append((max(now + wait, earliest), data))


def asks_position(request: bytes) -> bool:
    if request[:2] == LX:
        return request[4] == LX_POSITION
    if request[4] != DXL_READ or len(request) < 8:
        return False
    first, count = request[5], request[6]
    return first <= DXL_POSITION and first + count >= DXL_POSITION + 2


def reply_to(request: bytes, id: int, position: int) -> bytes | None:
    """Give the reply of the servo with this id; None if there is none."""
    header, command, where = request[:2], request[4], position.to_bytes(2, "little")
    if request[2] == BROADCAST:
        return None
    if header == LX:
        if command not in LX_SIZES:
            return None
        return framed(LX, id, bytes([command]) + (where if command == LX_POSITION else bytes(LX_SIZES[command])))
    if command == DXL_PING:
        return framed(DXL, id, b"\x00")
    if command != DXL_READ or len(request) < 8:
        return None
    table = bytearray(DXL_TABLE)
    table[DXL_POSITION : DXL_POSITION + 2] = where
    first, count = request[5], request[6]
    return framed(DXL, id, b"\x00" + bytes(table[first : first + count]))


def serve(servo: Servo, master: int, orders: int) -> None:
    """Answer until the order to end."""
    while True:
        now = time.monotonic()
        while servo.pieces and servo.pieces[0][0] <= now:
            os.write(master, servo.pieces.popleft()[1])
        wait = servo.pieces[0][0] - now if servo.pieces else None
        ready = select.select([master, orders], [], [], wait)[0]
        if orders in ready:
            order = os.read(orders, 64).decode().strip()
            if order not in ("on", "off"):
                return
            servo.suffers = order == "on"
            print("ok", flush=True)
        if master in ready:
            servo.hear(os.read(master, 4096), time.monotonic())


def main() -> None:
    import tty

    kind, seed, rate = sys.argv[1:]
    master, slave = os.openpty()  # the slave stays open: the terminal survives clients that come and go
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    servo = Servo(kind, seed, float(rate))
    serve(servo, master, sys.stdin.fileno())
    for when, position, bad in servo.log:
        print(f"{when:.9f} {position} {bad:d}")
    print(flush=True)


if __name__ == "__main__":
    main()
