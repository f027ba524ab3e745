"""Virtual servos for the tests of other projects; pytest finds this module by itself.

    virtual_bus     makes an open `Bus` of virtual servos, on a virtual clock
    virtual_port    makes a port that any program can open: a pseudo terminal, or a TCP port
    virtual_robot   makes an open `Robot` from a robot file, its servos virtual ones on a virtual clock
    served_robot    makes the ports of a robot file for any program, and a robot file that names them

All close behind the test what they made for it. Nothing of servobus's virtual servos is imported before that.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from os import PathLike, fspath
from typing import TYPE_CHECKING
from urllib.parse import quote

import pytest

if TYPE_CHECKING:
    from servobus.bus.blocking import Bus
    from servobus.robots.blocking import Robot
    from servobus.robots.virtual.serving import ServedRobot
    from servobus.virtual.serve.background import ServedPort
    from servobus.virtual.wire.faults import Faults


@pytest.fixture
def virtual_bus() -> "Iterator[Callable[..., Bus]]":
    """Make buses of virtual servos: `virtual_bus("rx28@1-4", faults="drop=0.01")`.

    Other keywords are the options of a virtual port, such as `echo=True` or `voltage=12`, and of its servos, such as
    `goal_torque=False`, or `reading="manual"` for all of them. The clock is virtual unless `clock="real"`: time passes
    only while the test waits for the bus. `bus.transport.inject(SPEC)` changes the faults
    later on, `bus.transport.servos` are the servos, `bus.transport.now()` is their time.
    """
    from servobus.bus.blocking import Bus  # noqa: PLC0415 - here and below: only who uses it waits for it
    from servobus.virtual.serve.inprocess import connect  # noqa: PLC0415

    with ExitStack() as stack:

        def make(servos: str, *, faults: "Faults | str | None" = None, **options: object) -> "Bus":
            port = connect(_url(servos, {"clock": "virtual"} | options))
            port.inject(faults)
            return stack.enter_context(Bus(port))

        yield make


@pytest.fixture
def virtual_port() -> "Iterator[Callable[..., ServedPort]]":
    """Serve virtual servos to other programs: `virtual_port("rx28@1-4")` gives the path of a pseudo terminal.

    With `tcp=True`, and on Windows always, it is a TCP port, as `socket://127.0.0.1:12345`. Other keywords are `faults`
    and the options of a virtual port. The clock is the real one.

    What is given is a string, and a handle to what is behind it: `port.servo(1)` tells what is true of a servo and can
    `block` it, `port.inject(SPEC)` changes the faults, `port.unplug(3)` and `port.plug(3)` take servos off the bus and
    put them back.
    """
    from servobus.virtual.serve.background import serve  # noqa: PLC0415

    with ExitStack() as stack:

        def make(
            servos: str, *, tcp: bool = False, faults: "Faults | str | None" = None, **options: object
        ) -> "ServedPort":
            return stack.enter_context(serve(_url(servos, options), tcp=tcp, faults=faults))

        yield make


@pytest.fixture
def virtual_robot() -> "Iterator[Callable[..., Robot]]":
    """Make robots of virtual servos from robot files: `virtual_robot("arm.toml", pose="home")`.

    Other keywords are `faults` and the options of a virtual port, as with `virtual_bus`. The servos stand where the
    robot rests, or in the pose that is named.
    """
    from servobus.robots.opening import robot  # noqa: PLC0415

    with ExitStack() as stack:

        def make(file: "str | PathLike[str]", **options: object) -> "Robot":
            return stack.enter_context(robot(_url(fspath(file), {"clock": "virtual"} | options)))

        yield make


@pytest.fixture
def served_robot() -> "Iterator[Callable[..., ServedRobot]]":
    """Serve the servos of a robot file to other programs: `served_robot("arm.toml")`.

    `.path` is a robot file that names the ports served, `.ports["left"]` such a port with a handle to what is behind
    it, and `.servos["shoulder"]` the servos of a joint. Keywords are `tcp=True` and the options of a virtual port.
    """
    from servobus.robots.file.reading import read_file  # noqa: PLC0415
    from servobus.robots.virtual.serving import serve_robot  # noqa: PLC0415

    with ExitStack() as stack:

        def make(file: "str | PathLike[str]", *, tcp: bool = False, **options: object) -> "ServedRobot":
            contents = read_file(_url(fspath(file), options))
            return stack.enter_context(serve_robot(contents, tcp=("127.0.0.1", 0) if tcp else None))

        yield make


def _url(servos: str, options: dict[str, object]) -> str:
    words = {"as" if name == "reading" else name: quote(_word(value)) for name, value in options.items()}
    return f"virtual:{servos}?" + "&".join(f"{name}={word}" for name, word in words.items())


def _word(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
