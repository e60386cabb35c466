"""Datasets in processes that are spawned."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.training import Electrons, PairDataset, RawFrames

PATIENCE_S = 20.0

pytestmark = pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="processes inherit memory on Linux")


class Pairs(PairDataset):
    """A user's class with a fact of its own."""

    note = ""


class WithFile(Pairs):
    """A user's class that leaves something out of its copies."""

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"note": "not copied"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, note=state["note"] + ", but made anew")


class Gate:
    """Made in a child process once a file exists, or after a while."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return opened, (self.path,)


def opened(path: Path) -> bool:
    end = time.monotonic() + PATIENCE_S
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.01)
    return path.exists()


def answer(gate: bool, pairs: Pairs, queue: Any) -> None:
    total = int(np.asarray(pairs[3].noisy, np.int64).sum())
    arrays = [value for value in getattr(pairs.source, "images", ()) if isinstance(value, np.ndarray)]
    for array in arrays:
        array += 1.0
    changed = int(np.asarray(pairs[3].noisy, np.int64).sum()) != total
    queue.put((gate, pairs.note, total, changed, all(array.flags.aligned for array in arrays)))


def electrons() -> Electrons:
    rng = np.random.default_rng(1)
    return Electrons([rng.uniform(0.0, 500.0, (257, 301)).astype(np.float32), rng.uniform(0.0, 9.0, (64, 64))])


def frames() -> RawFrames:
    sensor = ps.load_sensor("nikon-d200").with_(rows=256, cols=300, black_level_dn=64)
    camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    return RawFrames([camera.expose(np.full((256, 300), 500.0, np.float32), 0.01)], sensor, averaged=4)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
@pytest.mark.parametrize("source", [electrons, frames])
def test_a_process_starts_before_the_arrays_are_read_and_makes_the_same_items(
    method: Any, source: Any, tmp_path: Path
) -> None:
    light = source()
    pairs = Pairs(light, ps.load_sensor("nikon-d200"), crop=(64, 64), draws=4)
    object.__setattr__(pairs, "note", "mine")
    expected = int(np.asarray(pairs[3].noisy, np.int64).sum())
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    child = context.Process(target=answer, args=(Gate(tmp_path / "started"), pairs, queue))
    child.start()  # would wait for the child if arrays of more than 64 KB went through its pipe
    (tmp_path / "started").touch()
    gate, note, total, changed, aligned = queue.get(timeout=60)
    child.join()
    assert (gate, note, total, aligned) == (True, "mine", expected, True)
    assert changed == isinstance(light, Electrons)
    assert int(np.asarray(pairs[3].noisy, np.int64).sum()) == expected


@pytest.mark.parametrize("method", [None, "spawn"])
def test_a_class_may_state_what_is_copied(method: Any, tmp_path: Path) -> None:
    pairs = WithFile(electrons(), ps.load_sensor("nikon-d200"), crop=(64, 64), draws=4)
    if method is None:
        assert pickle.loads(pickle.dumps(pairs)).note == "not copied, but made anew"
        return
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    child = context.Process(target=answer, args=(Gate(tmp_path), pairs, queue))
    child.start()
    assert queue.get(timeout=60)[1] == "not copied, but made anew"
    child.join()


def test_a_small_dataset_without_arrays_goes_to_a_process(tmp_path: Path) -> None:
    np.save(tmp_path / "light.npy", np.full((64, 64), 100.0, np.float32))
    pairs = Pairs(Electrons([tmp_path / "light.npy"]), ps.load_sensor("nikon-d200"), draws=4)
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    child = context.Process(target=answer, args=(Gate(tmp_path), pairs, queue))
    child.start()
    assert queue.get(timeout=60)[2] == int(np.asarray(pairs[3].noisy, np.int64).sum())
    child.join()
