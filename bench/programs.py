"""Programs the bench talks to in lines, and its own C programs: compiled when needed, gone when it ends."""

import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

SOURCES = Path(__file__).parent


class NoCompiler(Exception):
    """There is no C compiler, or it could not compile."""


class Silent(Exception):
    """A program gave no line in time (`hung`), or ended (`died`)."""


class Program:
    """A program in a process of its own, so that CPU time, garbage collection and imports are its own."""

    def __init__(self, *command: str, quiet: bool = False) -> None:
        errors = subprocess.DEVNULL if quiet else None
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors)
        self._heard = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()

    def stay_on(self, cpu: int | None) -> None:
        """Keep the program on one CPU, where the system can do that; None leaves it to the system."""
        if cpu is not None and hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(self._process.pid, {cpu})

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise Silent("died") from None

    def hear(self, timeout: float = 120.0) -> str:
        """Give the next line. Raises Silent if none comes within `timeout` s, or the program has ended."""
        assert self._process.stdout is not None
        out = self._process.stdout.fileno()
        deadline = time.monotonic() + timeout
        while b"\n" not in self._heard:
            if not select.select([out], [], [], max(0.0, deadline - time.monotonic()))[0]:
                raise Silent("hung")
            chunk = os.read(out, 65_536)
            if not chunk:
                raise Silent("died")
            self._heard += chunk
        line, _, self._heard = self._heard.partition(b"\n")
        return line.decode().strip()


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
            try:
                done = subprocess.run(command, capture_output=True, text=True, check=False)
            except OSError as error:
                raise NoCompiler(f"the C compiler {compiler} does not start ({error}); name another: CC=...") from error
            if done.returncode:
                raise NoCompiler(f"{' '.join(command)} failed:\n{done.stderr}")
            programs.append(program)
        yield programs
