"""Load pairs with a DataLoader as a user's program does: `data_loader.py METHOD WAY` prints sums of the frames."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import photosite as ps
from photosite.engine.threads import thread_count
from photosite.training import Electrons, PairDataset


class Threads(PairDataset):
    """Pairs that state the number of threads in place of the clean frame; the item 5 can fail."""

    failing = False

    def __getitem__(self, index: int) -> Any:
        if self.failing and index == 5:
            raise ArithmeticError("five")
        return np.asarray(super().__getitem__(index).noisy, np.int64).sum(), thread_count()


def main(method: str, way: str) -> None:
    """Load twelve pairs twice; forked workers see what this process did before."""
    from torch.utils.data import DataLoader

    electrons = np.random.default_rng(1).uniform(0.0, 500.0, (256, 256)).astype(np.float32)
    pairs = Threads(Electrons([electrons]), ps.load_sensor("nikon-d200"), draws=12)
    pairs.failing = way == "error"
    if way != "unused":
        pairs[0]
    loader = DataLoader(
        pairs,
        batch_size=2,
        num_workers=2,
        multiprocessing_context=method,
        persistent_workers=way == "persistent",
        collate_fn=list,
    )
    for _ in range(2):
        for number, batch in enumerate(loader):
            for total, threads in batch:
                print(total, threads, flush=True)
            if way == "break" and number == 1:
                break


if __name__ == "__main__":
    main(*sys.argv[1:])
