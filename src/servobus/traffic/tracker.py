"""The traffic between a program and its servos: a stream of bytes becomes requests, answers and troubles.

A `Tracker` is fed with what was carried or heard, each piece with its time and direction, and gives what that says.
No port, no clock, no thread: fed with a recording it gives the same as it gave live.

Which requests are answered follows from the packet for questions. Whether commands are depends on a setting of the
servo: one that answered the last command is expected to answer the next one too.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence

from servobus.core.exchange import ReplyPattern
from servobus.core.framing import BITS_PER_BYTE, Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.families.base import Family, Model
from servobus.families.explain import addressed, junk_text, servo, show_bytes
from servobus.families.registry import FAMILIES
from servobus.traffic.events import GRAIN, UNASKED, EventKind, ServoTraffic, TrafficEvent, Trouble
from servobus.traffic.open_reply import OpenReply
from servobus.traffic.recording import DIGITS, Chunk, Direction, Entry, Speed, TapEnd
from servobus.traffic.streams import PADDING, Mark, Piece, Stream
from servobus.traffic.tables import Tables

QUIET = 0.05
"""s; assumption: no adapter keeps back the rest of a packet for so long."""
PATIENCE = 0.1
"""s; assumption: no servo, adapter and system together need so long for an answer, less its time on the wire."""
MEMORY = 1.0
"""s for which a question is remembered after its time-out: until then an answer to it counts as late, not unasked."""
ECHOES = 16
"""Requests whose echo may still come."""


class Tracker:
    """Explains the traffic on one line, with servos of one family or of several.

    family   whose packets are looked for; those of others are other traffic then. All families by default
    model    whose registers these are; else those of the model that a servo was heard to report
    baud     the line's speed, bit/s, from which the end of a request on the wire is reckoned
    """

    def __init__(self, family: Family | None = None, model: type[Model] | None = None, baud: int | None = None) -> None:
        self._only = model.family if model else family
        self._family = self._only
        self._families = tuple(dict.fromkeys((*([self._only] if self._only else []), *FAMILIES.values())))
        self._tables = Tables(model)
        self._baud = baud
        self._busy = 0.0
        """s: until then what was sent is on the wire."""
        self._streams: dict[Direction, Stream] = {}
        self._open: list[OpenReply] = []
        self._overdue: deque[OpenReply] = deque(maxlen=ECHOES)
        self._sent: deque[tuple[Packet, float]] = deque(maxlen=ECHOES)
        """Requests that may be echoed, and until when."""
        self._padded, self._padded_until = 0, 0.0
        """Bytes of padding that may come back, and until when, s."""
        self._request_last: set[Direction] = set()
        """Directions in which a request was the last that came."""
        self._echo: bool | None = None
        self._perhaps_echoed: OpenReply | None = None
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

    def know(self, family: Family, id: int, model: type[Model]) -> None:
        """Take it from somebody else of which model a servo is; what the servo says itself counts more."""
        self._tables.know(family, id, model)

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
            if isinstance(what, OpenReply):
                events += self._time_out(what, moment)
            else:
                events += self._sort(what, what.flush())
        self.time = max(self.time, now)
        return events

    def finish(self) -> list[TrafficEvent]:
        """Tell that this was all. A last question that may still have been answered counts neither way."""
        events: list[TrafficEvent] = []
        for stream in self._streams.values():
            events += self._sort(stream, stream.flush())
        self._open.clear()
        return events

    def _next_due(self) -> "tuple[float, OpenReply | Stream] | None":
        """Tell what happens next if nothing comes, and when."""
        due: list[tuple[float, OpenReply | Stream]] = [(one.deadline, one) for one in self._open]
        due += [(one.last + QUIET, one) for one in self._streams.values() if one.pending]
        return min(due, key=lambda one: one[0], default=None)

    def _take(self, chunk: Chunk) -> list[TrafficEvent]:
        events: list[TrafficEvent] = []
        wire = chunk.time
        if chunk.direction is Direction.OUT:
            wire = max(chunk.time, self._busy)
            self._busy = wire + self._wire_time(len(chunk.data))
        stream = self._stream(chunk.direction)
        pieces = stream.feed(chunk, wire)
        answers = self._streams.get(Direction.IN)
        half_duplex = any(piece.family is not None and not piece.family.full_duplex for piece in pieces)
        if chunk.direction is Direction.OUT and answers is not None and half_duplex:
            events += self._sort(answers, answers.flush())  # the rest of it will not come any more
        events += self._sort(stream, pieces)
        if chunk.direction is Direction.IN and stream.pending > self._longest():
            events += self._sort(stream, stream.flush())  # a header that promises more than was asked for is none
        return events

    def _stream(self, direction: Direction) -> Stream:
        if direction not in self._streams:
            self._streams[direction] = Stream(self._families, direction, self._likeliest)
        return self._streams[direction]

    def _likeliest(self) -> list[Family]:
        """Give the families whose packets are likeliest to come: those that are asked, and the one that came last."""
        if self._only is not None:
            return [self._only]
        last = [] if self._family is None else [self._family]
        return [*(one.family for one in self._open), *last]

    def _longest(self) -> float:
        """Give the size of the longest answer that may come, in bytes; infinite while nothing was asked."""
        asked = (*self._open, *self._overdue)
        sizes = [one.family.framing.overhead + max(one.reply.sizes) for one in asked]
        return max(sizes, default=math.inf) if self._open else math.inf

    def _wire_time(self, count: int) -> float:
        return count * BITS_PER_BYTE / self._baud if self._baud else 0.0

    # What the bytes mean

    def _sort(self, stream: Stream, pieces: Sequence[Piece]) -> Iterator[TrafficEvent]:
        for n, piece in enumerate(pieces):
            first, last = stream.at(piece.start), stream.at(piece.start + len(piece.raw) - 1)
            behind = pieces[n + 1] if n + 1 < len(pieces) else None
            followed_request = stream.direction in self._request_last
            self._request_last.discard(stream.direction)
            match piece.family, piece.event:
                case None, _:
                    yield self._noise(stream, piece.raw, first, behind, followed_request=followed_request)
                case family, Corrupt(packet):
                    yield self._corrupt(stream, family, packet, piece.raw, first)
                case family, Packet() as packet if self._only not in (None, family):
                    text = f"other traffic, {family.title}: {self._tables.explain(family, packet)}"
                    yield TrafficEvent(
                        first.time, stream.direction, EventKind.OTHER, text, family, packet.id, piece.raw
                    )
                case family, Packet() as packet if self._is_request(stream, family, packet):
                    self._family = family
                    end = last.time
                    if stream.direction is Direction.OUT:
                        end = last.wire + self._wire_time(packet.end - last.start)
                    yield from self._request(stream, family, packet, piece.raw, first, last, end)
                    self._request_last.add(stream.direction)
                case family, Packet() as packet:
                    self._family = family
                    yield self._answer(stream, family, packet, piece.raw, first)

    def _noise(
        self, stream: Stream, raw: bytes, first: Mark, behind: Piece | None, *, followed_request: bool
    ) -> TrafficEvent:
        """Say what bytes are that are no packet."""
        padding = self._padding(stream, raw, first, behind, followed_request=followed_request)
        if padding is not None:
            return padding
        asked = self._begun(stream, raw)
        if asked is not None:
            return self._cut(asked, stream, raw, first)
        if foreign := next(filter(None, (family.framing.foreign_in(raw) for family in self._families)), ""):
            return TrafficEvent(
                first.time, stream.direction, EventKind.NOISE, f"{len(raw)} bytes of {foreign}", self._family, None, raw
            )
        self.junk += len(raw)
        return TrafficEvent(
            first.time, stream.direction, EventKind.NOISE, junk_text(raw), self._family, None, raw, None, Trouble.JUNK
        )

    def _padding(
        self, stream: Stream, raw: bytes, first: Mark, behind: Piece | None, *, followed_request: bool
    ) -> TrafficEvent | None:
        """Recognise bytes between requests that servos skip, or their echo.

        A driver sends one before a request that looks like its own answer, to find out whether the line echoes; some to
        keep the answers of several servos apart, or to end what a servo took for the start of a packet.
        """
        if raw.strip(PADDING):
            return None
        family, direction, time = self._family, stream.direction, first.time
        if direction is Direction.IN:
            if time >= self._padded_until or len(raw) > self._padded:
                return None
            self._padded -= len(raw)
            text = "echo of the probe" if len(raw) == 1 else "echo of the padding"
            return TrafficEvent(time, direction, EventKind.ECHO, text, family, None, raw)
        request: Family | None = None
        if behind is not None and isinstance(behind.event, Packet) and behind.family is not None:
            request = behind.family if self._is_request(stream, behind.family, behind.event) else None
        # On a line of one wire 00 behind a request is where the direction changes.
        between = followed_request and family is not None and bool(family.framing.filler)
        if direction is Direction.UNKNOWN and request is None and not between:
            return None
        self._padded, self._padded_until = self._padded + len(raw), time + PATIENCE
        family = request or family
        if len(raw) == 1 and request is not None and not request.framing.filler:
            text = "probe: servos skip this byte, an echo brings it back"
            return TrafficEvent(time, direction, EventKind.PROBE, text, family, None, raw)
        text = f"padding: {len(raw)} byte{'s' * (len(raw) > 1)} between requests, which servos skip"
        return TrafficEvent(time, direction, EventKind.PADDING, text, family, None, raw)

    def _begun(self, stream: Stream, raw: bytes) -> OpenReply | None:
        """Find the question whose answer these bytes are the beginning of."""
        if stream.direction is Direction.OUT:
            return None
        return next((one for one in self._open if one.begins(raw)), None)

    def _cut(self, asked: OpenReply, stream: Stream, raw: bytes, first: Mark) -> TrafficEvent:
        asked.spoiled = True
        id = asked.id
        self._counts(asked.family, id).corrupt += 1
        self.cut_short += 1
        text = f"CUT SHORT: the answer of {servo(id)} begins so, and a byte or more of it is lost"
        return TrafficEvent(
            first.time, stream.direction, EventKind.CORRUPT, text, asked.family, id, raw, None, Trouble.CUT
        )

    def _is_request(self, stream: Stream, family: Family, packet: Packet) -> bool:
        """Tell a request from an answer; where the sender is not known, by what was asked before."""
        if stream.direction is not Direction.UNKNOWN:
            return stream.direction is Direction.OUT
        request = family.replies_to(packet) is not None
        asked = self._answered_by(family, packet)
        if asked is not None and not (packet.data and packet == asked.packet):
            # Whatever may be asked next fits where any servo may answer: there a request is one.
            return asked.to_several and request
        return request

    def _answered_by(self, family: Family, packet: Packet) -> OpenReply | None:
        return next((one for one in self._open if one.fits(family, packet)), None)

    def _request(
        self, stream: Stream, family: Family, packet: Packet, raw: bytes, first: Mark, last: Mark, end: float
    ) -> Iterator[TrafficEvent]:
        for one in list(self._open):
            # A program that asks on has stopped waiting, unless the line is full duplex and the request is to another.
            if not (family is one.family and family.full_duplex and one.packet.id != packet.id):
                answers = self._streams.get(Direction.IN)
                if answers is not None and one.begins(answers.begun):
                    yield from self._sort(answers, answers.flush())  # the rest of it will not come any more
                yield from self._time_out(one, first.time)
        replies = family.replies_to(packet)
        if replies is None:
            data = f", data {show_bytes(packet.data)}" if packet.data else ""
            text = f"unknown request {packet.code:#04x} {addressed(packet.id)}{data}"
            replies = (ReplyPattern(packet.id, None, (0,), certain=False),)  # it may be refused
        else:
            text = self._tables.explain(family, packet)
        self._perhaps_echoed = None
        self._counts(family, packet.id).requests += 1
        self._sent.append((packet, end + PATIENCE))
        size = 0
        for reply in replies:
            id = packet.id if reply.id is None else reply.id
            obeys = packet.id != BROADCAST and (family.name, id) in self._answers_commands
            expected = reply.certain or obeys
            size += family.framing.overhead + max(reply.sizes)
            deadline = end + PATIENCE + self._wire_time(size)
            self._open.append(OpenReply(family, packet, reply, text, end, last.time, expected, deadline))
        yield TrafficEvent(first.time, stream.direction, EventKind.REQUEST, text, family, packet.id, raw)

    def _answer(self, stream: Stream, family: Family, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        time = first.time
        asked = self._answered_by(family, packet)
        if stream.direction is Direction.IN and self._is_echo(packet, asked, time):
            text = "echo of the request"
            return TrafficEvent(time, stream.direction, EventKind.ECHO, text, family, packet.id, raw)
        counts = self._counts(family, packet.id)
        if asked is not None:
            self._close(asked, time)
            if self._echo is None:
                if packet == asked.packet:
                    self._perhaps_echoed = asked
                else:
                    self._echo = False
            counts.answers += 1
            if not asked.reply.certain and asked.packet.id != BROADCAST:
                self._answers_commands.add((family.name, packet.id))
            return self._answer_to(asked, stream, packet, raw, first)
        if self._perhaps_echoed is not None and self._perhaps_echoed.fits(family, packet):
            asked, self._perhaps_echoed, self._echo = self._perhaps_echoed, None, True
            return self._answer_to(asked, stream, packet, raw, first)
        trouble, text = self._misplaced(family, packet, time)
        counts.other += 1
        return TrafficEvent(time, stream.direction, EventKind.ANSWER, text, family, packet.id, raw, None, trouble)

    def _close(self, asked: OpenReply, time: float) -> None:
        """Count a question as answered. One that several servos may answer stays open for the others."""
        if not asked.answered:
            self._counts(asked.family, asked.id).answered += 1
        asked.answered = True
        if asked.to_several:
            asked.deadline = max(asked.deadline, time + PATIENCE)
        else:
            self._open.remove(asked)

    def _answer_to(self, asked: OpenReply, stream: Stream, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        family = asked.family
        latency = None
        if first.time > asked.mark:  # of two that came in one piece the time between them is not known
            latency = max(first.time - asked.end, 0.0)
            self._counts(family, packet.id).latencies[round(latency / GRAIN)] += 1
        text = self._tables.answer(family, packet, asked.packet)
        return TrafficEvent(first.time, stream.direction, EventKind.ANSWER, text, family, packet.id, raw, latency)

    def _is_echo(self, packet: Packet, asked: OpenReply | None, time: float) -> bool:
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
            said = self._tables.answer(family, packet, late.packet)
            return Trouble.LATE, f"LATE, {1000 * (time - late.end):.0f} ms behind its question: {said}"
        said = self._tables.explain(family, packet)
        if family.replies_to(packet) is not None:  # read as a request, it would say what it cannot mean here
            data = f", data {show_bytes(packet.data)}" if packet.data else ""
            said = f"answer of {servo(packet.id)}, {packet.code:#04x}{data}"
        open = [one for one in self._open if one.family is family]
        asked = next((one for one in open if one.id == packet.id), open[0] if open else None)
        if asked is None:
            return Trouble.UNASKED, f"{UNASKED}{said}"
        if asked.id != packet.id:
            return Trouble.STRANGER, f"STRANGER, id {asked.id} was asked: {said}"
        self._open.remove(asked)
        self._counts(family, packet.id).failed += 1
        return Trouble.MISFIT, f"DOES NOT FIT the question: {said}"

    def _corrupt(self, stream: Stream, family: Family, packet: Packet, raw: bytes, first: Mark) -> TrafficEvent:
        asked = None
        if stream.direction is not Direction.OUT:
            open = [one for one in self._open if one.family is family]
            asked = next((one for one in open if one.id == packet.id), open[0] if open else None)
        if asked is not None:
            asked.spoiled = True
        # Its id may be what is wrong: it counts for a servo that was asked, or is known.
        id = asked.id if asked else packet.id
        if asked is not None or (family.name, id) in self._servos:
            self._counts(family, id).corrupt += 1
        self.corrupt += 1
        said = self._tables.explain(family, packet, asked.packet if asked else None)
        text = f"CHECKSUM WRONG: would be {said}"
        return TrafficEvent(
            first.time, stream.direction, EventKind.CORRUPT, text, family, id, raw, None, Trouble.CHECKSUM
        )

    def _time_out(self, asked: OpenReply, time: float) -> Iterator[TrafficEvent]:
        """End the wait for an answer."""
        self._open.remove(asked)
        self._overdue.append(asked)
        counts = self._counts(asked.family, asked.id)
        if asked.answered:
            return
        if asked.spoiled:
            counts.failed += 1
        elif asked.expected:
            counts.failed += 1
            counts.missing += 1
            # Perhaps it was told to answer commands no longer: it is not expected to until it does again.
            self._answers_commands.discard((asked.family.name, asked.id))
            id = asked.id
            whose = "" if asked.packet.id == id else f" of {servo(id)}"
            text = f"NO ANSWER{whose} to {asked.text}"
            yield TrafficEvent(time, Direction.IN, EventKind.SILENCE, text, asked.family, id, b"", None, Trouble.SILENT)

    def _counts(self, family: Family, id: int) -> ServoTraffic:
        key = family.name, id
        if key not in self._servos:
            self._servos[key] = ServoTraffic(family, id)
        return self._servos[key]
