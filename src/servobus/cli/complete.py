"""What the Tab key offers in a shell: ports, models, registers, joints and so on. README says how to switch it on.

A shell asks the command line itself; no port is opened for that.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]

BY_ID = Path("/dev/serial/by-id")
"""Links to serial ports whose names stay the same, on Linux."""


def ports(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the serial ports that are plugged in and virtual ones, and files where what is typed begins like none."""
    from serial.tools import list_ports  # noqa: PLC0415 - only this needs it

    from servobus import MODELS  # noqa: PLC0415 - as all that is servobus, slow beside the rest
    from servobus.remote.runtime import servers  # noqa: PLC0415

    plugged = [CompletionItem(port.device, help=port.description) for port in list_ports.comports()]
    stable = [CompletionItem(str(link)) for link in sorted(BY_ID.iterdir())] if BY_ID.is_dir() else []
    shared = [CompletionItem(f"servobus:///{name}", help=port) for one in servers() for name, port in one.buses]
    known = plugged + stable + shared + [CompletionItem(f"virtual:{name}@1", help="a virtual servo") for name in MODELS]
    offered = [item for item in known if item.value.startswith(incomplete)]
    # A shell that is told of files completes them as it always does: links to terminals, a /dev/tty not listed here.
    if not offered or "/" in incomplete:
        return [CompletionItem(incomplete, type="file")]
    return offered


def models(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the models that are known."""
    from servobus import MODELS  # noqa: PLC0415 - see above

    return _items(((name, model.title) for name, model in MODELS.items()), incomplete)


def specs(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the models that are known, for `virtual`."""
    from servobus import MODELS  # noqa: PLC0415 - see above

    return _items(((f"{name}@1", model.title) for name, model in MODELS.items()), incomplete)


def families(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the families that are known."""
    from servobus import FAMILIES  # noqa: PLC0415 - see above

    return _items(((name, family.title) for name, family in FAMILIES.items()), incomplete)


def registers(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the registers of the model, or of the family, that the command line names so far; else those of all."""
    return _items(((name, meaning) for name, meaning in _registers(ctx).items()), incomplete.lower())


def settings(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer REGISTER= for those that can be written."""
    names = _registers(ctx, writable=True).items()
    return _items(((f"{name}=", meaning) for name, meaning in names), incomplete.lower())


def joints(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the joints of the robot file that the command line names."""
    file = _robot_file(ctx)
    titles = {} if file is None else {name: f"id {joint.id} on {joint.port}" for name, joint in file.joints.items()}
    return _items(titles.items(), incomplete)


def poses(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the poses of the robot file that the command line names."""
    file = _robot_file(ctx)
    return _items(((name, "") for name in ({} if file is None else file.poses)), incomplete)


def goals(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer JOINT= for the joints of the robot file that the command line names."""
    file = _robot_file(ctx)
    return _items(((f"{name}=", "") for name in ({} if file is None else file.joints)), incomplete)


def motions(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the motions of the robot file that the command line names; and files, where what is typed is none."""
    file = _robot_file(ctx)
    found = _items(((name, "") for name in ({} if file is None else file.motions)), incomplete)
    return found or [CompletionItem(incomplete, type="file")]


def _robot_file(ctx: click.Context) -> Any:
    """Read the robot file that the command line names; None if it cannot be read."""
    from servobus.errors import RobotFileError  # noqa: PLC0415 - see above
    from servobus.robots.file.reading import read_file  # noqa: PLC0415

    try:
        return read_file(str(ctx.params.get("file")))
    except RobotFileError:
        return None


def _registers(ctx: click.Context, *, writable: bool = False) -> dict[str, str]:
    """Give name or alias -> meaning."""
    from servobus import MODELS  # noqa: PLC0415 - see above
    from servobus.families import registry  # noqa: PLC0415

    where: Any = ctx.params.get("where")
    named = ctx.params.get("model")
    chosen = list(MODELS.values())
    if isinstance(named, str) and named in MODELS:
        chosen = [MODELS[named]]
    elif where is not None and where.model is not None:
        chosen = [where.model]
    elif where is not None and where.family is not None:
        chosen = list(registry.models_of(registry.family(where.family)))
    return {
        name: row.meaning
        for model in chosen
        for row in model.registers.values()
        if row.readable and (row.writable or not writable)
        for name in (row.name, *row.aliases)
    }


def _items(offered: Iterable[tuple[str, str]], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(value, help=text) for value, text in offered if value.startswith(incomplete)]
