"""`serve`: own ports, and share them with pages and programs."""

import asyncio
import re
import webbrowser
from pathlib import Path
from typing import Any

import click

from servobus.cli import complete
from servobus.cli.interrupts import stop_on_signals
from servobus.cli.options import verb
from servobus.errors import UsageError

HTTP = "127.0.0.1:7380"
TICK = 0.05
"""s after which a signal is noticed."""


@verb(
    "serve",
    "servobus serve /dev/ttyUSB0 --open",
    "servobus serve arm.toml --pty /tmp/arm",
    "servobus serve left=/dev/ttyUSB0 right=/dev/ttyUSB1 --tcp left=127.0.0.1:3333",
    "servobus serve virtual:rx28@1-4,drs0602@219,lx16a@1,2 --open",
)
@click.argument("sources", metavar="[PORT|ROBOT.toml]...", nargs=-1, shell_complete=complete.ports)
@click.option("--http", metavar="HOST:PORT", default=HTTP, show_default=True, help="Where pages and the API are.")
@click.option("--no-http", is_flag=True, help="No pages and no API: only share the ports.")
@click.option(
    "--pty",
    "ptys",
    metavar="[BUS=]LINK",
    multiple=True,
    help="A terminal for one program of another make, with a link to it; of the only bus, or of BUS.",
)
@click.option("--tcp", "tcps", metavar="[BUS=]HOST:PORT", multiple=True, help="The same as a TCP port.")
@click.option(
    "--record", type=click.Path(file_okay=False, path_type=Path), metavar="DIR", help="Record all traffic to DIR."
)
@click.option("--read-only", is_flag=True, help="Nobody may move or change anything; stopping works.")
@click.option("--open", "open_page", is_flag=True, help="Open the page in a browser.")
@click.option("--certificate", type=click.Path(exists=True, path_type=Path), metavar="FILE", help="For TLS.")
@click.option("--key", type=click.Path(exists=True, path_type=Path), metavar="FILE", help="Its key.")
@click.option("--name", "names", metavar="NAME", multiple=True, help="A name by which browsers reach this server.")
@click.option("--password", is_flag=True, help="Ask for a password that lets people in; see --http for others.")
@click.option("--exposed", is_flag=True, help="Serve an address of the network without TLS and password, all the same.")
def serve(sources: tuple[str, ...], **how: Any) -> None:
    """Own ports, and share them: with pages in a browser, an API, and programs that go on unchanged.

    PORT is a port, NAME=PORT, or a robot file, which brings its ports and the names of its joints. `ready` and the
    address of the page are printed first, then a line for each bus. Other servobus commands use a bus as PORT
    servobus:///NAME.

    Everything listens on this computer alone, unless --http names another address: that takes a certificate and a
    password, or --exposed. Ctrl-C ends it, and leaves every servo as its safe action says.
    """
    from servobus.server.serving import Plan, buses_of, serve, state_folder  # noqa: PLC0415 - asyncio is slow to import

    ports, robots = buses_of(sources)
    plan = Plan(
        ports,
        robots,
        [(bus, Path(link)) for bus, link in (_of_bus(one, ports) for one in how["ptys"])],
        [(bus, *_address(where)) for bus, where in (_of_bus(one, ports) for one in how["tcps"])],
        None if how["no_http"] else _web(how),
        how["record"],
        state_folder(),
        how["read_only"],
    )
    stopped = stop_on_signals()

    def say(line: str) -> None:
        click.echo(line)
        if how["open_page"] and line.startswith("ready http"):
            webbrowser.open(line.removeprefix("ready "))

    async def run() -> None:
        stop = asyncio.Event()

        async def look() -> None:
            while not stopped.is_set():  # noqa: ASYNC110 - signals set an event of threads
                await asyncio.sleep(TICK)
            stop.set()

        looking = asyncio.ensure_future(look())
        try:
            await serve(plan, say, stop)
        finally:
            looking.cancel()

    asyncio.run(run())


def _web(how: dict[str, Any]) -> dict[str, Any]:
    """Give what the web process is told of its address and of those whom it lets in."""
    host, port = _address(how["http"])
    web: dict[str, Any] = {"host": host, "port": port, "names": list(how["names"]), "exposed": how["exposed"]}
    if how["certificate"]:
        web |= {"certificate": str(how["certificate"].absolute())}
    if how["key"]:
        web |= {"key": str(how["key"].absolute())}
    if how["password"]:
        from servobus.server.web.auth import hash_password  # noqa: PLC0415 - seldom wanted

        web["password"] = hash_password(click.prompt("password", hide_input=True, confirmation_prompt=True))
    return web


def _of_bus(text: str, ports: dict[str, str]) -> tuple[str, str]:
    """Take "BUS=REST" apart; without BUS it is the only bus."""
    name, found, rest = text.partition("=")
    if found and name in ports:
        return name, rest
    if len(ports) != 1:
        there = ", ".join(ports) or "none"
        raise UsageError(f"{text}: say of which bus, as in {next(iter(ports), 'BUS')}={text}; there are: {there}")
    return next(iter(ports)), text


def _address(text: str) -> tuple[str, int]:
    match = re.fullmatch(r"(?:(\[[0-9A-Fa-f:.]+\]|[^:\[\]]*):)?(\d{1,5})", text)
    if match is None or int(match[2]) > 65535:
        raise UsageError(f"{text}: write HOST:PORT, such as {HTTP}")
    return (match[1] or "127.0.0.1").strip("[]"), int(match[2])
