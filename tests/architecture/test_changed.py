"""The tests that `make test-changed` runs."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from changed import public_name, reachable_tests  # noqa: E402


def test_a_changed_command_and_a_changed_test() -> None:
    found = {str(path.relative_to(ROOT)) for path in reachable_tests({ROOT / "src/photosite/cli/mtf.py"})}
    assert found >= {"tests/architecture", "tests/cli/test_mtf.py"}
    assert not found & {"tests/cli/test_plan.py", "tests/metrics/sharpness/test_slanted_edge.py"}
    found = {str(path.relative_to(ROOT)) for path in reachable_tests({ROOT / "tests/cli/test_plan.py"})}
    assert found == {"tests/architecture", "tests/cli/test_plan.py"}


def test_public_names_are_followed_to_their_modules() -> None:
    assert public_name("photosite.Camera") == "photosite.camera.camera.Camera"
    assert public_name("photosite.optics.Pupil") == "photosite.optics.pupil.Pupil"
    found = reachable_tests({ROOT / "src/photosite/metrics/sharpness/slanted_edge.py"})
    assert {ROOT / "tests/metrics/sharpness/test_slanted_edge.py", ROOT / "tests/cli/test_mtf.py"} <= set(found)
