"""The sections of the sensor file: pixel array, pixel, channels, noise, readout and gain settings."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from photosite.errors import InputError
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
    check_length,
)
from photosite.values.cfa import MONOCHROME, NAMED, Cfa, cfa_from, channel_names, tile_text
from photosite.values.uncertain import Measured
from photosite.values.validated import NonNegativeNumber, Number, Section

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
        "Light-sensitive fraction of the pixel's area; 1 if the quantum efficiency includes it, as that of EMVA 1288.",
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
        over="wavelength_nm",
    )
    standard_uncertainty: tuple[Annotated[float, Field(ge=0.0)], ...] | None = about(
        "Standard uncertainty of each efficiency.", "1", [0.01, 0.01, 0.01], over="wavelength_nm", default=None
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
        "HDF5 file, relative to the sensor file's folder; an absolute path once loaded.", NO_UNIT, "mine.maps.h5"
    )
    sha256: str = about("Digest of the file, hexadecimal.", NO_UNIT, "0" * 64, pattern="^[0-9a-f]{64}$")

    @field_validator("file")
    @classmethod
    def _check_file(cls, file: str) -> str:
        if not file:  # a constraint of Pydantic would reject names that are not UTF-8
            raise InputError("file", value=file, expected="text with at least 1 characters")
        return file


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
