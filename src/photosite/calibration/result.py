"""What a calibration gives: parameters with uncertainties, the points behind them, and what was left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.reduction.provenance import UsedFrame, frames_sha256
from photosite.errors import CalibrationError
from photosite.values.measured import COVERAGE_95, Measured
from photosite.values.uncertain import JointCovariance, Missing, Source, Uncertain, Value

if TYPE_CHECKING:
    from photosite.calibration.chip_maps.temporal import TemporalNoise
    from photosite.calibration.photon_transfer.general_model import GeneralModel
    from photosite.calibration.photon_transfer.linearity import Linearity
    from photosite.calibration.photon_transfer.snr import SnrCurve
    from photosite.calibration.spatial.spatial_analysis import SpatialAnalysis
    from photosite.sensor.measured_chip import MeasuredChip
    from photosite.sensor.model import Sensor


Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter as estimated, or the reason why it could not be.

    Parameters
    ----------
    value, standard_uncertainty
        In the unit that the parameter's name ends in; None where it could not be estimated.
    reason
        Why there is no value.
    upper_limit_95
        95 % upper limit, where the variance behind the value is not distinguishable from zero. A variance
        difference that comes out negative is not cut off: the value is then -sqrt(-variance).
    method
        How it was estimated, with the clause of the standard where there is one.
    interval_95
        The 95 % interval, not symmetric where few lines or frames stand behind the value; the normal one if None.
    parts
        What one standard uncertainty of each independent source does to the value; estimates may share sources.

    Examples
    --------
    >>> Estimate(2.0, 0.1).interval_95
    (1.804..., 2.195...)
    """

    value: float | None = None
    standard_uncertainty: float | None = None
    reason: str | None = None
    upper_limit_95: float | None = None
    method: str = ""
    interval_95: Interval | None = None
    parts: Mapping[Source, float] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.interval_95 is None and self.value is not None and self.standard_uncertainty is not None:
            half = COVERAGE_95 * self.standard_uncertainty
            object.__setattr__(self, "interval_95", (self.value - half, self.value + half))

    @classmethod
    def of(
        cls, value: Value, method: str, upper_limit_95: float | None = None, interval_95: Interval | None = None
    ) -> Estimate:
        """From a propagated value, or from what was missing for it."""
        if isinstance(value, Missing):
            return cls(reason=value.reason, method=method)
        interval_95 = interval_95 or value.interval_95
        return cls(value.value, value.standard_uncertainty, None, upper_limit_95, method, interval_95, value.parts)

    @property
    def uncertain(self) -> Value:
        """The value with its sources, to compute with."""
        return Missing(self.reason or "") if self.value is None else Uncertain(self.value, dict(self.parts))

    def measured(self, source: str) -> Measured:
        """The estimate as a sensor file keeps it.

        Raises
        ------
        CalibrationError
            If there is no value.
        """
        if self.value is None or self.standard_uncertainty is None:
            raise CalibrationError(f"there is no value: {self.reason}")
        return Measured(self.value, self.standard_uncertainty, source)

    def to_dict(self) -> dict[str, Any]:
        """`value`, `standard_uncertainty` and `interval_95`, and what else there is to say."""
        entry: dict[str, Any] = {"value": self.value, "standard_uncertainty": self.standard_uncertainty}
        for name in ("interval_95", "reason", "upper_limit_95", "method"):
            if getattr(self, name):
                entry[name] = getattr(self, name)
        return entry


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The parameters of a sensor, or of one of its colour channels. Names and terms: EMVA 1288 and the 2008 paper.

    Noise and spread are standard deviations; `_dn`, `_e` and `_mv` are one quantity in digital numbers, electrons
    and millivolts at the pixel.
    """

    read_noise_dn: Estimate
    read_noise_e: Estimate
    read_noise_mv: Estimate
    dsnu_dn: Estimate
    dsnu_e: Estimate
    dsnu_mv: Estimate
    prnu_percent: Estimate
    dark_voltage_mv_per_s: Estimate
    dark_current_e_per_s: Estimate
    dark_current_from_variance_e_per_s: Estimate
    dcnu_percent: Estimate
    black_level_dn: Estimate
    system_gain_dn_per_e: Estimate
    conversion_gain_uv_per_e: Estimate
    saturation_dn: Estimate
    saturation_capacity_e: Estimate
    responsivity_dn_per_photon: Estimate
    quantum_efficiency_percent: Estimate
    temporal_dark_noise_e: Estimate
    sensitivity_threshold_photons: Estimate
    saturation_capacity_photons: Estimate
    snr_max_db: Estimate
    dynamic_range_db: Estimate
    linearity_error_percent: Estimate
    linearity_error_min_percent: Estimate
    linearity_error_max_percent: Estimate
    linearity_error_full_scale_percent: Estimate
    dsnu1288_e: Estimate
    dsnu1288_row_e: Estimate
    dsnu1288_column_e: Estimate
    dsnu1288_pixel_e: Estimate
    dsnu1288_filtered_e: Estimate
    dsnu1288_filtered_row_e: Estimate
    dsnu1288_filtered_column_e: Estimate
    dsnu1288_filtered_pixel_e: Estimate
    prnu1288_percent: Estimate
    prnu1288_row_percent: Estimate
    prnu1288_column_percent: Estimate
    prnu1288_pixel_percent: Estimate
    prnu1288_unfiltered_percent: Estimate
    prnu1288_unfiltered_row_percent: Estimate
    prnu1288_unfiltered_column_percent: Estimate
    prnu1288_unfiltered_pixel_percent: Estimate

    def estimates(self) -> dict[str, Estimate]:
        """All of them by name, in the order above."""
        return {entry.name: getattr(self, entry.name) for entry in fields(Parameters)}


@dataclass(frozen=True)
class Curve:
    """The points behind a fit, and the line through them, ready to draw.

    Parameters
    ----------
    title, x_label, y_label
        For the axes, units included.
    x, y, y_uncertainty
        (points,) measured; the uncertainty is that of sampling alone.
    used
        (points,) whether the fit used the point.
    intercept, slope
        The line, or None where none could be fitted.
    extra_variance
        Variance per point that the scatter about the line asked for beyond sampling; 0 for ideal frames.
    line_covariance
        (2, 2) of intercept and slope; None where there is no line.
    """

    title: str
    x_label: str
    y_label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    y_uncertainty: NDArray[np.float64]
    used: NDArray[np.bool_]
    intercept: float | None = None
    slope: float | None = None
    extra_variance: float = 0.0
    line_covariance: NDArray[np.float64] | None = None

    def line(self, x: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The line and its standard uncertainty at some abscissae, or None where no line could be fitted.

        With a the intercept and b the slope, u^2 = u^2(a) + 2 x u(a, b) + x^2 u^2(b): where the true line lies, not
        where another point would.

        Examples
        --------
        >>> none, used = np.array([]), np.array([], dtype=bool)
        >>> curve = Curve("", "s", "DN", none, none, none, used, 1.0, 2.0, 0.0, np.array([[4.0, -1.0], [-1.0, 1.0]]))
        >>> [numbers.tolist() for numbers in curve.line([0.0, 1.0])]
        [[1.0, 3.0], [2.0, 1.7320508075688772]]
        """
        if self.intercept is None or self.slope is None or self.line_covariance is None:
            return None
        at = np.asarray(x, dtype=np.float64)
        (aa, ab), (_, bb) = self.line_covariance
        return self.intercept + self.slope * at, np.sqrt(aa + 2.0 * ab * at + bb * at**2)


@dataclass(frozen=True)
class LinearRange:
    """Where a channel is taken as linear.

    Parameters
    ----------
    abscissa
        "exposure_s" or "photons_per_pixel": what the light levels are sorted by.
    lowest, highest
        The range on that axis.
    highest_dn
        Mean digital number of the brightest level inside.
    levels
        How many light levels are inside, of `levels_measured`.
    rule
        How it was found.
    """

    abscissa: str
    lowest: float
    highest: float
    highest_dn: float
    levels: int
    levels_measured: int
    rule: str


@dataclass(frozen=True, kw_only=True)
class Calibration(Parameters):
    """The outcome of `calibrate`: each parameter is an attribute, `cal.read_noise_mv.value`.

    Parameters
    ----------
    channels
        The same parameters per colour channel; empty for a monochrome chip.
    curves
        Per channel ("M" for a monochrome chip), the points behind the fits: "dark_signal", "dark_variance",
        "response" and "photon_transfer", where they could be measured.
    linear_range
        Per channel, the range found.
    snr
        Per channel, the signal-to-noise ratio against the amount of light, or why it is missing.
    linearity, spatial
        Per channel, deviations from a straight line; spectrograms, profiles and histograms; or why they are missing.
    model
        "linear" where the photons are known, EMVA 1288 R4.0 Linear; else "general", R4.0 General, against exposure.
    general
        Per channel, the figures of the general model, or why they are missing.
    chip, temporal
        The chip's maps and defects, and its temporal noise by rows, columns and tail; None unless maps were asked for.
    no_chip
        Why they are None where maps were asked for.
    gain_setting, temperature_c
        The operating point, as far as files or protocol say it: the camera's gain setting, and the lowest and highest
        temperature of the sensor.
    warnings
        What the reader should know.
    rejected
        Frames left out, and why.
    frames_used
        The frames behind it.
    source
        What was opened.
    """

    channels: Mapping[str, Parameters]
    curves: Mapping[str, Mapping[str, Curve]]
    linear_range: Mapping[str, LinearRange]
    warnings: tuple[str, ...]
    rejected: tuple[str, ...]
    frames_used: tuple[UsedFrame, ...]
    source: str
    rows: int
    cols: int
    bits: int
    cfa: tuple[tuple[str, ...], ...]
    base: Sensor | None = None
    known: Mapping[str, Uncertain] = field(default_factory=dict)
    snr: Mapping[str, SnrCurve | Missing] = field(default_factory=dict)
    linearity: Mapping[str, Linearity | Missing] = field(default_factory=dict)
    spatial: Mapping[str, SpatialAnalysis | Missing] = field(default_factory=dict)
    model: Literal["linear", "general"] = "general"
    general: Mapping[str, GeneralModel | Missing] = field(default_factory=dict)
    chip: MeasuredChip | None = None
    temporal: TemporalNoise | None = None
    no_chip: str | None = None
    gain_setting: float | None = None
    temperature_c: tuple[float, float] | None = None

    @cached_property
    def covariance(self) -> JointCovariance:
        """Covariance of all parameters that have a value, from the independent sources that they share."""
        values = ((name, entry.uncertain) for name, entry in self.estimates().items())
        return JointCovariance.of({name: value for name, value in values if isinstance(value, Uncertain)})

    @property
    def frame_count(self) -> int:
        """Frames used."""
        return len(self.frames_used)

    @cached_property
    def frame_digests(self) -> tuple[str, ...]:
        """One SHA-256 per frame of `frames_used`, of its digital numbers (little-endian uint16, row by row).

        Taken when first asked for, from the frames, which must be there still.

        Raises
        ------
        FileError
            If a frame is gone or has changed since.
        """
        return frames_sha256(self.frames_used)

    @property
    def frames_sha256(self) -> tuple[str, ...]:
        """`frame_digests`, sorted, as a sensor file keeps them."""
        return tuple(sorted(self.frame_digests))

    @property
    def sensor(self) -> Sensor:
        """The sensor as measured, on what was known of it beforehand.

        Raises
        ------
        CalibrationError
            If nothing was known beforehand: frames do not tell the pixel's size, its spectral response or its volts.
        """
        from photosite.calibration.export.measured_sensor import measured_sensor

        return measured_sensor(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the sensor file, and the chip's maps beside it, if any; raises as `sensor` and `report`."""
        from photosite.calibration.export.measured_sensor import save_measured_sensor

        save_measured_sensor(self, path)

    def report(self, path: str | PathLike[str]) -> None:
        """Write one file that needs no other: every figure, every fit, what was left out and why.

        Parameters
        ----------
        path
            A PDF where it ends in .pdf, an HTML page otherwise.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        from photosite.report.calibration import write_calibration_report

        write_calibration_report(self, path)

    def to_dict(self) -> dict[str, Any]:
        """What `photosite calibrate --json` prints.

        Returns
        -------
        dict
            `parameters` (name to value, standard_uncertainty, and reason, upper_limit_95, method where there is
            one), `channels` (the same per colour channel), `model`, `general` (the general model's figures per
            channel), `linear_range`, `far_pixels` (per channel, candidates for a list of defects), `warnings`,
            `rejected`; with maps `defects` (how many of each kind) and `temporal`.
        """
        said: dict[str, Any] = {
            "parameters": {name: entry.to_dict() for name, entry in self.estimates().items()},
            "channels": {
                channel: {name: entry.to_dict() for name, entry in parameters.estimates().items()}
                for channel, parameters in self.channels.items()
            },
            "model": self.model,
            "general": {channel: found.to_dict() for channel, found in self.general.items()},
            "linear_range": {
                channel: {entry.name: getattr(found, entry.name) for entry in fields(LinearRange)}
                for channel, found in self.linear_range.items()
            },
            "far_pixels": {channel: found.to_dict() for channel, found in self.spatial.items()},
            "warnings": list(self.warnings),
            "rejected": list(self.rejected),
        }
        if self.chip is not None and self.temporal is not None:
            said |= {"defects": self.chip.defects.counts(), "temporal": self.temporal.to_dict()}
        return said
