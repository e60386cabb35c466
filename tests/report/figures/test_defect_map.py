"""The map of defects draws each where it lies, and says how many there are."""

from __future__ import annotations

import numpy as np

from photosite.report.figures import defect_map
from photosite.report.figures.defect_map import defect_map_figure
from photosite.report.style import svg_bytes
from photosite.sensor.measured_chip import DefectKind, Defects, no_defects


def defects(count=50):
    rng = np.random.default_rng(1)
    kind = rng.choice([DefectKind.HOT, DefectKind.DEAD, DefectKind.NOISY], count).astype(np.uint8)
    return Defects(rng.integers(0, 300, count), rng.integers(0, 400, count), kind, rng.random(count), rng.random(count))


def test_every_defect_is_drawn_where_it_lies() -> None:
    given = defects()
    (axes,) = defect_map_figure(given, (300, 400)).axes
    drawn = {line.get_label(): np.column_stack(line.get_data()) for line in axes.get_lines()}
    for name, kind in (("hot", DefectKind.HOT), ("dead", DefectKind.DEAD), ("noisy", DefectKind.NOISY)):
        chosen = given.of(kind)
        points = drawn.pop(f"{name}: {len(chosen)}")
        assert sorted(map(tuple, points)) == sorted(zip(chosen.col, chosen.row, strict=True))
    assert not drawn
    assert axes.get_ylim() == (299.5, -0.5)
    assert axes.get_xlim() == (-0.5, 399.5)


def test_of_very_many_the_farthest_are_drawn_and_the_legend_says_so(monkeypatch) -> None:
    monkeypatch.setattr(defect_map, "_MOST", 5)
    given = defects()
    (axes,) = defect_map_figure(given, (300, 400)).axes
    hot = given.of(DefectKind.HOT)
    line = next(line for line in axes.get_lines() if line.get_label() == f"hot: {len(hot)}, 5 drawn")
    farthest = np.argsort(-hot.deviation)[:5]
    assert sorted(line.get_xdata()) == sorted(hot.col[farthest])


def test_a_chip_without_defects_says_so_and_drawings_repeat() -> None:
    (axes,) = defect_map_figure(no_defects(), (30, 40)).axes
    assert [text.get_text() for text in axes.texts] == ["no defective pixels"]
    assert svg_bytes(defect_map_figure(defects(), (30, 40))) == svg_bytes(defect_map_figure(defects(), (30, 40)))
