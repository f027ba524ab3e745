"""`remember` and `forget`: which servos are of which model, where they cannot say so themselves."""

from collections.abc import Collection, Iterable

import click

from servobus.bus import remembered
from servobus.cli import complete
from servobus.cli.options import port_argument, verb
from servobus.cli.values import ALL, IDS, Ids, joined_ids
from servobus.connect import lasting_name
from servobus.core.ids import shown_ids
from servobus.errors import UsageError
from servobus.families import registry


@verb(
    "remember",
    "servobus remember /dev/ttyUSB0 1 hts35h",
    "servobus remember /dev/ttyUSB0 1-4,7 lx16a",
    "servobus remember socket://pi.local:3333 all lx224",
)
@port_argument()
@click.argument("words", metavar="ID... MODEL", nargs=-1, required=True, shell_complete=complete.models)
def remember(port: str, words: tuple[str, ...]) -> None:
    """Remember of which MODEL the servos ID... on PORT are, for servos that cannot say it themselves.

    LX, HTS, HTD and HX servos cannot. From then on every command and program of this user takes them for that model;
    --model and `models=` come first. It goes with the adapter, whatever its port is called; `all` is for all servos of
    the adapter of which nothing else is remembered. `servobus ports` shows what is remembered. No servo is asked.
    """
    *ids, name = words
    if not ids:
        raise click.UsageError("say ID... and MODEL, as in `servobus remember /dev/ttyUSB0 1-4 lx16a`")
    meant = joined_ids(IDS.convert(word, None, None) for word in ids)
    model = registry.model(name)
    adapter, about = lasting_name(port)
    remembered.remember(adapter, about, None if isinstance(meant, str) else meant, model)
    click.echo(f"{who(meant)} on {adapter}: remembered as {model.title}")


@verb("forget", "servobus forget /dev/ttyUSB0 1", "servobus forget /dev/ttyUSB0")
@port_argument()
@click.argument("ids", metavar="[ID]...", type=IDS, nargs=-1)
def forget(port: str, ids: tuple[Ids, ...]) -> None:
    """Forget of which model the servos ID... on PORT are, or all that is remembered of PORT.

    PORT may be the name of an adapter that is not plugged in, as `servobus ports` shows it.
    """
    meant = joined_ids(ids) or ALL
    adapter, _ = lasting_name(port) if port not in remembered.everything() else (port, "")
    gone = remembered.forget(adapter, None if isinstance(meant, str) else meant)
    if not gone:
        raise UsageError(f"nothing is remembered of {who(meant)} on {adapter}; `servobus ports` shows what is")
    click.echo(f"{who_of(gone, gone)} on {adapter}: forgotten")


def who(ids: Ids) -> str:
    """Name servos: "id 3", "ids 1-4,7" or "all servos"."""
    return "all servos" if isinstance(ids, str) else shown_ids(ids)


def who_of(keys: Collection[str], among: Iterable[str]) -> str:
    """Name servos by what stands for them in the file, among all that is kept of an adapter."""
    ids = [int(key) for key in keys if key != remembered.ALL]
    everyone = "all others" if any(key != remembered.ALL for key in among) else "all servos"
    return ", ".join([shown_ids(ids)] * bool(ids) + [everyone] * (remembered.ALL in keys))
