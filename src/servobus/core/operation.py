"""One method, two drivers: how operations are written once.

`bus_method` decorates a method that builds a job. What calling it gives depends on the object:

    Blocking    the result: the job is carried out before the call returns
    Awaiting    an awaitable of the result
    neither     the job itself

Type checkers see all three.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Generator
from enum import IntEnum
from functools import partial
from typing import Any, Concatenate, Generic, ParamSpec, TypeAlias, TypeVar, Union, overload

from servobus.core.exchange import Exchange

P = ParamSpec("P")
T = TypeVar("T")

Work: TypeAlias = Exchange[T] | Generator[Any, Any, T]
"""What an operation builds: a job of a bus, or one of a robot, whose steps are other ones."""


class Priority(IntEnum):
    """What a job is for, where several want one line: the lower comes first."""

    STOP = 0
    MOTION = 1
    READ = 2
    SCAN = 3


class Blocking(ABC):
    """Carries a job out and gives its result."""

    @abstractmethod
    def do(self, job: Any, *, priority: Priority = Priority.READ) -> Any: ...


class Awaiting(ABC):
    """Gives an awaitable that carries a job out."""

    @abstractmethod
    async def do(self, job: Any, *, priority: Priority = Priority.READ) -> Any: ...


F = TypeVar("F", bound=Callable[..., Any])


def urgent(priority: Priority) -> Callable[[F], F]:
    """Give the jobs that a method builds another priority than that of a read: `@bus_method` stands above it."""

    def mark(build: F) -> F:
        build.priority = priority  # type: ignore[attr-defined] # `bus_method` looks for it
        return build

    return mark


class bus_method(Generic[P, T]):  # noqa: N801 - it reads as what it is, a decorator
    """Decorator for a method that builds a job; see the head of this module.

    What one gets on a class or an object is a plain function with the method's own name and docstring. Its signature
    is made when something asks for it, since that takes `inspect`, which is slow to import.
    """

    def __init__(self, build: Callable[Concatenate[Any, P], Work[T]]) -> None:
        self._build = build
        self._name = build.__name__
        self.__doc__ = build.__doc__

    @overload
    def __get__(self, owner: None, kind: type) -> Callable[Concatenate[Any, P], Any]: ...
    @overload
    def __get__(self, owner: Blocking, kind: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, owner: Awaiting, kind: type) -> Callable[P, Awaitable[T]]: ...
    @overload
    def __get__(self, owner: object, kind: type) -> Callable[P, Work[T]]: ...
    def __get__(self, owner: Any, kind: type) -> Any:
        build, name = self._build, self._name
        if owner is None:

            def unbound(self: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
                return getattr(self, name)(*args, **kwargs)

            return self._named(unbound, _Shown(build, kind, bound=False))
        if isinstance(owner, (Blocking, Awaiting)):

            def operation(*args: P.args, **kwargs: P.kwargs) -> Any:
                return do(build(owner, *args, **kwargs))

            do: Any = owner.do
            if (priority := getattr(build, "priority", Priority.READ)) is not Priority.READ:
                do = partial(do, priority=priority)
        else:

            def operation(*args: P.args, **kwargs: P.kwargs) -> Any:
                return build(owner, *args, **kwargs)

        # Found there from now on, without coming here.
        vars(owner)[name] = self._named(operation, _Shown(build, kind, bound=True))
        return operation

    def _named(self, function: Any, shown: "_Shown") -> Any:
        function.__name__, function.__qualname__ = self._name, self._build.__qualname__
        function.__module__, function.__doc__ = self._build.__module__, self.__doc__
        function.__wrapped__ = shown
        return function


class _Shown:
    """What `inspect.signature`, and with it `help` and Jupyter, find behind an operation: the true signature."""

    __slots__ = ("_bound", "_build", "_kind")

    def __init__(self, build: Callable[..., Any], kind: type, *, bound: bool) -> None:
        self._build, self._kind, self._bound = build, kind, bound

    def __call__(self) -> None:
        """Be callable, as `inspect` demands of what has a signature. It is never called."""

    @property
    def __signature__(self) -> Any:
        import inspect  # noqa: PLC0415 - slow to import, and only wanted where something asks

        signature = inspect.signature(self._build)
        parameters = [
            parameter.replace(annotation=self._filled(parameter.annotation))
            for parameter in list(signature.parameters.values())[1 if self._bound else 0 :]
        ]
        return signature.replace(parameters=parameters, return_annotation=self._result(signature.return_annotation))

    def _result(self, job: Any) -> Any:
        """Give the type of what calling the operation gives, from that of its job."""
        if not issubclass(self._kind, Blocking | Awaiting):
            return job
        if isinstance(job, str):  # it names what is not imported at start
            result = self._filled(job.removeprefix("Procedure[").removesuffix("]"))
            return result if issubclass(self._kind, Blocking) else f"Awaitable[{result}]"
        # A job is a procedure, or the union of an exchange and a procedure: its result comes last.
        procedure = job.__args__[-1] if getattr(job, "__origin__", None) is Union else job
        given = self._filled(procedure.__args__[-1])
        given = None if given is type(None) else given
        awaitable: Any = Awaitable
        return awaitable[given] if issubclass(self._kind, Awaiting) else given

    def _filled(self, annotation: Any) -> Any:
        """Put what the class says in place of type variables: the S of a `Bus` is BusServo."""
        known: dict[Any, Any] = {}
        for base in [base for kind in self._kind.__mro__ for base in vars(kind).get("__orig_bases__", ())]:
            names = getattr(getattr(base, "__origin__", None), "__parameters__", ())
            known |= dict(zip(names, base.__args__, strict=True)) if names else {}
        if isinstance(annotation, str):
            for variable, meant in known.items():
                annotation = re.sub(rf"\b{variable.__name__}\b", getattr(meant, "__name__", str(meant)), annotation)
            return annotation
        if annotation in known:
            return known[annotation]
        if isinstance(annotation, type) and not hasattr(annotation, "__args__"):
            return annotation
        wanted = getattr(annotation, "__parameters__", ())
        return annotation[tuple(known.get(variable, variable) for variable in wanted)] if wanted else annotation
