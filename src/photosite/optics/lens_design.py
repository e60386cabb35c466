"""Point spreads of a lens over its field and over wavelength, as lens-design programs compute them.

They become a few modes with weights over the sensor (`photosite.optics.low_rank`): what the engine can apply to whole
frames. `photosite.optics.io.listings` reads them from those programs' text files.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_height_unit, check_numbers
from photosite.optics.lens import DiffractionLimited, camera_wavelengths
from photosite.optics.low_rank import LowRank, low_rank
from photosite.optics.radial_table import numbers
from photosite.optics.sampled import Rotated, box_blurred, check_spacing, light_radius, normalised, transfer
from photosite.optics.spread import FieldSpread, PlaneSpread, Spread

Array = NDArray[np.float64]

TOLERANCE = 0.01
"""Of RMS: what a low-rank sum may lack, unless told otherwise."""
_SHARE = 0.995
_FEWEST_NODES, _MOST_NODES = 9, 21
_BEYOND_CUTOFF = 1.25
_NOTHING = 0.02
"""Of a transfer function: less than this beyond diffraction's cutoff is the samples' cut-off border."""
_SAME_FOCUS_WAVES = 0.25
_LARGEST_SAMPLES = 1 << 28


@dataclass(frozen=True, eq=False)
class LensDesign:
    """Point spreads at points of the field: a `Blur`.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing.
    psf
        (F, L, n, n) samples of every field point at every wavelength, rows downwards and upright as the frame is, the
        point's nominal image at the sample (n // 2, n // 2). Each is normalised to light 1.
    spacing_um
        Between samples, on the sensor.
    field_y, field_x
        (F,) where the field points' images lie, y down, upright as the frame is.
    unit
        Of these: "mm" on the sensor, or "deg" in front of the lens, on each axis.
    symmetric
        Whether the lens is rotationally symmetric and the points lie along one radius, from the axis outwards. They are
        then turned to all azimuths. Otherwise they are a full grid of rows and columns.
    tolerance
        Largest error of the low-rank sum, relative to RMS; not used if there is a rank.
    rank
        Number of modes.
    detail_um
        Side of a square on the sensor, a pixel's: modes are chosen, and their error stated, for point spreads blurred
        by it. Fewer modes do then. None: for point spreads as they are.
    nodes
        On each axis of the grid to which a symmetric lens is turned; None: twice the points, 9 to 21.

    Raises
    ------
    InputError
        If shapes do not fit, samples cannot be a point spread, or field points are neither along one radius nor a grid.

    Notes
    -----
    Between heights of a symmetric lens the turned point spreads are mixed linearly, as they are between nodes and
    between wavelengths; nothing is shifted to align them. Beyond the outermost point its point spread is used. Field
    angles become image heights without the lens's distortion. The stated error is that at the nodes.

    Examples
    --------
    >>> axis = np.arange(-10, 11) * 0.5
    >>> r2 = axis[:, None] ** 2 + axis ** 2
    >>> psf = np.stack([np.exp(-r2 / 2), np.exp(-r2 / 4)])[:, None]     # twice the area at 8 mm
    >>> design = LensDesign(np.array([550.0]), psf, 0.5, np.zeros(2), np.array([0.0, 8.0]))
    >>> spread = design.spread(DiffractionLimited(2.8, 50), math.inf, None)
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
        grid, psf = camera_wavelengths(self.wavelength_nm), numbers("psf", self.psf)
        y, x = numbers("field_y", self.field_y), numbers("field_x", self.field_x)
        given = [name for name in ("detail_um",) if getattr(self, name) is not None]
        check_numbers(self, "spacing_um", "tolerance", *given)
        check_numbers(self, *[name for name in ("rank", "nodes") if getattr(self, name) is not None], whole=True)
        if psf.ndim != 4 or psf.shape[2] != psf.shape[3] or psf.shape[:2] != (y.size, grid.size) or x.shape != y.shape:
            raise InputError(
                "lens-design point spreads are psf (F, L, n, n) for field_y and field_x (F,) and wavelength_nm (L,): "
                f"got {psf.shape}, {y.shape}, {x.shape} and {grid.shape}"
            )
        check_spacing(self.spacing_um)
        if self.unit not in ("mm", "deg"):
            raise InputError(f"the unit of field points is 'mm' or 'deg', not {self.unit!r:.40}")
        if not (np.isfinite(y).all() and np.isfinite(x).all()):
            raise InputError("field points are finite numbers; some of field_y or field_x are not")
        if self.unit == "mm":
            check_height_unit("the field", float(np.hypot(y, x).max()))
        if self.unit == "deg" and max(np.abs(y).max(), np.abs(x).max()) >= 90:
            raise InputError("field angles must stay below 90 degrees; give image heights in mm")
        if self.detail_um is not None and not (math.isfinite(self.detail_um) and self.detail_um > 0):
            raise InputError(f"detail_um, the side of a pixel, must be above 0, not {self.detail_um}")
        if self.nodes is not None and not 3 <= self.nodes <= 101:
            raise InputError(f"a grid of nodes has 3 to 101 on each axis, not {self.nodes}")
        checked = np.empty_like(psf)
        for f in range(y.size):
            for w in range(grid.size):
                what = f"the point spread at ({y[f]:g}, {x[f]:g}) {self.unit}, {grid[w]:g} nm"
                checked[f, w] = normalised(psf[f, w], what)
        for name, value in (("wavelength_nm", grid), ("psf", checked), ("field_y", y), ("field_x", x)):
            object.__setattr__(self, name, value)
        count = math.prod(axis.size for axis in self._nodes)  # refuses points that are no radius and no grid
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance is a fraction between 0 and 1, not {self.tolerance}")
        if self.rank is not None and not 1 <= self.rank <= count:
            raise InputError(f"a low-rank sum over {count} nodes has 1 to {count} modes, not {self.rank}")

    def spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> Spread:
        """A `FieldSpread`; a `PlaneSpread` if there is one field point only.

        Raises
        ------
        InputError
            If the object is out of focus by more than a quarter of a wave: these point spreads hold in focus.
        """
        self._check_focus(base, distance_m, focus_distance_m)
        image_m = base.focal_length_mm * 1e-3 * (1 + base.magnification(focus_distance_m or distance_m))
        cutoff = self._cutoff(base.f_number * image_m / (base.focal_length_mm * 1e-3))
        if self.field_y.size == 1:
            return self._mode(self.psf[0], cutoff)
        y, x = (axis * (image_m if self.unit == "deg" else 1e-3) for axis in self._nodes)
        found = self.low_rank
        return FieldSpread(
            y_m=y,
            x_m=x,
            weights=found.weights.reshape(-1, y.size, x.size),
            modes=tuple(self._mode(mode, cutoff) for mode in found.modes),
            relative_error=found.relative_error,
        )

    @cached_property
    def low_rank(self) -> LowRank:
        """Modes (R, L, n, n) and weights (R, nodes), rows of nodes one after another."""
        samples = self.node_psfs()
        judged = None if self.detail_um is None else box_blurred(samples, self.spacing_um, self.detail_um)
        return low_rank(samples, tolerance=self.tolerance, rank=self.rank, judged=judged)

    @property
    def _plane(self) -> tuple[Array, Array]:
        """(F,) places on a plane: mm, or at image distance 1."""
        if self.unit == "mm":
            return self.field_y, self.field_x
        return np.tan(np.radians(self.field_y)), np.tan(np.radians(self.field_x))

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Rows and columns of the grid, in mm or at image distance 1."""
        y, x = self._plane
        if not self.symmetric:
            rows, cols = np.unique(y), np.unique(x)
            if rows.size * cols.size != y.size or len(set(zip(y, x, strict=True))) != y.size:
                raise InputError(
                    f"field points must be a full grid, each row at each column: {y.size} points lie on {rows.size} "
                    f"rows and {cols.size} columns; set symmetric for points along one radius"
                )
            return rows, cols
        heights = np.hypot(y, x)
        azimuth = np.arctan2(y, x)[heights > 0]
        if np.unique(heights).size != heights.size or np.ptp(np.unwrap(azimuth) if azimuth.size else [0.0]) > 1e-6:
            raise InputError(
                "field points of a symmetric lens lie along one radius, each height once; give a full grid of rows and "
                "columns for a lens without symmetry"
            )
        count = self.nodes or min(max(2 * heights.size - 1, _FEWEST_NODES), _MOST_NODES)
        axis = np.linspace(-heights.max(), heights.max(), count) if heights.max() > 0 else np.zeros(1)
        return axis, axis

    def node_psfs(self) -> Array:
        """(nodes, L, n, n) point spreads at the nodes of the grid, rows of nodes one after another."""
        rows, cols = self._nodes
        _, waves, n, _ = self.psf.shape
        if rows.size * cols.size * waves * n * n > _LARGEST_SAMPLES:
            raise InputError(
                f"{rows.size} x {cols.size} nodes of {waves} wavelengths with {n} x {n} samples are more than fit into "
                "2 GiB; give fewer nodes, or point spreads with fewer samples"
            )
        y, x = self._plane
        if not self.symmetric:
            return np.ascontiguousarray(self.psf[np.lexsort((x, y))])
        order = np.argsort(np.hypot(y, x))
        heights = np.hypot(y, x)[order]
        start = math.atan2(y[order[-1]], x[order[-1]])
        radius = [[Rotated(self.psf[f, w]) for w in range(waves)] for f in order]
        result = np.empty((rows.size, cols.size, waves, n, n))
        todo = np.ones((rows.size, cols.size), bool)
        for i, j in np.ndindex(rows.size, cols.size):
            if not todo[i, j]:
                continue
            angle = math.atan2(rows[i], cols[j]) - start if rows[i] or cols[j] else 0.0
            place = float(np.interp(math.hypot(rows[i], cols[j]), heights, np.arange(heights.size)))
            low, high = math.floor(place), math.ceil(place)
            for w in range(waves):
                here = radius[low][w] if low == high else radius[low][w].towards(radius[high][w], place - low)
                result[i, j, w] = here.at(angle)
            # The grid is its own image by quarter turns, and so are samples with one in the middle.
            k, m = i, j
            for _ in range(3 if n % 2 else 0):
                before = result[k, m]
                k, m = m, cols.size - 1 - k
                result[k, m], todo[k, m] = np.rot90(before, -1, axes=(1, 2)), False
        return result.reshape(-1, waves, n, n)

    def _mode(self, samples: Array, cutoff: Callable[[float], float]) -> PlaneSpread:
        spacing_m = self.spacing_um * 1e-6
        grid = self.wavelength_nm

        def otf(fy_per_m: Array, fx_per_m: Array, wavelength_nm: float) -> NDArray[np.complex128]:
            shares = [float(np.interp(wavelength_nm, grid, unit)) for unit in np.eye(grid.size)]
            mixed = sum((share * part for share, part in zip(shares, samples, strict=True) if share), 0 * samples[0])
            return transfer(mixed, spacing_m, fy_per_m, fx_per_m)

        return PlaneSpread(otf, cutoff, lambda _: self._reach_m, grid)

    @cached_property
    def _reach_m(self) -> float:
        spacing_m = self.spacing_um * 1e-6
        return max(light_radius(part, spacing_m, _SHARE) for part in self.psf.reshape(-1, *self.psf.shape[2:]))

    def _cutoff(self, working_f_number: float) -> Callable[[float], float]:
        """Diffraction's cutoff and a quarter more, for pupils that grow off axis; or what the samples can hold."""
        sampled = math.sqrt(0.5) / (self.spacing_um * 1e-6)
        mean = self.psf.mean(axis=0)
        angle = np.linspace(0, math.pi, 16, endpoint=False)
        limits = []
        for wavelength, samples in zip(self.wavelength_nm, mean, strict=True):
            limit = _BEYOND_CUTOFF / (wavelength * 1e-9 * working_f_number)
            beyond = np.linspace(limit, max(2 * limit, 1.01 * limit), 9)[:, None]
            values = transfer(samples, self.spacing_um * 1e-6, beyond * np.sin(angle), beyond * np.cos(angle))
            limits.append(sampled if np.abs(values).max() > _NOTHING else min(limit, sampled))
        return lambda wavelength_nm: float(np.interp(wavelength_nm, self.wavelength_nm, limits))

    def _check_focus(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> None:
        if focus_distance_m is None:
            return
        focal_m = base.focal_length_mm * 1e-3
        # Waves of defocus for each 1/m between object and focus.
        per_dioptre = (focal_m / base.f_number) ** 2 / 8 / (self.wavelength_nm.mean() * 1e-9)
        focus, here = (0.0 if math.isinf(d) else 1 / d for d in (focus_distance_m, distance_m))
        if (waves := abs(focus - here) * per_dioptre) <= _SAME_FOCUS_WAVES:
            return
        depth = _SAME_FOCUS_WAVES / per_dioptre
        nearest = f"{1 / (focus + depth):.4g} m"
        held = f"from {nearest} on" if focus <= depth else f"from {nearest} to {1 / (focus - depth):.4g} m"
        raise InputError(
            f"lens-design point spreads hold in focus, here {held}, and this object at {distance_m:g} m is {waves:.2g} "
            "waves out of it; place it there (--distance), use a wavefront for defocus, or name the point spreads in "
            "an optics file without focus_distance_m"
        )
