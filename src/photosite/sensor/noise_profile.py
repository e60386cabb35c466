"""Noise profiles: the variance at one gain setting as a straight line in the signal, as other programs exchange it.

Conversion from a sensor's description, and back to the part of one that the line determines. The file formats are in
`photosite.frames.io`: darktable, libcamera and dng_noise_profile.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from photosite.errors import InputError
from photosite.sensor.model import Sensor
from photosite.sensor.noise_terms import QUANTIZATION_DN2, NoiseTerms
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured

NOT_IN_PROFILE = (
    "PRNU, dark current, the well, quantum efficiency and the division of the offset into read noise and DSNU"
)
"""What a noise profile of two numbers does not hold."""


@dataclass(frozen=True)
class NoiseProfile(Shown):
    """Noise of one frame at one gain setting: a signal x in 0..1 (black to white) has variance slope x + offset.

    Parameters
    ----------
    channels
        Names of the color channels, `("M",)` for a monochrome sensor.
    slope, offset
        One for each channel. The slope is photon noise, system gain / (white - black); the offset is the variance in
        the dark: read noise, DSNU and rounding.
    gain_setting
        ISO or gain as the file or the frames state it, or None.
    black_level_dn, white_level_dn
        The levels that 0 and 1 stand for, or None.
    camera, notes
        Name of the camera, "" if unknown; assumptions and losses.

    Raises
    ------
    InputError
        If the lengths differ, a slope is not above 0, or the white level is not above the black level.

    References
    ----------
    DNG specification 1.7, NoiseProfile.

    Examples
    --------
    >>> profile = NoiseProfile(("M",), (Measured(2.5e-4),), (Measured(1e-6),), black_level_dn=95, white_level_dn=4095)
    >>> profile.system_gain_dn_per_e.value, profile.dark_noise_dn.value
    (1.0, 4.0)
    """

    channels: tuple[str, ...]
    slope: tuple[Measured, ...]
    offset: tuple[Measured, ...]
    gain_setting: float | None = None
    black_level_dn: float | None = None
    white_level_dn: float | None = None
    camera: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.channels) == len(self.slope) == len(self.offset) > 0:
            raise InputError("a noise profile needs one slope and one offset for each channel")
        if (lowest := min(entry.value for entry in self.slope)) <= 0:
            raise InputError("slope", value=lowest, expected="above 0")
        black, white = self.black_level_dn, self.white_level_dn
        if (black is None) != (white is None) or (black is not None and white is not None and not 0 <= black < white):
            raise InputError("black_level_dn, white_level_dn", value=(black, white), expected="0 <= black < white")

    @property
    def span_dn(self) -> float:
        """White level minus black level; raises `InputError` if they are unknown."""
        if self.black_level_dn is None or self.white_level_dn is None:
            hint = "Name a sensor that states them"
            raise InputError("the noise profile does not state its black and white level", hint=hint)
        return self.white_level_dn - self.black_level_dn

    @property
    def system_gain_dn_per_e(self) -> Measured:
        """System gain K, if the slope is photon noise alone: slope times (white - black), mean over channels."""
        return _scaled(_mean(self.slope), self.span_dn)

    @property
    def dark_noise_dn(self) -> Measured:
        """Noise of a dark frame over its pixels, rounding included: sqrt(offset) times (white - black).

        Raises `InputError` if the offset is negative.
        """
        variance = _scaled(_mean(self.offset), self.span_dn**2)
        if variance.value < 0:
            raise InputError(
                "offset", where="noise profile", value=variance.value, expected="a variance of 0 DN² or above"
            )
        return _root(variance)

    def at_levels(self, black_level_dn: float, white_level_dn: float) -> NoiseProfile:
        """Return the same noise for other black and white levels, such as those of another converter.

        Unknown levels are set to these. Known ones are converted by the ratio of the converters' ranges, 2^bits: a
        number of 12 bits is 16 times as large in 16 bits.

        Examples
        --------
        >>> of_12_bits = NoiseProfile(("M",), (Measured(1e-3),), (Measured(0.0),), None, 95, 4095)
        >>> round(of_12_bits.at_levels(95 * 16, 65535).system_gain_dn_per_e.value, 9)
        64.0
        """
        if self.black_level_dn is None or self.white_level_dn is None:
            return replace(self, black_level_dn=black_level_dn, white_level_dn=white_level_dn)
        bits = math.ceil(math.log2(white_level_dn + 1)) - math.ceil(math.log2(self.white_level_dn + 1))
        scale = self.span_dn * 2.0**bits / (white_level_dn - black_level_dn)
        return replace(
            self,
            slope=tuple(_scaled(entry, scale) for entry in self.slope),
            offset=tuple(_scaled(entry, scale**2) for entry in self.offset),
            black_level_dn=black_level_dn,
            white_level_dn=white_level_dn,
        )

    def sensor(self, base: Sensor) -> Sensor:
        """Return a sensor with the profile's gain and dark noise, and everything else from `base`.

        Conversion gain follows from the slope and the base's volts. Read noise is the offset without rounding, and DSNU
        is 0: a profile does not separate them, and in one frame they look alike. If the offset is less than rounding,
        read noise is 0, the least that a sensor has, and marked as assumed (`diagnostics`).
        """
        profile = self.at_levels(base.readout.black_level_dn.value, base.white_level_dn)
        source = f"noise profile{f' of {self.camera}' if self.camera else ''}"
        if self.gain_setting is not None:
            source += f" at gain setting {self.gain_setting:g}"
        read_dn, read_source = _root(self._analog_dn2(base)), f"{source}: the offset without rounding"
        if least := bool(self.diagnostics(base)):
            read_source = f"{source}: the offset is less than rounding, and 0 is the least read noise"
        read_mv = replace(_scaled(read_dn, base.mv_per_dn), source=read_source, assumed=least)
        conversion = _scaled(profile.system_gain_dn_per_e, base.mv_per_dn * 1e3)
        kept = base.provenance.source or base.name
        return base.with_(
            conversion_gain_uv_per_e=replace(conversion, source=f"{source}: the slope as photon noise, at these volts"),
            read_noise_mv=read_mv,
            dsnu_mv=Measured(0.0, source=f"{source}: included in the read noise", assumed=True),
            source=f"{source}; the rest as in: {kept}",
        )

    def diagnostics(self, base: Sensor) -> tuple[Diagnostic, ...]:
        """Return what limits `sensor(base)`.

        Examples
        --------
        >>> import photosite as ps
        >>> profile = NoiseProfile(("M",), (Measured(2.5e-4),), (Measured(-1e-6),))
        >>> [found.id for found in profile.diagnostics(ps.load_sensor("nikon-d200"))]
        ['negative-dark-noise']
        """
        variance = self._analog_dn2(base).value
        if variance >= 0:
            return ()
        setting = "" if self.gain_setting is None else f" at gain setting {self.gain_setting:g}"
        text = (
            f"the noise profile{setting} leaves a variance of {variance:.3g} DN² for the dark, without rounding, on "
            f"the scale of {base.readout.bits} bits: the read noise of the sensor is 0, the least that a sensor has"
        )
        return (NEGATIVE_DARK_NOISE(text, size=variance),)

    def _analog_dn2(self, base: Sensor) -> Measured:
        """Return the variance of a dark frame without rounding, at the levels of a sensor."""
        profile = self.at_levels(base.readout.black_level_dn.value, base.white_level_dn)
        offset = _scaled(_mean(profile.offset), profile.span_dn**2)
        return replace(offset, value=offset.value - QUANTIZATION_DN2)


NEGATIVE_DARK_NOISE = DiagnosticKind(
    "negative-dark-noise",
    "note",
    "The noise profile's variance in the dark is negative, or less than that of rounding: it is the end of a line that "
    "was fitted to brighter signals, and nonuniformity or a wrong black level bends the curve.",
    "The read noise of the sensor file is 0, marked as assumed. Dark parts of simulated frames have too little noise.",
    "Enter the read noise of a data sheet, or calibrate dark frames.",
    ("read_noise_e",),
    "variance in the dark without rounding, DN²",
)


def profile_at_setting(profiles: Sequence[NoiseProfile], setting: float | None) -> NoiseProfile:
    """Return the profile of a gain setting, or the only one for None; raise `InputError` if no profile has it."""
    if setting is None and len(profiles) == 1:
        return profiles[0]
    for profile in profiles:
        if setting is not None and profile.gain_setting == setting:
            return profile
    settings = ", ".join("not stated" if p.gain_setting is None else f"{p.gain_setting:g}" for p in profiles)
    raise InputError("gain_setting", value=setting, expected=f"one of the noise profiles': {settings}")


def _mean(entries: Sequence[Measured]) -> Measured:
    """Return the mean over channels; their errors are fully correlated, since gain and converter are shared."""
    return Measured(fmean(e.value for e in entries), fmean(e.standard_uncertainty for e in entries))


def _scaled(entry: Measured, factor: float) -> Measured:
    return Measured(entry.value * factor, entry.standard_uncertainty * factor)


def _root(variance: Measured) -> Measured:
    """Return the root of a variance, 0 for a negative one, with the larger distance to the roots of v +- u.

    The uncertainty of first order, u / (2 sqrt(v)), diverges at 0.
    """
    value, below, above = (
        math.sqrt(max(variance.value + side * variance.standard_uncertainty, 0.0)) for side in (0, -1, 1)
    )
    return Measured(value, max(above - value, value - below))


def sensor_noise_profile(sensor: Sensor, exposure_s: float = 0.0, gain_setting: float | None = None) -> NoiseProfile:
    """Return the noise profile of a sensor's description, with propagated uncertainties.

    The offset is read noise, DSNU, the dark current's shot noise in `exposure_s`, and rounding, with effects as in
    `photosite.sensor.noise_terms`: a response curve counts as its slope at small signal. `gain_setting` is the one that
    the description is valid for.

    Raises
    ------
    InputError
        If the numbers are companded, so that the variance is no straight line.

    Examples
    --------
    >>> import photosite as ps
    >>> profile = sensor_noise_profile(ps.load_sensor("nikon-d200"))
    >>> round(1 / profile.slope[0].value / 4095, 2), round(profile.dark_noise_dn.value, 2)
    (7.98, 3.17)
    """
    noise, pixel, readout, terms = sensor.noise, sensor.pixel, sensor.readout, NoiseTerms(sensor)
    if sensor.effects is not None and sensor.effects.companded:
        raise InputError("a noise profile holds for numbers that are not companded", where=f"sensor '{sensor.name}'")
    span = sensor.white_level_dn - readout.black_level_dn.value
    gain, volts = sensor.system_gain_dn_per_e, sensor.mv_per_dn
    # Relative uncertainties.
    of_volts = math.hypot(*(q.standard_uncertainty / q.value for q in (pixel.voltage_swing_v, readout.analog_gain)))
    of_conversion = pixel.conversion_gain_uv_per_e.standard_uncertainty / pixel.conversion_gain_uv_per_e.value
    of_span = readout.black_level_dn.standard_uncertainty / span
    slope = gain * terms.multiplication * terms.shot / span

    fixed = [(q.value / volts, q.standard_uncertainty / volts) for q in (noise.read_noise_mv, noise.dsnu_mv)]
    dark, to_dn = noise.dark_voltage_mv_per_s, gain * terms.multiplication
    shot_per_mv = terms.shot * terms.multiplication * to_dn * exposure_s / volts
    shot = shot_per_mv * dark.value
    analog = to_dn**2 * float(terms.floor_e2())
    rounding = to_dn**2 * float(terms.rounding_e2(0.0))
    uncertainty = math.hypot(
        *(2 * value * u for value, u in fixed),
        shot_per_mv * dark.standard_uncertainty,
        (2 * analog + 2 * shot) * of_volts,
        shot * of_conversion,
        2 * (analog + shot + rounding) * of_span,
    )
    count = len(sensor.channel_names)
    return NoiseProfile(
        sensor.channel_names,
        (Measured(slope, slope * math.hypot(of_volts, of_conversion, of_span)),) * count,
        (Measured((analog + shot + rounding) / span**2, uncertainty / span**2),) * count,
        gain_setting,
        *sensor.output_levels_dn,
        sensor.name,
    )
