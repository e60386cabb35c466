"""Figures 6 and 7 and section 5 as drawn: lines and pictures show the computed results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from photosite.report.page import Listing, Paragraph, Table
from photosite.studies.farrell2008.drawing import Drawing, Part, listing, text
from photosite.studies.farrell2008.high_dynamic_range import hdr_figure, wedge_figure
from photosite.studies.farrell2008.pixel_size import pixel_size_figure
from photosite.studies.farrell2008.portrait import FACE, Captioned, portrait, portraits_figure
from photosite.studies.farrell2008.snr import PARTS, snr_figure

KEYS = ("snr", "pixel_size", "dim_face", "high_dynamic_range")


@pytest.fixture(scope="module")
def results(snr, sizes, face, hdr) -> dict[str, Any]:
    return dict(zip(KEYS, (snr, sizes, face, hdr), strict=True))


@pytest.fixture
def parts(results: dict[str, Any], unrendered: None) -> dict[str, Part]:
    return {key: result.part() for key, result in results.items()}


def words(part: Part) -> str:
    lines = [entry.text for entry in part if isinstance(entry, Paragraph)]
    lines += [line for entry in part if isinstance(entry, Listing) for line in entry.lines]
    lines += [entry.caption for entry in part if isinstance(entry, Drawing)]
    return " ".join(lines)


def curve(figure: Figure, panel: int, label: str) -> np.ndarray:
    return next(np.asarray(x.get_xydata()) for x in figure.axes[panel].get_lines() if x.get_label() == label)


def test_figure_6_shows_the_curves_of_each_sensor(results: dict[str, Any]) -> None:
    figure = snr_figure(results["snr"])
    for panel, sensor in enumerate(results["snr"].sensors.values()):
        for name, label in {"total": "total", **PARTS}.items():
            wanted = np.column_stack([sensor.curves.volts, getattr(sensor.curves, f"{name}_db")])
            np.testing.assert_array_equal(curve(figure, panel, label), wanted)
    assert "1.08 V swing" in figure.axes[0].get_title(loc="left")


def test_figure_6_lists_the_values_of_the_paper_and_the_limits(parts: dict[str, Part]) -> None:
    table = next(entry for entry in parts["snr"] if isinstance(entry, Table))
    shown = {str(row[0]): row[1:3] for row in table.rows}  # type: ignore[index]
    assert shown["total"] == ("38.10", "38.10")
    assert shown["PRNU"] == ("38.97", "38.97")
    for wanted in ("below 0.0178 V", "above 0.254 V", "below 0.304 V", "above 0.650 V"):
        assert wanted in words(parts["snr"])


def test_figure_7_shows_one_pixel_and_the_same_area(results: dict[str, Any]) -> None:
    figure = pixel_size_figure(results["pixel_size"])
    for found in results["pixel_size"].pixels:
        label = f"{found.width_um:g} µm, {'without' if found.quiet else 'with'} read noise and DSNU"
        for panel, level in ((0, found.snr_db), (1, found.equal_area_db)):
            np.testing.assert_array_equal(curve(figure, panel, label), np.column_stack([found.luminance_cd_m2, level]))


def test_assumptions_and_sources_are_listed(parts: dict[str, Part]) -> None:
    assert all(line in words(parts["pixel_size"]) for line in listing("pixel_size_assumptions").lines)
    assert text("portrait_source") in words(parts["dim_face"])
    assert "the others are simulated" in words(parts["dim_face"])
    for key in ("pixel_size", "dim_face", "high_dynamic_range"):
        assert "not known" in words(parts[key])


def test_faces_are_parts_of_their_pictures() -> None:
    print_ = portrait()
    figure = portraits_figure([Captioned("one", print_, "whole"), Captioned("half", print_[::2, ::2], "half")])
    faces = [np.asarray(axes.get_images()[0].get_array()) for axes in figure.axes[2:]]
    np.testing.assert_array_equal(faces[0], print_[FACE.r0 : FACE.r1, FACE.c0 : FACE.c1])
    np.testing.assert_array_equal(faces[1], print_[FACE.r0 : FACE.r1 : 2, FACE.c0 : FACE.c1 : 2])


def test_high_dynamic_range_shows_both_brightnesses_and_the_detected_steps(results: dict[str, Any]) -> None:
    shots = results["high_dynamic_range"].shots
    shown = [np.asarray(axes.get_images()[0].get_array()) for axes in hdr_figure(results["high_dynamic_range"]).axes]
    for index, shot in enumerate(shots):
        np.testing.assert_array_equal(shown[2 * index], shot.picture)
        np.testing.assert_array_equal(shown[2 * index + 1], shot.lifted)
    bars = wedge_figure(results["high_dynamic_range"]).axes[0].containers
    for shot, bar in zip(shots, bars, strict=True):
        seen = [value for value in shot.wedge.snr_db if value is not None]
        np.testing.assert_array_equal(bar.lines[0].get_ydata(), seen)


def test_names_of_drawings_differ(parts: dict[str, Part]) -> None:
    names = [entry.name for part in parts.values() for entry in part if isinstance(entry, Drawing)]
    assert len(set(names)) == len(names) == 6
