"""Traces of lossy digital stages in a calibration: refused with what to correct, or withheld with the cause."""

from __future__ import annotations

from typing import Any

import pytest
from tests.calibration.test_pixel_coupling import SENSOR, measured
from tests.helpers.diagnosed import limits

from photosite.errors import CalibrationError


@pytest.mark.parametrize(
    ("output", "id"),
    [
        ({"dropped_bits": 2, "rescaled": True}, "shifted-numbers"),
        ({"dropped_bits": 2}, "wrong-bit-depth"),
    ],
)
def test_lossy_stages_are_refused(output: dict[str, Any], id: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        measured(SENSOR.with_(output=output), level=1.2)
    assert caught.value.id == id


def test_a_subtracted_black_level_is_named() -> None:
    found = measured(SENSOR.with_(output={"subtract_black_level": True}), level=1.2)
    low, high = found.system_gain_dn_per_e.interval_95 or (0.0, 0.0)
    assert low < SENSOR.system_gain_dn_per_e < high
    assert "clipped-darks" in limits(found)


def test_square_root_companding_is_named() -> None:
    found = measured(SENSOR.with_(output={"companding": "square_root"}), level=1.2)
    assert found.system_gain_dn_per_e.value is None
    assert "tone-curve" in limits(found)


def test_decoded_companding_keeps_the_gain() -> None:
    stages = {"companding": "square_root", "companded_bits": 8, "decoded": True}
    found = measured(SENSOR.with_(output=stages), level=1.2)
    low, high = found.system_gain_dn_per_e.interval_95 or (0.0, 0.0)
    assert low < SENSOR.system_gain_dn_per_e < high
    assert "decoded-companding" in limits(found)
