"""Who may import whom, by walking the source's import statements (those inside functions too)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "photosite"

COMMON = {
    "errors",
    "measured",
    "cfa",
    "regions",
    "exposure",
    "atomic",
    "cie",
    "small_file",
    "yaml_file",
    "mat_file",
    "hdf5_heap",
    "png_file",
}
"""Leaves at the top that say nothing of scenes, lenses, sensors or frames."""

MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "measured": {"errors"},
    "cfa": {"errors"},
    "regions": {"errors"},
    "exposure": {"errors"},
    "atomic": {"errors"},
    "cie": set(),
    "small_file": {"errors"},
    "yaml_file": {"errors", "small_file"},
    "mat_file": {"errors"},
    "hdf5_heap": {"errors"},
    "png_file": {"errors"},
    "spectra": {"errors", "cie", "lamps"},
    "spectrum_file": {"errors", "spectra", "small_file"},
    "lamps": {"errors", "cie", "spectra", "spectrum_file"},
    "engine": set(),
    "scene": COMMON | {"spectra", "engine"},
    "optics": COMMON | {"spectra", "engine"},
    "sensor": COMMON | {"spectra", "engine"},
    "frames": COMMON | {"sensor"},
    "reach": COMMON | {"engine"},
    "lens_tables": COMMON | {"optics", "engine", "reach"},  # what a lens's spread is to the engine; no scene, no sensor
    "transfers": COMMON | {"optics", "engine", "lens_tables"},
    "mosaic": COMMON
    | {"scene", "optics", "sensor", "engine", "spectra", "lens_tables", "transfers", "glare", "door", "warps"},
    "door": COMMON | {"optics", "sensor", "engine"},
    "glare": COMMON | {"optics", "engine"},
    "warps": COMMON | {"scene", "optics", "engine"},
    "layers": COMMON | {"scene", "optics", "sensor", "engine", "spectra", "mosaic"},
    "profile": COMMON | {"scene", "sensor", "spectra", "door"},
    "camera": COMMON
    | {"scene", "optics", "sensor", "frames", "engine", "spectra", "mosaic", "layers", "profile", "door"},
    "camera_file": COMMON | {"scene", "optics", "sensor", "spectra", "camera"},
    "calibration": COMMON | {"frames", "sensor", "engine", "spectra", "spectrum_file"},
    "develop": COMMON | {"frames", "sensor", "engine", "spectra", "metrics"},
    "metrics": COMMON | {"frames", "sensor", "engine", "spectra"},
}
BELOW = COMMON | {
    "spectra",
    "engine",
    "scene",
    "optics",
    "sensor",
    "frames",
    "mosaic",
    "door",
    "profile",
    "camera",
    "camera_file",
}
BELOW |= {"calibration", "develop", "metrics", "lamps", "spectrum_file"}
MAY_IMPORT["validation"] = BELOW
MAY_IMPORT["report"] = BELOW | {"validation", "studies"}
MAY_IMPORT["studies"] = BELOW | {"validation", "report"}
MAY_IMPORT["__main__"] = {"cli"}
MAY_IMPORT["cli"] = BELOW | {"validation", "report", "studies", ""}

EXCEPTIONS = {
    # A Calibration, or a series of them, writes its own report; the import is inside the method, and the report knows
    # calibration only.
    ("calibration", "report"): {"calibration/result.py", "calibration/gain_series_result.py"},
}


def rooms() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        if parts != ("__init__",):  # the public face hands on names of every room
            found.setdefault(parts[0], []).append(path)
    return found


def imported(path: Path) -> set[str]:
    """The rooms of photosite that a file imports; "" is the public face."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            names |= {node.module or ""} if node.module != "photosite" else {f"photosite.{a.name}" for a in node.names}
    inside = [name.split(".") for name in names if name.split(".")[0] == "photosite"]
    return {parts[1] if len(parts) > 1 else "" for parts in inside}


@pytest.mark.parametrize("room", rooms())
def test_room_imports_only_what_it_may(room: str) -> None:
    assert room in MAY_IMPORT, f"{room} has no entry: say what it may import"
    for path in rooms()[room]:
        for other in imported(path) - {room} - MAY_IMPORT[room]:
            allowed = EXCEPTIONS.get((room, other), set())
            assert str(path.relative_to(SOURCE)) in allowed, f"{path.relative_to(SOURCE)} imports photosite.{other}"


def test_every_exception_is_still_needed() -> None:
    for (room, other), files in EXCEPTIONS.items():
        for name in files:
            assert other in imported(SOURCE / name), f"{room}/{name} no longer imports {other}: remove the exception"


def test_numba_is_configured_in_one_place() -> None:
    """jit.py for the CPU, cuda.py for the GPU: numba's CUDA target is loaded by those only who ask for it."""
    for path in SOURCE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert path.name in ("jit.py", "cuda.py") or "numba" not in {
            alias.name.split(".")[0]
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Import)
            for alias in node.names
        }, f"{path.relative_to(SOURCE)} imports numba; engine/jit.py is the place"


def test_no_file_grows_past_400_lines() -> None:
    long = {str(p.relative_to(SOURCE)): n for p in SOURCE.rglob("*.py") if (n := len(p.read_text().splitlines())) > 400}
    assert not long, f"files past 400 lines are two rooms: {long}"


def test_a_folder_init_only_hands_names_on() -> None:
    for path in SOURCE.glob("*/__init__.py"):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        code = [n for n in body if not isinstance(n, ast.Expr | ast.ImportFrom | ast.Assign)]
        assert not code, f"{path.relative_to(SOURCE)} does more than hand names on"
