"""The option `--all`; tests/samples.py says which models stand for all of them without it."""

import sys

import pytest
from hypothesis import settings

import extent

pytest_plugins = ["counted_behaviours", "counted_faults"]
"""Here, as a run in several processes reads no other conftest.py where the results come together."""
EXAMPLES = {False: 40, True: 200}
"""--all -> examples of each property that names no number itself."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--all",
        action="store_true",
        dest="everything",
        help="run slow tests with every model too, not with samples alone, and more examples of each property",
    )


def pytest_configure(config: pytest.Config) -> None:
    assert "samples" not in sys.modules, "tests/samples.py chooses models when it is imported: not before this"
    extent.everything = config.getoption("everything")
    # An example has no time limit of its own: the computer may have more to do than this.
    settings.register_profile("servobus", deadline=None, max_examples=EXAMPLES[extent.everything])
    settings.load_profile("servobus")
