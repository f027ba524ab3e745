"""Virtual servos in a process of their own, in real time, for programs that do not know what they talk to.

The other process matters: a client may hold this one's interpreter while it waits for an answer.
"""

import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

PATIENCE = 20.0
"""s for what takes a fraction of one on a computer that has nothing else to do."""


class Servers:
    """What `servobus virtual` serves, each in its own process: call it with the arguments for the name of a port."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: list[subprocess.Popen[str]] = []
        self._started = 0

    def __call__(self, *arguments: str) -> str:
        if "--tcp" not in arguments:
            if sys.platform == "win32":
                pytest.skip("there are no pseudo terminals")
            arguments += ("--pty", str(self._folder / f"servos{self._started}"))
        command = [sys.executable, "-m", "servobus", "virtual", *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self._processes.append(process)
        self._started += 1
        assert process.stdout is not None
        assert sys.platform == "win32" or select.select([process.stdout], [], [], PATIENCE)[0], "it never got ready"
        word, _, name = process.stdout.readline().strip().partition(" ")
        assert word == "ready", process.communicate()[1]
        return name

    def end(self) -> None:
        """End all that are served; none of them must have said anything more."""
        processes, self._processes = self._processes, []
        for process in processes:
            process.terminate()
        said = "".join("".join(process.communicate(timeout=PATIENCE)) for process in processes)
        assert said == "", said
        assert sys.platform == "win32" or all(process.returncode == 0 for process in processes)


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    """Serve what `servobus virtual` would, until the tests of a module are over; give the name of the port."""
    servers = Servers(tmp_path_factory.mktemp("ports"))
    try:
        yield servers
    finally:
        servers.end()


@pytest.fixture
def eventually() -> Callable[[Callable[[], bool]], None]:
    """Ask again and again, until the answer is yes or too much time has passed."""

    def ask(question: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not question():
            assert time.monotonic() < deadline, "it never came true"
            time.sleep(0.02)

    return ask
