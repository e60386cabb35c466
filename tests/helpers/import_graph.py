"""Which modules of photosite name which: imports, in functions too, and names of modules in strings."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "src" / "photosite"


def module_name(path: Path) -> str:
    parts = ("photosite", *path.relative_to(SOURCE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(SOURCE.rglob("*.py"))}


@cache
def names_in(path: Path) -> frozenset[str]:
    """Return the dotted names that a file imports or has as a string, of modules or of what is in them."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            name = node.value.replace(":", ".")
            found |= {name} if module_of(name) not in ("", "photosite") else set()
    return frozenset(found)


def module_of(name: str) -> str:
    """Return the module that a dotted name is, or is in; "" where it is not of photosite."""
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name


@cache
def imports(module: str) -> frozenset[str]:
    """Return the modules of photosite that a module names."""
    return frozenset(map(module_of, names_in(MODULES[module]))) - {"", module}
