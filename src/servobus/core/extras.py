"""Libraries that only some of what servobus does needs: they are imported when used, and installed as extras."""

import importlib
from typing import Any

from servobus.errors import UsageError


def library(module: str, extra: str, what: str) -> Any:
    """Import a module of an extra. Raises UsageError, which says what needs it and how it is installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UsageError(f'{what} its library: pip install "servobus[{extra}]"') from None
