"""A short run of the commands under faults; `make test-faults` and its like are the long ones."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from power import failures

from faults import Case

needs_compiler = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)


def run(*arguments: str) -> str:
    """Run the program of the long runs; it fails where there are findings."""
    program = Path(__file__).with_name("run.py")
    done = subprocess.run([sys.executable, str(program), *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@needs_compiler
def test_a_command_under_faults() -> None:
    """Every operation on files fails, or is the last before a kill or a power failure."""
    table = run("faults", "kills", "power", "full-disk", "--only", "sensors export", "--most", "4")
    assert re.search(r"\| sensors export \| \d+ \| \d+ \| \d+ \| \d+ \| \d+ \| 0 \|", table), table


TEMPORARY = "/r/.photosite-0f1e2d3c-4711-123456-0000000"


def written(temporary: str, name: str) -> str:
    """Return the operations that write a file."""
    path = f"{TEMPORARY}{temporary}"
    return f"create\t{path}\nwrite\t{path}\nsync\t{path}\nrename\t{path}\t/r/{name}\nsync\t/r\n"


MAPS, SENSOR = written("0.h5", "m.maps.h5"), written("1.yaml", "m.yaml")
NEW_MAPS = written("0.new", "m.maps.h5.new")
LAST = "rename\t/r/m.maps.h5.new\t/r/m.maps.h5\nsync\t/r\n"


@pytest.mark.parametrize(
    ("log", "found"),
    [
        (NEW_MAPS + SENSOR + LAST, ""),
        (MAPS + SENSOR, "do not belong together"),
        (SENSOR + MAPS, "do not belong together"),
        (NEW_MAPS + SENSOR.replace(f"sync\t{TEMPORARY}1.yaml\n", "") + LAST, "m.yaml is neither old nor new"),
        (NEW_MAPS.replace("sync\t/r\n", "") + SENSOR + LAST, "do not belong together"),
        (NEW_MAPS + SENSOR.replace("sync\t/r\n", "") + LAST, "do not belong together"),
    ],
)
def test_power_failures_are_found(log: str, found: str) -> None:
    """The order in which a sensor file and its maps are written is the one without a finding."""
    case = Case("pair", "", pairs=(("m.yaml", "m.maps.h5"),))
    case.old = {"m.yaml": b"old", "m.maps.h5": b"old maps"}
    case.new = {"m.yaml": b"new", "m.maps.h5": b"new maps"}
    _, wrong = failures(case, log, "/r")
    assert bool(wrong) == bool(found)
    assert any(found in text for text in wrong) or not found


def test_a_folder_that_is_not_synced_is_found() -> None:
    place = f"{TEMPORARY}0"
    case = Case("folder", "", folder="s")
    case.new = {"s/a": b"a", "s/b": b"b"}
    files = "".join(f"create\t{place}/{name}\nwrite\t{place}/{name}\nsync\t{place}/{name}\n" for name in "ab")
    log = f"folder\t{place}\n{files}sync\t{place}\nrename\t{place}\t/r/s\nsync\t/r"
    assert failures(case, log, "/r")[1] == []
    assert "s is not whole" in failures(case, log.replace(f"sync\t{place}\n", ""), "/r")[1][0]
