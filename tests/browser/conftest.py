"""A browser, and a server on virtual servos in a process of its own. Both are started once."""

import json
import os
import shutil
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

SPEC = "virtual:rx28@1-3,drs0602@219,lx16a@5"
SERVOS = (("rx28", 1), ("rx28", 2), ("rx28", 3), ("drs0602", 219), ("lx16a", 5))
START = 60.0
"""s that the server may take to start on a computer that has much to do."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE = 60_000
"""ms that the page may take for what a test waits for."""


class Server:
    """A server that runs.

    url    the address of its pages
    link   the same, with what lets a browser in
    token  what lets a program of this computer in
    """

    def __init__(self, link: str, token: str) -> None:
        self.url, self.link, self.token = link.partition("/?")[0], link, token

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        """Ask the API, as another program does."""
        request = urllib.request.Request(
            f"{self.url}/api/v1{path}",
            None if body is None else json.dumps(body).encode(),
            {"authorization": f"Bearer {self.token}", "content-type": "application/json"},
            method=method,
        )
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.load(answer)

    def value(self, servo: str, register: str, *, stored: bool = False) -> Any:
        """Read one register of a servo, past the page."""
        query = f"?names={register}&stored={str(stored).lower()}"
        return self.ask("GET", f"/buses/bench/servos/{servo}/values{query}")[register]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Start the browser; without one these tests are skipped."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("there is no chromium here, so no page was tested in a browser")
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: no page was tested")
    pytest.importorskip("nicegui", reason="the extra servobus[web] is not installed: there is no page to test")
    with sync.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def server(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Serve virtual servos, all of them known from the start."""
    del chromium  # without a browser nothing is served
    folder = tmp_path_factory.mktemp("served")
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI", "SERVOBUS"))
    }
    environment |= {"PYTHONPATH": os.pathsep.join(sys.path), "XDG_RUNTIME_DIR": str(_private(folder / "run"))}
    environment |= {"XDG_STATE_HOME": str(folder / "state"), "XDG_CONFIG_HOME": str(folder / "config")}
    process = subprocess.Popen(
        [sys.executable, "-m", "servobus", "serve", "--http", "127.0.0.1:0", f"bench={SPEC}"],
        env=environment, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        yield _ready(process, folder / "run")
    finally:
        process.terminate()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


@pytest.fixture(scope="session")
def logged_in(server: Server, chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log in as an administrator, once for all; gives the file with what the browser remembers."""
    file = tmp_path_factory.mktemp("browser") / "state.json"
    context = chromium.new_context()
    page = context.new_page()
    page.goto(server.link)
    page.wait_for_selector("[data-stop]", state="attached", timeout=PATIENCE)
    context.storage_state(path=str(file))
    context.close()
    return file


@pytest.fixture
def show(server: Server, chromium: Any, logged_in: Path) -> Iterator[Callable[..., Any]]:
    """Give what opens a page; nothing from elsewhere may be asked for, and no error may stand in its console."""
    contexts: list[Any] = []
    wrong: list[str] = []
    note = wrong.append

    def open_page(path: str, *, width: int = 1280) -> Any:
        context = chromium.new_context(
            viewport={"width": width, "height": 860}, storage_state=str(logged_in), accept_downloads=True
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: note(f"script: {error}"))
        page.on("console", lambda said: note(f"console: {said.text}") if said.type == "error" else None)
        page.on("request", lambda asked: None if _own(asked.url, server.url) else note(f"elsewhere: {asked.url}"))
        page.goto(server.url + path)
        # What is typed before the page is connected is lost.
        page.wait_for_selector("[data-link=ok], [data-link=slow]", state="attached")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not wrong


def _own(url: str, base: str) -> bool:
    return url.startswith((base, base.replace("http", "ws", 1), "data:", "blob:"))


def _private(folder: Path) -> Path:
    folder.mkdir(mode=0o700)
    return folder


def _ready(process: "subprocess.Popen[str]", runtime: Path) -> Server:
    """Wait until a server says where its pages are, and make its servos known."""
    timer = threading.Timer(START, process.kill)
    timer.start()
    assert process.stdout is not None
    ready, bus = process.stdout.readline(), process.stdout.readline()
    timer.cancel()
    assert (ready[:6], bus[:4]) == ("ready ", "bus "), ready + bus
    (file,) = runtime.glob("*/server-*.json")
    server = Server(ready.split()[1], json.loads(file.read_text())["token"])
    for model, id in SERVOS:
        server.ask("POST", "/buses/bench/servos", {"model": model, "id": id})
    return server
