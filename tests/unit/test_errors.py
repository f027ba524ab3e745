"""The tree of errors: every error is exported, and drawn where it belongs, in its module and on the page."""

import inspect
import re
from pathlib import Path

import pytest

import servobus
from servobus import errors

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
ERRORS = {
    name: kind
    for name, kind in vars(errors).items()
    if inspect.isclass(kind) and issubclass(kind, errors.ServobusError)
}
LINE = re.compile(r"^(?P<lead>[│├└─ ]*)(?P<name>[A-Z]\w+)(?: \((?P<also>\w+)\))?(?:  |$)")


def drawn(text: str) -> dict[str, tuple[str | None, str | None]]:
    """Read a drawn tree: name -> the error it stands under, and what it is besides."""
    tree: dict[str, tuple[str | None, str | None]] = {}
    above: list[str] = []
    lines = text.splitlines()
    start = next(n for n, line in enumerate(lines) if line.strip() == "ServobusError")
    indent = len(lines[start]) - len("ServobusError")
    for line in lines[start:]:
        if not (match := LINE.match(line[indent:])):
            break
        depth = len(match["lead"]) // 4
        tree[match["name"]] = (above[depth - 1] if depth else None, match["also"])
        above[depth:] = [match["name"]]
    return tree


@pytest.mark.parametrize(
    "text", [inspect.getdoc(errors), PAGE.read_text(encoding="utf-8")], ids=["errors.py", "python.md"]
)
def test_the_tree_is_drawn_as_it_is(text: str) -> None:
    tree = drawn(text)
    assert tree.keys() == ERRORS.keys()
    for name, (above, also) in tree.items():
        first, *others = ERRORS[name].__bases__
        assert first.__name__ == (above or "Exception")
        assert [kind.__name__ for kind in others] == [kind for kind in [also] if kind]


@pytest.mark.parametrize("name", ERRORS)
def test_every_error_is_exported(name: str) -> None:
    assert getattr(servobus, name) is ERRORS[name]
    assert name in servobus.__all__


@pytest.mark.parametrize("name", ["Counts", "ReconnectReport", "Stats", "Watchdog"])
def test_so_is_what_a_bus_gives(name: str) -> None:
    assert name in servobus.__all__
    assert inspect.isclass(getattr(servobus, name))
