"""Plain fields: one gray everywhere, ramps, checkerboards, grids of points."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import Chart, Contrast, Samples, between, dark_share, grey_chart, lit


@lit()
def uniform() -> Chart:
    """Uniform field.

    Examples
    --------
    >>> round(uniform("A", 12.5).mean_luminance_cd_m2(), 6)
    12.5
    """
    return grey_chart(np.ones((1, 1)), "uniform field")


@lit()
def ramp(*, contrast: Contrast = 1000.0, logarithmic: bool = False, rows: Samples = 64, cols: Samples = 512) -> Chart:
    """Ramp of light from the left border to the right one.

    Parameters
    ----------
    contrast
        Radiance at the right border over that at the left one, above 1; `math.inf` for a linear ramp from black.
    logarithmic
        Equal steps along the row are equal factors of radiance, not equal differences.
    rows, cols
        Samples.

    Examples
    --------
    >>> stops = ramp(contrast=1024, logarithmic=True, cols=10).weights[0, 0]
    >>> (stops[1:] / stops[:-1]).round(4).tolist()[:3]
    [2.0, 2.0, 2.0]
    """
    dark = dark_share(contrast)
    if logarithmic and dark == 0.0:
        raise InputError("contrast", value=contrast, expected="finite for a logarithmic ramp")
    borders = np.arange(cols + 1) / cols
    if logarithmic:
        steepness = math.log(contrast)
        # The mean of dark * exp(steepness x) between borders; expm1 keeps a small contrast exact.
        line = dark * np.exp(steepness * borders[:-1]) * math.expm1(steepness / cols) / (steepness / cols)
    else:
        line = dark + (1.0 - dark) * (borders[:-1] + borders[1:]) / 2
    kind = "logarithmic" if logarithmic else "linear"
    return grey_chart(np.broadcast_to(line, (rows, cols)), f"{kind} ramp, contrast {contrast:g} : 1")


@lit()
def checkerboard(
    *, square: Annotated[float, Field(ge=1)] = 32.0, contrast: Contrast = 20.0, rows: Samples = 256, cols: Samples = 384
) -> Chart:
    """Checkerboard, bright at the top left.

    Parameters
    ----------
    square
        Side of a square in samples, from 1 to twice the larger side of the field. It may be a fraction: samples that a
        side cuts hold their exact share.
    contrast
        Radiance of bright over that of dark, above 1; `math.inf` for black.
    rows, cols
        Samples.

    Examples
    --------
    >>> board = checkerboard(square=1.5, contrast=float("inf"), rows=1, cols=4)
    >>> board.weights[0, 0].round(3).tolist()   # the square's side cuts the second sample in its middle
    [1.0, 0.5, 0.0, 1.0]
    """
    if square > 2 * max(rows, cols):
        raise InputError("square", value=square, expected=f"at most {2 * max(rows, cols)}")
    down, along = (
        coverage.square_wave((np.arange(count, dtype=np.float64) + 0.5) / (2 * square), 1 / (2 * square))
        for count in (rows, cols)
    )
    # The mean of a product of a function of the row and one of the column is the product of their means.
    share = 0.5 + 0.5 * down[:, None] * along[None, :]
    return grey_chart(between(share, contrast), f"checkerboard of {square:g} samples, contrast {contrast:g} : 1")


@lit()
def point_grid(
    *,
    pitch: Annotated[int, Field(ge=2)] = 32,
    diameter: Annotated[float, Field(gt=0)] | None = None,
    contrast: Contrast = math.inf,
    rows: Samples = 256,
    cols: Samples = 384,
) -> Chart:
    """Grid of bright points on a dark field.

    Parameters
    ----------
    pitch
        From point to point along rows and columns, in samples, at most the field's smaller side. A point is at the
        field's center sample.
    diameter
        Of round points, in samples, up to the pitch; each sample holds the exact share of its area that they cover.
        None: each point is one sample.
    contrast
        Radiance of a point over that of the field, above 1; `math.inf` for a black field.
    rows, cols
        Samples.

    Examples
    --------
    >>> stars = point_grid(pitch=8, diameter=0.5, rows=24, cols=24)
    >>> round(float(stars.weights.sum()) / 9, 6) == round(math.pi / 16, 6)   # nine points, each of area pi / 16
    True
    """
    if pitch > min(rows, cols):
        raise InputError("pitch", value=pitch, expected=f"at most the field's smaller side, {min(rows, cols)}")
    if diameter is not None and diameter > pitch:
        raise InputError("diameter", value=diameter, expected=f"at most the pitch, {pitch}")
    if diameter is None:
        cell = np.zeros((pitch, pitch))
        cell[pitch // 2, pitch // 2] = 1.0
    else:
        # Centered on a sample, so that points smaller than one sample stay in one.
        middle = pitch // 2 + 0.5
        cell = coverage.disc(pitch + 1, pitch + 1, middle, middle, diameter / 2)
        cell[0] += cell[pitch]  # with an even pitch the disc can extend into the next cell
        cell[:, 0] += cell[:, pitch]
        cell = cell[:pitch, :pitch]
    down, along = ((np.arange(count) - count // 2 + pitch // 2) % pitch for count in (rows, cols))
    share = cell[down[:, None], along]
    size = "of one sample" if diameter is None else f"of diameter {diameter:g}"
    return grey_chart(between(share, contrast), f"points {size} every {pitch} samples")
