"""Table 1 of the 2008 paper agrees with the sensor file about the well."""

from __future__ import annotations

from dataclasses import replace

from photosite.calibration.result import Calibration
from photosite.report.numbers import format_uncertain
from photosite.report.paper import table_1
from photosite.studies.closed_loop import ClosedLoop
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Uncertain


def _well_row(calibration: Calibration) -> tuple[str, ...]:
    (row,) = (row for row in table_1(calibration).rows if row[0] == "Well capacity")
    return row


def test_the_well_is_that_of_the_sensor_file(loop: ClosedLoop) -> None:
    """The flat fields fill the well before the converter saturates; EMVA's saturation capacity is another parameter."""
    full = replace(
        loop.calibration,
        saturation_dn=Estimate.of(Uncertain.of(3500.0, 1.0), "brightest flats"),
        saturation_capacity_e=Estimate(33_300.0, 4600.0),
    )
    well = full.sensor.pixel.well_capacity_e
    assert _well_row(full)[2] == format_uncertain(well.value, well.standard_uncertainty)


def test_no_well_if_the_converter_saturates_first(loop: ClosedLoop) -> None:
    top = float((1 << loop.calibration.bits) - 1)
    limited = replace(loop.calibration, saturation_dn=Estimate.of(Uncertain.of(top, 0.1), "brightest flats"))
    assert limited.base is not None
    deep = replace(limited, base=limited.base.with_(well_capacity_e=1e6))
    for calibration in (deep, replace(limited, base=None)):
        row = _well_row(calibration)
        assert row[2] == "not estimated"
        assert "the converter saturates before the well" in row[3]
    assert deep.sensor.pixel.well_capacity_e.value == 1e6
