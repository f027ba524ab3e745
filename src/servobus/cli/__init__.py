"""The command line: one file per verb, or per few verbs that belong together.

Nothing is imported here: `servobus --help` loads click alone, and each verb loads what it needs when it runs.
"""

import io
import sys


def main() -> None:
    """Run the command line; the console script `servobus`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Where ° cannot be written something else is; that is no reason to fail.
            stream.reconfigure(errors="replace")
    try:
        from servobus.cli.app import app  # noqa: PLC0415 - see above

        app(prog_name="servobus")
    except KeyboardInterrupt:
        # Ctrl-C while modules are still loading: nothing has been sent yet.
        sys.exit(130)
