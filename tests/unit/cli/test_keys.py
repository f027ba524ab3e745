"""Single keys of a terminal: given as they are pressed, one by one to who asks for one."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobus
from servobus.cli.keys import Keys
from servobus.cli.robots.person import ENTER, AtTerminal
from servobus.errors import UsageError
from servobus.robots.file.reading import read_text
from unit.robots.arms import SIX

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals as on POSIX")


@pytest.fixture
def hands(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Give the far end of the terminal that this program has: what is written there is typed."""
    far, near = os.openpty()
    with os.fdopen(near) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield far
    os.close(far)


def test_keys_come_as_they_are_pressed_and_arrows_are_none(hands: int) -> None:
    with Keys() as keys:
        assert keys.there
        assert keys.pressed() == keys.wait(0.0) == ""
        os.write(hands, b" q")
        assert keys.wait(5.0) == " q"
        os.write(hands, b"\x1b[A")  # the arrow upwards, as xterm sends it
        assert keys.wait(5.0) == ""
        assert keys.there


def test_who_asks_for_one_key_gets_one_after_the_other(hands: int) -> None:
    with servobus.robot(read_text(SIX)) as arm:
        person = AtTerminal(arm)
        with person.attentive():
            os.write(hands, b"n \r")
            assert [person.key(0.1) for _ in range(4)] == ["n", " ", ENTER, ""]


def test_without_a_terminal_nobody_presses_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing, servobus.robot(read_text(SIX)) as arm:
        monkeypatch.setattr(sys, "stdin", nothing)
        with pytest.raises(UsageError, match="a terminal is needed, or a --script"):
            AtTerminal(arm).key(0.1)
