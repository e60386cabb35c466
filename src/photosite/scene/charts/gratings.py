"""Waves: sinusoids and bars in any direction, frequency sweeps, the zone plate. All means over samples are exact.

Frequencies are in cycles per sample, so that 0.5 is the finest that the samples can show. What a camera makes of them
depends on how many of its pixels a sample covers.
"""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum
from photosite.errors import InputError, did_you_mean
from photosite.scene.charts.grey import between, check_size, grey_scene
from photosite.scene.charts.siemens import Waveform
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

Array = NDArray[np.float64]

_FINEST = 0.5
"""Cycles per sample that alternate samples show."""


def sinusoid(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    frequency: float = 0.05,
    direction_deg: float = 0.0,
    phase_deg: float = 0.0,
    waveform: Waveform = "sine",
    contrast: float = math.inf,
    rows: int = 256,
    cols: int = 256,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """A wave of one spatial frequency: a sine, or bars.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    frequency
        Cycles per sample, above 0 and up to 0.5.
    direction_deg
        In which the wave runs: 0 to the right (its bars stand upright), 90 down.
    phase_deg
        Of the wave at the field's centre; at 0 a sine is brightest there, and bars have a bright one's middle.
    waveform
        "sine" or "square".
    contrast
        Radiance of the brightest over that of the darkest, above 1, before it is averaged over samples; `math.inf` for
        full modulation. A sine of contrast c has the modulation (c - 1) / (c + 1).
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the frequency, direction, phase, waveform or contrast cannot be.

    Notes
    -----
    The mean of a sine over a sample is the sine at its centre times sinc(fx) sinc(fy). That of bars is a second
    difference of the wave's second integral, across the sample's two sides.

    Examples
    --------
    >>> wave = sinusoid(frequency=0.25, phase_deg=-45, rows=1, cols=4)
    >>> (2 * wave.weights[0, 0].astype(float) - 1).round(4).tolist()   # sinc(1/4) = 0.9003
    [-0.9003, 0.0, 0.9003, 0.0]
    """
    check_size(rows, cols)
    if not 0 < frequency <= _FINEST:
        raise InputError(f"a wave's frequency is above 0 and up to 0.5 cycles per sample, not {frequency}")
    for name, value in (("direction_deg", direction_deg), ("phase_deg", phase_deg)):
        if not math.isfinite(value):
            raise InputError(f"a wave's {name} is a finite number of degrees, not {value}")
    if waveform not in get_args(Waveform):
        raise InputError(f"no waveform '{waveform}'; {did_you_mean(str(waveform), get_args(Waveform))}")
    along, down = (frequency * turn(math.radians(direction_deg)) for turn in (math.cos, math.sin))
    row, col = (np.arange(count) + 0.5 - count / 2 for count in (rows, cols))
    cycles = down * row[:, None] + along * col[None, :] + phase_deg / 360
    if waveform == "sine":
        wave = np.sinc(along) * np.sinc(down) * np.cos(2 * math.pi * cycles)
    else:
        wave = _bars(cycles, abs(along), abs(down))
    return grey_scene(
        between(0.5 + 0.5 * wave, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"{waveform} wave of {frequency:g} cycles per sample, {direction_deg:g} degrees",
    )


def _bars(cycles: Array, along: float, down: float) -> Array:
    """Means over samples of bars, +1 from -1/4 to 1/4 of a cycle and -1 to 3/4; the sides span `along` and `down`."""

    def once(p: Array) -> Array:
        """The wave's integral: a triangle."""
        return 0.25 - np.abs(np.mod(p + 0.25, 1.0) - 0.5)

    def twice(p: Array) -> Array:
        """The triangle's integral: parabolas."""
        turn = np.mod(p + 0.25, 1.0)
        x = np.where(turn < 0.5, turn - 0.25, turn - 0.75)
        return np.where(turn < 0.5, 1.0, -1.0) * (x**2 / 2 - 1 / 32)

    p = np.mod(cycles, 1.0)  # before differences are taken, so that they lose no digits
    wide, narrow = max(along, down), min(along, down)
    if narrow < 1e-6 * wide:  # bars along a border; what their lean would change is smaller still
        return (once(p + wide / 2) - once(p - wide / 2)) / wide
    far, near = (wide + narrow) / 2, (wide - narrow) / 2
    return (twice(p + far) + twice(p - far) - twice(p + near) - twice(p - near)) / (wide * narrow)


def frequency_sweep(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    lowest: float = 0.005,
    highest: float = 0.5,
    contrast: float = math.inf,
    rows: int = 64,
    cols: int = 1024,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """A sine whose frequency grows by equal factors in equal steps from the left border to the right one.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    lowest, highest
        Frequencies at the left and right borders, in cycles per sample, above 0 and up to 0.5.
    contrast
        As for `sinusoid`.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the frequencies or contrast cannot be.

    Notes
    -----
    The frequency at the share x of the width is lowest (highest / lowest)^x. A sample's mean is by Gauss-Legendre
    quadrature with 16 points, exact to rounding: the phase turns by half a cycle or less.

    Examples
    --------
    >>> sweep = frequency_sweep(cols=400)
    >>> sweep.shape, bool(sweep.weights.min() >= 0)
    ((64, 400), True)
    """
    check_size(rows, cols)
    if not 0 < lowest < highest <= _FINEST:
        raise InputError(
            f"a sweep's frequencies rise from above 0 to at most 0.5 cycles per sample, not from {lowest} to {highest}"
        )
    steepness = math.log(highest / lowest)
    nodes, shares = np.polynomial.legendre.leggauss(16)
    place = (np.arange(cols)[:, None] + 0.5 + nodes / 2) / cols
    cycles = lowest * cols / steepness * np.expm1(steepness * place)
    line = np.cos(2 * math.pi * cycles) @ (shares / 2)
    return grey_scene(
        np.broadcast_to(between(0.5 + 0.5 * line, contrast), (rows, cols)),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"sweep from {lowest:g} to {highest:g} cycles per sample",
    )


def zone_plate(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    highest: float = 0.5,
    contrast: float = math.inf,
    rows: int = 512,
    cols: int = 512,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Rings whose frequency grows in proportion to the distance from the centre, in every direction.

    Where the camera's pixels are too coarse for the rings they show rings that are not there, round other centres:
    each false centre stands where the frequency is that of the grid, or of the colours' grid.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    highest
        Frequency in the middle of the field's longer borders' ends, cols / 2 or rows / 2 samples from the centre,
        whichever is more; above 0 and up to 0.5 cycles per sample.
    contrast
        As for `sinusoid`.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the frequency or contrast cannot be.

    Notes
    -----
    1/2 + 1/2 cos(k r^2) with k = 2 pi highest / side. cos(k (x^2 + y^2)) is the real part of a product of a function
    of x and one of y, whose means over samples are Fresnel integrals: exact. In the corners the frequency is higher,
    up to 1.41 times, and the mean over a sample fades it as it should.

    Examples
    --------
    >>> plate = zone_plate(rows=64, cols=64)
    >>> bool(plate.weights[0, 32, 32] > 0.98)   # bright in the middle
    True
    """
    from scipy.special import fresnel

    check_size(rows, cols)
    if not 0 < highest <= _FINEST:
        raise InputError(f"a zone plate's frequency is above 0 and up to 0.5 cycles per sample, not {highest}")
    # fresnel integrates cos and sin of pi t^2 / 2, and k x^2 is that at t = x sqrt(2 k / pi).
    scale = math.sqrt(4 * highest / max(rows, cols))

    def mean(count: int) -> NDArray[np.complex128]:
        sine, cosine = fresnel((np.arange(count + 1) - count / 2) * scale)
        means: NDArray[np.complex128] = np.diff(cosine + 1j * sine) / scale
        return means

    wave = (mean(rows)[:, None] * mean(cols)[None, :]).real
    return grey_scene(
        between(0.5 + 0.5 * wave, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"zone plate to {highest:g} cycles per sample",
    )
