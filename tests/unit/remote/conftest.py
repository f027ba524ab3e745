"""Clients of the tests know the token of the tests' servers."""

import pytest

from servobus.remote.address import TOKEN as VARIABLE
from unit.remote.hosted import TOKEN


@pytest.fixture(autouse=True)
def token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, TOKEN)
