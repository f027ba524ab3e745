"""The lists of behaviours and faults: every number once, every number in use is listed, every listed one is tested."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BEHAVIOURS, FAULTS = ROOT / "docs" / "behaviours.md", ROOT / "docs" / "faults.md"
COUNTS = {"H-": 121, "D-": 91, "L-": 78, "F": 30}
WITH_THE_SERVER = ("F26",)

ENTRY = re.compile(r"^- \*\*((?:[HDL]-|F)\d+)\*\* (.*(?:\n  .*)*)", re.MULTILINE)
"""An entry of a list: its number, and its text with the lines that go on indented."""
CITED = re.compile(r"\b(?:[HDL]-[1-9]\d*|F[1-9]\d?)\b|(?<=\btest_)(?:[HDL]_|F)\d+(?=_)")
"""A number in a text or in the name of a test. Bytes from F1 to F9 match too, which does no harm: all are listed."""
SOURCE = re.compile(r"\([^();]+; (?:manual|assumed|other: [^()]+)\) \S")
"""How the text of a behaviour begins: the section of the manual, and who says so."""
TEST = re.compile(r"^def test_((?:[HDL]_|F)\d+)_", re.MULTILINE)
FILE = re.compile(r"`(tests/[\w/]+\.py)`")


def entries(page: Path) -> list[tuple[str, str]]:
    return ENTRY.findall(page.read_text(encoding="utf-8"))


def listed() -> list[str]:
    return [number for page in (BEHAVIOURS, FAULTS) for number, _ in entries(page)]


def cited(text: str) -> set[str]:
    return {number.replace("_", "-") for number in CITED.findall(text)}


def numbers_of_tests(path: Path) -> set[str]:
    return {number.replace("_", "-") for number in TEST.findall(path.read_text(encoding="utf-8"))}


def test_every_number_is_listed_once_and_in_order() -> None:
    assert listed() == [f"{kind}{number}" for kind, count in COUNTS.items() for number in range(1, count + 1)]


@pytest.mark.parametrize("folder", ["src", "tests", "docs"])
def test_every_number_in_use_is_listed(folder: str) -> None:
    known = set(listed())
    files = [path for suffix in ("py", "toml", "md") for path in (ROOT / folder).rglob(f"*.{suffix}")]
    missing = {
        path.relative_to(ROOT).as_posix(): unknown
        for path in files
        if (unknown := cited(path.read_text(encoding="utf-8")) - known)
    }
    assert files
    assert missing == {}


def test_every_behaviour_says_where_it_stands_and_who_says_so() -> None:
    assert [number for number, text in entries(BEHAVIOURS) if not SOURCE.match(text)] == []


def test_every_behaviour_has_a_test() -> None:
    tests = set[str]().union(*map(numbers_of_tests, (ROOT / "tests" / "conformance").glob("test_*.py")))
    assert [number for number, _ in entries(BEHAVIOURS) if number not in tests] == []


def test_every_fault_names_the_files_of_its_tests() -> None:
    files = sorted((ROOT / "tests" / "faults").glob("test_*.py"))
    for number, text in entries(FAULTS):
        named = FILE.findall(text)
        assert [name for name in named if not (ROOT / name).is_file()] == []
        expected = {path.relative_to(ROOT).as_posix() for path in files if number in numbers_of_tests(path)}
        assert {name for name in named if name.startswith("tests/faults/")} == expected, number
        assert bool(named) is (number not in WITH_THE_SERVER), number
        assert text.endswith("with the server.") is (number in WITH_THE_SERVER), number
