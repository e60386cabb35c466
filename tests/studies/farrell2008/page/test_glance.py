"""The study at a glance: a line for each thing that the paper reports."""

from __future__ import annotations

import pytest

from photosite.studies.farrell2008 import table1
from photosite.studies.farrell2008.page.glance import GLANCES, glance_table
from photosite.studies.farrell2008.study import CHAPTERS, Reproduction, reproduce

QUICK = ("table1", "snr", "pixel_size", "dim_face", "high_dynamic_range")


@pytest.fixture(scope="module")
def study() -> Reproduction:
    with pytest.MonkeyPatch.context() as patch:
        for key, size in {"d200": (32, 48), "vendor": (96, 128)}.items():
            patch.setitem(table1.SIZES, key, size)
        return reproduce(2008, QUICK)


def test_every_chapter_has_its_lines(study: Reproduction) -> None:
    """The two that take longer, fill factor and patches, are known by their types."""
    assert len(GLANCES) == len(CHAPTERS)
    for key, result in study.results.items():
        assert type(result) in GLANCES, key
    assert {kind.__name__ for kind in GLANCES} >= {"FillFactors", "Patches"}


def test_lines_say_what_the_results_say(study: Reproduction) -> None:
    lines = {str(row[0]): row for row in glance_table(study).rows if isinstance(row, tuple)}
    numbers = study.to_dict()["chapters"]
    d200 = numbers["table1"]["cameras"]["d200"]["parameters"]
    line = lines["Table 1, Nikon D200: read noise, DSNU, PRNU"]
    assert line[1] == "0.52 mV, 0.55 mV, 1.126 %"
    assert line[2].startswith(f"{d200['read_noise_mv']['value']:.4f}"[:6])
    held = sum(entry["interval_95"][0] <= entry["true"] <= entry["interval_95"][1] for entry in d200.values())
    assert line[3].startswith(f"{held} of 7 figures")
    assert lines["Figure 6, SNR of the Nikon D200 at 1.08 V"][1:3] == ("38.10 dB in all", "38.10 dB in all")
    ranges = (entry["dynamic_range_db"] for entry in numbers["high_dynamic_range"]["cameras"].values())
    for decibel in ranges:
        assert f"{decibel:.0f} dB" in lines["Scene of high dynamic range"][2]
