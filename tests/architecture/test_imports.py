"""Which folder may import which, and that no files import each other in a circle.

Import statements inside functions and for type checkers count, and names of modules in strings, "photosite.a.b" and
"photosite.a.b:name".
"""

from __future__ import annotations

import ast

import pytest
from import_graph import MODULES, SOURCE, imports, module_name

VALUES = {"errors", "values", "files"}
STAGES = VALUES | {"color", "engine", "scene", "optics", "sensor", "frames", "camera"}
RESULTS = VALUES | {"color", "engine", "sensor", "frames", "calibration", "metrics", "validation"}
EXPERIMENTS = STAGES | {"training", "library", "calibration", "metrics", "develop", "validation", "report"}

MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "values": {"errors"},
    "files": {"errors", "values"},
    "engine": {"errors"},
    "color": VALUES,
    "scene": VALUES | {"color", "engine"},
    "optics": VALUES | {"color", "engine"},
    "sensor": VALUES | {"color", "engine"},
    "frames": VALUES | {"sensor", "engine"},
    "camera": VALUES | {"color", "engine", "scene", "optics", "sensor", "frames"},
    "calibration": VALUES | {"color", "engine", "sensor", "frames"},
    "metrics": VALUES | {"color", "engine", "scene", "sensor", "frames", "develop"},
    "develop": VALUES | {"color", "engine", "sensor", "frames"},
    "library": VALUES | {"color", "sensor", "frames", "calibration"},
    "training": STAGES,
    "validation": STAGES | {"calibration", "metrics", "develop"},
    "report": RESULTS | {"scene", "optics", "develop"},
    "studies": EXPERIMENTS,
    "app": EXPERIMENTS | {"studies", ""},
    "cli": EXPERIMENTS | {"studies", "app", ""},
    "__main__": {"cli"},
}
"""What each folder may import, besides itself; "" is the package's lazy public names."""

EXCEPTIONS: dict[tuple[str, str], str] = {
    ("values/shown.py", "photosite.report"): "the one hook of `.report()`, `.plot()` and notebooks",
    ("values/saved.py", "photosite"): "the one hook of `.save()`",
}
"""(file, imported module or folder): the reason."""


def folder(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def allowed(module: str, imported: str) -> bool:
    file = str(MODULES[module].relative_to(SOURCE))
    return any(file == name and imported.startswith(target) for name, target in EXCEPTIONS)


def test_top_level_holds_folders_and_errors_only() -> None:
    assert {path.name for path in SOURCE.glob("*.py")} == {"__init__.py", "__main__.py", "errors.py"}
    assert {folder(name) for name in MODULES} - {""} == set(MAY_IMPORT)


@pytest.mark.parametrize("name", MAY_IMPORT)
def test_folder_imports_only_what_it_may(name: str) -> None:
    wrong = [
        (module, other)
        for module in MODULES
        if folder(module) == name
        for other in imports(module)
        if folder(other) not in MAY_IMPORT[name] | {name} and not allowed(module, other)
    ]
    assert not wrong


def test_every_exception_is_still_needed() -> None:
    for name, target in EXCEPTIONS:
        assert any(other.startswith(target) for other in imports(module_name(SOURCE / name))), (name, target)


def circles() -> list[list[str]]:
    """Groups of modules that import each other, by Tarjan's algorithm."""
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        order[module] = lowest[module] = len(order)
        stack.append(module)
        for other in sorted(imports(module)):
            if allowed(module, other):
                continue
            if other not in order:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in stack:
                lowest[module] = min(lowest[module], order[other])
        if lowest[module] == order[module]:
            members = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(members) > 1:
                found.append(sorted(members))

    for module in MODULES:
        if module not in order:
            visit(module)
    return found


def test_no_circles_between_files() -> None:
    assert not circles()


def test_numba_is_configured_in_one_place() -> None:
    """jit.py for the CPU, cuda.py for the GPU, so that numba's CUDA target loads only when it is used."""
    for path in SOURCE.rglob("*.py"):
        imported = {
            alias.name.split(".")[0]
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Import)
            for alias in node.names
        }
        assert path.name in ("jit.py", "cuda.py") or "numba" not in imported, f"{path} imports numba"


def test_a_folder_init_only_imports_names() -> None:
    for path in SOURCE.glob("*/**/__init__.py"):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        code = [node for node in body if not isinstance(node, ast.Expr | ast.ImportFrom | ast.Assign)]
        assert not code, f"{path.relative_to(SOURCE)} does more than import names"


def test_every_folder_says_what_belongs_in_it() -> None:
    for path in SOURCE.glob("*/**/__init__.py"):
        assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path.relative_to(SOURCE)
