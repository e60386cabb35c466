"""What the workbench's copied code gives: Python in this process, and commands as the command line runs them."""

from __future__ import annotations

import json
import shlex

import pytest

from photosite.cli.main import run

_SHOWN = ("print(", "found.plot", "table.plot", "cal.report")


def executed(code: str) -> dict:
    """Run code without what it prints and draws; return its names."""
    names: dict = {}
    exec("\n".join(line for line in code.splitlines() if not line.startswith(_SHOWN)), names)
    return names


def json_of(command: str, capsys: pytest.CaptureFixture[str]) -> dict:
    """Run a photosite command with --json; return its object."""
    words = shlex.split(command)
    assert words[0] == "photosite"
    assert run([*words[1:], "--json"]) == 0
    return json.loads(capsys.readouterr().out)
