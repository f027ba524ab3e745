"""Counts the faults that are tested, by the numbers in the names of the tests: test_F7_... is F7."""

import re

import pytest

TOTAL = 25
"""Faults of a bus; those of networks and web pages come with them."""
NAME = re.compile(r"test_F(\d+)_")

_tested: set[int] = set()
_failed: set[int] = set()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    match = NAME.match(report.nodeid.rpartition("::")[2])
    if match is None or "faults" not in report.nodeid:
        return
    if report.failed:
        _failed.add(int(match[1]))
    elif report.when == "call" and report.passed:
        _tested.add(int(match[1]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if not _tested and not _failed:
        return
    terminalreporter.write_line(f"faults: {len(_tested - _failed)}/{TOTAL}")
