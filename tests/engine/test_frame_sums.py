"""Frame sums compared with Python integers and NumPy, and independent of the order and grouping of frames."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from photosite.engine.frame_sums import FrameSums
from photosite.frames.stored_rows import StoredRows

BAYER = np.array([[0, 1], [1, 2]])


def stack(n=7, shape=(9, 14), top=65_536, seed=1, dtype=np.uint16):
    return np.random.default_rng(seed).integers(0, top, (n, *shape), dtype=dtype)


def label_map(tile, shape):
    repeats = [n // m + 1 for n, m in zip(shape, tile.shape, strict=True)]
    return np.tile(tile, repeats)[: shape[0], : shape[1]]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_sums_mean_and_variance_match_numpy(dtype):
    frames = stack(top=256, dtype=dtype)
    sums = FrameSums(frames.shape[1:]).add(frames)
    wide = frames.astype(np.int64)
    assert np.array_equal(sums.sum, wide.sum(0))
    assert np.array_equal(sums.sum_of_squares, (wide**2).sum(0))
    np.testing.assert_allclose(sums.mean(), wide.mean(0), rtol=1e-15)
    np.testing.assert_allclose(sums.variance(), wide.var(0, ddof=1), rtol=1e-12)


def test_variance_near_full_scale_is_exact():
    """Noise of 1 DN at 65 535 DN would be lost in float32 sums."""
    frames = np.full((1001, 1, 2), 65_534, np.uint16)
    frames[::2, 0, 0] = 65_535
    expected = Fraction(501 * 500, 1001 * 1000)
    assert FrameSums((1, 2)).add(frames).variance()[0, 0] == float(expected)


@pytest.mark.parametrize("tile", [np.zeros((1, 1), int), BAYER, np.arange(36).reshape(6, 6) % 3], ids=("1", "2", "6"))
@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize("shape", [(19, 30), (3, 4100)])  # the second has rows of several runs
def test_the_last_frames_complete_the_totals_in_the_same_pass(tile, first, shape):
    frames = stack(n=13, shape=shape)
    whole = FrameSums(shape, tile).add(frames)
    sums = FrameSums(shape, tile).add(frames[:first]).add_last(frames[first:])
    for found, expected in zip(sums.label_totals(), whole.label_totals(), strict=True):
        assert found.variance_spread == pytest.approx(expected.variance_spread, rel=1e-12)
        assert replace(found, variance_spread=0.0) == replace(expected, variance_spread=0.0)
    assert np.array_equal(sums.sum, whole.sum)
    for unavailable in (sums.variance, sums.state, lambda: sums.add(frames), lambda: sums.merge(whole)):
        with pytest.raises(ValueError, match="add_last"):
            unavailable()
    assert np.array_equal(sums.clear().add(frames).sum_of_squares, whole.sum_of_squares)


def test_label_totals_are_exact():
    frames = stack()
    wide = frames.astype(object)
    totals = FrameSums(frames.shape[1:], BAYER, black=500, white=65_000).add(frames).label_totals()
    labels = label_map(BAYER, frames.shape[1:])
    for k, entry in enumerate(totals):
        chosen = wide[:, labels == k]
        assert entry.pixels == chosen.shape[1]
        assert entry.frames == 7
        assert entry.total == chosen.sum()
        assert entry.squares == (chosen**2).sum()
        assert entry.pixel_squares == (chosen.sum(0) ** 2).sum()
        assert entry.frame_squares == (chosen.sum(1) ** 2).sum()
        assert entry.low == (chosen <= 500).sum()
        assert entry.high == (chosen >= 65_000).sum()
        numbers = chosen.astype(float)
        v = numbers.var(0, ddof=1)
        assert entry.mean == pytest.approx(numbers.mean(), rel=1e-14)
        assert entry.temporal_variance == pytest.approx(v.mean(), rel=1e-12)
        assert entry.variance_spread == pytest.approx(v.var(ddof=1), rel=1e-9)
        assert entry.spatial_variance == pytest.approx(numbers.mean(0).var(ddof=1), rel=1e-12)
        assert entry.frame_mean_variance == pytest.approx(numbers.mean(1).var(ddof=1), rel=1e-9)


def test_totals_above_64_bits_do_not_overflow():
    """2^15 full-scale frames of 64 pixels: the sum of S^2 is 2^68."""
    sums = FrameSums((8, 8))
    sums.add(np.full((1 << 15, 8, 8), 65_535, np.uint16))
    totals = sums.label_totals()[0]
    assert totals.pixel_squares == 64 * (65_535 << 15) ** 2 > 1 << 64
    assert totals.squares == (64 << 15) * 65_535**2
    assert totals.temporal_variance == 0.0
    assert totals.pixel_variance == 0.0
    with pytest.raises(ValueError, match="at most 32768"):
        sums.add(np.full((8, 8), 65_535, np.uint16))


def test_pixel_variance_ignores_shifts_of_whole_frames():
    """Shifting whole frames leaves it unchanged; for two frames it is EMVA 1288's pair formula."""
    frames = stack(top=1000, seed=3)
    shifts = np.array([0, 40, 3, 100, 7, 7, 250], np.uint16)[:, None, None]
    before = FrameSums(frames.shape[1:]).add(frames).label_totals()[0]
    after = FrameSums(frames.shape[1:]).add(frames + shifts).label_totals()[0]
    assert after.pixel_variance == pytest.approx(before.pixel_variance, rel=1e-12)
    assert after.temporal_variance > 1.05 * before.temporal_variance

    first, second = frames[:2].astype(float)
    pair = FrameSums(frames.shape[1:]).add(frames[:2]).label_totals()[0]
    emva = 0.5 * ((first - second) ** 2).mean() - 0.5 * (first.mean() - second.mean()) ** 2
    pixels = first.size
    assert pair.pixel_variance == pytest.approx(emva * pixels / (pixels - 1), rel=1e-12)


def test_order_and_grouping_of_frames_do_not_matter():
    frames = stack(n=12, seed=5)
    whole = FrameSums(frames.shape[1:], BAYER).add(frames)
    parts = [FrameSums(frames.shape[1:], BAYER).add(frames[i::3]) for i in range(3)]
    for order in ([0, 1, 2], [2, 0, 1]):
        merged = parts[order[0]].merge(parts[order[1]]).merge(parts[order[2]])
        assert merged.count == whole.count
        assert np.array_equal(merged.sum, whole.sum)
        assert np.array_equal(merged.sum_of_squares, whole.sum_of_squares)
        assert merged.label_totals() == whole.label_totals()


def test_slices_and_fortran_order_are_accepted():
    frames = stack(n=2, shape=(8, 8), seed=8)
    plain = FrameSums((4, 8)).add(np.ascontiguousarray(frames[:, ::2]))
    sliced = FrameSums((4, 8)).add(np.asfortranarray(frames)[:, ::2])
    assert np.array_equal(plain.sum, sliced.sum)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("cols", [1, 2, 63, 64, 4095, 4096, 4097, 8193])
@pytest.mark.parametrize("tile", [BAYER, np.array([[0, 1, 2], [1, 2, 0]]), np.array([[0]])], ids=["2", "3", "1"])
def test_every_width_tile_and_number_of_frames(dtype, cols, tile):
    """Run ends and partial frame groups; squares that need 32 bits next to squares that do not."""
    n = 1 + cols % 17
    frames = stack(n=n, shape=(3, cols), top=256 if dtype == np.uint8 else 4096, seed=cols, dtype=dtype)
    if dtype == np.uint16:
        frames[0, 0, :: max(cols // 5, 1)] = 65_535
    sums = FrameSums((3, cols), tile, black=9, white=200).add(frames)
    wide = frames.astype(np.int64)
    assert np.array_equal(sums.sum, wide.sum(0))
    assert np.array_equal(sums.sum_of_squares, (wide**2).sum(0))
    assert sums.highest == wide.max((1, 2)).tolist()
    labels = label_map(tile, (3, cols))
    for k, entry in enumerate(sums.label_totals()):
        chosen = wide[:, labels == k]
        assert (entry.pixels, entry.total) == (chosen.shape[1], chosen.sum())
        assert entry.frame_squares == (chosen.sum(1) ** 2).sum()
        assert (entry.low, entry.high) == ((chosen <= 9).sum(), (chosen >= 200).sum())


def test_every_way_to_add_frames_gives_the_same_sums():
    """One by one, as a list, from an iterator, of mixed types, at unaligned addresses, read-only."""
    frames = stack(n=19, shape=(5, 30), top=256, seed=4)
    whole = FrameSums((5, 30), BAYER).add(frames).label_totals()

    one_by_one = FrameSums((5, 30), BAYER)
    for frame in frames:
        one_by_one.add(frame)
    shifted = np.empty(frames.size + 1, np.uint16)[1:].reshape(frames.shape)
    shifted[:] = frames
    shifted.flags.writeable = False
    mixed = [frame.astype(np.uint8) if k % 3 else frame for k, frame in enumerate(frames)]
    others = [FrameSums((5, 30), BAYER).add(given) for given in (list(frames), iter(frames), shifted, mixed)]
    for sums in (one_by_one, *others):
        assert sums.label_totals() == whole


def test_mean_frame_uses_the_smallest_type():
    frames = stack(n=16, top=4096, seed=6)
    sums = FrameSums(frames.shape[1:], BAYER).add(frames)
    kept = sums.mean_frame()
    assert kept.sum.dtype == np.uint16
    assert np.array_equal(kept[:], sums.mean())
    kept = sums.add(np.full((1, *sums.shape), 4095, np.uint16)).mean_frame()
    assert kept.sum.dtype == np.uint32
    assert np.array_equal(kept[:], sums.mean())


class Stored:
    """A frame of which rows are read."""

    place = None

    def __init__(self, dn):
        self.dn, self.shape = dn, dn.shape

    def read_rows(self, first, out):
        out[:] = self.dn[first : first + len(out)]


def stored(folder, frames):
    found = []
    for k, frame in enumerate(frames):
        path = folder / f"{k}.raw"
        path.write_bytes(b"head" + frame.tobytes())
        found.append(StoredRows(path, 4, frame.shape))
    return found


def test_a_mean_frame_stays_when_the_sums_change():
    frames = stack(n=16, top=4096, seed=6)
    for white, scale in ((4095, 1), (4095, 4), (65_535, 1)):  # the second holds numbers above `white`
        sums = FrameSums(frames.shape[1:], BAYER, white=white)
        kept = sums.add_last([Stored(frame * np.uint16(scale)) for frame in frames]).mean_frame()
        expected = frames.mean(axis=0) * scale
        assert np.array_equal(kept[:], expected)
        sums.clear().add_last([Stored(frame // 2) for frame in frames])
        sums.clear().add(frames // 3)
        assert np.array_equal(sums.sum, (frames // 3).sum(axis=0))
        assert np.array_equal(kept[:], expected)


@pytest.mark.parametrize("tile", [np.zeros((1, 1), int), BAYER, np.array([[0], [1], [1]])], ids=("1", "Bayer", "rows"))
@pytest.mark.parametrize(("count", "bits"), [(1, 16), (2, 15), (4, 14), (9, 14), (5, 12), (16, 12), (35, 12)])
def test_totals_of_frames_in_files_are_exact_up_to_full_scale(tmp_path, tile, count, bits):
    white = (1 << bits) - 1
    frames = stack(n=count, shape=(37, 4100), top=white + 1)
    frames[:, 3:5], frames[:, 20, 7:9] = white, 0
    frames[:, 30, ::3] = np.array([0, white])[np.arange(count) % 2][:, None]
    found = FrameSums((37, 4100), tile, white=white).add_last(stored(tmp_path, frames))
    expected = FrameSums((37, 4100), tile, white=white).add(frames)
    assert np.array_equal(found.sum, expected.sum)
    assert found.highest == expected.highest
    assert found.label_totals() == expected.label_totals()


@pytest.mark.parametrize(("count", "top", "cols"), [(2, 4095, 64), (12, 4095, 4100), (12, 4095, 63), (12, 40_000, 64)])
def test_variances_of_frames_in_files_are_exact(tmp_path, count, top, cols):
    """Whole numerators where sums have 16 bits, with the variances of the plain sums bit by bit; else none."""
    frames = stack(n=count, shape=(37, cols), top=top + 1)
    frames[:, 3, 2] = np.array([0, top])[np.arange(count) % 2]
    sums = FrameSums((37, cols), BAYER)
    numerators = sums.numerators(stored(tmp_path, frames), int(frames.max()))
    if cols % 2 or count * int(frames.max()) >= 1 << 16:
        assert numerators is None
    else:
        expected = FrameSums((37, cols)).add(frames).variance()
        assert np.array_equal(numerators / (count * (count - 1.0)), expected)
    assert sums.numerators(list(frames), top) is None


def test_sums_have_16_bits_where_the_numbers_that_are_expected_fit(tmp_path):
    frames = stack(n=4, shape=(20, 64), top=16_000)
    found = FrameSums((20, 64)).add_last(stored(tmp_path, frames), full_scale=int(frames.max()))
    expected = FrameSums((20, 64)).add(frames)
    assert found.sum.dtype == np.uint16
    assert np.array_equal(found.sum, expected.sum)
    assert found.label_totals() == expected.label_totals()


@pytest.mark.parametrize("expected_top", [None, 2000])
@pytest.mark.parametrize("count", [3, 40])
def test_frames_in_files_with_numbers_above_full_scale(tmp_path, count, expected_top):
    frames = stack(n=count, shape=(20, 64))  # of 16 bits
    found = FrameSums((20, 64), BAYER, white=1023).add_last(stored(tmp_path, frames), expected_top)
    expected = FrameSums((20, 64), BAYER, white=1023).add(frames)
    assert np.array_equal(found.sum, expected.sum)
    assert found.highest == expected.highest
    assert found.label_totals() == expected.label_totals()


def test_frame_means():
    frames = stack(n=4, seed=9)
    means = FrameSums(frames.shape[1:], BAYER).add(frames).frame_means()
    labels = label_map(BAYER, frames.shape[1:])
    expected = [[frame[labels == k].mean() for k in range(3)] for frame in frames.astype(float)]
    np.testing.assert_allclose(means, expected, rtol=1e-14)


def test_invalid_frames_are_rejected():
    sums = FrameSums((4, 4))
    with pytest.raises(ValueError, match=r"\(4, 5\)"):
        sums.add(np.zeros((4, 5), np.uint16))
    with pytest.raises(ValueError, match="float64"):
        sums.add(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="merged"):
        sums.merge(FrameSums((4, 4), white=4095))
    assert sums.count == 0


def test_cleared_sums_hold_only_later_frames() -> None:
    rng = np.random.default_rng(5)
    first, second = rng.integers(0, 4096, (2, 11, 37, 50)).astype(np.uint16)
    again = FrameSums((37, 50), white=4095).add(first).clear().add(second)
    fresh = FrameSums((37, 50), white=4095).add(second)
    assert np.array_equal(again.sum, fresh.sum)
    assert np.array_equal(again.sum_of_squares, fresh.sum_of_squares)
    assert again.label_totals() == fresh.label_totals()
    assert again.frame_totals() == fresh.frame_totals() == second.sum(axis=(1, 2), dtype=np.uint64).tolist()


def test_mean_frame_owns_its_memory() -> None:
    sums = FrameSums((2, 3)).add(np.full((4, 2, 3), 60_000, np.uint16))
    kept = sums.mean_frame()
    sums.clear().add(np.zeros((2, 3), np.uint16))
    assert kept[:].tolist() == [[60_000.0] * 3] * 2


def test_maps_fill_the_given_array() -> None:
    stack = np.random.default_rng(6).integers(0, 1000, (5, 8, 9)).astype(np.uint16)
    sums, out = FrameSums((8, 9)).add(stack), np.full((8, 9), np.nan)
    assert sums.mean(out) is out
    assert np.array_equal(out, sums.mean())
    assert np.array_equal(sums.variance(out), sums.variance())
    for wrong in (np.empty((9, 8)), np.empty((8, 9), np.float32)):
        with pytest.raises(ValueError, match=r"out must be \(8, 9\) of float64"):
            sums.mean(wrong)
