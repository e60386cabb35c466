"""Where the weights of a scene go while they are computed, some rows at a time: memory, or a file and then mapped."""

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
    """A place for weights (K, rows, cols); a `with` block holds it open."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        """Take (K, n, cols) weights of the rows from `first` on."""
        ...

    def finish(self) -> NDArray[np.float32]:
        """All of them."""
        ...


def temporary_store(shape: tuple[int, int, int]) -> WeightStore:
    """Memory for weights (K, rows, cols) up to 256 MiB, for larger ones a temporary file that goes with them.

    Raises
    ------
    InputError
        If there is no room for the file.
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
    """A file without a name: it goes when nothing maps it any longer."""

    def __init__(self, shape: tuple[int, int, int], size: int) -> None:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        if size > free:
            raise InputError(
                f"the scene's weights take {size / 1e9:.1f} GB, and {tempfile.gettempdir()} has {free / 1e9:.1f} GB "
                "free; set TMPDIR to a larger disk, or write the scene to a file (photosite convert)"
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
            raise InputError(
                f"the scene's weights cannot be kept in {tempfile.gettempdir()}: {error.strerror}"
            ) from None

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._file, np.float32, "r", shape=self._shape)
