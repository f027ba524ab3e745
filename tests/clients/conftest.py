"""Virtual servos in a process of their own, in real time, for programs that do not know what they talk to.

The other process matters: a client may hold this one's interpreter while it waits for an answer.
"""

import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

PATIENCE = 20.0
"""s for what takes a fraction of one on a computer that has nothing else to do."""


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., str]]:
    """Serve what `servobus virtual` would, until the tests of a module are over; give the name of the port."""
    folder = tmp_path_factory.mktemp("ports")
    processes: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> str:
        if "--tcp" not in arguments:
            if sys.platform == "win32":
                pytest.skip("there are no pseudo terminals")
            arguments += ("--pty", str(folder / f"servos{len(processes)}"))
        command = [sys.executable, "-m", "servobus", "virtual", *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        processes.append(process)
        assert process.stdout is not None
        assert sys.platform == "win32" or select.select([process.stdout], [], [], PATIENCE)[0], "it never got ready"
        word, _, name = process.stdout.readline().strip().partition(" ")
        assert word == "ready", process.communicate()[1]
        return name

    try:
        yield start
    finally:
        for process in processes:
            process.terminate()
        said = "".join("".join(process.communicate(timeout=PATIENCE)) for process in processes)
    assert said == "", said
    assert sys.platform == "win32" or all(process.returncode == 0 for process in processes)


@pytest.fixture
def eventually() -> Callable[[Callable[[], bool]], None]:
    """Ask again and again, until the answer is yes or too much time has passed."""

    def ask(question: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not question():
            assert time.monotonic() < deadline, "it never came true"
            time.sleep(0.02)

    return ask
