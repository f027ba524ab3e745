"""The bench's own C programs: compiled when they are needed, gone when it ends."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

SOURCES = Path(__file__).parent


class NoCompiler(Exception):
    """There is no C compiler, or it could not compile."""


@contextmanager
def compiled(*names: str) -> Iterator[list[Path]]:
    """Compile `responder.c` and its like into a folder that goes away; give the programs."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise NoCompiler(
            "the bench compiles its responder and needs a C compiler: install one (Debian, Ubuntu: "
            "`apt install gcc libc6-dev`), or name it: CC=/path/to/cc"
        )
    with tempfile.TemporaryDirectory() as folder:
        programs = []
        for name in names:
            program = Path(folder) / name
            command = [compiler, "-O2", "-Wall", "-Wextra", "-o", str(program), str(SOURCES / f"{name}.c")]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise NoCompiler(f"{' '.join(command)} failed:\n{done.stderr}")
            programs.append(program)
        yield programs


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program that takes lines and gives lines, until the `with` is over."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def responder(program: Path, delay: float = 0.0) -> Iterator[str]:
    """Serve a servo that answers `delay` s after each request; give the name of its port."""
    with running(str(program), str(round(delay * 1e6))) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()


class Worker:
    """A client in a process of its own, so that CPU time, garbage collection and imports are its own."""

    def __init__(self, stack: ExitStack, *command: str) -> None:
        self._process = stack.enter_context(running(*command))
        self.works = self._line() == "ready"

    def reads(self, count: int) -> tuple[float, list[float]]:
        """Let it read so many times; give its CPU seconds, and the seconds of each read."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{count}\n")
        self._process.stdin.flush()
        cpu, *times = map(float, self._line().split())
        return cpu, times

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def python_worker(stack: ExitStack, client: str, port: str) -> Worker:
    return Worker(stack, sys.executable, "-m", "bench.clients", client, port)
