"""The sensor's description: the model of the sensor file, and quantities derived from it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from numbers import Real
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import GetJsonSchemaHandler, PrivateAttr, ValidationError, model_validator
from pydantic_core import CoreSchema

from photosite.errors import InputError, PhotositeWarning, did_you_mean
from photosite.sensor.binning import Binning, binned_values, extra_bits
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
from photosite.sensor.quantity import NO_UNIT, Covariance, about, as_measured
from photosite.sensor.sections import SECTIONS, Array, Channel, GainSetting, Maps, Noise, Pixel, Provenance, Readout
from photosite.sensor.shutter import Shutter
from photosite.values.cfa import binned, channel_names, tile_text
from photosite.values.choice import check_choice
from photosite.values.limits import check_magnitude
from photosite.values.saved import write
from photosite.values.shown import ResultTable, Tabular, drawn
from photosite.values.uncertain import Measured
from photosite.values.validated import NonNegativeNumber, Section, input_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        keys="channels",
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
        if self.captures is not None and self.effects is not None and (of_charge := self.effects.of_single_captures):
            raise InputError(f"effects.{of_charge[0]} and captures are both given", hint="Leave one of them out")
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
            expected = f"one of {known}" if known else "omitted"
            raise InputError("gain_setting", value=setting, expected=expected, hint=hint)
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
    def output_bits(self) -> int:
        """Bit depth of the frames: that of the converter, or of the combined captures."""
        return self.readout.bits if self.captures is None else self.captures.combination.output_bits

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
        """Collected electrons at which the output saturates: the smaller of well capacity and converter range.

        Examples
        --------
        >>> import photosite as ps
        >>> sensor = ps.load_sensor("nikon-d200")
        >>> round(sensor.saturation_capacity_e), round(sensor.with_(em_gain={"gain": 100}).saturation_capacity_e)
        (32678, 327)
        """
        head_room_e = (self.white_level_dn - self.readout.black_level_dn.value) / self.system_gain_dn_per_e
        well_e = self.pixel.well_capacity_e.value
        if self.effects is not None and (curve := self.effects.response_curve) is not None:
            return curve.charge_at(head_room_e, well_e)
        if self.effects is not None and (em := self.effects.em_gain) is not None:
            head_room_e = (
                min(head_room_e, math.inf if em.register_well_e is None else em.register_well_e) / em.gain.value
            )
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
        if isinstance(width_um, bool) or not (isinstance(width_um, Real) and 0 < width_um < math.inf):
            raise InputError("pixel_width_um", value=width_um, expected="above 0")
        check_magnitude("pixel_width_um", float(width_um), "um")
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
        self._check_single_capture()
        check_choice("kind", kind, Binning)
        if factor > min(self.array.rows, self.array.cols):
            expected = f"at most the chip's {self.array.rows} rows and {self.array.cols} columns"
            raise InputError("factor", value=factor, expected=expected)
        cfa, bits = binned(self.array.cfa, factor), extra_bits(factor**2, kind)
        if self.optical_stack is not None and self.optical_stack.crosstalk is not None:
            hint = "Pass with_(crosstalk=None) first"
            raise InputError("a sensor with crosstalk cannot be binned", where="optical_stack", hint=hint)
        if self.effects is not None:
            raise InputError("a sensor with effects cannot be binned", hint="Pass with_(effects=None) first")
        if self.readout.bits + bits > 16:
            expected = f"at most {16 - bits} for a sum of {factor**2} pixels"
            raise InputError("bits", where="readout", value=self.readout.bits, expected=expected, hint="Use 'mean'")
        values = binned_values(self.measured, (self.noise.pixel_noise_mv, self.mv_per_dn), factor, kind)
        data = self.model_dump() | {"maps": None, "gain_settings": ()}
        data["array"] |= {"rows": self.array.rows // factor, "cols": self.array.cols // factor, "cfa": cfa}
        data["readout"]["bits"] += bits
        if self.covariance is not None:
            data["covariance"] = self.covariance.without(set(values))
        if self.shutter is not None and self.shutter.line_time_us is not None and kind != "charge":
            line, note = self.shutter.line_time_us, values["analog_gain"].source
            data["shutter"]["line_time_us"] = Measured(factor * line.value, factor * line.standard_uncertainty, note)
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
        return drawn(self, ax)

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
        write(self, path)
