"""Clients of the tests know the token of the tests' servers."""

from unit.remote.conftest import token

__all__ = ["token"]
