"""Stores for the weights of a scene while they are computed: memory, or a file that is mapped afterwards."""

from __future__ import annotations

import shutil
import tempfile
from types import TracebackType
from typing import IO, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.scene.weights import MappedWeights

_LARGE_BYTES = 256 << 20


class WeightStore(Protocol):
    """A store for weights (K, rows, cols), open within a `with` block."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        """Store the weights (K, n, cols) of the rows from `first` on."""
        ...

    def finish(self) -> NDArray[np.float32]:
        """Return all weights."""
        ...


def temporary_store(shape: tuple[int, int, int]) -> WeightStore:
    """Return memory for weights (K, rows, cols) up to 256 MiB, else a temporary file that is deleted with them.

    Raises
    ------
    InputError
        If the disk has no space for the file.
    """
    size = 4 * int(np.prod(shape, dtype=np.int64))
    return _InMemory(shape) if size <= _LARGE_BYTES else _InFile(shape, size)


class _InMemory:
    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._weights = np.empty(shape, np.float32)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        self._weights[:, first : first + weights.shape[1]] = weights

    def finish(self) -> NDArray[np.float32]:
        return self._weights


class _InFile:
    """A file without a name, which is deleted with its last mapping."""

    def __init__(self, shape: tuple[int, int, int], size: int) -> None:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        if size > free:
            raise InputError(
                f"the scene's weights need {size / 1e9:.1f} GB; {tempfile.gettempdir()} has {free / 1e9:.1f} GB free",
                hint="Set TMPDIR to a larger disk, or write the scene to a file (photosite convert)",
            )
        self._shape = shape
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="photosite-scene-")  # noqa: SIM115 - __exit__ closes it

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        _, rows, cols = self._shape
        try:
            for k, component in enumerate(weights):
                self._file.seek(4 * (k * rows + first) * cols)
                self._file.write(np.ascontiguousarray(component).data)
        except OSError as error:
            raise InputError(f"weights cannot be stored in {tempfile.gettempdir()}: {error.strerror}") from None

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._file, np.float32, "r", shape=self._shape)
