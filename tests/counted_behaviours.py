"""Counts the behaviours that are tested, by the numbers in the names of the tests: test_D_42_... is D-42."""

import re

import pytest

TOTAL = {"H": 121, "D": 91, "L": 78}
"""Behaviours of each family; docs/behaviours.md tells what the numbers stand for."""
NAME = re.compile(r"test_([HDL])_(\d+)(?:_|\[|$)")

_tested: set[tuple[str, int]] = set()
_failed: set[tuple[str, int]] = set()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    match = NAME.match(report.nodeid.rpartition("::")[2])
    if match is None or "conformance" not in report.nodeid:
        return
    behaviour = match[1], int(match[2])
    if report.failed:
        _failed.add(behaviour)
    elif report.when == "call" and report.passed:
        _tested.add(behaviour)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if not _tested and not _failed:
        return
    good = _tested - _failed
    parts = ", ".join(
        f"{family} {sum(1 for one, _ in good if one == family)}/{count}" for family, count in TOTAL.items()
    )
    terminalreporter.write_line(f"behaviours: {len(good)}/{sum(TOTAL.values())} ({parts})")
