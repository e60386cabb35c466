"""Pairs through tf.data, where TensorFlow is installed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import photosite as ps

tf = pytest.importorskip("tensorflow")


def pairs() -> ps.training.PairDataset:
    light = np.linspace(0, 3000, 64 * 64, dtype=np.float32).reshape(64, 64)
    sensor = ps.load_sensor("vendor-2.2um")
    return ps.training.PairDataset(
        ps.training.Electrons([light]), sensor, crop=(32, 32), crops=6, light=(0.1, 1), seed=4
    )


def test_a_generator_gives_the_items_in_order() -> None:
    dataset = pairs()

    def frames() -> Iterator[tuple[Any, Any]]:
        for clean, noisy, _ in dataset:
            yield clean, noisy

    signature = tf.TensorSpec(dataset.shape, tf.float32), tf.TensorSpec(dataset.shape, tf.uint16)
    batches = list(tf.data.Dataset.from_generator(frames, output_signature=signature).batch(4))
    for part, kind in enumerate(("clean", "noisy")):
        found = np.concatenate([batch[part].numpy() for batch in batches])
        assert np.array_equal(found, np.stack([getattr(item, kind) for item in dataset]))


def test_items_by_number_in_two_threads_have_the_same_bits() -> None:
    dataset = pairs()

    def item(number: Any) -> tuple[Any, Any]:
        clean, noisy, _ = dataset[int(number)]
        return clean, noisy

    def load(number: Any) -> tuple[Any, Any, Any]:
        clean, noisy = tf.numpy_function(item, [number], (tf.float32, tf.uint16))
        return number, tf.ensure_shape(clean, dataset.shape), tf.ensure_shape(noisy, dataset.shape)

    order = tf.data.Dataset.range(len(dataset)).shuffle(len(dataset), seed=1)
    seen = {int(n): noisy.numpy() for n, _, noisy in order.map(load, num_parallel_calls=2)}
    assert sorted(seen) == list(range(len(dataset)))
    assert all(np.array_equal(noisy, dataset[number].noisy) for number, noisy in seen.items())
