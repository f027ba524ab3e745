"""Values: small classes whose objects never change, cheap to declare and to make.

    @frozen
    class Pause:
        seconds: float

`frozen` does what `dataclass(frozen=True, slots=True)` does, as far as this package needs it, and exists for
start-up time alone: a dataclass compiles seven functions, this one, and half a hundred such classes stand on the
way of `import servobus`. That objects are made in half the time helps as well: every packet is one.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def frozen(cls: type[T]) -> type[T]:
    """Make a class of annotated fields one of values: compared and hashed by their fields, not to be changed.

    It takes at least one field, those with a default last, and no default that can change. Fields of a base class
    do not count; methods that the class defines itself stay.
    """
    names = tuple(cls.__annotations__)
    own = {name: item for name, item in vars(cls).items() if name not in ("__dict__", "__weakref__", *names)}
    own["__slots__"] = own["__match_args__"] = names
    # Slots can only be given to a class while it is made, so it is made again.
    kind: Any = type(cls)
    made: type[T] = kind(cls.__name__, cls.__bases__, _methods(names) | own)
    init = _init(made, names)
    init.__defaults__ = tuple(vars(cls)[name] for name in names if name in vars(cls))
    type.__setattr__(made, "__init__", init)
    return made


def replace(old: T, **changes: Any) -> T:
    """Make a value like another but for some fields."""
    names: tuple[str, ...] = type(old).__match_args__  # type: ignore[attr-defined]
    return type(old)(**{name: getattr(old, name) for name in names} | changes)


def _init(made: type, names: tuple[str, ...]) -> Any:
    """Compile `__init__`, which alone differs from class to class. It fills the slots past `__setattr__`."""
    scope: dict[str, Any] = {f"_{name}": vars(made)[name].__set__ for name in names}
    steps = "".join(f"\n    _{name}(self, {name})" for name in names)
    exec(f"def __init__(self, {', '.join(names)}):{steps}", scope)  # noqa: S102 - the names of fields and no more
    return scope["__init__"]


def _methods(names: tuple[str, ...]) -> dict[str, Callable[..., Any]]:
    fields = attrgetter(*names)

    def equal(self: Any, other: object) -> bool:
        return fields(self) == fields(other) if other.__class__ is self.__class__ else NotImplemented

    def key(self: Any) -> int:
        return hash(fields(self))

    def show(self: Any) -> str:
        return f"{type(self).__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    def refuse(self: Any, name: str, *_: object) -> None:
        raise AttributeError(f"{type(self).__name__} is a value: its {name} cannot be changed")

    def remake(self: Any) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, name) for name in names)

    return {
        "__eq__": equal,
        "__hash__": key,
        "__repr__": show,
        "__setattr__": refuse,
        "__delattr__": refuse,
        "__reduce__": remake,
    }
