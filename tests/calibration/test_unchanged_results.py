"""Parameters of a few calibrations, which change only on purpose.

`python tests/calibration/test_unchanged_results.py` writes them anew, to unchanged_results.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import photosite as ps
from photosite.calibration.result import Calibration
from photosite.calibration.setting import calibrate_setting
from photosite.studies.coverage import CONDITIONS
from photosite.studies.imperfect_stacks import KINDS
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab

STORED = Path(__file__).with_name("unchanged_results.json")
PROTOCOL = ShootingProtocol(
    "unchanged",
    (
        Step("dark", 1e-3, 16),
        *series("dark", 0.1, 8.0, exposures=4, count=4),
        *(Step("light", 0.005 * n, 4) for n in range(1, 13)),
    ),
)
EFFECTS: dict[str, Any] = {
    "hot_pixels": {"fraction": 0.005, "median_e_per_s": 300},
    "telegraph_noise": {"fraction": 0.03, "amplitude_e": 60},
    "line_pattern": {"row_offset_e": 4.0, "column_offset_e": 6.0, "column_gain_percent": 0.6},
}


def with_effects() -> Calibration:
    mono = {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}
    properties = {"rows": 96, "cols": 128, "black_level_dn": 100, "well_capacity_e": 20_000, "row_noise_e": 2}
    light = {"cfa": "mono", "channels": {"M": mono}, "dark_current_e_per_s": 20, "dcnu_percent": 20}
    sensor = ps.load_sensor("nikon-d200").with_(**properties, **light, serial="unchanged", **EFFECTS)
    return calibrate_setting(virtual_lab(sensor, PROTOCOL, seed=5, photons_known=True).frame_set(), maps=True)


def of_stack(name: str) -> Calibration:
    return calibrate_setting(next(kind for kind in KINDS if kind.name == name).frames(0))


CASES = {
    "bright-cfa-12": lambda: calibrate_setting(CONDITIONS["bright-cfa-12"].lab(0).frame_set()),
    "clipped-mono-12": lambda: calibrate_setting(CONDITIONS["clipped-mono-12"].lab(0).frame_set()),
    "image lag": lambda: of_stack("image lag"),
    "wrong level": lambda: of_stack("wrong level"),
    "effects": with_effects,
}


def found(name: str) -> dict[str, Any]:
    """Return values and standard uncertainties of the parameters, and the ids of the diagnostics."""
    calibration = CASES[name]()
    estimates = {key: [entry.value, entry.standard_uncertainty] for key, entry in calibration.estimates().items()}
    return {"parameters": estimates, "diagnostics": sorted({entry.id for entry in calibration.diagnostics})}


@pytest.mark.parametrize("name", CASES)
def test_parameters_and_diagnostics_are_the_stored_ones(name: str) -> None:
    stored, new = json.loads(STORED.read_text(encoding="utf-8"))[name], found(name)
    assert new["diagnostics"] == stored["diagnostics"]
    assert new["parameters"].keys() == stored["parameters"].keys()
    for key, (value, uncertainty) in stored["parameters"].items():
        if value is None:
            assert new["parameters"][key][0] is None, key
        else:  # the last digits depend on the processor's sums
            assert new["parameters"][key] == pytest.approx([value, uncertainty], rel=1e-6), key


if __name__ == "__main__":
    STORED.write_text(json.dumps({name: found(name) for name in CASES}, indent=1) + "\n", encoding="utf-8")
