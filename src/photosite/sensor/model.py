"""The sensor's description: the model of the sensor file, and quantities derived from it."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from photosite.errors import InputError, did_you_mean
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.quantity import (
    Covariance,
    Fraction,
    Increasing,
    NotNegative,
    Positive,
    ResponseSpread,
    UnitInterval,
    check_length,
)
from photosite.values.cfa import MONOCHROME, Cfa, cfa_from, channel_names
from photosite.values.uncertain import Measured
from photosite.values.validated import Section, input_error


class Array(Section):
    """The pixel array: its size and the tile of its color filter array."""

    rows: int = Field(gt=0, le=65_536, strict=True)
    cols: int = Field(gt=0, le=65_536, strict=True)
    cfa: Annotated[Cfa, BeforeValidator(cfa_from)] = MONOCHROME


class Pixel(Section):
    """One pixel: geometry, conversion gain, voltage swing and well capacity."""

    width_um: Positive
    height_um: Positive
    fill_factor: Fraction
    conversion_gain_uv_per_e: Positive
    voltage_swing_v: Positive
    well_capacity_e: Positive


class Channel(Section):
    """One color channel: its quantum efficiency, color filter included."""

    wavelength_nm: Increasing
    quantum_efficiency: tuple[UnitInterval, ...]
    standard_uncertainty: tuple[Annotated[float, Field(ge=0.0)], ...] | None = None
    source: str | None = None
    assumed: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
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

    read_noise_mv: NotNegative
    dsnu_mv: NotNegative
    prnu_percent: ResponseSpread
    dark_voltage_mv_per_s: NotNegative = Measured(0.0)
    dcnu_percent: NotNegative = Measured(0.0)
    """Dark current nonuniformity: standard deviation over pixels relative to the mean (log-normal)."""


class Readout(Section):
    """From volts to digital numbers: DN = analog_gain * V / voltage_swing * 2^bits + black level."""

    bits: int = Field(ge=1, le=16, strict=True)
    analog_gain: Positive = Measured(1.0)
    black_level_dn: NotNegative = Measured(0.0)


class Provenance(Section):
    """Origin of the description."""

    source: str | None = None
    license: str | None = None
    created: str | None = None
    notes: str | None = None
    frames_sha256: tuple[str, ...] = ()


class Maps(Section):
    """The measured chip's maps beside the sensor file, used in place of a drawn fixed pattern."""

    file: str = Field(min_length=1)
    """HDF5 file, relative to the sensor file's folder; an absolute path once loaded."""
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class Sensor(Section):
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

    photosite_sensor: Literal[1] = 1
    name: str
    serial: str = "0"
    array: Array
    pixel: Pixel
    channels: dict[str, Channel]
    noise: Noise
    readout: Readout
    optical_stack: OpticalStack | None = None
    provenance: Provenance = Provenance()
    maps: Maps | None = None
    covariance: Covariance | None = None

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
        if (black := self.readout.black_level_dn.value) >= self.white_level_dn:
            expected = f"below the highest number, {self.white_level_dn:g}"
            raise InputError("black_level_dn", where="readout", value=black, expected=expected)
        if self.optical_stack is not None:
            array, ranges = self.array, {name: channel.responds_nm for name, channel in self.channels.items()}
            self.optical_stack.check(ranges, (array.rows, array.cols), (len(array.cfa), len(array.cfa[0])))
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

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The channels, each once, in reading order of the CFA's tile."""
        return channel_names(self.array.cfa)

    @property
    def white_level_dn(self) -> float:
        """The highest digital number, 2^bits - 1."""
        return float((1 << self.readout.bits) - 1)

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
        head_room_dn = self.white_level_dn - self.readout.black_level_dn.value
        return min(self.pixel.well_capacity_e.value, head_room_dn / self.system_gain_dn_per_e)

    @property
    def pixel_area_m2(self) -> float:
        """Area of a pixel in m^2, fill factor not applied."""
        return self.pixel.width_um.value * self.pixel.height_um.value * 1e-12

    def with_(self, **changes: Any) -> Sensor:
        """Return a copy with changed fields, named as in the file, from any section.

        A new serial is another chip and removes measured maps; `maps=None` removes only the maps. A changed value is no
        longer correlated with the others, unless `covariance` is changed, too.

        Raises
        ------
        InputError
            If there is no such field, or a value is invalid.

        Examples
        --------
        >>> import photosite as ps
        >>> quiet = ps.load_sensor("nikon-d200").with_(read_noise_mv=0, serial="12", rows=8, cols=8)
        >>> quiet.noise.read_noise_mv.value, quiet.serial, quiet.array.rows
        (0.0, '12', 8)
        """
        data = self.model_dump()
        targets: dict[str, dict[str, Any]] = dict.fromkeys(("name", "serial", "channels", "maps", "covariance"), data)
        for section in ("array", "pixel", "noise", "readout", "provenance"):
            targets |= dict.fromkeys(type(getattr(self, section)).model_fields, data[section])
        stack = data["optical_stack"] = data["optical_stack"] or {}
        targets |= dict.fromkeys(OpticalStack.model_fields, stack) | {"optical_stack": data}
        if "serial" in changes:
            data["maps"] = None
        if self.covariance is not None:
            data["covariance"] = self.covariance.without(set(changes))
        for name, value in changes.items():
            if name not in targets:
                raise InputError(f"a sensor has no field '{name}'", hint=did_you_mean(name, targets))
            targets[name][name] = value
        if isinstance(stack := data["optical_stack"], dict) and not any(part is not None for part in stack.values()):
            data["optical_stack"] = None
        try:
            return Sensor.model_validate(data)
        except ValidationError as error:
            raise input_error(error) from None

    def save(self, path: str | PathLike[str]) -> None:
        """Write the sensor file (YAML), with its maps if it has any; raise `FileError` if it cannot be written."""
        from photosite.sensor.io.sensor_file import write_sensor

        write_sensor(self, path)
