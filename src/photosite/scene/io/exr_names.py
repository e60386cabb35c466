"""What the channels of an OpenEXR file are, by their names.

The layout is A. Fichet, R. Pacanowski and A. Wilkie, "An OpenEXR Layout for Spectral Images", Journal of Computer
Graphics Techniques 10(3), 2021: `S0.550,000000nm`, a comma for the decimal point, which OpenEXR keeps for layers.
PBRT's spectral film writes it too. Mitsuba 0.x names a band by its ends, `400.00-410.00nm`; a channel that is only
called `550nm` is understood as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from photosite.color.spectrum import LIGHT_SPEED_M_S

Kind = Literal["emissive", "polarised", "reflective", "reradiated", "plain"]
"""S0; S1 to S3, and all of a Mueller matrix but its first; T or M00; a reflectance from one wavelength to another; a
name that is nothing but a wavelength."""

_PREFIX = {
    "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1, "": 1.0,
    "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
_NUMBER = r"\d+(?:,\d*)?(?:[Ee][+-]?\d+)?"
_LAYOUT = re.compile(rf"(S[0-3]|T|M[0-3][0-3])\.({_NUMBER})(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)(\..+)?")
_BAND = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)nm")
_PLAIN = re.compile(r"(\d+(?:[.,]\d+)?)nm")


@dataclass(frozen=True)
class SpectralChannel:
    """A channel of one wavelength.

    Parameters
    ----------
    name
        As the file has it.
    kind
        What it holds.
    wavelength_nm
        Of its centre.
    """

    name: str
    kind: Kind
    wavelength_nm: float


def spectral_channel(name: str) -> SpectralChannel | None:
    """What a channel's name says, or None where it is not that of a spectral channel.

    Examples
    --------
    >>> spectral_channel("S0.500,250000nm")
    SpectralChannel(name='S0.500,250000nm', kind='emissive', wavelength_nm=500.25)
    >>> spectral_channel("T.0,6um").wavelength_nm, spectral_channel("400.00-410.00nm").wavelength_nm
    (600.0, 405.0)
    >>> spectral_channel("R") is None
    True
    """
    if match := _LAYOUT.fullmatch(name):
        layer, number, prefix, unit, rest = match.groups()
        value = float(number.replace(",", ".")) * _PREFIX[prefix or ""]
        if not value > 0:
            return None
        wavelength_nm = value * 1e9 if unit == "m" else LIGHT_SPEED_M_S / value * 1e9
        return SpectralChannel(name, _kind(layer, rest is not None), float(f"{wavelength_nm:.9g}"))
    if match := _BAND.fullmatch(name):
        return SpectralChannel(name, "plain", (float(match[1]) + float(match[2])) / 2)
    if match := _PLAIN.fullmatch(name):
        return SpectralChannel(name, "plain", float(match[1].replace(",", ".")))
    return None


def _kind(layer: str, reradiated: bool) -> Kind:
    if reradiated:
        return "reradiated"
    if layer == "S0":
        return "emissive"
    return "reflective" if layer in ("T", "M00") else "polarised"


def channel_name(wavelength_nm: float) -> str:
    """The layout's name of the unpolarised radiance at a wavelength.

    Examples
    --------
    >>> channel_name(500.25)
    'S0.500,250000nm'
    """
    return f"S0.{wavelength_nm:.6f}nm".replace(".", ",").replace(",", ".", 1)


def spectral_channels(names: Iterable[str]) -> dict[Kind, tuple[SpectralChannel, ...]]:
    """The spectral channels among a file's, by kind, each kind in order of wavelength.

    Examples
    --------
    >>> found = spectral_channels(["B", "G", "R", "S0.1000,0nm", "S0.400,0nm"])
    >>> [channel.wavelength_nm for channel in found["emissive"]]
    [400.0, 1000.0]
    """
    found: dict[Kind, list[SpectralChannel]] = {}
    for name in names:
        if (channel := spectral_channel(name)) is not None:
            found.setdefault(channel.kind, []).append(channel)
    return {kind: tuple(sorted(group, key=lambda c: c.wavelength_nm)) for kind, group in found.items()}
