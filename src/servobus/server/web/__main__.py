"""The web process: `python -m servobus.server.web`, started by the process that owns the ports.

It is told what to serve by one line of JSON on its standard input, see `config`; secrets stand in no argument and in no
variable of the environment. It says on its standard output where it listens, one line of JSON: {"ready": URL}, or
{"failed": WHY}. When its standard input ends, its parent has ended, and so does it.
"""

import asyncio
import contextlib
import gc
import importlib.util
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

from servobus.errors import ServobusError, UsageError
from servobus.server.web.config import WebConfig, parse
from servobus.server.web.rules import SMALL

COLLECT = 50_000, 20, 100
"""When garbage is looked for: seldom, for each time the loop stands still; measured, it was 22 to 39 ms and is 3."""
SLOW_END = 3
"""s for which open connections may go on when the process ends."""


def main() -> int:
    gc.disable()  # until everything is imported
    try:
        config = parse(sys.stdin.readline())
        serve(config)
    except ServobusError as error:
        say({"failed": str(error)})
        return 2
    return 0


def serve(config: WebConfig, *, until: Callable[[Callable[[], None]], None] | None = None) -> None:
    """Serve until the parent ends. Raises ServobusError for what cannot be served."""
    listener = _listener(config)
    try:
        import uvicorn  # noqa: PLC0415 - it takes its time, and what is wrong is said before

        from servobus.server.web.app import WebApplication  # noqa: PLC0415
    except ImportError as error:
        raise UsageError(f"{error.name} is not installed: install servobus[server]") from None
    application = WebApplication(config)
    if importlib.util.find_spec("nicegui") is not None:  # the extra `server` alone has the API and no pages
        from servobus.server.web.page import mount  # noqa: PLC0415

        mount(application)
    application.listens(listener.getsockname()[1])
    server = uvicorn.Server(server_settings(application))
    asyncio.run(_run(server, listener, application, until or _parent_ended))


def server_settings(application: Any) -> Any:
    """Give what uvicorn is told: bounds for everything, no log of addresses, no belief in headers of others."""
    import uvicorn  # noqa: PLC0415

    config: WebConfig = application.config
    # A socket that is refused with a status is to uvicorn one that nobody has answered.
    logging.getLogger("uvicorn.error").addFilter(_said_of_refusals)
    return uvicorn.Config(
        application.asgi,
        loop="none",
        log_level="warning",
        access_log=False,  # addresses may hold the token of a link
        server_header=False,
        proxy_headers=False,  # anybody can send them
        ws="websockets-sansio",
        ws_max_size=SMALL,
        ws_ping_interval=5.0,
        ws_ping_timeout=10.0,
        ws_per_message_deflate=False,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=SLOW_END,
        limit_concurrency=500,
        h11_max_incomplete_event_size=32 * 1024,
        ssl_certfile=config.certificate,
        ssl_keyfile=config.key,
        lifespan="on",
        interface="asgi3",
    )


def _said_of_refusals(record: logging.LogRecord) -> bool:
    return "without completing handshake" not in record.getMessage()


async def _run(
    server: Any, listener: socket.socket, application: Any, until: Callable[[Callable[[], None]], None]
) -> None:
    loop = asyncio.get_running_loop()

    def end() -> None:
        server.should_exit = True

    def told() -> None:
        loop.call_soon_threadsafe(end)

    until(told)
    async with application:
        ended = asyncio.ensure_future(server.serve(sockets=[listener]))
        while not server.started and not ended.done():  # noqa: ASYNC110 - uvicorn tells nobody
            await asyncio.sleep(0.005)
        if server.started:
            gc.collect()
            gc.freeze()
            gc.set_threshold(*COLLECT)
            gc.enable()
            say({"ready": application.context.base})
        await ended


def _listener(config: WebConfig) -> socket.socket:
    """Open the port. Raises UsageError for one that is taken."""
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((config.host, config.port))
    except OSError as error:
        listener.close()
        raise UsageError(f"{config.host}:{config.port} cannot be listened on: {error.strerror}") from None
    return listener


def _parent_ended(end: Callable[[], None]) -> None:
    """Call `end` when the parent has ended: then nobody holds the other end of standard input."""

    def watch() -> None:
        with contextlib.suppress(OSError, ValueError):
            while sys.stdin.readline():
                pass
        end()

    threading.Thread(target=watch, name="parent", daemon=True).start()


def say(what: dict[str, str]) -> None:
    """Tell the parent something, on a line of its own."""
    with contextlib.suppress(OSError):
        print(json.dumps(what), flush=True)


if __name__ == "__main__":
    sys.exit(main())
