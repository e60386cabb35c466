"""Plain fields: one light everywhere, ramps, checkerboards, grids of points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.grey import between, check_range, check_size, dark_share, grey_scene
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene, light_title
from photosite.scene.values import check_flag


def uniform(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    rule: Rule = "trapezoid",
) -> Scene:
    """A field of one light, of a given luminance.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, rule
        As for `photosite.scene.charts.macbeth`.

    Raises
    ------
    InputError
        If the illuminant is unknown or does not reach all the wavelengths.

    Examples
    --------
    >>> round(uniform("A", 12.5).mean_luminance_cd_m2(), 6)
    12.5
    """
    grid = wavelength_grid(wavelength_nm)
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    field = Scene.uniform(light, grid, distance_m, name=f"uniform field, illuminant {light_title(illuminant)}")
    return replace(field, reflectance=np.ones_like(field.basis)).with_mean_luminance(mean_luminance_cd_m2, rule)


def ramp(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    contrast: float = 1000.0,
    logarithmic: bool = False,
    rows: int = 64,
    cols: int = 512,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Light that rises from the left border to the right one.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    contrast
        Radiance at the right border over that at the left one, above 1; `math.inf` for a linear ramp from black.
    logarithmic
        Equal steps along the row are equal factors of radiance, not equal differences.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the contrast cannot be: a logarithmic ramp does not begin at black.

    Examples
    --------
    >>> stops = ramp(contrast=1024, logarithmic=True, cols=10).weights[0, 0]
    >>> (stops[1:] / stops[:-1]).round(4).tolist()[:3]
    [2.0, 2.0, 2.0]
    """
    check_size(rows, cols)
    check_flag("logarithmic", logarithmic)
    dark = dark_share(contrast)
    if logarithmic and dark == 0.0:
        raise InputError("a logarithmic ramp begins above black: give it a finite contrast")
    borders = np.arange(cols + 1) / cols
    if logarithmic:
        steepness = math.log(contrast)
        # The mean of dark * exp(steepness x) between borders; expm1 keeps a small contrast exact.
        line = dark * np.exp(steepness * borders[:-1]) * math.expm1(steepness / cols) / (steepness / cols)
    else:
        line = dark + (1.0 - dark) * (borders[:-1] + borders[1:]) / 2
    return grey_scene(
        np.broadcast_to(line, (rows, cols)),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"{'logarithmic' if logarithmic else 'linear'} ramp, contrast {contrast:g} : 1",
    )


def checkerboard(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    square: float = 32.0,
    contrast: float = 20.0,
    rows: int = 256,
    cols: int = 384,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Squares, bright and dark by turns, bright at the top left.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    square
        Side of a square in samples, 1 or more; it may be a fraction: samples that a side cuts hold their exact share.
    contrast
        Radiance of bright over that of dark, above 1; `math.inf` for black.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the side or contrast cannot be.

    Examples
    --------
    >>> board = checkerboard(square=1.5, contrast=float("inf"), rows=1, cols=4)
    >>> board.weights[0, 0].round(3).tolist()   # the square's side cuts the second sample in its middle
    [1.0, 0.5, 0.0, 1.0]
    """
    check_size(rows, cols)
    check_range("a checkerboard's square", square, 1.0, float(2 * max(rows, cols)), "samples")
    down, along = (
        coverage.square_wave((np.arange(count, dtype=np.float64) + 0.5) / (2 * square), 1 / (2 * square))
        for count in (rows, cols)
    )
    # The mean of a product of a function of the row and one of the column is the product of their means.
    share = 0.5 + 0.5 * down[:, None] * along[None, :]
    return grey_scene(
        between(share, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"checkerboard of {square:g} samples, contrast {contrast:g} : 1",
    )


def point_grid(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    pitch: int = 32,
    diameter: float | None = None,
    contrast: float = math.inf,
    rows: int = 256,
    cols: int = 384,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Bright points on a dark field, at equal steps from the field's centre.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field, most of it dark.
    pitch
        From point to point along rows and columns, in samples.
    diameter
        Of round points, in samples, up to the pitch; each sample holds the exact share of its area that they cover.
        None: each point is one sample.
    contrast
        Radiance of a point over that of the field, above 1; `math.inf` for a black field.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the pitch, diameter or contrast cannot be.

    Examples
    --------
    >>> stars = point_grid(pitch=8, diameter=0.5, rows=24, cols=24)
    >>> round(float(stars.weights.sum()) / 9, 6) == round(math.pi / 16, 6)   # nine points, each of area pi / 16
    True
    """
    check_size(rows, cols)
    if not isinstance(pitch, int | np.integer) or not 2 <= pitch <= min(rows, cols):
        raise InputError(f"a grid's pitch is a whole number of samples from 2 to the field's smaller side, not {pitch}")
    if diameter is not None and not 0 < diameter <= pitch:
        raise InputError(f"a point's diameter is above 0 and up to the pitch of {pitch} samples, not {diameter}")
    if diameter is None:
        cell = np.zeros((pitch, pitch))
        cell[pitch // 2, pitch // 2] = 1.0
    else:
        # In the middle of a sample, so that points smaller than one stay in one.
        middle = pitch // 2 + 0.5
        cell = coverage.disc(pitch + 1, pitch + 1, middle, middle, diameter / 2)
        cell[0] += cell[pitch]  # a pitch of odd size holds the disc; one of even size lets it reach into the next cell
        cell[:, 0] += cell[:, pitch]
        cell = cell[:pitch, :pitch]
    # A point stands on the field's centre sample.
    share = np.take(
        np.take(cell, (np.arange(rows) - rows // 2 + pitch // 2) % pitch, axis=0),
        (np.arange(cols) - cols // 2 + pitch // 2) % pitch,
        axis=1,
    )
    size = "of one sample" if diameter is None else f"of diameter {diameter:g}"
    return grey_scene(
        between(share, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"points {size} every {pitch} samples",
    )
