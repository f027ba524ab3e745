"""One method, two drivers: how operations are written once.

`bus_method` decorates a method that builds a job. What calling it gives depends on who it is called on:

    Blocking    the result: the job is carried out before the call returns
    Awaiting    an awaitable of the result
    neither     the job itself

Type checkers see all three.
"""

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from servobus.core.exchange import Job

P = ParamSpec("P")
T = TypeVar("T")


class Blocking(ABC):
    """Carries a job out and gives its result."""

    @abstractmethod
    def do(self, job: Job[T]) -> T: ...


class Awaiting(ABC):
    """Gives an awaitable that carries a job out."""

    @abstractmethod
    async def do(self, job: Job[T]) -> T: ...


class bus_method(Generic[P, T]):  # noqa: N801 - it reads as what it is, a decorator
    """Decorator for a method that builds a job; see the head of this module."""

    def __init__(self, build: Callable[Concatenate[Any, P], Job[T]]) -> None:
        self._build = build
        self._name = build.__name__
        self.__doc__ = build.__doc__

    @overload
    def __get__(self, owner: None, kind: type) -> "bus_method[P, T]": ...
    @overload
    def __get__(self, owner: Blocking, kind: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, owner: Awaiting, kind: type) -> Callable[P, Awaitable[T]]: ...
    @overload
    def __get__(self, owner: object, kind: type) -> Callable[P, Job[T]]: ...
    def __get__(self, owner: Any, kind: type) -> Any:
        if owner is None:
            return self
        build = self._build
        if isinstance(owner, (Blocking, Awaiting)):

            def operation(*args: P.args, **kwargs: P.kwargs) -> Any:
                return do(build(owner, *args, **kwargs))

            do = owner.do
        else:

            def operation(*args: P.args, **kwargs: P.kwargs) -> Any:
                return build(owner, *args, **kwargs)

        operation.__doc__ = self.__doc__
        vars(owner)[self._name] = operation  # found there from now on, without coming here
        return operation
