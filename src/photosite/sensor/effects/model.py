"""The section `effects` of a sensor file."""

from __future__ import annotations

from photosite.errors import InputError
from photosite.sensor.effects.black_level_drift import BlackLevelDrift
from photosite.sensor.effects.blooming import Blooming
from photosite.sensor.effects.charge_transfer import ChargeTransfer
from photosite.sensor.effects.converter_error import ConverterError
from photosite.sensor.effects.em_gain import EmGain
from photosite.sensor.effects.glow import Glow
from photosite.sensor.effects.hot_pixels import HotPixels
from photosite.sensor.effects.interpixel_capacitance import InterpixelCapacitance
from photosite.sensor.effects.line_pattern import LinePattern
from photosite.sensor.effects.optical_black import OpticalBlack
from photosite.sensor.effects.output import Output
from photosite.sensor.effects.pixel_defects import PixelDefects
from photosite.sensor.effects.read_noise_spread import ReadNoiseSpread
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.sensor.effects.response_curve import ResponseCurve
from photosite.sensor.effects.section import Corner, EffectSection, Limits
from photosite.sensor.effects.telegraph_noise import TelegraphNoise
from photosite.sensor.quantity import NO_UNIT, about
from photosite.values.region import Border
from photosite.values.validated import Section


class Effects(Section):
    """Effects beyond the pixel model; None for those that the sensor does not have.

    Examples
    --------
    >>> Effects(response_curve={"polynomial_percent": [0.0, -2.0]}).readout_channels is None
    True
    """

    response_curve: ResponseCurve | None = about(
        "Deviation of the signal from a straight response.", NO_UNIT, {"polynomial_percent": [0.0, -2.0]}, default=None
    )
    readout_channels: ReadoutChannels | None = about(
        "Gains and offsets of readout channels.",
        NO_UNIT,
        {"relative_gain": [[1.01, 0.99]], "offset_e": [[3, -3]]},
        default=None,
    )
    line_pattern: LinePattern | None = about(
        "Fixed offsets of rows and columns, and gains of columns.",
        NO_UNIT,
        {"row_offset_e": 0.5, "column_offset_e": 2.0, "column_gain_percent": 0.3},
        default=None,
    )
    blooming: Blooming | None = about(
        "Charge above the full well flows along the column.", NO_UNIT, {"drained": 0.5}, default=None
    )
    charge_transfer: ChargeTransfer | None = about(
        "Charge that stays behind at the transfers of a CCD.",
        NO_UNIT,
        {"parallel_inefficiency": 5e-6, "serial_inefficiency": 1e-6},
        default=None,
    )
    em_gain: EmGain | None = about(
        "Multiplication register of an EMCCD.", NO_UNIT, {"gain": 300, "stages": 536}, default=None
    )
    interpixel_capacitance: InterpixelCapacitance | None = about(
        "Signal that couples to neighboring pixels after the charge was collected.",
        NO_UNIT,
        {"coupling_percent": 1.2, "diagonal_percent": 0.1},
        default=None,
    )
    converter_error: ConverterError | None = about(
        "Integral nonlinearity of the converter.", NO_UNIT, {"error_lsb": [0, 1.5, -0.5, 0]}, default=None
    )
    output: Output | None = about(
        "Lossy digital stages behind the converter.", NO_UNIT, {"dropped_bits": 1}, default=None
    )
    hot_pixels: HotPixels | None = about(
        "Tail of the dark current.", NO_UNIT, {"fraction": 0.001, "median_e_per_s": 200}, default=None
    )
    pixel_defects: PixelDefects | None = about(
        "Dead, stuck and hot pixels, columns and clusters.",
        NO_UNIT,
        {"dead_fraction": 1e-4, "stuck_fraction": 1e-4},
        default=None,
    )
    telegraph_noise: TelegraphNoise | None = about(
        "Pixels that blink.", NO_UNIT, {"fraction": 0.01, "amplitude_e": 20, "correlation_frames": 5.0}, default=None
    )
    read_noise_spread: ReadNoiseSpread | None = about(
        "Distribution of the read noise over the pixels.", NO_UNIT, {"log_spread": 0.2}, default=None
    )
    glow: Glow | None = about(
        "Amplifier glow.", NO_UNIT, {"places": ["top_left"], "peak_e_per_s": 5, "decay_pixels": 100}, default=None
    )
    black_level_drift: BlackLevelDrift | None = about(
        "1/f noise of the black level over frames.", NO_UNIT, {"standard_deviation_e": 2}, default=None
    )
    optical_black: OpticalBlack | None = about(
        "Rows and columns without light at the edges: covered ones, and overscan.",
        NO_UNIT,
        {"top": 8, "left": 16},
        default=None,
    )

    @property
    def stated(self) -> dict[str, EffectSection]:
        """The sections of the effects that the sensor has, by name."""
        return {name: section for name, section in self if section is not None}

    def check(
        self, rows: int, cols: int, tile: tuple[int, int], well_capacity_e: float, black_dn: float, white_dn: float
    ) -> None:
        """Raise `InputError` unless the effects are consistent with the sensor's array, well and converter."""
        limits = Limits(rows, cols, tile, well_capacity_e, black_dn, white_dn, self.corner)
        for name, section in self.stated.items():
            try:
                section.check(limits)
            except InputError as error:
                raise error.within(f"effects.{name}") from None
        if self.response_curve is not None and self.em_gain is not None:
            hint = "A curve ends at the well capacity, and the output of the register reaches beyond it"
            raise InputError("response_curve and em_gain are both given", where="effects", hint=hint)

    @property
    def companded(self) -> bool:
        """Whether the digital numbers of frames are companded."""
        return self.output is not None and self.output.companding is not None

    @property
    def corner(self) -> Corner:
        """The corner of the output; top left unless `charge_transfer` states another."""
        return "top_left" if self.charge_transfer is None else self.charge_transfer.output

    @property
    def border(self) -> Border | None:
        """Lines without light at top, bottom, left and right; None without `optical_black`."""
        return None if self.optical_black is None else self.optical_black.border(self.corner)

    @property
    def of_single_captures(self) -> list[str]:
        """The effects that sensors with several captures of one exposure cannot have."""
        return [name for name, section in self.stated.items() if section.of_single_captures]

    @property
    def line_variances(self) -> tuple[float, float]:
        """Variance over pixels of fixed offsets, e-^2, and of relative gains: of rows, columns and readout channels.

        Examples
        --------
        >>> Effects(line_pattern={"row_offset_e": 3, "column_gain_percent": 1}).line_variances
        (9.0, 0.0001)
        """
        offsets, gains = zip((0.0, 0.0), *(section.line_variances for section in self.stated.values()), strict=True)
        return sum(offsets), sum(gains)

    def with_dark_current(self, ratio: float) -> Effects:
        """Return the effects with a dark current that is larger or smaller by a ratio: that of hot pixels.

        Glow is light, and does not follow the temperature as the dark current does.
        """
        return self.model_copy(update={name: section.with_dark_current(ratio) for name, section in self.stated.items()})
