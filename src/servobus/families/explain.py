"""Packets in words: who is spoken to, which registers the bytes at an address are, and what they say."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any

from servobus.core.ids import BROADCAST
from servobus.core.registers import Register
from servobus.families.model import Model


def servo(id: int) -> str:
    """Name a servo, or all of them."""
    return "all" if id == BROADCAST else f"id {id}"


def addressed(id: int) -> str:
    """Say whom a command is for, behind its name: PING id 1, PING to all."""
    return "to all" if id == BROADCAST else servo(id)


def id_list(ids: Iterable[int]) -> str:
    """Name several servos: id 1; ids 1, 2."""
    listed = [str(id) for id in ids]
    return f"id{'s' * (len(listed) > 1)} {', '.join(listed)}"


def junk_text(raw: bytes) -> str:
    """Say how much it is that is no packet."""
    return f"JUNK: {len(raw)} bytes that are no packet" if len(raw) > 1 else "JUNK: a byte that is no packet"


def show_bytes(data: bytes) -> str:
    return data.hex(" ").upper()


def show_value(register: Register[Any], raw: int) -> str:
    """Write a register's name and value as people read them; the raw integer where it has no meaning."""
    return f"{register.name} {register.said(raw)}"


def show_span(model: type[Model] | None, space: str, address: int, length: int) -> str:
    """Say what a read asks for: 2 bytes from address 36, present_position."""
    span = f"{length} byte{'' if length == 1 else 's'} from address {address}"
    return ", ".join([span, *(row.name for _, _, row in pieces(model, space, address, length) if row is not None)])


def show_values(model: type[Model] | None, space: str, address: int, data: bytes) -> str:
    """Say what stands in bytes: goal_position 150.1°, moving_speed 341.0°/s; the bytes where nothing is known."""
    said = []
    for start, size, row in pieces(model, space, address, len(data)):
        part = data[start - address : start - address + size]
        raw = f"address {start}: {show_bytes(part)}"
        said.append(raw if row is None else show_value(row, row.layout.unpack(part)))
        if row is not None and (flags := row.layout.flags_in(part)):
            said[-1] += f" (flag bits {flags:#06x})"
    return ", ".join(said) or f"nothing at address {address}"


def pieces(
    model: type[Model] | None, space: str, address: int, length: int
) -> Iterator[tuple[int, int, Register[Any] | None]]:
    """Cut the bytes from `address` on into registers: (address, size, register).

    The register is None for bytes that are none, or not the whole of one. `space` is the map that the addresses are in,
    as `Place.locations` names it.
    """
    rows = _by_offset(model, space) if model else {}  # type: ignore[arg-type] # a class has a hash
    at, end = address, address + length
    unknown = at
    while at < end:
        row = rows.get(at)
        if row is None or at + row.layout.size > end:
            at += 1
            continue
        if unknown < at:
            yield unknown, at - unknown, None
        yield at, row.layout.size, row
        at += row.layout.size
        unknown = at
    if unknown < end:
        yield unknown, end - unknown, None


@lru_cache(maxsize=256)
def _by_offset(model: type[Model], space: str) -> dict[int | None, Register[Any]]:
    """Give the registers of a map by their first byte, and at None one that stands elsewhere."""
    return {row.place.within(space): row for row in model.registers.values()}
