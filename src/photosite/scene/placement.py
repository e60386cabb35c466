"""The position of a scene's samples on a grid of pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from photosite.errors import InputError
from photosite.values.region import Region


@dataclass(frozen=True, slots=True)
class Placement:
    """An upright scene on a grid of pixels: sample coordinate = start + step * pixel coordinate, on each axis.

    Coordinates are from border to border: pixel i covers i to i + 1. Outside its border the scene repeats its border
    samples.

    Parameters
    ----------
    row_start, col_start
        Sample coordinate of the grid's top left corner.
    row_step, col_step
        Samples per pixel.
    shape
        (rows, cols) of the grid, in pixels.
    """

    row_start: float
    col_start: float
    row_step: float
    col_step: float
    shape: tuple[int, int]

    def regions(self, sample_regions: Iterable[Region]) -> tuple[Region, ...]:
        """Return regions in pixels: the whole pixels inside them, within the frame; see `whole_pixels`."""
        found = []
        for region in sample_regions:
            r0, r1 = ((row - self.row_start) / self.row_step for row in (region.r0, region.r1))
            c0, c1 = ((col - self.col_start) / self.col_step for col in (region.c0, region.c1))
            found.append(self.whole_pixels(region.name, (r0, r1), (c0, c1)))
        return tuple(found)

    def whole_pixels(self, name: str, rows: tuple[float, float], cols: tuple[float, float]) -> Region:
        """Return the whole pixels between two rows and two columns in pixels, within the frame."""
        r0, r1 = self._inside(*rows, self.shape[0])
        c0, c1 = self._inside(*cols, self.shape[1])
        if r0 >= r1 or c0 >= c1:
            what = f"region '{name}' holds no whole pixel of a {self.shape[0]} x {self.shape[1]} frame"
            raise InputError(what, hint="Use a larger frame or a scene that fills it")
        return Region(name, r0, r1, c0, c1)

    @staticmethod
    def _inside(low: float, high: float, size: int) -> tuple[int, int]:
        # 1e-9 absorbs rounding where a border is on a pixel's border.
        first, end = math.ceil(low - 1e-9), math.floor(high + 1e-9)
        return max(first, 0), min(end, size)


def place(
    scene_shape: tuple[int, int],
    frame_shape: tuple[int, int],
    *,
    pixel_aspect: float = 1.0,
    cols_per_pixel: float | None = None,
) -> Placement:
    """Center a scene of square samples on a frame; shapes are (rows, cols).

    Parameters
    ----------
    scene_shape, frame_shape
        In samples and in pixels.
    pixel_aspect
        A pixel's height over its width.
    cols_per_pixel
        Samples per pixel along a row; None scales the scene evenly until it covers the frame.

    Examples
    --------
    >>> place((100, 100), (20, 50)).row_step
    2.0
    """
    (scene_rows, scene_cols), (rows, cols) = scene_shape, frame_shape
    col_step = cols_per_pixel
    if col_step is None:
        col_step = min(scene_cols / cols, scene_rows / (rows * pixel_aspect))
    row_step = col_step * pixel_aspect
    start = (scene_rows - rows * row_step) / 2, (scene_cols - cols * col_step) / 2
    return Placement(*start, row_step, col_step, frame_shape)
