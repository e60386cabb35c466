"""The optical transfer function of a lens, sampled in wavelength and spatial frequency (docs/theory/model.md).

A point spread of any shape becomes a kernel on the frame's cells. What makes such a kernel large are the rings of
diffraction: their light falls only as 1 / radius^3, because the transfer function of a pupil with a sharp border begins
as a cone, 1 - c |f|. Therefore the cone is split off as a multiple of the transfer function of a circular pupil. The
engine takes it as a function of |f|, whose extent is unlimited. The remainder is smooth at f = 0; its kernel is small.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.threads import thread_count
from photosite.engine.transfer import RadialTransfer, Sampling, Transfer
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread, RadialPsf, SampledPsf
from photosite.values.block_diagonal import block_diagonal

Array = NDArray[np.float64]

Progress = Callable[[int, int, str], object]
"""Receives the number of parts done, of how many, and what they are."""

FREQUENCY_NODES = 4097
_INTERPOLATION_TOLERANCE = 1e-5
"""Error of linear interpolation between the nodes of a table, relative to the largest transfer."""
_MOST_REFINEMENT = 32
_BLOCK = 8192
"""Frequencies whose transfers are computed at a time."""
_DIRECTIONS = 16
_CONE_SAMPLES = 12
_CONE_RADIUS = 0.05
"""Radius around f = 0, relative to the cutoff, in which the cone is fitted; halved while the transfer function falls by
more than `_CONE_FALL` within it."""
_CONE_FALL = 0.1
_SMALLEST_CONE = 1e-3
"""A smaller cone has a millionth of the light outside the kernel: it stays in the kernel."""
_THREADS = 4
"""Wavelengths sampled in parallel; each needs some hundred megabytes for a large pupil."""
_SMALLEST_KERNEL = 65
_LARGEST_KERNEL = 2049
"""Cells per axis; the kernels of 31 wavelengths then take a gigabyte."""
_SLOW_KERNEL = 500
"""Cells per axis above which 41 wavelengths take more than half a minute."""
_LARGEST_RADIAL = 16384
"""Cells per axis of a spread that needs no kernel; the frame is padded by this many."""
_HINT = "Check the units of the optics and the focus, or use fewer cells per pixel"


@dataclass(frozen=True, eq=False)
class SampledOtf:
    """Transfer function of a lens, mode by mode, at the wavelengths at which it is known (spectral nodes)."""

    # (wavelengths, nodes) weights of linear interpolation: the fraction of each wavelength's light at each node
    node_fractions: Array
    radial: Array | None  # (R, nodes, frequencies) part that depends on |f| only; None without such a part
    step_per_m: float  # frequency step of `radial`
    # (R, nodes, Q, Q // 2 + 1) spectra of the kernels on the cells; None if the spread depends on |f| only
    kernel_spectra: NDArray[np.complex128] | None
    padding_m: float  # distance to either side over which a point is spread

    @property
    def parts(self) -> tuple[Array, ...]:
        """(R, nodes, values) tables that add up to the transfer function; complex values as pairs."""
        kernels = None
        if self.kernel_spectra is not None:
            kernels = self.kernel_spectra.view(np.float64).reshape(*self.kernel_spectra.shape[:2], -1)
        return tuple(table for table in (self.radial, kernels) if table is not None)

    @property
    def modes(self) -> int:
        """R, the number of modes; 1 for a spread that is the same over the whole field."""
        return len(self.parts[0])

    def transfer(self, coupling: Array, mixing: Array) -> Transfer:
        """Return the engine's transfer, from coupling (channels, maps, nodes) and mixing (terms, R, maps)."""
        to_terms = np.einsum("trk,ckn->ctrn", mixing, coupling, optimize=True)
        radial = None
        if self.radial is not None:
            radial = RadialTransfer(np.tensordot(to_terms, self.radial, axes=((2, 3), (0, 1))), self.step_per_m)
        if self.kernel_spectra is None:
            assert radial is not None
            return Transfer(refined(radial))
        size = self.kernel_spectra.shape[2]
        spectra = np.tensordot(to_terms, self.kernel_spectra, axes=((2, 3), (0, 1)))
        from scipy.fft import irfft2

        kernels = irfft2(spectra, s=(size, size), workers=-1)
        return Transfer(radial, np.fft.fftshift(kernels, axes=(2, 3)))


@dataclass(frozen=True, eq=False)
class MapTransfers:
    """Transfers from maps to channels, as `coefficients @ tables`, because all together would be large."""

    coefficients: Array  # (channels, maps, values) what a map contributes to each table value
    tables: tuple[Array, ...]  # (values, n): the same values at n frequencies, or real and imaginary parts

    @classmethod
    def by_map(cls, otf: SampledOtf, coupling: Array) -> list[MapTransfers]:
        """Return the transfers of each mode; `coupling` is (channels, maps, nodes), as for `SampledOtf.transfer`."""
        return [cls(coupling, tuple(table[r] for table in otf.parts)) for r in range(otf.modes)]

    @classmethod
    def by_mode_and_map(cls, otf: SampledOtf, coupling: Array) -> MapTransfers:
        """Return the transfers of the maps of all modes, mode after mode."""
        coefficients = np.stack([block_diagonal(*[of_channel] * otf.modes) for of_channel in coupling])
        return cls(coefficients, tuple(table.reshape(-1, table.shape[2]) for table in otf.parts))

    def squares(self, stride: int) -> Array:
        """Return (maps, maps): the sum over channels, and every `stride`-th frequency, of products of transfers."""
        products = sum(table[:, ::stride] @ table[:, ::stride].T for table in self.tables)
        return np.asarray((self.coefficients @ products @ self.coefficients.transpose(0, 2, 1)).sum(axis=0))

    def without(self, mixing: Array) -> MapTransfers:
        """Return what orthonormal combinations of maps (terms, maps) leave."""
        return MapTransfers(self.coefficients - mixing.T @ (mixing @ self.coefficients), self.tables)

    def within(self, limit: float, stride: int) -> bool:
        """Return whether all transfers are at most a limit at every `stride`-th frequency."""
        return all(float(np.abs(block).max()) <= limit for block in self._blocks(stride))

    def largest(self, stride: int) -> float:
        """Return the largest magnitude at every `stride`-th frequency."""
        return max(float(np.abs(block).max()) for block in self._blocks(stride))

    def _blocks(self, stride: int) -> Iterator[Array]:
        flat = self.coefficients.reshape(-1, self.coefficients.shape[2])
        for table in self.tables:
            for first in range(0, table.shape[1], _BLOCK * stride):
                yield flat @ table[:, first : first + _BLOCK * stride : stride]


def sample_otf(
    spread: PointSpread, wavelength_nm: Array, sampling: Sampling, progress: Progress | None = None
) -> SampledOtf:
    """Sample the transfer function of a lens at the (wavelengths,) of the light; report wavelengths done.

    The modes of a `FieldPsf` are multiplied by `field_scale`.

    Raises `InputError` if a point is spread over more cells than a mosaic can be computed with.

    Warns `PhotositeWarning` if it is spread over so many that computing the transfer functions takes long.
    """
    if isinstance(spread, RadialPsf):
        return _sample_radial(spread, wavelength_nm, sampling)
    if isinstance(spread, PlanePsf):
        return _sample_modes((spread,), np.ones(1), wavelength_nm, sampling, progress)
    return _sample_modes(spread.modes, field_scale(spread), wavelength_nm, sampling, progress)


def field_scale(spread: FieldPsf) -> Array:
    """Return (R,) the largest magnitude of each mode's field weights; 1 for a mode whose weights are all 0."""
    largest: Array = np.abs(spread.weights).max(axis=(1, 2))
    largest[largest == 0] = 1.0
    return largest


def _sample_radial(spread: RadialPsf, wavelength_nm: Array, sampling: Sampling) -> SampledOtf:
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    _cells_across(spread.reach_m(middle), sampling, _LARGEST_RADIAL)
    frequencies = np.linspace(0.0, max(spread.cutoff_per_m(w) for w in wavelength_nm), FREQUENCY_NODES)
    otfs = np.stack([spread.otf(frequencies, w) for w in wavelength_nm])
    padding_m = spread.reach_m(middle) + max(sampling.split_m) / 2
    return SampledOtf(np.eye(wavelength_nm.size), otfs[None], float(frequencies[1]), None, padding_m)


def kernel_size(reach_m: float, sampling: Sampling) -> int:
    """Return the cells per axis of a kernel for the low-pass filter's four spots; odd, with a fast transform."""
    from scipy.fft import next_fast_len

    cells = _cells_across(reach_m, sampling, _LARGEST_KERNEL)
    if cells > _SLOW_KERNEL:
        what = f"the lens spreads a point over {cells:.0f} cells of the sensor, which may take minutes to compute"
        warnings.warn(PhotositeWarning(what, hint=_HINT), stacklevel=2)
    size = max(math.ceil(cells), _SMALLEST_KERNEL)
    while size % 2 == 0 or next_fast_len(size) != size:
        size += 1
    return size


def _cells_across(reach_m: float, sampling: Sampling, most: int) -> float:
    """Return the cells per axis that a spread with its low-pass filter and pixel covers; check the limit."""
    across_m = 2 * reach_m + max(sampling.split_m)
    cells = (across_m / min(sampling.pitch_m) + 2) * sampling.cells_per_pixel
    if not cells <= most:
        number = round(cells) if math.isfinite(cells) else cells
        what = "the number of cells over which the lens spreads a point"
        where = f"point spread of {across_m * 1e3:g} mm"
        raise InputError(what, value=number, expected=f"at most {most}", where=where, hint=_HINT)
    return cells


def refined(radial: RadialTransfer) -> RadialTransfer:
    """Add nodes by cubic splines if the transfer oscillates between them, as for a strongly defocused lens."""
    from scipy.interpolate import CubicSpline

    table = radial.table
    largest = np.abs(table).max()
    bend = np.abs(np.diff(table, 2)).max() / 8
    if bend <= _INTERPOLATION_TOLERANCE * largest:
        return radial
    factor = min(math.ceil(math.sqrt(bend / (_INTERPOLATION_TOLERANCE * largest))), _MOST_REFINEMENT)
    nodes = np.arange(table.shape[2])
    fine = np.linspace(0.0, nodes[-1], (nodes.size - 1) * factor + 1)
    return RadialTransfer(CubicSpline(nodes, table, axis=2)(fine), radial.step_per_m / factor)


def _sample_modes(
    modes: tuple[PlanePsf, ...], scale: Array, wavelength_nm: Array, sampling: Sampling, progress: Progress | None
) -> SampledOtf:
    node_fractions, nodes_nm = _spectral_nodes(modes[0], wavelength_nm)
    samples = _ModeSamples(modes, scale, nodes_nm, sampling)
    samples.fill(0)  # alone: what all wavelengths share is computed once, in the first
    with ThreadPoolExecutor(min(thread_count(), _THREADS)) as pool:
        for done, _ in enumerate(pool.map(samples.fill, range(1, nodes_nm.size)), 2):
            if progress is not None:
                progress(done, nodes_nm.size, "wavelengths")
    padding_m = (samples.size // 2 + 1) * max(sampling.cell_m(axis) for axis in (0, 1))
    radial = samples.cones if samples.cones.any() else None
    return SampledOtf(node_fractions, radial, samples.step_per_m, samples.spectra, padding_m)


def _spectral_nodes(mode: PlanePsf, wavelength_nm: Array) -> tuple[Array, Array]:
    """Return (wavelengths, nodes) fractions and (nodes,) wavelengths: linear between nodes, constant beyond them."""
    if mode.wavelength_nm is None:
        return np.eye(wavelength_nm.size), wavelength_nm
    grid = np.asarray(mode.wavelength_nm, np.float64)
    fractions = np.stack([np.interp(wavelength_nm, grid, unit) for unit in np.eye(grid.size)], axis=1)
    used = fractions.any(axis=0)
    return fractions[:, used], grid[used]


@dataclass(eq=False)
class _ModeSamples:
    """Samples of modes, one wavelength at a time: the cone as a function of |f|, and the spectrum of the remainder."""

    modes: tuple[PlanePsf, ...]
    scale: Array
    nodes_nm: Array
    sampling: Sampling
    size: int = field(init=False)
    step_per_m: float = field(init=False)
    cones: Array = field(init=False)
    spectra: NDArray[np.complex128] = field(init=False)

    def __post_init__(self) -> None:
        count, nodes = len(self.modes), self.nodes_nm
        self.size = kernel_size(max(mode.reach_m(w) for mode in self.modes for w in nodes), self.sampling)
        self.step_per_m = max(mode.cutoff_per_m(w) for mode in self.modes for w in nodes) / (FREQUENCY_NODES - 1)
        self.cones = np.zeros((count, nodes.size, FREQUENCY_NODES))
        self.spectra = np.empty((count, nodes.size, self.size, self.size // 2 + 1), np.complex128)

    def fill(self, n: int) -> None:
        """Compute the samples of all modes at wavelength n."""
        frequencies = self.step_per_m * np.arange(FREQUENCY_NODES, dtype=np.float64)
        wavelength_nm = self.nodes_nm[n]
        for r, mode in enumerate(self.modes):
            cone = _cone(mode, wavelength_nm)
            if abs(cone) * self.scale[r] < _SMALLEST_CONE:
                cone = 0.0
            else:
                pupil = circular_pupil_otf(frequencies / mode.cutoff_per_m(wavelength_nm))
                self.cones[r, n] = self.scale[r] * cone * pupil
            remainder = _remainder_spectrum(mode, wavelength_nm, cone, self.sampling, self.size)
            self.spectra[r, n] = self.scale[r] * remainder


def circular_pupil_otf(r: Array) -> Array:
    """Return the transfer function of a circular pupil at r = |f| / cutoff (Goodman, Fourier Optics, eq. 6-32)."""
    r = np.minimum(r, 1.0)
    return np.asarray((2 / math.pi) * (np.arccos(r) - r * np.sqrt(1 - r * r)))


def _cone(mode: PlanePsf, wavelength_nm: float) -> float:
    """Return the multiple of a circular pupil's transfer function that has the same cone at f = 0.

    The autocorrelation of a pupil with a sharp border begins with a loss proportional to the border's length and |f|;
    aberrations add smooth terms. An error of this fit is harmless: the kernel contains the remainder.
    """
    cutoff = mode.cutoff_per_m(wavelength_nm)
    angle = (np.arange(_DIRECTIONS) + 0.5) * (math.pi / _DIRECTIONS)
    at_0 = complex(mode.otf(np.zeros(1), np.zeros(1), wavelength_nm)[0]).real
    radius = _CONE_RADIUS
    while True:
        r = radius * np.arange(1, _CONE_SAMPLES + 1) / _CONE_SAMPLES
        f = cutoff * r[:, None]
        mean = mode.otf(f * np.sin(angle), f * np.cos(angle), wavelength_nm).real.mean(axis=1)
        if np.abs(mean - at_0).max() <= _CONE_FALL * max(abs(at_0), np.abs(mean).max()) or radius < 1e-4:
            break
        radius /= 2
    u = r / radius
    shape = np.stack([(1 - circular_pupil_otf(r)) / radius, u**2, u**3, u**4], axis=1)
    return float(np.linalg.lstsq(shape, (at_0 - mean) / radius, rcond=None)[0][0])


def _remainder_spectrum(
    mode: PlanePsf, wavelength_nm: float, cone: float, sampling: Sampling, size: int
) -> NDArray[np.complex128]:
    """Return (Q, Q // 2 + 1): the transfer function without its cone, times photodetector and cell, folded at 1 / cell.

    Half of the columns suffice, because the point spread is real.
    """
    cutoff = mode.cutoff_per_m(wavelength_nm)
    if isinstance(mode.otf, SampledPsf):
        # The Fourier sum is a product of a factor of each axis, and so is its folded sum.
        samples, position = mode.otf.samples_at(wavelength_nm), mode.otf.position_m
        most = min(cutoff, mode.otf.nyquist_per_m)
        down, across = (_folded_factors(sampling, axis, size, most, position) for axis in (0, 1))
        total = down @ (samples @ across[: size // 2 + 1].T)
        return total - cone * _folded_pupil(cutoff, sampling, size) if cone else total
    return _folded(
        lambda fy, fx: mode.otf(fy, fx, wavelength_nm) - (cone * _pupil(cutoff, fy, fx) if cone else 0.0),
        cutoff,
        sampling,
        size,
    )


def _pupil(cutoff_per_m: float, fy_per_m: Array, fx_per_m: Array) -> Array:
    return circular_pupil_otf(np.hypot(fy_per_m, fx_per_m) / cutoff_per_m)


@lru_cache(maxsize=8)
def _folded_pupil(cutoff_per_m: float, sampling: Sampling, size: int) -> NDArray[np.complex128]:
    """Return what `_folded` does for a circular pupil; the modes of a lens share it."""
    return _folded(partial(_pupil, cutoff_per_m), cutoff_per_m, sampling, size)


def _folded_factors(
    sampling: Sampling, axis: int, size: int, most_per_m: float, position_m: Array
) -> NDArray[np.complex128]:
    """Return (Q, n) phase factors of positions on an axis, times photodetector and cell, folded at 1 / cell."""
    cell_m = sampling.cell_m(axis)
    zones = math.ceil(most_per_m * cell_m)
    f = np.arange(-zones * size, (zones + 1) * size) / (size * cell_m)
    weight = sampling.aperture(axis, f) * (np.abs(f) <= most_per_m)
    factors = weight[:, None] * np.exp((-2j * math.pi) * f[:, None] * position_m)
    folded: NDArray[np.complex128] = factors.reshape(-1, size, position_m.size).sum(axis=0)
    return folded


def _folded(otf: Callable[[Array, Array], Any], cutoff: float, sampling: Sampling, size: int) -> NDArray[np.complex128]:
    """Return (Q, Q // 2 + 1): a transfer function times photodetector and cell, folded at 1 / cell."""
    step = [np.float64(1.0 / (size * sampling.cell_m(axis))) for axis in (0, 1)]
    zones = [math.ceil(cutoff * sampling.cell_m(axis)) for axis in (0, 1)]
    row = np.arange(-zones[0] * size, (zones[0] + 1) * size)
    inside = np.abs(row) * step[0] <= cutoff
    fy: Array = (row[inside] * step[0])[:, None]
    aperture_y = sampling.aperture(0, fy)
    total = np.zeros((size, size // 2 + 1), np.complex128)
    for zone in range(-zones[1], zones[1] + 1):
        col = np.arange(size // 2 + 1) + zone * size
        near = np.abs(col) * step[1] <= cutoff
        if not near.any():
            continue
        fx: Array = (col[near] * step[1])[None, :]
        values = np.zeros((row.size, near.size), np.complex128)
        values[np.ix_(inside, near)] = otf(fy, fx) * (aperture_y * sampling.aperture(1, fx))
        total += values.reshape(-1, size, near.size).sum(axis=0)
    return total
