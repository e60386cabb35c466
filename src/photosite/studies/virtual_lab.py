"""A virtual laboratory: the frames of a shooting protocol, simulated on demand or written to a folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import integration_weights
from photosite.errors import InputError
from photosite.files.writing import atomic_folder
from photosite.frames.frame_set import FrameSet, FrameSource, group_frames
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.io.protocol import Protocol, ProtocolFrames, write_protocol
from photosite.frames.raw_frame import Numbers, RawFrame
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.capture_readout import captures_of, part_sensor
from photosite.sensor.captures import Captures
from photosite.sensor.effects.model import Effects
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.values.uncertain import Measured

FrameProgress = Callable[[int, int], None]
"""Called with (frames done, frames in total) after each frame."""

DEFAULT_LEVEL = 1.3
"""Signal of the brightest channel at the longest exposure, relative to saturation."""

CLIP_SIGMA, PEDESTAL_SIGMA = 5.0, 8.0
"""In standard deviations of a dark frame: below the first they clip at 0; the second is the raised black level."""

NOMINAL_NAME, TRUTH_NAME, PROTOCOL_NAME = "nominal.sensor.yaml", "truth.sensor.yaml", "protocol.yaml"

_OF_TEMPERATURE = ("dark_current_temperature_c", "dark_doubling_c")
_WRITERS = 2
_PENDING = 8
"""Largest number of frames that wait to be written, which bounds the memory."""


def dark_noise_dn(sensor: Sensor) -> float:
    """Return the standard deviation over the pixels of a dark frame in DN: read noise, DSNU and rounding.

    Examples
    --------
    >>> import photosite as ps
    >>> round(dark_noise_dn(ps.load_sensor("nikon-d200")), 2)
    3.17
    """
    noise = sensor.noise
    analog = math.hypot(noise.read_noise_mv.value, noise.dsnu_mv.value) / sensor.mv_per_dn
    return math.sqrt(analog**2 + QUANTIZATION_DN2)


def with_pedestal(sensor: Sensor) -> Sensor:
    """Return the sensor with a black level that keeps its dark frames from clipping at 0.

    A sensor whose black level is at least 5 standard deviations of a dark frame is returned unchanged. Otherwise the
    black level becomes the next power of two at or above 8 of them. Calibrating clipped dark frames is possible, but
    less accurate (`photosite.calibration.dark.clipped_darks`).

    Raises
    ------
    InputError
        If the new black level exceeds the range of the converter.

    Examples
    --------
    >>> import photosite as ps
    >>> with_pedestal(ps.load_sensor("nikon-d200")).readout.black_level_dn.value
    32.0
    """
    sigma = dark_noise_dn(sensor)
    if sensor.readout.black_level_dn.value >= CLIP_SIGMA * sigma:
        return sensor
    pedestal = float(2 ** math.ceil(math.log2(PEDESTAL_SIGMA * sigma)))
    source = f"raised so that dark frames with {sigma:.3g} DN of noise do not clip at 0"
    return sensor.with_(black_level_dn=Measured(pedestal, source=source, assumed=True))


def nominal_sensor(sensor: Sensor) -> Sensor:
    """Return the sensor as known before the measurement: geometry, converter, voltage swing, spectral response.

    Noise and black level become 0, conversion gain and well capacity 1 in their units, each marked as assumed. Maps of
    the chip, the temperature of its dark current and the values of other gain settings are removed. Of its effects, the
    lines without light stay, and that it is a CCD with its output at a corner. Names and
    combination of several captures stay.

    Examples
    --------
    >>> import photosite as ps
    >>> nominal_sensor(ps.load_sensor("google-pixel-4a").at_gain_setting(440)).all_gain_settings
    (440.0,)
    """
    unknown = Measured(0.0, source="placeholder: to be measured", assumed=True)
    scale = replace(unknown, value=1.0)
    captures = sensor.captures
    if captures is not None:
        parts = [part.model_dump(include={"name", "charge", "charge_of"}) for part in captures.parts]
        captures = Captures.model_validate({"parts": parts, "combination": captures.combination})
    return sensor.with_(
        captures=captures,
        **{name: None if name in _OF_TEMPERATURE else unknown for name in type(sensor.noise).model_fields},
        black_level_dn=unknown,
        conversion_gain_uv_per_e=scale,
        well_capacity_e=scale,
        maps=None,
        effects=_known(sensor.effects),
        gain_settings=(),
    )


def _known(effects: Effects | None) -> Effects | None:
    """Return what is known of the effects before a measurement."""
    sections = {} if effects is None else effects.stated
    known = {name: entry for name, section in sections.items() if (entry := section.nominal()) is not None}
    return Effects(**known) if known else None


@dataclass(frozen=True)
class VirtualLab:
    """A virtual camera, its light source, and a shooting protocol.

    Light falls perpendicularly on every pixel, as from the source that EMVA 1288 prescribes, so that the sensor's
    angular response has no effect. Filters and crosstalk act as behind a lens.

    Parameters
    ----------
    camera, protocol
        The camera, whose lens is covered for dark frames, and the frames to take.
    light
        Uniform field of the light frames.
    seed
        Key of the temporal noise. The frame number is the frame's position in the protocol.
    photons_known
        Whether the protocol states the photons per pixel, as with a metered light source.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.protocol import paper_d200_protocol
    >>> sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=8, cols=8))
    >>> lab = virtual_lab(sensor, paper_d200_protocol(), seed=3)
    >>> lab.frame_set().frame_count
    405
    """

    camera: Camera
    protocol: ShootingProtocol
    light: Scene
    seed: int = 0
    photons_known: bool = False

    def photons_per_pixel(self, step: Step) -> float | None:
        """Return the mean number of photons of all wavelengths on a pixel's area; None if the light is not metered."""
        if not self.photons_known:
            return None
        if step.kind == "dark":
            return 0.0
        grid = self.light.wavelength_nm
        irradiance = self.light.basis[0] * self.camera.optics.irradiance_per_radiance(grid, self.light.distance_m)
        rate = float(irradiance @ integration_weights(grid, self.camera.integration))
        return rate * float(self.light.weights[0, 0, 0]) * self.camera.sensor.pixel_area_m2 * step.exposure_s

    def frames(self) -> Iterator[tuple[int, Step, RawFrame]]:
        """Yield every frame in the protocol's order: number of the step, step, frame."""
        for number, step, first in self._numbered():
            mean = self._mean_electrons(step)
            for frame in range(first, first + step.count):
                yield number, step, self._expose(step, mean, frame)

    def _settings(self, step: Step) -> FrameSettings:
        gain_setting = self.camera.sensor.gain_setting
        return FrameSettings(step.kind, step.exposure_s, self.photons_per_pixel(step), gain_setting)

    def frame_set(self) -> FrameSet:
        """Return the frames as `calibrate` takes them; each frame is simulated when it is read."""
        listed = [
            (FrameSource(f"virtual frame {frame}", partial(self._dn, step, frame)), self._settings(step))
            for _, step, first in self._numbered()
            for frame in range(first, first + step.count)
        ]
        sensor = self.camera.sensor
        return FrameSet(
            group_frames(listed),
            sensor.array.rows,
            sensor.array.cols,
            sensor.output_bits,
            sensor.array.cfa,
            f"virtual frames of {sensor.name}",
            sensor=nominal_sensor(sensor),
            black_level_dn=sensor.output_levels_dn[0],
        )

    def write(
        self, folder: str | PathLike[str], progress: FrameProgress | None = None, *, captures: bool = False
    ) -> None:
        """Write frames, protocol.yaml, nominal.sensor.yaml and truth.sensor.yaml to a new folder.

        With `captures`, the frames of each capture of the sensor are in a subfolder of its name, with a protocol and a
        nominal sensor each; the true sensor is in the folder. Otherwise the frames are the combined ones.

        The protocol refers to the nominal sensor, which has placeholders for the values to be measured. The true sensor
        is written for comparison; no command reads it. The folder appears complete or not at all.

        Raises
        ------
        FileError
            If the folder is not empty or cannot be written.
        """
        sensor = self.camera.sensor
        sensors = {name: part_sensor(sensor, name) for name in captures_of(sensor).names} if captures else {"": sensor}
        with atomic_folder(folder) as place:
            for name in sensors:
                for kind in dict.fromkeys(step.kind for step in self.protocol.steps):
                    (place / name / kind).mkdir(parents=True)
            self._write_frames(place, tuple(sensors), progress)
            sensor.save(place / TRUTH_NAME)
            entries = tuple(
                ProtocolFrames((f"{step.kind}/{number:02d}_*.tif",), self._settings(step))
                for number, step in enumerate(self.protocol.steps, start=1)
            )
            for name, each in sensors.items():
                nominal_sensor(each).save(place / name / NOMINAL_NAME)
                write_protocol(Protocol(entries, self.protocol.name, sensor=NOMINAL_NAME), place / name / PROTOCOL_NAME)

    def _write_frames(self, place: Path, names: Sequence[str], progress: FrameProgress | None) -> None:
        """Simulate frames in this thread, and write them in others."""
        pending: list[Future[None]] = []
        with ThreadPoolExecutor(_WRITERS) as writers:
            try:
                for done, (number, step, frame) in enumerate(self.frames(), start=1):
                    file = f"{number:02d}_{frame.metadata['frame']:04d}.tif"
                    for name in names:
                        each = frame.capture(name, self.camera.sensor) if name else frame
                        pending.append(writers.submit(each.save, place / name / step.kind / file))
                        if len(pending) >= _PENDING:
                            pending.pop(0).result()
                    if progress is not None:
                        progress(done, self.protocol.frame_count)
                for future in pending:
                    future.result()
            except BaseException:
                writers.shutdown(cancel_futures=True)
                raise

    def _numbered(self) -> Iterator[tuple[int, Step, int]]:
        """Yield the number of each step, from 1, the step, and the number of its first frame, from 0."""
        first = 0
        for number, step in enumerate(self.protocol.steps, start=1):
            yield number, step, first
            first += step.count

    def _mean_electrons(self, step: Step) -> NDArray[np.float32]:
        if step.kind == "dark":
            array = self.camera.sensor.array
            return np.zeros((array.rows, array.cols), np.float32)
        return self._perpendicular.mean_electrons(self.light, step.exposure_s)

    @cached_property
    def _perpendicular(self) -> Camera:
        """The camera without angular response, for perpendicular light."""
        sensor = self.camera.sensor
        if sensor.optical_stack is None or sensor.optical_stack.angular_response is None:
            return self.camera
        return replace(self.camera, sensor=sensor.with_(angular_response=None))

    def _expose(self, step: Step, mean: NDArray[np.float32], frame: int) -> RawFrame:
        raw = self.camera.expose(mean, step.exposure_s, seed=self.seed, frame=frame)
        photons = self.photons_per_pixel(step)
        known = {} if photons is None else {"photons_per_pixel": photons}
        return replace(raw, metadata={**raw.metadata, "kind": step.kind, **known})

    def _dn(self, step: Step, frame: int) -> Numbers:
        return self._expose(step, self._mean_electrons(step), frame).dn


def virtual_lab(
    sensor: Sensor,
    protocol: ShootingProtocol,
    *,
    illuminant: str = "D65",
    level: float = DEFAULT_LEVEL,
    seed: int = 0,
    photons_known: bool = False,
) -> VirtualLab:
    """Return a laboratory with the light level set for a protocol.

    Parameters
    ----------
    sensor, protocol
        The virtual sensor (see `with_pedestal`), and the frames to take.
    illuminant
        Light of the uniform field, as for `photosite.color.illuminants.illuminant`.
    level
        Mean electrons of the brightest channel at the longest exposure, relative to the saturation capacity.
    seed, photons_known
        As in `VirtualLab`.

    Raises
    ------
    InputError
        If the level is not above 0, the illuminant is unknown, or the sensor does not respond to it.
    """
    if not (math.isfinite(level) and level > 0):
        raise InputError("level", value=level, expected="above 0")
    camera = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    field = charts.uniform(illuminant, 1.0)
    longest_s = protocol.longest_light_s
    if longest_s is None:
        return VirtualLab(camera, protocol, field, seed, photons_known)
    tile = sensor.array.cfa
    small = replace(camera, sensor=sensor.with_(rows=len(tile), cols=len(tile[0]), effects=None))
    brightest = float(small.mean_electrons(field, longest_s).max())
    if not brightest > 0:
        expected = "a light that the sensor responds to"
        raise InputError("illuminant", value=illuminant, expected=expected, where=f"sensor '{sensor.name}'")
    light = field.scaled(level * sensor.saturation_capacity_e / brightest)
    return VirtualLab(camera, protocol, light, seed, photons_known)
