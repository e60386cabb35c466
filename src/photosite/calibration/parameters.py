"""The parameters of a sensor, and the label and unit of each."""

from __future__ import annotations

from dataclasses import dataclass, fields

from photosite.errors import InputError, did_you_mean
from photosite.values.estimate import Estimate


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The parameters of a sensor or of one colour channel, named after EMVA 1288 and the 2008 paper.

    Noise and non-uniformity are standard deviations. `_dn`, `_e` and `_mv` are the same quantity in digital numbers,
    electrons and millivolts at the pixel.
    """

    read_noise_dn: Estimate
    read_noise_e: Estimate
    read_noise_mv: Estimate
    dsnu_dn: Estimate
    dsnu_e: Estimate
    dsnu_mv: Estimate
    prnu_percent: Estimate
    dark_voltage_mv_per_s: Estimate
    dark_current_e_per_s: Estimate
    dark_current_from_variance_e_per_s: Estimate
    dcnu_percent: Estimate
    black_level_dn: Estimate
    system_gain_dn_per_e: Estimate
    conversion_gain_uv_per_e: Estimate
    saturation_dn: Estimate
    saturation_capacity_e: Estimate
    responsivity_dn_per_photon: Estimate
    quantum_efficiency_percent: Estimate
    temporal_dark_noise_e: Estimate
    sensitivity_threshold_photons: Estimate
    saturation_capacity_photons: Estimate
    snr_max_db: Estimate
    dynamic_range_db: Estimate
    linearity_error_percent: Estimate
    linearity_error_min_percent: Estimate
    linearity_error_max_percent: Estimate
    linearity_error_full_scale_percent: Estimate
    dsnu1288_e: Estimate
    dsnu1288_row_e: Estimate
    dsnu1288_column_e: Estimate
    dsnu1288_pixel_e: Estimate
    dsnu1288_filtered_e: Estimate
    dsnu1288_filtered_row_e: Estimate
    dsnu1288_filtered_column_e: Estimate
    dsnu1288_filtered_pixel_e: Estimate
    prnu1288_percent: Estimate
    prnu1288_row_percent: Estimate
    prnu1288_column_percent: Estimate
    prnu1288_pixel_percent: Estimate
    prnu1288_unfiltered_percent: Estimate
    prnu1288_unfiltered_row_percent: Estimate
    prnu1288_unfiltered_column_percent: Estimate
    prnu1288_unfiltered_pixel_percent: Estimate

    def estimates(self) -> dict[str, Estimate]:
        """Return all parameters by name, in the order above."""
        return {entry.name: getattr(self, entry.name) for entry in fields(Parameters)}


@dataclass(frozen=True, slots=True)
class ParameterLabel:
    """How a parameter is shown.

    Parameters
    ----------
    label
        Its name in words.
    unit
        Its unit.
    topic
        Heading in long tables.
    """

    label: str
    unit: str
    topic: str


def _labels(topic: str, **entries: tuple[str, str]) -> dict[str, ParameterLabel]:
    return {name: ParameterLabel(label, unit, topic) for name, (label, unit) in entries.items()}


PARAMETER_LABELS: dict[str, ParameterLabel] = {
    **_labels(
        "Noise and fixed pattern (2008 paper)",
        read_noise_dn=("Read noise", "DN"),
        read_noise_e=("Read noise", "e⁻"),
        read_noise_mv=("Read noise", "mV"),
        dsnu_dn=("DSNU", "DN"),
        dsnu_e=("DSNU", "e⁻"),
        dsnu_mv=("DSNU", "mV"),
        prnu_percent=("PRNU", "%"),
    ),
    **_labels(
        "Dark signal",
        dark_voltage_mv_per_s=("Dark voltage", "mV/s"),
        dark_current_e_per_s=("Dark current", "e⁻/s"),
        dark_current_from_variance_e_per_s=("Dark current from variance", "e⁻/s"),
        dcnu_percent=("Dark current non-uniformity", "%"),
        black_level_dn=("Black level", "DN"),
    ),
    **_labels(
        "Gain and saturation",
        system_gain_dn_per_e=("System gain K", "DN/e⁻"),
        conversion_gain_uv_per_e=("Conversion gain", "µV/e⁻"),
        saturation_dn=("Saturation", "DN"),
        saturation_capacity_e=("Saturation capacity", "e⁻"),
    ),
    **_labels(
        "EMVA 1288",
        responsivity_dn_per_photon=("Responsivity", "DN/photon"),
        quantum_efficiency_percent=("Quantum efficiency", "%"),
        temporal_dark_noise_e=("Temporal dark noise", "e⁻"),
        sensitivity_threshold_photons=("Absolute sensitivity threshold", "photons"),
        saturation_capacity_photons=("Saturation capacity", "photons"),
        snr_max_db=("Maximum SNR", "dB"),
        dynamic_range_db=("Dynamic range", "dB"),
        linearity_error_percent=("Linearity error LE", "%"),
        linearity_error_min_percent=("Linearity error LE, lowest", "%"),
        linearity_error_max_percent=("Linearity error LE, highest", "%"),
        linearity_error_full_scale_percent=("Linearity error of full scale (R3.0)", "%"),
        dsnu1288_e=("DSNU1288", "e⁻"),
        dsnu1288_row_e=("DSNU1288, rows", "e⁻"),
        dsnu1288_column_e=("DSNU1288, columns", "e⁻"),
        dsnu1288_pixel_e=("DSNU1288, pixels", "e⁻"),
        dsnu1288_filtered_e=("DSNU1288 after high-pass", "e⁻"),
        dsnu1288_filtered_row_e=("DSNU1288 after high-pass, rows", "e⁻"),
        dsnu1288_filtered_column_e=("DSNU1288 after high-pass, columns", "e⁻"),
        dsnu1288_filtered_pixel_e=("DSNU1288 after high-pass, pixels", "e⁻"),
        prnu1288_percent=("PRNU1288", "%"),
        prnu1288_row_percent=("PRNU1288, rows", "%"),
        prnu1288_column_percent=("PRNU1288, columns", "%"),
        prnu1288_pixel_percent=("PRNU1288, pixels", "%"),
        prnu1288_unfiltered_percent=("PRNU1288 without high-pass", "%"),
        prnu1288_unfiltered_row_percent=("PRNU1288 without high-pass, rows", "%"),
        prnu1288_unfiltered_column_percent=("PRNU1288 without high-pass, columns", "%"),
        prnu1288_unfiltered_pixel_percent=("PRNU1288 without high-pass, pixels", "%"),
    ),
}
"""Label and unit by the parameter's name, in the order of `Parameters`."""


def parameter_label(name: str) -> ParameterLabel:
    """Return a parameter's label and unit.

    Parameters
    ----------
    name
        As in `Parameters`.

    Raises
    ------
    InputError
        If the name is unknown.

    Examples
    --------
    >>> shown = parameter_label("read_noise_mv")
    >>> shown.label, shown.unit
    ('Read noise', 'mV')
    """
    if name not in PARAMETER_LABELS:
        raise InputError("name", value=name, expected="a parameter", hint=did_you_mean(name, PARAMETER_LABELS))
    return PARAMETER_LABELS[name]
