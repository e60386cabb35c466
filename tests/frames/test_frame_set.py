"""Frames in memory: grouping, order, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.frames.frame_set import frame_set_from_arrays
from photosite.values.cfa import cfa_from


def frame(value: int, shape=(2, 3)) -> np.ndarray:
    return np.full(shape, value, np.uint16)


def test_groups_by_kind_exposure_and_photons_in_their_order():
    frames = frame_set_from_arrays(
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


def test_gain_settings_part_groups_and_temperatures_do_not():
    frames = frame_set_from_arrays(
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
    with pytest.raises(InputError, match="no frames at gain setting 200; there are not stated, 100, 400"):
        frames.at_gain(200)


def test_a_group_can_be_read_again_and_sent_to_another_process():
    frames = frame_set_from_arrays([("dark", 0.1, frame(6))], bits=12, cfa=cfa_from("rggb"))
    again = pickle.loads(pickle.dumps(frames))
    for one in (frames, frames, again):
        assert [int(dn.sum()) for dn in one.groups[0]] == [36]
    assert again.cfa == cfa_from("rggb")


@pytest.mark.parametrize(
    ("entries", "why"),
    [
        ([], "there are none"),
        ([("dark", 0.1, frame(1)), ("dark", 0.1, frame(1, (3, 2)))], r"frame 1 .*is \(3, 2\).*before it \(2, 3\)"),
        ([("dark", 0.1, frame(1).astype(np.float32))], "frame 0 .*uint16"),
        ([("dark", 0.1, frame(1)[0])], r"\(rows, cols\)"),
        ([("dark", 0.1, frame(4096))], "frame 0 .*holds 4096 DN, which 12 bits cannot"),
        ([("drak", 0.1, frame(1))], "'dark' or 'light', not 'drak'"),
        ([("dark", 0.0, frame(1))], "above 0 s, not 0"),
        ([("dark", float("nan"), frame(1))], "above 0 s"),
        ([("light", 0.1, frame(1), -3.0)], "photons per pixel cannot be -3"),
        ([("light", 0.1, frame(1), float("nan"))], "photons per pixel cannot be nan"),
        ([("light", 0.1, frame(1), None, -100.0)], "the gain setting cannot be -100"),
        ([("light", 0.1, frame(1), None, float("inf"))], "the gain setting cannot be inf"),
        ([("dark", 0.1, frame(1), None, None, -300.0)], "temperature cannot be -300.0 degrees Celsius"),
        ([("dark", 0.1, frame(1), None, None, float("nan"))], "temperature cannot be nan"),
        ([("dark", 0.1, frame(1), None, None, 20.0, 1.0)], "frame 0: is .*up to three settings more"),
    ],
)
def test_what_is_refused(entries, why):
    with pytest.raises(InputError, match=why):
        frame_set_from_arrays(entries, bits=12)


def test_bits_out_of_range():
    with pytest.raises(InputError, match="1 to 16 bits, not 0"):
        frame_set_from_arrays([("dark", 0.1, frame(1))], bits=0)
