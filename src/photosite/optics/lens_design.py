"""PSFs over the field and wavelength, as lens-design programs compute them.

They become a few modes with weights over the sensor (`low_rank`), which the engine can apply to whole frames.
`photosite.optics.io.formats.load_lens_design` reads them from the text files of those programs.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from photosite.engine.threads import thread_count
from photosite.errors import InputError
from photosite.files.cache import cached_arrays
from photosite.optics.checks import camera_wavelengths, check_height_unit, check_number, check_whole, number_array
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import (
    Constant,
    FieldPsf,
    PlanePsf,
    PointSpread,
    RotatablePsf,
    SampledPsf,
    box_blurred,
    check_spacing,
    encircled_radius,
    normalized,
    sampled_otf,
)
from photosite.values.shown import Shown

Array = NDArray[np.float64]

TOLERANCE = 0.01
"""Default RMS error of the low-rank sum."""
_ENCLOSED = 0.995
_FEWEST_NODES, _MOST_NODES = 9, 21
_BEYOND_CUTOFF = 1.25
_NEGLIGIBLE_OTF = 0.02
"""Smaller values beyond the diffraction cutoff come from the truncated border of the samples."""
_SAME_FOCUS_WAVES = 0.25
_LARGEST_SAMPLES = 1 << 28


class LensDesignOptions(TypedDict, total=False):
    """How PSFs over the field become a low-rank sum, see `LensDesign`; `first_row` of listings is the top or bottom."""

    symmetric: bool
    tolerance: float
    rank: int
    detail_um: float
    nodes: int
    first_row: Literal["top", "bottom"]


@dataclass(frozen=True, eq=False)
class LensDesign(Shown):
    """PSFs at points of the field: a `Blur`.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    psf
        (F, L, n, n) samples of every field point at every wavelength, rows downwards as in the frame, the nominal image
        point at the sample (n // 2, n // 2). Each is normalized to sum 1.
    spacing_um
        Distance between samples on the sensor.
    field_y, field_x
        (F,) image points of the field points, y down, as in the frame.
    unit
        Unit of these: "mm" on the sensor, or "deg" in front of the lens, on each axis.
    symmetric
        True: a rotationally symmetric lens, whose points lie along one radius from the axis outwards, and whose PSFs
        are rotated to all azimuths. False: the points are a full grid of rows and columns.
    tolerance
        Largest error of the low-rank sum, relative to RMS; not used with `rank`.
    rank
        Number of modes.
    detail_um
        Side of a square on the sensor, such as a pixel. Modes are chosen, and their error stated, for PSFs blurred by
        it, which needs fewer modes. None: for PSFs as they are.
    nodes
        Nodes on each axis of the grid of a symmetric lens; None: twice the points, 9 to 21.

    Raises
    ------
    InputError
        If shapes do not match, samples are invalid, or field points are neither along one radius nor a grid.

    Notes
    -----
    Between the heights of a symmetric lens, rotated PSFs are mixed linearly, as between nodes and between wavelengths;
    they are not shifted into alignment. Beyond the outermost point its PSF is used. Field angles become image heights
    without distortion. The stated error is that at the nodes.

    Examples
    --------
    >>> axis = np.arange(-10, 11) * 0.5
    >>> r2 = axis[:, None] ** 2 + axis ** 2
    >>> psf = np.stack([np.exp(-r2 / 2), np.exp(-r2 / 4)])[:, None]     # twice the area at 8 mm
    >>> design = LensDesign(np.array([550.0]), psf, 0.5, np.zeros(2), np.array([0.0, 8.0]))
    >>> spread = design.point_spread(DiffractionLimited(2.8, 50), math.inf, None)
    >>> len(spread.modes), spread.weights.shape
    (2, (2, 9, 9))
    """

    wavelength_nm: Array
    psf: Array
    spacing_um: float
    field_y: Array
    field_x: Array
    unit: Literal["mm", "deg"] = "mm"
    symmetric: bool = True
    tolerance: float = TOLERANCE
    rank: int | None = None
    detail_um: float | None = None
    nodes: int | None = None

    def __post_init__(self) -> None:
        grid, psf = camera_wavelengths(self.wavelength_nm), number_array("psf", self.psf)
        y, x = number_array("field_y", self.field_y), number_array("field_x", self.field_x)
        if psf.ndim != 4 or psf.shape[2] != psf.shape[3] or psf.shape[:2] != (y.size, grid.size) or x.shape != y.shape:
            expected = f"of shape (F, L, n, n) for {grid.size} wavelengths L, field_y {y.shape} and field_x {x.shape}"
            raise InputError("psf", value=psf.shape, expected=expected)
        check_spacing(self.spacing_um)
        check_number("tolerance", self.tolerance, "a fraction between 0 and 1", above=0, below=1)
        if self.unit not in ("mm", "deg"):
            raise InputError("unit", value=self.unit, expected="'mm' or 'deg'")
        for name, values in (("field_y", y), ("field_x", x)):
            if not np.isfinite(values).all():
                raise InputError(name, value=values.tolist(), expected="finite")
            if self.unit == "deg" and np.abs(values).max() >= 90:
                hint = "Give image heights in mm"
                raise InputError(name, value=values.tolist(), expected="below 90 degrees", hint=hint)
        if self.unit == "mm":
            check_height_unit("field_y, field_x", float(np.hypot(y, x).max()))
        if self.detail_um is not None:
            check_number("detail_um", self.detail_um, "above 0, the side of a pixel", above=0)
        if self.nodes is not None:
            check_whole("nodes", self.nodes, "from 3 to 101", 3, 101)
        checked = np.empty_like(psf)
        for f in range(y.size):
            for w in range(grid.size):
                place = f"PSF at ({y[f]:g}, {x[f]:g}) {self.unit}, {grid[w]:g} nm"
                checked[f, w] = normalized(psf[f, w], place)
        for name, value in (("wavelength_nm", grid), ("psf", checked), ("field_y", y), ("field_x", x)):
            object.__setattr__(self, name, value)
        count = math.prod(axis.size for axis in self._nodes)  # raises for points that are neither a radius nor a grid
        if self.rank is not None:
            expected = f"from 1 to {count}, the number of nodes"
            check_whole("rank", self.rank, expected, 1, count)

    def point_spread(
        self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None = None
    ) -> PointSpread:
        """Return a `FieldPsf`, or a `PlanePsf` for a single field point.

        Raises `InputError` if the object is out of focus by more than a quarter wave: these PSFs apply in focus.
        """
        self._check_focus(base, distance_m, focus_distance_m)
        image_m = base.focal_length_mm * 1e-3 * (1 + base.magnification(focus_distance_m or distance_m))
        cutoffs = self._cutoffs_per_m(base.f_number * image_m / (base.focal_length_mm * 1e-3))
        if self.field_y.size == 1:
            return self._plane_psf(self.psf[0], cutoffs)
        y, x = (axis * (image_m if self.unit == "deg" else 1e-3) for axis in self._nodes)
        found = self.low_rank
        return FieldPsf(
            y_m=y,
            x_m=x,
            weights=found.weights.reshape(-1, y.size, x.size),
            modes=tuple(self._plane_psf(mode, cutoffs) for mode in found.modes),
            relative_error=found.relative_error,
        )

    @cached_property
    def low_rank(self) -> LowRank:
        """Modes (R, L, n, n) and weights (R, nodes), nodes row by row; cached on disk (`photosite.files.cache`)."""

        def compute() -> dict[str, Array]:
            samples = self.node_psfs()
            blurred = None if self.detail_um is None else box_blurred(samples, self.spacing_um, self.detail_um)
            found = low_rank(samples, tolerance=self.tolerance, rank=self.rank, compared=blurred)
            return {name: np.asarray(value) for name, value in vars(found).items()}

        found = cached_arrays("modes", (self,), compute)
        return LowRank(found["weights"], found["modes"], float(found["relative_error"]), found["error_by_rank"])

    @property
    def _image_points(self) -> tuple[Array, Array]:
        """Return (F,) y and x in mm, or for image distance 1 if fields are angles."""
        if self.unit == "mm":
            return self.field_y, self.field_x
        return np.tan(np.radians(self.field_y)), np.tan(np.radians(self.field_x))

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Return rows and columns of the grid, in the unit of `_image_points`."""
        y, x = self._image_points
        if not self.symmetric:
            rows, cols = np.unique(y), np.unique(x)
            if rows.size * cols.size != y.size or len(set(zip(y, x, strict=True))) != y.size:
                raise InputError(
                    f"{y.size} field points on {rows.size} rows and {cols.size} columns are not a full grid",
                    hint="Set symmetric for points along one radius",
                )
            return rows, cols
        heights = np.hypot(y, x)
        azimuth = np.arctan2(y, x)[heights > 0]
        if np.unique(heights).size != heights.size or np.ptp(np.unwrap(azimuth) if azimuth.size else [0.0]) > 1e-6:
            raise InputError(
                "field points of a symmetric lens must lie along one radius, each height once",
                hint="Give a full grid of rows and columns, and symmetric=False, for a lens without symmetry",
            )
        count = self.nodes or min(max(2 * heights.size - 1, _FEWEST_NODES), _MOST_NODES)
        axis = np.linspace(-heights.max(), heights.max(), count) if heights.max() > 0 else np.zeros(1)
        return axis, axis

    def node_psfs(self) -> Array:
        """Return (nodes, L, n, n) PSFs at the nodes of the grid, row by row."""
        rows, cols = self._nodes
        _, waves, n, _ = self.psf.shape
        if rows.size * cols.size * waves * n * n > _LARGEST_SAMPLES:
            raise InputError(
                f"{rows.size} x {cols.size} nodes of {waves} wavelengths with {n} x {n} samples exceed 2 GiB",
                hint="Reduce nodes, or the samples of the PSFs",
            )
        y, x = self._image_points
        if not self.symmetric:
            return np.ascontiguousarray(self.psf[np.lexsort((x, y))])
        order = np.argsort(np.hypot(y, x))
        heights = np.hypot(y, x)[order]
        start = math.atan2(y[order[-1]], x[order[-1]])
        result = np.empty((rows.size, cols.size, waves, n, n))
        with ThreadPoolExecutor(thread_count()) as pool:
            radius = list(pool.map(RotatablePsf, self.psf[order].reshape(-1, n, n)))

            def fill(places: list[tuple[int, int]]) -> None:
                i, j = places[0]
                angle = math.atan2(rows[i], cols[j]) - start if rows[i] or cols[j] else 0.0
                place = float(np.interp(math.hypot(rows[i], cols[j]), heights, np.arange(heights.size)))
                low, high = (waves * end for end in (math.floor(place), math.ceil(place)))
                for w in range(waves):
                    psf = radius[low + w]
                    if low != high:
                        psf = psf.mixed_with(radius[high + w], place - math.floor(place))
                    result[i, j, w] = psf.rotated(angle)
                for before, turned in pairwise(places):
                    result[turned] = np.rot90(result[before], -1, axes=(1, 2))

            orbits = (_quarter_turns(i, j, cols.size, n) for i, j in np.ndindex(rows.size, cols.size))
            list(pool.map(fill, [places for places in orbits if places[0] == min(places)]))
        return result.reshape(-1, waves, n, n)

    def _plane_psf(self, samples: Array, cutoffs_per_m: Array) -> PlanePsf:
        return PlanePsf(
            SampledPsf(self.wavelength_nm, samples, self.spacing_um * 1e-6),
            _Tabulated(self.wavelength_nm, cutoffs_per_m),
            Constant(self._reach_m),
            self.wavelength_nm,
        )

    @cached_property
    def _reach_m(self) -> float:
        spacing_m = self.spacing_um * 1e-6
        return max(encircled_radius(part, spacing_m, _ENCLOSED) for part in self.psf.reshape(-1, *self.psf.shape[2:]))

    def _cutoffs_per_m(self, working_f_number: float) -> Array:
        """Return (L,) cutoffs: diffraction's and a quarter more, for pupils that grow off axis, up to Nyquist."""
        nyquist = math.sqrt(0.5) / (self.spacing_um * 1e-6)
        mean = self.psf.mean(axis=0)
        angle = np.linspace(0, math.pi, 16, endpoint=False)
        limits = []
        for wavelength, samples in zip(self.wavelength_nm, mean, strict=True):
            limit = _BEYOND_CUTOFF / (wavelength * 1e-9 * working_f_number)
            beyond = np.linspace(limit, max(2 * limit, 1.01 * limit), 9)[:, None]
            values = sampled_otf(samples, self.spacing_um * 1e-6, beyond * np.sin(angle), beyond * np.cos(angle))
            limits.append(nyquist if np.abs(values).max() > _NEGLIGIBLE_OTF else min(limit, nyquist))
        return np.array(limits)

    def _check_focus(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> None:
        if focus_distance_m is None:
            return
        focal_m = base.focal_length_mm * 1e-3
        # Waves of defocus per dioptre between object and focus.
        per_dioptre = (focal_m / base.f_number) ** 2 / 8 / (self.wavelength_nm.mean() * 1e-9)
        focus, here = (0.0 if math.isinf(d) else 1 / d for d in (focus_distance_m, distance_m))
        if (waves := abs(focus - here) * per_dioptre) <= _SAME_FOCUS_WAVES:
            return
        depth = _SAME_FOCUS_WAVES / per_dioptre
        nearest = f"{1 / (focus + depth):.4g} m"
        in_focus = f"{nearest} or more" if focus <= depth else f"from {nearest} to {1 / (focus - depth):.4g} m"
        raise InputError(
            "distance_m",
            value=distance_m,
            expected=f"{in_focus}, where lens-design PSFs are in focus",
            hint=f"The object is {waves:.2g} waves out of focus. Move it, use a wavefront for defocus, or omit "
            "focus_distance_m in the optics file",
        )


def _quarter_turns(row: int, col: int, count: int, samples: int) -> list[tuple[int, int]]:
    """Return a node of a grid of (count, count) and its quarter turns, if PSFs of so many samples can make these."""
    places = [(row, col)]
    for _ in range(3 if samples % 2 else 0):
        row, col = col, count - 1 - row
        places.append((row, col))
    return places


@dataclass(frozen=True, eq=False)
class _Tabulated(Shown):
    """A function of wavelength, linear between tabulated values."""

    wavelength_nm: Array
    values: Array

    def __call__(self, wavelength_nm: float) -> float:
        return float(np.interp(wavelength_nm, self.wavelength_nm, self.values))


# Low-rank approximation of PSFs that vary over the field: a few modes with weights.
#
# The first mode is the mean over the field, with weight 1 everywhere. The others are principal components of the
# deviations. Every PSF sums to 1, so the others sum to 0: energy is conserved for any number of modes.


@dataclass(frozen=True, eq=False)
class LowRank(Shown):
    """Modes and weights.

    Parameters
    ----------
    weights, modes
        (R, nodes), and (R, ...) of the shape of one node's samples.
    relative_error
        RMS of the omitted part over the RMS of all samples.
    error_by_rank
        (nodes,) the same error for 1, 2, ... modes.
    """

    weights: Array
    modes: Array
    relative_error: float
    error_by_rank: Array


def low_rank(samples: Array, *, tolerance: float, rank: int | None = None, compared: Array | None = None) -> LowRank:
    """Return the fewest modes that keep a tolerance.

    Parameters
    ----------
    samples
        (nodes, ...): samples at every node of the field.
    tolerance
        Largest relative error, RMS over all samples of all nodes.
    rank
        Number of modes, in place of the tolerance; at most the number of nodes.
    compared
        (nodes, ...) the samples to compare, such as blurred ones: modes are chosen for them, and errors are theirs.
        None: the samples themselves.

    References
    ----------
    C. Eckart and G. Young, Psychometrika 1 (1936) 211, for the samples less their mean. It is computed from the Gram
    matrix of the nodes, so that errors below 1e-8 are rounding.

    Examples
    --------
    >>> ramp = np.linspace(0, 1, 5)[:, None] * np.array([1.0, -1.0]) + np.array([0.0, 1.0])
    >>> result = low_rank(ramp, tolerance=1e-6)
    >>> result.modes.shape, bool(np.allclose(result.weights.T @ result.modes, ramp))
    ((2, 2), True)
    """
    nodes = samples.shape[0]
    flat = samples.reshape(nodes, -1)
    mean = flat.mean(axis=0)
    rest = flat - mean
    seen = flat if compared is None else compared.reshape(nodes, -1)
    deviation = rest if compared is None else seen - seen.mean(axis=0)
    power, vectors = np.linalg.eigh(deviation @ deviation.T)
    power, vectors = np.maximum(power[::-1], 0.0), vectors[:, ::-1]
    left = np.append(np.cumsum(power[::-1])[::-1], 0.0)[:nodes]
    errors = np.sqrt(left / float((seen**2).sum()))
    count = min(rank or int(np.argmax(np.append(errors, 0.0) <= tolerance)) + 1, nodes)
    directions = vectors[:, : count - 1]
    weights = np.concatenate([np.ones((1, nodes)), directions.T])
    modes = np.concatenate([mean[None], directions.T @ rest])
    return LowRank(weights, modes.reshape(count, *samples.shape[1:]), float(errors[count - 1]), errors)
