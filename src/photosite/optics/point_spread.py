"""Point spread functions (PSF) on the sensor: given by their optical transfer functions (OTF), and sampled.

Positions on the sensor are (y, x) in m: y down the rows of the frame, x along its columns, 0 on the optical axis. A PSF
is normalized to unit energy. Its OTF is

    otf(fy, fx) = integral of psf(y, x) exp(-2 pi i (fy y + fx x)) dy dx,

which is 1 at (0, 0). A single mode of a `FieldPsf` may have any value there.

Samples are those of a band-limited function, (rows, cols), rows downwards as in the frame, at the distance `spacing` on
both axes; the origin is the sample (rows // 2, cols // 2). Between samples the function is a sum of sinc functions. Its
OTF is therefore the Fourier sum of the samples up to half the sampling frequency, and 0 beyond.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.checks import check_number
from photosite.values.shown import Shown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Constant(Shown):
    """A function of wavelength with one value."""

    value: float

    def __call__(self, wavelength_nm: float) -> float:
        return self.value


@dataclass(frozen=True, eq=False)
class RadialPsf(Shown):
    """A rotationally symmetric PSF, the same over the whole field; its OTF is real.

    Parameters
    ----------
    otf
        (frequency_per_m of any shape, wavelength_nm) -> real values of that shape.
    cutoff_per_m
        wavelength_nm -> frequency beyond which the OTF is 0, cycles/m.
    reach_m
        wavelength_nm -> radius on the sensor that encloses 99.5 % of the energy.
    """

    otf: Callable[[Array, float], Array]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]


@dataclass(frozen=True, eq=False)
class PlanePsf(Shown):
    """A PSF of any shape, the same over the whole field.

    Parameters
    ----------
    otf
        (fy_per_m, fx_per_m, wavelength_nm) -> complex values of the broadcast shape of the frequencies.
    cutoff_per_m, reach_m
        As for `RadialPsf`, in the direction where they are largest.
    wavelength_nm
        Wavelengths of the tabulated PSF: linear in between, the nearest one beyond. None: computed at each wavelength.
    """

    otf: Callable[[Array, Array, float], NDArray[np.complex128]]
    cutoff_per_m: Callable[[float], float]
    reach_m: Callable[[float], float]
    wavelength_nm: Array | None = None


@dataclass(frozen=True, eq=False)
class FieldPsf(Shown):
    """A PSF that varies over the field: the sum over r of weights[r] at the image point times modes[r].

    Parameters
    ----------
    y_m, x_m
        (P,), (Q,) increasing: nodes on the sensor. Weights are bilinear in between, those of the nearest node beyond.
    weights
        (R, P, Q).
    modes
        R PSFs with the same `wavelength_nm`. At every node their weighted sum has unit energy.
    relative_error
        RMS error of the sum over all nodes and wavelengths, relative to the RMS of the lens's PSFs; 0 if exact.
    """

    y_m: Array
    x_m: Array
    weights: Array
    modes: tuple[PlanePsf, ...]
    relative_error: float = 0.0


PointSpread = RadialPsf | PlanePsf | FieldPsf


def in_part_of_field(spread: FieldPsf, y_m: tuple[float, float], x_m: tuple[float, float]) -> FieldPsf:
    """Return the same PSFs in a part of the field, from fewer modes where the part has fewer nodes than modes.

    The first mode stays; the others become the principal components of the weights in the part. Nothing is left out.
    Spreads whose OTFs are not sampled stay as they are.

    Parameters
    ----------
    spread
        PSFs over the field.
    y_m, x_m
        First and last position of the part on each axis.

    Examples
    --------
    >>> spots = np.zeros((4, 1, 3, 3))
    >>> spots[range(4), 0, (1, 0, 1, 2), (1, 1, 0, 2)] = 1.0
    >>> modes = tuple(PlanePsf(SampledPsf(np.array([550.0]), s, 1e-6), Constant(5e5), Constant(1e-6)) for s in spots)
    >>> nodes = np.array([0.0, 1e-3, 2e-3, 3e-3])
    >>> spread = FieldPsf(np.zeros(1), nodes, np.eye(4)[:, None], modes)
    >>> part = in_part_of_field(spread, (0.0, 0.0), (0.2e-3, 0.8e-3))
    >>> len(part.modes), part.x_m
    (2, array([0.   , 0.001]))
    """
    rows, cols = (_nodes_around(nodes, part) for nodes, part in ((spread.y_m, y_m), (spread.x_m, x_m)))
    weights = spread.weights[:, rows, cols]
    sampled = [mode.otf for mode in spread.modes if isinstance(mode.otf, SampledPsf)]
    if weights[0].size + 1 >= len(spread.modes) or len(sampled) < len(spread.modes):
        return spread
    modes, size, nodes = np.linalg.svd(weights[1:].reshape(len(weights) - 1, -1), full_matrices=False)
    used = int(np.count_nonzero(size > _ROUNDING * np.linalg.norm(weights)))
    samples = np.tensordot(modes[:, :used] * size[:used], np.stack([otf.samples for otf in sampled[1:]]), axes=(0, 0))
    return replace(
        spread,
        y_m=spread.y_m[rows],
        x_m=spread.x_m[cols],
        weights=np.concatenate([weights[:1], nodes[:used].reshape(-1, *weights.shape[1:])]),
        modes=(
            spread.modes[0],
            *(replace(spread.modes[0], otf=replace(sampled[0], samples=own)) for own in samples),
        ),
    )


def _nodes_around(nodes: Array, part: tuple[float, float]) -> slice:
    """Return the nodes from the last one below a part of an axis to the first one above it."""
    first = int(np.searchsorted(nodes, part[0], side="right")) - 1
    return slice(max(first, 0), int(np.searchsorted(nodes, part[1])) + 1)


_ROUNDING = 1e-13
"""Weights of modes, relative to all, that are rounding errors."""


Complex = NDArray[np.complex128]

_CHUNK = 2048
_OVERSAMPLING = 4
"""Factor before interpolation by splines of fifth order, which then err by about 1e-5 at the highest frequency."""
_ROTATION_ORDER = 5
_SMALLEST_SPACING_UM = 0.01
"""A tenth of what the shortest wavelength and the fastest lens need; less indicates a wrong unit."""


def sample_positions(count: int, spacing: float) -> Array:
    """Return (count,) positions of samples on an axis, 0 at count // 2."""
    return (np.arange(count, dtype=np.float64) - count // 2) * spacing


def sampled_otf(samples: Array, spacing_m: float, fy_per_m: Array, fx_per_m: Array) -> Complex:
    """Return the OTF of a sampled PSF: the Fourier sum of its (n, n) samples, 0 beyond half the sampling frequency.

    The frequencies broadcast; a column and a row are fastest.

    Examples
    --------
    >>> one = np.zeros((3, 3)); one[1, 2] = 1.0      # a sample to the right of the origin
    >>> sampled_otf(one, 1e-6, np.zeros(1), np.array([0.25e6])).round(6)
    array([0.-1.j])
    """
    fy, fx = np.asarray(fy_per_m, np.float64), np.asarray(fx_per_m, np.float64)
    limit = 0.5 / spacing_m * (1 + 1e-12)
    rows, cols = samples.shape
    if fy.ndim == 2 and fx.ndim == 2 and fy.shape[1] == 1 and fx.shape[0] == 1:
        down = _phase_factors(fy.tobytes(), rows, spacing_m) * (np.abs(fy) <= limit)
        across = _phase_factors(fx.tobytes(), cols, spacing_m) * (np.abs(fx.T) <= limit)
        return down @ (samples @ across.T)
    fy, fx = np.broadcast_arrays(fy, fx)
    flat_y, flat_x = fy.reshape(-1), fx.reshape(-1)
    out = np.empty(flat_y.size, np.complex128)
    for first in range(0, out.size, _CHUNK):
        part = slice(first, first + _CHUNK)
        down, across = (
            _phase_factors(flat[part].tobytes(), count, spacing_m) for flat, count in ((flat_y, rows), (flat_x, cols))
        )
        out[part] = np.einsum("ij,ij->i", down @ samples, across)
    out[(np.abs(flat_y) > limit) | (np.abs(flat_x) > limit)] = 0
    return out.reshape(fy.shape)


@dataclass(frozen=True, eq=False)
class SampledPsf(Shown):
    """The OTF of PSFs sampled at several wavelengths, linear in between: an `otf` of `PlanePsf`.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    samples
        (L, n, n).
    spacing_m
        Distance between samples on the sensor.
    """

    wavelength_nm: Array
    samples: Array
    spacing_m: float

    def __call__(self, fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> Complex:
        return sampled_otf(self.samples_at(wavelength_nm), self.spacing_m, fy_per_m, fx_per_m)

    @property
    def position_m(self) -> Array:
        """(n,) positions of the samples on each axis."""
        return sample_positions(self.samples.shape[1], self.spacing_m)

    @property
    def nyquist_per_m(self) -> float:
        """Half the sampling frequency, beyond which the OTF is 0 on each axis; a rounding error beyond is not."""
        return 0.5 / self.spacing_m * (1 + 1e-12)

    def samples_at(self, wavelength_nm: float) -> Array:
        """Return (n, n) samples at a wavelength; those of the nearest beyond the last."""
        fractions = [
            float(np.interp(wavelength_nm, self.wavelength_nm, unit)) for unit in np.eye(self.wavelength_nm.size)
        ]
        used = [fraction * part for fraction, part in zip(fractions, self.samples, strict=True) if fraction]
        mixed: Array = used[0] if len(used) == 1 else used[0] + used[1]
        return mixed


@lru_cache(maxsize=16)
def _phase_factors(frequency_per_m: bytes, count: int, spacing_m: float) -> Complex:
    """Return (frequencies, count) phase factors; cached, because the modes of a lens share their frequencies."""
    factors: Complex = np.exp(
        (-2j * math.pi) * np.frombuffer(frequency_per_m)[:, None] * sample_positions(count, spacing_m)
    )
    factors.flags.writeable = False
    return factors


def check_spacing(spacing_um: float | None) -> None:
    """Raise `InputError` for a distance between samples that is not above 0, or below 0.01 um."""
    low = _SMALLEST_SPACING_UM
    hint = "If the value is in m, multiply it by 1e6; if in mm, by 1000"
    check_number("spacing_um", spacing_um, f"{low} or more", at_least=low, hint=hint)


def normalized(samples: Array, where: str) -> Array:
    """Return samples divided by their sum; raise `InputError`, whose `where` names the PSF, if they are no PSF.

    They are none with NaN, a sum that is not above 0, or a value below -2 % of the peak.
    """
    if not np.isfinite(samples).all():
        raise InputError("psf", where=where, expected="finite")
    total = float(samples.sum())
    if not total > 0:
        raise InputError("psf", where=where, expected="of a sum above 0", value=total)
    if samples.min() < -0.02 * samples.max():
        limit = f"above -2 % of its peak of {samples.max():g}"
        raise InputError("psf", where=where, expected=limit, value=samples.min())
    return samples / total


def resampled(samples: Array, origin: tuple[float, float], spacing: float, count: int, to_spacing: float) -> Array:
    """Return (count, count) samples of the same energy on another grid: sums of sinc functions, 0 beyond the samples.

    `origin` is the (row, col) of the origin. `to_spacing` is at most `spacing`, to avoid aliasing.
    """
    matrices = []
    for axis in (0, 1):
        position = sample_positions(count, to_spacing)[:, None]
        own = (np.arange(samples.shape[axis]) - origin[axis]) * spacing
        matrices.append(np.sinc((position - own) / spacing) * (to_spacing / spacing))
    return matrices[0] @ samples @ matrices[1].T


class RotatablePsf:
    """One PSF of (n, n) samples that can be rotated about its origin."""

    def __init__(self, samples: Array) -> None:
        from scipy.ndimage import spline_filter

        count = samples.shape[0]
        self.samples = samples
        self.padded = count + 2 * (count // 8 + 2)  # a margin, because the Fourier sum is periodic
        border = (self.padded - count) // 2
        fine = _oversampled(np.pad(samples, border), _OVERSAMPLING)
        self.coefficients = spline_filter(fine, order=_ROTATION_ORDER, mode="grid-wrap")

    def mixed_with(self, other: RotatablePsf, fraction: float) -> RotatablePsf:
        """Return (1 - fraction) of this PSF plus fraction of another of the same size."""
        between = copy(self)
        between.samples = (1 - fraction) * self.samples + fraction * other.samples
        between.coefficients = (1 - fraction) * self.coefficients + fraction * other.coefficients
        return between

    def rotated(self, angle_rad: float) -> Array:
        """Return (n, n) samples rotated from right (x) towards down (y) by an angle, of the same energy."""
        from scipy.ndimage import map_coordinates

        quarter = round(angle_rad / (math.pi / 2))
        if abs(angle_rad - quarter * math.pi / 2) < 1e-12 and self.samples.shape[0] % 2 == 1:
            return np.rot90(self.samples, -quarter).copy()
        count = self.samples.shape[0]
        y, x = sample_positions(count, 1.0)[:, None], sample_positions(count, 1.0)[None, :]
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        place = np.stack(np.broadcast_arrays(cos * y - sin * x, sin * y + cos * x))
        middle = (self.padded // 2) * _OVERSAMPLING
        rotated_samples = map_coordinates(
            self.coefficients, place * _OVERSAMPLING + middle, order=_ROTATION_ORDER, mode="grid-wrap", prefilter=False
        )
        # The corners may have left the square, or entered it from the next period.
        outside = np.abs(place).max(axis=0) > count // 2
        rotated_samples[outside] = 0
        result: Array = rotated_samples * (self.samples.sum() / rotated_samples.sum())
        return result


def _oversampled(samples: Array, times: int) -> Array:
    """Return a period of the Fourier sum at `times` as many points on each axis."""
    import scipy.fft

    count = samples.shape[0]
    spectrum = np.fft.fftshift(scipy.fft.fft2(samples))
    size = count * times
    whole = np.zeros((size, size), np.complex128)
    first = size // 2 - count // 2
    whole[first : first + count, first : first + count] = spectrum
    result: Array = scipy.fft.ifft2(np.fft.ifftshift(whole)).real * times**2
    return result


def box_blurred(samples: Array, spacing: float, side: float) -> Array:
    """Return (..., n, n) samples blurred by a square of the given side.

    Examples
    --------
    >>> axis = np.arange(-20, 21) / 2
    >>> gauss = np.exp(-(axis[:, None] ** 2 + axis**2) / 2)
    >>> float(box_blurred(gauss, 0.5, 1.0)[20, 20].round(6))    # 2 pi erf(0.5 / sqrt(2))^2
    0.921313
    """
    import scipy.fft

    count = samples.shape[-1]
    size = scipy.fft.next_fast_len(count + 2 * math.ceil(side / spacing), real=True)
    f = np.fft.fftfreq(size, spacing)
    window = np.sinc(f * side)[:, None] * np.sinc(f[: size // 2 + 1] * side)
    spectrum = scipy.fft.rfft2(samples, s=(size, size), workers=-1)
    spectrum *= window
    result: Array = scipy.fft.irfft2(spectrum, s=(size, size), workers=-1, overwrite_x=True)[..., :count, :count]
    return result


def encircled_radius(samples: Array, spacing: float, fraction: float) -> float:
    """Return the radius about the origin that encloses a fraction of the energy, in the unit of the spacing."""
    y, x = (sample_positions(count, spacing) for count in samples.shape)
    radius = np.hypot(y[:, None], x).ravel()
    order = np.argsort(radius, kind="stable")
    held = np.cumsum(np.abs(samples).ravel()[order])
    index = min(int(np.searchsorted(held, fraction * held[-1])), held.size - 1)
    return float(radius[order][index])


def otf_at(
    spread: PointSpread, fy_per_m: Array, fx_per_m: Array, wavelength_nm: float, y_m: float = 0.0, x_m: float = 0.0
) -> NDArray[np.complex128]:
    """Return the OTF at an image point: complex, of the broadcast shape of the frequencies.

    Parameters
    ----------
    spread
        The PSF.
    fy_per_m, fx_per_m
        Frequencies down the rows and along the columns, cycles/m.
    wavelength_nm
        Wavelength. Tables are linear between their wavelengths.
    y_m, x_m
        Image point on the sensor; on the axis by default.

    Examples
    --------
    >>> import photosite as ps
    >>> airy = ps.DiffractionLimited(f_number=4, focal_length_mm=25).point_spread(float("inf"))
    >>> otf_at(airy, np.zeros(2), np.array([0.0, 1e5]), 500.0).real.round(3)
    array([1.   , 0.747])
    """
    if isinstance(spread, RadialPsf):
        return np.asarray(spread.otf(np.hypot(fy_per_m, fx_per_m), wavelength_nm), np.complex128)
    if isinstance(spread, FieldPsf):
        along = [[np.interp(x_m, spread.x_m, row) for row in weights] for weights in spread.weights]
        fractions = [float(np.interp(y_m, spread.y_m, column)) for column in along]
        parts = [
            fraction * otf_at(mode, fy_per_m, fx_per_m, wavelength_nm)
            for fraction, mode in zip(fractions, spread.modes, strict=True)
        ]
        return np.asarray(sum(parts), np.complex128)
    grid = np.array([wavelength_nm]) if spread.wavelength_nm is None else np.asarray(spread.wavelength_nm)
    fractions = [float(np.interp(wavelength_nm, grid, unit)) for unit in np.eye(grid.size)]
    used = [(fraction, float(w)) for fraction, w in zip(fractions, grid, strict=True) if fraction]
    return np.asarray(sum(fraction * spread.otf(fy_per_m, fx_per_m, w) for fraction, w in used), np.complex128)
