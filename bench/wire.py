"""How much of the wire the driver uses, and how long a full scan takes, in simulated time.

    python -m bench.wire [--cycles N]

The servos run in this process on a virtual clock, so that the figures are the same on every machine. What the bits
allow is counted here from the packets of the manuals, not by the driver:

    RX-28       half duplex: 8 bytes ask, 6 + n answer (manual 3-5-1); return delay 0
    DRS-0602    full duplex: 9 bytes ask, 11 + n answer (manual 6-4), at the same time on a wire each

At last, six MX-28 are read by one BULK_READ, and one by one, behind adapters that hand bytes over later and later.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import servobus
from servobus import DRS0602, LX16A, RX28, Bus, BusServo
from servobus.families.dynamixel.models.mx import MX28

if TYPE_CHECKING:
    from servobus.virtual.serve.inprocess import VirtualPort

FAST = 1_000_000
SERVOS = 20
BITS = 10
"""Bits on the wire for each byte: 8N1."""
SHARE, TIMES = 0.97, 1.6
"""Aims: of the rate that the bits allow on one wire; times the rate of asking one by one, on two."""
SCAN_FAST, SCAN_SLOW = 1.0, 2.5
"""Aims: s for a full scan at 1 Mbit/s, and at 115200 bit/s."""
LAST = 253
"""The highest id; a scan asks all 254."""


@dataclass(frozen=True, slots=True)
class Job:
    """Position, speed and load of one model: three registers that touch."""

    model: Any
    registers: tuple[Any, ...]
    asks: int
    """Bytes of a request."""
    answers: int
    """Bytes of its reply."""
    full_duplex: bool

    @property
    def least(self) -> float:
        """Seconds of wire that each read takes at least, among many."""
        count = max(self.asks, self.answers) if self.full_duplex else self.asks + self.answers
        return count * BITS / FAST


JOBS = (
    Job(RX28, (RX28.present_position, RX28.present_speed, RX28.present_load), 8, 6 + 6, full_duplex=False),
    Job(DRS0602, (DRS0602.present_position, DRS0602.differential_position, DRS0602.pwm), 9, 11 + 8, full_duplex=True),
)
TOGETHER = 6
"""Servos that are read by one request."""
LATENCIES = ("0ms", "1ms", "4ms", "16ms")
"""How much later an adapter hands over what it got; 16 ms is what FTDI chips are set to as they come."""
RETURN_DELAYS = (0, 250)
"""Codes of 2 µs: none, and as it comes from the factory (e-manual, MX-28, Return Delay Time)."""
SCANS = ((RX28, FAST), (RX28, 115_200), (DRS0602, FAST), (DRS0602, 115_200), (LX16A, 115_200))


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="bench.wire", description="Share of the wire that is used.")
    parser.add_argument("--cycles", type=int, default=50, help="cycles of each way to read")
    args = parser.parse_args(arguments)
    print(f"position, speed and load of {SERVOS} servos at {FAST} baud, simulated")
    print(f"{'model':<10}{'way':<24}{'cycles/s':>9}{'of the bits':>13}{'of one after the other':>24}{'aim':>20}")
    for job in JOBS:
        bound = 1 / (SERVOS * job.least)
        print(f"{job.model.title:<10}{'what the bits allow':<24}{bound:>9.1f}{1:>13.1%}")
        rates = {way: _rate(job, make, args.cycles) for way, make in WAYS.items()}
        singly, together = rates.values()
        for way, rate in rates.items():
            aim = _aim(job, together / bound, together / singly) if rate is together else ""
            shares = f"{rate / bound:>13.1%}{rate / singly:>24.2f}"
            print(f"{job.model.title:<10}{way:<24}{rate:>9.1f}{shares}{aim:>20}")
    print(f"\n{'scan of 254 ids':<17}{'baud':>8}{'simulated s':>13}{'CPU s':>8}{'aim':>20}")
    for model, baud in SCANS:
        taken, spent = _scan(model, baud)
        longest = SCAN_FAST if baud == FAST else SCAN_SLOW
        aim = f"{longest:g} s {_said(taken < longest)}"
        print(f"{model.title:<17}{baud:>8}{taken:>13.3f}{spent:>8.2f}{aim:>20}")
    print(f"\n8 bytes of {TOGETHER} MX-28 at {FAST} baud, simulated")
    print(f"{'adapter':<10}{'return delay':>13}{'one by one, ms':>16}{'BULK_READ, ms':>15}{'times':>8}")
    for latency in LATENCIES:
        for code in RETURN_DELAYS:
            alone, together = (_together(model, latency, code, args.cycles) for model in (AskedAlone, MX28))
            delay = f"{2 * code} µs"
            print(f"{latency:<10}{delay:>13}{alone * 1e3:>16.2f}{together * 1e3:>15.2f}{alone / together:>8.2f}")


class AskedAlone(MX28):
    """The same servo, never asked along with others."""

    answers_together = False


def _together(model: Any, latency: str, return_delay: int, cycles: int) -> float:
    """Give the simulated seconds of a cycle that reads 8 bytes of some servos."""
    url = f"virtual:{MX28.key()}@1-{TOGETHER}?clock=virtual&baud={FAST}&faults=latency={latency}"
    with servobus.open(url, bauds=FAST) as bus:
        servos = [bus.attach(model, id, baud=FAST) for id in range(1, TOGETHER + 1)]
        for servo in servos:
            servo.write_raw({"return_delay_time": return_delay})
        cycle = bus.cycle(("present_position", "present_temperature"), write=(), servos=servos)
        for _ in range(cycles):
            cycle.run()
        before = _clock(bus)
        for _ in range(cycles):
            lost = cycle.run().lost
            assert not lost, lost
        return (_clock(bus) - before) / cycles


def _aim(job: Job, of_bits: float, of_singly: float) -> str:
    if job.full_duplex:
        return f"{TIMES:g} times {_said(of_singly >= TIMES)}"
    return f"{SHARE:.0%} {_said(of_bits >= SHARE)}"


def _said(reached: bool) -> str:
    return "reached" if reached else "NOT_FAST"


Way = Callable[[Bus, list[BusServo], Job], Callable[[], None]]
"""Makes a function that reads all servos once."""


def one_by_one(_: Bus, servos: list[BusServo], job: Job) -> Callable[[], None]:
    """Ask and wait, one servo after the other, as other drivers do."""

    def once() -> None:
        for servo in servos:
            servo.read_many(job.registers)

    return once


def in_cycles(bus: Bus, servos: list[BusServo], _: Job) -> Callable[[], None]:
    """Let a control cycle ask."""
    cycle = bus.cycle(write=(), servos=[servo.id for servo in servos])

    def once() -> None:
        lost = cycle.run().lost
        assert not lost, lost

    return once


WAYS: dict[str, Way] = {"one after the other": one_by_one, "bus.cycle()": in_cycles}


def _rate(job: Job, make: Way, cycles: int) -> float:
    """Give the cycles in a simulated second."""
    with _opened(job.model, f"1-{SERVOS}", FAST) as bus:
        servos = [bus.attach(job.model, id, baud=FAST) for id in range(1, SERVOS + 1)]
        if job.model is RX28:
            for servo in servos:
                servo.write(RX28.return_delay_time, 0.0)
        once = make(bus, servos, job)
        for _ in range(cycles):  # gaps shrink to what the line needs
            once()
        before = _clock(bus)
        for _ in range(cycles):
            once()
        return cycles / (_clock(bus) - before)


def _scan(model: Any, baud: int) -> tuple[float, float]:
    """Give the simulated seconds of a scan that meets one servo, and the CPU seconds."""
    with _opened(model, str(LAST), baud) as bus:
        before, started = _clock(bus), time.process_time()
        found = bus.scan(family=model.family, bauds=[baud])
        assert [servo.id for servo in found] == [LAST]
        return _clock(bus) - before, time.process_time() - started


def _opened(model: Any, ids: str, baud: int) -> Bus:
    return servobus.open(f"virtual:{model.key()}@{ids}?clock=virtual&baud={baud}", bauds=baud)


def _clock(bus: Bus) -> float:
    port: VirtualPort = bus.transport  # type: ignore[assignment] # a virtual: port is one
    return port.now()


if __name__ == "__main__":
    main()
