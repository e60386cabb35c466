"""Row and column sums against NumPy's."""

import numpy as np
import pytest

from photosite.engine.lines import LONGEST_LINE, line_sums


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("tile", [(1, 1), (2, 2), (3, 2)])
@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (64, 33), (130, 66)])
def test_sums_of_every_site_s_plane(shape, tile, dtype):
    frames = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, (3, *shape), dtype, endpoint=True)
    row_sums, column_sums = line_sums(frames, tile)
    assert row_sums.shape == (3, shape[0], tile[1])
    assert column_sums.shape == (3, tile[0], shape[1])
    for r in range(tile[0]):
        for c in range(tile[1]):
            plane = frames[:, r :: tile[0], c :: tile[1]].astype(np.uint64)
            np.testing.assert_array_equal(row_sums[:, r :: tile[0], c], plane.sum(2))
            np.testing.assert_array_equal(column_sums[:, r, c :: tile[1]], plane.sum(1))


def test_the_longest_line_of_the_highest_numbers_does_not_overflow():
    frame = np.full((1, LONGEST_LINE), 65_535, np.uint16)
    assert line_sums([frame])[0][0, 0, 0] == LONGEST_LINE * 65_535
    assert line_sums([frame.T])[1][0, 0, 0] == LONGEST_LINE * 65_535


def test_views_and_iterators_are_taken():
    frames = np.random.default_rng(2).integers(0, 4096, (2, 40, 30), np.uint16)
    row_sums, column_sums = line_sums(frame[::2, ::3] for frame in frames)
    np.testing.assert_array_equal(row_sums[:, :, 0], frames[:, ::2, ::3].sum(2, dtype=np.uint32))
    np.testing.assert_array_equal(column_sums[:, 0], frames[:, ::2, ::3].sum(1, dtype=np.uint32))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], "need a frame"),
        ([np.zeros((2, 2), np.uint16), np.zeros((2, 3), np.uint16)], r"not \(2, 3\)"),
        ([np.zeros((2, 2))], "float64"),
        ([np.zeros((1, LONGEST_LINE + 1), np.uint16)], "at most 65536"),
    ],
)
def test_wrong_frames_are_refused(frames, message):
    with pytest.raises(ValueError, match=message):
        line_sums(frames)
