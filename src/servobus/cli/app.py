"""The group of all verbs: which there are, how help lists them, and how errors are told.

A verb's module is imported when the verb is used. What help says about it stands here, so that help needs no verb.
"""

import importlib
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import click

from servobus.errors import ServobusError

VERBS: dict[str, dict[str, tuple[str, str]]] = {
    "Find": {
        "ports": ("reference:ports", "List the serial ports of this computer."),
        "scan": ("scan:scan", "Look for servos on a port."),
        "remember": ("remember:remember", "Keep which model a servo is that cannot say it."),
        "forget": ("remember:forget", "Keep no longer which model a servo is."),
    },
    "Look": {
        "doctor": ("doctor:doctor", "Find out what is wrong with a port and its servos."),
        "info": ("info:info", "Show all of a servo: data sheet, registers, alarms."),
        "read": ("read_write:read", "Read registers of servos, once or live."),
        "plot": ("curves:plot", "Draw readings as curves, live."),
        "sniff": ("sniff:sniff", "Show the traffic on a port, live."),
        "step": ("step:step", "Measure a step response, virtual or real."),
    },
    "Move": {
        "move": ("move:move", "Move servos to angles, together."),
        "turn": ("turn:turn", "Turn without end, and back to angles."),
        "stop": ("stop:stop", "Stop servos where they are."),
        "torque": ("stop:torque", "Switch torque on or off."),
        "rearm": ("rearm:rearm", "Torque again, after an alarm took it."),
        "led": ("led:led", "Switch a servo's light."),
    },
    "Change": {
        "write": ("read_write:write", "Write registers of servos."),
        "set-id": ("set_id_baud:set_id", "Give a servo another id."),
        "set-baud": ("set_id_baud:set_baud", "Set a servo to another speed."),
        "backup": ("backup:backup", "Save the settings of servos to files."),
        "restore": ("backup:restore", "Write saved settings back."),
        "reset": ("reset:reset", "Restore factory settings."),
        "reboot": ("reset:reboot", "Restart a servo."),
    },
    "Robot": {
        "robot": ("robots.group:robot", "Joints by name: make, check, show and move a robot."),
        "pose": ("robots.move:pose", "Save poses, and go to them."),
        "teach": ("robots.teach:teach", "Record a motion: limp joints moved by hand."),
        "play": ("robots.play:play", "Play a motion of a robot."),
        "teleop": ("robots.teleop:teleop", "Let one robot lead another."),
    },
    "Share": {
        "serve": ("serve:serve", "Own ports: pages, an API, and programs side by side."),
    },
    "Virtual servos": {
        "virtual": ("virtual:virtual", "Be servos, on a virtual port."),
        "replay": ("replay:replay", "Play a recording into virtual servos."),
        "demo": ("demo:demo", "See it all work, without hardware."),
    },
    "Learn": {
        "models": ("reference:models", "List the models known here."),
        "registers": ("registers:registers", "Show the register table of a model."),
        "decode": ("decode:decode", "Explain bytes, packet by packet."),
    },
}
"""heading -> verb -> where it is (module:function), and what help says of it."""


class CommandError(click.ClickException):
    """An error as people see it: one line, exit code 1."""

    def show(self, file: Any = None) -> None:
        click.echo(f"servobus: {self.message}", file=file, err=file is None)


class VerbGroup(click.Group):
    """A group that loads its commands when they are used.

    `verbs` has them by heading: verb -> where it is (module:function), and what help says of it.
    """

    verbs: ClassVar[Mapping[str, Mapping[str, tuple[str, str]]]] = {}

    @property
    def places(self) -> dict[str, str]:
        """Where each verb is."""
        return {name: where for verbs in self.verbs.values() for name, (where, _) in verbs.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.places)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in self.places:
            return None
        module, function = self.places[cmd_name].split(":")
        command: click.Command = getattr(importlib.import_module(f"servobus.cli.{module}"), function)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in self.places and not args[0].startswith("-"):
            import difflib  # noqa: PLC0415 - only ever needed for this message

            near = difflib.get_close_matches(args[0], self.places, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"`{ctx.command_path} --help` lists them all"
            raise click.UsageError(f"there is no command {args[0]!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        width = max(map(len, self.places))
        for heading, verbs in self.verbs.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), text) for name, (_, text) in verbs.items()])


class App(VerbGroup):
    """The group of all verbs, which tells errors in one line."""

    verbs = VERBS

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_help_text(ctx, formatter)
        formatter.write_paragraph()
        formatter.write("  No servo at hand? Try:\n    servobus demo\n    servobus scan virtual:rx28@1-3\n")

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except ServobusError as error:
            raise CommandError(str(error)) from error
        except BrokenPipeError:
            raise  # the program that read our output has closed the pipe; click ends without a message
        except OSError as error:
            raise CommandError(_explain(error)) from error
        except KeyboardInterrupt:
            click.echo(err=True)  # the terminal shows ^C: what comes next starts on a line of its own
            raise click.exceptions.Exit(130) from None
        except click.Abort as abort:
            click.echo(err=True)
            if isinstance(abort.__context__, EOFError):
                raise CommandError("nobody is there to confirm; nothing was changed (--yes goes ahead)") from abort
            raise click.exceptions.Exit(130) from None


def _explain(error: OSError) -> str:
    reason = error.strerror or str(error)
    if isinstance(error, FileNotFoundError) and error.filename is not None:
        return _explain_missing(Path(os.fsdecode(error.filename)))
    return f"{error.filename}: {reason}" if error.filename is not None else reason


def _explain_missing(path: Path) -> str:
    """Say what there is not, a file or its folder, and what can be done."""
    folder = path.absolute().parent
    if not folder.is_dir():
        return f"{path}: there is no folder {folder}; make it first, or name another file"
    import difflib  # noqa: PLC0415 - only ever needed for this message

    names = [one.name for one in folder.iterdir()] if os.access(folder, os.R_OK) else []
    near = difflib.get_close_matches(path.name, names, n=1)
    hint = f"did you mean {path.with_name(near[0])}?" if near else f"look for it in {folder}"
    return f"{path}: there is no such file; {hint}"


def _version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from servobus import __version__  # noqa: PLC0415 - here as everywhere in this file

        click.echo(f"servobus {__version__}")
        ctx.exit()


NEGATIVE = re.compile(r"-\.?\d")
"""Beginning of a word that is a negative number."""


class Verb(click.Command):
    """A command whose help ends with examples."""

    def __init__(self, *args: Any, examples: Sequence[str] = (), **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.examples = examples

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        # A negative number is a value, such as a signed byte, and no option.
        ctx.ignore_unknown_options = any(NEGATIVE.match(word) for word in args)
        try:
            return super().parse_args(ctx, args)
        except ServobusError as error:  # found before anything was opened: the command line is wrong
            raise click.UsageError(str(error), ctx) from error

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        if self.examples:
            with formatter.section("Examples"):
                for line in self.examples:
                    formatter.write(" " * formatter.current_indent + line + "\n")


@click.group(
    "servobus",
    cls=App,
    context_settings={"help_option_names": ["-h", "--help"]},
    subcommand_metavar="COMMAND ...",
    epilog="`servobus COMMAND --help` explains a command, with examples.",
)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show the version.")
def app() -> None:
    """Drive smart serial-bus servos, and be them.

    A PORT is a device path (/dev/ttyUSB0), COM4, socket://host:port, rfc2217://host:port, virtual:SPEC
    for virtual servos inside the command, such as virtual:rx28@1-4,lx16a@7, or servobus:///NAME for a bus that
    a server shares. Angles are degrees.
    """
