"""The image of a flat scene as a differentiable function of weights, fill factor, f-number and focal length.

The equations are those of `mean_image`, in double precision and without the approximations that make large frames fast:
the mosaic of channel c is

    image_c = IFFT( sum_k H_ck FFT(w_k) ),    H_ck(f) = sum_lambda C_ck U_lambda(f),
    U_lambda(f) = sum_j OTF_lambda(|f + j fs|) A(f + j fs)

on the camera's padded grid of cells (docs/theory/model.md has the symbols). The coupling C contains the fill factor F
as a factor, and the working f-number N_w as 1 / (1 + 4 N_w^2); the aperture A depends on F, and the OTF on N_w. The
image is linear in the weights. H is real and even, so that the adjoint is the same product in the reverse order.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.sparse import csr_array

from photosite.camera.mean_image import electrons_per_weight, pitch_m, placement
from photosite.camera.optical_stack import low_pass_split_m
from photosite.camera.parts import CameraParts
from photosite.engine.layers import Grid
from photosite.engine.threads import thread_count
from photosite.engine.transfer import Sampling
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import RadialPsf
from photosite.scene.scene import Scene
from photosite.values.cfa import channel_sites

Array = NDArray[np.float64]

_EFFICIENCY = "quantum_efficiency"


@dataclass(frozen=True)
class ImageValues:
    """What the image depends on, besides the weights. Lens values are None for a lens with fixed values."""

    fill_factor: float
    f_number: float | None = None
    focal_length_mm: float | None = None

    @classmethod
    def of_camera(cls, camera: CameraParts) -> ImageValues:
        """Return a camera's values."""
        fill_factor, lens = float(camera.sensor.pixel.fill_factor.value), camera.optics
        if type(lens) is not DiffractionLimited:
            return cls(fill_factor)
        return cls(fill_factor, float(lens.f_number), float(lens.focal_length_mm))


class DifferentiableImage:
    """Electrons per second of a scene before crosstalk, and their derivatives, at some values.

    The lens has a rotationally symmetric point spread, without distortion and veiling glare; the camera is checked by
    `SignalModel`.
    """

    def __init__(self, camera: CameraParts, scene: Scene, values: ImageValues) -> None:
        lens = camera.optics
        factor = values.fill_factor / camera.sensor.pixel.fill_factor.value
        if values.f_number is not None and values.focal_length_mm is not None:
            assert isinstance(lens, DiffractionLimited)
            before = lens.working_f_number(scene.distance_m)
            lens = replace(lens, f_number=values.f_number, focal_length_mm=values.focal_length_mm)
            now = lens.working_f_number(scene.distance_m)
            factor *= (1.0 + 4.0 * before**2) / (1.0 + 4.0 * now**2)
        self._lens, self._scene, self._values, self._sensor = lens, scene, values, camera.sensor
        spread = lens.point_spread(scene.distance_m)
        assert isinstance(spread, RadialPsf)
        self._spread = spread
        array, pitch, side = camera.sensor.array, pitch_m(camera.sensor), math.sqrt(values.fill_factor)
        cells, split = camera.cells_per_pixel, low_pass_split_m(camera.sensor)
        self._sampling = Sampling(pitch, (pitch[0] * side, pitch[1] * side), cells, split)
        middle_nm = float(scene.wavelength_nm[scene.wavelength_nm.size // 2])
        padding = math.ceil((spread.reach_m(middle_nm) + max(split) / 2) / min(pitch))
        shape, tile = (array.rows, array.cols), (len(array.cfa), len(array.cfa[0]))
        self._grid = Grid(shape, padding, tile, cells)
        where = placement(scene, camera)
        starts, steps = (where.row_start, where.col_start), (where.row_step, where.col_step)
        # (cells, samples) of each axis: which samples a cell is the mean of
        self._down, self._across = (
            self._resampling(axis, starts[axis], steps[axis], scene.shape[axis]) for axis in (0, 1)
        )
        self._coupling = electrons_per_weight(scene, camera) * factor
        self._camera, self._factor = camera, factor
        self._blurs: dict[bool, Array] | None = None
        self._latest: tuple[Array, list[NDArray[np.complex128]]] | None = None
        self._sites = [channel_sites(array.cfa, name) for name in camera.sensor.channel_names]

    def with_efficiencies(self, efficiencies: Array) -> DifferentiableImage:
        """Return the image with other (channels, n) quantum efficiencies, at the wavelengths of the sensor.

        From now on both keep what does not depend on these.
        """
        if self._blurs is None:
            self._blurs = {}
        coupling = self._coupling_of(efficiencies)
        again = copy.copy(self)
        for name in ("_transfers", "_by_working_f_number"):
            again.__dict__.pop(name, None)
        again._coupling = coupling
        return again

    def _coupling_of(self, efficiencies: Array) -> Array:
        """Return (channels, K, wavelengths), linear in the quantum efficiencies."""
        per_efficiency, on_scene = self._per_efficiency
        return np.asarray(per_efficiency * (efficiencies @ on_scene.T)[:, None])

    @cached_property
    def _per_efficiency(self) -> tuple[Array, Array]:
        """Coupling for a quantum efficiency of 1, and (wavelengths, n) from the sensor's samples to the scene's."""
        sensor = self._sensor
        channels = {name: sensor.channels[name] for name in sensor.channel_names}
        own_nm = next(iter(channels.values())).wavelength_nm
        ones = {name: one.model_copy(update={_EFFICIENCY: (1.0,) * len(own_nm)}) for name, one in channels.items()}
        even = replace(self._camera, sensor=sensor.with_(channels={**sensor.channels, **ones}))
        hats = [np.interp(self._scene.wavelength_nm, own_nm, hat, left=0.0, right=0.0) for hat in np.eye(len(own_nm))]
        return electrons_per_weight(self._scene, even) * self._factor, np.stack(hats, axis=1)

    def _resampling(self, axis: int, start: float, step: float, samples: int) -> csr_array:
        cover = self._grid.overlap(axis, start, step, samples)
        shape = cover.first.size - 1, samples
        return csr_array((cover.fraction.astype(np.float64), cover.sample, cover.first), shape=shape)

    # The transfers of maps to channels on a quarter of the frequencies, and their derivatives.

    @cached_property
    def _frequencies(self) -> tuple[Array, Array]:
        """(rows // 2 + 1,), (cols // 2 + 1,) frequencies of the cells' grid, from 0 to the Nyquist frequency."""
        down, across = (
            np.arange(self._grid.cells(axis) // 2 + 1) / (self._grid.cells(axis) * self._sampling.cell_m(axis))
            for axis in (0, 1)
        )
        return down, across

    def _folded(self, of_lens: bool) -> Array:
        """Return (2 or 1, wavelengths, fy, fx) sums over folded frequencies.

        These are U and its derivative by the fill factor; or that by the working f-number alone.
        """
        fy, fx = self._frequencies
        grid_nm, rate = self._scene.wavelength_nm, [1.0 / self._sampling.cell_m(axis) for axis in (0, 1)]
        total = np.zeros((1 if of_lens else 2, grid_nm.size, fy.size, fx.size))
        cutoffs = [self._spread.cutoff_per_m(float(wavelength)) for wavelength in grid_nm]
        most = [math.ceil(max(cutoffs) / each + 0.5) for each in rate]
        down, across = (
            [self._shifted(axis, f + m * rate[axis]) for m in range(-most[axis], most[axis] + 1)]
            for axis, f in enumerate((fy, fx))
        )
        for (y, near_y, of_y, slope_y), (x, near_x, of_x, slope_x) in product(down, across):
            near = math.hypot(near_y, near_x)
            if near >= max(cutoffs):
                continue
            frequency, aperture = np.hypot(y[:, None], x), np.outer(of_y, of_x)
            slope = np.outer(slope_y, of_x) + np.outer(of_y, slope_x)
            for n, (wavelength, cutoff) in enumerate(zip(grid_nm.tolist(), cutoffs, strict=True)):
                if near >= cutoff:
                    continue
                if of_lens:
                    assert isinstance(self._lens, DiffractionLimited)
                    total[0, n] += aperture * self._lens.otf_derivative(frequency, wavelength, self._scene.distance_m)
                else:
                    otf = self._spread.otf(frequency, wavelength)
                    total[0, n] += aperture * otf
                    total[1, n] += slope * otf
        return total

    def _blur(self, of_lens: bool) -> Array:
        """Return `_folded`, which is kept for other quantum efficiencies once these have changed."""
        if self._blurs is None:
            return self._folded(of_lens)
        if of_lens not in self._blurs:
            self._blurs[of_lens] = self._folded(of_lens)
        return self._blurs[of_lens]

    def _shifted(self, axis: int, frequency_per_m: Array) -> tuple[Array, float, Array, Array]:
        """Return frequencies on an axis, the least, and the aperture at them with its derivative by the fill factor."""
        detector = self._sampling.detector_m[axis] * frequency_per_m
        # The rest, of cell and low-pass filter, does not depend on the fill factor.
        rest = replace(self._sampling, detector_m=(0.0, 0.0)).aperture(axis, frequency_per_m)
        sinc = np.sinc(detector)
        slope = (np.cos(np.pi * detector) - sinc) / (2.0 * self._values.fill_factor)
        return frequency_per_m, float(np.abs(frequency_per_m).min()), sinc * rest, slope * rest

    @cached_property
    def _transfers(self) -> tuple[Array, Array]:
        """(channels, K, fy, fx) transfers, and their derivatives by the fill factor."""
        value, slope = self._coupled(self._blur(False), self._coupling)
        return value, slope + value / self._values.fill_factor

    def _coupled(self, folded: Array, coupling: Array) -> Array:
        """Return (n, channels, K, fy, fx) from (n, wavelengths, fy, fx)."""
        channels, maps, wavelengths = coupling.shape
        flat: Array = coupling.reshape(-1, wavelengths) @ folded.reshape(*folded.shape[:2], -1)
        return flat.reshape(len(folded), channels, maps, *folded.shape[2:])

    @cached_property
    def _by_working_f_number(self) -> Array:
        assert isinstance(self._lens, DiffractionLimited)
        number = self._lens.working_f_number(self._scene.distance_m)
        (slope,) = self._coupled(self._blur(True), self._coupling)
        return np.asarray(slope - self._transfers[0] * (8.0 * number / (1.0 + 4.0 * number**2)))

    # Images.

    def image(self, weights: Array) -> Array:
        """Return (rows, cols) electrons per second of (K, R, C) weights; linear in these."""
        return np.asarray(self._image(self._spectra(weights), self._transfers[0]) * self._falloff)

    def adjoint(self, mosaic: Array) -> Array:
        """Return (K, R, C): the adjoint of `image`, with <mosaic, image(weights)> = <adjoint(mosaic), weights>."""
        cells, spectra = self._cells, self._channel_spectra(mosaic)
        out = np.empty((len(self._scene.basis), *self._scene.shape))
        for k in range(len(out)):
            total = sum(
                spectrum * self._on_grid(of[k]) for spectrum, of in zip(spectra, self._transfers[0], strict=True)
            )
            blurred = scipy.fft.irfft2(total, s=cells, workers=thread_count())
            out[k] = (self._across.T @ (self._down.T @ blurred).T).T
        return out

    def _channel_spectra(self, mosaic: Array) -> list[NDArray[np.complex128]]:
        """Return the spectra of each channel's pixels of a mosaic, on the cells' grid, 0 elsewhere."""
        tile, per_pixel, spectra = self._grid.tile, self._grid.cells_per_pixel, []
        seen = mosaic * self._falloff
        for sites in self._sites:
            sparse = np.zeros(self._cells)
            for r, c in sites:
                rows, cols = self._centers(0, r, tile[0] * per_pixel), self._centers(1, c, tile[1] * per_pixel)
                sparse[rows, cols] = seen[r :: tile[0], c :: tile[1]]
            spectra.append(scipy.fft.rfft2(sparse, workers=thread_count()))
        return spectra

    def along_efficiencies(self, weights: Array, efficiencies: Array) -> Array:
        """Return the derivative of the image along a direction of the quantum efficiencies, in which it is linear."""
        (transfers,) = self._coupled(self._blur(False)[:1], self._coupling_of(efficiencies))
        return np.asarray(self._image(self._spectra(weights), transfers) * self._falloff)

    def by_efficiencies(self, weights: Array, mosaic: Array) -> Array:
        """Return (channels, n): the adjoint of `along_efficiencies`."""
        per_efficiency, on_scene = self._per_efficiency
        rows, cols = self._cells
        # Parseval: each frequency of the half plane stands for two, but those of the first and the last column.
        fraction = np.full(cols // 2 + 1, 2.0 / (rows * cols))
        fraction[0] /= 2.0
        if cols % 2 == 0:
            fraction[-1] /= 2.0
        blur = self._blur(False)[0]
        found = np.empty((len(self._sites), on_scene.shape[0]))
        for c, of_channel in enumerate(self._channel_spectra(mosaic)):
            products = [(np.conj(of_channel) * spectrum).real * fraction for spectrum in self._spectra(weights)]
            quarters = np.stack([self._on_quarter(product) for product in products])
            by_coupling = np.tensordot(quarters, blur, ((1, 2), (1, 2)))  # (K, wavelengths)
            found[c] = (per_efficiency[c] * by_coupling).sum(axis=0)
        return np.asarray(found @ on_scene)

    def derivatives(self, weights: Array, names: set[str]) -> dict[str, Array]:
        """Return (rows, cols) derivatives of the image by the named ones of `ImageValues`."""
        found, spectra = {}, self._spectra(weights)
        if "fill_factor" in names:
            found["fill_factor"] = self._image(spectra, self._transfers[1]) * self._falloff
        if names & {"f_number", "focal_length_mm"}:
            assert isinstance(self._lens, DiffractionLimited)
            distance_m, magnification = self._scene.distance_m, self._lens.magnification(self._scene.distance_m)
            slope = self._image(spectra, self._by_working_f_number) * self._falloff
            found["f_number"] = slope * (1.0 + magnification)
            # N_w = N (1 + |m|), |m| = f / (d - f)
            by_m = (1.0 + magnification) ** 2 / distance_m
            of_falloff = self._image(spectra, self._transfers[0]) * self._falloff_by_focal_length
            found["focal_length_mm"] = (slope * self._lens.f_number * by_m + of_falloff) * 1e-3
        return {name: found[name] for name in names}

    @property
    def _cells(self) -> tuple[int, int]:
        return self._grid.cells(0), self._grid.cells(1)

    def _spectra(self, weights: Array) -> list[NDArray[np.complex128]]:
        """Return the (rows, cols // 2 + 1) spectra of the maps on the cells; the latest are kept."""
        if self._latest is None or self._latest[0] is not weights:
            spectra = [scipy.fft.rfft2((self._across @ (self._down @ w).T).T, workers=thread_count()) for w in weights]
            self._latest = weights, spectra
        return self._latest[1]

    def _on_grid(self, transfer: Array) -> Array:
        """Return (rows, cols // 2 + 1) of the grid from a quarter of the frequencies."""
        rows = self._grid.cells(0)
        return np.concatenate([transfer, transfer[(rows - 1) // 2 : 0 : -1]])

    def _on_quarter(self, values: Array) -> Array:
        """Return the adjoint of `_on_grid`."""
        rows = self._grid.cells(0)
        quarter = values[: rows // 2 + 1].copy()
        quarter[1 : (rows - 1) // 2 + 1] += values[rows // 2 + 1 :][::-1]
        return quarter

    def _centers(self, axis: int, site: int, step: int) -> slice:
        """Return the cells in the centers of the frame's pixels of a site."""
        per_pixel = self._grid.cells_per_pixel
        first = (self._grid.before(axis) + site) * per_pixel + per_pixel // 2
        pixels = len(range(site, self._grid.shape[axis], self._grid.tile[axis]))
        return slice(first, first + pixels * step, step)

    def _image(self, spectra: list[NDArray[np.complex128]], transfers: Array) -> Array:
        """Return the mosaic of maps behind transfers to the channels."""
        mosaic, tile = np.empty(self._grid.shape), self._grid.tile
        per_pixel = self._grid.cells_per_pixel
        for sites, of_channel in zip(self._sites, transfers, strict=True):
            total = sum(spectrum * self._on_grid(of) for spectrum, of in zip(spectra, of_channel, strict=True))
            image = scipy.fft.irfft2(total, s=self._cells, workers=thread_count())
            for r, c in sites:
                rows, cols = self._centers(0, r, tile[0] * per_pixel), self._centers(1, c, tile[1] * per_pixel)
                mosaic[r :: tile[0], c :: tile[1]] = image[rows, cols]
        return mosaic

    @cached_property
    def _image_height_m(self) -> Array:
        (rows, cols), pitch = self._grid.shape, pitch_m(self._sensor)
        y, x = ((np.arange(size) + 0.5 - size / 2) * pitch[axis] for axis, size in ((0, rows), (1, cols)))
        return np.asarray(np.hypot(y[:, None], x), np.float64)

    @cached_property
    def _falloff(self) -> Array | float:
        falloff = self._lens.relative_illumination(self._image_height_m, self._scene.distance_m)
        return 1.0 if falloff is None else np.asarray(falloff, np.float64)

    @cached_property
    def _falloff_by_focal_length(self) -> Array | float:
        """Derivative of cos^4 = 1 / (1 + (h / L)^2)^2, L = f (1 + |m|), by f in m."""
        assert isinstance(self._lens, DiffractionLimited)
        if self._lens.falloff == "none":
            return 0.0
        enlarged = 1.0 + self._lens.magnification(self._scene.distance_m)
        length_m = self._lens.focal_length_mm * 1e-3 * enlarged
        square = (self._image_height_m / length_m) ** 2
        # dL / df = (1 + |m|)^2, because L = f d / (d - f)
        return np.asarray(4.0 * square / (length_m * (1.0 + square) ** 3) * enlarged**2)
