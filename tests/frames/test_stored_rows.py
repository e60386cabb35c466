"""Rows of uncompressed frames: the same numbers as of the whole frame, and errors where the file has changed."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile

import photosite as ps
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.reduce import reduce_frames
from photosite.engine.frame_sums import FrameSums
from photosite.errors import FileError
from photosite.files import small_files
from photosite.frames.stored_rows import StoredRows

BAYER = np.array([[0, 1], [1, 2]])
SHAPE = (70, 50)


def stack(count, seed=1):
    return np.random.default_rng(seed).integers(100, 4000, (count, *SHAPE), dtype=np.uint16)


def frame_set(folder, frames, **written):
    for number, dn in enumerate(frames):
        tifffile.imwrite(folder / f"dark_{number:02d}.tif", dn, photometric="minisblack", **written)
    entries = "- {kind: dark, exposure: 1/100, files: dark*.tif}"
    (folder / "protocol.yaml").write_text(f"photosite_protocol: 1\nbits: 12\ncfa: rggb\nframes:\n{entries}\n")
    return ps.open_frames(folder)


@pytest.fixture(params=[small_files.SETTLED_NS, -1], ids=["just written", "settled"])
def age(request, monkeypatch):
    """The times of a file identify its content only when it is old enough; tests do not wait."""
    monkeypatch.setattr(small_files, "SETTLED_NS", request.param)


@pytest.mark.usefixtures("age")
@pytest.mark.parametrize("written", [{}, {"rowsperstrip": 7}], ids=["one strip", "many strips"])
def test_rows_are_those_of_the_frame(tmp_path, written):
    frames = stack(3)
    (group,) = frame_set(tmp_path, frames, **written).groups
    for source, dn in zip(group.frames, frames, strict=True):
        rows = source.open_rows()
        assert rows.shape == SHAPE
        part = np.empty((5, SHAPE[1]), np.uint16)
        rows.read_rows(9, part)
        np.testing.assert_array_equal(part, dn[9:14])
        np.testing.assert_array_equal(rows.take_rows([60, 3]), dn[[60, 3]])
        np.testing.assert_array_equal(rows.read(), dn)


@pytest.mark.usefixtures("age")
@pytest.mark.parametrize("written", [{"compression": "zlib"}, {"byteorder": ">"}, {"tile": (16, 16)}], ids=str)
def test_other_frames_are_read_whole(tmp_path, written):
    frames = stack(2)
    (group,) = frame_set(tmp_path, frames, **written).groups
    assert group.frames[0].open_rows() is None
    np.testing.assert_array_equal(group.frames[1].read(), frames[1])


@pytest.mark.parametrize("tile", [BAYER, np.arange(36).reshape(6, 6) % 3], ids=["Bayer", "6 x 6"])
def test_sums_of_rows_are_those_of_arrays(tmp_path, tile, monkeypatch):
    frames = stack(11)
    monkeypatch.setattr("photosite.engine.frame_sums._READ_BYTES", 1)  # one band at a time
    (group,) = frame_set(tmp_path, frames).groups
    opened = [source.open_rows() for source in group.frames]
    whole = FrameSums(SHAPE, tile, white=3990).add(frames)
    for sums in (
        FrameSums(SHAPE, tile, white=3990).add(opened),
        FrameSums(SHAPE, tile, white=3990).add([*frames[:4]]).add(opened[4:]),
        FrameSums(SHAPE, tile, white=3990).add([frames[0], *opened[1:]]),
    ):
        np.testing.assert_array_equal(sums.sum_of_squares, whole.sum_of_squares)
        np.testing.assert_array_equal(sums.sum, whole.sum)
        assert sums.highest == whole.highest
        assert sums.label_totals() == whole.label_totals()
    totals = FrameSums(SHAPE, tile, white=3990).add_last(frames).label_totals()
    for mixed in (opened, [*frames[:2], *opened[2:]], [*opened[:2], *frames[2:]]):
        assert FrameSums(SHAPE, tile, white=3990).add_last(mixed).label_totals() == totals


@pytest.mark.parametrize("white", [4095, 20_000], ids=["12 bits", "above full scale"])
@pytest.mark.parametrize("tile", [BAYER, np.arange(36).reshape(6, 6) % 3], ids=["Bayer", "6 x 6"])
def test_numbers_of_watched_pixels_are_those_of_the_frames(tmp_path, tile, white):
    frames = stack(11)
    frames[3, 20, 7] = white
    (group,) = frame_set(tmp_path, frames).groups
    opened = [source.open_rows() for source in group.frames]
    at = np.array([0, 3, 50, 777, 1007, 3499])
    sums = FrameSums(SHAPE, tile, white=3990)
    for added in (opened, frames, [*frames[:4], *opened[4:]]):
        sums.clear().watch(at)
        np.testing.assert_array_equal(sums.add_last(added).watched_numbers(), frames.reshape(11, -1)[:, at])
    sums.clear().watch(at[1:])
    numbers = sums.add(opened[:5]).add(opened[5:]).watched_numbers()
    np.testing.assert_array_equal(numbers, frames.reshape(11, -1)[:, at[1:]])


def test_stored_and_compressed_frames_give_the_same_reduction(tmp_path):
    frames = stack(5)
    found = []
    for number, written in enumerate(({}, {"compression": "zlib"})):
        folder = tmp_path / str(number)
        folder.mkdir()
        with FrameReader(frame_set(folder, frames, **written)) as reader:
            found.append(reduce_frames(reader))
    assert found[0].darks[0].levels == found[1].darks[0].levels
    assert found[0].darks[0].frame_means == found[1].darks[0].frame_means


@pytest.mark.usefixtures("age")
def test_a_file_that_was_cut_off_is_an_error(tmp_path):
    frames = frame_set(tmp_path, stack(3))
    source = frames.groups[0].frames[1]
    rows = source.open_rows()
    with source.path.open("r+b") as file:
        file.truncate(2000)
    with pytest.raises(FileError) as error:
        rows.read()
    assert error.value.path == str(source.path)
    with pytest.raises(FileError) as error:
        ps.calibrate(frames)
    assert error.value.path == str(source.path)


@pytest.mark.usefixtures("age")
def test_a_file_of_another_size_or_depth_is_an_error(tmp_path):
    frames = frame_set(tmp_path, stack(3))
    source = frames.groups[0].frames[1]
    tifffile.imwrite(source.path, np.zeros((8, 8), np.uint16), photometric="minisblack")
    with pytest.raises(FileError) as error:
        source.open_rows()
    assert error.value.path == str(source.path)
    tifffile.imwrite(source.path, np.full(SHAPE, 5000, np.uint16), photometric="minisblack")
    with pytest.raises(FileError) as error:
        ps.calibrate(frames)
    assert error.value.path == str(source.path)


@pytest.mark.usefixtures("age")
def test_a_replaced_file_is_read_where_its_pixels_are_now(tmp_path):
    frames = stack(3)
    source = frame_set(tmp_path, frames).groups[0].frames[1]
    tifffile.imwrite(source.path, frames[2], photometric="minisblack", description="another header " * 50)
    np.testing.assert_array_equal(source.open_rows().read(), frames[2])


def test_single_numbers_are_those_of_the_frame(tmp_path):
    """A file of odd offset, cut off within and before the rows that are read."""
    dn = np.random.default_rng(5).integers(0, 4096, (7, 9)).astype(np.uint16)
    path, row, col = tmp_path / "frame.raw", np.array([6, 0, 3, 3]), np.array([8, 0, 5, 5])
    path.write_bytes(b"\0" * 33 + dn.tobytes())
    assert np.array_equal(StoredRows(path, 33, dn.shape).numbers_at(row, col), dn[row, col])
    path.write_bytes(path.read_bytes()[:-4])
    stored = StoredRows(path, 33, dn.shape)
    assert np.array_equal(stored.numbers_at(row[1:], col[1:]), dn[row[1:], col[1:]])
    with pytest.raises(FileError, match="truncated"):
        stored.numbers_at(row, col)
