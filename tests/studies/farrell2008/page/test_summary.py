"""The summary: a line for each result of the paper."""

from __future__ import annotations

from types import MappingProxyType

import pytest

from photosite.studies.farrell2008 import table1
from photosite.studies.farrell2008.page.summary import SUMMARIES, summary_table
from photosite.studies.farrell2008.study import CHAPTERS, Reproduction, reproduce


@pytest.fixture(scope="module")
def study(charts, snr, sizes, face, hdr) -> Reproduction:
    with pytest.MonkeyPatch.context() as patch:
        for key, size in {"d200": (32, 48), "vendor": (96, 128)}.items():
            patch.setitem(table1.SIZES, key, size)
        first = reproduce(2008, ["table1"]).results
    results = (*first.values(), *charts, snr, sizes, face, hdr)
    keys = [chapter.key for chapter in CHAPTERS]
    return Reproduction(2008, MappingProxyType(dict(zip(keys, results, strict=True))), {})


def test_every_chapter_has_its_lines(study: Reproduction) -> None:
    assert [type(result) for result in study.results.values()] == list(SUMMARIES)


def test_lines_contain_the_results(study: Reproduction) -> None:
    lines = {str(row[0]): row for row in summary_table(study).rows if isinstance(row, tuple)}
    numbers = study.to_dict()["chapters"]
    d200 = numbers["table1"]["cameras"]["d200"]["parameters"]
    line = lines["Table 1, Nikon D200: read noise, DSNU, PRNU"]
    assert line[1] == "0.52 mV, 0.55 mV, 1.126 %"
    assert line[2].startswith(f"{d200['read_noise_mv']['value']:.4f}"[:6])
    covered = sum(entry["interval_95"][0] <= entry["true"] <= entry["interval_95"][1] for entry in d200.values())
    assert line[3].startswith(f"{covered} of 7 values")
    assert lines["Figure 6, SNR of the Nikon D200 at 1.08 V"][1:3] == ("38.10 dB in total", "38.10 dB in total")
    ranges = (entry["dynamic_range_db"] for entry in numbers["high_dynamic_range"]["cameras"].values())
    for decibel in ranges:
        assert f"{decibel:.0f} dB" in lines["Scene of high dynamic range"][2]
