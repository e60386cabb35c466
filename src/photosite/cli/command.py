"""The command classes that every command uses: errors are written with the command's own options."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import click

from photosite.errors import PhotositeError, PythonSpelling, Spelling, did_you_mean


class NameValueOption(click.Option):
    """A repeatable option NAME=VALUE that carries arguments without an option of their own."""

    def carries(self, field: str) -> bool:
        """Return whether an argument of the library is given through this option."""
        raise NotImplementedError


class OptionSpelling:
    """Arguments of the library as options of a command.

    The name of each parameter of a command is the name of the library's argument, so that the command's own list of
    parameters is the map from argument to option.

    Examples
    --------
    >>> option = click.Option(["--luminance", "mean_luminance_cd_m2"], type=float)
    >>> OptionSpelling(click.Command("show", params=[option])).argument("mean_luminance_cd_m2", 100)
    '--luminance 100'
    """

    def __init__(self, command: click.Command) -> None:
        self._parameters = {parameter.name: parameter for parameter in command.params}
        self._carriers = [entry for entry in command.params if isinstance(entry, NameValueOption)]

    def name(self, field: str) -> str:
        """Return the option that sets an argument, such as `--exposure`."""
        parameter = self._parameters.get(field) or self._parameters.get(f"{field}s")  # plural: a repeatable option
        if parameter is not None:
            return _flag(parameter)
        carrier = self._carrier(field)
        return field if carrier is None else f"{_flag(carrier)} {field}"

    def argument(self, field: str, value: Any) -> str:
        """Return the option with its value, such as `--exposure 0.01`."""
        parameter = self._parameters.get(field)
        if isinstance(parameter, click.Option) and parameter.is_flag:
            return _flag(parameter)
        if parameter is not None:
            spell = getattr(parameter.type, "spell", _text)
            words = value if parameter.nargs > 1 else [value]
            return " ".join([_flag(parameter), *(shlex.quote(spell(word)) for word in words)])
        carrier = self._carrier(field)
        if carrier is None:
            return PythonSpelling().argument(field, value)
        return f"{_flag(carrier)} {shlex.quote(f'{field}={_yaml(value)}')}"

    def _carrier(self, field: str) -> NameValueOption | None:
        return next((entry for entry in self._carriers if entry.carries(field)), None)


def _flag(parameter: click.Parameter) -> str:
    if isinstance(parameter, click.Option):
        return max(parameter.opts, key=len)
    return parameter.human_readable_name


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(_text(entry) for entry in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"[{_text(value)}]" if isinstance(value, list | tuple) else _text(value)


def spelling_of_current_command() -> Spelling:
    """Return the spelling of the command that runs; Python's where none does."""
    context = click.get_current_context(silent=True)
    return PythonSpelling() if context is None else OptionSpelling(context.command)


@contextmanager
def _errors_in_options(command: click.Command) -> Iterator[None]:
    try:
        yield
    except PhotositeError as error:
        raise click.ClickException(error.format(OptionSpelling(command))) from error


_FORCE = "photosite.force"


def writes_file(parser: Callable[[str], Path]) -> Callable[[str], Path]:
    """Mark the parser of a file that a command writes: such a command has --force."""
    parser.writes_file = True  # type: ignore[attr-defined]
    return parser


def overwrites() -> bool:
    """Return whether the current command has --force."""
    context = click.get_current_context(silent=True)
    return context is None or bool(context.meta.get(_FORCE))


def _note_force(context: click.Context, _: click.Parameter, given: bool) -> None:
    context.meta[_FORCE] = given


class Command(click.Command):
    """A command whose errors are written with its options; with --force, if it writes files."""

    shows_time = True
    """Whether a terminal shows for how long it works."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        if any(hasattr(getattr(parameter.type, "func", None), "writes_file") for parameter in self.params):
            # Eager: known before the files are checked.
            force = click.Option(["--force"], is_flag=True, is_eager=True, expose_value=False, callback=_note_force)
            force.help = "Overwrite files that exist."
            self.params.append(force)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does."""
        with _errors_in_options(self):
            try:
                return super().parse_args(ctx, args)
            except click.UsageError as error:
                error.ctx = error.ctx or ctx  # some of click's errors do not name the command
                raise

    def invoke(self, ctx: click.Context) -> Any:
        """Run as click does; on a terminal, show that a long command works."""
        from photosite.cli.output import working

        silent = isinstance(self, click.Group) or not self.shows_time
        with _errors_in_options(self), nullcontext() if silent else working(ctx.command_path):
            return super().invoke(ctx)


class Group(Command, click.Group):
    """A group of such commands; a misspelled subcommand gets the most similar one as a hint."""

    command_class = Command
    group_class = type

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the subcommands in the order of their definition."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the subcommand as click does."""
        known = self.list_commands(ctx)
        if args[0] not in known and not args[0].startswith("-"):
            called = f"{self.name} {args[0]}" if ctx.parent is not None else args[0]
            raise click.UsageError(f"no command '{called}'. {did_you_mean(args[0], known)}", ctx)
        return super().resolve_command(ctx, args)
