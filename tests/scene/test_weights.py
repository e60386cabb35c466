"""Mapped weights are checked once, in blocks, and never copied."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

import photosite.scene.weights as weights_module
from photosite.errors import InputError
from photosite.scene.scene import Scene
from photosite.scene.weights import MappedWeights, all_finite, checked_weights, component_means

GRID = np.arange(400.0, 701, 100)


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(weights_module, "_BLOCK_VALUES", 7)


def mapped(path: Path, array: np.ndarray, kind: type[np.memmap] = np.memmap) -> np.memmap:
    array.astype(np.float32).tofile(path)
    return kind(path, np.float32, "r", shape=array.shape)


@pytest.mark.usefixtures("small_blocks")
def test_every_value_is_checked(tmp_path: Path) -> None:
    good = np.ones((2, 3, 5))
    for number in range(good.size):
        bad = good.copy()
        bad.flat[number] = np.nan
        assert not all_finite(mapped(tmp_path / "w", bad))
    assert all_finite(mapped(tmp_path / "w", good))
    assert all_finite(np.asfortranarray(good.astype(np.float32)))


@pytest.mark.usefixtures("small_blocks")
def test_a_scene_of_a_mapped_file_is_no_copy(tmp_path: Path) -> None:
    for kind in (np.memmap, MappedWeights):
        weights = mapped(tmp_path / "w", np.arange(30.0).reshape(2, 3, 5), kind)
        scene = Scene(weights, np.ones((2, GRID.size)), GRID)
        assert np.shares_memory(scene.weights, weights)
        assert np.shares_memory(scene.scaled(2.0).weights, weights)
        assert component_means(scene.weights) == pytest.approx([7, 22])
        assert scene.mean_luminance_cd_m2() > 0
    bad = mapped(tmp_path / "w", np.full((2, 3, 5), np.nan))
    with raises(InputError, "weights and basis must"):
        Scene(bad, np.ones((2, GRID.size)), GRID)


def test_weights_computed_from_mapped_ones_are_checked_again(tmp_path: Path) -> None:
    weights = mapped(tmp_path / "w", np.ones((2, 3, 5)), MappedWeights)
    with np.errstate(divide="ignore", invalid="ignore"):
        divided = weights / np.float32(0)
    assert checked_weights(weights)[1]
    assert not checked_weights(divided)[1]
