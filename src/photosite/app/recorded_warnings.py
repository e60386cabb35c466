"""Warnings of a computation, as texts for the page."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from photosite.errors import PhotositeWarning


@contextmanager
def recorded_warnings() -> Iterator[list[str]]:
    """Record the warnings of photosite in a block: a list that has each text once when the block has ended."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
        yield texts
    texts += dict.fromkeys(str(each.message) for each in caught if isinstance(each.message, PhotositeWarning))
