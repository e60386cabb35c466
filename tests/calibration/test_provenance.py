"""Digests of the frames used are computed on request, and never from changed frames."""

import hashlib

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.provenance import UsedFrame, frames_sha256
from photosite.errors import FileError
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource


def test_the_digest_is_that_of_little_endian_words_row_by_row() -> None:
    dn = np.arange(12, dtype=np.uint16).reshape(3, 4) * 300
    expected = hashlib.sha256(b"".join(int(n).to_bytes(2, "little") for n in dn.ravel())).hexdigest()
    for array in (dn, np.asfortranarray(dn), dn.astype(">u2")):
        assert frames_sha256([UsedFrame(FrameSource("f", lambda a=array: a), int(dn.sum()))]) == (expected,)


@pytest.mark.parametrize("thread_safe", [True, False])
def test_a_frame_that_changed_after_it_was_used_has_no_digest(thread_safe: bool) -> None:
    dn = np.full((4, 4), 7, np.uint16)
    used = UsedFrame(FrameSource("a.tif", lambda: dn, thread_safe), int(dn.sum()))
    before = frames_sha256([used])
    assert frames_sha256([used]) == before
    dn[2, 1] += 1
    with pytest.raises(FileError) as caught:
        frames_sha256([used])
    assert caught.value.path == "a.tif"


def test_repeats_and_near_copies_are_left_out() -> None:
    rng = np.random.default_rng(3)
    stack = rng.integers(60, 70, (6, 64, 32)).astype(np.uint16)
    stack[3] = stack[1]
    stack[4] = stack[1]
    stack[4][63, 5] += 1  # one pixel of a row that is not sampled
    lit = rng.integers(200, 230, (2, 4, 64, 32)).astype(np.uint16) + np.array([0, 90], np.uint16)[:, None, None, None]

    def group(kind: str, exposure_s: float, frames: np.ndarray) -> FrameGroup:
        return FrameGroup(
            kind, exposure_s, tuple(FrameSource(f"{kind}-{i}", lambda dn=dn: dn) for i, dn in enumerate(frames))
        )

    groups = (group("dark", 0.01, stack), group("light", 0.01, lit[0]), group("light", 0.02, lit[1]))
    calibration = calibrate(FrameSet(groups, rows=64, cols=32, bits=12))
    assert [line.split(" repeats dark-1")[0] for line in calibration.rejected] == ["dark-3", "dark-4"]
    assert calibration.frame_count == 12 == len(calibration.frames_sha256)
