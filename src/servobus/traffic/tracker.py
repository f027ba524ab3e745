"""The traffic between a program and its servos: a stream of bytes becomes requests, answers and troubles.

A `Tracker` is fed with what was carried or heard, each piece with its time and direction, and gives what that says.
No port, no clock, no thread: fed with a recording it gives the same as it gave live.

Which requests are answered follows from the packet for questions. Whether commands are depends on a setting of the
servo: one that answered the last command is expected to answer the next one too.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Corrupt, Event, Noise, Packet
from servobus.families.base import Family, Model
from servobus.families.explain import addressed, servo, show_bytes
from servobus.families.present import junk_text
from servobus.families.registry import FAMILIES, MODELS, first_model
from servobus.traffic.events import GRAIN, EventKind, ServoTraffic, TrafficEvent, Trouble
from servobus.traffic.recording import DIGITS, Chunk, Direction, Entry, Speed, TapEnd
from servobus.traffic.streams import Mark, Stream, best_family, certain_family, good_bytes

QUIET = 0.05
"""s; assumption: no adapter keeps back the rest of a packet for so long."""
PATIENCE = 0.1
"""s; assumption: no servo, adapter and system together need so long for an answer, less its time on the wire."""
MEMORY = 1.0
"""s for which a question is remembered after its time-out: until then an answer to it counts as late, not unasked."""
BITS = 10
"""Bits of a byte on the wire, start and stop bit included."""
REPEATED = 1024
"""Packets whose explanation is kept: programs ask the same again and again."""
ECHOES = 16
"""Requests whose echo may still come."""
HEAD = 4
"""Bytes of a packet that tell whose it is and how long, in all families."""


@dataclass(slots=True, eq=False)
class _Open:
    """A reply that a question on its way asks for."""

    family: Family
    packet: Packet
    reply: ReplyPattern
    text: str
    end: float
    """s: when its last byte was on the wire."""
    mark: float
    """s: when the piece came that its last byte was in."""
    expected: bool
    deadline: float
    spoiled: bool = False
    """Whether something corrupt came that may have been the answer."""

    @property
    def id(self) -> int:
        """The servo that must answer; the broadcast id where any may."""
        return self.packet.id if self.reply.id is None else self.reply.id

    def fits(self, family: Family, packet: Packet) -> bool:
        return family is self.family and self.reply.fits(packet)

    def begins(self, raw: bytes) -> bool:
        """Tell whether these bytes are the beginning of the answer, and not all of it."""
        reply, framing = self.reply, self.family.framing
        if reply.id is None or len(raw) < HEAD - 1:
            return False
        whole = [framing.frame(Packet(reply.id, reply.code or 0, bytes(size))) for size in reply.sizes]
        return any(len(raw) < len(one) and one[:HEAD].startswith(raw[:HEAD]) for one in whole)


class Tracker:
    """Explains the traffic on one line, with servos of one family or, if none is given, of any.

    family   whose packets these are; found out for each piece by default
    model    whose registers these are; else those of the family's first model
    baud     the line's speed, bit/s, from which the end of a request on the wire is reckoned
    """

    def __init__(self, family: Family | None = None, model: type[Model] | None = None, baud: int | None = None) -> None:
        self._found_out = family is None and model is None
        self._family = model.family if model else family
        self._model = model
        self._baud = baud
        self._busy = 0.0
        """s: until then what was sent is on the wire."""
        self._streams: dict[tuple[str, Direction], Stream] = {}
        self._held: list[Chunk] = []
        """What came before the family is known."""
        self._open: list[_Open] = []
        self._overdue: deque[_Open] = deque(maxlen=ECHOES)
        self._sent: deque[tuple[Packet, float]] = deque(maxlen=ECHOES)
        """Requests that may be echoed, and until when."""
        self._probed = 0.0
        """s: until then a probe may come back."""
        self._echo: bool | None = None
        self._perhaps_echoed: _Open | None = None
        """A question whose answer was the same as itself, and may have been its echo."""
        self._answers_commands: set[tuple[str, int]] = set()
        """Servos that answered the last command."""
        self._servos: dict[tuple[str, int], ServoTraffic] = {}
        self.junk = 0
        """Bytes that were no packet."""
        self.corrupt = 0
        """Packets whose checksum was wrong."""
        self.cut_short = 0
        """Answers that began and did not end."""
        self.time = 0.0
        """s: up to when the line was watched."""

    @property
    def family(self) -> Family | None:
        """The family of the last packets."""
        return self._family

    @property
    def servos(self) -> list[ServoTraffic]:
        """What each servo did, in the order of families and ids."""
        return [self._servos[key] for key in sorted(self._servos)]

    def feed(self, entry: Entry) -> list[TrafficEvent]:
        """Take in what was carried or heard, in the order of time."""
        events = self.pass_time(entry.time)
        if isinstance(entry, TapEnd):
            return events
        if isinstance(entry, Speed):
            self._baud = entry.baud
            text = f"the line is at {entry.baud} baud from here on"
            return [*events, TrafficEvent(entry.time, Direction.UNKNOWN, EventKind.SPEED, text)]
        return events + self._take(entry)

    def pass_time(self, now: float) -> list[TrafficEvent]:
        """Tell that nothing more came before `now`: what is incomplete stays so, answers that are due are missing."""
        now = round(now, DIGITS)
        events: list[TrafficEvent] = []
        while (due := self._next_due()) is not None and due[0] <= now:
            moment, what = due
            if isinstance(what, _Open):
                events += self._time_out(what, moment)
            elif isinstance(what, Stream):
                events += self._sort(what, what.flush())
            else:
                events += self._decide_by_best()
        self.time = max(self.time, now)
        return events

    def finish(self) -> list[TrafficEvent]:
        """Tell that this was all. A last question that may still have been answered counts neither way."""
        events = self._decide_by_best() if self._held else []
        for stream in self._streams.values():
            events += self._sort(stream, stream.flush())
        self._open.clear()
        return events

    def _next_due(self) -> "tuple[float, _Open | Stream | None] | None":
        """Tell what happens next if nothing comes, and when."""
        due: list[tuple[float, _Open | Stream | None]] = [(one.deadline, one) for one in self._open]
        due += [(one.last + QUIET, one) for one in self._streams.values() if one.decoder.pending]
        if self._held:
            due.append((self._held[-1].time + QUIET, None))
        return min(due, key=lambda one: one[0], default=None)

    # Which family the bytes are of

    def _take(self, chunk: Chunk) -> list[TrafficEvent]:
        if not self._found_out:
            assert self._family is not None
            return self._feed(self._family, chunk)
        if self._family is None:
            self._held.append(chunk)
            family = certain_family(self._held)
            return self._decide(family) if family is not None else []
        if not good_bytes(self._family, chunk.data):
            # Only what is wholly made of another family's packets is its: a false packet may hide in anything.
            size = len(chunk.data.removeprefix(self._family.framing.probe))
            others = (one for one in FAMILIES.values() if size and good_bytes(one, chunk.data) == size)
            if (other := next(others, None)) is not None:
                events = [one for stream in self._streams.values() for one in self._sort(stream, stream.flush())]
                self._family = other
                return events + self._feed(other, chunk)
        return self._feed(self._family, chunk)

    def _decide(self, family: Family) -> list[TrafficEvent]:
        self._family = family
        held, self._held = self._held, []
        return [one for chunk in held for one in self._feed(family, chunk)]

    def _decide_by_best(self) -> list[TrafficEvent]:
        family = best_family(self._held)
        if family is not None:
            return self._decide(family)
        held, self._held = self._held, []
        self.junk += sum(len(chunk.data) for chunk in held)
        return [_junk(chunk.time, chunk.direction, chunk.data, None) for chunk in held]

    def _feed(self, family: Family, chunk: Chunk) -> list[TrafficEvent]:
        events: list[TrafficEvent] = []
        wire = chunk.time
        if chunk.direction is Direction.OUT:
            wire = max(chunk.time, self._busy)
            self._busy = wire + self._wire_time(len(chunk.data))
            answers = self._streams.get((family.name, Direction.IN))
            if answers is not None and not family.full_duplex:
                events += self._sort(answers, answers.flush())  # the rest of it will not come any more
        key = family.name, chunk.direction
        stream = self._streams.get(key) or self._streams.setdefault(key, Stream(family, chunk.direction))
        events += self._sort(stream, stream.feed(chunk, wire))
        if chunk.direction is Direction.IN and stream.decoder.pending > self._longest(family):
            events += self._sort(stream, stream.flush())  # a header that promises more than was asked for is none
        return events

    def _longest(self, family: Family) -> float:
        """Give the size of the longest answer that may come, in bytes; infinite while nothing was asked."""
        asked = [one.reply for one in (*self._open, *self._overdue) if one.family is family]
        sizes = [family.framing.overhead + max(reply.sizes) for reply in asked]
        return max(sizes, default=math.inf) if self._open else math.inf

    def _wire_time(self, count: int) -> float:
        return count * BITS / self._baud if self._baud else 0.0

    # What the bytes mean

    def _sort(self, stream: Stream, placed: Sequence[tuple[int, bytes, Event]]) -> Iterator[TrafficEvent]:
        for n, (start, raw, event) in enumerate(placed):
            first, last = stream.at(start), stream.at(start + len(raw) - 1)
            match event:
                case Noise() if (probe := self._probe(stream, raw, first, placed[n + 1 :])) is not None:
                    yield probe
                case Noise() if (asked := self._begun(stream, raw)) is not None:
                    yield self._cut(asked, stream, raw, first)
                case Noise():
                    self.junk += len(raw)
                    yield _junk(first.time, stream.direction, raw, stream.family)
                case Corrupt(packet):
                    yield self._corrupt(stream, packet, raw, first)
                case Packet() if self._is_request(stream, event):
                    end = last.time
                    if stream.direction is Direction.OUT:
                        end = last.wire + self._wire_time(event.end - last.start)
                    yield from self._request(stream, event, raw, first, last, end)
                case Packet():
                    yield self._answer(stream, event, raw, first)

    def _probe(
        self, stream: Stream, raw: bytes, first: Mark, behind: Sequence[tuple[int, bytes, Event]]
    ) -> TrafficEvent | None:
        """Recognise the byte that a driver sends before a request to find out about an echo, or that byte's echo."""
        if raw != stream.family.framing.probe:
            return None
        family, direction, time = stream.family, stream.direction, first.time
        if direction is Direction.IN and time < self._probed:
            self._probed = 0.0
            return TrafficEvent(time, direction, EventKind.ECHO, "echo of the probe", family, None, raw)
        if direction is not Direction.IN and behind:
            request = behind[0][2]
            if isinstance(request, Packet) and self._is_request(stream, request):
                self._probed = time + PATIENCE
                text = "probe: servos skip this byte, an echo brings it back"
                return TrafficEvent(time, direction, EventKind.PROBE, text, family, None, raw)
        return None

    def _begun(self, stream: Stream, raw: bytes) -> _Open | None:
        """Find the question whose answer these bytes are the beginning of."""
        if stream.direction is Direction.OUT:
            return None
        return next((one for one in self._open if one.family is stream.family and one.begins(raw)), None)

    def _cut(self, asked: _Open, stream: Stream, raw: bytes, first: Mark) -> TrafficEvent:
        asked.spoiled = True
        id = asked.id
        self._counts(stream.family, id).corrupt += 1
        self.cut_short += 1
        text = f"CUT SHORT: the answer of {servo(id)} begins so, and a byte or more of it is lost"
        return TrafficEvent(
            first.time, stream.direction, EventKind.CORRUPT, text, stream.family, id, raw, None, Trouble.CUT
        )

    def _is_request(self, stream: Stream, packet: Packet) -> bool:
        """Tell a request from an answer; where the sender is not known, by what was asked before."""
        if stream.direction is not Direction.UNKNOWN:
            return stream.direction is Direction.OUT
        asked = self._answered_by(stream.family, packet)
        if asked is not None and not (packet.data and packet == asked.packet):
            return False
        return stream.family.replies_to(packet) is not None

    def _answered_by(self, family: Family, packet: Packet) -> _Open | None:
        return next((one for one in self._open if one.fits(family, packet)), None)

    def _request(
        self, stream: Stream, packet: Packet, raw: bytes, first: Mark, last: Mark, end: float
    ) -> Iterator[TrafficEvent]:
        family = stream.family
        for one in list(self._open):
            # A program that asks on has stopped waiting, unless the line is full duplex and the request is to another.
            if not (family is one.family and family.full_duplex and one.packet.id != packet.id):
                answers = self._streams.get((one.family.name, Direction.IN))
                if answers is not None and one.begins(answers.decoder.begun):
                    yield from self._sort(answers, answers.flush())  # the rest of it will not come any more
                yield from self._time_out(one, first.time)
        replies = family.replies_to(packet)
        if replies is None:
            data = f", data {show_bytes(packet.data)}" if packet.data else ""
            text = f"unknown request {packet.code:#04x} {addressed(packet.id)}{data}"
            replies = (ReplyPattern(packet.id, None, (0,), certain=False),)  # it may be refused
        else:
            text = self._explain(family, packet, None)
        self._perhaps_echoed = None
        self._counts(family, packet.id).requests += 1
        self._sent.append((packet, end + PATIENCE))
        size = 0
        for reply in replies:
            id = packet.id if reply.id is None else reply.id
            expected = reply.certain or (family.name, id) in self._answers_commands
            size += family.framing.overhead + max(reply.sizes)
            deadline = end + PATIENCE + self._wire_time(size)
            self._open.append(_Open(family, packet, reply, text, end, last.time, expected, deadline))
        yield TrafficEvent(first.time, stream.direction, EventKind.REQUEST, text, family, packet.id, raw)

    def _answer(self, stream: Stream, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        family, time = stream.family, first.time
        asked = self._answered_by(family, packet)
        if stream.direction is Direction.IN and self._is_echo(packet, asked, time):
            text = "echo of the request"
            return TrafficEvent(time, stream.direction, EventKind.ECHO, text, family, packet.id, raw)
        counts = self._counts(family, packet.id)
        if asked is not None:
            self._open.remove(asked)
            if self._echo is None:
                if packet == asked.packet:
                    self._perhaps_echoed = asked
                else:
                    self._echo = False
            self._counts(family, asked.id).answered += 1
            counts.answers += 1
            if not asked.reply.certain:
                self._answers_commands.add((family.name, packet.id))
            return self._answer_to(asked, stream, packet, raw, first)
        if self._perhaps_echoed is not None and self._perhaps_echoed.fits(family, packet):
            asked, self._perhaps_echoed, self._echo = self._perhaps_echoed, None, True
            return self._answer_to(asked, stream, packet, raw, first)
        trouble, text = self._misplaced(family, packet, time)
        counts.other += 1
        return TrafficEvent(time, stream.direction, EventKind.ANSWER, text, family, packet.id, raw, None, trouble)

    def _answer_to(self, asked: _Open, stream: Stream, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        family = stream.family
        latency = None
        if first.time > asked.mark:  # of two that came in one piece the time between them is not known
            latency = max(first.time - asked.end, 0.0)
            self._counts(family, packet.id).latencies[round(latency / GRAIN)] += 1
        text = self._explain(family, packet, asked.packet)
        return TrafficEvent(first.time, stream.direction, EventKind.ANSWER, text, family, packet.id, raw, latency)

    def _is_echo(self, packet: Packet, asked: _Open | None, time: float) -> bool:
        """Tell whether this is what was sent. Some requests look like their own answers (Dynamixel PING)."""
        sent = next((one for one in self._sent if one[0] == packet and time < one[1]), None)
        if sent is None or (asked is not None and not self._echo):
            return False
        self._sent.remove(sent)
        self._echo = True
        return True

    def _misplaced(self, family: Family, packet: Packet, time: float) -> tuple[Trouble, str]:
        """Say what is wrong with an answer that fits no open question."""
        late = next((one for one in self._overdue if one.fits(family, packet) and time < one.end + MEMORY), None)
        if late is not None:
            self._overdue.remove(late)
            said = self._explain(family, packet, late.packet)
            return Trouble.LATE, f"LATE, {1000 * (time - late.end):.0f} ms behind its question: {said}"
        said = self._explain(family, packet, None)
        if family.replies_to(packet) is not None:  # read as a request, it would say what it cannot mean here
            data = f", data {show_bytes(packet.data)}" if packet.data else ""
            said = f"answer of {servo(packet.id)}, {packet.code:#04x}{data}"
        open = [one for one in self._open if one.family is family]
        asked = next((one for one in open if one.id == packet.id), open[0] if open else None)
        if asked is None:
            return Trouble.UNASKED, f"NOBODY ASKED for this: {said}"
        if asked.id != packet.id:
            return Trouble.STRANGER, f"STRANGER, id {asked.id} was asked: {said}"
        self._open.remove(asked)
        self._counts(family, packet.id).failed += 1
        return Trouble.MISFIT, f"DOES NOT FIT the question: {said}"

    def _corrupt(self, stream: Stream, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        family = stream.family
        asked = None
        if stream.direction is not Direction.OUT:
            asked = next((one for one in self._open if one.family is family), None)
        if asked is not None:
            asked.spoiled = True
        # Its id may be what is wrong: it counts for a servo that was asked, or is known.
        id = asked.id if asked else packet.id
        if asked is not None or (family.name, id) in self._servos:
            self._counts(family, id).corrupt += 1
        self.corrupt += 1
        said = self._explain(family, packet, asked.packet if asked else None)
        text = f"CHECKSUM WRONG: would be {said}"
        return TrafficEvent(
            first.time, stream.direction, EventKind.CORRUPT, text, family, id, raw, None, Trouble.CHECKSUM
        )

    def _time_out(self, asked: _Open, time: float) -> Iterator[TrafficEvent]:
        """End the wait for an answer."""
        self._open.remove(asked)
        self._overdue.append(asked)
        counts = self._counts(asked.family, asked.id)
        if asked.spoiled:
            counts.failed += 1
        elif asked.expected:
            counts.failed += 1
            counts.missing += 1
            # Perhaps it was told to answer commands no longer: it is not expected to until it does again.
            self._answers_commands.discard((asked.family.name, asked.id))
            text = f"NO ANSWER to {asked.text}"
            id = asked.id
            yield TrafficEvent(time, Direction.IN, EventKind.SILENCE, text, asked.family, id, b"", None, Trouble.SILENT)

    def _explain(self, family: Family, packet: Packet, request: Packet | None) -> str:
        return _explained(family, packet, request, (self._model or first_model(family)).key())

    def _counts(self, family: Family, id: int) -> ServoTraffic:
        key = family.name, id
        if key not in self._servos:
            self._servos[key] = ServoTraffic(family, id)
        return self._servos[key]


@lru_cache(maxsize=REPEATED)
def _explained(family: Family, packet: Packet, request: Packet | None, model: str) -> str:
    return family.explain(packet, request, MODELS[model])


def _junk(time: float, direction: Direction, raw: bytes, family: Family | None) -> TrafficEvent:
    return TrafficEvent(time, direction, EventKind.NOISE, junk_text(raw), family, None, raw, None, Trouble.JUNK)
