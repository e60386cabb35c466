"""Planted columns, rows, clusters and single pixels among scattered defects."""

from __future__ import annotations

import numpy as np

from photosite.calibration.chip_maps.defect_groups import group_defects

SIZE = (400, 600)


def test_planted_shapes_are_found_among_scattered_defects():
    rng = np.random.default_rng(3)
    rows, cols = rng.integers(0, 400, 60), rng.integers(0, 600, 60)
    column = np.arange(100, 355)
    places = [
        *zip(column, np.full(column.size, 123), strict=True),
        *((40, c) for c in range(0, 600, 3)),
        *((200 + r, 500 + c) for r in range(3) for c in range(2)),
        *zip(rows, cols, strict=True),
    ]
    groups = group_defects(*np.array(places).T, SIZE)
    lines = [(group.shape, group.first, group.last) for group in groups if group.shape in ("column", "row")]
    assert [shape for shape, *_ in lines] == ["column", "row"]
    assert lines[0][1][1] == lines[0][2][1] == 123
    assert lines[1][1][0] == lines[1][2][0] == 40
    clusters = [group for group in groups if group.shape == "cluster"]
    assert (clusters[0].first, clusters[0].last, len(clusters[0])) == ((200, 500), (202, 501), 6)
    every = np.sort(np.concatenate([group.index for group in groups]))
    assert len(every) == len({tuple(place) for place in np.array(places).tolist()})
    assert len(np.unique(every)) == len(every)


def test_scattered_defects_are_no_lines():
    rng = np.random.default_rng(4)
    found = [group_defects(rng.integers(0, 400, 3000), rng.integers(0, 600, 3000), SIZE) for _ in range(3)]
    assert not any(group.shape in ("column", "row") for groups in found for group in groups)


def test_reach_of_one_channel_of_a_mosaic():
    rows, cols = [10, 12, 12, 30], [20, 20, 22, 40]
    assert [len(group) for group in group_defects(rows, cols, SIZE)] == [1, 1, 1, 1]
    assert [(group.shape, len(group)) for group in group_defects(rows, cols, SIZE, reach=2)] == [
        ("cluster", 3),
        ("pixel", 1),
    ]
    assert group_defects([], [], SIZE) == ()
    assert len(group_defects([5, 5], [5, 5], SIZE)) == 1
