"""What a model names as "package.module:NAME": found when a virtual servo needs it, and not before."""

import importlib
from typing import Any

from servobus.errors import UnknownName


def resolve(reference: str, what: str) -> Any:
    """Import what a reference names. Raises UnknownName, which says what it was wanted for."""
    module, _, name = reference.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        if error.name is None or not (module + ".").startswith(error.name + "."):
            raise  # the module is there, and needs another that is not
        raise UnknownName(f"{what} should be {reference}, and there is no module {error.name}") from None
    except AttributeError:
        raise UnknownName(f"{what} should be {reference}, and the module has no {name!r}") from None
