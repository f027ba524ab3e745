"""The command line: one file per verb, or per few verbs that belong together.

Nothing is imported here: `servobus --help` loads click alone, and each verb loads what it needs when it runs.
"""

import io
import os
import sys


def main() -> None:
    """Run the command line; the console script `servobus`."""
    _replace_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Where ° cannot be written something else is; that is no reason to fail.
            stream.reconfigure(errors="replace")
    try:
        from servobus.cli.app import app  # noqa: PLC0415 - see above

        if "_SERVOBUS_COMPLETE" in os.environ:
            from servobus.cli import complete_bash  # noqa: F401, PLC0415 - only the Tab key needs it
        app(prog_name="servobus")
    except KeyboardInterrupt:
        # Ctrl-C while modules are still loading: nothing has been sent yet.
        sys.exit(130)


def _replace_closed_streams() -> None:
    """Let what a shell has closed (`>&-`) lead nowhere: Python has None in its place.

    In the order of their numbers, which a port would get otherwise: what is printed would go to it.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
