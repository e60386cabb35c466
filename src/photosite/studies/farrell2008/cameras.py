"""The two cameras of the 2008 paper: their known parameters, and the virtual cameras that replace the real ones.

The paper's frames were never published. In this study, measured frames come from a virtual camera (`MeasuredCamera`)
that differs from what the simulation knows (`Case`), as a real camera does:

- its lens is slightly out of focus; that of the simulation is limited by diffraction alone,
- the lamp lights the chart unevenly by 3 %; the chart of the simulation is evenly lit at the mean luminance,
- its fill factor is somewhat below that of Table 1; the simulation does not know it and fits it,
- it is another chip of the same design, with another fixed pattern and other temporal noise.

All of this is drawn from the seed of the study (`HiddenTruth.drawn`). Both sides share what the authors of the paper
measured beforehand: Table 1, spectral sensitivities, exposure time, lens data, and reflectances and light of the chart.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.optics.annular import defocused_otf
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.virtual_lab import with_pedestal

ILLUMINANT = "A"
"""The tungsten light of the paper."""

UNEVENNESS = 0.03
"""Difference of brightest and darkest light on the chart, relative to the mean."""

WAVEFRONT_ERROR_WAVES = 0.06
"""RMS wavefront error of the measured camera's lens at 550 nm; lenses up to 0.07 count as diffraction-limited."""

_WAVEFRONT_NM = 550.0

FILL_FACTOR_BELOW = 0.07
"""Largest amount by which the hidden fill factor is below the paper's; with a larger one the white patch would clip."""

CHART_ROWS, CHART_COLS = 528, 784
"""Frame size of the chart: 4 pixels for each of its samples, 6400 in the region of a patch. Smaller than the sensors,
so that the study is fast."""


def frame_key(seed: int, purpose: str) -> int:
    """Return the key of the temporal noise for one purpose; different purposes are independent.

    Examples
    --------
    >>> frame_key(2008, "measured chart") == frame_key(2008, "simulated chart")
    False
    """
    return int.from_bytes(hashlib.blake2b(f"{seed}: {purpose}".encode(), digest_size=8).digest(), "big")


@dataclass(frozen=True)
class DefocusedLens(DiffractionLimited):
    """A diffraction-limited lens slightly out of focus: the same light, a lower transfer function.

    `wavefront_error_waves` is the RMS wavefront error over the pupil in waves of 550 nm, 0 or more. The transfer
    function is the exact one of a circular pupil with the phase 2 pi W r^2, W = sqrt(12) RMS / wavelength, see
    `photosite.optics.annular.defocused_otf`. Its transform is an intensity, so that no pixel value is negative.

    Examples
    --------
    >>> lenses = DiffractionLimited(f_number=8, focal_length_mm=50), DefocusedLens(8, 50, wavefront_error_waves=0.06)
    >>> half = lenses[0].cutoff_per_m(550.0, 1.2) / 2
    >>> [round(float(lens.otf(np.array([half]), 550.0, 1.2)[0]), 4) for lens in lenses]
    [0.391, 0.3172]
    """

    wavefront_error_waves: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.wavefront_error_waves) and self.wavefront_error_waves >= 0):
            raise InputError("wavefront_error_waves", value=self.wavefront_error_waves, expected="0 or more")

    def otf(self, frequency_per_m: NDArray[np.float64], wavelength_nm: float, distance_m: float) -> NDArray[np.float64]:
        """Return the transfer function of the pupil with its wavefront error."""
        waves_at_rim = math.sqrt(12.0) * self.wavefront_error_waves * _WAVEFRONT_NM / wavelength_nm
        return defocused_otf(frequency_per_m / self.cutoff_per_m(wavelength_nm, distance_m), waves_at_rim)


@dataclass(frozen=True)
class Case:
    """One of the two cameras of the paper, as the simulation knows it.

    Parameters
    ----------
    key, title
        Name in results and in text.
    preset
        Sensor file: Table 1. The simulation fits its own fill factor.
    f_number, focal_length_mm
        Nominal lens data.
    exposure_s, luminances_cd_m2
        Exposure time of the chart, and mean luminances of its patches, brightest last.
    paper_fill_factor
        Result of the paper's fit.
    chart_rows, chart_cols
        Frame size of the chart in pixels.
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
        """Return the sensor of Table 1, by default with the frame size of the chart.

        The black level of the D200 is raised, so that its dark frames do not clip at 0 (`with_pedestal`).
        """
        sensor = load_sensor(self.preset)
        return with_pedestal(sensor.with_(rows=rows or self.chart_rows, cols=cols or self.chart_cols))

    @property
    def lens(self) -> DiffractionLimited:
        """Lens of the simulation."""
        return DiffractionLimited(f_number=self.f_number, focal_length_mm=self.focal_length_mm)

    def camera(self, fill_factor: float, serial: str | None = None) -> Camera:
        """Return the camera of the simulation with a fill factor; its chip differs from the measured one."""
        return Camera(
            self.lens, self.sensor().with_(fill_factor=fill_factor, serial=serial or f"{self.key}, simulated")
        )

    def chart(self, luminance_cd_m2: float | None = None) -> Scene:
        """Return the evenly lit ColorChecker of the simulation, by default at the brightest luminance."""
        level = self.luminances_cd_m2[-1] if luminance_cd_m2 is None else luminance_cd_m2
        return charts.macbeth(ILLUMINANT, level)


# Farrell, Okincha and Parmar (2008), Table 1. The distance of 1.2 m is that of the preset's D200 conditions. It is an
# assumption for the vendor camera: farther away, its chart would be less than 1 % brighter.
D200 = Case("d200", "Nikon D200", "nikon-d200", 8.0, 50.0, 1 / 3, (40.0,), 0.9)
VENDOR = Case("vendor", "Vendor 2.2 µm", "vendor-2.2um", 2.8, 4.88, 0.066, (5.0, 15.0, 40.0), 0.5)
CASES = (D200, VENDOR)


@dataclass(frozen=True)
class HiddenTruth:
    """Parameters of the measured camera that the simulation does not know.

    Lens and light as `WAVEFRONT_ERROR_WAVES` and `UNEVENNESS`; the light is strongest towards `lamp_angle_deg` (0 is
    right, 90 is down).
    """

    fill_factor: float
    serial: str
    wavefront_error_waves: float
    unevenness: float
    lamp_angle_deg: float

    @classmethod
    def drawn(cls, case: Case, seed: int) -> HiddenTruth:
        """Return the hidden parameters of a seed.

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
        """Return the parameters by name."""
        return asdict(self)


@dataclass(frozen=True)
class MeasuredCamera:
    """A virtual camera that replaces the real camera of the paper.

    Hidden parameters and keys of the temporal noise follow from the seed of the study.

    Examples
    --------
    >>> measured = MeasuredCamera(D200, seed=2008)
    >>> raw, other = measured.shoot(frames=2)
    >>> raw.shape, bool((raw.dn != other.dn).any())
    ((528, 784), True)
    """

    case: Case
    seed: int

    @property
    def truth(self) -> HiddenTruth:
        """Hidden parameters."""
        return HiddenTruth.drawn(self.case, self.seed)

    def sensor(self, rows: int | None = None, cols: int | None = None) -> Sensor:
        """Return its true sensor."""
        return self.case.sensor(rows, cols).with_(fill_factor=self.truth.fill_factor, serial=self.truth.serial)

    @property
    def camera(self) -> Camera:
        """True lens and sensor."""
        waves = self.truth.wavefront_error_waves
        lens = DefocusedLens(self.case.f_number, self.case.focal_length_mm, wavefront_error_waves=waves)
        return Camera(lens, self.sensor())

    def chart(self, luminance_cd_m2: float | None = None) -> Scene:
        """Return the unevenly lit chart, with the mean luminance that the simulation knows."""
        return unevenly_lit(self.case.chart(luminance_cd_m2), self.truth.unevenness, self.truth.lamp_angle_deg)

    def shoot(self, luminance_cd_m2: float | None = None, frames: int = 1) -> tuple[RawFrame, ...]:
        """Return raw frames of the chart at the exposure time of the paper."""
        level = self.case.luminances_cd_m2[-1] if luminance_cd_m2 is None else luminance_cd_m2
        key = frame_key(self.seed, f"measured chart of {self.case.key} at {level:g} cd/m2")
        return tuple(self.camera.stream(self.chart(level), self.case.exposure_s, frames, seed=key))


def unevenly_lit(scene: Scene, unevenness: float, angle_deg: float) -> Scene:
    """Return an evenly lit scene under a lamp at one side, with the same mean over the samples that are not black.

    The light is a plane plus a weaker bowl: the middle is brighter than the rim by half of the drop of the plane from
    the middle to the rim. `unevenness` is the difference of brightest and darkest light relative to the mean, from 0 to
    below 1; the lamp is at the right for an angle of 0, below for 90.

    Examples
    --------
    >>> even = charts.macbeth()
    >>> lit = unevenly_lit(even, 0.03, 30.0)
    >>> light = lit.weights.sum(axis=0)[even.weights.any(axis=0)]
    >>> round(float(light.mean()), 5), round(float(np.ptp(light)), 5)
    (1.0, 0.03)
    """
    if not 0 <= unevenness < 1:
        raise InputError("unevenness", value=unevenness, expected="from 0 to below 1")
    rows, cols = scene.shape
    y = (np.arange(rows) + 0.5 - rows / 2)[:, None] / (cols / 2)
    x = (np.arange(cols) + 0.5 - cols / 2)[None, :] / (cols / 2)
    angle = math.radians(angle_deg)
    light = x * math.cos(angle) + y * math.sin(angle) - 0.5 * (x**2 + y**2)
    seen = light[scene.weights.any(axis=0)]
    light = 1.0 + unevenness * (light - seen.mean()) / np.ptp(seen)
    return replace(scene, weights=(scene.weights * light).astype(np.float32))
