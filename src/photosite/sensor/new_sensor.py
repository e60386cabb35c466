"""A sensor file from the figures of a data sheet; what the sheet does not state is assumed, and marked as such."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from photosite.errors import InputError
from photosite.sensor.assumed_channels import KNOWN, assumed_channels
from photosite.sensor.file_units import AMPLIFIER, CONVERSION, DN_PER_E, E_PER_DN, SWING, UNITS, check_quantities
from photosite.sensor.io.sensor_file import parse_sensor
from photosite.sensor.sections import SECTIONS
from photosite.values.cfa import Cfa, cfa_from, channel_names, tile_text

_HEADING = """\
# {name}
#
# Made by `photosite sensors new`. Values with "assumed: true" were not given: replace them by those of the data sheet.
# Any value may be a number or {{value, standard_uncertainty, source, assumed}}.
photosite_sensor: 1
name: {quoted}
array: {{rows: {rows}, cols: {cols}, cfa: {cfa}}}
"""


_SMALLEST_QE = 1e-6
"""Below any photodetector; smaller ones give tables of nothing but rounding."""


def new_sensor_file(
    name: str,
    *,
    rows: int,
    cols: int,
    bits: int,
    cfa: str = "mono",
    qe_peak: float,
    values: Mapping[str, float],
    source: str | None = None,
) -> str:
    """Return the text of a commented sensor file.

    Parameters
    ----------
    name, rows, cols, bits, cfa
        As in the file.
    qe_peak
        Largest quantum efficiency of all channels. The spectral shape is assumed, see
        `photosite.sensor.assumed_channels`.
    values
        Fields of `pixel`, `noise` and `readout` in any of the file's units.
    source
        Origin of the values, for `provenance`.

    Raises
    ------
    FileError
        If values are missing, invalid, or contradict each other; with the line of the text.
    InputError
        If the color filter array is unknown, no shape is known for one of its channels, or a number is outside the
        limits of its unit.

    Examples
    --------
    >>> given = {"pitch_um": 3.45, "full_well_e": 10500, "read_noise_e": 2.4}
    >>> text = new_sensor_file("A1", rows=2048, cols=2448, bits=12, qe_peak=0.65, values=given)
    >>> print("\\n".join(line for line in text.splitlines() if "dsnu_e:" in line))
      dsnu_e: {value: 1.2, source: "assumed: half of the read noise", assumed: true}
    """
    tile = cfa_from(cfa)
    check_quantities(values, (kind for kinds in SECTIONS.values() for kind in kinds))
    if not _SMALLEST_QE <= qe_peak <= 1.0:
        raise InputError("qe_peak", value=qe_peak, expected=f"from {_SMALLEST_QE:g} to 1")
    stated = {**values, "bits": bits}
    assumed = _assumptions(stated)
    places = {field: section for section, kinds in SECTIONS.items() for kind in kinds for field in kind.model_fields}
    text = _HEADING.format(
        name=" ".join(name.split()), quoted=json.dumps(name), rows=rows, cols=cols, cfa=json.dumps(tile)
    )
    for section in SECTIONS:
        if section == "noise":
            text += _channels(tile, qe_peak)
        text += f"{section}:\n"
        fields = [field for field in places if places[field] == section]
        for field in (*filter(stated.__contains__, fields), *filter(assumed.__contains__, fields)):
            meaning, unit = described(field)
            text += f"  # {meaning.removesuffix('.')} [{unit}]\n  {field}: "
            if field in stated:
                text += f"{stated[field]:.12g}\n"
            else:
                value, reason = assumed[field]
                text += f'{{value: {value:.4g}, source: "assumed: {reason}", assumed: true}}\n'
    text += f"provenance:\n  source: {json.dumps(source or 'photosite sensors new')}\n"
    parse_sensor(text, f"the new file of {name}")
    return text


def described(name: str) -> tuple[str, str]:
    """Return what a field of `pixel`, `noise` or `readout` means, and its unit, from the model.

    Examples
    --------
    >>> described("full_well_e")
    ('Full well.', 'e-')
    """
    info = next(kind.model_fields[name] for pair in SECTIONS.values() for kind in pair if name in kind.model_fields)
    unit = info.json_schema_extra["unit"] if isinstance(info.json_schema_extra, dict) else ""
    return (info.description or "").partition(" Instead of ")[0], str(unit)


def _assumptions(stated: Mapping[str, float]) -> dict[str, tuple[float, str]]:
    """Return a value and the reason for it, for each quantity that is not stated in any unit."""
    found: dict[str, tuple[float, str]] = {"fill_factor": (1.0, "the quantum efficiency includes it")}
    codes = (1 << int(stated["bits"])) - 1
    full_well = stated.get("full_well_e", stated.get("well_capacity_e"))
    read_noise = next((name for name in ("read_noise_e", "read_noise_dn", "read_noise_mv") if name in stated), None)
    gain = _system_gain(stated)
    black = stated.get("black_level_dn")
    if black is None:
        highest = codes / full_well if gain is None and full_well else gain
        noise_dn = 0.0 if read_noise is None else stated[read_noise] * _dn_per_unit(read_noise, stated, highest)
        black = math.ceil(8.0 * noise_dn)
        found["black_level_dn"] = black, "eight times the read noise, so that dark frames do not clip"
    if gain is None and full_well:
        found[DN_PER_E] = (codes - black) / full_well, "the full well is the highest digital number"
    if read_noise is not None:
        found[read_noise.replace("read_noise", "dsnu")] = 0.5 * stated[read_noise], "half of the read noise"
    found["prnu_percent"] = 1.0, "1 %"
    found["dark_current_e_per_s"] = 0.0, "no dark current"
    own = {other: name for name, others in UNITS.items() for other in others}
    known = {own.get(name, name) for name in stated}
    return {name: entry for name, entry in found.items() if own.get(name, name) not in known}


def _system_gain(stated: Mapping[str, float]) -> float | None:
    """Return the gain in DN per electron, or None if it is not stated."""
    if DN_PER_E in stated:
        return stated[DN_PER_E]
    if E_PER_DN in stated:
        return 1.0 / stated[E_PER_DN]
    if CONVERSION in stated and SWING in stated:
        return 1e-3 * stated[CONVERSION] * _dn_per_unit("read_noise_mv", stated, None)
    return None


def _dn_per_unit(read_noise: str, stated: Mapping[str, float], gain: float | None) -> float:
    """Return digital numbers per unit of a read noise: DN, electron or millivolt; 0 if unknown."""
    if read_noise == "read_noise_dn":
        return 1.0
    if read_noise == "read_noise_e":
        return gain or 0.0
    if SWING in stated:
        return 1e-3 * stated.get(AMPLIFIER, 1.0) * float(1 << int(stated["bits"])) / stated[SWING]
    return 1e3 / stated[CONVERSION] * (gain or 0.0) if CONVERSION in stated else 0.0


def _channels(tile: Cfa, qe_peak: float) -> str:
    """Return the section `channels`: assumed shapes, scaled to the peak."""
    try:
        channels = assumed_channels(channel_names(tile), qe_peak)
    except InputError as error:
        hint = "Make a file with rggb, then edit array and channels in it"
        raise InputError("cfa", value=tile_text(tile), expected=f"a tile of {', '.join(KNOWN)}", hint=hint) from error
    text = "# The largest quantum efficiency was given; the spectral shape is assumed.\nchannels:\n"
    for name, channel in channels.items():
        text += f"  {name}:\n    wavelength_nm: [{', '.join(f'{nm:g}' for nm in channel.wavelength_nm)}]\n"
        text += f"    quantum_efficiency: [{', '.join(f'{value:.4g}' for value in channel.quantum_efficiency)}]\n"
        if channel.polarization_angle_deg is not None:
            text += f"    polarization_angle_deg: {channel.polarization_angle_deg:g}\n"
            text += f"    extinction_ratio: {channel.extinction_ratio:g}\n"
        text += f"    source: {json.dumps(channel.source)}\n    assumed: true\n"
    return text
