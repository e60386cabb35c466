"""Results of the chapters, each computed once for all tests of the study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace

import pytest
from short_protocol import short_d200_protocol

from photosite.studies.farrell2008 import fill_factor, patches, table1
from photosite.studies.farrell2008.cameras import CASES
from photosite.studies.farrell2008.fill_factor import FillFactors
from photosite.studies.farrell2008.high_dynamic_range import HighDynamicRange, high_dynamic_range
from photosite.studies.farrell2008.patches import Patches
from photosite.studies.farrell2008.pixel_size import PixelSize, pixel_sizes
from photosite.studies.farrell2008.portrait import DimFace, dim_face
from photosite.studies.farrell2008.snr import SnrChapter, snr_against_volts
from photosite.studies.farrell2008.study import Reproduction, reproduce


@pytest.fixture(scope="session")
def charts() -> tuple[FillFactors, Patches]:
    """Fill factors and chart comparisons on small frames, seed 5."""
    small = tuple(replace(case, chart_rows=264, chart_cols=392) for case in CASES)
    with pytest.MonkeyPatch.context() as patch:
        for module in (fill_factor, patches):
            patch.setattr(module, "CASES", small)
        fitted = fill_factor.fit_fill_factors(5)
        return fitted, patches.compare_charts(5, fitted)


@pytest.fixture(scope="session")
def reproduce_table1() -> Callable[[int], Reproduction]:
    """The study with the chapter on Table 1 only, on small frames."""

    def run(seed: int) -> Reproduction:
        with pytest.MonkeyPatch.context() as patch:
            for key, size in {"d200": (32, 48), "vendor": (96, 128)}.items():
                patch.setitem(table1.SIZES, key, size)
            patch.setitem(table1.PROTOCOLS, "d200", short_d200_protocol)
            return reproduce(seed, ["table1"])

    return run


@pytest.fixture(scope="session")
def table1_study(reproduce_table1: Callable[[int], Reproduction]) -> Reproduction:
    return reproduce_table1(2008)


@pytest.fixture(scope="session")
def snr() -> SnrChapter:
    return snr_against_volts(2008)


@pytest.fixture(scope="session")
def sizes() -> PixelSize:
    return pixel_sizes(2008)


@pytest.fixture(scope="session")
def face() -> DimFace:
    return dim_face(2008)


@pytest.fixture(scope="session")
def hdr() -> HighDynamicRange:
    return high_dynamic_range(2008)


@pytest.fixture
def unrendered(undrawn: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """Draw figures, but skip their conversion to SVG and PNG, for tests of texts and tables."""
    with undrawn():
        yield
