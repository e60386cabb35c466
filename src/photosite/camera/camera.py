"""The camera: mean electrons and raw frames of a scene, with their metadata for DNG files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import InitVar, dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.auto_exposure import ExposureControl, exposure_control
from photosite.camera.gpu_camera import GpuCamera
from photosite.camera.image_over_time import AnyImage, AnyScene, StaticImage, image_over_time
from photosite.camera.mean_image import electrons_per_weight, image_regions
from photosite.camera.optical_stack import channel_mixing
from photosite.camera.sampled_otf import Progress
from photosite.color.colorimetry import xyz
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, integration_weights, photons_from_energy
from photosite.engine.arrays import Arrays
from photosite.errors import InputError
from photosite.frames.companding import COMPANDING, companding_text
from photosite.frames.raw_frame import OPTICAL_BLACK, RawFrame, neutral_text
from photosite.optics.lens import Optics
from photosite.scene.charts import macbeth_reflectance
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.planes import Planes
from photosite.scene.scene import Scene
from photosite.sensor.capture_readout import combined, largest_light_e
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.device import Device, Gpu
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import sensor_noise_profile
from photosite.sensor.readout import Rectangle, digital_numbers, digital_numbers_of_captures
from photosite.values.cfa import plane_names, shifted
from photosite.values.exposure import check_exposure, check_start, exposure_sequence
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.validated import check_choice

_AUTO_EXPOSURE_PERCENTILE, _AUTO_EXPOSURE_LEVEL = 99.5, 0.8
_INFRARED_NM = np.arange(790.0, 1101.0, 10.0)
_ONE_SECOND = {"exposure_s": 1.0}


@dataclass(frozen=True)
class Camera(Shown):
    """A lens in front of a sensor.

    Parameters
    ----------
    optics, sensor
        The lens, for example `DiffractionLimited`, and the sensor.
    integration
        Rule of the integral over wavelength: "trapezoid", or "rectangle" to compare with tools that use it.
    cells_per_pixel
        Cells per pixel on each axis of the grid on which the scene is sampled before blurring; odd. 1 suits scenes that
        are smooth on the scale of a pixel. Measuring an edge or a position needs 3 or more.
    gain_setting
        One of the sensor's gain settings, such as ISO 400 (`Sensor.at_gain_setting`); default the sensor's own.

    Raises
    ------
    InputError
        If lens or sensor are something else or in the wrong order, the rule is unknown, cells_per_pixel is not odd and
        positive, or the sensor has no such gain setting.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196)
    >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> chart = ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40)
    >>> raw = camera.capture(chart, exposure_s=1 / 3, seed=7)
    >>> raw.dn.shape, raw.dn.dtype
    ((132, 196), dtype('uint16'))
    """

    optics: Optics
    sensor: Sensor
    integration: Rule = "trapezoid"
    cells_per_pixel: int = 1
    gain_setting: InitVar[float | None] = None

    def __post_init__(self, gain_setting: float | None) -> None:
        hint = "Write Camera(optics, sensor), the lens first"
        if not callable(getattr(self.optics, "irradiance_per_radiance", None)):
            expected = "a lens, such as DiffractionLimited(2.8, 50)"
            raise InputError("optics", value=self.optics, expected=expected, hint=hint)
        if not isinstance(self.sensor, Sensor):
            expected = "a sensor, such as load_sensor('nikon-d200')"
            raise InputError("sensor", value=self.sensor, expected=expected, hint=hint)
        if gain_setting is not None:
            object.__setattr__(self, "sensor", self.sensor.at_gain_setting(gain_setting))
        check_choice("integration", self.integration, Rule)
        cells = self.cells_per_pixel
        if not isinstance(cells, int | np.integer) or isinstance(cells, bool) or cells < 1 or cells % 2 == 0:
            raise InputError("cells_per_pixel", value=cells, expected="odd and positive: 1, 3, 5, ...")

    def mean_electrons(
        self, scene: AnyScene, exposure_s: float, progress: Progress | None = None, *, start_s: float = 0.0
    ) -> NDArray[np.float32]:
        """Return the mean electrons from light in every pixel, without noise, fixed pattern or dark current.

        Irradiance from the lens, times quantum efficiency, pixel area, fill factor and exposure, over wavelength.
        The photodetector is a centered square of side pitch * sqrt(fill factor).

        Parameters
        ----------
        scene, exposure_s
            A scene, `Planes` in depth, or a `DynamicScene`; and the exposure time.
        progress
            Called with the number of parts done, of how many, and what they are: "wavelengths", then "transforms".
        start_s
            Time at which the frame starts: the exposure of the first row of a rolling shutter, of all rows of a global
            one.

        Returns
        -------
        ndarray
            (rows, cols) float32 mosaic: each pixel behind its own color filter.

        Raises
        ------
        InputError
            If the exposure time is not above 0 or too long for 32-bit floats, the scene lies within the focal length,
            or its radiance is negative in places.

        Warns
        -----
        PhotositeWarning
            If the sensor responds to light beyond the scene's wavelengths.
        """
        time_s, start_s = check_exposure(exposure_s), check_start(start_s)
        image = self._image(scene, start_s, time_s, progress)
        return image.electrons(start_s, time_s, out=_memory(image))

    def _image(self, scene: AnyScene, start_s: float, longest_s: float, progress: Progress | None = None) -> AnyImage:
        end_s = start_s + float(self.sensor.row_start_s.max()) + longest_s
        return image_over_time(scene, self, (start_s, end_s), progress)

    @cached_property
    def _color_matrices(self) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
        """The color matrices under D65 and A, which all frames share."""
        return color_matrix(self.sensor), color_matrix(self.sensor, "A")

    def capture(
        self,
        scene: AnyScene,
        exposure_s: float,
        *,
        start_s: float = 0.0,
        seed: int = 0,
        frame: int = 0,
        region: Rectangle | None = None,
        device: Device = "cpu",
        temperature_c: float | None = None,
    ) -> RawFrame:
        """Return a raw frame of a scene.

        Parameters
        ----------
        scene, exposure_s, start_s
            As for `mean_electrons`.
        seed, frame
            Key of the temporal noise, 0 to 2^64 - 1, and frame number in a sequence, 0 to 2^32 - 1. The same two give
            the same frame; frames of one seed have independent noise. The fixed pattern depends on the sensor's serial
            and is the same in all frames.
        region
            (r0, r1, c0, c1), rows r0 to r1 and columns c0 to c1, the second of each excluded. The result equals that
            part of the whole frame. None is the whole frame.
        device
            Where noise and digital numbers are computed: "cpu", or "cuda" for an NVIDIA GPU (extra `gpu`), with equal
            results. The mean image is computed on the CPU; `on_gpu` computes all of it on the GPU.
        temperature_c
            Temperature of the sensor, which scales its dark current (`Sensor.at_temperature`) and is stated in the
            frame's metadata. None: the dark current of the description.

        Raises
        ------
        InputError
            As `mean_electrons`; or if the seed or frame number is out of range, the region is not on the chip, or the
            device is unavailable.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> whole = camera.capture(ps.charts.macbeth(), 1 / 3, seed=7)
        >>> part = camera.capture(ps.charts.macbeth(), 1 / 3, seed=7, region=(10, 30, 51, 99))
        >>> bool((part.dn == whole.dn[10:30, 51:99]).all()), part.cfa
        (True, (('G', 'R'), ('B', 'G')))
        """
        mean = self.mean_electrons(scene, exposure_s, start_s=start_s)
        place: dict[str, Any] = {
            "seed": seed,
            "frame": frame,
            "region": region,
            "device": device,
            "temperature_c": temperature_c,
        }
        return self.expose(mean, exposure_s, scene=scene, **place)

    def stream(
        self,
        scene: AnyScene,
        exposures_s: float | Iterable[float],
        frames: int = 1,
        *,
        start_s: float = 0.0,
        seed: int = 0,
        first_frame: int = 0,
        region: Rectangle | None = None,
        device: Device = "cpu",
        temperature_c: float | None = None,
    ) -> Iterator[RawFrame]:
        """Yield raw frames of a scene that all start at one time; the mean image is computed once.

        Parameters
        ----------
        scene, start_s, seed, region, device, temperature_c
            As for `capture`.
        exposures_s
            One exposure time, or several.
        frames, first_frame
            Frames at each exposure; number of the first frame. The n-th equals `capture` with frame first_frame + n.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> [raw.exposure_s for raw in camera.stream(ps.charts.macbeth(), [1 / 4, 1 / 2], frames=2)]
        [0.25, 0.25, 0.5, 0.5]
        """
        sequence, start_s = exposure_sequence(exposures_s, frames, first_frame), check_start(start_s)
        image = self._image(scene, start_s, max((time_s for time_s, _ in sequence), default=0.0))
        place: dict[str, Any] = {"seed": seed, "region": region, "device": device, "temperature_c": temperature_c}
        memory = _memory(image) if len(sequence) == 1 else None
        for exposure_s, numbers in sequence:
            mean = image.electrons(start_s, exposure_s, out=memory)
            for number in numbers:
                yield self.expose(mean, exposure_s, frame=number, scene=scene, **place)

    def record(
        self,
        scene: AnyScene | Callable[[float], AnyScene],
        frames: int,
        fps: float,
        exposure_s: float | Sequence[float] | ExposureControl,
        *,
        start_s: float = 0.0,
        scenes_per_frame: int = 1,
        seed: int = 0,
        first_frame: int = 0,
        region: Rectangle | None = None,
        device: Device = "cpu",
        temperature_c: float | None = None,
    ) -> Iterator[RawFrame]:
        """Yield the frames of a video; frame n starts at `start_s` + n / `fps`, as its metadata `start_s` states.

        Parameters
        ----------
        scene
            A scene as for `capture`, imaged once. Or a function of the time in s that returns one; each frame then
            sees the scenes of times evenly spread over it, each while its time is the nearest.
        frames, fps
            Number of frames, and frames per second.
        exposure_s
            One exposure time; several in turn, as a bracket; or a function of the last frame, and of None for the
            first, such as `AutoExposure`. A function's times are limited to 1 / fps.
        start_s
            Time at which the first frame starts.
        scenes_per_frame
            Scenes of a frame, if `scene` is a function.
        seed, first_frame, region, device, temperature_c
            As for `stream`.

        Raises
        ------
        InputError
            As `capture`; or if an exposure, or the readout of a rolling shutter, is longer than 1 / fps.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=44, cols=66, line_time_us=100)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> panned = ps.scenes.DynamicScene(ps.charts.macbeth(), motion=ps.scenes.Motion(cols_per_s=-120))
        >>> [raw.metadata["start_s"] for raw in camera.record(panned, frames=3, fps=25, exposure_s=1 / 50)]
        [0.0, 0.04, 0.08]
        >>> bracket = camera.record(panned, frames=3, fps=25, exposure_s=[1 / 400, 1 / 100, 1 / 25])
        >>> [raw.exposure_s for raw in bracket]
        [0.0025, 0.01, 0.04]
        """
        for name, count in (("frames", frames), ("scenes_per_frame", scenes_per_frame)):
            if count < 1:
                raise InputError(name, value=count, expected="1 or more")
        if isinstance(fps, bool | str) or not (fps > 0 and math.isfinite(fps)):
            raise InputError("fps", value=fps, expected="above 0")
        if (readout_s := float(np.ptp(self.sensor.row_start_s))) > 1.0 / fps:
            hint = "The rows of a frame start one line time apart"
            raise InputError("fps", value=fps, expected=f"at most {1.0 / readout_s:.6g} for this shutter", hint=hint)
        start_s, control, last = check_start(start_s), exposure_control(exposure_s), None
        seen: AnyScene
        place: dict[str, Any] = {"seed": seed, "region": region, "device": device, "temperature_c": temperature_c}
        image = None if callable(scene) else self._image(scene, start_s, (frames + 1) / fps)
        for number in range(frames):
            begin_s, time_s = start_s + number / fps, check_exposure(control(last))
            if time_s > 1.0 / fps * (1.0 + 1e-9):
                if not callable(exposure_s):
                    raise InputError("exposure_s", value=time_s, expected=f"at most 1 / fps, {1.0 / fps:.6g} s")
                time_s = 1.0 / fps
            if callable(scene):
                seen, mean = self._mean_of_scenes(scene, begin_s, time_s, scenes_per_frame)
            else:
                assert image is not None
                seen, mean = scene, image.electrons(begin_s, time_s)
            raw = self.expose(mean, time_s, frame=first_frame + number, scene=seen, **place)
            last = replace(raw, metadata={**raw.metadata, "start_s": begin_s})
            yield last

    def _mean_of_scenes(
        self, scene_at: Callable[[float], AnyScene], start_s: float, exposure_s: float, count: int
    ) -> tuple[AnyScene, NDArray[np.float32]]:
        """Return the first scene of a frame, and the mean electrons from `count` scenes, one after the other."""
        borders = start_s + (float(np.ptp(self.sensor.row_start_s)) + exposure_s) * np.linspace(0.0, 1.0, count + 1)
        first, total = None, None
        for part_s in pairwise(borders.tolist()):
            scene = scene_at(0.5 * sum(part_s))
            image = image_over_time(scene, self, part_s)
            mean = image.electrons(start_s, exposure_s, part_s=None if count == 1 else part_s)
            first, total = (scene, mean) if total is None else (first, np.add(total, mean, out=total))
        assert first is not None
        assert total is not None
        return first, total

    def expose(
        self,
        mean_electrons: NDArray[np.float32],
        exposure_s: float,
        *,
        seed: int = 0,
        frame: int = 0,
        region: Rectangle | None = None,
        device: Device = "cpu",
        temperature_c: float | None = None,
        scene: AnyScene | None = None,
    ) -> RawFrame:
        """Return a raw frame from mean electrons, which several frames may share.

        Parameters
        ----------
        mean_electrons
            (rows, cols) of the whole chip, as from `mean_electrons`; not negative.
        exposure_s, seed, frame, region, device, temperature_c
            As for `capture`; the exposure time is that of the dark current.
        scene
            The scene of the mean electrons, whose light gives `RawFrame.as_shot_neutral`; None leaves it out.

        Raises
        ------
        InputError
            As `capture`; or if the shape is not the sensor's, or a mean is negative or not finite.
        """
        time_s = check_exposure(exposure_s)
        place: dict[str, Any] = {
            "seed": seed,
            "frame": frame,
            "region": region,
            "device": device,
            "temperature_c": temperature_c,
        }
        captures: dict[str, NDArray[np.uint16]] = {}
        if self.sensor.captures is None:
            dn = digital_numbers(self.sensor, mean_electrons, time_s, **place)
        else:
            captures = digital_numbers_of_captures(self.sensor, mean_electrons, time_s, **place)
            dn = combined(self.sensor, captures)
        fields = self.frame_fields(exposure_s, seed, frame, region, temperature_c, scene)
        return RawFrame(dn, captures=captures, **fields)

    def frame_fields(
        self,
        exposure_s: float,
        seed: int,
        frame: int,
        region: Rectangle | None,
        temperature_c: float | None,
        scene: AnyScene | None,
    ) -> dict[str, Any]:
        """Return the arguments of `RawFrame` other than digital numbers and captures; see `expose`."""
        at = self.sensor if temperature_c is None else self.sensor.at_temperature(temperature_c)
        several, cfa = self.sensor.captures, self.sensor.array.cfa
        if several is None:
            bits, (black_level_dn, white_level_dn) = self.sensor.readout.bits, self.sensor.output_levels_dn
            profile = None if at.effects is not None and at.effects.companded else noise_profile(at, exposure_s)
        else:
            profile, bits = None, several.combination.output_bits
            black_level_dn, white_level_dn = several.combination.output_black_level_dn, float((1 << bits) - 1)
        name, serial = self.sensor.name, self.sensor.serial
        metadata: dict[str, Any] = {"camera": name, "serial": serial, "seed": seed, "frame": frame}
        if several is not None and (table := several.combination.companding) is not None:
            metadata[COMPANDING] = companding_text(table.linear_dn, table.companded_dn)
        if self.sensor.gain_setting is not None:
            metadata["gain_setting"] = self.sensor.gain_setting
            if self.sensor.gain_setting_is_iso:
                metadata["iso"] = self.sensor.gain_setting
        if temperature_c is not None:
            metadata["temperature_c"] = float(temperature_c)
        lens = getattr(self.optics, "base", self.optics)
        metadata |= {key: value for key in ("f_number", "focal_length_mm") if (value := getattr(lens, key, None))}
        if (neutral := None if scene is None else self._neutral_of(scene)) is not None:
            metadata["as_shot_neutral"] = neutral
        if self.sensor.array.stacked:
            metadata["stacked"] = 1
            if region is not None and (region[2] % len(cfa[0]) or region[3] % len(cfa[0])):
                raise InputError("region", value=region, expected=f"columns in multiples of {len(cfa[0])}")
        if region is None and self.sensor.effects is not None and (border := self.sensor.effects.border) is not None:
            metadata[OPTICAL_BLACK] = ",".join(map(str, border))
        if region is not None:
            cfa = shifted(cfa, region[0], region[2])
            metadata["region"] = ",".join(map(str, region))
        return {
            "bits": bits,
            "cfa": cfa,
            "black_level_dn": black_level_dn,
            "white_level_dn": white_level_dn,
            "exposure_s": exposure_s,
            "color_matrix": self._color_matrices[0],
            "color_matrix_a": self._color_matrices[1],
            "noise_profile": profile,
            "metadata": metadata,
        }

    def on_gpu(self, arrays: Arrays | None = None) -> GpuCamera:
        """Return the camera on an NVIDIA GPU (extra `gpu`): mean image, noise and digital numbers stay there.

        Parameters
        ----------
        arrays
            The device's arrays; default CuPy's.

        Raises
        ------
        InputError
            If a GPU, its driver or the extra `gpu` is missing, or the sensor has several captures.
        """
        return GpuCamera(self, Gpu(arrays))

    def auto_exposure_s(self, electrons_per_s: NDArray[np.float32]) -> float:
        """Return the exposure time at which the bright parts of a scene stay just below saturation.

        The 99.5th percentile of the pixels then has 80 % of the sensor's saturation capacity, dark current included;
        of the light at which the combined frame saturates, for a sensor with several captures.
        Rounded down to two digits, below 0.1 s of its reciprocal: 1/33.

        Parameters
        ----------
        electrons_per_s
            (rows, cols) mean electrons in 1 s: `mean_electrons(scene, 1.0)`.

        Raises
        ------
        InputError
            If no pixel receives light.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> 1 / camera.auto_exposure_s(camera.mean_electrons(ps.charts.uniform("D65", 1000), 1.0))
        33.0
        """
        bright = float(np.percentile(electrons_per_s, _AUTO_EXPOSURE_PERCENTILE)) or float(electrons_per_s.max())
        if not bright > 0:
            raise InputError("the scene sends no light to the sensor", hint="Pass {exposure_s}", arguments=_ONE_SECOND)
        dark = self.sensor.electrons(self.sensor.noise.dark_voltage_mv_per_s.value)
        several = self.sensor.captures is not None
        capacity_e = largest_light_e(self.sensor) if several else self.sensor.saturation_capacity_e
        exposure_s = _AUTO_EXPOSURE_LEVEL * capacity_e / (bright + dark)
        if exposure_s < 0.1:
            return 1.0 / _two_digits(1.0 / exposure_s, math.ceil)
        return _two_digits(exposure_s, math.floor)

    def clean_dn(self, mean_electrons: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the noise-free frame of mean electrons: black level plus gain times electrons, not rounded.

        Wells, response curve, transfer and multiplication of charge and digital stages act as in a frame; noise, fixed
        pattern and dark current are left out. With several captures it is their combination, which is rounded.

        Returns
        -------
        ndarray
            (rows, cols) float32, in digital numbers.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=1, cols=2, black_level_dn=64)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> camera.clean_dn(np.array([[798.0, 1e6]], np.float32)).round(2)
        array([[ 164., 4095.]], dtype=float32)
        """
        return clean_numbers(self.sensor, mean_electrons)

    def as_shot_neutral(self, light: Scene) -> str | None:
        """Return the signal of a uniform field in each channel, relative to the largest, for DNG's AsShotNeutral.

        Returns
        -------
        str or None
            Comma-separated numbers in the order of `photosite.values.cfa.plane_names`: R, G, B (DNG specification 1.7);
            None for a monochrome sensor, or if no light reaches R, G or B, or any channel.

        Examples
        --------
        >>> import photosite as ps
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), ps.load_sensor("nikon-d200"))
        >>> camera.as_shot_neutral(ps.charts.uniform("A", 1))
        '1,0.927022,0.323447'
        """
        names = self.sensor.channel_names
        if len(names) == 1:
            return None
        alone = electrons_per_weight(light, self).sum(axis=(1, 2))
        electrons = channel_mixing(self.sensor) @ alone
        signal = np.array([electrons[names.index(name)] for name in plane_names(self.sensor.array.cfa)])
        colors = [
            value for name, value in zip(plane_names(self.sensor.array.cfa), signal, strict=True) if name in "RGB"
        ]
        if not min(colors, default=signal.max()) > 0:
            return None
        return neutral_text(signal.tolist())

    def _neutral_of(self, scene: AnyScene) -> str | None:
        """Return `as_shot_neutral` of a scene's light where its reflectance is known; of planes, the first such."""
        scenes = _parts(scene)
        lit = next((one for one in scenes if one.reflectance is not None), None)
        return None if lit is None else self.as_shot_neutral(Scene.uniform(lit.light(), lit.wavelength_nm))

    def image_regions(self, scene: AnyScene) -> tuple[Region, ...]:
        """Return the scene's named regions in pixels at time 0; with distortion, rectangles inside their images.

        With stacked channels, these are the pixels of `RawFrame.layers`.

        Raises
        ------
        InputError
            If a region contains no whole pixel of the frame.
        """
        stacked = self.sensor.array.stacked
        seen = replace(self, sensor=self.sensor.layer(self.sensor.channel_names[0])) if stacked else self
        return tuple(region for one in _parts(scene) for region in image_regions(one, seen))


def _two_digits(value: float, rounded: Callable[[float], int]) -> float:
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{rounded(round(value / step, 9)) * step:.2g}")


def _at_rest(scene: AnyScene) -> Scene | Planes:
    return scene.scene if isinstance(scene, DynamicScene) else scene


def _parts(scene: AnyScene) -> list[Scene]:
    """Return the flat scenes that a scene consists of."""
    still = _at_rest(scene)
    return [plane.scene for plane in still.planes] if isinstance(still, Planes) else [still]


def _memory(image: AnyImage) -> NDArray[np.float32] | None:
    """Return memory for the mean electrons of an image that is not needed any more."""
    return image.rate if isinstance(image, StaticImage) else None


# The color matrix and the noise profile of a camera, as DNG defines them for raw files.


def color_matrix(sensor: Sensor, illuminant_name: str = "D65") -> NDArray[np.float64] | None:
    """Return the matrix from CIE XYZ under an illuminant to the camera's channels: ColorMatrix of DNG 1.7.

    It is the (pseudo)inverse of the least-squares matrix from camera channels to XYZ over the ColorChecker's 24 patches
    under the illuminant (Farrell, Okincha and Parmar 2008, section 3). It is scaled so that the largest channel is 1
    for the illuminant's white. With more than three channels, light beyond 780 nm is one more patch, which is black to
    the eye: the matrix takes it away by means of an infrared channel.

    Returns
    -------
    ndarray or None
        (channels, 3) in the order of the sensor's channels; None if fewer than three of these are linearly
        independent.

    Examples
    --------
    >>> import photosite as ps
    >>> color_matrix(ps.load_sensor("nikon-d200")).shape
    (3, 3)
    """
    names = sensor.channel_names
    if len(names) < 3:
        return None
    responses = channel_mixing(sensor) @ np.stack([sensor.response_at(name, DEFAULT_WAVELENGTH_NM) for name in names])
    infrared = np.zeros(len(names))
    if len(names) > 3:
        beyond = np.stack([sensor.response_at(name, _INFRARED_NM) for name in names])
        infrared = channel_mixing(sensor) @ beyond @ integration_weights(_INFRARED_NM)
    return _color_matrix(tuple(map(tuple, responses.tolist())), tuple(infrared.tolist()), illuminant_name)


@lru_cache(maxsize=8)
def _color_matrix(
    responses: tuple[tuple[float, ...], ...], infrared: tuple[float, ...], illuminant_name: str
) -> NDArray[np.float64] | None:
    grid = DEFAULT_WAVELENGTH_NM
    light = photons_from_energy(illuminant(illuminant_name, grid), grid)
    patches = macbeth_reflectance(grid) * light
    camera = patches @ (np.array(responses) * integration_weights(grid)).T
    if np.linalg.matrix_rank(camera) < 3:
        return None
    white = xyz(light, grid)
    target = xyz(patches, grid) / white[1]
    camera, target = np.vstack([camera, np.array(infrared) * light.mean()]), np.vstack([target, np.zeros(3)])
    to_xyz, *_ = np.linalg.lstsq(camera, target, rcond=None)
    matrix = np.asarray(np.linalg.pinv(to_xyz.T), dtype=np.float64)
    matrix /= (matrix @ (white / white[1])).max()
    matrix.flags.writeable = False
    return matrix


def noise_profile(sensor: Sensor, exposure_s: float) -> NDArray[np.float64]:
    """Return (channels, 2) scale and offset: a signal s from 0 (black) to 1 (white) has the variance scale s + offset.

    The scale is photon shot noise. The offset is read noise, DSNU, dark current shot noise and quantization. The model
    has no PRNU, whose variance grows with the square of the signal. It is NoiseProfile of DNG 1.7.

    Examples
    --------
    >>> import photosite as ps
    >>> scale, offset = noise_profile(ps.load_sensor("nikon-d200"), 1 / 8000)[0]
    >>> float((1 / scale / 4095).round(2)), float((offset**0.5 * 4095).round(2))
    (7.98, 3.17)
    """
    profile = sensor_noise_profile(sensor, exposure_s)
    return np.array([(slope.value, offset.value) for slope, offset in zip(profile.slope, profile.offset, strict=True)])
