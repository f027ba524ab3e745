"""The web process as its parent starts it: told by a pipe, heard by a pipe, and gone with its parent."""

import json
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fastapi", reason="the web process needs fastapi: servobus[server]")

PATIENCE = 60.0
"""s; a limit against hanging, and never a measurement."""
SECRET = "a-secret-of-the-test"


@contextmanager
def process(**told: Any) -> Iterator[tuple[subprocess.Popen[str], dict[str, str]]]:
    """Start the web process, and give it with the first line that it says."""
    made = subprocess.Popen(
        [sys.executable, "-m", "servobus.server.web"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert made.stdin is not None
    assert made.stdout is not None
    with made:
        try:
            made.stdin.write(json.dumps(told) + "\n")
            made.stdin.flush()
            yield made, json.loads(made.stdout.readline())
        finally:
            made.kill()


def test_it_serves_until_its_parent_ends_and_tells_no_secret() -> None:
    with process(port=0, local_token=SECRET, start_token=SECRET + "2", buses={"b": "virtual:rx28@1"}) as (made, said):
        base = said["ready"]
        assert base.startswith("http://127.0.0.1:")
        request = urllib.request.Request(f"{base}/api/v1/buses", headers={"Authorization": f"Bearer {SECRET}"})
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            assert [bus["name"] for bus in json.load(answer)] == ["b"]
            assert "server" not in answer.headers
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{base}/?token={SECRET}", timeout=PATIENCE)
        assert refused.value.code == 401
        refused.value.close()
        for name in ("cmdline", "environ"):
            if (file := Path(f"/proc/{made.pid}/{name}")).exists():
                assert SECRET.encode() not in file.read_bytes()
        assert made.stdin is not None
        assert made.stderr is not None
        made.stdin.close()
        assert made.wait(PATIENCE) == 0
        assert made.stderr.read() == ""  # nothing is logged of a request, and so no token


def test_it_says_why_it_cannot_serve() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, process(port=taken.getsockname()[1]) as (made, said):
        assert "cannot be listened on" in said["failed"]
        assert made.wait(PATIENCE) == 2
    with process(port=0, host="0.0.0.0", local_token=SECRET) as (made, said):
        assert "other computers" in said["failed"]
        assert SECRET not in said["failed"]
        assert made.wait(PATIENCE) == 2
    with process(port=0, buses={"b": "/dev/there-is-none"}) as (made, said):
        assert "/dev/there-is-none" in said["failed"]
        assert made.wait(PATIENCE) == 2
