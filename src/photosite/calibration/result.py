"""The result of a calibration: parameters with uncertainties, the points behind them, and the frames left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from photosite.calibration.amplifiers import Amplifier
from photosite.calibration.chip_maps.pixel_gain import PixelGains
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.diagnostics import named
from photosite.calibration.effect import effects
from photosite.calibration.effects.black_level_drift import BlackLevelSeries
from photosite.calibration.effects.blooming import BloomingResult
from photosite.calibration.effects.charge_transfer import TransferLoss
from photosite.calibration.effects.converter_error import ConverterCodes
from photosite.calibration.effects.glow import GlowMap
from photosite.calibration.effects.hot_pixels import DarkDistribution
from photosite.calibration.effects.readout_channels import ChannelDifferences
from photosite.calibration.emva1288 import EMVA1288, emva1288_figures
from photosite.calibration.export.measured_sensor import MeasuredSensor
from photosite.calibration.finding import Finding
from photosite.calibration.light.flicker import Flicker
from photosite.calibration.parameters import Parameters
from photosite.calibration.photon_transfer.channel import Curve, LinearRange
from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.photon_transfer.pixel_coupling import PixelCoupling
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.calibration.spatial.spatial_analysis import SpatialAnalysis
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.diagnostic import Diagnosed, Diagnostic, texts
from photosite.values.estimate import Estimate
from photosite.values.shown import Reported, ResultTable, clipped, drawn
from photosite.values.uncertain import JointCovariance, Missing, Uncertain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Found = TypeVar("_Found", bound=Finding)


@dataclass(frozen=True, kw_only=True)
class Calibration(Diagnosed, Reported, MeasuredSensor):
    """The result of `calibrate`. Each parameter is an attribute: `cal.read_noise_mv.value`.

    Parameters
    ----------
    by_line
        The same parameters by the straight lines of EMVA 1288. They equal the others where the response is straight.
    channels
        The same parameters per color channel; empty for a monochrome chip.
    findings
        What the frames show of each effect (`photosite.calibration.effects`), or why they show nothing.
    clipped_electrons
        Electrons of fully clipped pixels, the full well where the well is the limit.
    curves
        Per channel ("M" for a monochrome chip), the points behind the fits: "dark_signal", "dark_variance",
        "response" and "photon_transfer", where they could be measured.
    linear_range
        Per channel, the linear range.
    snr, linearity, spatial, general
        Per channel, the signal-to-noise ratio against the amount of light; the deviations from a straight line;
        spectrograms, profiles and histograms; the results of the general model; or the reasons why they are missing.
    dsnu1288_exposure_s
        Per channel, the exposure time of the dark frames of DSNU1288, which contains their dark current nonuniformity.
    model
        "linear" where the photons are known, EMVA 1288 R4.0 Linear; else "general", R4.0 General, against exposure.
    chip, temporal, no_maps_reason
        Maps and defects of the chip; temporal noise by rows, columns and tail. None unless maps were requested, and
        where they are missing for the reason given.
    pixel_gains
        With a map of the gain: the spread of the pixels' gains and the precision of one, or why they are missing.
    amplifiers
        The amplifiers of the chip that the files name, each calibrated by itself.
    gain_setting, temperature_c
        The operating point, where metadata or protocol give it: the camera's gain setting, and the lowest and highest
        temperature of the sensor in degrees Celsius, that of the dark frames if they state one.
    base, electrical_scale
        The sensor as known before the measurement, None if unknown; its voltage swing in V and analog gain with
        uncertainties, which all values in volts share.
    raised
        Limitations of the result, frames left out, and why parameters have no value; `diagnostics` has those of the
        findings, too.
    frames_used
        The frames that the result is based on.
    source
        The folder or file that was opened.

    Examples
    --------
    >>> import numpy as np
    >>> import photosite as ps
    >>> rng = np.random.default_rng(1)
    >>> levels = [("dark", 0.01, 64.0), *(("light", t, 64 + 5e4 * t) for t in (0.01, 0.02, 0.03))]
    >>> frames = [(kind, t, np.uint16(rng.normal(mean, 4, (32, 32)))) for kind, t, mean in levels for _ in range(4)]
    >>> calibration = ps.calibrate(ps.FrameSet.from_arrays(frames, bits=12))
    >>> round(calibration.read_noise_dn.value)
    4
    """

    by_line: Parameters
    channels: Mapping[str, Parameters]
    curves: Mapping[str, Mapping[str, Curve]]
    linear_range: Mapping[str, LinearRange]
    raised: tuple[Diagnostic, ...] = field(repr=False)
    cfa: tuple[tuple[str, ...], ...]
    snr: Mapping[str, SnrCurve | Missing] = field(default_factory=dict)
    linearity: Mapping[str, Linearity | Missing] = field(default_factory=dict)
    spatial: Mapping[str, SpatialAnalysis | Missing] = field(default_factory=dict)
    dsnu1288_exposure_s: Mapping[str, float] = field(default_factory=dict)
    model: Literal["linear", "general"] = "general"
    general: Mapping[str, GeneralModel | Missing] = field(default_factory=dict)
    temporal: TemporalNoise | None = None
    no_maps_reason: str | None = None
    pixel_gains: PixelGains | Missing | None = None
    amplifiers: Mapping[str, Amplifier] = field(default_factory=dict)

    @property
    def light_unknown(self) -> bool:
        """Whether nothing tells the light of the levels, so that their signal stands for it."""
        return any(found.abscissa == "signal_dn" for found in self.linear_range.values())

    @cached_property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]
        """Limitations of the result, frames left out, why parameters have no value, and what the findings make wrong.

        Some flat fields are read again when it is first read, as by `converter`.
        """
        found = (entry for entry in self.findings.values() if isinstance(entry, Finding))
        return (*self.raised, *named(each for entry in found for each in entry.diagnostics))

    @property
    def rejected(self) -> tuple[str, ...]:
        """Texts of the diagnostics of frames that were left out."""
        return texts(self.raised, "left out")

    def _found(self, name: str, kind: type[_Found]) -> _Found | None:
        found = self.findings[name]
        return found if isinstance(found, kind) else None

    @property
    def readout_channels(self) -> ReadoutChannels | None:
        """Gains and offsets of readout channels; None where no difference between channels was found."""
        found = self._found("readout_channels", ChannelDifferences)
        return None if found is None else found.channels

    @property
    def pixel_nonuniformity(self) -> Mapping[str, Estimate]:
        """DSNU, PRNU and DCNU without the differences between readout channels, by the names of the parameters.

        Those parameters include the differences. Empty where the channels are alike.
        """
        found = self._found("readout_channels", ChannelDifferences)
        return {} if found is None else found.pixels

    @property
    def coupling(self) -> PixelCoupling | None:
        """Interpixel capacitance; None where it is not known."""
        return self._found("interpixel_capacitance", PixelCoupling)

    @property
    def charge_transfer(self) -> TransferLoss | None:
        """Charge transfer inefficiency; None unless `base` states a charge transfer."""
        return self._found("charge_transfer", TransferLoss)

    @property
    def black_level_drift(self) -> BlackLevelSeries | None:
        """1/f drift of the black level over the dark frames; None with too few frames."""
        return self._found("black_level_drift", BlackLevelSeries)

    @property
    def flicker(self) -> Flicker | None:
        """Flicker of the light; None where rows vary no more than in dark frames."""
        return self._found("flicker", Flicker)

    @property
    def dark_distribution(self) -> DarkDistribution | None:
        """Distribution of the dark current over the pixels; None without maps."""
        return self._found("hot_pixels", DarkDistribution)

    @property
    def blooming(self) -> BloomingResult | None:
        """Blooming of hot pixels; None without maps, and where no pixel overflows."""
        return self._found("blooming", BloomingResult)

    @property
    def glow(self) -> GlowMap | None:
        """Amplifier glow in the map of the dark current; None without such a map.

        Until it is first read, the map stays in memory: 8 bytes per pixel.
        """
        return self._found("glow", GlowMap)

    @property
    def converter(self) -> ConverterCodes | Missing:
        """Nonlinearity of the converter's codes, or why it is missing.

        Some flat fields are read again when it is first read: a `FileError` if one is missing or has changed.
        """
        found = self.findings["converter_error"]
        assert isinstance(found, ConverterCodes | Missing)
        return found

    @cached_property
    def covariance(self) -> JointCovariance:
        """Covariance of all parameters that have a value, from the independent sources that they share."""
        values = ((name, entry.uncertain) for name, entry in self.estimates().items())
        return JointCovariance.of({name: value for name, value in values if isinstance(value, Uncertain)})

    @cached_property
    def emva1288(self) -> dict[str, Estimate]:
        """The figures of EMVA 1288 R4.0 Linear, by its straight lines and under its symbols (`EMVA1288`).

        Those per area need the pixel size of `base`.
        """
        return emva1288_figures(self.by_line, None if self.base is None else self.base.pixel_area_m2 * 1e12)

    def plot(self, kind: str = "photon_transfer", ax: Axes | None = None) -> Axes:
        """Draw one of `curves` for all channels on Matplotlib axes, new ones by default, and return them.

        Raises
        ------
        InputError
            If the calibration has no curve of that kind.
        """
        return drawn(self, ax, kind)

    def _table(self) -> ResultTable:
        chip = f"{self.rows} x {self.cols} pixels, {self.bits} bits"
        limits = f", warnings: {len(warnings)}" if (warnings := texts(self.raised, "note", "warning")) else ""
        title = f"Calibration of {clipped(self.source, 40)}: {self.frame_count} frames of {chip}{limits}"
        return replace(super()._table(), title=title)

    def to_dict(self) -> dict[str, Any]:
        """Return what `photosite calibrate --json` prints; `glow` and `converter` are computed if they were not read.

        Returns
        -------
        dict
            `parameters` (name to `Estimate.to_dict`), `emva1288` (the standard's figures by symbol, with `unit`),
            `channels` (the parameters per color channel), `model`, `general` (results of the general model per
            channel), `linear_range`, `outlier_pixels` (per channel, candidates for the defect list), the findings of
            effects by their keys (`photosite.calibration.effect.effects`), with maps `temporal` and
            `pixel_gains`; `amplifiers`, where the files name several; `diagnostics`, and the texts of some of them as
            `warnings` and `rejected`.
        """

        def of(parameters: Parameters) -> dict[str, Any]:
            return {name: entry.to_dict() for name, entry in parameters.estimates().items()}

        entries: dict[str, Any] = {
            "parameters": of(self),
            "emva1288": {
                symbol: entry.to_dict() | {"unit": EMVA1288[symbol].unit} for symbol, entry in self.emva1288.items()
            },
            "channels": {channel: of(parameters) for channel, parameters in self.channels.items()},
            "model": self.model,
            "general": {channel: found.to_dict() for channel, found in self.general.items()},
            "linear_range": {channel: asdict(found) for channel, found in self.linear_range.items()},
            "outlier_pixels": {channel: found.to_dict() for channel, found in self.spatial.items()},
            "diagnostics": [entry.to_dict() for entry in self.diagnostics],
            "warnings": list(self.warnings),
            "rejected": list(self.rejected),
        }
        for name, effect in effects().items():
            found = self.findings[name]
            if effect.key is None or (isinstance(found, Missing) and effect.missing == "absent"):
                continue
            unknown = isinstance(found, Missing) and effect.missing == "null"
            entries[effect.key or name] = None if unknown else found.to_dict()
        if self.temporal is not None:
            entries["temporal"] = self.temporal.to_dict()
        if isinstance(self.pixel_gains, PixelGains):
            entries["pixel_gains"] = self.pixel_gains.to_dict()
        if self.amplifiers:
            entries["amplifiers"] = {name: each.to_dict() for name, each in self.amplifiers.items()}
        return entries
