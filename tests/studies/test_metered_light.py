"""A colour sensor under metered light."""

from __future__ import annotations

import pytest

import photosite as ps
from photosite.studies.protocol import paper_d200_protocol
from photosite.studies.virtual_lab import virtual_lab, with_pedestal


def test_saturation_is_that_of_the_channel_that_saturates_first() -> None:
    """Green saturates first; the mean efficiency of all channels would make two thirds of its electrons of it."""
    sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=64, cols=96))
    lab = virtual_lab(sensor, paper_d200_protocol(), seed=3, photons_known=True)
    cal = ps.calibrate(lab.frame_set())
    green = cal.channels["G"].saturation_capacity_e
    assert green.value is not None
    assert cal.saturation_capacity_e.value == pytest.approx(green.value, rel=0.02)  # its own gain or that of all
    # The paper's exposures are too far apart for EMVA's variance maximum: the saturated level tells, and tells well.
    assert "too far apart" in cal.saturation_capacity_photons.method
    assert cal.saturation_capacity_photons.value == pytest.approx(
        cal.channels["G"].saturation_capacity_photons.value, rel=1e-3
    )
    assert cal.saturation_capacity_e.standard_uncertainty is not None
    off = abs(cal.saturation_capacity_e.value - sensor.saturation_capacity_e)
    assert off < 3 * cal.saturation_capacity_e.standard_uncertainty < 0.02 * sensor.saturation_capacity_e
