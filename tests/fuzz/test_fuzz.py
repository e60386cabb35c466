"""A short run of the fuzzing; `make fuzz` is the long one."""

from __future__ import annotations

import random
import tempfile
import time
from pathlib import Path

import fuzzing
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

_PLACE = tempfile.TemporaryDirectory()
FOLDER = Path(_PLACE.name)
TARGETS = fuzzing.targets(FOLDER)
READERS = [name for name, target in TARGETS.items() if target.draw is None]
CORPUS = sorted(path for path in (Path(__file__).parent / "corpus").glob("*/*.*"))
SLOWEST_S = 60.0
"""Longer than any reading takes on a busy machine; a hang takes longer."""


def outcome(name, content):
    target = TARGETS[name]
    path = FOLDER / f"input-{name}{target.suffix}"
    path.write_bytes(content)
    fuzzing.start_child()
    begun = time.monotonic()
    found = fuzzing.outcome(target, path)
    assert time.monotonic() - begun < SLOWEST_S
    return found


@pytest.mark.parametrize("name", TARGETS)
def test_undamaged_files_are_read(name):
    """Otherwise only the error would be fuzzed."""
    assert {outcome(name, seed) for seed in TARGETS[name].seeds} == {"read"}


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32))
def test_damaged_files_are_read_or_refused(name, seed):
    outcome(name, TARGETS[name].hostile(random.Random(seed)))


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    edits=st.lists(st.tuples(st.integers(0, 4000), st.binary(max_size=9), st.integers(0, 40)), min_size=1, max_size=4)
)
def test_edits_are_read_or_refused(name, edits):
    """Replaced bytes, which hypothesis shrinks to the fewest that matter."""
    content = TARGETS[name].seeds[0]
    for at, put, over in edits:
        place = at % (len(content) + 1)
        content = content[:place] + put + content[place + over :]
    outcome(name, content)


@pytest.mark.parametrize(
    "content", [b"", b"\0", b"\xff" * 100, b"II*\0", b"MM\0*" + b"\0" * 8, b"SIMPLE  =", b"\x89HDF\r\n\x1a\n"]
)
@pytest.mark.parametrize("name", READERS)
def test_stubs_are_refused(name, content):
    assert outcome(name, content) == "refused"


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_earlier_findings(path):
    """Inputs that once were findings, by target; `corpus/README.md` says what they did."""
    outcome(path.parent.name, path.read_bytes())


def test_the_same_seed_gives_the_same_damage():
    content = TARGETS["tiff"].seeds[0]
    one, other = (fuzzing.damaged(content, random.Random("7 tiff 3"), text=False) for _ in "ab")
    assert one == other
    assert one != content
    for name in ("sensor", "commands"):
        assert TARGETS[name].hostile(random.Random(3)) == TARGETS[name].hostile(random.Random(3))


def test_findings_are_detected():
    """A result that is not finite, and another exception."""
    bad = fuzzing.Target(".x", (), lambda path: [1.0, float("nan")])
    with pytest.raises(AssertionError, match="a result holds nan"):
        fuzzing.outcome(bad, FOLDER)
    worse = fuzzing.Target(".x", (), lambda path: {}["missing"])
    with pytest.raises(KeyError):
        fuzzing.outcome(worse, FOLDER)
