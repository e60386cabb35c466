"""The sensor's description: the model of the sensor file, and quantities derived from it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema

from photosite.errors import InputError, PhotositeWarning, did_you_mean
from photosite.sensor.captures import Captures
from photosite.sensor.effects.model import Effects
from photosite.sensor.file_units import (
    ASSUMED_SWING,
    CONVERSION,
    DN_PER_E,
    E_PER_DN,
    GAINS,
    IN_ELECTRONS,
    SETTING_VALUES,
    SWING,
    check_volts,
    choices_of,
    in_model_units,
    model_fields_of,
)
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.quantity import (
    NO_UNIT,
    Covariance,
    Fraction,
    Increasing,
    NotNegative,
    Positive,
    ResponseSpread,
    UnitInterval,
    about,
    as_measured,
    check_length,
)
from photosite.sensor.shutter import Shutter
from photosite.values.cfa import MONOCHROME, NAMED, Cfa, binned, cfa_from, channel_names, tile_text
from photosite.values.shown import ResultTable, Tabular
from photosite.values.uncertain import Measured
from photosite.values.validated import NonNegativeNumber, Number, Section, check_choice, input_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Binning = Literal["charge", "sum", "mean"]
"""What is combined of the pixels of a block: their electrons before the reading, or their digital numbers after it."""


def mean_offset_dn(n: int) -> float:
    """Return by how much rounding, halves up, raises the mean of n whole numbers.

    Examples
    --------
    >>> mean_offset_dn(4), mean_offset_dn(9)
    (0.125, 0.0)
    """
    return 0.5 / n if n % 2 == 0 else 0.0


_ZERO_KELVIN_C = 273.15
_MOST_DOUBLINGS = 100.0
_SECTIONS = ("array", "pixel", "noise", "readout", "provenance")
_OWN = (
    *("name", "serial", "channels", "maps", "covariance"),
    *("gain_setting", "gain_settings", "gain_setting_is_iso"),
)
_PRINCIPAL = (
    *("width_um", "height_um", "fill_factor", "conversion_gain_uv_per_e", "well_capacity_e"),
    *("read_noise_mv", "dsnu_mv", "prnu_percent", "analog_gain", "black_level_dn"),
)
"""The values that `repr` shows."""
_IN_MAPS = {
    *("read_noise_mv", "row_noise_mv", "column_noise_mv", "dsnu_mv", "prnu_percent"),
    *("dark_voltage_mv_per_s", "dcnu_percent"),
}
"""The values that measured maps hold for every pixel."""
_CFA_SCHEMA = {
    "anyOf": [
        {"enum": list(NAMED)},
        {"type": "string", "pattern": "/"},
        {"type": "array", "items": {"type": "array", "items": {"type": "string"}}},
    ]
}


class Array(Section):
    """The pixel array: its size and the tile of its color filter array."""

    rows: int = about("Rows of the active array.", "pixels", 2048, gt=0, le=65_536, strict=True)
    cols: int = about("Columns of the active array.", "pixels", 2448, gt=0, le=65_536, strict=True)
    cfa: Annotated[Cfa, BeforeValidator(cfa_from), WithJsonSchema(_CFA_SCHEMA)] = about(
        "Tile of the color filter array from the top left pixel: rows of channel names, RG/GB, or a name such as "
        "rggb or x-trans.",
        NO_UNIT,
        [["R", "G"], ["G", "B"]],
        default=MONOCHROME,
    )
    stacked: bool = about(
        "Whether the channels of cfa, one row, are layers of one pixel. A row of a frame then holds the readings of "
        "all channels of each pixel side by side, and cols counts readings.",
        NO_UNIT,
        False,
        default=False,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = channel_names(self.cfa)
        if self.stacked and (self.cfa != (names,) or len(names) < 2):
            expected = "one row of two or more different channels where they are stacked"
            raise InputError("cfa", value=tile_text(self.cfa), expected=expected)
        if self.stacked and self.cols % len(names):
            raise InputError("cols", value=self.cols, expected=f"a multiple of the {len(names)} stacked channels")
        return self

    @property
    def pixels(self) -> tuple[int, int]:
        """Rows and columns of pixels: fewer columns than readings where channels are stacked."""
        return self.rows, self.cols // len(self.cfa[0]) if self.stacked else self.cols


class Pixel(Section):
    """One pixel: geometry, conversion gain, voltage swing and well capacity."""

    width_um: Positive = about("Pixel pitch along a row.", "um", 3.45)
    height_um: Positive = about("Pixel pitch along a column.", "um", 3.45)
    fill_factor: Fraction = about(
        "Light-sensitive share of the pixel's area; 1 if the quantum efficiency includes it, as that of EMVA 1288.",
        "1",
        0.9,
        default=Measured(1.0),
    )
    conversion_gain_uv_per_e: Positive = about("Voltage at the pixel per electron.", "uV/e-", 30.0)
    voltage_swing_v: Positive = about(
        "Voltage at the pixel that spans all codes of the converter at an analog gain of 1.", "V", 1.08
    )
    well_capacity_e: Positive = about("Full well: electrons that a pixel can hold.", "e-", 10500)


class PixelUnits(Section):
    """Other units of `pixel` in a sensor file."""

    pitch_um: Positive = about("Pitch of square pixels. Instead of width_um and height_um.", "um", 3.45)
    full_well_e: Positive = about("Full well. Instead of well_capacity_e.", "e-", 10500)


class Channel(Section):
    """One channel: its quantum efficiency with the color filter, and its polarizer."""

    wavelength_nm: Increasing = about("Wavelengths of the table, increasing.", "nm", [450.0, 550.0, 650.0])
    quantum_efficiency: tuple[UnitInterval, ...] = about(
        "Electrons per photon on the photodetector at each wavelength, color filter included; 0 outside the table. "
        "Per photon on the pixel's area, as in EMVA 1288, it is this times the fill factor. With a polarizer, "
        "for unpolarized light.",
        "1",
        [0.45, 0.65, 0.5],
    )
    standard_uncertainty: tuple[Annotated[float, Field(ge=0.0)], ...] | None = about(
        "Standard uncertainty of each efficiency.", "1", [0.01, 0.01, 0.01], default=None
    )
    source: str | None = about("Origin of the table.", NO_UNIT, "data sheet, figure 4", default=None)
    assumed: bool = about("Whether the table is an assumption.", NO_UNIT, True, default=False)
    polarization_angle_deg: Number | None = about(
        "Angle of the electric field that the polarizer passes, counterclockwise from the rows. None: no polarizer.",
        "deg",
        45.0,
        default=None,
    )
    extinction_ratio: Annotated[float, Field(ge=1.0)] | None = about(
        "Response to light polarized along this angle over that to light across it. None: an ideal polarizer.",
        "1",
        300.0,
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.extinction_ratio is not None and self.polarization_angle_deg is None:
            raise InputError("extinction_ratio", value=self.extinction_ratio, expected="with polarization_angle_deg")
        count = len(self.wavelength_nm)
        check_length("quantum_efficiency", self.quantum_efficiency, "wavelength", count)
        if self.standard_uncertainty is not None:
            check_length("standard_uncertainty", self.standard_uncertainty, "wavelength", count)
        return self

    def quantum_efficiency_at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the quantum efficiency at other wavelengths: linear between entries, 0 outside the table.

        Examples
        --------
        >>> Channel(wavelength_nm=(500, 510), quantum_efficiency=(0.2, 0.4)).quantum_efficiency_at([490, 505])
        array([0. , 0.3])
        """
        grid = np.asarray(wavelength_nm, dtype=np.float64)
        return np.interp(grid, self.wavelength_nm, self.quantum_efficiency, left=0.0, right=0.0)

    @property
    def polarizer(self) -> tuple[float, float]:
        """Diattenuation times cosine and sine of twice the angle; (0, 0) without a polarizer.

        The response to light of the Stokes parameters S0, S1 and S2 is (S0 + a S1 + b S2) / S0 of that to unpolarized
        light, which is Malus' law (D. H. Goldstein, Polarized Light, 3rd ed., 2011).

        Examples
        --------
        >>> Channel(
        ...     wavelength_nm=(500,), quantum_efficiency=(0.3,), polarization_angle_deg=90, extinction_ratio=9
        ... ).polarizer
        (-0.8, 9.797174393178826e-17)
        """
        if self.polarization_angle_deg is None:
            return 0.0, 0.0
        ratio, twice = self.extinction_ratio, math.radians(2.0 * self.polarization_angle_deg)
        diattenuation = 1.0 if ratio is None else (ratio - 1.0) / (ratio + 1.0)
        return diattenuation * math.cos(twice), diattenuation * math.sin(twice)

    @property
    def responds_nm(self) -> tuple[float, float] | None:
        """First and last wavelength of the range with an efficiency above 0, or None."""
        above = np.flatnonzero(self.quantum_efficiency)
        if above.size == 0:
            return None
        # Linear between entries: the range begins at the last entry of 0.
        first, last = max(above[0] - 1, 0), min(above[-1] + 1, len(self.wavelength_nm) - 1)
        return self.wavelength_nm[first], self.wavelength_nm[last]


class Noise(Section):
    """Temporal read noise, and the fixed pattern's standard deviations over pixels."""

    read_noise_mv: NotNegative = about(
        "Temporal dark noise, standard deviation at the pixel, with the noise of rows and columns.", "mV", 0.52
    )
    row_noise_mv: NotNegative = about(
        "Part of the read noise that the pixels of a row share in a frame, standard deviation at the pixel.",
        "mV",
        0.05,
        default=Measured(0.0),
    )
    column_noise_mv: NotNegative = about(
        "Part of the read noise that the pixels of a column share in a frame, standard deviation at the pixel.",
        "mV",
        0.02,
        default=Measured(0.0),
    )
    dsnu_mv: NotNegative = about(
        "Dark signal nonuniformity: standard deviation of the offset over pixels, at the pixel.", "mV", 0.55
    )
    prnu_percent: ResponseSpread = about(
        "Photo response nonuniformity: standard deviation of the response over pixels.", "%", 0.6
    )
    dark_voltage_mv_per_s: NotNegative = about(
        "Mean dark current as a voltage at the pixel per second.", "mV/s", 0.1, default=Measured(0.0)
    )
    dcnu_percent: NotNegative = about(
        "Dark current nonuniformity: standard deviation over pixels relative to the mean (log-normal).",
        "%",
        20.0,
        default=Measured(0.0),
    )
    dark_current_temperature_c: Number | None = about(
        "Sensor temperature at which the dark current was measured.", "deg C", 25.0, default=None
    )
    dark_doubling_c: Positive | None = about(
        "Rise of the temperature that doubles the dark current.", "deg C", 6.5, default=None
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_line_noise(self)
        return self

    @property
    def pixel_noise_mv(self) -> float:
        """Read noise without the noise of rows and columns, mV at the pixel."""
        lines = self.row_noise_mv.value**2 + self.column_noise_mv.value**2
        return math.sqrt(max(self.read_noise_mv.value**2 - lines, 0.0)) if lines else self.read_noise_mv.value


class NoiseUnits(Section):
    """Other units of `noise` in a sensor file."""

    read_noise_e: NotNegative = about("Temporal dark noise in electrons. Instead of read_noise_mv.", "e-", 2.4)
    read_noise_dn: NotNegative = about("Temporal dark noise in DN. Instead of read_noise_mv.", "DN", 0.94)
    row_noise_e: NotNegative = about("Row noise in electrons. Instead of row_noise_mv.", "e-", 0.2, default=None)
    row_noise_dn: NotNegative = about("Row noise in DN. Instead of row_noise_mv.", "DN", 0.08, default=None)
    column_noise_e: NotNegative = about(
        "Column noise in electrons. Instead of column_noise_mv.", "e-", 0.1, default=None
    )
    column_noise_dn: NotNegative = about("Column noise in DN. Instead of column_noise_mv.", "DN", 0.04, default=None)
    dsnu_e: NotNegative = about("Dark signal nonuniformity in electrons. Instead of dsnu_mv.", "e-", 1.1)
    dsnu_dn: NotNegative = about("Dark signal nonuniformity in DN. Instead of dsnu_mv.", "DN", 0.43)
    dark_current_e_per_s: NotNegative = about(
        "Mean dark current in electrons. Instead of dark_voltage_mv_per_s.", "e-/s", 1.5, default=None
    )
    dark_current_dn_per_s: NotNegative = about(
        "Mean dark current in DN. Instead of dark_voltage_mv_per_s.", "DN/s", 0.6, default=None
    )


class Readout(Section):
    """From volts to digital numbers: DN = analog_gain * V / voltage_swing * 2^bits + black level."""

    bits: int = about("Bit depth of the analog-to-digital converter.", "bit", 12, ge=1, le=16, strict=True)
    analog_gain: Positive = about(
        "Amplification between pixel and converter. Follows from the system gain, where that is stated.",
        "1",
        1.0,
        default=Measured(1.0),
    )
    black_level_dn: NotNegative = about(
        "Mean digital number without light or dark current.", "DN", 64, default=Measured(0.0)
    )


class ReadoutUnits(Section):
    """Other units of the gain in a sensor file."""

    system_gain_dn_per_e: Positive = about(
        "Overall system gain K of EMVA 1288. Instead of conversion_gain_uv_per_e and voltage_swing_v, or with them.",
        "DN/e-",
        0.39,
    )
    system_gain_e_per_dn: Positive = about(
        "Electrons per digital number, 1 / K. Instead of system_gain_dn_per_e.", "e-/DN", 2.56
    )


class Provenance(Section):
    """Origin of the description."""

    source: str | None = about("Origin of the description.", NO_UNIT, "data sheet, revision 3", default=None)
    license: str | None = about("License of the data.", NO_UNIT, "CC0", default=None)
    created: str | None = about("Date, ISO 8601.", NO_UNIT, "2026-01-31", default=None)
    notes: str | None = about("Remarks.", NO_UNIT, "engineering sample", default=None)
    frames_sha256: tuple[str, ...] = about(
        "Digests of the frames that were measured.", NO_UNIT, ["9f86d081884c7d65"], default=()
    )


class Maps(Section):
    """The measured chip's maps beside the sensor file, used in place of a drawn fixed pattern."""

    file: str = about(
        "HDF5 file, relative to the sensor file's folder; an absolute path once loaded.",
        NO_UNIT,
        "mine.maps.h5",
        min_length=1,
    )
    sha256: str = about("Digest of the file, hexadecimal.", NO_UNIT, "0" * 64, pattern="^[0-9a-f]{64}$")


class GainSetting(Section):
    """The values at another gain setting."""

    setting: NonNegativeNumber = about("The gain setting, as the camera states it: ISO, or gain.", "1", 400)
    conversion_gain_uv_per_e: Positive = about("As in pixel, at this setting.", "uV/e-", 30.0)
    analog_gain: Positive = about("As in readout, at this setting.", "1", 4.0)
    well_capacity_e: Positive = about("As in pixel, at this setting.", "e-", 10500)
    read_noise_mv: NotNegative = about("As in noise, at this setting.", "mV", 0.2)
    row_noise_mv: NotNegative = about("As in noise, at this setting.", "mV", 0.05, default=Measured(0.0))
    column_noise_mv: NotNegative = about("As in noise, at this setting.", "mV", 0.02, default=Measured(0.0))
    dsnu_mv: NotNegative = about("As in noise, at this setting.", "mV", 0.3)
    prnu_percent: ResponseSpread = about("As in noise, at this setting.", "%", 0.6)
    dark_voltage_mv_per_s: NotNegative = about("As in noise, at this setting.", "mV/s", 0.1)
    dcnu_percent: NotNegative = about("As in noise, at this setting.", "%", 20.0)
    black_level_dn: NotNegative = about("As in readout, at this setting.", "DN", 64)
    covariance: Covariance | None = about(
        "Correlations of the values at this setting.",
        NO_UNIT,
        {"names": ["read_noise_mv", "dsnu_mv"], "correlation": [[1.0, 0.5], [0.5, 1.0]]},
        default=None,
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        _check_line_noise(self)
        return self


def _check_line_noise(entry: Noise | GainSetting) -> None:
    """Raise an error if the noise of rows and columns exceeds the read noise."""
    read, lines = entry.read_noise_mv.value, math.hypot(entry.row_noise_mv.value, entry.column_noise_mv.value)
    if lines > read * (1.0 + 1e-9):
        hint = "The read noise is that of a pixel and contains both; change them together"
        expected = f"at least {lines:.6g}, the root of the squares of row_noise_mv and column_noise_mv"
        raise InputError("read_noise_mv", value=read, expected=expected, hint=hint)


SECTIONS: dict[str, tuple[type[Section], type[Section]]] = {
    "pixel": (Pixel, PixelUnits),
    "noise": (Noise, NoiseUnits),
    "readout": (Readout, ReadoutUnits),
}
"""Sections with measured values: their fields, and their fields in other units."""

_PARTS: dict[str, type[Section]] = {
    "optical_stack": OpticalStack,
    "shutter": Shutter,
    "effects": Effects,
    "captures": Captures,
}
"""Sections that a sensor may have; each part is a field of `with_`."""


@dataclass(frozen=True)
class Written:
    """The text of the file that a sensor was read from, for its units and comments; not a part of the sensor's value.

    - `text`, `is_preset`: The text, empty for a sensor that was not read; whether the file is a preset.
    - `with_comments`: Whether its comments still apply.
    """

    text: str = field(default="", compare=False, repr=False)
    is_preset: bool = field(default=False, compare=False)
    with_comments: bool = field(default=True, compare=False)

    def renamed(self) -> Written:
        """Return the text for a sensor with another name: a preset's comments do not apply to it."""
        return replace(self, is_preset=False, with_comments=not self.is_preset)


def _warn_of_maps(changes: Mapping[str, Any]) -> None:
    """Warn of changed values in whose place simulated frames take those of the measured maps."""
    changed = {own for name in changes for own in (name, *model_fields_of(name))}
    if replaced := sorted(changed & _IN_MAPS):
        problem = (
            f"measured maps are used in place of {', '.join(replaced)}, so that the change has no effect on frames"
        )
        hint = "Pass {maps} to draw the fixed pattern instead"
        warnings.warn(PhotositeWarning(problem, hint=hint, arguments={"maps": None}), stacklevel=3)


class Sensor(Tabular, Section):
    """An image sensor.

    Values are `Measured`; `sensor.noise.read_noise_mv.value` is the number. A sensor is immutable; `with_` returns a
    changed copy.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200")
    >>> sensor.array.rows, sensor.noise.read_noise_mv.value
    (2592, 0.52)
    """

    photosite_sensor: Literal[1] = about("Version of the file format.", NO_UNIT, 1, default=1)
    name: str = about("Name of the sensor or camera.", NO_UNIT, "Nikon D200")
    serial: str = about(
        "The chip: its fixed pattern is drawn from the serial, where there are no maps.", NO_UNIT, "0", default="0"
    )
    array: Array = about("The pixel array.", NO_UNIT, {"rows": 2048, "cols": 2448, "cfa": "mono"})
    pixel: Pixel = about("One pixel.", NO_UNIT, {"pitch_um": 3.45, "full_well_e": 10500})
    channels: dict[str, Channel] = about(
        "A quantum efficiency for each channel of the color filter array; M for a monochrome sensor.",
        NO_UNIT,
        {"M": {"wavelength_nm": [450, 550], "quantum_efficiency": [0.45, 0.65]}},
    )
    noise: Noise = about(
        "Temporal noise and fixed pattern.", NO_UNIT, {"read_noise_e": 2.4, "dsnu_e": 1.1, "prnu_percent": 0.6}
    )
    readout: Readout = about("From volts to digital numbers.", NO_UNIT, {"bits": 12, "system_gain_dn_per_e": 0.39})
    gain_setting: NonNegativeNumber | None = about(
        "The gain setting of the values above, such as ISO 100.", "1", 100, default=None
    )
    gain_settings: tuple[GainSetting, ...] = about(
        "Other gain settings, ascending: the values that differ from those above, in any of their units.",
        NO_UNIT,
        [{"setting": 400, "system_gain_dn_per_e": 1.56, "read_noise_e": 1.9}],
        default=(),
    )
    gain_setting_is_iso: bool = about(
        "Whether gain settings are ISO speeds, which DNG files then state; false for a factor or dB.",
        NO_UNIT,
        False,
        default=True,
    )
    optical_stack: OpticalStack | None = about(
        "Filters, microlenses and crosstalk in front of the silicon.", NO_UNIT, {"cover_glass": 0.92}, default=None
    )
    shutter: Shutter | None = about(
        "When each row is exposed; by default all rows together.",
        NO_UNIT,
        {"kind": "rolling", "line_time_us": 14.8},
        default=None,
    )
    effects: Effects | None = about(
        "Effects beyond the pixel model, such as a response curve.",
        NO_UNIT,
        {"response_curve": {"polynomial_percent": [0.0, -2.0]}},
        default=None,
    )
    captures: Captures | None = about(
        "Several captures of one exposure and their combination: high dynamic range.",
        NO_UNIT,
        {"parts": [{"name": "long"}, {"name": "short", "relative_exposure": 0.0625}], "combination": {"dn_per_e": 1.0}},
        default=None,
    )
    provenance: Provenance = about(
        "Origin of the values.", NO_UNIT, {"source": "data sheet, revision 3"}, default=Provenance()
    )
    maps: Maps | None = about(
        "Measured maps of this chip.", NO_UNIT, {"file": "mine.maps.h5", "sha256": "0" * 64}, default=None
    )
    covariance: Covariance | None = about(
        "Correlations of the measured values.",
        NO_UNIT,
        {"names": ["read_noise_mv", "dsnu_mv"], "correlation": [[1.0, 0.5], [0.5, 1.0]]},
        default=None,
    )
    _written: Written = PrivateAttr(default=Written())

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(handler(core_schema))
        for section, (_, units) in SECTIONS.items():
            part = handler.resolve_ref_schema({"$ref": schema["properties"][section]["$ref"]})
            part["properties"] |= units.model_json_schema()["properties"]
            choices = choices_of(section)
            optional = {*GAINS, *(name for names in choices for name in names)}
            part["required"] = [name for name in part["required"] if name not in optional]
            if choices:
                part["allOf"] = [{"anyOf": [{"required": [name]} for name in names]} for names in choices]
        setting = handler.resolve_ref_schema(schema["properties"]["gain_settings"]["items"])
        setting["required"] = ["setting"]
        for _, units in SECTIONS.values():
            fields = units.model_json_schema()["properties"].items()
            setting["properties"] |= {
                name: field for name, field in fields if {*model_fields_of(name)} <= {*SETTING_VALUES}
            }
        gains = ("pixel", [CONVERSION, SWING]), ("readout", [DN_PER_E]), ("readout", [E_PER_DN])
        schema["anyOf"] = [{"properties": {section: {"required": names}}} for section, names in gains]
        return schema

    @model_validator(mode="before")
    @classmethod
    def _from_file_units(cls, raw: Any) -> Any:
        return in_model_units(raw, SECTIONS)

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in () if self.covariance is None else self.covariance.names:
            try:
                self.measured(name)
            except InputError as error:
                raise error.within("covariance.names") from None
        named = set(channel_names(self.array.cfa))
        if missing := sorted(named - set(self.channels)):
            raise InputError(f"{', '.join(missing)} of array.cfa is missing", where="channels")
        if extra := sorted(set(self.channels) - named):
            raise InputError(f"{', '.join(extra)} is not in array.cfa", where="channels")
        settings = [entry.setting for entry in self.gain_settings]
        if settings and self.gain_setting is None:
            hint = "State the setting of the values above"
            raise InputError("field 'gain_setting' is missing", where="gain_settings", hint=hint)
        if self.gain_setting in settings:
            expected = f"that of the values above, and not one of gain_settings, {settings}"
            raise InputError("gain_setting", value=self.gain_setting, expected=expected)
        if any(b <= a for a, b in pairwise(settings)):
            raise InputError("gain_settings", value=settings, expected="ascending")
        if (black := self.readout.black_level_dn.value) >= self.white_level_dn:
            expected = f"below the highest number, {self.white_level_dn:g}"
            raise InputError("black_level_dn", where="readout", value=black, expected=expected)
        if self.optical_stack is not None:
            array, ranges = self.array, {name: channel.responds_nm for name, channel in self.channels.items()}
            self.optical_stack.check(ranges, (array.rows, array.cols), (len(array.cfa), len(array.cfa[0])))
            if array.stacked and self.optical_stack.crosstalk is not None:
                raise InputError("crosstalk", where="optical_stack", value="given", expected="none in stacked channels")
        if self.effects is not None:
            array, well_e = self.array, self.pixel.well_capacity_e.value
            tile = len(array.cfa), len(array.cfa[0])
            self.effects.check(array.rows, array.cols, tile, well_e, black, self.white_level_dn)
        if self.captures is not None and self.maps is not None:
            hint = "Measured maps are those of a single capture; pass with_(maps=None)"
            raise InputError("maps", expected="without captures", hint=hint)
        if self.captures is not None and self.effects is not None and (of_charge := self.effects.of_single_captures):
            raise InputError(f"effects.{of_charge[0]}", value="given", expected="none with captures")
        if self.captures is not None:
            head_room_dn = self.white_level_dn - self.readout.black_level_dn.value
            self.captures.check(self.pixel.well_capacity_e.value, head_room_dn / self.system_gain_dn_per_e)
        return self

    def response_at(self, channel: str, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return electrons per photon in front of the optical stack: transmittance of its filters times efficiency.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(cover_glass=0.5)
        >>> bare = sensor.channels["G"].quantum_efficiency_at([550])
        >>> bool(sensor.response_at("G", [550]) == 0.5 * bare)
        True
        """
        behind = self.channels[channel].quantum_efficiency_at(wavelength_nm)
        return behind if self.optical_stack is None else behind * self.optical_stack.transmittance_at(wavelength_nm)

    def response(self, channel: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return `response_at` as a table: (n,) wavelengths in nm of the entries of channel and filters, and values."""
        grid = np.array(self.channels[channel].wavelength_nm)
        if self.optical_stack is not None:
            knots = self.optical_stack.knots_nm()
            grid = np.union1d(grid, knots[(knots > grid[0]) & (knots < grid[-1])])
        return grid, self.response_at(channel, grid)

    def measured(self, name: str) -> Measured:
        """Return a value by the name of its field, from any section; raise `InputError` for an unknown name.

        Examples
        --------
        >>> import photosite as ps
        >>> ps.load_sensor("nikon-d200").measured("read_noise_mv").value
        0.52
        """
        sections = self.pixel, self.noise, self.readout
        found = {key: value for section in sections for key, value in section if isinstance(value, Measured)}
        if name not in found:
            raise InputError(f"a sensor has no value '{name}'", hint=did_you_mean(name, found))
        return found[name]

    def covariance_of(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the (n, n) covariance of values of `pixel`, `noise` and `readout`, in the fields' units.

        Values that are not in the file's `covariance` are independent. Raises `InputError` for an unknown name.

        Examples
        --------
        >>> import photosite as ps
        >>> from photosite.values.uncertain import Measured
        >>> sensor = ps.load_sensor("nikon-d200").with_(read_noise_mv=Measured(0.52, 0.01))
        >>> sensor.covariance_of(["read_noise_mv", "dsnu_mv"]).tolist()
        [[0.0001, 0.0], [0.0, 0.0]]
        """
        scale = [self.measured(name).standard_uncertainty for name in names]
        if self.covariance is None:
            return np.diag(np.square(scale))
        return self.covariance.matrix(names, scale)

    def at_gain_setting(self, setting: float) -> Sensor:
        """Return the sensor at another of its gain settings; measured maps are those of one setting, and are removed.

        Raises
        ------
        InputError
            If the sensor has no such setting.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(
        ...     gain_setting=100, gain_settings=[{"setting": 400, "analog_gain": 4.4, "read_noise_e": 9}]
        ... )
        >>> fast = sensor.at_gain_setting(400)
        >>> round(fast.system_gain_dn_per_e / sensor.system_gain_dn_per_e, 2), fast.all_gain_settings
        (3.99, (100.0, 400.0))
        >>> fast.at_gain_setting(100) == sensor
        True
        """
        if setting == self.gain_setting:
            return self
        entry = next((entry for entry in self.gain_settings if entry.setting == setting), None)
        if entry is None:
            known = ", ".join(f"{known:g}" for known in self.all_gain_settings)
            hint = None if known else "The sensor file states values for one gain setting only"
            raise InputError("gain_setting", value=setting, expected=f"one of {known or 'none'}", hint=hint)
        if self.maps is not None:
            problem = f"the measured maps are those of gain setting {self.gain_setting:g}"
            drawn = "the fixed pattern is drawn from the serial"
            warnings.warn(PhotositeWarning(f"{problem}; at {setting:g} {drawn}"), stacklevel=2)
        values = {name: getattr(entry, name) for name in SETTING_VALUES}
        others = (self.own_gain_setting, *(other for other in self.gain_settings if other is not entry))
        changed = self.with_(
            **values, maps=None, covariance=entry.covariance, gain_setting=entry.setting, gain_settings=()
        )
        return changed.model_copy(update={"gain_settings": tuple(sorted(others, key=lambda each: each.setting))})

    def dark_current_ratio(self, temperature_c: float) -> Measured:
        """Return the dark current at a temperature over that of the description: 2^((T - T0) / doubling temperature).

        Raises
        ------
        InputError
            If the temperature is invalid, or the sensor does not state the two fields that the ratio needs.
        """
        if isinstance(temperature_c, bool | str) or not -_ZERO_KELVIN_C <= temperature_c < math.inf:
            raise InputError("temperature_c", value=temperature_c, expected=f"{-_ZERO_KELVIN_C:g} or above")
        noise = self.noise
        if noise.dark_current_temperature_c is None or noise.dark_doubling_c is None:
            missing = "dark_doubling_c" if noise.dark_doubling_c is None else "dark_current_temperature_c"
            hint = "Frames at a temperature need both dark_current_temperature_c and dark_doubling_c"
            raise InputError(f"field '{missing}' is missing", where="noise", hint=hint)
        doublings = (temperature_c - noise.dark_current_temperature_c) / noise.dark_doubling_c.value
        relative = math.log(2.0) * doublings * noise.dark_doubling_c.standard_uncertainty / noise.dark_doubling_c.value
        if doublings > _MOST_DOUBLINGS:
            expected = f"at most {_MOST_DOUBLINGS:g} doublings above {noise.dark_current_temperature_c:g}"
            raise InputError("temperature_c", value=temperature_c, expected=expected)
        ratio = 2.0**doublings
        return Measured(ratio, ratio * abs(relative), assumed=noise.dark_doubling_c.assumed)

    def at_temperature(self, temperature_c: float) -> Sensor:
        """Return the sensor at another temperature, at which its dark current is larger or smaller.

        The dark current of all gain settings is scaled by `dark_current_ratio`. Read noise, DSNU, gain and measured
        maps are those of the description.

        Raises
        ------
        InputError
            As `dark_current_ratio`.

        References
        ----------
        EMVA 1288 release 3.1, sections 3.2 and 7.2, defines the doubling temperature.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(
        ...     dark_current_e_per_s=2, dark_current_temperature_c=25, dark_doubling_c=6
        ... )
        >>> warm = sensor.at_temperature(37)
        >>> round(warm.electrons(warm.noise.dark_voltage_mv_per_s.value), 3), warm.noise.dark_current_temperature_c
        (8.0, 37.0)
        """
        ratio = self.dark_current_ratio(temperature_c)

        def scaled(entry: Noise | GainSetting) -> dict[str, Any]:
            old = entry.dark_voltage_mv_per_s
            uncertainty = math.hypot(old.standard_uncertainty * ratio.value, old.value * ratio.standard_uncertainty)
            new = replace(old, value=old.value * ratio.value, standard_uncertainty=uncertainty)
            return {"dark_voltage_mv_per_s": new}

        changes = {**scaled(self.noise), "dark_current_temperature_c": float(temperature_c)}
        settings = tuple(entry.model_copy(update=scaled(entry)) for entry in self.gain_settings)
        effects = None if self.effects is None else self.effects.with_dark_current(ratio.value)
        captures = None if self.captures is None else self.captures.with_dark_current(ratio.value)
        noise = self.noise.model_copy(update=changes)
        parts = {"effects": effects, "captures": captures}
        return self.model_copy(update={"noise": noise, "gain_settings": settings, **parts})

    @property
    def own_gain_setting(self) -> GainSetting:
        """The values of the sensor's own gain setting, as another sensor's `gain_settings` has them."""
        return GainSetting(
            setting=0.0 if self.gain_setting is None else self.gain_setting,
            **{name: self.measured(name) for name in SETTING_VALUES},
            covariance=self.covariance,
        )

    @property
    def all_gain_settings(self) -> tuple[float, ...]:
        """The gain settings that the sensor has values for, ascending; empty if none is stated."""
        own = () if self.gain_setting is None else (self.gain_setting,)
        return tuple(sorted((*own, *(entry.setting for entry in self.gain_settings))))

    @property
    def line_time_us(self) -> Measured | None:
        """Time from the start of a row's exposure to that of the next; None for a global shutter."""
        return None if self.shutter is None or self.shutter.kind == "global" else self.shutter.line_time_us

    @property
    def row_start_s(self) -> NDArray[np.float64]:
        """(rows,) seconds from the start of a frame to that of each row's exposure; 0 for a global shutter."""
        rows = self.array.rows
        return np.zeros(rows) if self.shutter is None else self.shutter.row_start_s(rows)

    @property
    def is_preset(self) -> bool:
        """Whether the sensor is a preset, or a changed copy of one with the preset's name."""
        return self._written.is_preset

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The channels, each once, in reading order of the CFA's tile."""
        return channel_names(self.array.cfa)

    @property
    def white_level_dn(self) -> float:
        """The highest digital number, 2^bits - 1."""
        return float((1 << self.readout.bits) - 1)

    @property
    def output_levels_dn(self) -> tuple[float, float]:
        """Black and white level of the frames: those of the converter, after the digital stages behind it."""
        levels = self.readout.black_level_dn.value, self.white_level_dn
        if self.effects is None or self.effects.output is None:
            return levels
        return self.effects.output.levels(*levels)

    @property
    def system_gain_dn_per_e(self) -> float:
        """Overall system gain K (EMVA 1288), DN per electron."""
        return self.pixel.conversion_gain_uv_per_e.value * 1e-3 / self.mv_per_dn

    @property
    def mv_per_dn(self) -> float:
        """Millivolts at the pixel per digital number."""
        readout = self.readout
        return 1e3 * self.pixel.voltage_swing_v.value / (readout.analog_gain.value * float(1 << readout.bits))

    def electrons(self, millivolts: float) -> float:
        """Convert millivolts at the pixel to electrons.

        Examples
        --------
        >>> import photosite as ps
        >>> round(ps.load_sensor("nikon-d200").electrons(0.52), 3)
        17.333
        """
        return millivolts * 1e3 / self.pixel.conversion_gain_uv_per_e.value

    @property
    def saturation_capacity_e(self) -> float:
        """Electrons at which the output saturates: the smaller of well capacity and converter range."""
        head_room_e = (self.white_level_dn - self.readout.black_level_dn.value) / self.system_gain_dn_per_e
        well_e = self.pixel.well_capacity_e.value
        if self.effects is not None and (curve := self.effects.response_curve) is not None:
            return curve.charge_at(head_room_e, well_e)
        return min(well_e, head_room_e)

    @property
    def pixel_area_m2(self) -> float:
        """Area of a pixel in m^2, fill factor not applied."""
        return self.pixel.width_um.value * self.pixel.height_um.value * 1e-12

    def with_(self, **changes: Any) -> Sensor:
        """Return a copy with changed fields, named as in the file, from any section.

        A new serial is another chip and removes measured maps; `maps=None` removes only the maps. Frames have the noise
        of the maps, whatever the values of the description: changing one gives a warning. A changed value is no
        longer correlated with the others, unless `covariance` is changed, too. Values in other units of the file, such
        as `read_noise_e`, are converted; a system gain sets the analog gain. Noise in volts needs volts of the gain, if
        the sensor file has none.

        Raises
        ------
        InputError
            If there is no such field, or a value is invalid.

        Warns
        -----
        PhotositeWarning
            If measured maps are used in place of a changed value.

        Examples
        --------
        >>> import photosite as ps
        >>> quiet = ps.load_sensor("nikon-d200").with_(read_noise_mv=0, serial="12", rows=8, cols=8)
        >>> quiet.noise.read_noise_mv.value, quiet.serial, quiet.array.rows
        (0.0, '12', 8)
        >>> ps.load_sensor("nikon-d200").with_(read_noise_e=10).noise.read_noise_mv.value
        0.3
        """
        data = self.model_dump()
        targets: dict[str, dict[str, Any]] = dict.fromkeys(_OWN, data)
        for section in _SECTIONS:
            targets |= dict.fromkeys(self._names_in(section), data[section])
        for section, kind in _PARTS.items():
            parts = data[section] = data[section] or {}
            targets |= dict.fromkeys(kind.model_fields, parts) | {section: data}
        if "serial" in changes:
            data["maps"] = None
        if self.covariance is not None:
            replaced = {own for name in changes for own in (name, *model_fields_of(name))}
            data["covariance"] = self.covariance.without(replaced)
        if self.maps is not None and not {"maps", "serial"} & changes.keys():
            _warn_of_maps(changes)
        for name, value in changes.items():
            if name == "gain_settings":
                value = [entry.model_dump() if isinstance(entry, GainSetting) else entry for entry in value]
            if name not in targets:
                raise InputError(f"a sensor has no field '{name}'", hint=did_you_mean(name, targets))
            for own in model_fields_of(name):
                del targets[own][own]
            targets[name][name] = value
        for section in _PARTS:
            if isinstance(parts := data[section], dict) and all(part is None for part in parts.values()):
                data[section] = None
        try:
            if self.pixel.voltage_swing_v == ASSUMED_SWING:
                volts = {
                    name: as_measured(changes[name]) for name in (*IN_ELECTRONS, CONVERSION, SWING) if name in changes
                }
                check_volts(volts, {name: ("noise", name) for name in IN_ELECTRONS})
            changed = Sensor.model_validate(data)
        except ValidationError as error:
            raise input_error(error) from None
        changed._written = self._written.renamed() if changed.name != self.name else self._written
        return changed

    def _names_in(self, section: str) -> list[str]:
        kinds = SECTIONS.get(section, (type(getattr(self, section)),))
        return [name for kind in kinds for name in kind.model_fields]

    @property
    def field_names(self) -> tuple[str, ...]:
        """The names that `with_` takes."""
        names = (name for section in _SECTIONS for name in self._names_in(section))
        parts = (name for kind in _PARTS.values() for name in kind.model_fields)
        return (*_OWN, *names, *parts, *_PARTS)

    def with_pixel_width(self, width_um: float) -> Sensor:
        """Return the sensor with a larger or smaller pixel of the same technology.

        Read noise and DSNU keep their electrons. Well capacity and dark current per second scale with the area; the
        voltage swing is kept, so that the conversion gain scales with the inverse of the area, and with it read noise
        and DSNU in millivolts. Fill factor, quantum efficiency, PRNU and the number of pixels are kept: the chip
        shrinks with its pixels. Other gain settings and measured maps do not apply to it.

        Parameters
        ----------
        width_um
            Width of the pixel; its height keeps the proportion.

        Raises
        ------
        InputError
            If the width is not above 0.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("vendor-2.2um")
        >>> small = sensor.with_pixel_width(1.1)
        >>> small.pixel.well_capacity_e.value, round(small.noise.read_noise_mv.value, 6)
        (2500.0, 18.32)
        >>> sensor.electrons(sensor.noise.read_noise_mv.value), small.electrons(small.noise.read_noise_mv.value)
        (45.8, 45.8)
        """
        self._check_single_capture()
        if isinstance(width_um, bool | str) or not (np.isfinite(width_um) and width_um > 0):
            raise InputError("pixel_width_um", value=width_um, expected="above 0")
        before = self.pixel.width_um.value
        area = (width_um / before) ** 2
        factors = {
            "height_um": width_um / before,
            "well_capacity_e": area,
            "conversion_gain_uv_per_e": 1.0 / area,
            **dict.fromkeys(("read_noise_mv", "row_noise_mv", "column_noise_mv"), 1.0 / area),
            "dsnu_mv": 1.0 / area,
        }
        note = f"scaled from a pixel of {before:g} um"
        scaled = {
            name: Measured(factor * old.value, factor * old.standard_uncertainty, note, assumed=True)
            for name, factor in factors.items()
            for old in (self.measured(name),)
        }
        width = Measured(float(width_um), source="chosen", assumed=True)
        return self.with_(width_um=width, maps=None, gain_settings=(), **scaled)

    def layer(self, channel: str) -> Sensor:
        """Return one of the stacked channels as a monochrome sensor.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200").with_(rows=4, cols=18, cfa=[["B", "G", "R"]], stacked=True)
        >>> green = sensor.layer("G")
        >>> green.array.cols, green.channel_names
        (6, ('G',))
        """
        if not self.array.stacked or channel not in self.channels:
            raise InputError("channel", value=channel, expected="one of a sensor with stacked channels")
        data = self.model_dump()
        data |= {"maps": None, "channels": {channel: data["channels"][channel]}}
        data["array"] |= {"cfa": ((channel,),), "cols": self.array.pixels[1], "stacked": False}
        return Sensor.model_validate(data)

    def binned(self, factor: int = 2, kind: Binning = "charge") -> Sensor:
        """Return the sensor as its binned mode reads it: blocks of factor x factor pixels as one pixel.

        The pixels of a block have one color filter: a monochrome sensor, or a tile such as quad-rggb, which becomes
        rggb. Of the n pixels, electrons, dark current and full well add up, and PRNU and dark current nonuniformity,
        which are independent, fall by the square root of n. The rows of a block are read in one line time by charge,
        else each in its own. Other gain settings and measured maps do not apply.

        Parameters
        ----------
        factor
            Rows and columns of a block.
        kind
            "charge": the electrons are added before they are read once, so that read noise, DSNU and black level are
            those of one pixel. "sum" and "mean": digital numbers are added or averaged after each pixel was read, as
            `photosite.frames.binning.bin_frame` does it. Read noise and DSNU in electrons then grow by the square root
            of n, and the rounding of each pixel adds to the read noise; the bit depth of a sum grows.

        Raises
        ------
        InputError
            If the pixels of a block have different filters, the sensor has crosstalk or effects, which are those of
            single pixels, a sum exceeds 16 bits, or the kind is unknown.

        Examples
        --------
        >>> import photosite as ps
        >>> mono = ps.load_sensor("sony-imx174")
        >>> for sensor in (mono, mono.binned(2, "charge"), mono.binned(2, "sum")):
        ...     round(sensor.electrons(sensor.noise.read_noise_mv.value), 2), sensor.readout.bits
        (6.83, 12)
        (6.83, 12)
        (14.26, 14)
        """
        check_choice("kind", kind, Binning)
        self._check_single_capture()
        cfa = binned(self.array.cfa, factor)
        if self.optical_stack is not None and self.optical_stack.crosstalk is not None:
            hint = "Pass with_(crosstalk=None) first"
            raise InputError("a sensor with crosstalk cannot be binned", where="optical_stack", hint=hint)
        if self.effects is not None:
            raise InputError("a sensor with effects cannot be binned", hint="Pass with_(effects=None) first")
        n = factor**2
        extra_bits = math.ceil(math.log2(n)) if kind == "sum" else 0
        if self.readout.bits + extra_bits > 16:
            expected = f"at most {16 - extra_bits} for a sum of {n} pixels"
            raise InputError("bits", where="readout", value=self.readout.bits, expected=expected, hint="Use 'mean'")
        amplifier = {"charge": 1.0, "sum": 2.0**-extra_bits, "mean": 1.0 / n}[kind]
        reads, lines = (1.0, 1.0) if kind == "charge" else (math.sqrt(n), factor**1.5)
        factors = {
            **dict.fromkeys(("width_um", "height_um"), float(factor)),
            **dict.fromkeys(("well_capacity_e", "dark_voltage_mv_per_s"), float(n)),
            **dict.fromkeys(("prnu_percent", "dcnu_percent"), 1.0 / factor),
            **dict.fromkeys(("row_noise_mv", "column_noise_mv"), lines),
            "dsnu_mv": reads,
            "analog_gain": amplifier,
            "black_level_dn": float(n) if kind == "sum" else 1.0,
        }
        note = f"from {factor} x {factor} pixels ({kind})"
        values = {
            name: Measured(by * old.value, by * old.standard_uncertainty, note, assumed=old.assumed)
            for name, by in factors.items()
            for old in (self.measured(name),)
        }
        if kind == "mean":
            black = values["black_level_dn"]
            values["black_level_dn"] = replace(black, value=black.value + mean_offset_dn(n))
        # The readings of n pixels, each rounded. The mean of n is a multiple of 1/n before it is rounded again.
        rounding_dn2 = {"charge": 0.0, "sum": (n - 1) / 12, "mean": 1 / (12 * n) - 1 / (12 * n**2)}[kind]
        mv_per_dn = self.mv_per_dn * (n if kind == "mean" else 1.0)
        old = self.noise.read_noise_mv
        squares = (reads * self.noise.pixel_noise_mv) ** 2 + rounding_dn2 * mv_per_dn**2
        read_mv = math.sqrt(squares + sum(values[name].value ** 2 for name in ("row_noise_mv", "column_noise_mv")))
        slope = reads**2 * old.value / read_mv if read_mv else reads
        values["read_noise_mv"] = Measured(read_mv, slope * old.standard_uncertainty, note, assumed=old.assumed)
        data = self.model_dump()
        data |= {"maps": None, "gain_settings": ()}
        data["array"] |= {"rows": self.array.rows // factor, "cols": self.array.cols // factor, "cfa": cfa}
        data["readout"]["bits"] += extra_bits
        if self.covariance is not None:
            data["covariance"] = self.covariance.without(set(values))
        if self.shutter is not None and self.shutter.line_time_us is not None and kind != "charge":
            line, lines = self.shutter.line_time_us, float(factor)
            data["shutter"]["line_time_us"] = Measured(lines * line.value, lines * line.standard_uncertainty, note)
        for section in SECTIONS:
            data[section] |= {name: value for name, value in values.items() if name in data[section]}
        try:
            changed = Sensor.model_validate(data)
        except ValidationError as error:
            raise input_error(error) from None
        changed._written = self._written.renamed()
        return changed

    def _check_single_capture(self) -> None:
        if self.captures is not None:
            hint = "Pass with_(captures=None) first"
            raise InputError("a sensor with several captures cannot be scaled", where="captures", hint=hint)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the quantum efficiencies on Matplotlib axes, new ones by default, and return them."""
        from photosite.report.plots import plot_sensor

        return plot_sensor(self, ax)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the sensor file as plain numbers, texts, lists and dictionaries."""
        return self.model_dump(mode="json", exclude_none=True)

    def _table(self) -> ResultTable:
        array = self.array
        size = f"{array.rows} x {array.cols} pixels, {tile_text(array.cfa)}, {self.readout.bits} bits"
        title = f"Sensor '{self.name}': {size}"
        sections = {"pixel": self.pixel, "noise": self.noise, "readout": self.readout}
        rows = [
            (section, name, found.value, found.standard_uncertainty, found.assumed, found.source)
            for section, fields in sections.items()
            for name, found in fields
            if isinstance(found, Measured)
        ]
        return ResultTable(title, ("section", "field", "value", "standard_uncertainty", "assumed", "source"), rows)

    def _brief_table(self) -> ResultTable:
        table = self._table()
        shown = [number for number, row in enumerate(table.rows) if row[1] in _PRINCIPAL]
        return table.only(("field", "value", "standard_uncertainty"), shown)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the sensor file (YAML), with its maps if it has any; raise `FileError` if it cannot be written."""
        from photosite.sensor.io.sensor_file import write_sensor

        write_sensor(self, path)
