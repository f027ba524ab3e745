"""Registers and their values as JSON and as sentences, for the command line, web pages and recordings alike.

Functions that end in `entry` give what becomes a JSON object, those that end in `text` what people read. Nothing is
printed here.
"""

from collections.abc import Callable
from typing import Any

from servobus.core.registers import Access, Register
from servobus.core.units import Choice, Flags, Measure, Quantity, Switch, Thermistor, shown

ACCESS = {Access.READ: "read", Access.READ_WRITE: "read, write", Access.RESERVED: "reserved"}


# Values


def json_value(register: Register[Any], raw: int) -> Any:
    """Give a value for JSON, in the unit people use; the raw integer where it is a code without a known meaning.

    None for a raw integer that the register cannot hold.
    """
    return _shown_as(decoded_json, register, raw)


def decoded_json(register: Register[Any], value: Any) -> Any:
    """Give a value that was read for JSON, in the unit people use."""
    scale = register.scale
    if isinstance(scale, Measure):
        return shown(value, scale.unit)[0]
    if isinstance(scale, Choice | Flags):
        return scale.show(value)
    return value


def si_value(register: Register[Any], raw: int) -> Any:
    """Give a value for programs, in SI units; else as `json_value`, but a set of flags as a list of names."""
    return _shown_as(decoded_si, register, raw)


def decoded_si(register: Register[Any], value: Any) -> Any:
    """Give a value that was read for programs; see `si_value`."""
    scale = register.scale
    if isinstance(scale, Flags):
        return scale.show(value).split("+") if value else []
    return scale.show(value) if isinstance(scale, Choice) else value


def _shown_as(show: Callable[[Register[Any], Any], Any], register: Register[Any], raw: int) -> Any:
    try:
        value = register.decode(raw)
    except ValueError:
        return raw if register.holds(raw) else None
    return show(register, value)


def si_entry(register: Register[Any], raw: int) -> dict[str, Any]:
    """Give one value in its SI unit, the raw integer, and the text for people."""
    return {
        "value": si_value(register, raw),
        "unit": register.unit,
        "raw": raw,
        "text": value_text(register, raw),
    }


def unit_text(register: Register[Any]) -> str:
    """Give the unit that goes with `json_value`; empty for switches, choices and plain numbers."""
    return shown(0.0, register.unit)[1] if register.unit else ""


def value_text(register: Register[Any], raw: int) -> str:
    """Write a raw integer as people read it."""
    return register.said(raw)


def value_entry(register: Register[Any], raw: int) -> dict[str, Any]:
    """Give one value with its unit, and the raw integer."""
    return {"value": json_value(register, raw), "unit": unit_text(register), "raw": raw}


def change_entry(register: Register[Any], old: int | None, new: int) -> dict[str, Any]:
    """Give what a value was, None if that is not known, and what it is now; both raw here."""
    return {
        "old": None if old is None else json_value(register, old),
        "new": json_value(register, new),
        "unit": unit_text(register),
    }


# Rows of a register table


def register_entry(row: Register[Any]) -> dict[str, Any]:
    """Give one row of a table: limits and default in the unit people use, and raw."""
    low, high = row.limits
    return {
        "name": row.name,
        "aliases": list(row.aliases),
        **row.place.json(),
        "size": row.layout.size,
        "access": row.access.value,
        "area": row.area.value,
        "limits": [json_value(row, low), json_value(row, high)] if row.writable else None,
        "allowed": [json_value(row, raw) for raw in row.allowed] if row.allowed else None,
        "default": None if row.default is None else json_value(row, row.default),
        "unit": unit_text(row),
        "meaning": row.meaning,
        "note": row.note,
        "raw": {
            "limits": [low, high] if row.writable else None,
            "allowed": list(row.allowed) if row.allowed else None,
            "default": None if row.default is None else int(row.default),
        },
    }


def si_register_entry(row: Register[Any]) -> dict[str, Any]:
    """Give one row of a table for programs: as `register_entry`, in SI units, with what its values are called."""
    low, high = row.limits
    kind, names = _kind(row)
    return {
        **register_entry(row),
        "kind": kind,
        "names": names,
        "limits": [si_value(row, low), si_value(row, high)] if row.writable else None,
        "allowed": [si_value(row, raw) for raw in row.allowed] if row.allowed else None,
        "default": None if row.default is None else si_value(row, row.default),
        "default_text": None if row.default is None else value_text(row, row.default),
        "unit": row.unit,
        "latched": row.latched,
        "volatile": row.volatile,
        "moves": row.motion is not None,
    }


def _kind(row: Register[Any]) -> tuple[str, list[str]]:
    """Say what kind of values a row has, and give the names of those that have names."""
    scale = row.scale
    if isinstance(scale, Choice):
        return "choice", [scale.show(option) for option in scale.options]
    if isinstance(scale, Flags):
        return "flags", [scale.show(flag) for flag in scale.used]
    if isinstance(scale, Switch):
        return "switch", []
    return "quantity" if isinstance(scale, Measure) else "number", []


def title_text(row: Register[Any]) -> str:
    """Write the name of a row, its aliases in parentheses."""
    return f"{row.name} ({', '.join(row.aliases)})" if row.aliases else row.name


def place_text(row: Register[Any]) -> str:
    """Say where a row is, how long it is and what may be done with it: "RAM 36, 2 bytes, read"."""
    size = "1 byte" if row.layout.size == 1 else f"{row.layout.size} bytes"
    return f"{row.place.text(row.area)}, {size}, {ACCESS[row.access]}"


def writable_text(row: Register[Any]) -> str:
    """Say what can be written, as it is typed, and the factory setting; empty for what can only be read."""
    if not row.writable:
        return ""
    factory = "" if row.default is None else f"; factory setting {value_text(row, row.default)}"
    return _choices_text(row) + factory


def unit_step_text(row: Register[Any]) -> str:
    """Say what one raw unit is worth, and which raw value is 0 where that is not 0; empty where it has no unit."""
    if isinstance(row.scale, Thermistor):
        return f"not linear, raw {row.scale.full // 2} is 25 °C"
    if not isinstance(row.scale, Quantity):
        return ""
    value, symbol = shown(row.scale.step, row.unit)
    zero = f", 0 is raw {row.scale.zero}" if row.scale.zero else ""
    return f"{value:.4g}{'' if symbol.startswith('°') else ' '}{symbol}".strip() + zero


def aspects(row: Register[Any]) -> dict[str, str]:
    """Say of a row what can differ between two models: where it is, what one unit is, what it holds."""
    layout = row.layout
    sign = (
        f"sign in bit {layout.sign_bit}" if layout.sign_bit is not None else "signed" if layout.signed else "unsigned"
    )
    return {
        "where": place_text(row),
        "layout": sign,
        "unit": unit_step_text(row) or row.unit,
        "may be written": _choices_text(row) if row.writable else "",
        "factory setting": "" if row.default is None else value_text(row, row.default),
    }


def _choices_text(row: Register[Any]) -> str:
    scale = row.scale
    if isinstance(scale, Switch):
        return "on or off"
    if isinstance(scale, Flags):
        return "any of " + ", ".join(scale.show(flag) for flag in scale.used) + ", joined by +"
    if row.allowed is not None:
        return ", ".join(value_text(row, raw) for raw in row.allowed)
    low, high = row.limits
    if isinstance(scale, Choice):
        return ", ".join(scale.show(option) for option in scale.options if low <= option <= high)
    return " .. ".join(value_text(row, raw) for raw in (low, high))
