"""All verbs of the command line, those inside groups as "robot check"."""

from collections.abc import Iterator

from servobus.cli.app import VerbGroup, app


def _paths(group: VerbGroup, before: str = "") -> Iterator[str]:
    for name in group.places:
        command = group.get_command(None, name)  # type: ignore[arg-type] # the context is not looked at
        yield before + name
        if isinstance(command, VerbGroup):
            yield from _paths(command, f"{before}{name} ")


assert isinstance(app, VerbGroup)
NAMES = list(app.places)
"""The verbs behind `servobus`."""
PATHS = list(_paths(app))
"""The same, and those of the groups among them."""
EXPLAINED = [path for path in PATHS if not any(other.startswith(f"{path} ") for other in PATHS)]
"""Those that do something: all but groups."""
