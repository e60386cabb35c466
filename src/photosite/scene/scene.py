"""A scene: spectral radiance as weights over a few basis spectra, at a distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.regions import Region
from photosite.spectra import Rule, integration_weights, luminance_cd_m2, wavelength_grid

DEFAULT_DISTANCE_M = 1.2


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands in front of the camera: photon radiance `sum_k weights[k] * basis[k]`.

    Parameters
    ----------
    weights
        (K, rows, cols) float32; signed weights are allowed, the radiance they make is not negative.
        A sample is the mean over its own rectangle; the radiance is taken as constant within it.
    basis
        (K, wavelengths) photons/s/sr/m2/nm.
    wavelength_nm
        (wavelengths,), increasing.
    distance_m
        From the lens to the scene.
    width_m
        Width of the scene at its distance. None: the scene fills the sensor, scaled evenly until it covers it.
    regions
        Named rectangles of samples, a chart's patches.
    name
        What to call it.

    Raises
    ------
    InputError
        If shapes do not fit, values are not finite, or the distance or width is not positive.

    Examples
    --------
    >>> grey = Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10))
    >>> grey.shape, grey.weights.shape, grey.basis.shape
    ((1, 1), (1, 1, 1), (1, 31))
    """

    weights: NDArray[np.float32]
    basis: NDArray[np.float64]
    wavelength_nm: NDArray[np.float64]
    distance_m: float = DEFAULT_DISTANCE_M
    width_m: float | None = None
    regions: tuple[Region, ...] = ()
    name: str = "scene"

    def __post_init__(self) -> None:
        weights = np.asarray(self.weights, dtype=np.float32)
        basis = np.asarray(self.basis, dtype=np.float64)
        grid = wavelength_grid(self.wavelength_nm)
        if weights.ndim != 3 or 0 in weights.shape or basis.shape != (weights.shape[0], grid.size):
            raise InputError(
                "a scene is weights (K, rows, cols) and basis (K, wavelengths): got weights "
                f"{weights.shape}, basis {basis.shape}, {grid.size} wavelengths"
            )
        if not (np.isfinite(weights).all() and np.isfinite(basis).all()):
            raise InputError("a scene's weights and basis must be finite; some are NaN or infinite")
        if not (np.isfinite(self.distance_m) and self.distance_m > 0):
            raise InputError(f"a scene's distance must be above 0 m, not {self.distance_m}")
        if self.width_m is not None and not (np.isfinite(self.width_m) and self.width_m > 0):
            raise InputError(f"a scene's width must be above 0 m, not {self.width_m}")
        for name, value in (("weights", weights), ("basis", basis), ("wavelength_nm", grid)):
            object.__setattr__(self, name, value)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of samples."""
        return self.weights.shape[1], self.weights.shape[2]

    @classmethod
    def uniform(
        cls,
        photon_radiance: ArrayLike,
        wavelength_nm: ArrayLike,
        distance_m: float = DEFAULT_DISTANCE_M,
        name: str = "uniform field",
    ) -> Scene:
        """A field of one spectrum everywhere.

        Parameters
        ----------
        photon_radiance
            (wavelengths,) photons/s/sr/m2/nm, none negative.
        wavelength_nm
            (wavelengths,), increasing.
        distance_m
            From the lens to the field.
        name
            What to call it.

        Raises
        ------
        InputError
            If lengths differ or a value is negative or not finite.
        """
        radiance = _radiance(photon_radiance, 1)
        return cls(
            np.ones((1, 1, 1), np.float32),
            radiance[None],
            wavelength_grid(wavelength_nm),
            distance_m,
            name=name,
        )

    @classmethod
    def from_radiance(
        cls,
        photon_radiance: ArrayLike,
        wavelength_nm: ArrayLike,
        *,
        distance_m: float = DEFAULT_DISTANCE_M,
        width_m: float | None = None,
        tolerance: float = 1e-3,
        name: str = "scene",
    ) -> Scene:
        """A scene from its radiance at every sample, by truncated singular value decomposition.

        Parameters
        ----------
        photon_radiance
            (rows, cols, wavelengths) photons/s/sr/m2/nm, none negative.
        wavelength_nm
            (wavelengths,), increasing.
        distance_m, width_m, name
            As for `Scene`.
        tolerance
            Largest RMS error of the radiance relative to its RMS; the fewest basis spectra that keep it are used.

        Raises
        ------
        InputError
            If shapes do not fit, a value is negative or not finite, or the tolerance is not between 0 and 1.

        Examples
        --------
        >>> ramp = np.linspace(0, 1e14, 6)[:, None, None] * np.ones((6, 8, 31))
        >>> Scene.from_radiance(ramp, np.arange(400, 701, 10)).weights.shape   # one spectrum is enough
        (1, 6, 8)
        """
        radiance = _radiance(photon_radiance, 3)
        if not 0 < tolerance < 1:
            raise InputError(f"the tolerance is a fraction of the RMS radiance, between 0 and 1, not {tolerance}")
        rows, cols, count = radiance.shape
        samples = radiance.reshape(-1, count)
        # Eigenvectors of the small (wavelengths, wavelengths) matrix: the right singular vectors of the tall one.
        power, vectors = np.linalg.eigh(samples.T @ samples)
        power, vectors = (
            np.maximum(power[::-1], 0.0),
            vectors[:, ::-1],
        )  # rounding only: the matrix is a Gram matrix
        left_over = power.sum() - np.cumsum(power)
        K = int(np.argmax(left_over <= tolerance**2 * power.sum())) + 1 if power.sum() > 0 else 1
        weights = samples @ vectors[:, :K]
        scale = np.abs(weights).max(axis=0)
        scale[scale == 0] = 1.0  # a dark scene: weights stay zero
        return cls(
            (weights / scale).T.reshape(K, rows, cols).astype(np.float32),
            scale[:, None] * vectors[:, :K].T,
            wavelength_grid(wavelength_nm),
            distance_m,
            width_m,
            name=name,
        )

    def radiance(self, row: int, col: int) -> NDArray[np.float64]:
        """(wavelengths,) photon radiance of one sample."""
        return self.weights[:, row, col].astype(np.float64) @ self.basis

    def mean_luminance_cd_m2(self, rule: Rule = "trapezoid") -> float:
        """Mean luminance over all samples, in cd/m2; a chart's black gaps count too."""
        means = self.weights.mean(axis=(1, 2), dtype=np.float64)
        return float(luminance_cd_m2(means @ self.basis, self.wavelength_nm, rule))

    def with_mean_luminance(self, mean_luminance_cd_m2: float, rule: Rule = "trapezoid") -> Scene:
        """The same scene, brighter or darker, so that its mean luminance is the one given.

        Raises
        ------
        InputError
            If the luminance is negative, or the scene is dark.
        """
        if not (np.isfinite(mean_luminance_cd_m2) and mean_luminance_cd_m2 >= 0):
            raise InputError(f"a mean luminance is 0 cd/m2 or more, not {mean_luminance_cd_m2}")
        now = self.mean_luminance_cd_m2(rule)
        if now <= 0:
            raise InputError("a scene without light cannot be given a luminance; give it a radiance first")
        return self.scaled(mean_luminance_cd_m2 / now)

    def scaled(self, factor: float) -> Scene:
        """The same scene with its radiance multiplied by a factor."""
        if not (np.isfinite(factor) and factor >= 0):
            raise InputError(f"radiance is multiplied by 0 or more, not {factor}")
        return replace(self, basis=self.basis * factor)

    def light_outside(self, wavelength_nm: ArrayLike, response: ArrayLike) -> float:
        """Share of a response's area that lies beyond the scene's wavelengths, where the scene says nothing.

        Parameters
        ----------
        wavelength_nm, response
            (n,) the response, a quantum efficiency say.
        """
        response_grid = wavelength_grid(wavelength_nm)
        first, last = self.wavelength_nm[0], self.wavelength_nm[-1]
        if first == last:  # a line: it says that there is no other light
            return 0.0
        if response_grid.size == 1:
            return 0.0 if first <= response_grid[0] <= last else 1.0
        ends = [w for w in (first, last) if response_grid[0] < w < response_grid[-1]]
        grid = np.union1d(response_grid, ends)
        values = np.interp(grid, response_grid, np.asarray(response, np.float64))
        inside = (grid >= first) & (grid <= last)
        total = float(values @ integration_weights(grid))
        seen = float(values[inside] @ integration_weights(grid[inside])) if inside.sum() > 1 else 0.0
        return 1.0 - seen / total if total > 0 else 0.0


def _radiance(photon_radiance: ArrayLike, ndim: int) -> NDArray[np.float64]:
    radiance = np.asarray(photon_radiance, dtype=np.float64)
    if radiance.ndim != ndim or radiance.size == 0:
        wanted = "(wavelengths,)" if ndim == 1 else "(rows, cols, wavelengths)"
        raise InputError(f"photon radiance is an array {wanted}, not of shape {radiance.shape}")
    if not np.isfinite(radiance).all() or (radiance < 0).any():
        raise InputError("photon radiance must be finite and not negative; some values are not")
    return radiance


def labelled(
    labels: NDArray[np.intp],
    spectra: NDArray[np.float64],
    wavelength_nm: NDArray[np.float64],
    *,
    distance_m: float,
    width_m: float | None,
    regions: Sequence[Region],
    name: str,
) -> Scene:
    """A scene of few colours: (rows, cols) indices into (K, wavelengths) spectra, -1 for black. Exact."""
    weights = (labels[None] == np.arange(len(spectra))[:, None, None]).astype(np.float32)
    return Scene(weights, spectra, wavelength_nm, distance_m, width_m, tuple(regions), name)
