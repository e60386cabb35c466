"""The parameters of a sensor, each with its label and unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, get_type_hints

from photosite.errors import InputError, did_you_mean
from photosite.values.estimate import Estimate

_NOISE = "Noise and fixed pattern (2008 paper)"
_DARK = "Dark signal"
_GAIN = "Gain and saturation"
_EMVA = "EMVA 1288"


@dataclass(frozen=True, slots=True)
class Label:
    """How a parameter is shown: its name in words, its unit, and the heading it stands under in long tables."""

    label: str
    unit: str
    topic: str


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The parameters of a sensor or of one color channel, named after EMVA 1288 and the 2008 paper.

    Noise and nonuniformity are standard deviations. `_dn`, `_e` and `_mv` are the same quantity in digital numbers,
    electrons and millivolts at the pixel.
    """

    read_noise_dn: Annotated[Estimate, Label("Read noise", "DN", _NOISE)]
    read_noise_e: Annotated[Estimate, Label("Read noise", "e⁻", _NOISE)]
    read_noise_mv: Annotated[Estimate, Label("Read noise", "mV", _NOISE)]
    dsnu_dn: Annotated[Estimate, Label("DSNU", "DN", _NOISE)]
    dsnu_e: Annotated[Estimate, Label("DSNU", "e⁻", _NOISE)]
    dsnu_mv: Annotated[Estimate, Label("DSNU", "mV", _NOISE)]
    prnu_percent: Annotated[Estimate, Label("PRNU", "%", _NOISE)]
    shading_percent: Annotated[Estimate, Label("Shading", "%", _NOISE)]
    dark_voltage_mv_per_s: Annotated[Estimate, Label("Dark voltage", "mV/s", _DARK)]
    dark_current_dn_per_s: Annotated[Estimate, Label("Dark current", "DN/s", _DARK)]
    dark_current_e_per_s: Annotated[Estimate, Label("Dark current", "e⁻/s", _DARK)]
    dark_current_from_variance_e_per_s: Annotated[Estimate, Label("Dark current from variance", "e⁻/s", _DARK)]
    dcnu_percent: Annotated[Estimate, Label("Dark current nonuniformity", "%", _DARK)]
    black_level_dn: Annotated[Estimate, Label("Black level", "DN", _DARK)]
    system_gain_dn_per_e: Annotated[Estimate, Label("System gain K", "DN/e⁻", _GAIN)]
    conversion_gain_uv_per_e: Annotated[Estimate, Label("Conversion gain", "µV/e⁻", _GAIN)]
    saturation_dn: Annotated[Estimate, Label("Saturation", "DN", _GAIN)]
    saturation_capacity_e: Annotated[Estimate, Label("Saturation capacity", "e⁻", _GAIN)]
    responsivity_dn_per_photon: Annotated[Estimate, Label("Responsivity", "DN/photon", _EMVA)]
    quantum_efficiency_percent: Annotated[Estimate, Label("Quantum efficiency", "%", _EMVA)]
    temporal_dark_noise_e: Annotated[Estimate, Label("Temporal dark noise", "e⁻", _EMVA)]
    sensitivity_threshold_photons: Annotated[Estimate, Label("Absolute sensitivity threshold", "photons", _EMVA)]
    saturation_capacity_photons: Annotated[Estimate, Label("Saturation capacity", "photons", _EMVA)]
    snr_max_db: Annotated[Estimate, Label("Maximum SNR", "dB", _EMVA)]
    dynamic_range_db: Annotated[Estimate, Label("Dynamic range", "dB", _EMVA)]
    linearity_error_percent: Annotated[Estimate, Label("Linearity error LE", "%", _EMVA)]
    linearity_error_min_percent: Annotated[Estimate, Label("Linearity error LE, lowest", "%", _EMVA)]
    linearity_error_max_percent: Annotated[Estimate, Label("Linearity error LE, highest", "%", _EMVA)]
    linearity_error_full_scale_percent: Annotated[Estimate, Label("Linearity error of full scale (R3.0)", "%", _EMVA)]
    dsnu1288_e: Annotated[Estimate, Label("DSNU1288", "e⁻", _EMVA)]
    dsnu1288_row_e: Annotated[Estimate, Label("DSNU1288, rows", "e⁻", _EMVA)]
    dsnu1288_column_e: Annotated[Estimate, Label("DSNU1288, columns", "e⁻", _EMVA)]
    dsnu1288_pixel_e: Annotated[Estimate, Label("DSNU1288, pixels", "e⁻", _EMVA)]
    dsnu1288_filtered_e: Annotated[Estimate, Label("DSNU1288 after high-pass", "e⁻", _EMVA)]
    dsnu1288_filtered_row_e: Annotated[Estimate, Label("DSNU1288 after high-pass, rows", "e⁻", _EMVA)]
    dsnu1288_filtered_column_e: Annotated[Estimate, Label("DSNU1288 after high-pass, columns", "e⁻", _EMVA)]
    dsnu1288_filtered_pixel_e: Annotated[Estimate, Label("DSNU1288 after high-pass, pixels", "e⁻", _EMVA)]
    prnu1288_percent: Annotated[Estimate, Label("PRNU1288", "%", _EMVA)]
    prnu1288_row_percent: Annotated[Estimate, Label("PRNU1288, rows", "%", _EMVA)]
    prnu1288_column_percent: Annotated[Estimate, Label("PRNU1288, columns", "%", _EMVA)]
    prnu1288_pixel_percent: Annotated[Estimate, Label("PRNU1288, pixels", "%", _EMVA)]
    prnu1288_unfiltered_percent: Annotated[Estimate, Label("PRNU1288 without high-pass", "%", _EMVA)]
    prnu1288_unfiltered_row_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, rows", "%", _EMVA)]
    prnu1288_unfiltered_column_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, columns", "%", _EMVA)]
    prnu1288_unfiltered_pixel_percent: Annotated[Estimate, Label("PRNU1288 without high-pass, pixels", "%", _EMVA)]

    def estimates(self) -> dict[str, Estimate]:
        """Return all parameters by name, in the order above."""
        return {name: getattr(self, name) for name in PARAMETER_LABELS}


PARAMETER_LABELS: dict[str, Label] = {
    name: hint.__metadata__[0] for name, hint in get_type_hints(Parameters, include_extras=True).items()
}
"""Label and unit by the parameter's name, in the order of `Parameters`."""


def parameter_label(name: str) -> Label:
    """Return the label of a parameter, by its name in `Parameters`.

    Raises
    ------
    InputError
        If the name is unknown.
    """
    if name not in PARAMETER_LABELS:
        raise InputError("parameter", value=name, expected="a known name", hint=did_you_mean(name, PARAMETER_LABELS))
    return PARAMETER_LABELS[name]
