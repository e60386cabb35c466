"""The note below each figure: its number in the paper, and that the cameras are virtual."""

from __future__ import annotations

import io
from xml.etree import ElementTree

import matplotlib.image
import pytest
from matplotlib.figure import Figure

from photosite.report.style import STRIP_IN, png_bytes, styled
from photosite.studies.farrell2008.drawing import Drawing, texts

NARROWEST_IN = 7.0
"""Width of the narrowest figure of the study."""


def figure(width_in: float = NARROWEST_IN) -> Figure:
    with styled():
        made = Figure(figsize=(width_in, 3.0))
        made.subplots().plot([0, 1], [0, 1])
    return made


@pytest.mark.parametrize("name", texts()["figure"])
def test_the_note_states_the_figure_and_that_it_is_virtual_and_fits_below_it(name: str) -> None:
    note = texts()["figure"][name]["note"]
    assert "virtual" in note or "simulated" in note
    number = name.split("-")[0]
    expected = {"fill": "Section 3", "table1": "Table 1", "section5": "Section 5"}.get(number, f"Figure {number[-1]}")
    assert note.startswith(expected)
    one = figure(10.2 if name.startswith("figure1") else NARROWEST_IN)
    text = one.text(0.0, 0.0, f"photosite, Farrell et al. 2008, {note}", fontsize=8.0)
    one.draw_without_rendering()
    assert text.get_window_extent().width < 0.97 * one.bbox.width


def test_the_note_is_in_a_strip_below_the_figure() -> None:
    one = figure()
    plain = matplotlib.image.imread(io.BytesIO(png_bytes(one, 100.0)))
    lined = matplotlib.image.imread(io.BytesIO(png_bytes(one, 100.0, below="a line")))
    rows = round(100 * STRIP_IN)
    assert lined.shape[0] - plain.shape[0] == rows
    assert (lined[: plain.shape[0]] == plain).all()
    strip = lined[plain.shape[0] :, :, :3]
    assert strip.min() < 0.6  # the note
    assert strip[0].min() == strip[-1].min() == 1.0  # not cut off
    assert not one.texts


def test_both_files_have_the_note() -> None:
    drawn = Drawing.of("figure6-snr", figure())
    height = ElementTree.fromstring(drawn.svg).get("height")
    assert height is not None
    assert float(height.removesuffix("pt")) == pytest.approx(72 * (3.0 + STRIP_IN), abs=0.1)
