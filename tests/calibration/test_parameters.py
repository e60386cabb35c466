"""Labels and units of the parameters."""

from __future__ import annotations

from dataclasses import fields

import pytest

from photosite.calibration.parameters import PARAMETER_LABELS, Parameters, parameter_label
from photosite.errors import InputError

UNITS = {
    "dn": "DN",
    "e": "e⁻",
    "mv": "mV",
    "percent": "%",
    "db": "dB",
    "photons": "photons",
    "mv_per_s": "mV/s",
    "e_per_s": "e⁻/s",
    "dn_per_e": "DN/e⁻",
    "uv_per_e": "µV/e⁻",
    "dn_per_photon": "DN/photon",
    "dn_per_s": "DN/s",
}


def test_every_parameter_has_a_label_and_every_label_a_parameter() -> None:
    assert list(PARAMETER_LABELS) == [entry.name for entry in fields(Parameters)]


def test_the_unit_matches_the_end_of_the_name() -> None:
    for name in PARAMETER_LABELS:
        ending = max((end for end in UNITS if name.endswith(f"_{end}")), key=len)
        assert parameter_label(name).unit == UNITS[ending], name


def test_no_two_parameters_look_alike() -> None:
    shown = [(entry.label, entry.unit) for entry in PARAMETER_LABELS.values()]
    assert len(set(shown)) == len(shown)


def test_an_unknown_parameter_gives_the_most_similar_one() -> None:
    with pytest.raises(InputError) as caught:
        parameter_label("read_noise_mV")
    assert caught.value.value == "read_noise_mV"
    assert "'read_noise_mv'" in caught.value.hint
