"""Each command has a smoke test; the smoke tests of public names are their examples (tests/conftest.py)."""

from __future__ import annotations

import ast
from pathlib import Path

import click

from photosite.cli.main import COMMANDS, load_command

TESTS = Path(__file__).parents[1]


def commands() -> set[str]:
    found = set()
    for name in COMMANDS:
        command = load_command(name)
        subcommands = command.commands if isinstance(command, click.Group) else ()
        found |= {f"{name} {inner}" for inner in subcommands}
        found |= {name} if command.params or not subcommands else set()  # a group with options works by itself
    return found


def smoke_tests() -> dict[str, ast.FunctionDef]:
    """Return the test that a marker `smoke` assigns to a command."""
    return {
        argument.value: node
        for path in TESTS.rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.smoke"
        for argument in decorator.args
        if isinstance(argument, ast.Constant)
    }


def test_every_command_has_a_smoke_test_that_names_it() -> None:
    tests = smoke_tests()
    assert tests.keys() == commands()
    for command, test in tests.items():
        words = {node.value for node in ast.walk(ast.Module(test.body, [])) if isinstance(node, ast.Constant)}
        assert words >= set(command.split()), command
