"""Messages between the process that owns the ports and its clients: values here, lines of JSON on the way.

    @message("beat")
    @frozen
    class Beat:
        time: float

goes as `{"k":"beat","time":12.5}`. The annotations of a class say what its fields may hold, and a line that says
anything else is refused as a whole: an unknown kind, a missing or unknown field, a value of another type. These are the
types:

    str, bool, int, float       as in JSON; a whole number will do for a float, and NaN and infinity never
    bytes                       two hexadecimal digits for each byte
    tuple[T, ...], tuple[A, B]  arrays
    a class of messages         an object with its kind in "k"
    another frozen class        an array of its fields, in their order
    A | B | None                one of them; None is null

A field that has a default may be left out, and is left out where it has it.
"""

import json
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType, NoneType, UnionType
from typing import Any, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

VERSION = 1
"""Version of the protocol. Both sides speak the same one, or do not talk."""
LONGEST = 1 << 20
"""Bytes of the longest line."""
KINDS: dict[str, type] = {}
"""kind -> class of messages. A room that adds messages of its own adds them here by `message`."""

NOTHING: Mapping[str, Any] = MappingProxyType({})
Coder: TypeAlias = Callable[[Any], Any]


class Malformed(ValueError):
    """What came is no message; the text says why."""


def message(kind: str) -> Callable[[type[T]], type[T]]:
    """Decorator for a class of frozen values: make it a class of messages of this kind."""

    def add(cls: type[T]) -> type[T]:
        if kind in KINDS:
            raise ValueError(f"there are messages of kind {kind!r} already")
        KINDS[kind] = cls
        type.__setattr__(cls, "kind", kind)
        return cls

    return add


def encode(value: Any) -> bytes:
    """Give the line of a message, with its end."""
    return text(value).encode() + b"\n"


def text(value: Any) -> str:
    """Give a message as JSON, to be put into a line."""
    return json.dumps(_shape(type(value)).encode(value), separators=(",", ":"), allow_nan=False)


def decode(line: bytes | str, **known: Any) -> Any:
    """Give the message of a line. Raises Malformed. Fields that are `known` already are not in the line."""
    try:
        found = json.loads(line, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise Malformed(f"no JSON: {error}") from None
    return from_json(found, **known)


def from_json(found: Any, **known: Any) -> Any:
    """Give the message that an object of JSON is, with the fields that are `known` already. Raises Malformed."""
    kind = found.get("k") if isinstance(found, dict) else None
    if not isinstance(kind, str):
        raise Malformed(f"no object with a kind in k: {_said(found)}")
    cls = KINDS.get(kind)
    if cls is None:
        raise Malformed(f"unknown kind {_said(kind)}")
    return _shape(cls).decode(found, known)


def _no_number(constant: str) -> Any:
    raise Malformed(f"{constant} is no number")


def _said(thing: Any) -> str:
    return f"{thing!r:.60}"


# From values to what JSON has, and back: made once for each class, when the first of its values goes or comes


class _Shape:
    """How the values of one frozen class go and come."""

    def __init__(self, cls: type) -> None:
        self._cls = cls
        self._kind: str | None = getattr(cls, "kind", None)
        self._fields: tuple[str, ...] = cls.__match_args__  # type: ignore[attr-defined] # a frozen class has it
        defaults = cls.__init__.__defaults__ or ()  # type: ignore[misc] # it is a plain function
        self._defaults = dict(zip(self._fields[len(self._fields) - len(defaults) :], defaults, strict=True))
        hints = get_type_hints(cls)
        self._coders = {name: _coders(hints[name]) for name in self._fields}
        self._needed = {name for name in self._fields if name not in self._defaults}

    def encode(self, value: Any) -> Any:
        if self._kind is None:
            return [to(getattr(value, name)) for name, (to, _) in self._coders.items()]
        given: dict[str, Any] = {"k": self._kind}
        for name, (to, _) in self._coders.items():
            item = getattr(value, name)
            if name in self._needed or item != self._defaults[name]:
                given[name] = to(item)
        return given

    def decode(self, found: Any, known: Mapping[str, Any] = NOTHING) -> Any:
        if self._kind is None:
            return self._from_list(found)
        if not isinstance(found, dict) or found.get("k") != self._kind:
            raise Malformed(f"no {self._kind}: {_said(found)}")
        if found.keys() - {"k"} != self._coders.keys():
            if unknown := found.keys() - self._coders.keys() - {"k"}:
                raise Malformed(f"{self._kind}: unknown field {_said(min(unknown))}")
            if missing := self._needed - found.keys() - known.keys():
                raise Malformed(f"{self._kind}: {min(missing)} is missing")
        if twice := found.keys() & known.keys():
            raise Malformed(f"{self._kind}: {min(twice)} is there twice")
        values = {**self._defaults, **known}
        for name, (_, back) in self._coders.items():
            if name in found:
                try:
                    values[name] = back(found[name])
                except Malformed as error:
                    raise Malformed(f"{self._kind}.{name}: {error}") from None
        return self._cls(**values)

    def _from_list(self, found: Any) -> Any:
        if not isinstance(found, list) or len(found) != len(self._fields):
            raise Malformed(f"no array of {', '.join(self._fields)}: {_said(found)}")
        return self._cls(*(back(item) for (_, back), item in zip(self._coders.values(), found, strict=True)))


_shapes: dict[type, _Shape] = {}


def _shape(cls: type) -> _Shape:
    shape = _shapes.get(cls)
    if shape is None:
        shape = _shapes[cls] = _Shape(cls)
    return shape


def _same(value: Any) -> Any:
    return value


def _coders(hint: Any) -> tuple[Coder, Coder]:
    """Give what takes a value of this type to JSON, and what brings it back or raises Malformed."""
    origin = get_origin(hint)
    if hint is NoneType:
        return _same, _null
    if hint is bytes:
        return bytes.hex, _from_hex
    if hint is float:
        return float, _to_float
    if hint in (str, bool, int):
        return _same, _checked(hint)
    if origin in (Union, UnionType):
        return _union(get_args(hint))
    if origin is tuple:
        return _tuple(get_args(hint))
    # Not asked for now: classes may hold values of each other, and of themselves.
    return (lambda value: _shape(hint).encode(value)), (lambda found: _shape(hint).decode(found))


def _null(found: Any) -> None:
    if found is not None:
        raise Malformed(f"{_said(found)} is not null")


def _from_hex(found: Any) -> bytes:
    try:
        if isinstance(found, str) and " " not in found:
            return bytes.fromhex(found)
    except ValueError:
        pass
    raise Malformed(f"{_said(found)} is not made of hexadecimal digits")


def _to_float(found: Any) -> float:
    if type(found) is float or type(found) is int:
        try:
            if math.isfinite(number := float(found)):
                return number
        except OverflowError:
            pass
    raise Malformed(f"{_said(found)} is no number")


def _checked(kind: type) -> Coder:
    names = {str: "text", bool: "true or false", int: "whole number"}

    def back(found: Any) -> Any:
        if type(found) is not kind:
            raise Malformed(f"{_said(found)} is no {names[kind]}")
        if isinstance(found, str) and not found.isascii():
            try:
                found.encode()
            except UnicodeEncodeError:
                raise Malformed("a text with half a character") from None
        return found

    return back


def _tuple(kinds: tuple[Any, ...]) -> tuple[Coder, Coder]:
    if kinds[1:] == (...,):
        to, back = _coders(kinds[0])

        def all_back(found: Any) -> tuple[Any, ...]:
            return tuple(back(item) for item in _array(found))

        return (lambda values: [to(value) for value in values]), all_back
    both = [_coders(kind) for kind in kinds]

    def each_back(found: Any) -> tuple[Any, ...]:
        if len(_array(found)) != len(both):
            raise Malformed(f"{_said(found)} has not {len(both)} items")
        return tuple(back(item) for (_, back), item in zip(both, found, strict=True))

    return (lambda values: [to(value) for (to, _), value in zip(both, values, strict=True)]), each_back


def _array(found: Any) -> list[Any]:
    if not isinstance(found, list):
        raise Malformed(f"{_said(found)} is no array")
    return found


def _union(kinds: tuple[Any, ...]) -> tuple[Coder, Coder]:
    """Give the coders of a type that is one of several: messages, or anything that JSON tells from the others."""
    messages = {kind.kind: kind for kind in kinds if hasattr(kind, "kind")}
    others = [(get_origin(kind) or kind, _coders(kind)) for kind in kinds if not hasattr(kind, "kind")]

    def to(value: Any) -> Any:
        for kind, (other, _) in others:
            if isinstance(value, kind):
                return other(value)
        return _shape(type(value)).encode(value)

    def back(found: Any) -> Any:
        if isinstance(found, dict) and messages:
            kind = messages.get(str(found.get("k")))
            if kind is None:
                raise Malformed(f"none of {', '.join(messages)}: {_said(found)}")
            return _shape(kind).decode(found)
        why = ""
        for _, (_, other) in others:
            try:
                return other(found)
            except Malformed as error:
                why = str(error)
        raise Malformed(why or f"none of {', '.join(messages)}: {_said(found)}")

    return to, back
