"""Training pairs a second from torch's DataLoader, in this process and in workers of each start method.

    python benchmarks/data_loader.py [--workers 2] [--pairs 640] [--rounds 3]

Pairs of 512 x 512 from given electrons in batches of 16, stacked by `ps.training.collate`. The rate counts the batches
after the first of each worker. The methods run in turn after one pair was made here; medians of the rounds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from functools import partial

import numpy as np

import photosite as ps
from photosite.training import Electrons, PairDataset, collate

BATCH, SIZE = 16, 512


def dataset(pairs: int) -> PairDataset:
    """Return pairs as a user's program makes them: a spawned worker imports what this file imports."""
    electrons = np.random.default_rng(1).uniform(0, 4000, (1024, 1024)).astype(np.float32)
    return PairDataset(
        Electrons([electrons]), ps.load_sensor("vendor-2.2um"), crop=(SIZE, SIZE), crops=pairs, light=(0.1, 1.0), seed=1
    )


def measure(pairs: PairDataset, workers: int, method: str | None) -> tuple[float, float]:
    """Return the seconds to the first batch, and the pairs a second after the first of each worker."""
    from torch.utils.data import DataLoader

    loader = DataLoader(
        pairs,
        batch_size=BATCH,
        num_workers=workers if method else 0,
        multiprocessing_context=method,
        collate_fn=partial(collate, library="torch"),
    )
    start = time.perf_counter()
    batches = iter(loader)
    next(batches)
    first = time.perf_counter() - start
    for _ in range(workers - 1 if method else 0):
        next(batches)
    since = time.perf_counter()
    count = sum(len(batch.noisy) for batch in batches)
    return first, count / (time.perf_counter() - since)


def main() -> None:
    """Print a line for each start method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=640)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    pairs = dataset(options.pairs)
    _ = pairs[0]
    methods = (None, "fork", "forkserver", "spawn")
    found: dict[str | None, list[tuple[float, float]]] = {method: [] for method in methods}
    for _ in range(options.rounds):
        for method in methods:
            found[method].append(measure(pairs, options.workers, method))
    alone = statistics.median(rate for _, rate in found[None])
    print("workers        first batch, s  pairs/s  of one process")
    for method, rounds in found.items():
        first, rate = (statistics.median(values) for values in zip(*rounds, strict=True))
        print(f"{method or 'none':14s} {first:14.2f} {rate:8.0f} {rate / alone:15.2f}")


if __name__ == "__main__":
    main()
