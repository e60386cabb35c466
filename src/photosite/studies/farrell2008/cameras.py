"""The 2008 paper's two cameras: what the simulation is told of them, and the virtual ones that stand in for real ones.

The paper's frames were never published. What this study calls measured is shot by a virtual camera (`MeasuredCamera`)
that differs from what the simulation is told (`Case`) in what nobody tells a simulation, either:

- its lens is a little out of focus; the simulation's is limited by diffraction alone,
- the lamp lights the chart unevenly by 3 %; the simulation's chart is even, at the luminance that a spectroradiometer
  reads on average over the chart,
- its fill factor lies somewhere below Table 1's; the simulation does not know it, and fits it,
- it is another chip of the same design, with another fixed pattern, and other photons.

All of this is drawn from the study's seed (`HiddenTruth.drawn`). What both share is what the paper's authors
measured beforehand: Table 1, spectral sensitivities, exposure, the lens's marks, the chart's reflectances, and the
lamp's spectrum.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.optics.annular import defocused_otf
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.mapping import RadialMapping
from photosite.optics.point_spread import RadialPsf
from photosite.optics.veiling_glare import VeilingGlare
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.virtual_lab import with_pedestal

ILLUMINANT = "A"
"""The paper's tungsten light, in the simulation and in the virtual laboratory."""

UNEVENNESS = 0.03
"""Brightest less darkest light on the chart, relative to the mean."""

WAVEFRONT_ERROR_WAVES = 0.06
"""RMS wavefront error of the measured camera's lens at 550 nm; a lens of 0.07 is still called diffraction-limited."""

_WAVEFRONT_NM = 550.0

FILL_FACTOR_BELOW = 0.07
"""The hidden fill factor is the paper's or up to this much less: with more, the D200's white patch would clip."""

CHART_ROWS, CHART_COLS = 528, 784
"""Of frames of the chart: 4 pixels for each of its samples, 6400 in a patch's region. Fewer than the sensors have,
so that the study is quick; the pixel, the lens and the chart filling the frame stay."""


def frame_key(seed: int, purpose: str) -> int:
    """Key of the temporal noise for one use of the study's seed; two uses are independent of each other.

    Examples
    --------
    >>> frame_key(2008, "measured chart") == frame_key(2008, "simulated chart")
    False
    """
    return int.from_bytes(hashlib.blake2b(f"{seed}: {purpose}".encode(), digest_size=8).digest(), "big")


@dataclass(frozen=True)
class AberratedLens:
    """A diffraction-limited lens a little out of focus: the same light, a lower transfer function.

    Parameters
    ----------
    lens
        The lens in focus.
    wavefront_error_waves
        Root mean square over the pupil of the wavefront's error, in waves of 550 nm, 0 or more.

    Raises
    ------
    InputError
        If the error is negative or not finite.

    Notes
    -----
    The exact transfer function of a circular pupil with the phase 2 pi W r^2, W = sqrt(12) RMS / wavelength, see
    `photosite.optics.annular.defocused_otf`. Its transform is an intensity, so no pixel gets less than no light.

    Examples
    --------
    >>> ideal = DiffractionLimited(f_number=8, focal_length_mm=50)
    >>> half = ideal.cutoff_per_m(550.0, 1.2) / 2
    >>> [round(float(lens.otf(np.array([half]), 550.0, 1.2)[0]), 4) for lens in (ideal, AberratedLens(ideal, 0.06))]
    [0.391, 0.3172]
    """

    lens: DiffractionLimited
    wavefront_error_waves: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.wavefront_error_waves) and self.wavefront_error_waves >= 0):
            raise InputError(f"a wavefront error is 0 waves or more, not {self.wavefront_error_waves}")

    def magnification(self, distance_m: float) -> float:
        """|m|, image size over object size."""
        return self.lens.magnification(distance_m)

    def irradiance_per_radiance(self, wavelength_nm: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
        """(wavelengths,) sr: on-axis irradiance over radiance; aberrations lose no light."""
        return self.lens.irradiance_per_radiance(wavelength_nm, distance_m)

    def cutoff_per_m(self, wavelength_nm: float, distance_m: float) -> float:
        """Diffraction's cutoff frequency on the sensor, cycles/m."""
        return self.lens.cutoff_per_m(wavelength_nm, distance_m)

    def otf(self, frequency_per_m: NDArray[np.float64], wavelength_nm: float, distance_m: float) -> NDArray[np.float64]:
        """The transfer function of the pupil with its wavefront error."""
        waves_at_rim = math.sqrt(12.0) * self.wavefront_error_waves * _WAVEFRONT_NM / wavelength_nm
        return defocused_otf(frequency_per_m / self.cutoff_per_m(wavelength_nm, distance_m), waves_at_rim)

    def relative_illumination(
        self, image_height_m: NDArray[np.float64], distance_m: float
    ) -> NDArray[np.float64] | None:
        """As the lens's."""
        return self.lens.relative_illumination(image_height_m, distance_m)

    def point_spread(self, distance_m: float) -> RadialPsf:
        """The point spread of the pupil with its wavefront error; so small a one does not reach farther."""
        ideal = self.lens.point_spread(distance_m)
        return replace(ideal, otf=lambda frequency, wavelength_nm: self.otf(frequency, wavelength_nm, distance_m))

    def mapping(self, distance_m: float) -> RadialMapping | None:
        """As the lens's."""
        return self.lens.mapping(distance_m)

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        """As the lens's."""
        return self.lens.veiling_glare


@dataclass(frozen=True)
class Case:
    """One of the paper's two cameras: what the simulation is told, and no more.

    Parameters
    ----------
    key, title
        What it is called in results and in words.
    preset
        Its sensor file: Table 1. Of its fill factor, only the paper's value is said there; the simulation of this
        study fits its own.
    f_number, focal_length_mm
        As marked on the lens.
    exposure_s
        Of the chart.
    luminances_cd_m2
        Mean luminances of the chart's patches that the paper shot, brightest last.
    paper_fill_factor
        What the paper's fit of patch means found.
    chart_rows, chart_cols
        Size of the chart's frames.
    """

    key: str
    title: str
    preset: str
    f_number: float
    focal_length_mm: float
    exposure_s: float
    luminances_cd_m2: tuple[float, ...]
    paper_fill_factor: float
    chart_rows: int = CHART_ROWS
    chart_cols: int = CHART_COLS

    def sensor(self, rows: int | None = None, cols: int | None = None) -> Sensor:
        """The sensor of Table 1 with some rows and columns, those of the chart's frames if not given.

        The black level of the D200 is raised, so that its darks do not clip at 0 (`with_pedestal`).
        """
        return with_pedestal(
            load_sensor(self.preset).with_(
                rows=self.chart_rows if rows is None else rows, cols=self.chart_cols if cols is None else cols
            )
        )

    @property
    def lens(self) -> DiffractionLimited:
        """The lens that the simulation is told of."""
        return DiffractionLimited(f_number=self.f_number, focal_length_mm=self.focal_length_mm)

    def camera(self, fill_factor: float) -> Camera:
        """The simulation's camera at the chart, with some fill factor; its chip is none that was measured."""
        sensor = self.sensor().with_(fill_factor=fill_factor, serial=f"{self.key}, simulated")
        return Camera(self.lens, sensor)

    def chart(self, luminance_cd_m2: float | None = None) -> Scene:
        """The ColorChecker that the simulation sees, evenly lit; at the brightest luminance if none is given."""
        level = self.luminances_cd_m2[-1] if luminance_cd_m2 is None else luminance_cd_m2
        return charts.macbeth(ILLUMINANT, level)


# Conditions: Farrell, Okincha and Parmar (2008), Table 1. Charts stand at the 1.2 m of the preset's D200 conditions;
# for the vendor's camera that is an assumption: farther away, its chart would be brighter by less than 1 %.
D200 = Case("d200", "Nikon D200", "nikon-d200", 8.0, 50.0, 1 / 3, (40.0,), 0.9)
VENDOR = Case("vendor", "Vendor 2.2 µm", "vendor-2.2um", 2.8, 4.88, 0.066, (5.0, 15.0, 40.0), 0.5)
CASES = (D200, VENDOR)


@dataclass(frozen=True)
class HiddenTruth:
    """What the measured camera is and the simulation is not told.

    Parameters
    ----------
    fill_factor
        Of its pixels.
    serial
        Of its chip.
    wavefront_error_waves
        Of its lens, RMS at 550 nm.
    unevenness
        Brightest less darkest light on the chart over their mean.
    lamp_angle_deg
        Where on the chart the light is strongest: 0 is right, 90 is down.
    """

    fill_factor: float
    serial: str
    wavefront_error_waves: float
    unevenness: float
    lamp_angle_deg: float

    @classmethod
    def drawn(cls, case: Case, seed: int) -> HiddenTruth:
        """The truth of a seed: a fill factor up to 0.07 below the paper's, a lamp on any side, a chip of its own.

        Examples
        --------
        >>> truth = HiddenTruth.drawn(D200, seed=2008)
        >>> 0.83 < truth.fill_factor < 0.9, truth == HiddenTruth.drawn(D200, seed=2009)
        (True, False)
        """
        rng = np.random.default_rng(frame_key(seed, f"hidden truth of {case.key}"))
        return cls(
            fill_factor=case.paper_fill_factor - FILL_FACTOR_BELOW * float(rng.uniform()),
            serial=f"{case.key}, measured {seed}",
            wavefront_error_waves=WAVEFRONT_ERROR_WAVES,
            unevenness=UNEVENNESS,
            lamp_angle_deg=float(rng.uniform(0.0, 360.0)),
        )

    def to_dict(self) -> dict[str, float | str]:
        """All of it by name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True)
class MeasuredCamera:
    """A virtual camera in place of the paper's real one.

    Parameters
    ----------
    case
        What is known of it.
    truth
        What is not.
    seed
        Key of its temporal noise, by way of `frame_key`.

    Examples
    --------
    >>> measured = MeasuredCamera.drawn(D200, seed=2008)
    >>> raw, other = measured.shoot(frames=2)
    >>> raw.shape, bool((raw.dn != other.dn).any())
    ((528, 784), True)
    """

    case: Case
    truth: HiddenTruth
    seed: int

    @classmethod
    def drawn(cls, case: Case, seed: int) -> MeasuredCamera:
        """The measured camera of a seed of the study."""
        return cls(case, HiddenTruth.drawn(case, seed), seed)

    def sensor(self, rows: int | None = None, cols: int | None = None) -> Sensor:
        """The sensor that it really has."""
        told = self.case.sensor(rows, cols)
        return told.with_(fill_factor=self.truth.fill_factor, serial=self.truth.serial)

    @property
    def camera(self) -> Camera:
        """Lens and sensor, as they are."""
        return Camera(AberratedLens(self.case.lens, self.truth.wavefront_error_waves), self.sensor())

    def chart(self, luminance_cd_m2: float | None = None) -> Scene:
        """The chart as it is lit: its light is, on average over the patches, what the simulation is told."""
        return unevenly_lit(self.case.chart(luminance_cd_m2), self.truth.unevenness, self.truth.lamp_angle_deg)

    def shoot(self, luminance_cd_m2: float | None = None, frames: int = 1) -> tuple[RawFrame, ...]:
        """Raw frames of the chart, at the paper's exposure."""
        level = self.case.luminances_cd_m2[-1] if luminance_cd_m2 is None else luminance_cd_m2
        key = frame_key(self.seed, f"measured chart of {self.case.key} at {level:g} cd/m2")
        return tuple(self.camera.stream(self.chart(level), self.case.exposure_s, frames, seed=key))


def unevenly_lit(scene: Scene, unevenness: float, angle_deg: float) -> Scene:
    """A chart under a lamp to one side of it: the same light on average over the samples that are not black.

    The light is a plane and a weaker bowl, the middle brighter than the rim by half of what the plane drops from the
    middle to the rim.

    Parameters
    ----------
    scene
        The evenly lit chart.
    unevenness
        Brightest less darkest light over the samples that are not black, relative to its mean; below 1.
    angle_deg
        Towards the lamp: 0 is right, 90 is down.

    Examples
    --------
    >>> even = charts.macbeth()
    >>> lit = unevenly_lit(even, 0.03, 30.0)
    >>> light = lit.weights.sum(axis=0)[even.weights.any(axis=0)]
    >>> round(float(light.mean()), 5), round(float(np.ptp(light)), 5)
    (1.0, 0.03)
    """
    if not 0 <= unevenness < 1:
        raise InputError(f"unevenness is a fraction of the mean light, from 0 to below 1, not {unevenness}")
    rows, cols = scene.shape
    y = (np.arange(rows) + 0.5 - rows / 2)[:, None] / (cols / 2)
    x = (np.arange(cols) + 0.5 - cols / 2)[None, :] / (cols / 2)
    angle = math.radians(angle_deg)
    light = x * math.cos(angle) + y * math.sin(angle) - 0.5 * (x**2 + y**2)
    seen = light[scene.weights.any(axis=0)]
    light = 1.0 + unevenness * (light - seen.mean()) / np.ptp(seen)
    return replace(scene, weights=(scene.weights * light).astype(np.float32))
