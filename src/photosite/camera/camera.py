"""The camera: mean electrons and raw frames of a scene, with their metadata for DNG files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from photosite.camera.auto_exposure import ExposureControl, exposure_control
from photosite.camera.frame_fields import as_shot_neutral, flat_scenes, frame_fields
from photosite.camera.gpu_camera import GpuCamera
from photosite.camera.image_over_time import AnyImage, AnyScene, StaticImage, exposure_image, image_over_time
from photosite.camera.mean_image import image_regions
from photosite.camera.parts import CameraParts
from photosite.camera.sampled_otf import Progress
from photosite.engine.arrays import Arrays
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.scene.scene import Scene
from photosite.sensor.capture_readout import combined, largest_light_e
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.device import Device, Gpu
from photosite.sensor.readout import read_captures, read_frame
from photosite.sensor.shot import Rectangle, SequenceOptions, Shot
from photosite.values.exposure import check_exposure, check_start, exposure_sequence
from photosite.values.region import Region

_AUTO_EXPOSURE_PERCENTILE, _AUTO_EXPOSURE_LEVEL = 99.5, 0.8
_ONE_SECOND = {"exposure_s": 1.0}


class Camera(CameraParts):
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
    FileError
        If a file of measured maps is missing, or is not the file that the sensor file names by its hash.

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
        image = exposure_image(scene, self, start_s, time_s, progress)
        return image.electrons(start_s, time_s, out=_memory(image))

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
        shot = Shot(seed, frame, region, device, temperature_c)
        mean = self.mean_electrons(scene, exposure_s, start_s=start_s)
        return self._expose(mean, exposure_s, shot, scene)

    def stream(
        self,
        scene: AnyScene,
        exposures_s: float | Iterable[float],
        frames: int = 1,
        *,
        start_s: float = 0.0,
        first_frame: int = 0,
        **shot: Unpack[SequenceOptions],
    ) -> Iterator[RawFrame]:
        """Yield raw frames of a scene that all start at one time; the mean image is computed once.

        Parameters
        ----------
        scene, start_s
            As for `capture`.
        exposures_s
            One exposure time, or several.
        frames, first_frame
            Frames at each exposure; number of the first frame. The n-th equals `capture` with frame first_frame + n.
        **shot
            `seed`, `region`, `device` and `temperature_c` of `capture`.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=132, cols=196)
        >>> camera = Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
        >>> [raw.exposure_s for raw in camera.stream(ps.charts.macbeth(), [1 / 4, 1 / 2], frames=2)]
        [0.25, 0.25, 0.5, 0.5]
        """
        sequence, start_s = exposure_sequence(exposures_s, frames, first_frame), check_start(start_s)
        image = exposure_image(scene, self, start_s, max((time_s for time_s, _ in sequence), default=0.0))
        memory = _memory(image) if len(sequence) == 1 else None
        for exposure_s, numbers in sequence:
            mean = image.electrons(start_s, exposure_s, out=memory)
            for number in numbers:
                yield self._expose(mean, exposure_s, Shot(**shot, frame=number), scene)

    def record(
        self,
        scene: AnyScene | Callable[[float], AnyScene],
        frames: int,
        fps: float,
        exposure_s: float | Sequence[float] | ExposureControl,
        *,
        start_s: float = 0.0,
        scenes_per_frame: int = 1,
        first_frame: int = 0,
        **shot: Unpack[SequenceOptions],
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
        first_frame, **shot
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
        image = None if callable(scene) else exposure_image(scene, self, start_s, (frames + 1) / fps)
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
            raw = self._expose(mean, time_s, Shot(**shot, frame=first_frame + number), seen)
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
        return self._expose(mean_electrons, exposure_s, Shot(seed, frame, region, device, temperature_c), scene)

    def _expose(
        self, mean_electrons: NDArray[np.float32], exposure_s: float, shot: Shot, scene: AnyScene | None
    ) -> RawFrame:
        light = mean_electrons, check_exposure(exposure_s), shot
        captures: dict[str, NDArray[np.uint16]] = {}
        if self.sensor.captures is None:
            dn = read_frame(self.sensor, self.measured_chip, *light)
        else:
            captures = read_captures(self.sensor, self.measured_chip, *light)
            dn = combined(self.sensor, captures)
        return RawFrame(dn, captures=captures, **frame_fields(self, exposure_s, shot, scene))

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
        return as_shot_neutral(self, light)

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
        return tuple(region for one in flat_scenes(scene) for region in image_regions(one, seen))


def _two_digits(value: float, rounded: Callable[[float], int]) -> float:
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{rounded(round(value / step, 9)) * step:.2g}")


def _memory(image: AnyImage) -> NDArray[np.float32] | None:
    """Return memory for the mean electrons of an image that is not needed any more."""
    return image.rate if isinstance(image, StaticImage) else None
