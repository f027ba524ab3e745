"""The wire between a client and virtual servos of one family, counted in bit times.

A line has no clock of its own. The client says what it sends and when; `run(now)` lets everything up to
now happen, in the order of time: bytes travel, servos hear packets, replies start after their delay and
collide with what else is on the wire. How finely time is cut makes no difference to any byte.

    half duplex (Dynamixel, LewanSoul)  one wire: each hears all others
    full duplex (HerkuleX)              servos hear only the client, the client hears only servos

Two deliberate limits. A servo takes no other servo's reply for a request, even with its own id: firmware
that did would keep two servos of one id answering each other's answers for ever, which is reported nowhere
(assumption). And a client whose adapter gives no echo hears nothing while it sends, as its receiver is off.
"""

import bisect
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TypeAlias

from servobus.core.framing import BITS_PER_BYTE, Corrupt, Decoder, Framing, Noise, Packet
from servobus.core.ids import BROADCAST
from servobus.errors import UsageError
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.shaft import Rail
from servobus.virtual.wire.adapter import WHOLE, Adapter, Handover
from servobus.virtual.wire.faults import Faults, Injected
from servobus.virtual.wire.injector import Injector
from servobus.virtual.wire.uart import EPSILON, ReceivedBytes, Receiver, Transmission

KEPT = 0.02
"""s that bytes are kept after their end for receivers too slow to be through with them."""


class VirtualLine:
    """Servos of one family on one wire.

    `echo` tells whether the client hears what it sends. `client_baud` is its speed in bit/s; None means
    that it has none (TCP), is always understood and understands everything. `supply` is one that all servos share;
    without it each has its own, which nothing pulls down. `adapter` says in which pieces the client gets what it
    receives.
    """

    def __init__(
        self,
        servos: Iterable[VirtualServo],
        *,
        echo: bool = False,
        supply: Rail | None = None,
        adapter: Adapter = WHOLE,
    ) -> None:
        self.servos = list(servos)
        if not self.servos:
            raise UsageError("a line needs at least one servo")
        families = {type(servo.model.family): servo.model.family for servo in self.servos}
        if len(families) > 1:
            titles = " and ".join(family.title for family in families.values())
            raise UsageError(f"one line carries one family, not {titles}")
        self.family = self.servos[0].model.family
        self.echo = echo
        self.adapter = adapter
        self.supply = supply
        if supply is not None:
            for servo in self.servos:
                servo.shaft.join(supply)
        self.now = max(servo.time for servo in self.servos)
        self._to_servos: list[Transmission] = []
        self._to_client: list[Transmission] = []
        self._client = Receiver(None, self.now)
        self._handover = Handover(adapter, self._to_client, self.now)
        self._client_busy_until = self.now
        self._busy: dict[VirtualServo, float] = {}
        """Servo -> time at which it has sent its last reply."""
        self._arrived: list[ReceivedBytes] = []
        self._groups: dict[tuple[float, float], _Group] = {}
        self._group_of: dict[VirtualServo, _Group] = {}
        self._injector: Injector | None = None
        self.regroup()

    @property
    def client_baud(self) -> float | None:
        return self._client.baud

    @client_baud.setter
    def client_baud(self, baud: float | None) -> None:
        self._client.baud = baud

    # The client's side

    def send(self, data: bytes, now: float) -> None:
        """Let the client begin to send, behind what it is still sending."""
        self.run(now)
        if not data:
            return
        if self._settings() != self._placed:
            self.regroup()
        baud = self.client_baud or self.servos[0].baud
        start = max(now, self._client_busy_until)
        wave = Transmission(start, baud, bytes(data), None, plain=self.client_baud is None)
        self._client_busy_until = wave.end
        heard, echoed = [wave], [wave] if self.echo else []
        if self._injector:
            heard, echoed = self._injector.send(wave, echo=self.echo)
        for part in heard:
            self._carry(part)
        if echoed:
            _put(self._to_client, echoed[0])
        elif not self.family.full_duplex:
            self._client.since = max(self._client.since, wave.end)

    def receive(self, now: float) -> bytes:
        """Give what the client has received whole by now and not been given yet."""
        return b"".join(run.data for run in self.arrivals(now))

    def arrivals(self, now: float) -> list[ReceivedBytes]:
        """Give the same with its times."""
        self.run(now)
        arrived, self._arrived = self._arrived, []
        return arrived

    def next_event(self) -> float | None:
        """Give the time of the next thing that happens by itself; None if all is quiet."""
        times = [time] if (time := self._due()[0]) < math.inf else []
        if self._arrived:
            times.append(self.now)
        elif (handed := self._handover.next_event(self._client.next_run(self._to_client))) is not None:
            times.append(handed)
        if self._injector and (fault := self._injector.next_event(self.now)) is not None:
            times.append(fault)
        return min(times, default=None)

    # What goes wrong

    def inject(self, faults: Faults, now: float) -> None:
        """Let these faults happen from now on, instead of any others; what they hold back is lost."""
        self.run(now)
        if self._injector:
            self._injector.heal(now)
        self._injector = None
        handover = Handover(faults.adapter or self.adapter, self._to_client, now)
        handover.follow(self._handover)
        self._handover = handover
        if faults:
            self._injector = Injector(
                faults,
                self.family.framing,
                self.family.name,
                self.servos,
                handover,
                plug=self.plug,
                unplug=self.unplug,
                now=now,
            )
        self.regroup()

    @property
    def injected(self) -> Sequence[Injected]:
        """The latest faults that have happened since the last call of `inject`."""
        return self._injector.log if self._injector else ()

    @property
    def fault_counts(self) -> Counter[str]:
        """Kind of fault -> how often it has happened since the last call of `inject`."""
        return self._injector.counts if self._injector else Counter()

    @property
    def handing_over(self) -> float:
        """How much later than its last bit a reply may reach the client, s, as its adapter is."""
        return self._handover.adapter.delay(self.client_baud)

    def gone(self, now: float) -> bool:
        """Tell whether the client's port is gone."""
        return self._injector is not None and self._injector.gone(now)

    def unplug(self, servos: Iterable[VirtualServo], now: float) -> None:
        """Take the supply from servos. What they were going to say stays unsaid."""
        self._live(now)
        for servo in servos:
            servo.advance(now)
            servo.power_off()
            for waves in (self._to_servos, self._to_client):
                waves[:] = [wave for wave in waves if wave.sender is not servo or wave.start < now]
        for group in self._groups.values():
            group.next = None

    def plug(self, servos: Iterable[VirtualServo], now: float) -> None:
        """Give servos their supply again."""
        self._live(now)
        for servo in servos:
            servo.restart(now)
            self._busy.pop(servo, None)
            self._place(servo)

    # Time

    def run(self, now: float) -> None:
        """Let everything up to now happen."""
        while True:
            time, group, run = self._due()
            if self._injector and self._injector.change(min(time - EPSILON, now)):
                continue
            if time > now + EPSILON:
                break
            self._live(time)
            if run is None:
                self._drop(group, time)
            else:
                self._hear(group, run)
        while self._to_client and (run := self._client.next_run(self._to_client, until=now)):
            self._client.since = run.resume
            self._handover.take(run)
        self._arrived += self._handover.due(now)
        self._live(now)
        if self._to_servos:
            _forget(self._to_servos, min(group.receiver.since for group in self._groups.values()), now)
        if self._to_client:
            _forget(self._to_client, self._client.since, now)

    def _live(self, now: float) -> None:
        """Let time pass. Servos that pull at one supply live in step; others catch up when they are looked at."""
        if self.supply is not None and self.supply.resistance:
            step = min(servo.tick for servo in self.servos)
            for n in range(1, math.ceil((now - self.now) / step)):
                for servo in self.servos:
                    servo.advance(self.now + n * step)
            for servo in self.servos:
                servo.advance(now)
        self.now = max(self.now, now)

    def regroup(self) -> None:
        """Sort the servos anew, after their id or speed was changed other than by packets."""
        for servo in self.servos:
            self._place(servo)
        self._placed = self._settings()

    def _settings(self) -> list[tuple[int, float, float]]:
        return [(servo.id, servo.baud, servo.garbage_timeout) for servo in self.servos]

    def _due(self) -> "_Due":
        """Give the next event of all groups, and when; see `_Group.look`."""
        first: _Due | None = None
        for group in self._groups.values():
            event = group.next or group.look(self._to_servos)
            if first is None or event[0] < first[0]:
                first = event
        assert first is not None, "a line has servos, and so a group"
        return first

    # The servos' side

    def _hear(self, group: "_Group", run: ReceivedBytes) -> None:
        group.receiver.since = run.resume
        group.last, group.next = run.end, None
        events = group.decoder.feed(run.data)
        if run.from_servo:
            group.servo_bytes_end = group.decoder.position
        for event in events:
            if not isinstance(event, Noise):
                self._dispatch(group, event, run.end)

    def _dispatch(self, group: "_Group", event: Packet | Corrupt, time: float) -> None:
        packet = event.packet if isinstance(event, Corrupt) else event
        size = self.family.framing.overhead + len(packet.data)
        if packet.end - size < group.servo_bytes_end:
            if isinstance(event, Packet):
                self._overhear(group, event, time)
            return
        begin = time - size * BITS_PER_BYTE / group.baud
        for servo in group.called(packet.id):
            if not servo.powered or servo.deaf_until > begin:
                continue
            baud = self._speed(servo)  # a new speed acts after the reply
            servo.advance(time)
            for delay, data in servo.answer(event, time):
                self._reply(servo, baud, time + delay, data)
            self._place(servo)

    def _overhear(self, group: "_Group", packet: Packet, time: float) -> None:
        """Tell servos of a reply that wait for their turn to answer the same request."""
        for servo in list(group.ids):
            if servo.awaits_turn and servo.powered and servo.id != packet.id:
                servo.advance(time)
                for delay, data in servo.in_its_time(servo.overhear(packet, time)):
                    self._reply(servo, self._speed(servo), time + delay, data)

    def _reply(self, servo: VirtualServo, baud: float, time: float, data: bytes) -> None:
        wave = Transmission(max(time, self._busy.get(servo, time)), baud, data, servo)
        self._busy[servo] = wave.end
        for part in self._injector.reply(wave) if self._injector else (wave,):
            _put(self._to_client, part)
        if not self.family.full_duplex:
            self._carry(wave)

    def _carry(self, wave: Transmission) -> None:
        """Put onto the wire what servos hear."""
        _put(self._to_servos, wave)
        for group in self._groups.values():
            if group.next is not None and wave.start < group.next[0]:
                group.next = None

    def _drop(self, group: "_Group", time: float) -> None:
        group.decoder.drop()
        group.next = None
        for servo in group.called(BROADCAST):
            if servo.powered and servo.deaf_until <= time:
                servo.advance(time)
                servo.garbage(time)
                self._place(servo)

    def _speed(self, servo: VirtualServo) -> float:
        """Give a servo's speed as its own clock makes it, bit/s."""
        return servo.baud * self._injector.skew(servo) if self._injector else servo.baud

    def _place(self, servo: VirtualServo) -> None:
        """Put a servo into the group that listens as it does."""
        key = (self._speed(servo), servo.garbage_timeout)
        old = self._group_of.get(servo)
        if old is not None and old.key == key:
            old.rename(servo)
            return
        if old is not None:
            old.remove(servo)
            if not old.ids:  # no servo is left that listens like this
                del self._groups[old.key]
        if key not in self._groups:
            self._groups[key] = _Group(key, self.family.framing, self.now)
        self._group_of[servo] = self._groups[key]
        self._groups[key].add(servo)


class _Group:
    """Servos that hear the same: one speed, one longest pause, and so one decoder for all of them."""

    def __init__(self, key: tuple[float, float], framing: Framing, now: float) -> None:
        self.key = key
        self.baud, self._timeout = key
        self.decoder = Decoder(framing)
        self.receiver = Receiver(self.baud, now)
        self.last = now
        """Time at which the last byte was received."""
        self.servo_bytes_end = 0
        """Position in the decoder's stream behind the last byte that a servo sent."""
        self.next: _Due | None = None
        """What `look` gave, as long as that holds."""
        self.ids: dict[VirtualServo, int] = {}
        self._by_id: dict[int, list[VirtualServo]] = {}

    def look(self, waves: Sequence[Transmission]) -> "_Due":
        """Give the next thing that happens here, and when: a run of bytes, a packet given up (None), nothing (inf).

        A pause longer than the longest ends an incomplete packet. What is given holds until a wave is added that starts
        before, or until it has happened.
        """
        run = self.receiver.next_run(waves, self.decoder.missing)
        gives_up = self.last + self._timeout + 2 * EPSILON if self.decoder.pending else math.inf
        if run is None or gives_up < run.start - EPSILON:
            self.next = gives_up, self, None
        else:
            self.next = run.end, self, run
        return self.next

    def called(self, id: int) -> list[VirtualServo]:
        """Give the servos that listen to an id."""
        return list(self.ids) if id == BROADCAST else list(self._by_id.get(id, ()))

    def add(self, servo: VirtualServo) -> None:
        self.ids[servo] = servo.id
        self._by_id.setdefault(servo.id, []).append(servo)

    def remove(self, servo: VirtualServo) -> None:
        self._by_id[self.ids.pop(servo)].remove(servo)

    def rename(self, servo: VirtualServo) -> None:
        if self.ids[servo] != servo.id:
            self.remove(servo)
            self.add(servo)


def _put(waves: list[Transmission], wave: Transmission) -> None:
    bisect.insort(waves, wave, key=_start_of)


def _forget(waves: list[Transmission], done: float, now: float) -> None:
    """Drop what every receiver is through with."""
    waves[:] = [wave for wave in waves if wave.end > done + EPSILON and wave.end > now - KEPT]


def _start_of(wave: Transmission) -> float:
    return wave.start


_Due: TypeAlias = tuple[float, _Group, ReceivedBytes | None]
