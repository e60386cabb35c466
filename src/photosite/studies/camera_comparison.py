"""Cameras side by side: signal-to-noise ratio, sharpness, and a ColorChecker's patches and colors in the same light."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.camera.mean_image import pitch_m
from photosite.develop.camera_color import ColorMatrix, fit_color_matrix
from photosite.errors import InputError
from photosite.metrics.charts.color_checker import chart_regions, chart_xyz_d65
from photosite.metrics.patches import PatchStatistics, patch_statistics
from photosite.metrics.snr import noise_budget
from photosite.optics.distortion import image_height
from photosite.optics.point_spread import otf_at
from photosite.scene import charts
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.studies.gray_surface import light_capacity_e
from photosite.studies.sensor_comparison import (
    SWITCHES,
    SensorFacts,
    draw_snr,
    luminance_grid,
    sensor_facts,
    transitions_to_dict,
)
from photosite.studies.simulated_charts import brief_columns, compared_quality, quality_cells, quality_to_dict
from photosite.values.estimate import Estimate
from photosite.values.exposure import check_exposure, format_exposure
from photosite.values.shown import Cell, ResultTable, Shown, Tabular

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

WAVELENGTH_NM = 550.0
"""Of the MTF and the distortion."""
CHART_ROWS, CHART_COLS = 528, 792
"""Largest array on which the chart is simulated; its patches fill any array."""
_FREQUENCIES = 121
_VOLTS = 120
_LOWEST_SHARE = 1e-4  # of the saturation, the lowest signal of the noise budgets


@dataclass(frozen=True, eq=False)
class CameraFacts(Shown):
    """One camera under the conditions of a comparison.

    Parameters
    ----------
    camera, light
        The camera, and its signal and noise as in `compare_sensors`, with the camera's own lens.
    distance_m
        Distance from the lens to the chart.
    patches
        Statistics of the patches of a simulated frame that the chart fills; None if the array is too small for it.
    used
        (patches,), false where a channel is saturated.
    colors
        Camera channels to XYZ under D65, fitted to the used patches, with its color errors; None without.
    reason
        Why there are no patches or no colors; empty otherwise.
    """

    camera: Camera
    light: SensorFacts
    distance_m: float
    patches: PatchStatistics | None
    used: NDArray[np.bool_]
    colors: ColorMatrix | None
    reason: str

    @property
    def nyquist_per_mm(self) -> float:
        """Half the sampling frequency along the rows, in cycles per mm."""
        return 5e-4 / pitch_m(self.camera.sensor)[1]

    def mtf(self, frequency_per_mm: Array) -> Array:
        """Return the MTF of lens and photodetector on the axis, along the rows of the frame, at 550 nm."""
        sensor, frequency = self.camera.sensor, np.asarray(frequency_per_mm, np.float64) * 1e3
        spread = self.camera.optics.point_spread(self.distance_m)
        side_m = pitch_m(sensor)[1] * math.sqrt(sensor.pixel.fill_factor.value)
        lens = np.abs(otf_at(spread, np.zeros(frequency.shape), frequency, WAVELENGTH_NM))
        return np.asarray(lens * np.abs(np.sinc(frequency * side_m)))

    @property
    def mtf50_per_mm(self) -> float | None:
        """Lowest frequency at which the MTF is 0.5; None if that is above the sampling frequency."""
        grid = np.linspace(0.0, 2.0 * self.nyquist_per_mm, 4 * _FREQUENCIES)
        below = np.flatnonzero(self.mtf(grid) <= 0.5)
        if not below.size:
            return None
        ends = grid[below[0] - 1 : below[0] + 1]
        values = self.mtf(ends)
        return float(ends[0] + (values[0] - 0.5) / (values[0] - values[1]) * (ends[1] - ends[0]))

    @property
    def mtf50_per_height(self) -> float | None:
        """`mtf50_per_mm` in line pairs per picture height, which compares sensors of different sizes."""
        height_mm = self.camera.sensor.array.rows * pitch_m(self.camera.sensor)[0] * 1e3
        return None if self.mtf50_per_mm is None else self.mtf50_per_mm * height_mm

    @property
    def _corner_m(self) -> float:
        array, pitch = self.camera.sensor.array, pitch_m(self.camera.sensor)
        return math.hypot(array.rows * pitch[0], array.cols * pitch[1]) / 2

    @property
    def corner_illumination_percent(self) -> float:
        """Irradiance in the corner of the frame over that on the axis."""
        found = self.camera.optics.relative_illumination(np.array([self._corner_m]), self.distance_m)
        return 100.0 if found is None else 100.0 * float(found[0])

    @property
    def corner_distortion_percent(self) -> float:
        """Real over ideal image height in the corner of the frame, less 1."""
        mapping = self.camera.optics.mapping(self.distance_m)
        if mapping is None:
            return 0.0
        corner = np.array([self._corner_m])
        return 100.0 * float(image_height(mapping, WAVELENGTH_NM)(corner)[0] / corner[0] - 1.0)

    @property
    def delta_e_2000(self) -> Array | None:
        """(patches,) CIEDE2000 between fitted and true color, NaN for patches that are not used."""
        if self.colors is None:
            return None
        found = np.full(self.used.size, np.nan)
        found[self.used] = self.colors.delta_e_2000
        return found

    def to_dict(self) -> dict[str, Cell]:
        """Return the numbers of the table."""
        colors = self.colors
        return {
            **self.light.to_dict(),
            "nyquist_per_mm": self.nyquist_per_mm,
            "mtf50_per_mm": self.mtf50_per_mm,
            "mtf50_per_height": self.mtf50_per_height,
            "mtf_at_nyquist": float(self.mtf(np.array([self.nyquist_per_mm]))[0]),
            "corner_illumination_percent": self.corner_illumination_percent,
            "corner_distortion_percent": self.corner_distortion_percent,
            "mean_delta_e_2000": None if colors is None else float(colors.delta_e_2000.mean()),
            "largest_delta_e_2000": None if colors is None else float(colors.delta_e_2000.max()),
            "mean_delta_e_2000_left_out": None if colors is None else float(colors.delta_e_2000_left_out.mean()),
        }

    def chart_to_dict(self) -> dict[str, Any]:
        """Return the patches as plain lists; None where a patch is saturated."""
        found: dict[str, Any] = {"reason": self.reason}
        if (patches := self.patches) is not None:
            found |= {
                "patches": list(patches.names),
                "channels": list(patches.channels),
                "mean_dn": patches.mean_dn.tolist(),
                "snr_db": np.ma.masked_invalid(patches.spatial_snr_db).tolist(),
                "saturated": patches.saturated.tolist(),
            }
        delta = self.delta_e_2000
        return found | {"delta_e_2000": None if delta is None else np.ma.masked_invalid(delta).tolist()}


@dataclass(frozen=True, eq=False)
class CameraComparison(Tabular):
    """Result of `compare_cameras`.

    Parameters
    ----------
    cameras
        By label.
    luminance_cd_m2
        (points,) of the curves of signal-to-noise ratio.
    frequency_per_mm
        (points,) of the curves of MTF, to the highest Nyquist frequency.
    exposure_s, illuminant, mean_luminance_cd_m2, distance_m, seed
        The conditions.
    quality
        Values of image quality of simulated charts, by label and name.
    """

    cameras: Mapping[str, CameraFacts]
    luminance_cd_m2: Array
    frequency_per_mm: Array
    exposure_s: float
    illuminant: str
    mean_luminance_cd_m2: float
    distance_m: float
    seed: int
    quality: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)

    def facts(self) -> dict[str, dict[str, Cell]]:
        """Return the numbers of each camera, and its image quality."""
        cells = {label: quality_cells(each) for label, each in self.quality.items()}
        return {label: each.to_dict() | cells.get(label, {}) for label, each in self.cameras.items()}

    @property
    def conditions(self) -> str:
        """The conditions in words."""
        return (
            f"{format_exposure(self.exposure_s)} s, illuminant {self.illuminant}, {self.mean_luminance_cd_m2:g} cd/m²"
        )

    def noise_budgets(self) -> dict[str, dict[str, list[float]]]:
        """Return volts at the pixel and total SNR in dB by label, without sensors of no noise."""
        found: dict[str, dict[str, list[float]]] = {}
        for label, facts in self.cameras.items():
            sensor = facts.camera.sensor
            top = light_capacity_e(sensor, 0.0) * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
            volts = np.geomspace(top * _LOWEST_SHARE, top, _VOLTS)
            total_db = noise_budget(sensor, volts).total_db
            if np.isfinite(total_db).all():
                found[label] = {"volts": volts.tolist(), "snr_db": total_db.tolist()}
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return conditions, figures, curves and patches as plain values; None above saturation."""
        names = ("exposure_s", "illuminant", "mean_luminance_cd_m2", "distance_m", "seed")
        grid = self.luminance_cd_m2
        return {
            **{name: getattr(self, name) for name in names},
            "cameras": self.facts(),
            "quality": quality_to_dict(self.quality),
            "transitions": transitions_to_dict({label: facts.light for label, facts in self.cameras.items()}),
            "luminance_cd_m2": grid.tolist(),
            "snr_db": {
                label: np.ma.masked_invalid(facts.light.snr_db(grid)).tolist() for label, facts in self.cameras.items()
            },
            "noise_budgets": self.noise_budgets(),
            "frequency_per_mm": self.frequency_per_mm.tolist(),
            "mtf": {label: facts.mtf(self.frequency_per_mm).tolist() for label, facts in self.cameras.items()},
            "chart": {label: facts.chart_to_dict() for label, facts in self.cameras.items()},
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the signal-to-noise ratios on Matplotlib axes, new ones by default, and return them."""
        from photosite.report.plots import new_or_given

        axes = new_or_given(ax)
        draw_snr(axes, {label: facts.light for label, facts in self.cameras.items()}, self.luminance_cd_m2)
        return axes

    def _table(self) -> ResultTable:
        facts = self.facts()
        rows = [(label, *each.values()) for label, each in facts.items()]
        names = next(iter(facts.values()))
        return ResultTable(f"Cameras at {self.conditions}", ("camera", *names), rows)

    def _brief_table(self) -> ResultTable:
        brief = ["dynamic_range_db", "snr10_cd_m2", "mtf50_per_height", "mean_delta_e_2000"]
        if any(facts.light.transitions for facts in self.cameras.values()):
            brief.insert(2, SWITCHES)
        return self._table().only(("camera", *brief, *brief_columns(self.quality)))


def compare_cameras(
    cameras: Mapping[str, Camera],
    *,
    exposure_s: float = 1 / 15,
    illuminant: str = "3200K",
    mean_luminance_cd_m2: float = 40.0,
    distance_m: float = DEFAULT_DISTANCE_M,
    seed: int = 0,
    values: Sequence[str] = (),
    on_progress: Callable[[str], None] | None = None,
) -> CameraComparison:
    """Compare cameras in the same light: noise, sharpness on the axis, and the patches of a ColorChecker.

    Parameters
    ----------
    cameras
        By label: any lenses with any sensors.
    exposure_s, illuminant
        The common exposure time and light.
    mean_luminance_cd_m2, distance_m
        Mean luminance of the chart's patches, and its distance from the lens.
    seed
        Key of the noise in the frames of the chart.
    values
        Names of image quality, such as "edge-sfr.mtf50.G", as for `photosite.studies.simulated_charts.image_quality`:
        of charts in the same light, exposed to just below saturation.
    on_progress
        Called with what is measured of image quality.

    Raises
    ------
    InputError
        If there are no cameras, or a condition is invalid.

    Notes
    -----
    Signal and noise are those of `compare_sensors`, with each camera's own lens. The chart fills an array of at most
    528 x 792 pixels of the sensor, about the optical axis. Its color errors are those of the best matrix from the
    camera's channels to XYZ under D65 (`photosite.develop.camera_color.fit_color_matrix`), as in Farrell, Okincha and
    Parmar (2008), section 3, without patches that saturate a channel.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> lenses = {f"f/{n:g}": ps.DiffractionLimited(n, 50) for n in (4, 16)}
    >>> found = ps.studies.compare_cameras({name: ps.Camera(lens, sensor) for name, lens in lenses.items()})
    >>> [round(facts.mtf50_per_mm) for facts in found.cameras.values()]
    [84, 40]
    """
    if not cameras:
        raise InputError("cameras", value=cameras, expected="at least one camera by its label")
    time_s = check_exposure(exposure_s)
    chart = charts.macbeth(illuminant, mean_luminance_cd_m2, distance_m=distance_m)
    facts = {
        label: _facts(camera, sensor_facts(camera, time_s, illuminant, f"camera '{label}'"), chart, seed)
        for label, camera in cameras.items()
    }
    highest = max(each.nyquist_per_mm for each in facts.values())
    return CameraComparison(
        facts,
        luminance_grid({label: each.light for label, each in facts.items()}),
        np.linspace(0.0, highest, _FREQUENCIES),
        time_s,
        illuminant,
        float(mean_luminance_cd_m2),
        float(distance_m),
        seed,
        compared_quality(cameras, values, on_progress, illuminant=illuminant, luminance_cd_m2=mean_luminance_cd_m2),
    )


def _facts(camera: Camera, light: SensorFacts, chart: Scene, seed: int) -> CameraFacts:
    """Return the facts of a camera from a simulated frame of the chart."""
    none = np.zeros(0, np.bool_)
    array = camera.sensor.array
    rows, cols = (
        min(size, most) // len(tile) * len(tile)
        for size, most, tile in ((array.rows, CHART_ROWS, array.cfa), (array.cols, CHART_COLS, array.cfa[0]))
    )
    sensor = camera.sensor.with_(rows=rows, cols=cols, maps=None)
    try:
        frame = replace(camera, sensor=sensor).capture(chart, light.exposure_s, seed=seed)
        patches = patch_statistics(frame, chart_regions("macbeth", rows, cols))
    except InputError as error:
        return CameraFacts(camera, light, chart.distance_m, None, none, None, f"no patches: {error}")
    used = np.asarray(~patches.saturated.any(axis=1), np.bool_)
    colors, reason = None, ""
    try:
        if not {"R", "G", "B"} <= set(patches.channels):
            raise InputError("the sensor has no red, green and blue channels")
        names = [name for name, kept in zip(patches.names, used, strict=True) if kept]
        colors = fit_color_matrix(patches.mean_dn[used], chart_xyz_d65("macbeth", names))
    except InputError as error:
        reason = f"no color errors: {error}"
    return CameraFacts(camera, light, chart.distance_m, patches, used, colors, reason)
