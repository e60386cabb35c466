"""Frame sets in memory: grouping, order, invalid input."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import FrameSettings
from photosite.values.cfa import cfa_from


def frame(value: int, shape=(2, 3)) -> np.ndarray:
    return np.full(shape, value, np.uint16)


def test_groups_are_sorted_by_kind_exposure_and_photons():
    frames = FrameSet.from_arrays(
        [
            ("light", 0.2, frame(1), 900.0),
            ("light", 0.1, frame(2), 500.0),
            ("dark", 0.2, frame(3)),
            ("light", 0.1, frame(4), 100.0),
            ("light", 0.1, frame(5), 500.0),
            ("dark", 0.1, frame(6)),
            ("dark", 0.2, frame(7)),
            ("light", 0.1, frame(8)),
        ],
        bits=12,
    )
    seen = [(g.kind, g.exposure_s, g.photons_per_pixel, [int(dn[0, 0]) for dn in g]) for g in frames.groups]
    assert seen == [
        ("dark", 0.1, None, [6]),
        ("dark", 0.2, None, [3, 7]),
        ("light", 0.1, None, [8]),
        ("light", 0.1, 100.0, [4]),
        ("light", 0.1, 500.0, [2, 5]),
        ("light", 0.2, 900.0, [1]),
    ]
    assert (frames.rows, frames.cols, frames.bits, frames.frame_count, frames.source) == (2, 3, 12, 8, "memory")
    assert [g.exposure_s for g in frames.of_kind("dark")] == [0.1, 0.2]


def test_gain_settings_separate_groups_and_temperatures_do_not():
    frames = FrameSet.from_arrays(
        [
            ("dark", 0.1, frame(1), None, 400.0, 20.5),
            ("dark", 0.1, frame(2), None, None),
            ("dark", 0.1, frame(3), None, 100.0),
            ("dark", 0.1, frame(4), None, 400.0, 21.5),
            ("dark", 0.1, frame(5), None, 400.0),
        ],
        bits=12,
    )
    seen = [(g.gain_setting, g.temperature_c, [int(dn[0, 0]) for dn in g]) for g in frames.groups]
    assert seen == [(None, None, [2]), (100.0, None, [3]), (400.0, 21.0, [1, 4, 5])]
    assert frames.gain_settings == (None, 100.0, 400.0)
    one = frames.at_gain(400)
    assert (one.gain_settings, one.frame_count, one.source) == ((400.0,), 3, "memory (gain 400)")
    assert one.at_gain(400) is one
    assert frames.at_gain(None).source == "memory (gain not stated)"
    with raises(InputError, "gain_setting", value=200):
        frames.at_gain(200)


def test_groups_can_be_read_again_and_pickled():
    frames = FrameSet.from_arrays([("dark", 0.1, frame(6))], bits=12, cfa=cfa_from("rggb"))
    again = pickle.loads(pickle.dumps(frames))
    for one in (frames, frames, again):
        assert [int(dn.sum()) for dn in one.groups[0]] == [36]
    assert again.cfa == cfa_from("rggb")


NAN, INFINITY = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("entries", "what"),
    [
        ([], "a frame set needs at least one frame"),
        ([("dark", 0.1, frame(1)), ("dark", 0.1, frame(1, (3, 2)))], "dn.shape"),
        ([("dark", 0.1, frame(1).astype(np.float32))], "dn"),
        ([("dark", 0.1, frame(1)[0])], "dn"),
        ([("dark", 0.1, frame(4096))], "dn"),
        ([("drak", 0.1, frame(1))], "kind"),
        ([("light", 0.0, frame(1))], "exposure_s"),
        ([("dark", NAN, frame(1))], "exposure_s"),
        ([("light", 0.1, frame(1), -3.0)], "photons_per_pixel"),
        ([("light", 0.1, frame(1), NAN)], "photons_per_pixel"),
        ([("light", 0.1, frame(1), None, -100.0)], "gain_setting"),
        ([("light", 0.1, frame(1), None, INFINITY)], "gain_setting"),
        ([("dark", 0.1, frame(1), None, None, -300.0)], "temperature_c"),
        ([("dark", 0.1, frame(1), None, None, NAN)], "temperature_c"),
        ([("dark", 0.1, frame(1), None, None, 20.0, 1.0)], "frames[0]"),
    ],
)
def test_invalid_frames(entries, what):
    with raises(InputError, what):
        FrameSet.from_arrays(entries, bits=12)


def test_bits_out_of_range():
    with raises(InputError, "bits", value=0):
        FrameSet.from_arrays([("dark", 0.1, frame(1))], bits=0)


def test_settings_of_a_source_override_those_of_the_next():
    protocol, metadata = FrameSettings("dark", gain_setting=0.0), FrameSettings("light", 0.1, 5.0, 100.0)
    assert protocol.or_else(metadata) == FrameSettings("dark", 0.1, 5.0, 0.0)
