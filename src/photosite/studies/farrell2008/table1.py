"""Section 2: the two measurements of the paper with virtual sensors, and Table 1 estimated from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.report.figures.validation import deviations_figure
from photosite.report.numbers import format_interval, format_number, format_time, format_uncertain
from photosite.report.page import Block, Column, Details, Listing, Paragraph, Subheading, Table
from photosite.sensor.chip import draw_chip
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.studies.farrell2008.cameras import D200, ILLUMINANT, VENDOR, Case, MeasuredCamera, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, listing, paragraph, text
from photosite.studies.progress import NoProgress, Progress
from photosite.studies.protocol import ShootingProtocol, paper_d200_protocol, paper_vendor_protocol
from photosite.studies.truth import measured_truth
from photosite.studies.virtual_lab import VirtualLab, virtual_lab
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95

Size = tuple[int, int]

SIZES: dict[str, Size] = {"d200": (648, 968), "vendor": (1536, 2048)}
"""(rows, cols) of the frames: a sixteenth of the D200's pixels, so that its 405 frames take half a minute instead of
eight; all pixels of the vendor sensor, which takes 28 frames."""

PROTOCOLS: dict[str, Callable[[], ShootingProtocol]] = {"d200": paper_d200_protocol, "vendor": paper_vendor_protocol}

_TABLE_1 = (
    *("read_noise_mv", "dsnu_mv", "prnu_percent", "dark_voltage_mv_per_s"),
    *("conversion_gain_uv_per_e", "electrons_per_dn", "saturation_capacity_e"),
)
"""Parameters of Table 1 that frames determine."""

GAIN_LABEL, GAIN_UNIT = "System gain", "e⁻/DN"

_SHARE = 0.1
"""Precision at which the offset of a pixel counts as known, relative to the DSNU."""

_FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class Table1Row:
    """A line of Table 1: value in the paper (None if confidential), true value of the virtual sensor, estimate from its
    frames, and the difference in words."""

    name: str
    label: str
    unit: str
    paper: float | None
    true: float
    estimate: Estimate
    words: str

    @property
    def covered(self) -> bool:
        """Whether there is an estimate whose 95 % interval contains the true value."""
        ends = self.estimate.interval_95
        return ends is not None and ends[0] <= self.true <= ends[1]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers and the difference in words."""
        return {
            "unit": self.unit,
            "paper": self.paper,
            "true": self.true,
            **self.estimate.to_dict(),
            "difference": self.words,
        }

    def cells(self) -> tuple[str, ...]:
        """Return the line on the page."""
        spread, ends = self.estimate.standard_uncertainty or 0.0, self.estimate.interval_95
        return (
            self.label,
            self.unit,
            "confidential" if self.paper is None else _plain(self.paper),
            _plain(self.true),
            "–" if self.estimate.value is None else format_uncertain(self.estimate.value, spread),
            "–" if ends is None else format_interval(*ends, spread),
            self.words,
        )


def _plain(value: float) -> str:
    """Format an exact value without trailing zeros."""
    return format_uncertain(float(f"{value:.5g}"), 0.0)


@dataclass(frozen=True, eq=False)
class CameraTable:
    """Table 1 of one camera; `size` and `whole` are (rows, cols) of the frames and of the sensor."""

    case: Case
    protocol: ShootingProtocol
    size: Size
    whole: Size
    calibration: Calibration
    rows: tuple[Table1Row, ...]

    def row(self, name: str) -> Table1Row:
        """Return a line by name."""
        return next(row for row in self.rows if row.name == name)

    def to_dict(self) -> dict[str, Any]:
        """Return frames, pixels, and the lines by name."""
        return {
            "protocol": self.protocol.name,
            "frames": self.protocol.frame_count,
            "rows_cols": list(self.size),
            "rows_cols_of_the_sensor": list(self.whole),
            "parameters": {row.name: row.to_dict() for row in self.rows},
            "warnings": list(self.calibration.warnings),
        }

    def blocks(self) -> tuple[Block, ...]:
        """Return the table and the frames on the page."""
        rows, cols = self.size
        frames, share = self.protocol.frame_count, rows * cols / (self.whole[0] * self.whole[1])
        pixels = Paragraph(f"{frames} frames of {rows} × {cols} pixels, all pixels of the sensor.")
        if share < 1:
            values = {"frames": frames, "rows": rows, "cols": cols, "percent": 100 * share, "times": share**-0.5}
            pixels = paragraph("table1_some_pixels", **values)
        numeric = ("Paper", "Virtual sensor", "Estimated", "95 % interval")
        columns = (Column("Parameter"), Column("Unit"), *(Column(title, numeric=True) for title in numeric))
        taken = Table(
            "In this order; exposure times between the ends of each range are an assumption",
            (Column("Frames"), Column("Exposure", numeric=True), Column("Count", numeric=True)),
            tuple((step.kind, format_time(step.exposure_s), str(step.count)) for step in self.protocol.steps),
        )
        lines = tuple(row.cells() for row in self.rows)
        return (
            Subheading(self.case.title),
            pixels,
            Table(f"Table 1, {self.case.title}", (*columns, Column("Difference")), lines),
            Details("Frames", (taken,)),
        )

    def summary(self) -> SummaryRow:
        """Return the line of the noise."""
        rows = [self.row(name) for name in ("read_noise_mv", "dsnu_mv", "prnu_percent")]
        return (
            f"Table 1, {self.case.title}: read noise, DSNU, PRNU",
            ", ".join(f"{row.paper:g} {row.unit}" for row in rows if row.paper is not None),
            ", ".join(
                f"{format_uncertain(row.estimate.value, row.estimate.standard_uncertainty or 0.0)} {row.unit}"
                for row in rows
                if row.estimate.value is not None
            ),
            text("table1_summary", inside=sum(row.covered for row in self.rows), count=len(self.rows)),
        )


@dataclass(frozen=True, eq=False)
class Table1:
    """Result of the chapter: tables by key of the case, and what the 8 dark frames of the vendor protocol determine."""

    cameras: Mapping[str, CameraTable]
    eight: EightFrames

    def to_dict(self) -> dict[str, Any]:
        """Return the tables by camera, and `eight_frames`."""
        return {
            "cameras": {key: table.to_dict() for key, table in self.cameras.items()},
            "eight_frames": self.eight.to_dict(),
        }

    def part(self) -> Part:
        """Return the tables of both cameras, the deviations from the truth, and the section on eight dark frames."""
        return (
            paragraph("table1"),
            listing("table1_differences"),
            *(block for table in self.cameras.values() for block in table.blocks()),
            self._deviations(),
            *self.eight.blocks(),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return a line for each camera, and that of the eight dark frames."""
        return *(table.summary() for table in self.cameras.values()), self.eight.summary()

    def _deviations(self) -> Drawing:
        labels, away = [], []
        for table in self.cameras.values():
            for row in table.rows:
                value, uncertainty = row.estimate.value, row.estimate.standard_uncertainty
                if value is not None and uncertainty:
                    labels.append(f"{table.case.title}: {row.label} ({row.unit})")
                    away.append((value - row.true) / uncertainty)
        inside = sum(abs(entry) <= COVERAGE_95 for entry in away)
        return Drawing.of("table1-deviations", deviations_figure(labels, away), inside=inside, count=len(away))


def measure_table1(seed: int, *, sizes: Mapping[str, Size] | None = None, progress: Progress | None = None) -> Table1:
    """Shoot both protocols and calibrate, by default with frames of `SIZES`."""
    progress = progress or NoProgress()
    chosen = {**SIZES, **(sizes or {})}
    labs = {case.key: _lab(case, seed, chosen[case.key]) for case in (D200, VENDOR)}
    cameras = {case.key: _camera_table(case, labs[case.key], progress) for case in (D200, VENDOR)}
    return Table1(cameras, eight_frames(labs[VENDOR.key], cameras[VENDOR.key].calibration))


def _lab(case: Case, seed: int, size: Size) -> VirtualLab:
    sensor = MeasuredCamera(case, seed).sensor(*size)
    key = frame_key(seed, f"calibration of {case.key}")
    return virtual_lab(sensor, PROTOCOLS[case.key](), illuminant=ILLUMINANT, seed=key)


def _camera_table(case: Case, lab: VirtualLab, progress: Progress) -> CameraTable:
    array = lab.camera.sensor.array
    frames, size = lab.protocol.frame_count, (array.rows, array.cols)
    progress.stage(f"{case.title}: shooting {frames} frames of {size[0]} x {size[1]} pixels and calibrating")
    calibration = calibrate_setting(lab.frame_set(), progress=progress)
    preset = load_sensor(case.preset)
    truth = measured_truth(lab, calibration)
    truth["electrons_per_dn"] = 1.0 / truth["system_gain_dn_per_e"]
    rows = tuple(_row(name, preset, lab.camera.sensor, truth[name], calibration) for name in _TABLE_1)
    whole = (preset.array.rows, preset.array.cols)
    return CameraTable(case, lab.protocol, size, whole, calibration, rows)


def _row(name: str, preset: Sensor, real: Sensor, true: float, calibration: Calibration) -> Table1Row:
    if name == "electrons_per_dn":
        label, unit = GAIN_LABEL, GAIN_UNIT
        estimate, gain = _reciprocal(calibration.system_gain_dn_per_e), preset.measured("analog_gain")
        # The analog gain of the preset was computed from Table 1's 7.98 e-/DN.
        paper = None if gain.assumed else round(1.0 / preset.system_gain_dn_per_e, 4)
    else:
        label, unit = PARAMETER_LABELS[name].label, PARAMETER_LABELS[name].unit
        entry = preset.measured("well_capacity_e" if name == "saturation_capacity_e" else name)
        estimate, paper = getattr(calibration, name), None if entry.assumed else entry.value
    words = difference_in_words(estimate, paper, true)
    if name == "saturation_capacity_e":
        words = f"{_what_saturates(real, paper)} {words}"
    return Table1Row(name, label, unit, paper, true, estimate, words)


def _reciprocal(estimate: Estimate) -> Estimate:
    """Return the estimate of 1 / value."""
    if estimate.value is None or estimate.standard_uncertainty is None or estimate.interval_95 is None:
        return estimate
    low, high = estimate.interval_95
    ends = (1.0 / high, 1.0 / low) if low > 0.0 else None
    spread = estimate.standard_uncertainty / estimate.value**2
    return Estimate(1.0 / estimate.value, spread, method=f"1 / ({estimate.method})", interval_95=ends)


def _what_saturates(sensor: Sensor, paper_well_e: float | None) -> str:
    """Return whether well or converter limits the range, and which of them the paper lists."""
    level = sensor.white_level_dn - sensor.readout.black_level_dn.value
    if sensor.saturation_capacity_e == sensor.pixel.well_capacity_e.value:
        return "The well limits the range."
    ends = f"The converter limits the range, {level:.0f} DN above black"
    return f"{ends}." if paper_well_e is None else f"{ends}, below the well capacity, which the paper lists."


def difference_in_words(estimate: Estimate, paper: float | None, true: float) -> str:
    """Return the difference of an estimate from the paper's value and from that of the virtual sensor.

    Examples
    --------
    >>> difference_in_words(Estimate(0.523, 0.001), 0.52, 0.52)
    '0.58 % above the paper’s value: 3.0 standard uncertainties, outside the 95 % interval, as expected for 1 in 20.'
    >>> difference_in_words(Estimate(101.0, 1.0), None, 100.0)
    '1 % above the virtual sensor’s value, inside the 95 % interval. The value in the paper is confidential.'
    >>> difference_in_words(Estimate(0.01, 0.02), 0.0, 0.0)
    'No significant difference from 0, the paper’s value.'
    """
    if estimate.value is None or estimate.standard_uncertainty is None or estimate.interval_95 is None:
        return f"Not estimated: {estimate.reason}."
    same = paper is not None and abs(paper - true) <= 1e-3 * abs(true)
    whose = "the paper’s" if same else "the virtual sensor’s"
    low, high = estimate.interval_95
    inside = low <= true <= high
    away = estimate.value - true
    if true == 0.0 and inside:
        return f"No significant difference from 0, {whose} value."
    words = f"{_size(away, true)} {whose} value"
    if inside:
        words += ", inside the 95 % interval."
    else:
        sigmas = f"{abs(away) / estimate.standard_uncertainty:.1f} standard uncertainties"
        words += f": {sigmas}, outside the 95 % interval, as expected for 1 in 20."
    if paper is None:
        return f"{words} The value in the paper is confidential."
    return words if same else f"{words} It is {_size(estimate.value - paper, paper)} the paper’s value."


def _size(away: float, reference: float) -> str:
    size = f"{100 * abs(away / reference):.2g} %" if reference else f"{abs(away):.2g}"
    return f"{size} {'above' if away > 0 else 'below'}"


# What eight dark frames determine, and what they do not, if DSNU and read noise have similar size.


@dataclass(frozen=True)
class EightFrames:
    """Values computed from repeated dark frames, as measured and as expected; in mV at the pixel.

    "Expected" values follow from read noise and DSNU; "naive" ones are of the mean frame, which includes residual read
    noise.
    """

    frames: int
    pixels: int
    exposure_s: float
    read_noise_mv: float
    read_noise_uncertainty_mv: float
    dsnu_mv: float
    dsnu_uncertainty_mv: float
    naive_dsnu_mv: float
    naive_expected_mv: float
    noise_left_share: float  # of residual read noise in the variance of the mean frame
    many_frames_uncertainty_mv: float  # of the DSNU with infinitely many frames, due to the number of pixels
    smallest_dsnu_mv: float  # that these frames detect, 95 %
    chip_spread_mv: float  # standard deviation of the true offsets of this chip
    pixel_offset_error_mv: float  # RMS error of one pixel's offset, against the true chip
    pixel_offset_expected_mv: float
    map_correlation: float  # of the mean frame with the true offsets
    map_correlation_expected: float
    frames_for_a_tenth: int  # that give a pixel's offset to a tenth of the DSNU
    pixel_variance_scatter: float  # over pixels, of the temporal variance relative to its mean
    pixel_variance_scatter_expected: float  # by chance
    noisy_pixel_factor: float  # multiple of the read noise that fewer than one of 1000 equal pixels exceed by chance
    frame_level_low: float  # 95 % interval of a noise common to all pixels of a frame, relative to its estimate
    frame_level_high: float
    pixel_slope_error_mv_per_s: float  # standard error of one pixel's dark voltage from the dark series
    slope_error_at_exposure_mv: float  # the same over the exposure time of the repeated frames

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers by name, and the words."""
        return {**asdict(self), "can": list(self.can), "cannot": list(self.cannot)}

    @property
    def can(self) -> tuple[str, ...]:
        """What these frames determine."""
        excess, left = 100 * (self.naive_dsnu_mv / self.dsnu_mv - 1), 100 * self.noise_left_share
        return listing("eight_frames_can", f=self, excess=excess, left=left).lines

    @property
    def cannot(self) -> tuple[str, ...]:
        """What these frames do not determine."""
        return listing(
            "eight_frames_cannot",
            f=self,
            share=100 * self.pixel_offset_error_mv / self.dsnu_mv,
            scatter=100 * self.pixel_variance_scatter,
            milliseconds=1e3 * self.exposure_s,
        ).lines

    def blocks(self) -> tuple[Block, ...]:
        """Return the section on the page: the words, and a table of measured and expected values."""

        def row(what: str, unit: str, measured: float, expected: float, digits: int) -> tuple[str, ...]:
            return what, unit, format_number(measured, digits), format_number(expected, digits)

        offset = self.pixel_offset_error_mv, self.pixel_offset_expected_mv
        correlation = self.map_correlation, self.map_correlation_expected
        scatter = self.pixel_variance_scatter, self.pixel_variance_scatter_expected
        rows = (
            row("Standard deviation of the mean frame", "mV", self.naive_dsnu_mv, self.naive_expected_mv, 5),
            ("DSNU, estimated; true value of this chip", "mV", self.dsnu_text, format_number(self.chip_spread_mv, 5)),
            row("RMS error of a pixel’s offset", "mV", *offset, 4),
            row("Correlation of the mean frame with the true offsets", "", *correlation, 4),
            row("Standard deviation of the pixel variances over their mean", "", *scatter, 3),
        )
        numeric = (Column("Measured", numeric=True), Column("Expected", numeric=True))
        caption = f"{self.frames} dark frames: measured and expected"
        return (
            Subheading(f"What {self.frames} dark frames determine"),
            paragraph("eight_frames", frames=self.frames, milliseconds=1e3 * self.exposure_s),
            Listing(self.can),
            Paragraph("They do not determine:"),
            Listing(self.cannot),
            Table(caption, (Column("Quantity"), Column("Unit"), *numeric), rows),
        )

    def summary(self) -> SummaryRow:
        """Return the line of the DSNU."""
        words = text("eight_frames_summary", offset_mv=self.pixel_offset_error_mv)
        title = f"DSNU from {self.frames} dark frames"
        return title, "6 mV, with a read noise of 4.58 mV", f"{self.dsnu_text} mV", words

    @property
    def dsnu_text(self) -> str:
        """DSNU with its uncertainty."""
        return format_uncertain(self.dsnu_mv, self.dsnu_uncertainty_mv)


def eight_frames(lab: VirtualLab, calibration: Calibration) -> EightFrames:
    """Evaluate the exposure time with the most dark frames of a measurement.

    Parameters
    ----------
    lab
        Laboratory that made the frames, with the true chip.
    calibration
        Result of their calibration.

    Raises
    ------
    CalibrationError
        If read noise or DSNU was not estimated.
    """
    from scipy.stats import chi2

    frames = lab.frame_set()
    group = max(frames.of_kind("dark"), key=len)
    sensor, count = lab.camera.sensor, len(group)
    dark_mv = np.stack([dn.astype(np.float64) for dn in group]) * sensor.mv_per_dn
    mean, variance = dark_mv.mean(axis=0), dark_mv.var(axis=0, ddof=1)
    pattern = draw_chip(sensor).offset_e.map().astype(np.float64) * sensor.pixel.conversion_gain_uv_per_e.value * 1e-3
    read, dsnu = calibration.read_noise_mv.measured("darks"), calibration.dsnu_mv.measured("darks")
    pixels, freedom = mean.size, count - 1
    # The temporal variance of a frame includes that of rounding.
    once = read.value**2 + QUANTIZATION_DN2 * sensor.mv_per_dn**2
    left = once / count
    error = mean - pattern
    times = np.repeat([g.exposure_s for g in frames.of_kind("dark")], [len(g) for g in frames.of_kind("dark")])
    slope_error = math.sqrt(once / float(((times - times.mean()) ** 2).sum()))
    return EightFrames(
        frames=count,
        pixels=pixels,
        exposure_s=group.exposure_s,
        read_noise_mv=read.value,
        read_noise_uncertainty_mv=read.standard_uncertainty,
        dsnu_mv=dsnu.value,
        dsnu_uncertainty_mv=dsnu.standard_uncertainty,
        naive_dsnu_mv=float(mean.std(ddof=1)),
        naive_expected_mv=math.sqrt(dsnu.value**2 + left),
        noise_left_share=left / (dsnu.value**2 + left),
        many_frames_uncertainty_mv=dsnu.value / math.sqrt(2 * pixels),
        smallest_dsnu_mv=math.sqrt(1.645 * left * math.sqrt(2 / pixels)),
        chip_spread_mv=float(pattern.std(ddof=1)),
        pixel_offset_error_mv=float(error.std(ddof=1)),
        pixel_offset_expected_mv=math.sqrt(left),
        map_correlation=float(np.corrcoef(mean.ravel(), pattern.ravel())[0, 1]),
        map_correlation_expected=dsnu.value / math.sqrt(dsnu.value**2 + left),
        frames_for_a_tenth=math.ceil(once / (_SHARE * dsnu.value) ** 2),
        pixel_variance_scatter=float(variance.std() / variance.mean()),
        pixel_variance_scatter_expected=math.sqrt(2 / freedom),
        noisy_pixel_factor=math.sqrt(float(chi2.isf(_FALSE_ALARM, freedom)) / freedom),
        frame_level_low=math.sqrt(freedom / float(chi2.isf(0.025, freedom))),
        frame_level_high=math.sqrt(freedom / float(chi2.isf(0.975, freedom))),
        pixel_slope_error_mv_per_s=slope_error,
        slope_error_at_exposure_mv=slope_error * group.exposure_s,
    )
