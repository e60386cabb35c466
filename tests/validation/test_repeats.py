"""The same frame twice is no stack."""

import numpy as np
from raising import raises

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.validation.validate import check_repeats, validate
from photosite.values.region import Region


def frame(seed):
    return RawFrame(np.random.default_rng(seed).poisson(400, (40, 40)).astype(np.uint16), bits=12)


def test_identical_frames_are_named():
    with raises(InputError, "measured frames"):
        check_repeats([frame(1), frame(2), frame(1)])
    with raises(InputError, "measured frames a.tif and"):
        check_repeats([frame(1), frame(1)], ["a.tif", "b.tif"])
    with raises(InputError, "measured frames"):
        validate([frame(1), frame(1)], frame(2), chart=None, regions=[Region("all", 0, 40, 0, 40)])


def test_repeats_pass():
    check_repeats([frame(1)])
    check_repeats([frame(1), frame(2)])
    even = RawFrame(np.full((4, 4), 7, np.uint16), bits=12)
    check_repeats([even, even])
