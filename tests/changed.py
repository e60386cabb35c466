"""Print the tests that a change can reach: files of tests, and modules with examples, that import what changed.

Imports are followed from module to module; a test that runs a command imports it, a test with a fixture what the
fixture names. Changed files are those that differ from a commit, main unless another is given. The tests of the
architecture are always among them.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "helpers"))

from import_graph import MODULES, SOURCE, imports, module_of, names_in

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests"
HOOKS = {"photosite", "photosite.cli.main", "photosite.values.shown", "photosite.values.saved"}
"""Modules that name others for whoever asks; a test depends on those that it uses."""
EVERYTHING = {"pyproject.toml", "tests/conftest.py"}


def changed_files(base: str) -> set[Path]:
    """Return the files that differ from the commit where the branch left `base`, and the untracked ones."""

    def git(*call: str) -> list[str]:
        return subprocess.run(["git", *call], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")

    start = git("merge-base", base, "HEAD")[0].strip()
    named = git("diff", "--name-only", "-z", start) + git("ls-files", "--others", "--exclude-standard", "-z")
    return {ROOT / name for name in named if name}


@cache
def public_name(name: str) -> str:
    """Return where a public name is defined: photosite.camera.camera.Camera for photosite.Camera."""
    group, _, last = name.rpartition(".")
    stub = SOURCE.joinpath(*group.split(".")[1:], "__init__.pyi")
    if f"{group}.{last}" in MODULES or not stub.is_file():
        return name
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and last in {alias.name for alias in node.names}:
            return ".".join(filter(None, (group, node.module, last)))
    return name


def attributes(tree: ast.AST) -> Iterator[str]:
    """Yield the public names that code uses as `ps.name` or `ps.group.name`."""
    for node in ast.walk(tree):
        words: list[str] = []
        while isinstance(node, ast.Attribute):
            words.insert(0, node.attr)
            node = node.value
        if words and isinstance(node, ast.Name) and node.id in ("ps", "photosite"):
            yield public_name(f"photosite.{words[0]}")
            if len(words) > 1:
                yield public_name(f"{public_name(f'photosite.{words[0]}')}.{words[1]}")


@cache
def fixtures(folder: Path) -> dict[str, ast.FunctionDef]:
    """Return the functions of the conftest files that tests in a folder see."""
    found = fixtures(folder.parent).copy() if folder != TESTS else {}
    file = folder / "conftest.py"
    if file.is_file():
        functions = (
            node for node in ast.parse(file.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)
        )
        found |= {node.name: node for node in functions}
    return found


@cache
def own_modules(path: Path) -> frozenset[str]:
    """Return the modules that a file of tests names, without those that they import."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    words |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    found = {module_of(name) for name in {*names_in(path), *attributes(tree)}}
    for place in (path.parent, TESTS / "helpers"):
        for name in names_in(path):
            beside = place / f"{name.split('.')[0]}.py"
            if beside.is_file() and beside != path:
                found |= own_modules(beside)
    commands = {f"photosite.cli.{word}" for word in words | {f"{word}_" for word in words}}
    every = {"COMMANDS", "load_command", "cli"} & {name.rpartition(".")[2] for name in names_in(path)}
    found |= {name for name in MODULES if name in commands or (every and name.startswith("photosite.cli."))}
    return frozenset(found - {""})


def fixture_modules(path: Path) -> set[str]:
    """Return the modules that the fixtures of a file of tests name."""
    known = fixtures(path.parent)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    todo = [node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)]
    todo += [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    todo += [name for name, node in known.items() if "autouse=True" in "".join(map(ast.unparse, node.decorator_list))]
    found: set[str] = set()
    seen: set[str] = set()
    while todo:
        name = todo.pop()
        if name in known and name not in seen:
            seen.add(name)
            todo += [node.arg for node in ast.walk(known[name]) if isinstance(node, ast.arg)]
            found |= {module_of(used) for used in attributes(known[name])}
            for node in ast.walk(known[name]):
                if isinstance(node, ast.ImportFrom):
                    found |= {module_of(f"{node.module}.{alias.name}") for alias in node.names}
    conftests = (folder / "conftest.py" for folder in path.parents if TESTS in folder.parents)
    return found.union(*(own_modules(file) for file in conftests if file.is_file())) - {""}


def affected(changed: set[str]) -> set[str]:
    """Return the modules that import changed ones, directly or not, and these."""
    found = set(changed)
    while more := {name for name in MODULES if name not in found | HOOKS and imports(name) & found}:
        found |= more
    return found


def reachable_tests(files: set[Path]) -> list[Path]:
    """Return files of tests and modules whose examples to run."""
    if any(str(file.relative_to(ROOT)) in EVERYTHING for file in files):
        return [TESTS, SOURCE]
    changed = {module for module, path in MODULES.items() if path in files}
    data = {file for file in files if SOURCE in file.parents and file.suffix not in (".py", ".pyi")}
    changed |= {module for module, path in MODULES.items() if any(path.parent in file.parents for file in data)}
    modules = affected(changed)
    tests = [path for path in TESTS.rglob("test_*.py") if path.parent.name != "architecture"]
    chosen = {TESTS / "architecture"}
    helpers = {file for file in files if TESTS in file.parents} - set(tests)
    for test in tests:
        text = test.read_text(encoding="utf-8")
        if modules & (own_modules(test) | fixture_modules(test)) or any(file.stem in text for file in helpers):
            chosen.add(test)
    chosen |= files & set(tests)
    return sorted(chosen | {MODULES[name] for name in modules if ">>>" in MODULES[name].read_text(encoding="utf-8")})


if __name__ == "__main__":
    print(
        *(
            path.relative_to(ROOT)
            for path in reachable_tests(changed_files(sys.argv[1] if len(sys.argv) > 1 else "main"))
        )
    )
