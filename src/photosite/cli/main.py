"""The command `photosite`: which commands there are, and how every failure becomes one line.

A command's module is imported when that command is called, so that `photosite --help` answers at once.
"""

from __future__ import annotations

import importlib
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import NoReturn, TextIO

import click

import photosite
from photosite.errors import PhotositeError, PhotositeWarning, did_you_mean

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
"""128 + SIGINT, as shells have it."""
EXIT_TERMINATED = 143
"""128 + SIGTERM."""


@dataclass(frozen=True)
class Entry:
    """A command of the table: its module in this folder, and its line of help."""

    module: str
    summary: str


COMMANDS: dict[str, Entry] = {
    "demo": Entry("demo", "Close the loop on a virtual D200: shoot, calibrate, simulate, compare, report."),
    "sensors": Entry("sensors", "List, show, check and export sensor files."),
    "optics": Entry("optics", "Check optics files: what they hold, and the lens's contrast."),
    "scenes": Entry("scenes", "List the scenes by formula, look at scenes and their files."),
    "convert": Entry("convert", "Reduce a spectral image to a scene of few spectra, in a file."),
    "render": Entry("render", "Render a scene of Mitsuba 3, with units."),
    "simulate": Entry("simulate", "Simulate a raw frame of a scene."),
    "shoot": Entry("shoot", "Simulate a measurement: the dark and flat frames that a calibration needs."),
    "plan": Entry("plan", "How many frames a wanted precision takes; what precision a protocol reaches."),
    "calibrate": Entry("calibrate", "Estimate a sensor's parameters from dark and flat frames."),
    "spectral": Entry("spectral", "Measure quantum efficiency: bands of light and a photodiode, or a chart."),
    "export": Entry("export", "Write noise profiles and EMVA 1288 files for other programs."),
    "import": Entry("import_", "Read other programs' noise profiles, into sensor files too."),
    "validate": Entry("validate", "Compare measured with simulated raw frames of a chart."),
    "compare": Entry("compare", "Compare another simulator's patches or mosaics with photosite's."),
    "develop": Entry("develop", "Make a picture of a raw frame."),
    "reproduce": Entry("reproduce", "Run studies anew: whether intervals cover the truth."),
    "bench": Entry("bench", "Time photosite on this machine, beside the plain way to do the same work."),
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the table's order: the order in which one meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command, imported now; every module calls its own `command`."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"photosite.cli.{COMMANDS[cmd_name].module}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click's, but an unknown command is told which was probably meant."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(f"no command '{args[0]}'; {did_you_mean(args[0], COMMANDS)}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table itself; nothing is imported for it."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(photosite.__version__, message="photosite %(version)s")
def cli() -> None:
    """Measure image sensors and simulate the cameras around them.

    Frames of darkness and of flat light become a sensor file; a spectral scene, a lens and that file become
    simulated raw frames; measured and simulated frames are compared.

    Every command takes --help. Results go to standard output, messages to standard error; a wrong call or bad
    input is one line there, and exit status 2.
    """


def main() -> NoReturn:
    """The entry point of the console script."""
    signal.signal(signal.SIGTERM, _terminated)
    sys.exit(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run a command line; what was raised on purpose becomes one line on standard error.

    Returns
    -------
    int
        The exit status: 0, 2 for a wrong call or bad input, 130 when interrupted.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", PhotositeWarning)
        warnings.showwarning = partial(_show_warning, warnings.showwarning)
        try:
            status = cli.main(list(arguments), prog_name="photosite", standalone_mode=False)
        except PhotositeError as error:
            return _fail(str(error))
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "photosite"
            return _fail(f"{error.format_message()} ({command} --help says more)")
        except click.ClickException as error:
            return _fail(error.format_message())
        except (KeyboardInterrupt, click.Abort):
            click.echo("photosite: interrupted", err=True)
            return EXIT_INTERRUPTED
    return int(status) if isinstance(status, int) else 0


def _show_warning(
    default: Callable[..., None],
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if issubclass(category, PhotositeWarning):
        click.echo(f"photosite: warning: {_one_line(str(message))}", err=True)
    else:
        default(message, category, filename, lineno, file, line)


def _fail(message: str) -> int:
    click.echo(f"photosite: {_one_line(message)}", err=True)
    return EXIT_BAD_INPUT


def _one_line(message: str) -> str:
    return " ".join(message.split())


def _terminated(signum: int, frame: FrameType | None) -> NoReturn:
    """Unwind, so that half-written output is removed."""
    sys.exit(EXIT_TERMINATED)
