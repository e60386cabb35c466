"""The command's frame: help, versions, exit statuses, warnings, interruptions."""

from __future__ import annotations

import importlib
import os
import shlex
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import click
import pytest

import photosite as ps
from photosite.cli import main
from photosite.cli.main import COMMANDS, load_command
from photosite.errors import PhotositeWarning
from photosite.sensor.io.sensor_file import dump_sensor


def test_help_names_every_command(photosite: Any) -> None:
    shown = photosite("--help")
    assert shown.status == 0
    assert all(f"  {name} " in shown.out for name in COMMANDS)
    assert shown.err == ""


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from photosite.cli.main import run; status = run(['--help']);"
        "heavy = {'pydantic', 'numba', 'colour', 'scipy', 'matplotlib'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("arguments", [[], ["optics"], ["reproduce"], ["scenes"], ["sensors"]])
def test_bare_groups_print_their_help(photosite: Any, arguments: list[str]) -> None:
    shown = photosite(*arguments)
    asked = photosite(*arguments, "--help")
    assert (shown.status, shown.err) == (0, "")
    assert shown.out == asked.out


def test_shell_completion() -> None:
    code = "import sys; sys.argv = ['photosite']; from photosite.cli.main import main; main()"
    given = {"_PHOTOSITE_COMPLETE": "bash_complete", "COMP_WORDS": "photosite sim", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | given, capture_output=True, text=True, check=True
    )
    assert done.stdout == "plain,simulate\n"


def _leaves() -> list[tuple[str, click.Command]]:
    found = []
    for name in COMMANDS:
        command = load_command(name)
        found.append((name, command))
        if isinstance(command, click.Group):
            found += [(f"{name} {sub}", command.commands[sub]) for sub in command.commands]
    return found


@pytest.mark.parametrize(("name", "command"), _leaves())
def test_every_command_explains_itself(photosite: Any, name: str, command: click.Command) -> None:
    shown = photosite(*name.split(), "--help")
    assert shown.status == 0
    assert f"Example: photosite {name.split()[0]}" in shown.out
    assert [p.name for p in command.params if isinstance(p, click.Option) and not p.help] == []


def test_version(photosite: Any) -> None:
    assert photosite("--version").out == f"photosite {ps.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["simulat"], "Did you mean 'simulate'?"),
        (["sensors", "shw"], "Did you mean 'show'?"),
        (["sensors", "lst"], "Did you mean 'list'?"),
        (["sensors", "zzz"], "Known are: list, show"),
        (["simulate", "--sead", "3"], "--seed"),
        (["simulate", "--seed", "-1"], "--seed must be a whole number, 0 to 2^64-1, got -1"),
        (["shoot", "--rows", "x"], "--rows must be a whole number, 1 or more, got x"),
        (["compare", "a.csv", "--unit", "v"], "--unit must be one of e, dn, got 'v'"),
        (["shoot"], "--output"),
    ],
)
def test_wrong_call_is_one_line(photosite: Any, arguments: list[str], said: str) -> None:
    wrong = photosite(*arguments)
    assert (wrong.status, wrong.out, wrong.err.count("\n")) == (2, "", 1)
    assert wrong.err.startswith("photosite: ")
    assert said in wrong.err


def _command_that(monkeypatch: pytest.MonkeyPatch, does: Any) -> None:
    module = importlib.import_module("photosite.cli.simulate")
    monkeypatch.setattr(module, "command", click.Command("simulate", callback=does))


def test_interruption(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    _command_that(monkeypatch, interrupted)
    stopped = photosite("simulate")
    assert (stopped.status, stopped.err.strip()) == (130, "photosite: interrupted")  # after the terminal's ^C


def test_warning_is_one_line(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where two lines of code give it."""

    def warns() -> None:
        warnings.warn("two\nlines", PhotositeWarning, stacklevel=1)
        warnings.warn("two\nlines", PhotositeWarning, stacklevel=1)

    _command_that(monkeypatch, warns)
    shown = warnings.showwarning
    warned = photosite("simulate")
    assert (warned.status, warned.err) == (0, "photosite: warning: two lines\n")
    assert warnings.showwarning is shown


def test_bugs_escape(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ZeroDivisionError

    _command_that(monkeypatch, broken)
    with pytest.raises(ZeroDivisionError):
        main.run(["simulate"])


def called(*arguments: str, shell: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a shell; `shell` follows it."""
    line = f"set -o pipefail; {sys.executable} -m photosite {shlex.join(arguments)} {shell}"
    return subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        env=os.environ | environment,
    )


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of the address space")
def test_a_limit_of_virtual_memory_that_ends_libraries_is_refused() -> None:
    line = f"ulimit -v 800000; {sys.executable} -m photosite sensors list"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "ulimit -v" in done.stderr


def test_threads_that_cannot_be_started(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr("photosite.sensor.io.sensor_file.preset_names", fails)
    done = photosite("sensors", "list")
    assert (done.status, done.err.count("\n")) == (2, 1)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full and bash")
def test_output_that_cannot_be_written_is_one_line() -> None:
    done = called("sensors", "list", shell="> /dev/full")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="needs bash")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_standard_streams(tmp_path: Path, closed: str) -> None:
    file = tmp_path / "a.sensor.yaml"
    assert called("sensors", "export", "nikon-d200", "-o", str(file), shell=closed).returncode == 0
    assert ps.load_sensor(file) == ps.load_sensor("nikon-d200")
    done = called("sensors", "check", "missing.yaml", shell=closed)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full and bash")
def test_neither_output_nor_its_error_can_be_written() -> None:
    assert called("sensors", "list", shell="> /dev/full 2>&1").returncode == 2


def test_a_reader_that_ends_gets_no_message() -> None:
    done = called("sensors", "schema", shell="| true")
    assert done.returncode in (0, 1)
    assert done.stderr == ""


def test_characters_that_the_encoding_lacks_are_escaped() -> None:
    done = called("sensors", "check", "µ€.yaml", PYTHONIOENCODING="latin-1")
    assert done.returncode == 2
    assert "\\u20ac" in done.stderr


@pytest.mark.parametrize("name", ["a" * 5000, f"{'a' * 300}/b"])
def test_names_that_the_system_refuses_are_one_line(photosite: Any, name: str) -> None:
    shown = photosite("calibrate", name)
    assert shown.status == 2
    assert shown.err.count("\n") == 1
    assert len(shown.err) < 500


def test_control_characters_do_not_reach_the_terminal(photosite: Any, tmp_path: Any) -> None:
    """An escape sequence in a file's name, in its content, and in what a command reports of it."""
    path = tmp_path / "a\x1b]0;title\x07.sensor.yaml"
    path.write_text('photosite_sensor: 1\n"na\\e[31mme": 1\n')
    shown = photosite("sensors", "check", str(path))
    assert shown.status == 2
    assert not set(shown.err) & {"\x1b", "\x07"}
    sensor = tmp_path / "named.sensor.yaml"
    sensor.write_text(dump_sensor(ps.load_sensor("nikon-d200")).replace("name: ", 'name: "\\e[31mred" #', 1))
    shown = photosite("sensors", "show", str(sensor))
    assert "\x1b" not in shown.out
