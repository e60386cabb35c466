"""The command `photosite`: the table of commands, exit statuses, errors and warnings in one line each.

A command's module is imported only when that command runs, so that `photosite --help` starts fast.
"""

from __future__ import annotations

import errno
import gc
import importlib
import io
import keyword
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from types import FrameType
from typing import NoReturn, TextIO

import click

import photosite
from photosite.cli.command import Group, spelling_of_current_command
from photosite.engine.process import prepare_process
from photosite.errors import PhotositeError, PhotositeWarning, printable, shortened_path

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
"""128 + SIGINT, as shells return."""
EXIT_BROKEN_PIPE = 1
"""As click ends where the reader of the output has gone."""

COMMANDS = {
    "demo": "Run the whole loop on a virtual D200: frames, calibration, simulation, comparison, report.",
    "sensors": "List, make, show, check and export sensor files.",
    "cameras": "List cameras from profile files; check contributed ones.",
    "optics": "Check optics files; print what they hold and the MTF.",
    "scenes": "List the built-in scenes; show scenes and scene files.",
    "convert": "Reduce a spectral image to a scene of few basis spectra, and write it.",
    "render": "Render a Mitsuba 3 scene to spectral radiance.",
    "simulate": "Simulate a raw frame of a scene.",
    "sweep": "Measure a camera for all combinations of values of its fields.",
    "dataset": "Write pairs of clean and noisy frames for training.",
    "worker": "Start workers for the tasks of a Dask scheduler.",
    "shoot": "Simulate a measurement: the dark frames and flat fields of a calibration.",
    "plan": "Plan a measurement: frames needed for a precision, precision reached by a protocol.",
    "calibrate": "Estimate a sensor's parameters from dark frames and flat fields.",
    "explain": "Explain a diagnostic of a calibration or measurement, by its id.",
    "temperature": "Measure the doubling temperature of the dark current.",
    "emgain": "Measure gain and excess noise of an EMCCD's multiplication register.",
    "polarizers": "Measure angle and extinction ratio of the polarizers on the pixels.",
    "spectral": "Measure quantum efficiency from narrow bands and a photodiode, or from a chart.",
    "export": "Write noise profiles and EMVA 1288 files for other programs.",
    "import": "Read noise profiles of other programs, also into sensor files.",
    "validate": "Compare measured with simulated raw frames of a chart.",
    "compare": "Compare another simulator's patches or mosaics with photosite's.",
    "develop": "Develop a raw frame to a picture.",
    "measure": "Measure image quality on frames of a chart.",
    "mtf": "Measure sharpness on a slanted edge in a raw frame.",
    "serve": "Serve the workbench, a page in the browser on this machine.",
    "reproduce": "Repeat the studies, such as the coverage of the intervals.",
    "bench": "Time photosite on this machine against a plain implementation.",
}
"""Commands, each a module of this folder, with their lines of help."""


def load_command(name: str) -> click.Command:
    """Import and return a command: `command` in the module of its name (`import_` for `import`)."""
    module = f"{name}_" if keyword.iskeyword(name) else name
    command: click.Command = importlib.import_module(f"photosite.cli.{module}").command
    return command


class LazyGroup(Group):
    """A group whose commands are imported when they run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the table's order: the order of use."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command."""
        if cmd_name not in COMMANDS:
            return None
        _check_address_space()
        if not sys.flags.dev_mode:
            _discard_logs()
        return load_command(cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table; no command is imported for it."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


_SMALL_MATRICES = frozenset({"calibrate"})
"""Commands of small matrices: threads of OpenBLAS would wait for the next one, on the cores that decode frames."""

_LEAST_ADDRESS_SPACE_KB = 1_500_000
"""A small calibration takes 1.39 million kB while LLVM compiles its kernels (docs/validation/faults.md)."""


def _check_address_space() -> None:
    """Refuse a limit of the address space below which C libraries end the process: LLVM, OpenBLAS, the C library."""
    try:
        import resource
    except ImportError:  # Windows
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < _LEAST_ADDRESS_SPACE_KB * 1024:
        least = f"must be {_LEAST_ADDRESS_SPACE_KB} kB or more, got {limit // 1024} kB"
        raise click.ClickException(f"the limit of virtual memory {least}. Raise it with ulimit -v")


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(photosite.__version__, message="photosite %(version)s")
def cli() -> None:
    """Measure image sensors and simulate the cameras around them.

    Dark frames and flat fields give a sensor file. A spectral scene, a lens and that file give simulated raw frames.
    Measured and simulated frames are compared.

    Every command takes --help. Results go to standard output, messages to standard error. A wrong call or bad input
    gives one line there, and exit status 2.
    """


def main() -> NoReturn:
    """Run the console script."""
    for name in ("SIGTERM", "SIGHUP"):  # Windows has no SIGHUP; nohup ignores it
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _terminated)
    _open_closed_streams()
    if _SMALL_MATRICES.intersection(sys.argv[1:2]):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported
    prepare_process()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal's encoding may lack characters of names and units
            stream.reconfigure(errors="backslashreplace")
    if not sys.flags.dev_mode:
        _separate_messages()
    status = run(sys.argv[1:])
    try:
        sys.stdout.flush()
    except OSError as error:
        _discard(sys.stdout)
        status = status or _fail_with(error)
    try:
        sys.stderr.flush()
    except OSError:
        _discard(sys.stderr)
    gc.freeze()  # otherwise the interpreter searches all objects for cycles before it ends, for up to 0.3 s
    sys.exit(status)


def _open_closed_streams() -> None:
    """Open closed standard streams on the null device, also so that no file of a command gets their descriptors."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def _discard(stream: TextIO) -> None:
    """Send what is left in the buffer to the null device; it would fail once more when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _separate_messages() -> None:
    """Discard what C libraries write to standard error by its file descriptor.

    photosite's own lines go to a copy of the descriptor. `python -X dev -m photosite` shows all messages.
    """
    try:
        sys.stderr.flush()
        own, nowhere = os.dup(sys.stderr.fileno()), os.open(os.devnull, os.O_WRONLY)
    except (OSError, ValueError, AttributeError):  # closed
        return
    sys.stderr = open(own, "w", buffering=1, encoding=sys.stderr.encoding, errors="backslashreplace")  # noqa: SIM115
    os.dup2(nowhere, 2)
    os.close(nowhere)


def _discard_logs() -> None:
    """Discard what Python libraries log, which goes to standard error where no logging is set up."""
    import logging

    root = logging.getLogger()
    if not root.handlers:
        root.addHandler(logging.NullHandler())


def run(arguments: Sequence[str]) -> int:
    """Run a command line; every intended error becomes one line on standard error.

    Returns
    -------
    int
        The exit status: 0, 2 for a wrong call or bad input, 130 when interrupted.
    """
    with warnings.catch_warnings():
        if not sys.warnoptions:  # those of Python and libraries are for developers: python -W default -m photosite
            warnings.simplefilter("ignore")
        warnings.simplefilter("default", PhotositeWarning)
        warnings.showwarning = partial(_show_warning, warnings.showwarning, set())
        try:
            status = cli.main(list(arguments), prog_name="photosite", standalone_mode=False)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.message)
            return 0
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "photosite"
            return _fail(f"{_usage_message(error)} (see {command} --help)")
        except click.ClickException as error:
            return _fail(error.format_message())
        except PhotositeError as error:
            return _fail(str(error))
        except (KeyboardInterrupt, click.Abort):
            click.echo("photosite: interrupted", err=True)
            return EXIT_INTERRUPTED
        except OSError as error:
            return _fail_with(error)
        except MemoryError:
            return _fail(_NO_MEMORY)
        except RuntimeError as error:
            if "can't start new thread" not in str(error):  # Python gives no error number
                raise
            return _fail("no thread can be started: the limit of memory or of processes is too low (ulimit -v, -u)")
        except ImportError as error:
            if "failed to map segment" not in str(error):  # the dynamic loader gives no error number
                raise
            return _fail(_NO_MEMORY)
    return int(status) if isinstance(status, int) else 0


_NO_MEMORY = "the memory is not sufficient; close other programs, or take a smaller input"


def _usage_message(error: click.UsageError) -> str:
    """Return click's message as one clause: `--unit must be one of 'e', 'dn', got 'v'`."""
    message = error.format_message().rstrip(".")
    if not isinstance(error, click.BadParameter) or isinstance(error, click.MissingParameter):
        return message
    prefix = re.match(r"Invalid value for '?(?:-\w['/ ]+)*([^':]+)'?: ", message)
    if prefix is None:
        return message
    name, problem = prefix[1], message[prefix.end() :]
    for pattern, condition in _CONDITIONS:
        if found := re.fullmatch(pattern, problem):
            return f"{name} must be {condition.format(found['limit'].replace(chr(39), ''))}, got {found['value']}"
    return f"{name} {problem}" if problem.startswith("must be") else message


_CONDITIONS = (
    (r"(?P<value>'.*?') is not one of (?P<limit>.+)", "one of {}"),
    (r"(?P<value>'.*') is not a valid (?P<limit>.+?)(?: range)?", "a valid {}"),
)
"""What click says of an invalid value, and the condition in photosite's form."""


def _show_warning(
    default: Callable[..., None],
    shown: set[str],
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if isinstance(message, PhotositeWarning):
        text = _one_line(message.format(spelling_of_current_command()))
        if text not in shown:  # Python shows a warning once for each line of code that gives it
            shown.add(text)
            click.echo(f"photosite: warning: {text}", err=True)
    else:
        default(message, category, filename, lineno, file, line)


def _fail(message: str) -> int:
    with suppress(OSError):  # standard error on a full disk, or closed by its reader: the status says the rest
        click.echo(f"photosite: {_one_line(message)}", err=True)
    return EXIT_BAD_INPUT


def _fail_with(error: OSError) -> int:
    """Report an error of the operating system; a reader of the output that has ended, as `head`, needs no message."""
    if isinstance(error, BrokenPipeError):
        return EXIT_BROKEN_PIPE
    message = error.strerror or str(error)
    if error.filename is None:
        return _fail(f"the output cannot be written: {message}" if error.errno == errno.ENOSPC else message)
    return _fail(f"{shortened_path(os.fsdecode(error.filename))}: {message}")


def _one_line(message: str) -> str:
    return printable(" ".join(message.split()))


def _terminated(signum: int, frame: FrameType | None) -> NoReturn:
    """Unwind, so that temporary output is removed, with the exit status of shells."""
    sys.exit(128 + signum)
