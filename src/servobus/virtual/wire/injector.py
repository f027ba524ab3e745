"""Brings faults about on one line.

What servos hear and what collides on the wire stays the wire's business. A reply is altered when the receiver at the
client's end has it, byte by byte, so that no fault makes a collision of its own, but for `twin`, which is one.
Whatever a fault hits is decided once, when the reply or the request begins.
"""

import bisect
import math
import random
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

from servobus.core.framing import Decoder, Framing, Packet
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.wire.adapter import Delivery, Handover, plain
from servobus.virtual.wire.faults import KINDS, Fault, Faults, Injected
from servobus.virtual.wire.uart import EPSILON, Transmission

Switch: TypeAlias = Callable[[Iterable[VirtualServo], float], None]
"""Switches the supply of servos at a time in s."""

OUTAGE = 0.5
"""s that servos unplugged by chance, or at a moment, stay off if nothing else is said."""
KEPT = 100_000
"""Faults that the log remembers, the latest ones."""
BEHIND = -1.0
"""In place of a time: when the reply is over."""
TRIES = 256
"""Pairs of bits that are tried before it is believed that none fits."""


class Dice:
    """Decides about one fault, packet by packet."""

    def __init__(self, fault: Fault, name: str) -> None:
        self.fault = fault
        self.random = random.Random(name)

    def hits(self, number: int, time: float) -> bool:
        fault = self.fault
        return fault.which.holds(number, time) and (fault.probability >= 1 or self.random.random() < fault.probability)

    @property
    def argument(self) -> Any:
        return KINDS[self.fault.kind].default if self.fault.argument is None else self.fault.argument


class Injector:
    """The faults of one line, at whose client's end it stands.

    framing, name   of the family on the line; the name seeds the dice, so that two lines have different luck
    servos          those on the line; the same list that the line holds
    handover        what hands over to the client what comes
    plug, unplug    what gives servos their supply, and takes it away
    now             s: faults happen from then on
    """

    def __init__(
        self,
        faults: Faults,
        framing: Framing,
        name: str,
        servos: Sequence[VirtualServo],
        handover: Handover,
        *,
        plug: Switch,
        unplug: Switch,
        now: float,
    ) -> None:
        self.faults = faults
        self.log: deque[Injected] = deque(maxlen=KEPT)
        self.counts: Counter[str] = Counter()
        """Kind -> how often it was brought about."""
        self._framing, self._family_name, self._servos = framing, name, servos
        self._plug_servos, self._unplug_servos = plug, unplug
        self._handover = handover
        names = list(KINDS)
        seed = f"{faults.seed}/{name}"
        dice = [Dice(fault, f"{seed}/{number}/{fault.kind}") for number, fault in enumerate(faults.faults)]
        dice.sort(key=lambda one: names.index(one.fault.kind))
        self._reply_dice = [one for one in dice if KINDS[one.fault.kind].hits == "reply"]
        self._request_dice = [one for one in dice if KINDS[one.fault.kind].hits == "request"]
        self._replies = self._sent = 0
        """Replies and requests so far."""
        self._jitter = random.Random(f"{seed}/jitter")
        self._requests = Decoder(framing)
        self._sent_until = now
        self._changes: list[tuple[float, Callable[[float], None]]] = []
        """What is going to happen to servos, and when."""
        self._off: dict[Dice, list[VirtualServo]] = {}
        """What each fault has taken the supply from, and not given back."""
        self._glued = False
        """Whether the last reply is held until the next comes."""
        self._gone: list[tuple[float, float]] = []
        """From when to when the port is gone."""
        for one in self._request_dice:
            self._schedule(one, now)

    def skew(self, servo: VirtualServo) -> float:
        """Give the factor by which a servo is too fast."""
        return 1 + self.faults.skew(servo.id)

    def next_event(self, now: float) -> float | None:
        """Give the time at which the port goes away next."""
        return min((start for start, _ in self._gone if start > now), default=None)

    def gone(self, now: float) -> bool:
        """Tell whether the port is gone now."""
        return any(start <= now + EPSILON < end for start, end in self._gone)

    # Replies

    def reply(self, wave: Transmission) -> list[Transmission]:
        """Decide what becomes of a reply; give what the client's end of the wire carries of it."""
        self._replies += 1
        waiting, self._glued = self._glued, False
        jitter = self._jitter.uniform(0, self.faults.jitter) if self.faults.jitter else 0.0
        hits = [one for one in self._reply_dice if one.hits(self._replies, wave.start)]
        if not hits and not jitter:
            return [wave]
        plan = plain(wave.data)
        plan.jitter = jitter
        twins: list[Transmission] = []
        for one in hits:
            match one.fault.kind:
                case "mute":
                    self._note(one, self._replies, "all of it", wave.start)
                    return []
                case "twin":
                    start = wave.end if one.argument == BEHIND else wave.start + one.argument
                    twins.append(Transmission(start, wave.baud, wave.data, wave.sender))
                    self._note(one, self._replies, f"{start - wave.start:.6f} s after its start", wave.start)
                case "glue":
                    if not waiting:  # this one would let the last one go
                        plan.hold, self._glued = one.argument, True
                        self._note(one, self._replies, "to the next", wave.start)
                case kind:
                    alter: Callable[[Dice, Delivery], str | None] = getattr(self, f"_{kind}")
                    if (where := alter(one, plan)) is not None:
                        self._note(one, self._replies, where, wave.start)
        if plan.late is not None:
            self._handover.take_late(wave.end + plan.late, plan.data)
            return twins
        wave.note = plan
        return [wave, *twins]

    def _stranger(self, dice: Dice, plan: Delivery) -> str:
        packet, _ = self._framing.unframe(plan.data)
        id = dice.fault.where
        if id is None:
            id = (packet.id + dice.random.randrange(1, 254)) % 254
        raw = self._framing.frame(Packet(id, packet.code, packet.data))
        plan.parts = plain(raw).parts
        return f"id {id} for {packet.id}"

    def _pair(self, dice: Dice, plan: Delivery) -> str | None:
        frame, header = plan.data, len(self._framing.header)
        if dice.fault.where is not None and not 8 * header <= dice.fault.where < 8 * len(frame):
            return None
        for _ in range(TRIES):
            one = dice.random.randrange(8 * header, 8 * len(frame)) if dice.fault.where is None else dice.fault.where
            other = 8 * dice.random.randrange(header, len(frame)) + one % 8
            raw = _flipped(_flipped(frame, one), other)
            if one != other and self._framing.size(raw, 0) == len(raw) and self._framing.unframe(raw)[1]:
                plan.parts = plain(raw).parts
                return f"bits {one}, {other}"
        return None

    def _flip(self, dice: Dice, plan: Delivery) -> str | None:
        bit = _place(dice, 8 * len(plan.parts))
        if bit is None:
            return None
        plan.parts[bit // 8] = _flipped(plan.parts[bit // 8], bit % 8)
        return f"bit {bit}"

    def _drop(self, dice: Dice, plan: Delivery) -> str | None:
        byte = _place(dice, len(plan.parts))
        if byte is None:
            return None
        plan.parts[byte] = b""
        return f"byte {byte}"

    def _junk(self, dice: Dice, plan: Delivery) -> str | None:
        size = len(plan.parts)
        where = dice.fault.where
        if where is None:
            where = dice.random.choice(("before", "inside", "after"))
        if where == "inside":
            where = dice.random.randrange(1, size)
        junk = dice.argument
        if isinstance(junk, tuple):
            headers = self._framing.header
            count = dice.random.randint(*junk)
            # Every fourth may begin a packet.
            junk = bytes(dice.random.choice((headers[0], *dice.random.choices(range(256), k=3))) for _ in range(count))
        if where == "after":
            plan.parts[-1] += junk
        else:
            at = 0 if where == "before" else where
            if at >= size:
                return None
            plan.parts[at] = junk + plan.parts[at]
        return f"{len(junk)} bytes {where if isinstance(where, str) else f'before byte {where}'}"

    def _split(self, dice: Dice, plan: Delivery) -> str | None:
        size = len(plan.parts)
        byte = dice.random.randrange(1, size) if dice.fault.where is None else dice.fault.where
        if byte >= size:
            return None
        plan.pauses[byte] = max(plan.pauses.get(byte, 0.0), dice.argument)
        return f"before byte {byte}"

    def _stall(self, dice: Dice, plan: Delivery) -> str:
        plan.pauses[0] = max(plan.pauses.get(0, 0.0), dice.argument)
        return f"{dice.argument:g} s"

    def _late(self, dice: Dice, plan: Delivery) -> str:
        plan.late = dice.argument
        return f"{dice.argument:g} s"

    # Requests

    def send(self, wave: Transmission, *, echo: bool) -> tuple[list[Transmission], list[Transmission]]:
        """Decide what servos hear of what the client sends, and what it hears of that itself."""
        if not self._request_dice:
            return [wave], [wave] if echo else []
        if wave.start > self._sent_until + min(servo.garbage_timeout for servo in self._servos):
            self._requests.drop()  # as the servos did
        self._sent_until = wave.end
        before, behind = self._requests.position, 0
        heard = [True] * len(wave.data)
        parts = [bytes((byte,)) if echo else b"" for byte in wave.data]
        for event in self._requests.feed(wave.data):
            if isinstance(event, Packet):
                self._sent += 1
                stop = event.end - before
                begin = max(0, stop - self._framing.overhead - len(event.data))
                for one in self._request_dice:
                    self._befall(one, wave, slice(begin, stop), heard, parts, behind)
                behind = stop
        echoed = Transmission(wave.start, wave.baud, wave.data, None, plain=wave.plain, note=Delivery(parts))
        return [wave] if all(heard) else _pieces(wave, heard), [echoed] if any(parts) else []

    def _befall(
        self, one: Dice, wave: Transmission, packet: slice, heard: list[bool], parts: list[bytes], behind: int
    ) -> None:
        """Let a fault act on the request that stands at these bytes of the wave; the last one ends at `behind`."""
        fault, number, start = one.fault, self._sent, wave.time(packet.start)
        if fault.kind == "unplug" and fault.probability == 1:
            self._unplug(one, number, start)
        elif fault.which.timed and fault.probability == 1 and KINDS[fault.kind].rare:
            pass  # it is scheduled already
        elif one.hits(number, start):
            if fault.kind == "echo":
                for at in range(behind, packet.start):  # an adapter that echoes does not know what is a packet
                    parts[at] = b"" if fault.where == "none" else wave.data[at : at + 1]
                self._note(one, number, _echo(one, wave.data, packet, parts), start)
            elif fault.kind == "deaf":
                heard[packet] = [False] * (packet.stop - packet.start)
                self._note(one, number, "all of it", start)
            elif fault.kind == "gone":
                stop = start if fault.where == "write" else wave.time(packet.stop)
                if fault.where == "write":
                    heard[packet.start :] = [False] * (len(heard) - packet.start)
                self._lose_port(one, number, stop)
            else:
                self._cut(one, number, start, one.argument)

    def _lose_port(self, one: Dice, number: int, time: float) -> None:
        self._gone.append((time, time + one.argument))
        self._note(one, number, one.fault.where or "read", time)

    # Servos without supply

    def heal(self, now: float) -> None:
        """Give every servo the supply again that a fault took."""
        for one in list(self._off):
            self._give_back(one, now)

    def change(self, until: float) -> bool:
        """Let the next thing happen to the servos that is due by then; False if there is none."""
        if not self._changes or self._changes[0][0] > until:
            return False
        time, act = self._changes.pop(0)
        act(time)
        return True

    def _schedule(self, one: Dice, now: float) -> None:
        """Put down what happens at a time."""
        fault = one.fault
        if not fault.which.timed or fault.probability < 1:
            return
        start = max(now, fault.which.first)
        if fault.kind == "gone":
            self._lose_port(one, 0, start)
        elif fault.kind == "reboot":
            self._cut(one, 0, start, one.argument)
        elif fault.kind == "unplug":
            outage = fault.which.last - start or OUTAGE
            self._cut(one, 0, start, outage if fault.argument is None else fault.argument)

    def _unplug(self, one: Dice, number: int, time: float) -> None:
        which, outage = one.fault.which, one.fault.argument
        if which.timed:
            return
        if number == which.first:
            self._cut(one, number, time, math.inf if outage is None else outage)
        elif number == which.last + 1 and outage is None:
            self._at(time, lambda now: self._give_back(one, now))

    def _cut(self, one: Dice, number: int, time: float, outage: float) -> None:
        """Take the supply from servos at this time, for so many s."""

        def cut(now: float) -> None:
            low, high = one.fault.where or (0, math.inf)
            servos = [servo for servo in self._servos if servo.powered and low <= servo.id <= high]
            if one.fault.probability < 1 and servos:
                servos = [one.random.choice(servos)]
            self._off.setdefault(one, []).extend(servos)
            self._unplug_servos(servos, now)
            if outage < math.inf:
                self._at(now + outage, lambda now: self._give_back(one, now, servos))
            if servos:
                self._note(one, number, f"ids {', '.join(str(servo.id) for servo in servos)}", now)

        self._at(time, cut)

    def _give_back(self, one: Dice, now: float, some: Sequence[VirtualServo] | None = None) -> None:
        """Give servos the supply again that this fault took: these, or all of them."""
        off = self._off.get(one, [])
        servos = [servo for servo in off if some is None or servo in some]
        self._off[one] = [servo for servo in off if servo not in servos]
        self._plug_servos(servos, now)

    def _at(self, time: float, act: Callable[[float], None]) -> None:
        bisect.insort(self._changes, (time, act), key=lambda change: change[0])

    def _note(self, one: Dice, number: int, where: str, time: float) -> None:
        self.counts[one.fault.kind] += 1
        self.log.append(Injected(one.fault.kind, number, where, time, self._family_name))


def _place(dice: Dice, size: int) -> int | None:
    """Give the place that a fault names, or one by chance; None if the packet has no such place."""
    where: int | None = dice.fault.where
    if where is None:
        return dice.random.randrange(size)
    return where if where < size else None


def _flipped(data: bytes, bit: int) -> bytes:
    byte, place = divmod(bit, 8)
    return data[:byte] + bytes((data[byte] ^ 1 << place,)) + data[byte + 1 :]


def _echo(dice: Dice, data: bytes, packet: slice, parts: list[bytes]) -> str:
    """Put what comes back of a request in its place among the parts."""
    whole = [bytes((byte,)) for byte in data[packet]]
    size, number, how = len(whole), dice.argument, dice.fault.where or "full"
    match how:
        case "part":
            number = dice.random.randrange(1, size) if number is None else min(number, size)
            whole[number:] = [b""] * (size - number)
            how = f"first {number} bytes"
        case "bad":
            number = dice.random.randrange(size) if number is None else min(number, size - 1)
            whole[number] = _flipped(whole[number], dice.random.randrange(8))
            how = f"bad byte {number}"
        case "none":
            whole = [b""] * size
    parts[packet] = whole
    return how


def _pieces(wave: Transmission, heard: list[bool]) -> list[Transmission]:
    """Give what is left of a wave, each byte at its time."""
    pieces: list[Transmission] = []
    start = None
    for at, there in enumerate([*heard, False]):
        if there and start is None:
            start = at
        elif not there and start is not None:
            pieces.append(Transmission(wave.time(start), wave.baud, wave.data[start:at], None, plain=wave.plain))
            start = None
    return pieces
