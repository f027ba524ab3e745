"""The two register maps of a HerkuleX, EEP and RAM: how registers that stand in either or both are read and written."""

from collections.abc import Iterable, Sequence
from typing import Any

from servobus.core.exchange import Exchange, Pause, Procedure
from servobus.core.registers import Int, Location, Register
from servobus.errors import BusError
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.herkulex.protocol import (
    ACK_POLICY,
    MAX_DATA,
    TURNAROUND,
    eep_read,
    eep_write,
    ram_read,
    ram_write,
)
from servobus.families.reading import Reading, adjacent, blocks, place
from servobus.families.refusal import mute
from servobus.families.target import Answers, KnownServo, ServoRef


def reading(target: ServoRef, registers: Sequence[Register[Any]], spots: Sequence[Location]) -> Reading:
    """Tell what to ask for registers that stand at the spots given."""
    if target.answers is Answers.NOTHING:
        raise mute(target, "ACK Policy", "ack_policy=reads")
    exchanges: list[Exchange[bytes]] = []
    places: dict[Register[Any], tuple[int, slice, Int]] = {}
    for space, read in ((RAM, ram_read), (EEP, eep_read)):
        inside = [(row, address) for row, (home, address) in zip(registers, spots, strict=True) if home == space]
        # A second exchange costs 20 bytes, request and frame of the ACK: rather bridge a gap of that size.
        spans = blocks(((address, row.layout.size) for row, address in inside), gap=20, longest=MAX_DATA - 4)
        for row, address in inside:
            n, part, layout = place(spans, address, row.layout)
            places[row] = len(exchanges) + n, part, layout
        exchanges += [read(target.id, *span) for span in spans]
    return Reading(tuple(exchanges), tuple(places[row] for row in registers))


def write(target: ServoRef, parts: Iterable[tuple[Location, bytes]]) -> Procedure[None]:
    """Write to EEP, then to RAM from the top down.

    So ID and ACK Policy, RAM 0 and 1, come last: what followed them would have to go by the new ones.
    """
    maps: dict[str, dict[int, bytes]] = {EEP: {}, RAM: {}}
    for (space, address), data in parts:
        maps[space][address] = data
    for address, data in adjacent(maps[EEP]):
        yield from eep_write(target.id, address, data, answered=target.answers_writes)
        yield from target.model.family.await_eeprom(target, len(data))
    for address, data in reversed(adjacent(maps[RAM])):
        new_policy = address <= ACK_POLICY < address + len(data)
        yield from ram_write(target.id, address, data, answered=target.answers_writes and not new_policy)
        if new_policy:
            # Whether the old or the new policy rules the ACK is an assumption (H-30): let one pass unheard.
            yield Pause(2 * TURNAROUND)


def keep(target: KnownServo, row: Register[Any], raw: int) -> Procedure[None]:
    """Write one register to EEP and nowhere else, until it is there. Raises BusError if it does not get there."""
    part = row.place.locations[-1], row.layout.pack(raw)
    if target.answers is Answers.NOTHING:  # then nothing can be made sure of
        yield from write(target, [part])
        return
    for _ in range(2):
        (kept,) = yield from target.model.family.read_stored(target, [row])
        if kept == raw:
            return
        target.record.check_wear(str(target), [row])
        target.record.wrote([row])
        yield from write(target, [part])
    (kept,) = yield from target.model.family.read_stored(target, [row])
    if kept != raw:
        raise BusError(f"{target} did not keep {row.name} = {raw}: it is {kept}")
