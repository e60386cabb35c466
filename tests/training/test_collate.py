"""Batches of NumPy, torch and JAX, and torch's DataLoader with forked and spawned workers."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.training import Electrons, Pair, PairDataset, collate

RAMP = np.linspace(0, 3000, 64 * 64, dtype=np.float32).reshape(64, 64)
PAIRS = PairDataset(
    Electrons([RAMP]),
    ps.load_sensor("vendor-2.2um").with_(rows=64, cols=64),
    crop=(16, 32),
    crops=3,
    draws=2,
    flips=True,
)


def test_a_batch_of_numpy() -> None:
    batch = collate(list(PAIRS))
    assert batch.clean.shape == batch.noisy.shape == (6, 16, 32)
    assert batch.noisy.dtype == np.uint16
    assert batch.metadata["index"].tolist() == list(range(6))
    assert batch.metadata["sensor"] == ["Vendor 2.2 um"] * 6
    packed = collate(list(PAIRS), packed=True)
    assert packed.clean.shape == (6, 4, 8, 16)
    assert (packed.clean[2, 3] == batch.clean[2, 1::2, 1::2]).all()


def test_a_batch_of_torch_shares_the_types_and_values() -> None:
    torch = pytest.importorskip("torch", reason="torch (extra ml) is not installed")
    here, there = collate(list(PAIRS)), collate(list(PAIRS), "torch")
    assert there.clean.dtype == torch.float32
    assert there.noisy.dtype == torch.uint16
    assert (there.noisy.numpy() == here.noisy).all()
    assert (there.metadata["light"].numpy() == here.metadata["light"]).all()
    assert there.metadata["flipped_rows"].dtype == torch.uint8


def test_a_batch_of_jax() -> None:
    jax = pytest.importorskip("jax", reason="jax is not installed")
    batch = collate(list(PAIRS), "jax")
    assert isinstance(batch.clean, jax.Array)
    assert (np.asarray(batch.noisy) == collate(list(PAIRS)).noisy).all()


@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_data_loader_gives_the_same_in_workers(start: str) -> None:
    data = pytest.importorskip("torch.utils.data", reason="torch (extra ml) is not installed")
    here = collate([PAIRS[0], PAIRS[1]])  # starts the threads that a forked process does not have
    settings = {"batch_size": 2, "num_workers": 2, "multiprocessing_context": start, "timeout": 60}
    batches = list(data.DataLoader(PAIRS, collate_fn=partial(collate, library="torch"), **settings))
    assert len(batches) == 3
    assert (batches[0].noisy.numpy() == here.noisy).all()
    plain = next(iter(data.DataLoader(PAIRS, **settings)))  # torch's own collation
    assert (plain[1].numpy() == here.noisy).all()


@pytest.mark.parametrize(
    ("pairs", "library", "what"),
    [
        (PAIRS[0], "numpy", "pairs[0]"),
        ([], "numpy", "pairs"),
        ([PAIRS[0]], "tensorflow", "library"),
        ([PAIRS[0], Pair(RAMP, RAMP, {})], "numpy", "pairs"),
        ([PAIRS[0], Pair(PAIRS[1].clean, PAIRS[1].noisy, {})], "numpy", "pairs"),
    ],
)
def test_invalid_arguments(pairs: list[Pair], library: str, what: str) -> None:
    with raises(InputError, what):
        collate(pairs, library)  # type: ignore[arg-type]
