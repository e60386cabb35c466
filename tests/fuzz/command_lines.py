"""Command lines from the grammar of the commands: valid and invalid values of every option, run in this process."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import click

from photosite.cli.main import COMMANDS, load_command, run

LEFT_OUT = {"serve", "worker", "bench", "reproduce", "demo", "render"}
"""Commands that run until they are stopped or for minutes, or need programs that are not always there."""

_LEFT_OUT_OPTIONS = {"--dask", "--help", "--version"}

_HOSTILE = """0 -0 -1 1e300 -1e300 5e-324 1e-40 1e40 nan inf -inf 1e999 0x10 1_000 1/0 1/3 0/0 1e9 1e-9 65536 4294967296
18446744073709551616 1e400 abc true [] {} [[1,2],[3]] {a:1} ~ = , : :: 1:2 1,2 1,,2 400:700:10 400:700:0 700:400:10
400:1e300:1 1:2:1e-300 400,500 400,400 0,0 1,1,1 nan,nan 100Hz:0.2 1e300Hz:0.2 100Hz:duty=0.5 100Hz:duty=1e300 -- - . ..
/ /dev/null /dev/zero * %s{0} é"""
HOSTILE = [*_HOSTILE.split(), "", " ", "\x1b[31m", "\udcff", "x" * 5000, "9" * 400, "[" * 300, "../" * 2000]

_PLAIN = {
    "NAME=VALUE": "read_noise_e=3 prnu_percent=0.5 width_um=5 fill_factor=0.5 bits=14 serial='2' well_capacity_e=1e4 "
    "contrast=10 cycles=8 rows=2 angle_deg=5 transmittance=0.9 falloff=cos4 tolerance=0.01 patches=3 no_data=zero "
    "telegraph_noise={fraction:0.01,amplitude_e:20} captures=null method=jakob-hanika",
    "NAME|FILE": "nikon-d200 vendor-2.2um google-pixel-4a sony-imx174 macbeth slanted-edge siemens-star uniform",
    "NAME": "A D65 3200K FL2 R G light darkest",
    "TIME": "1/100 0.01 10ms 30",
    "TIME|auto": "1/100 auto 1/8000",
    "TIME[:TIME]": "1/100 1/1000:1/30",
    "X[:X]": "1 0.1:1",
    "ROWSxCOLS": "8x8 12x16",
    "PARAMETER=X": "prnu_percent=2% read_noise_e=0.05 system_gain_dn_per_e=1%",
    "KIND:EXPOSURE:FRAMES": "dark:1/8000:50 light:1/50:5 dark:1/100:2",
    "HZ:DEPTH": "100Hz:0.2 250Hz:duty=0.3",
    "ROWS,COLS": "5,5 0,100 1,2,3",
    "TILE": "rggb mono RRGG/RRGG/GGBB/GGBB",
    "UNITS": "W/sr/m2/nm reflectance percent radiance",
    "NM": "400:700:10 450,550",
    "REGEX": "t([0-9]+) ( (a+)+b",
    "C,C,...": "15,25 20",
    "FIRST:LAST": "400:700 500:600",
}
"""Values that are often valid, by the metavar of the option."""

_NUMBERS = "0.5 1 2 8 50 0.01 100 1000"
_OUTPUTS = "dng tif png h5 html pdf yaml csv json"
_SMALL = ("1", "2", "3", "12")
_COUNTS = {"--frames", "--processes", "--cells", "--chips", "--crops", "--draws", "--averaged", "--pairs-per-shard"}
"""Counts of work that the user asks for: small ones, and invalid ones."""
_INVALID_COUNTS = ["0", "-1", "abc", "1e300", "1.5", ""]
_SIZES = {"--rows": "12", "--cols": "16"}
_MOST_OPTIONS = 6


def commands() -> dict[tuple[str, ...], click.Command]:
    """Return all commands and subcommands that are fuzzed, by their words."""
    found: dict[tuple[str, ...], click.Command] = {}
    for name in COMMANDS:
        if name in LEFT_OUT:
            continue
        command = load_command(name)
        if isinstance(command, click.Group):
            context = click.Context(command)
            found |= {(name, sub): command.get_command(context, sub) for sub in command.list_commands(context)}
        found[(name,)] = command
    return found


class Grammar:
    """Draws command lines; `folder` holds the files that they name."""

    def __init__(self, folder: Path) -> None:
        self._commands = commands()
        self._words = sorted(self._commands)
        self._files = [*sorted(p.name for p in folder.iterdir()), "pipe.tif", "gone.yaml"]

    def draw(self, rng: random.Random) -> list[str]:
        """Return the arguments of one command."""
        words = rng.choice(self._words)
        command = self._commands[words]
        options = [p for p in command.params if isinstance(p, click.Option) and not _LEFT_OUT_OPTIONS & set(p.opts)]
        line = [*words]
        chosen = rng.sample(options, min(len(options), rng.randrange(_MOST_OPTIONS)))
        given = {name for option in chosen for name in option.opts}
        for option in options:
            if option.required and option not in chosen:
                chosen.append(option)
            for name, size in _SIZES.items():
                if name in option.opts and name not in given:
                    line += [name, size]
        for option in chosen:
            line += self._option(option, rng)
        for argument in (p for p in command.params if isinstance(p, click.Argument)):
            count = 1 if argument.nargs == 1 else rng.choice((1, 1, 2, 3))
            line += [self._file(rng) if rng.random() < 0.9 else rng.choice(HOSTILE) for _ in range(count)]
        if rng.random() < 0.05:
            line.insert(rng.randrange(len(line) + 1), rng.choice(HOSTILE))
        return line

    def _option(self, option: click.Option, rng: random.Random) -> list[str]:
        name = rng.choice(option.opts)
        if option.is_flag:
            return [name]
        count = rng.choice((1, 1, 2)) if option.multiple else 1
        return [part for _ in range(count) for part in (name, *(self._value(option, rng) for _ in range(option.nargs)))]

    def _value(self, option: click.Option, rng: random.Random) -> str:
        metavar, names = option.metavar or "", set(option.opts)
        if names & _COUNTS or names & set(_SIZES):
            return rng.choice(_SMALL if rng.random() < 0.7 else _INVALID_COUNTS)
        hostile = rng.random() < 0.4
        if "-o" in names or {"--preview", "--report", "--figure", "--clean", "--into", "--checkpoint"} & names:
            return rng.choice(HOSTILE) if hostile else f"out.{rng.choice(_OUTPUTS.split())}"
        if isinstance(option.type, click.Choice) and not hostile:
            return rng.choice(list(map(str, option.type.choices)))
        if "=" in metavar and hostile and rng.random() < 0.8:
            field = rng.choice(_PLAIN[metavar if metavar in _PLAIN else "NAME=VALUE"].split()).split("=")[0]
            return f"{field}={rng.choice(HOSTILE)}"
        if hostile:
            return rng.choice(HOSTILE)
        if "FILE" in metavar and rng.random() < 0.6:
            return self._file(rng)
        return rng.choice(_PLAIN.get(metavar, _NUMBERS).split())

    def _file(self, rng: random.Random) -> str:
        return rng.choice(self._files)


def outcome(line: list[str], folder: Path) -> str:
    """Run a command in a copy of the folder, and return "read" if it succeeds, "refused" if it fails as it should.

    Raises
    ------
    AssertionError
        If the exit status is neither 0 nor 2, a failure is not one line, or JSON holds nan.
    Exception
        Whatever the command raises.
    """
    place = folder.with_name(folder.name + "-run")
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder, place, symlinks=True)
    os.mkfifo(place / "pipe.tif")
    out, err = io.StringIO(), io.StringIO()
    with _within(place), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(line)
    assert status in (0, 2), f"exit status {status}: {err.getvalue()[-300:]}"
    lines = [text for text in err.getvalue().splitlines() if text.startswith("photosite: ")]
    errors = [text for text in lines if not text.startswith("photosite: warning: ")]
    if status == 2:
        assert errors, f"status 2 without a line: {err.getvalue()[-300:]}"
        assert len(errors[-1]) < 20_000, f"an error of {len(errors[-1])} letters"
    if status == 0 and "--json" in line and out.getvalue().strip():
        json.loads(out.getvalue(), parse_constant=_refuse)
    assert not set(map(ord, out.getvalue() + err.getvalue())) & {0x1B, 0x07, 0x9B}, "a control character is printed"
    return "read" if status == 0 else "refused"


def _refuse(constant: str) -> float:
    raise AssertionError(f"{constant} in JSON")


@contextlib.contextmanager
def _within(place: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(place)
    try:
        yield
    finally:
        os.chdir(before)
