"""Charge missing in the mean of nearly full wells, against Poisson electrons cut off at the well."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.photon_transfer.unfilled_wells import missing_charge

GAIN, PIXELS, FRAMES = 0.5, 60_000, 6


@pytest.mark.parametrize("beyond", [1.5, 2.0, 2.5, 3.0])
@pytest.mark.parametrize("prnu", [0.0, 0.004, 0.02])
@pytest.mark.parametrize("well", [2000.0, 30_000.0])
def test_the_missing_charge_is_found(well: float, prnu: float, beyond: float) -> None:
    """Levels are `beyond` standard deviations of noise and pattern brighter than the well."""
    rng = np.random.default_rng([int(well), int(1e4 * prnu), int(10 * beyond)])
    mean = well + beyond * np.hypot(np.sqrt(well), prnu * well)
    dn = GAIN * np.minimum(rng.poisson(mean * (1.0 + prnu * rng.normal(size=PIXELS)), (FRAMES, PIXELS)), well)
    variances = dn.var(axis=0, ddof=1)
    own = float(variances.std()) / PIXELS**0.5
    found = missing_charge(float(variances.mean()), own, 0.0, GAIN * well**0.5, prnu * GAIN * well, GAIN)
    truth = GAIN * well - float(dn.mean())
    assert abs(found.value - truth) < 4.0 * found.standard_uncertainty
    assert found.standard_uncertainty < 0.4 * truth


def test_without_charge_left_out_there_is_no_correction() -> None:
    assert [missing_charge(v, 1.0, 0.0, 40.0, 5.0, 0.5).value for v in (-5.0, 0.0, 2.9)] == [0.0, 0.0, 0.0]
    exact, unknown = (missing_charge(0.0, 1.0, more, 40.0, 5.0, 0.5).standard_uncertainty for more in (0.0, 3.0))
    assert 0.02 < exact < 0.05
    assert 3.0 < unknown / exact < 4.0
