"""Objects that take no attribute which their class does not know.

`servo.goal_position = 2.0` looks like a write of a register to people who come from other libraries. Python would keep
the value as an attribute of the object, and the servo would never hear of it.
"""

from typing import TYPE_CHECKING, Any


class Closed:
    """Refuses to set what was not there when `_close` was called, and what is an operation or can only be read."""

    _closed = False

    def _close(self) -> None:
        """Take no further attributes from now on."""
        self._closed = True

    def _no_attribute(self, name: str) -> str:
        """Say why this attribute cannot be set, and what to do instead."""
        return f"{type(self).__name__} has no attribute {name!r} that can be set"

    def _no_such_attribute(self, name: str) -> str:
        """Say that there is no such attribute, and what to do instead."""
        return f"{type(self).__name__} has no attribute {name!r}"

    if not TYPE_CHECKING:  # type checkers tell of unknown attributes by themselves, unless they see this

        def __setattr__(self, name: str, value: Any) -> None:
            if not name.startswith("_"):
                known = getattr(type(self), name, None)  # an operation, or a property, which may have a setter
                unknown = known is None and self._closed and name not in vars(self)
                if unknown or (known is not None and getattr(known, "fset", None) is None):
                    raise AttributeError(self._no_attribute(name), name=name, obj=self)
            object.__setattr__(self, name, value)

        def __getattr__(self, name: str) -> Any:
            # Called for what is not there. Before all is set up, and for names of Python's own, no hint is made.
            said = f"{type(self).__name__!r} object has no attribute {name!r}"
            if self._closed and not name.startswith("_"):
                said = self._no_such_attribute(name)
            raise AttributeError(said, name=name, obj=self)
