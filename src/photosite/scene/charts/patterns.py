"""Patterns: one gray everywhere, ramps, checkerboards, grids of points, waves in any direction, the zone plate."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.chart import (
    Chart,
    Contrast,
    Degrees,
    Frequency,
    Samples,
    between,
    dark_fraction,
    gray_chart,
    lit,
)

Array = NDArray[np.float64]
Waveform = Literal["sine", "square"]


@lit()
def uniform() -> Chart:
    """Uniform field.

    Examples
    --------
    >>> round(uniform("A", 12.5).mean_luminance_cd_m2(), 6)
    12.5
    """
    return gray_chart(np.ones((1, 1)), "uniform field")


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
    dark = dark_fraction(contrast)
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
    return gray_chart(np.broadcast_to(line, (rows, cols)), f"{kind} ramp, contrast {contrast:g} : 1")


@lit()
def checkerboard(
    *, square: Annotated[float, Field(ge=1)] = 32.0, contrast: Contrast = 20.0, rows: Samples = 256, cols: Samples = 384
) -> Chart:
    """Checkerboard, bright at the top left.

    Parameters
    ----------
    square
        Side of a square in samples, from 1 to twice the larger side of the field. It may be a fraction: samples that a
        side cuts hold their exact fraction.
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
    fraction = 0.5 + 0.5 * down[:, None] * along[None, :]
    return gray_chart(between(fraction, contrast), f"checkerboard of {square:g} samples, contrast {contrast:g} : 1")


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
        Of round points, in samples, up to the pitch; each sample holds the exact fraction of its area that they cover.
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
    fraction = cell[down[:, None], along]
    size = "of one sample" if diameter is None else f"of diameter {diameter:g}"
    return gray_chart(between(fraction, contrast), f"points {size} every {pitch} samples")


# Waves: sinusoids and bars in any direction, frequency sweeps, the zone plate. All means over samples are exact.
#
# Frequencies are in cycles per sample; 0.5 is the highest that samples can show. What a camera resolves depends on the
# number of its pixels per sample.


@lit()
def sinusoid(
    *,
    frequency: Frequency = 0.05,
    direction_deg: Degrees = 0.0,
    phase_deg: Degrees = 0.0,
    waveform: Waveform = "sine",
    contrast: Contrast = math.inf,
    rows: Samples = 256,
    cols: Samples = 256,
) -> Chart:
    """Wave of one spatial frequency: a sine, or bars.

    Parameters
    ----------
    frequency
        Cycles per sample, above 0 and up to 0.5.
    direction_deg
        Direction of the wave: 0 to the right (vertical bars), 90 down.
    phase_deg
        Phase at the field's center; at 0 a sine has its maximum there, and bars the center of a bright one.
    waveform
        "sine" or "square".
    contrast
        Radiance of the brightest over that of the darkest, above 1, before averaging over samples; `math.inf` for full
        modulation. A sine of contrast c has the modulation (c - 1) / (c + 1).
    rows, cols
        Samples.

    Notes
    -----
    The mean of a sine over a sample is the sine at its center times sinc(fx) sinc(fy). That of bars is a second
    difference of the wave's second integral, across the sample's two sides.

    Examples
    --------
    >>> wave = sinusoid(frequency=0.25, phase_deg=-45, rows=1, cols=4)
    >>> (2 * wave.weights[0, 0].astype(float) - 1).round(4).tolist()   # sinc(1/4) = 0.9003
    [-0.9003, 0.0, 0.9003, 0.0]
    """
    along, down = (frequency * turn(math.radians(direction_deg)) for turn in (math.cos, math.sin))
    row, col = (np.arange(count) + 0.5 - count / 2 for count in (rows, cols))
    cycles = down * row[:, None] + along * col[None, :] + phase_deg / 360
    if waveform == "sine":
        wave = np.sinc(along) * np.sinc(down) * np.cos(2 * math.pi * cycles)
    else:
        wave = _bars(cycles, abs(along), abs(down))
    name = f"{waveform} wave of {frequency:g} cycles per sample, {direction_deg:g} degrees"
    return gray_chart(between(0.5 + 0.5 * wave, contrast), name)


def _bars(cycles: Array, along: float, down: float) -> Array:
    """Means over samples of bars, +1 from -1/4 to 1/4 of a cycle and -1 to 3/4; a sample spans `along` and `down`."""

    def once(p: Array) -> Array:
        """The wave's integral: a triangle."""
        return 0.25 - np.abs(np.mod(p + 0.25, 1.0) - 0.5)

    def twice(p: Array) -> Array:
        """The triangle's integral: parabolas."""
        turn = np.mod(p + 0.25, 1.0)
        x = np.where(turn < 0.5, turn - 0.25, turn - 0.75)
        return np.where(turn < 0.5, 1.0, -1.0) * (x**2 / 2 - 1 / 32)

    p = np.mod(cycles, 1.0)  # before the differences, to keep digits
    wide, narrow = max(along, down), min(along, down)
    if narrow < 1e-6 * wide:  # bars along a border; the tilt has no effect
        return (once(p + wide / 2) - once(p - wide / 2)) / wide
    far, near = (wide + narrow) / 2, (wide - narrow) / 2
    return (twice(p + far) + twice(p - far) - twice(p + near) - twice(p - near)) / (wide * narrow)


@lit()
def frequency_sweep(
    *,
    lowest: Frequency = 0.005,
    highest: Frequency = 0.5,
    contrast: Contrast = math.inf,
    rows: Samples = 64,
    cols: Samples = 1024,
) -> Chart:
    """Sine whose frequency increases exponentially from the left border to the right one.

    Parameters
    ----------
    lowest, highest
        Frequencies at the left and right borders, in cycles per sample, above 0 and up to 0.5.
    contrast, rows, cols
        As for `sinusoid`.

    Notes
    -----
    The frequency at the fraction x of the width is lowest (highest / lowest)^x. A sample's mean is by Gauss-Legendre
    quadrature with 16 points, exact to rounding: the phase changes by half a cycle or less.

    Examples
    --------
    >>> sweep = frequency_sweep(cols=400)
    >>> sweep.shape, bool(sweep.weights.min() >= 0)
    ((64, 400), True)
    """
    if not lowest < highest:
        raise InputError("highest", value=highest, expected=f"above lowest, {lowest:g}")
    steepness = math.log(highest / lowest)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    place = (np.arange(cols)[:, None] + 0.5 + nodes / 2) / cols
    cycles = lowest * cols / steepness * np.expm1(steepness * place)
    line = np.cos(2 * math.pi * cycles) @ (weights / 2)
    pattern = np.broadcast_to(between(0.5 + 0.5 * line, contrast), (rows, cols))
    return gray_chart(pattern, f"sweep from {lowest:g} to {highest:g} cycles per sample")


@lit()
def zone_plate(
    *, highest: Frequency = 0.5, contrast: Contrast = math.inf, rows: Samples = 512, cols: Samples = 512
) -> Chart:
    """Zone plate: rings whose frequency is proportional to the distance from the center.

    Pixels that are too coarse for the rings show aliases: false rings around other centers, where the frequency is that
    of the pixel grid, or of the grid of one color.

    Parameters
    ----------
    highest
        Frequency at the ends of the longer axis, cols / 2 or rows / 2 samples from the center, whichever is more; above
        0 and up to 0.5 cycles per sample.
    contrast, rows, cols
        As for `sinusoid`.

    Notes
    -----
    1/2 + 1/2 cos(k r^2) with k = 2 pi highest / side. cos(k (x^2 + y^2)) is the real part of a product of a function
    of x and one of y, whose means over samples are Fresnel integrals: exact. In the corners the frequency is up to 1.41
    times higher, and the mean over a sample reduces its modulation accordingly.

    Examples
    --------
    >>> plate = zone_plate(rows=64, cols=64)
    >>> bool(plate.weights[0, 32, 32] > 0.98)   # bright in the middle
    True
    """
    from scipy.special import fresnel

    # fresnel integrates cos and sin of pi t^2 / 2, and k x^2 is that at t = x sqrt(2 k / pi).
    scale = math.sqrt(4 * highest / max(rows, cols))

    def mean(count: int) -> NDArray[np.complex128]:
        sine, cosine = fresnel((np.arange(count + 1) - count / 2) * scale)
        means: NDArray[np.complex128] = np.diff(cosine + 1j * sine) / scale
        return means

    wave = (mean(rows)[:, None] * mean(cols)[None, :]).real
    return gray_chart(between(0.5 + 0.5 * wave, contrast), f"zone plate to {highest:g} cycles per sample")
