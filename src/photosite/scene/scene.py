"""A scene: spectral radiance as weights over a few basis spectra, at a distance; and its preview."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import (
    D65_XY,
    PUBLISHED_SRGB_FROM_XYZ,
    cat02_adaptation,
    luminance_cd_m2,
    srgb_from_light,
    xyz,
    xyz_of_chromaticity,
)
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, integration_weights, photons_from_energy, wavelength_grid
from photosite.errors import InputError
from photosite.scene.cube import ArrayCube
from photosite.scene.options import ReadOptions
from photosite.scene.polarization import Polarization
from photosite.scene.weights import checked_weights, component_means, reduce_to_components
from photosite.values.limits import check_magnitude
from photosite.values.region import Region
from photosite.values.saved import write
from photosite.values.shown import Shown, drawn
from photosite.values.thumbnail import stride_for, thumbnail_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DEFAULT_DISTANCE_M = 1.2

_ONE_LIGHT = 1e-4
"""Largest part of a basis that reflectance times one light may leave over: files store spectra in few digits."""


@dataclass(frozen=True, eq=False)
class Scene(Shown):
    """What the camera sees: photon radiance `sum_k weights[k] * basis[k]`.

    Parameters
    ----------
    weights
        (K, rows, cols) float32. Weights may be negative; the radiance that they make is not. A sample is the mean over
        its own rectangle, and the radiance is constant within it.
    basis
        (K, wavelengths) photons/s/sr/m2/nm.
    wavelength_nm
        (wavelengths,), increasing.
    distance_m
        From the lens to the scene.
    width_m
        Width of the scene at its distance. None: the scene is scaled evenly until it covers the sensor.
    regions
        Named rectangles of samples, such as a chart's patches.
    name
        Name of the scene.
    reflectance
        (K, wavelengths) where a single light falls on the whole scene: the basis is the reflectance times that light's
        photons from a perfect white. `with_illuminant` needs it. None where it is not known.
    relative_error
        RMS error of the radiance relative to its RMS, where it was reduced from more spectra; 0 where it is exact.
    patches
        Whether the scene is a chart whose luminance is the mean of its patches, the regions, without the black between
        them.
    polarization
        Linear polarization of the light, which pixels with polarizers see; None is unpolarized.

    Raises
    ------
    InputError
        If shapes do not fit, values are not finite, the distance or width is not positive, or the basis is not the
        reflectance under one light.

    Examples
    --------
    >>> gray = Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10))
    >>> gray.shape, gray.weights.shape, gray.basis.shape
    ((1, 1), (1, 1, 1), (1, 31))
    """

    weights: NDArray[np.float32]
    basis: NDArray[np.float64]
    wavelength_nm: NDArray[np.float64]
    distance_m: float = DEFAULT_DISTANCE_M
    width_m: float | None = None
    regions: tuple[Region, ...] = ()
    name: str = "scene"
    reflectance: NDArray[np.float64] | None = None
    relative_error: float = 0.0
    patches: bool = False
    polarization: Polarization | None = None

    def __post_init__(self) -> None:
        weights, finite = checked_weights(self.weights)
        basis = np.asarray(self.basis, dtype=np.float64)
        grid = wavelength_grid(self.wavelength_nm)
        if weights.ndim != 3 or 0 in weights.shape or basis.shape != (weights.shape[0], grid.size):
            what = f"weights {weights.shape} and basis {basis.shape} do not fit {grid.size} wavelengths"
            raise InputError(what, hint="Give weights (K, rows, cols) and basis (K, wavelengths)")
        if not (finite and np.isfinite(basis).all()):
            raise InputError("weights and basis must be finite; some values are NaN or infinite")
        for name in ("distance_m", "width_m"):
            value = getattr(self, name)
            if not (value is None and name == "width_m") and not (np.isfinite(value) and value > 0):
                raise InputError(name, value=value, expected="above 0")
            check_magnitude(name, value)
        rows, cols = weights.shape[1:]
        if self.patches and any(part.r1 > rows or part.c1 > cols for part in self.regions):
            raise InputError("regions", expected=f"within the chart of {rows} x {cols} samples")
        if self.polarization is not None and self.polarization.shape not in ((), (rows, cols)):
            expected = f"one degree and angle, or ({rows}, {cols}) as the scene's samples"
            raise InputError("polarization", value=self.polarization.shape, expected=expected)
        for name, value in (("weights", weights), ("basis", basis), ("wavelength_nm", grid)):
            object.__setattr__(self, name, value)
        if self.reflectance is not None:
            object.__setattr__(self, "reflectance", _checked_reflectance(basis, self.reflectance))

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
        """Return a field with the same spectrum everywhere.

        Parameters
        ----------
        photon_radiance
            (wavelengths,) photons/s/sr/m2/nm, none negative.
        wavelength_nm, distance_m, name
            As for `Scene`.
        """
        radiance = _checked_radiance(photon_radiance, 1)
        grid = wavelength_grid(wavelength_nm)
        return cls(np.ones((1, 1, 1), np.float32), radiance[None], grid, distance_m, name=name)

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
        """Return a scene of the radiance of every sample, by truncated singular value decomposition.

        Parameters
        ----------
        photon_radiance
            (rows, cols, wavelengths) photons/s/sr/m2/nm, none negative.
        wavelength_nm, distance_m, width_m, name
            As for `Scene`.
        tolerance
            Largest RMS error of the radiance relative to its RMS. The scene has the fewest basis spectra that keep it.

        Examples
        --------
        >>> ramp = np.linspace(0, 1e14, 6)[:, None, None] * np.ones((6, 8, 31))
        >>> Scene.from_radiance(ramp, np.arange(400, 701, 10)).weights.shape   # one spectrum is enough
        (1, 6, 8)
        """
        radiance = _checked_radiance(photon_radiance, 3)
        grid = wavelength_grid(wavelength_nm)
        if radiance.shape[2] != grid.size:
            raise InputError(f"the radiance has {radiance.shape[2]} values in a sample, for {grid.size} wavelengths")
        options = ReadOptions(tolerance=tolerance, distance_m=distance_m, width_m=width_m)
        rows, cols, bands = radiance.shape
        cube = ArrayCube(
            name=name, shape=(rows, cols, bands), wavelength_nm=grid, quantity="photon radiance", values=radiance
        )
        ones = np.ones(grid.size)
        parts = reduce_to_components(cube, np.arange(bands), options, ones, ones)
        basis, error = parts.spectra * parts.to_photons, parts.relative_error
        return cls(parts.weights, basis, grid, distance_m, width_m, name=name, relative_error=error)

    def radiance(self, row: int, col: int) -> NDArray[np.float64]:
        """Return the photon radiance (wavelengths,) of one sample."""
        return self.weights[:, row, col].astype(np.float64) @ self.basis

    def mean_luminance_cd_m2(self, rule: Rule = "trapezoid") -> float:
        """Return the mean luminance in cd/m2: of the patches of a chart of patches, of all samples of any other scene.

        Examples
        --------
        >>> from photosite.scene.charts import macbeth
        >>> chart = macbeth("A", 40)
        >>> round(chart.mean_luminance_cd_m2(), 4), round(chart.sample_luminance_cd_m2(), 4)
        (40.0, 29.0909)
        """
        if not (self.patches and self.regions):
            return self.sample_luminance_cd_m2(rule)
        means = [component_means(self.weights[:, part.r0 : part.r1, part.c0 : part.c1]) for part in self.regions]
        return float(luminance_cd_m2(np.mean(means, axis=0) @ self.basis, self.wavelength_nm, rule))

    def sample_luminance_cd_m2(self, rule: Rule = "trapezoid") -> float:
        """Return the mean luminance of all samples in cd/m2, a chart's black gaps included."""
        return float(luminance_cd_m2(component_means(self.weights) @ self.basis, self.wavelength_nm, rule))

    def with_mean_luminance(self, mean_luminance_cd_m2: float, rule: Rule = "trapezoid") -> Scene:
        """Return the scene scaled to a `mean_luminance_cd_m2`.

        Raises
        ------
        InputError
            If the luminance is negative, or the scene is dark.
        """
        return self._scaled_to(mean_luminance_cd_m2, self.mean_luminance_cd_m2(rule))

    def with_sample_luminance(self, sample_luminance_cd_m2: float, rule: Rule = "trapezoid") -> Scene:
        """Return the scene scaled to a `sample_luminance_cd_m2`."""
        return self._scaled_to(sample_luminance_cd_m2, self.sample_luminance_cd_m2(rule))

    def _scaled_to(self, wanted_cd_m2: float, now_cd_m2: float) -> Scene:
        if not (np.isfinite(wanted_cd_m2) and wanted_cd_m2 >= 0):
            raise InputError("mean_luminance_cd_m2", value=wanted_cd_m2, expected="0 or more")
        if now_cd_m2 <= 0:
            raise InputError("a dark scene cannot be scaled to a luminance", hint="Give it a radiance first")
        return self.scaled(wanted_cd_m2 / now_cd_m2)

    def scaled(self, factor: float) -> Scene:
        """Return the scene with its radiance multiplied by a factor; the reflectance does not change."""
        if not (np.isfinite(factor) and factor >= 0):
            raise InputError("factor", value=factor, expected="0 or more")
        return replace(self, basis=self.basis * factor)

    def polarized(self, degree: ArrayLike, angle_deg: ArrayLike) -> Scene:
        """Return the scene with linearly polarized light; arguments as for `photosite.scene.polarization.Polarization`.

        Examples
        --------
        >>> sky = Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10)).polarized(0.6, 30.0)
        >>> sky.polarization.stokes.round(3)
        array([0.3 , 0.52])
        """
        return replace(self, polarization=Polarization(degree, angle_deg))

    def light(self) -> NDArray[np.float64]:
        """Return the photons/s/sr/m2/nm (wavelengths,) that a perfect white in the scene sends out.

        0 at a wavelength that nothing in the scene reflects, where the light is unknown.

        Raises
        ------
        InputError
            If the scene's reflectance is not known.
        """
        return _light(self.basis, self.known_reflectance())

    def known_reflectance(self) -> NDArray[np.float64]:
        """Return the reflectance; raise `InputError` where it is not known, so that the light cannot be changed."""
        if self.reflectance is None:
            raise InputError(
                f"the light of '{self.name}' cannot be changed: only its radiance is known, not its reflectances",
                hint="Use a scene made from reflectances, such as a chart or a picture under one light",
            )
        return self.reflectance

    def with_illuminant(
        self, illuminant: str | float | Spectrum, mean_luminance_cd_m2: float | None = None, rule: Rule = "trapezoid"
    ) -> Scene:
        """Return the scene under another light.

        Parameters
        ----------
        illuminant
            As for `photosite.color.illuminants.illuminant`.
        mean_luminance_cd_m2
            `mean_luminance_cd_m2` under the new light; None keeps the scene's.
        rule
            Integration rule of the luminance.

        Raises
        ------
        InputError
            If the scene's reflectance is not known, the illuminant is unknown or does not cover the scene's
            wavelengths, or the scene is dark.

        Examples
        --------
        >>> from photosite.scene.charts import macbeth
        >>> chart = macbeth("A", 40)
        >>> round(chart.with_illuminant("D75").mean_luminance_cd_m2(), 4)
        40.0
        """
        reflectance = self.known_reflectance()
        wanted = self.mean_luminance_cd_m2(rule) if mean_luminance_cd_m2 is None else mean_luminance_cd_m2
        light = photons_from_energy(relative_energy(illuminant, self.wavelength_nm), self.wavelength_nm)
        title = light_title(illuminant)
        name = re.sub(r"(, illuminant )[^,]*$", lambda found: found[1] + title, self.name)  # where it names the light
        relit = replace(self, basis=reflectance * light, name=name)
        return relit.with_mean_luminance(wanted, rule)

    def _repr_html_(self) -> str:
        size = f"{self.shape[0]} x {self.shape[1]} samples of {self.weights.shape[0]} spectra"
        return thumbnail_html(thumbnail(self), f"{self.name}: {size}, {self.mean_luminance_cd_m2():.4g} cd/m2")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the scene as an eye would see it on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the scene to a file, as `photosite.write_scene`; `.h5` keeps all of it."""
        write(self, path)

    def light_outside(self, wavelength_nm: ArrayLike, response: ArrayLike) -> float:
        """Return the fraction of a response's area outside the scene's wavelengths, where the radiance is unknown.

        `response` (n,) at `wavelength_nm` is for example a quantum efficiency.
        """
        response_grid = wavelength_grid(wavelength_nm)
        first, last = self.wavelength_nm[0], self.wavelength_nm[-1]
        if first == last:  # a spectral line: there is no other light
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


def light_title(light: str | float | Spectrum) -> str:
    """Return the light's part of a scene's name."""
    if isinstance(light, Spectrum):
        return "as given"
    return light if isinstance(light, str) else f"{light:g} K"


def _checked_radiance(photon_radiance: ArrayLike, ndim: int) -> NDArray[np.float64]:
    radiance = np.asarray(photon_radiance, dtype=np.float64)
    if radiance.ndim != ndim or radiance.size == 0:
        shape = "(wavelengths,)" if ndim == 1 else "(rows, cols, wavelengths)"
        raise InputError("photon_radiance", value=radiance.shape, expected=f"an array {shape}")
    if not np.isfinite(radiance).all() or (radiance < 0).any():
        raise InputError("photon_radiance", expected="finite and not negative everywhere")
    return radiance


def _checked_reflectance(basis: NDArray[np.float64], reflectance: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(reflectance, dtype=np.float64)
    if values.shape != basis.shape or not np.isfinite(values).all():
        expected = f"finite and of the shape of the basis {basis.shape}"
        raise InputError("reflectance", value=values.shape, expected=expected)
    if np.abs(basis - values * _light(basis, values)).max() > _ONE_LIGHT * np.abs(basis).max():
        hint = "Give a basis that is the reflectance times one light, or omit reflectance"
        raise InputError("basis and reflectance differ by more than one factor per wavelength", hint=hint)
    return values


def _light(basis: NDArray[np.float64], reflectance: NDArray[np.float64]) -> NDArray[np.float64]:
    """The light by least squares: exact where basis = reflectance * light."""
    power = (reflectance**2).sum(axis=0)
    light: NDArray[np.float64] = np.divide(
        (basis * reflectance).sum(axis=0), power, out=np.zeros_like(power), where=power > 0
    )
    return light


_STRIP = 256


def tristimulus(scene: Scene) -> NDArray[np.float32]:
    """Return the CIE 1931 tristimulus values (rows, cols, 3) of every sample, Y in cd/m2.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> round(float(tristimulus(charts.uniform("A", 40))[0, 0, 1]), 4)
    40.0
    """
    basis_xyz = xyz(scene.basis, scene.wavelength_nm)  # (K, 3)
    rows, cols = scene.shape
    values = np.empty((rows, cols, 3), np.float32)
    for first in range(0, rows, _STRIP):
        strip = scene.weights[:, first : first + _STRIP].astype(np.float64)
        values[first : first + _STRIP] = np.tensordot(strip, basis_xyz, axes=(0, 0))
    return values


def preview(
    scene: Scene, white_cd_m2: float | None = None, *, white_xy: tuple[float, float] | None = None
) -> NDArray[np.float32]:
    """Return display sRGB (rows, cols, 3), 0 to 1, of a scene as an eye adapted to its light would see it.

    Parameters
    ----------
    scene
        The scene.
    white_cd_m2
        Luminance of display white; brighter samples are white too. None: that of the brightest 1 % of samples, or of
        the brightest one where these are dark.
    white_xy
        Chromaticity of display white, by von Kries adaptation in CAT02. None: that of the scene's light, or of its mean
        where the light is not known.

    Notes
    -----
    Colors outside sRGB and light above white are clipped.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> gray = preview(charts.uniform("A", 40), white_cd_m2=80)
    >>> gray.shape, bool(np.ptp(gray) < 2e-3)
    ((1, 1, 3), True)
    """
    values = tristimulus(scene)
    luminance = values[..., 1]
    white = float(np.quantile(luminance, 0.99) or luminance.max()) if white_cd_m2 is None else white_cd_m2
    if not white > 0:
        raise InputError("white_cd_m2", value=white, expected="above 0; the scene is dark")
    adapted = _adapted_to(scene, values) if white_xy is None else xyz_of_chromaticity(white_xy)
    adapt = cat02_adaptation(adapted / adapted[1], xyz_of_chromaticity(D65_XY))
    to_rgb = (PUBLISHED_SRGB_FROM_XYZ @ adapt / white).astype(np.float32)
    linear = np.clip(values @ to_rgb.T, 0.0, 1.0)
    return srgb_from_light(linear).astype(np.float32)


def thumbnail(scene: Scene) -> NDArray[np.float32]:
    """Return the preview of every n-th sample, at most 480 x 480; a dark scene is black.

    Examples
    --------
    >>> from photosite.scene import charts
    >>> thumbnail(charts.ramp(cols=1000)).shape[1]
    334
    """
    step = stride_for(*scene.shape)
    small = replace(scene, weights=scene.weights[:, ::step, ::step], regions=(), patches=False, polarization=None)
    try:
        return preview(small)
    except InputError:
        return np.zeros((*small.shape, 3), np.float32)


def _adapted_to(scene: Scene, values: NDArray[np.float32]) -> NDArray[np.float64]:
    """(3,) tristimulus values of the scene's light, where it is known and visible; else of the mean sample."""
    if scene.reflectance is not None:
        light = xyz(scene.light(), scene.wavelength_nm)
        if light.min() > 0:
            return light
    mean: NDArray[np.float64] = values.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    return mean
