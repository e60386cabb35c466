"""What the parameters are called where people read them: one label and one unit for each, for the whole project."""

from __future__ import annotations

from dataclasses import dataclass

from photosite.errors import InputError, did_you_mean


@dataclass(frozen=True, slots=True)
class ParameterLabel:
    """How a parameter is shown.

    Parameters
    ----------
    label
        Its name in words.
    unit
        Its unit in symbols.
    topic
        What it belongs to: the heading it stands under in a long table.
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
"""By the parameter's name in `Parameters`, in its order."""


def parameter_label(name: str) -> ParameterLabel:
    """How a parameter is shown.

    Parameters
    ----------
    name
        As in `Parameters`.

    Raises
    ------
    InputError
        If there is no such parameter.

    Examples
    --------
    >>> shown = parameter_label("read_noise_mv")
    >>> shown.label, shown.unit
    ('Read noise', 'mV')
    """
    if name not in PARAMETER_LABELS:
        raise InputError(f"there is no parameter '{name}'; {did_you_mean(name, PARAMETER_LABELS)}")
    return PARAMETER_LABELS[name]
