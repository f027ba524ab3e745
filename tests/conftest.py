"""The option `--all`; tests/samples.py says which models stand for all of them without it. And an empty home."""

import sys
from collections.abc import Iterator

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


@pytest.fixture(autouse=True, scope="session")
def no_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep tests away from what the user has remembered, and from servers that run: their folders are empty ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("configuration")))
        yield
