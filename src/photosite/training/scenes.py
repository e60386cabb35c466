"""Scenes as a source of light: pictures, spectral cubes, charts and renders, seen through a lens."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.camera.mean_image import electrons_per_weight
from photosite.color.colorimetry import luminance_cd_m2
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import InputError
from photosite.optics.lens import Optics
from photosite.scene.io.color_space import RgbSpace
from photosite.scene.io.picture import PICTURE_SUFFIXES, read_codes
from photosite.scene.picture_colors import checked_picture, srgb_weights
from photosite.scene.pictures import PICTURE_WAVELENGTH_NM, srgb_reflectance
from photosite.scene.polarization import Polarization
from photosite.scene.scene import Scene, light_title
from photosite.scene.scene_request import SceneRequest
from photosite.sensor.model import Sensor
from photosite.training.digest import described, described_files
from photosite.training.kept import Kept
from photosite.training.light import Light, check_exist, listed, place_facts
from photosite.training.patch import Patch, between
from photosite.values.cfa import channel_sites
from photosite.values.shown import Shown

MARGIN_PIXELS = 16
"""Pixels around a patch whose light the lens may bring into it."""

Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class _Picture:
    """The codes of a display picture; spectra are made of the patches that are used."""

    codes: NDArray[Any]
    space: RgbSpace
    name: str

    @property
    def shape(self) -> tuple[int, int]:
        return self.codes.shape[0], self.codes.shape[1]

    @property
    def nbytes(self) -> int:
        return int(np.prod(self.codes.shape)) * self.codes.dtype.itemsize  # gray ones are broadcast

    def scene(self, window: Window, steps: tuple[int, int], basis: NDArray[np.float64]) -> Scene:
        codes = checked_picture(self.space.decoded(np.ascontiguousarray(self.codes[window])), "clip")
        weights = srgb_weights(codes, self.space.name, linear=self.space.linear, out_of_gamut="clip")
        weights = np.ascontiguousarray(weights[:, :: steps[0], :: steps[1]])
        return Scene(weights, basis, PICTURE_WAVELENGTH_NM, name=self.name)


@dataclass(frozen=True, eq=False)
class Scenes(Shown):
    """Scenes through a lens, which give the mean electrons of a sensor's pixels.

    A patch is a window of a scene. It is imaged as if it were at the center of the frame: relative illumination,
    distortion and blur that vary over the field, and the angle at which light reaches the pixels, are those of the
    axis. What is beyond the borders of a scene is like its border. The sensor's dark current and noise come later.

    Parameters
    ----------
    scenes
        `Scene` objects; names of built-in scenes; files that `photosite.read_scene` reads, such as spectral cubes and
        renders; or display pictures: PNG and JPEG files, and (rows, cols, 3) arrays of sRGB. A picture becomes a flat
        print of its colors (`photosite.pictures.from_rgb`); colors outside sRGB are clipped.
    optics
        The lens.
    samples_per_pixel
        Samples of the scene across a pixel, or (lowest, highest), uniform in the logarithm. Two and more average a
        picture's own noise and compression. A scene that is too small for the patch is enlarged until it fills it.
    illuminants
        Lights, of which a patch gets one by chance, at the same mean luminance; as for
        `photosite.illuminants.illuminant`. Default: D65 for pictures, and the light that other scenes have.
    white_luminance_cd_m2
        Luminance of display white in pictures.
    lens_blur
        False computes each pixel from its nearest sample, without blur, crosstalk and glare: the picture is
        unprocessed to electrons. It takes a tenth of the time.
    cells_per_pixel
        As for `Camera`.
    options
        Options of built-in scenes and of scene files that are no display pictures, as for `photosite.read_scene`.

    Raises
    ------
    InputError
        If there are no scenes, or an argument is invalid.
    FileError
        If a file is missing.

    Examples
    --------
    >>> import photosite as ps
    >>> picture = np.full((96, 96, 3), 128, np.uint8)
    >>> source = Scenes([picture, "macbeth"], ps.DiffractionLimited(f_number=2.8, focal_length_mm=4))
    >>> sensor = ps.load_sensor("vendor-2.2um")
    >>> pair = ps.training.PairDataset(source, sensor, crop=(32, 32), exposure_s=1 / 30, seed=1)[0]
    >>> pair.metadata["scene"], pair.clean.shape, bool(pair.clean.min() > pair.metadata["black_level_dn"])
    ('picture 0', (32, 32), True)
    """

    scenes: Sequence[Scene | NDArray[Any] | str | os.PathLike[str]]
    optics: Optics
    _: KW_ONLY
    samples_per_pixel: float | tuple[float, float] = 1.0
    illuminants: Sequence[str | float | Spectrum] = ()
    white_luminance_cd_m2: float = 100.0
    lens_blur: bool = True
    cells_per_pixel: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "scenes", listed("scenes", self.scenes))
        if isinstance(self.illuminants, str | float | int | Spectrum):
            raise InputError("illuminants", value=self.illuminants, expected="a list of lights")
        object.__setattr__(self, "illuminants", tuple(self.illuminants))
        object.__setattr__(self, "_kept", Kept())
        object.__setattr__(self, "_cameras", Kept())
        steps = self.samples_per_pixel
        low, high = steps if isinstance(steps, tuple | list) else (steps, steps)
        if not 0 < low <= high < np.inf:
            raise InputError("samples_per_pixel", value=steps, expected="above 0, or (lowest, highest)")
        object.__setattr__(self, "samples_per_pixel", (float(low), float(high)))
        if not 0 < self.white_luminance_cd_m2 < np.inf:
            raise InputError("white_luminance_cd_m2", value=self.white_luminance_cd_m2, expected="above 0")
        for light in self.illuminants:
            relative_energy(light, PICTURE_WAVELENGTH_NM)
        check_exist([scene for scene in self.scenes if isinstance(scene, str | os.PathLike) and _is_picture(scene)])
        if self.options and not any(
            isinstance(scene, str | os.PathLike) and not _is_picture(scene) for scene in self.scenes
        ):
            expected = "empty for pictures and Scene objects, to which they do not apply"
            raise InputError("options", value=dict(self.options), expected=expected)
        for number, scene in enumerate(self.scenes):
            if not isinstance(scene, Scene | np.ndarray | str | os.PathLike):
                expected = "a Scene, a name, a file or a (rows, cols, 3) array"
                raise InputError(f"scenes[{number}]", value=type(scene).__name__, expected=expected)
            if isinstance(scene, str) and not _is_picture(scene):
                SceneRequest(scene, self.options)
            elif isinstance(scene, np.ndarray):
                self._image(number)

    def __len__(self) -> int:
        return len(self.scenes)

    @property
    def shape(self) -> tuple[int, int] | None:
        """None: scenes have no pixels."""
        return None

    def check(self, sensor: Sensor, light: float) -> None:
        """Raise `InputError` if lens and sensor make no camera."""
        Camera(self.optics, sensor, cells_per_pixel=self.cells_per_pixel)

    def _image(self, number: int) -> Scene | _Picture:
        given = self.scenes[number]
        if isinstance(given, Scene):
            return given
        if isinstance(given, np.ndarray):
            return _Picture(checked_picture(given), RgbSpace("sRGB"), f"picture {number}")

        def read() -> Scene | _Picture:
            if _is_picture(given):
                return _Picture(*read_codes(Path(given)), Path(given).stem)
            return SceneRequest(str(given), self.options).scene()

        kept: Kept[Scene | _Picture] = self._kept  # type: ignore[attr-defined]  # set in __post_init__
        return kept.get(number, read, _bytes_of)

    def _picture_basis(self, light: str | float | Spectrum) -> NDArray[np.float64]:
        grid = PICTURE_WAVELENGTH_NM
        photons = photons_from_energy(relative_energy(light, grid), grid)
        return srgb_reflectance() * photons * (self.white_luminance_cd_m2 / float(luminance_cd_m2(photons, grid)))

    def _lit(self, number: int, choice: float) -> tuple[Scene | _Picture, Any, str]:
        """Return an image, what it needs to become a scene, and the name of its light."""
        image, several = self._image(number), self.illuminants
        index = int(choice * len(several))
        kept: Kept[Any] = self._cameras  # type: ignore[attr-defined]  # set in __post_init__
        if isinstance(image, _Picture):
            light = several[index] if several else "D65"
            basis = kept.get(("basis", index), lambda: self._picture_basis(light), lambda found: found.nbytes)
            return image, basis, light_title(light)
        if not several:
            return image, None, "own"
        basis = kept.get(
            (number, index), lambda: image.with_illuminant(several[index]).basis, lambda found: found.nbytes
        )
        return image, basis, light_title(several[index])

    def _camera(self, sensor: Sensor, shape: tuple[int, int]) -> Camera:
        """Return the camera of a patch. Its name holds the sensor, so that the number of that is not used again."""

        def make() -> tuple[Camera, Sensor]:
            array = sensor.array.model_copy(update={"rows": shape[0], "cols": shape[1]})
            part = sensor.model_copy(update={"array": array, "effects": None, "captures": None, "maps": None})
            return Camera(self.optics, part, cells_per_pixel=self.cells_per_pixel), sensor

        kept: Kept[Any] = self._cameras  # type: ignore[attr-defined]  # set in __post_init__
        camera: Camera = kept.get((id(sensor), shape), make, lambda _: 0)[0]
        return camera

    def light(self, image: int, patch: Patch) -> Light:
        """Return the mean electrons of a patch of a scene."""
        seen, basis, title = self._lit(image, patch.choices[0])
        camera = self._camera(patch.sensor, patch.shape)
        low, high = self.samples_per_pixel  # type: ignore[misc]  # made a pair in __post_init__
        margin = MARGIN_PIXELS if self.lens_blur else 0
        place = _place(seen.shape, patch, between(low, high, patch.choices[1]), _aspect(patch.sensor), margin)
        steps = -1 if patch.flips[0] else 1, -1 if patch.flips[1] else 1
        if isinstance(seen, _Picture):
            scene = seen.scene(place.window, steps, basis)
        else:
            scene = _cut(seen, place.window, basis)
            scene = replace(scene, weights=np.ascontiguousarray(scene.weights[:, :: steps[0], :: steps[1]]))
        if self.lens_blur:
            pitch_m = patch.sensor.pixel.width_um.value * 1e-6
            magnification = self.optics.magnification(scene.distance_m)
            placed = replace(scene, width_m=scene.shape[1] * pitch_m / (place.step * magnification))
            rate = camera.mean_electrons(placed, 1.0)
        else:
            rate = _sampled(scene, camera, patch.shape, place.step)
        rate *= np.float32(patch.exposure_s * patch.light)
        facts = {"scene": seen.name, "illuminant": title, "samples_per_pixel": place.step}
        return Light(rate, None, facts | place_facts(place.corner, patch))

    def describe(self) -> dict[str, Any]:
        """Return the settings, and digests of scenes and files."""
        names = "optics", "samples_per_pixel", "illuminants", "white_luminance_cd_m2", "lens_blur", "cells_per_pixel"
        settings = {name: described(getattr(self, name)) for name in (*names, "options")}
        return {"kind": "scenes", **settings, "images": described_files(self.scenes)}


def _bytes_of(image: Scene | _Picture) -> int:
    return image.nbytes if isinstance(image, _Picture) else image.weights.nbytes


def _is_picture(given: str | os.PathLike[str]) -> bool:
    return Path(given).suffix.lower() in PICTURE_SUFFIXES


def _aspect(sensor: Sensor) -> float:
    return sensor.pixel.height_um.value / sensor.pixel.width_um.value


@dataclass(frozen=True)
class _Place:
    """A patch in a scene: its first sample, samples per pixel along a row, and the window around it."""

    corner: tuple[int, int]
    step: float
    window: Window


def _place(size: tuple[int, int], patch: Patch, step: float, aspect: float, margin_pixels: int) -> _Place:
    rows, cols = patch.shape
    step = min(step, size[0] / (rows * aspect), size[1] / cols)
    corner, sides = [], []
    for length, wide, chance in zip(size, (rows * step * aspect, cols * step), patch.place, strict=True):
        first = int(chance * (int(length - wide) + 1))
        middle = first + wide / 2
        # The patch must stay in the middle of the window.
        half = min(wide / 2 + margin_pixels * step, middle, length - middle)
        corner.append(first)
        sides.append(slice(max(math.floor(middle - half + 1e-6), 0), min(math.ceil(middle + half - 1e-6), length)))
    return _Place((corner[0], corner[1]), float(step), (sides[0], sides[1]))


def _cut(scene: Scene, window: Window, basis: NDArray[np.float64] | None) -> Scene:
    """Return a window of a scene, under another light if a basis is given."""
    polarization = scene.polarization
    if polarization is not None and polarization.shape:
        polarization = Polarization(polarization.degree[window], polarization.angle_deg[window])
    return replace(
        scene,
        weights=scene.weights[:, window[0], window[1]],
        basis=scene.basis if basis is None else basis,
        regions=(),
        patches=False,
        polarization=polarization,
    )


def _sampled(scene: Scene, camera: Camera, shape: tuple[int, int], step: float) -> NDArray[np.float32]:
    """Return (rows, cols) electrons per second of each pixel's nearest sample."""
    sensor = camera.sensor
    coupling = electrons_per_weight(scene, camera).sum(axis=2).astype(np.float32)
    steps = step * _aspect(sensor), step
    places = [
        np.clip(((np.arange(count) + 0.5) * by + (length - count * by) / 2).astype(int), 0, length - 1)
        for count, by, length in zip(shape, steps, scene.shape, strict=True)
    ]
    cfa, out = sensor.array.cfa, np.empty(shape, np.float32)
    for channel, name in enumerate(sensor.channel_names):
        for row, col in channel_sites(cfa, name):
            at = np.ix_(places[0][row :: len(cfa)], places[1][col :: len(cfa[0])])
            out[row :: len(cfa), col :: len(cfa[0])] = np.tensordot(
                coupling[channel], scene.weights[:, at[0], at[1]], 1
            )
    return out
