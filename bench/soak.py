"""A soak: reads and writes by the million on lines where everything goes wrong, every value compared with the truth.

    python -m bench.soak [--transactions N] [--seconds S] [--seed N] [--chunk N] [--shared]

Virtual servos in this process, on a virtual clock; all three families, both drivers, every wire fault there is. Before
each transaction a shaft is turned to another place by hand, so that a value from before can be told from the right
one. A value is

    right     what the servo held while it was asked
    provable  not that, but a fault altered the reply within this very transaction, and the bytes that came hold a
              packet with this value whose id, command, length and checksum fit: nobody could have known
    late      not that, but a reply that another had overtaken was under way, and it was told with one of the next
              exchanges (DuplicateId); only in the mixes where replies overtake each other, which no adapter does
    WRONG     anything else

With `--shared` all goes through a server, over a socket: the driver is a client of it, and has no port itself.

A write that was acknowledged and is not there is wrong too. A transaction of more than 5 s hangs, by the servos' clock
or by yours. The work is cut into chunks with seeds of their own; whatever is wrong is printed with its chunk, and
`--seed N --chunk N` does that chunk again. The exit code is 1 if anything was wrong or hung.
"""

import argparse
import asyncio
import faulthandler
import os
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from inspect import isawaitable
from itertools import islice
from typing import Any, Self

from servobus.bus.asyncio import AsyncBus
from servobus.bus.blocking import Bus
from servobus.errors import BusError, PortLost, ServobusError
from servobus.families.base import Answers
from servobus.families.registry import MODELS
from servobus.link.stats import COLUMNS
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url

CHUNK = 1000
"""Transactions with one seed."""
IDS = (1, 2, 3)
HANGS = 5.0
"""s of the servos' clock."""
STUCK = 300.0
"""s of this computer's clock for one chunk, which takes one or two."""
TELLS = 40
"""Exchanges after a value that was overtaken in which that must be told."""
REPEATS = 8
"""Troubles that are printed; all are counted."""

ALTERING = {"pair", "flip", "drop", "junk", "twin", "stranger", "split"}
"""Kinds of fault that change what comes, as opposed to when."""

POSITION = "present_position"
WRITABLE = {
    "dynamixel": ("punch", "torque_limit", "led"),
    "herkulex": ("position_kp", "max_pwm", "min_pwm"),
    "lewansoul": ("led",),
}
"""Registers of a family that are written; of one length, so that one answer looks like the other's."""
BLOCKS = {
    "dynamixel": (POSITION, "punch", "torque_limit"),
    "herkulex": (POSITION, "max_pwm", "position_kp"),
    "lewansoul": (POSITION, "led"),
}

COMMON = (
    "drop=0.01,flip=0.01,pair=0.005,junk=0.01,junk=0.005:1-4,split=0.01,mute=0.01,deaf=0.01,stranger=0.01,"
    "stall=0.003,glue=0.003,twin=0.003,echo@part=0.002,echo@bad=0.002"
)
MIXES = (
    # Options of the port, faults, whether replies may overtake each other.
    ("", f"{COMMON},echo@full=0.002", False),
    ("", f"{COMMON},reboot=0.001,unplug=0.0005:80ms,gone=0.0005:5ms,gone@write=0.0005:5ms,jitter=3ms", False),
    ("echo=on", f"{COMMON},echo@none=0.002", False),
    ("", f"{COMMON},latency=16ms,jitter=8ms,skew@2=2%", False),
    ("", "drop=0.1,flip=0.1,pair=0.1,junk=0.1,split=0.1:20ms,mute=0.1,stall=0.05,glue=0.05,stranger=0.1", False),
    ("", "stall=0.1:120ms,stall=0.1:12ms,glue=0.1:50ms,mute=0.1,deaf=0.1", False),
    ("", f"{COMMON},late=0.005,late=0.005:3ms", True),
    ("", "late=0.3:20ms,mute=0.02", True),
)


@dataclass(slots=True)
class ServoTraffic:
    """What came of transactions."""

    transactions: int = 0
    right: int = 0
    unknown: int = 0
    """Writes that nobody acknowledges: whether they arrived is not said."""
    provable: Counter[str] = field(default_factory=Counter)
    """Kinds of fault -> wrong values with a checksum that fits."""
    late: int = 0
    wrong: int = 0
    hung: int = 0
    errors: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    stats: dict[str, float] = field(default_factory=dict)
    longest: float = 0.0
    """s of the servos' clock."""
    troubles: list[str] = field(default_factory=list)

    def __iadd__(self, other: "ServoTraffic") -> Self:
        for name in ("transactions", "right", "unknown", "late", "wrong", "hung"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("provable", "errors", "faults"):
            getattr(self, name).update(getattr(other, name))
        for name, value in other.stats.items():
            mine = self.stats.get(name, 0)
            self.stats[name] = max(mine, value) if name == "worst" else mine + value
        self.longest = max(self.longest, other.longest)
        self.troubles += other.troubles
        return self


class Tapped(VirtualPort):
    """A virtual port that keeps what the driver was given."""

    heard = b""

    def read(self, timeout: float) -> bytes:
        data = super().read(timeout)
        self.heard += data
        return data


@dataclass(slots=True)
class Doubt:
    """A wrong value that must be told of within the next exchanges."""

    text: str
    doubled: int
    left: int = TELLS


class Sharing:
    """A server in a thread of its own, whose one bus is on this port."""

    def __init__(self, port: VirtualPort) -> None:
        from servobus.server.ports.service import Service

        os.environ["SERVOBUS_TOKEN"] = "soak"
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

        async def begin() -> tuple[AsyncBus, Service, asyncio.Server]:
            bus = AsyncBus(port)
            service = Service({"soak": bus}, {"soak": "operator"})
            return bus, service, await service.listen("127.0.0.1", 0)

        self.bus, self._service, self._server = asyncio.run_coroutine_threadsafe(begin(), self._loop).result()

    def client(self) -> Any:
        """Give a port that goes through it."""
        from servobus.remote.address import Address
        from servobus.remote.port import RemotePort

        return RemotePort(Address("127.0.0.1", self._server.sockets[0].getsockname()[1], "soak"))

    def close(self) -> None:
        async def end() -> None:
            self._service.close()
            self._server.close()
            await asyncio.sleep(0)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class Chunk:
    """A bus of three servos, and what is asked of them; the same each time."""

    def __init__(self, seed: int, number: int, *, shared: bool = False) -> None:
        self.name = f"--seed {seed} --chunk {number}{' --shared' * shared}"
        self.random = random.Random(f"{seed}/{number}")
        kinds = len(MODELS)
        key = list(MODELS)[number % kinds]
        self.asynchronous = number // kinds % 2 == 1
        options, faults, self.overtaking = MIXES[number // (2 * kinds) % len(MIXES)]
        url = f"virtual:{key}@{IDS[0]}-{IDS[-1]}?clock=virtual&{options}".rstrip("&")
        self.port = Tapped(url, build_rig(parse_url(url)), real=False)
        self.reals: list[VirtualServo] = self.port.rig.servos
        self.server = Sharing(self.port) if shared else None
        own = self.port if self.server is None else self.server.client()
        self.bus: Any = (AsyncBus if self.asynchronous else Bus)(own)
        self.stats = self.bus.stats if self.server is None else self.server.bus.stats
        self.model = MODELS[key]
        self.family = self.model.family.name
        self.acknowledged = "answer_level" in self.model.aliases
        for real in self.reals:
            if self.acknowledged:
                real.memory.store(self.model.register("answer_level"), Answers.EVERYTHING)
                real.power_on(0.0)
            level = Answers.EVERYTHING if self.acknowledged else Answers.READS
            self.bus.attach(self.model, real.id, answers=level).target.record.most = None  # nothing wears out here
        self.port.inject(f"seed={self.random.randrange(10**6)},{faults}")
        self.tally = ServoTraffic()
        self.doubt: Doubt | None = None

    async def run(self, transactions: int) -> ServoTraffic:
        for number in range(transactions):
            await self._transaction(number)
        if self.doubt is not None:
            self._wrong(self.doubt.text)
        self.tally.faults.update(self.port.rig.fault_counts)
        total = self.stats.total
        self.tally.stats = {name: getattr(total, name) for name in COLUMNS}
        if self.server is not None:
            self.bus.close()
            self.server.close()
        return self.tally

    async def _transaction(self, number: int) -> None:
        port, rng, tally = self.port, self.random, self.tally
        real = self.reals[rng.randrange(len(self.reals))]
        here = self._turn(real)
        started, port.heard = port.now(), b""
        names, wanted = self._order(rng)
        before = [here if name == POSITION else real.get(name) for name in names]
        what = f"{number}: {'async ' * self.asynchronous}{real} {'write' if wanted else 'read'} {' '.join(names)}"
        tally.transactions += 1
        try:
            values = await self._carry_out(real.id, names, wanted)
        except (BusError, PortLost) as error:
            tally.errors[type(error).__name__] += 1
            if isinstance(error, PortLost):
                await self._reopen()
            values = None
        except ServobusError as error:
            tally.errors[type(error).__name__] += 1
            self._wrong(f"{what}: {type(error).__name__}: {error}")
            return
        took = port.now() - started
        tally.longest = max(tally.longest, took)
        if took > HANGS:
            tally.hung += 1
            self._tell(f"{what}: took {took:.1f} s")
        if values is not None:
            self._judge(what, real, names, before, wanted, values, started)
        self._watch_doubt()

    def _turn(self, real: VirtualServo) -> int:
        """Turn the shaft to another place by hand; give what its sensor tells there."""
        low, high = (self.model.register(name).default for name in ("min_position", "max_position"))
        raw = self.random.randint(low, high)  # what the sensor tells after power-on too
        real.turn_shaft(real.model.register(POSITION).decode(raw))
        return raw

    def _order(self, rng: random.Random) -> tuple[tuple[str, ...], dict[str, int]]:
        """Choose what to read, or what to write."""
        dice, writable = rng.random(), WRITABLE[self.family]
        if dice < 0.5:
            return (POSITION,), {}
        name = rng.choice(writable)
        if dice < 0.65:
            return (name,), {}
        if dice < 0.8:
            return BLOCKS[self.family], {}
        low, high = self.model.register(name).limits
        # A torque limit of 0 is a servo that has shut down: only `rearm` gives it another.
        return (name,), {name: rng.randint(low + (name == "torque_limit"), high)}

    async def _carry_out(self, id: int, names: tuple[str, ...], wanted: dict[str, int]) -> list[int]:
        rows = [self.model.register(name) for name in names]
        servo = self.bus[id]
        if wanted:
            done = servo.write_raw({self.model.register(name): raw for name, raw in wanted.items()})
        elif len(rows) > 1:
            done = servo.read_raw(rows)
        else:
            done = servo.read(rows[0])
        if isawaitable(done):
            done = await done
        if wanted:
            return list(wanted.values())
        return done if len(rows) > 1 else [_raw(rows[0], done)]

    async def _reopen(self) -> None:
        while True:
            self.port.sleep(0.01)
            try:
                self.port.reopen()
            except PortLost:
                continue
            return

    def _judge(
        self,
        what: str,
        real: VirtualServo,
        names: tuple[str, ...],
        before: list[int],
        wanted: dict[str, int],
        values: list[int],
        started: float,
    ) -> None:
        after = [then if name == POSITION else real.get(name) for name, then in zip(names, before, strict=True)]
        if wanted and not self.acknowledged:
            self.tally.unknown += 1
            return
        truths = [(now,) if wanted else (then, now) for then, now in zip(before, after, strict=True)]
        bad = [n for n, value in enumerate(values) if value not in truths[n]]
        if not bad:
            self.tally.right += 1
            return
        said = ", ".join(f"{names[n]} {values[n]}, is {after[n]}, was {before[n]}" for n in bad)
        kinds = {one.kind for one in self.port.rig.injected if one.time >= started}
        what = f"{what}: {said}; faults {', '.join(sorted(kinds)) or 'none'}; heard {self.port.heard.hex(' ')}"
        altering = kinds & ALTERING
        if altering and any(_holds(self.family, frame, real.id) for frame in _frames(self.family, self.port.heard)):
            self.tally.provable["+".join(sorted(altering))] += 1
        elif wanted and kinds & {"reboot", "unplug"}:
            self.tally.right += 1  # it was there, and then the supply broke down
        elif self.overtaking and self.doubt is None:
            self.doubt = Doubt(what, self._doubled())
        else:
            self._wrong(what)

    def _watch_doubt(self) -> None:
        """See to it that a value which was overtaken is told of."""
        doubt = self.doubt
        if doubt is None:
            return
        doubt.left -= 1
        if self._doubled() > doubt.doubled:
            self.tally.late += 1
            self.doubt = None
        elif doubt.left < 0:
            self._wrong(doubt.text)
            self.doubt = None

    def _doubled(self) -> int:
        counts = self.stats.total
        return int(counts.doubled + counts.strangers)

    def _wrong(self, text: str) -> None:
        self.tally.wrong += 1
        self._tell(text)

    def _tell(self, text: str) -> None:
        if len(self.tally.troubles) < REPEATS:
            self.tally.troubles.append(f"{self.name}, transaction {text}")


def _raw(row: Any, value: Any) -> int:
    raw: int = row.scale.encode(value)
    return raw


# Packets, reckoned here and not by the driver


def _frames(family: str, heard: bytes) -> Iterator[bytes]:
    """Give each run of bytes that is a packet whose checksum fits (manuals: RX-28 3-3, DRS-0602 5-2, LX-16A 3)."""
    header = b"\x55\x55" if family == "lewansoul" else b"\xff\xff"
    for at in range(len(heard) - 5):
        if heard[at : at + 2] != header:
            continue
        size = heard[at + 2] if family == "herkulex" else heard[at + 3] + (3 if family == "lewansoul" else 4)
        frame = heard[at : at + size]
        if len(frame) == size >= 6 and _fits(family, frame):
            yield frame


def _fits(family: str, frame: bytes) -> bool:
    if family != "herkulex":
        return ~sum(frame[2:-1]) & 0xFF == frame[-1]
    check = 0
    for byte in frame[2:5] + frame[7:]:
        check ^= byte
    return frame[5] == check & 0xFE and frame[6] == ~check & 0xFE


def _holds(family: str, frame: bytes, id: int) -> bool:
    return frame[3 if family == "herkulex" else 2] == id


# Many chunks


def work(seed: int, number: int, transactions: int, *, shared: bool = False) -> ServoTraffic:
    """Do one chunk."""
    faulthandler.dump_traceback_later(STUCK, exit=True)
    try:
        return asyncio.run(Chunk(seed, number, shared=shared).run(transactions))
    finally:
        faulthandler.cancel_dump_traceback_later()


def soak(seed: int, transactions: int, seconds: float, *, shared: bool = False) -> tuple[ServoTraffic, bool]:
    """Do chunks on all cores, until there are enough or time is up; tell whether all of them came back."""
    total, started, told = ServoTraffic(), time.monotonic(), 0.0
    chunks = iter(range(-(-transactions // CHUNK)))
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        busy: set[Future[ServoTraffic]] = set()
        while True:
            if time.monotonic() - started < seconds:
                for number in islice(chunks, 2 * (os.cpu_count() or 1) - len(busy)):
                    some = min(CHUNK, transactions - number * CHUNK)
                    busy.add(pool.submit(work, seed, number, some, shared=shared))
            if not busy:
                return total, True
            done, busy = wait(busy, return_when=FIRST_COMPLETED)
            for one in done:
                try:
                    total += one.result()
                except BrokenProcessPool:
                    return total, False
            if sys.stderr.isatty() and (now := time.monotonic()) - told > 2:
                told = now
                rate = total.transactions / (now - started)
                print(f"\r{total.transactions} of {transactions}, {rate:.0f}/s, {total.wrong} wrong", end="",
                      file=sys.stderr, flush=True)  # fmt: skip


def show(total: ServoTraffic, took: float) -> None:
    print(f"transactions    {total.transactions:>9}   in {took:.0f} s, {total.transactions / took:.0f} each second")
    print(f"right           {total.right:>9}")
    print(f"unacknowledged  {total.unknown:>9}   writes that nothing answers")
    print(f"exceptions      {total.errors.total():>9}   {_listed(total.errors)}")
    print(f"provable        {total.provable.total():>9}   wrong, and the checksum fits: {_listed(total.provable)}")
    print(f"late            {total.late:>9}   overtaken, and told with one of the next exchanges")
    print(f"WRONG           {total.wrong:>9}")
    print(f"hung            {total.hung:>9}   the longest took {total.longest:.2f} s of the servos' time")
    print(f"faults          {total.faults.total():>9}   {_listed(total.faults)}")
    counts = ", ".join(f"{name} {value:.0f}" for name, value in total.stats.items() if name != "worst")
    print(f"bus.stats                   {counts}")


def _listed(counter: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counter.most_common()) or "none"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="bench.soak", description="Every value compared with the truth.")
    parser.add_argument("--transactions", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--chunk", type=int, help="do this one again, and nothing else")
    parser.add_argument("--shared", action="store_true", help="through a server")
    args = parser.parse_args(arguments)

    started = time.monotonic()
    if args.chunk is None:
        total, whole = soak(args.seed, args.transactions, args.seconds, shared=args.shared)
    else:
        total, whole = work(args.seed, args.chunk, min(CHUNK, args.transactions), shared=args.shared), True
    print(file=sys.stderr)
    show(total, time.monotonic() - started)
    for trouble in total.troubles[:REPEATS]:
        print(f"  {trouble}")
    if not whole:
        print(f"a chunk hung for more than {STUCK:g} s or its process died; see above")
    good = whole and not total.wrong and not total.hung and total.transactions
    print("good" if good else "NOT GOOD")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
