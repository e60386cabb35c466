"""The same frame twice is no stack."""

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.validation.validate import check_repeats, validate
from photosite.values.region import Region


def frame(seed):
    return RawFrame(np.random.default_rng(seed).poisson(400, (40, 40)).astype(np.uint16), bits=12)


def test_identical_frames_are_named():
    with pytest.raises(InputError, match=r"frames 1 and 3 are identical in every pixel"):
        check_repeats([frame(1), frame(2), frame(1)])
    with pytest.raises(InputError, match=r"frames a\.tif and b\.tif are identical"):
        check_repeats([frame(1), frame(1)], ["a.tif", "b.tif"])
    with pytest.raises(InputError, match="frames 1 and 2 are identical"):
        validate([frame(1), frame(1)], frame(2), chart=None, regions=[Region("all", 0, 40, 0, 40)])


def test_repeats_pass():
    check_repeats([frame(1)])
    check_repeats([frame(1), frame(2)])
    even = RawFrame(np.full((4, 4), 7, np.uint16), bits=12)
    check_repeats([even, even])
