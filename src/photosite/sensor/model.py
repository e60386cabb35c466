"""The sensor's description: the one model behind the sensor file, and the figures that follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from photosite.errors import InputError, did_you_mean
from photosite.sensor.covariance import Covariance
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.quantity import Fraction, NotNegative, Positive, ResponseSpread
from photosite.values.cfa import Cfa, cfa_from, channel_names
from photosite.values.measured import Measured

if TYPE_CHECKING:
    from photosite.sensor.measured_chip import MeasuredChip


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, validate_default=True)


class Array(_Section):
    """The pixel array: its size and its colour filter array's tile."""

    rows: int = Field(gt=0, le=65_536, strict=True)
    cols: int = Field(gt=0, le=65_536, strict=True)
    cfa: Cfa = (("M",),)

    @field_validator("cfa", mode="before")
    @classmethod
    def _tile(cls, raw: Any) -> Cfa:
        return cfa_from(raw)


class Pixel(_Section):
    """One pixel: its geometry and its electrical scale."""

    width_um: Positive
    height_um: Positive
    fill_factor: Fraction
    conversion_gain_uv_per_e: Positive
    voltage_swing_v: Positive
    well_capacity_e: Positive


class Channel(_Section):
    """One colour channel: its quantum efficiency, filters included."""

    wavelength_nm: tuple[float, ...]
    quantum_efficiency: tuple[float, ...]
    standard_uncertainty: tuple[float, ...] | None = None
    source: str | None = None
    assumed: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        n = len(self.wavelength_nm)
        if n < 1 or len(self.quantum_efficiency) != n:
            raise ValueError(
                f"quantum_efficiency needs one number per wavelength: {n} wavelengths, "
                f"{len(self.quantum_efficiency)} efficiencies"
            )
        if any(b <= a for a, b in zip(self.wavelength_nm, self.wavelength_nm[1:], strict=False)):
            raise ValueError("wavelength_nm must increase from entry to entry")
        outside = [q for q in self.quantum_efficiency if not 0.0 <= q <= 1.0]
        if outside:
            raise ValueError(f"quantum_efficiency is electrons per photon, 0 to 1, not {outside[0]:g}")
        if self.standard_uncertainty is not None and (
            len(self.standard_uncertainty) != n or min(self.standard_uncertainty) < 0
        ):
            raise ValueError(f"standard_uncertainty needs {n} numbers, none negative")
        return self

    def quantum_efficiency_at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Quantum efficiency at other wavelengths: linear between entries, 0 outside them.

        Examples
        --------
        >>> Channel(wavelength_nm=(500, 510), quantum_efficiency=(0.2, 0.4)).quantum_efficiency_at([490, 505])
        array([0. , 0.3])
        """
        return np.interp(
            np.asarray(wavelength_nm, dtype=np.float64),
            self.wavelength_nm,
            self.quantum_efficiency,
            left=0.0,
            right=0.0,
        )

    @property
    def responds_nm(self) -> tuple[float, float] | None:
        """Between which wavelengths the efficiency is above 0; None where it is nowhere."""
        above = np.flatnonzero(self.quantum_efficiency)
        if above.size == 0:
            return None
        # Linear between entries: it rises from the last 0 before.
        first, last = max(above[0] - 1, 0), min(above[-1] + 1, len(self.wavelength_nm) - 1)
        return self.wavelength_nm[first], self.wavelength_nm[last]


class Noise(_Section):
    """What the chip adds: temporal read noise, and the fixed pattern's spreads (standard deviations over pixels)."""

    read_noise_mv: NotNegative
    dsnu_mv: NotNegative
    prnu_percent: ResponseSpread
    dark_voltage_mv_per_s: NotNegative = Measured(0.0)
    dcnu_percent: NotNegative = Measured(0.0)
    """Dark current non-uniformity: spread over pixels of the dark current, relative to its mean (log-normal)."""


class Readout(_Section):
    """From volts to digital numbers: DN = analog_gain * V / voltage_swing * 2^bits + black level."""

    bits: int = Field(ge=1, le=16, strict=True)
    analog_gain: Positive = Measured(1.0)
    black_level_dn: NotNegative = Measured(0.0)


class Provenance(_Section):
    """Where the description comes from."""

    source: str | None = None
    license: str | None = None
    created: str | None = None
    notes: str | None = None
    frames_sha256: tuple[str, ...] = ()


class Maps(_Section):
    """The measured chip's maps beside the sensor file: what every pixel does, in place of a drawn fixed pattern."""

    file: str = Field(min_length=1)
    """HDF5, named from the sensor file's folder; once loaded, a full path."""
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class Sensor(_Section):
    """An image sensor, as its file describes it.

    Values are `Measured`; `sensor.noise.read_noise_mv.value` is the number. A sensor does not change:
    `with_` makes another.

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
    def _covariance_is_of_measured_values(self) -> Self:
        for name in () if self.covariance is None else self.covariance.names:
            try:
                self.measured(name)
            except InputError as error:
                raise ValueError(f"covariance.names: {error}") from None
        return self

    @model_validator(mode="after")
    def _channels_match_cfa(self) -> Self:
        wanted = set(channel_names(self.array.cfa))
        if missing := sorted(wanted - set(self.channels)):
            raise ValueError(f"channels lacks {', '.join(missing)}, which array.cfa names")
        if extra := sorted(set(self.channels) - wanted):
            raise ValueError(f"channels has {', '.join(extra)}, which array.cfa does not name")
        if self.readout.black_level_dn.value >= self.white_level_dn:
            raise ValueError(
                f"readout.black_level_dn {self.readout.black_level_dn.value:g} leaves no room below "
                f"the highest number, {self.white_level_dn:g}"
            )
        return self

    @model_validator(mode="after")
    def _stack_fits(self) -> Self:
        if self.optical_stack is not None:
            array, ranges = self.array, {name: channel.responds_nm for name, channel in self.channels.items()}
            self.optical_stack.check(ranges, (array.rows, array.cols), (len(array.cfa), len(array.cfa[0])))
        return self

    def response_at(self, channel: str, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Electrons per photon before the optical stack: what its filters pass, times the efficiency behind them.

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
        """`response_at` as a table: (n,) wavelengths in nm at which channel or filters have an entry, and values."""
        grid = np.array(self.channels[channel].wavelength_nm)
        if self.optical_stack is not None:
            knots = self.optical_stack.knots_nm()
            grid = np.union1d(grid, knots[(knots > grid[0]) & (knots < grid[-1])])
        return grid, self.response_at(channel, grid)

    def measured(self, name: str) -> Measured:
        """A value by the name of its field, whatever section it is in.

        Raises
        ------
        InputError
            If there is no such value.

        Examples
        --------
        >>> import photosite as ps
        >>> ps.load_sensor("nikon-d200").measured("read_noise_mv").value
        0.52
        """
        found = {
            key: value
            for section in (self.pixel, self.noise, self.readout)
            for key, value in section
            if isinstance(value, Measured)
        }
        if name not in found:
            raise InputError(f"a sensor has no value '{name}'; {did_you_mean(name, found)}")
        return found[name]

    def covariance_of(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Covariance of measured values, from their standard uncertainties and the file's correlations.

        Parameters
        ----------
        names
            Fields of `pixel`, `noise` and `readout`. Those that `covariance` does not name are independent of all.

        Returns
        -------
        ndarray
            (names, names), in the fields' units.

        Raises
        ------
        InputError
            If there is no such value.

        Examples
        --------
        >>> import photosite as ps
        >>> from photosite.values.measured import Measured
        >>> sensor = ps.load_sensor("nikon-d200").with_(read_noise_mv=Measured(0.52, 0.01))
        >>> sensor.covariance_of(["read_noise_mv", "dsnu_mv"]).tolist()
        [[0.0001, 0.0], [0.0, 0.0]]
        """
        scale = [self.measured(name).standard_uncertainty for name in names]
        if self.covariance is None:
            return np.diag(np.square(scale))
        return self.covariance.matrix(names, scale)

    # What follows from the file, in the units of calibration.

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
        """Volts at the pixel, in mV, per digital number."""
        readout = self.readout
        return 1e3 * self.pixel.voltage_swing_v.value / (readout.analog_gain.value * float(1 << readout.bits))

    def electrons(self, millivolts: float) -> float:
        """Millivolts at the pixel as electrons.

        Examples
        --------
        >>> import photosite as ps
        >>> round(ps.load_sensor("nikon-d200").electrons(0.52), 3)
        17.333
        """
        return millivolts * 1e3 / self.pixel.conversion_gain_uv_per_e.value

    @property
    def saturation_capacity_e(self) -> float:
        """Electrons at which the output saturates: the well, or the converter's range where that is less."""
        head_room_dn = self.white_level_dn - self.readout.black_level_dn.value
        return min(self.pixel.well_capacity_e.value, head_room_dn / self.system_gain_dn_per_e)

    @property
    def pixel_area_m2(self) -> float:
        """Area of a pixel, photodetector and the rest, in m^2."""
        return self.pixel.width_um.value * self.pixel.height_um.value * 1e-12

    @property
    def measured_chip(self) -> MeasuredChip | None:
        """The chip that the maps beside the sensor file hold; None where the fixed pattern is drawn from the serial.

        The maps are read when this is first asked for, or the first frame simulated.

        Raises
        ------
        FileError
            If the file of maps is missing, or is not the one that the sensor file hashed.
        """
        from photosite.sensor.io.maps_file import load_maps

        return None if self.maps is None else load_maps(self.maps)

    def with_(self, **changes: Any) -> Sensor:
        """The same sensor with some fields changed, named as in the file, whatever section they are in.

        Another serial is another chip: it leaves measured maps behind. `maps=None` does that alone. A value that is
        changed has no correlation with the others any more, unless `covariance` is changed too.

        Raises
        ------
        InputError
            If there is no such field, or a value cannot be.

        Examples
        --------
        >>> import photosite as ps
        >>> quiet = ps.load_sensor("nikon-d200").with_(read_noise_mv=0, serial="12", rows=8, cols=8)
        >>> quiet.noise.read_noise_mv.value, quiet.serial, quiet.array.rows
        (0.0, '12', 8)
        """
        data = self.model_dump()
        homes: dict[str, dict[str, Any]] = dict.fromkeys(("name", "serial", "channels", "maps", "covariance"), data)
        for section in ("array", "pixel", "noise", "readout", "provenance"):
            homes |= dict.fromkeys(type(getattr(self, section)).model_fields, data[section])
        stack = data["optical_stack"] = data["optical_stack"] or {}
        homes |= dict.fromkeys(OpticalStack.model_fields, stack) | {"optical_stack": data}
        if "serial" in changes:
            data["maps"] = None
        if self.covariance is not None:
            data["covariance"] = self.covariance.without(set(changes))
        for name, value in changes.items():
            if name not in homes:
                raise InputError(f"a sensor has no field '{name}'; {did_you_mean(name, homes)}")
            homes[name][name] = value
        if isinstance(stack := data["optical_stack"], dict) and not any(part is not None for part in stack.values()):
            data["optical_stack"] = None
        try:
            return Sensor.model_validate(data)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"])
            why = first["msg"].removeprefix("Value error, ")
            raise InputError(f"{place}: {why}" if place else why) from None

    def save(self, path: str | PathLike[str]) -> None:
        """Write the sensor file (YAML), whole or not at all.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        from photosite.sensor.io.sensor_file import write_sensor

        write_sensor(self, path)
