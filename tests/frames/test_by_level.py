"""Dark or light by level: what is told, what is refused, and that it is said."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.by_level import DARK_SPREADS, LIGHT_SPREADS, Candidate, told_by_level
from photosite.frames.frame_set import FrameSource
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame

SPREAD = 4.0


def frame(level, seed=0, hot=0):
    dn = np.random.default_rng(seed).normal(level, SPREAD, (60, 80)).round().clip(0, 4095).astype(np.uint16)
    dn.flat[:hot] = 4095
    return dn


def candidate(level, kind=None, gain=None, seed=0, hot=0, name="a"):
    dn = frame(level, seed, hot)
    return Candidate(FrameSource(name, lambda: dn), gain, kind)


def test_dark_and_light_of_each_gain_setting():
    """At the higher gain the darks are where the lights of the lower one are."""
    frames = [
        candidate(level, gain=gain, seed=n)
        for n, (level, gain) in enumerate([(64, 100), (200, 100), (64, 100), (200, 400), (1000, 400), (201, 400)])
    ]
    kinds, notes = told_by_level(frames, 12)
    assert kinds == ["dark", "light", "dark", "dark", "light", "dark"]
    assert len(notes) == 1
    assert "4 as dark (mean 6" in notes[0]
    assert "2 as light" in notes[0]


def test_frames_known_to_be_dark_are_the_reference():
    """Without them the dimmest light would pass for a dark frame."""
    lights = [candidate(level, seed=n) for n, level in enumerate((100, 200, 400))]
    assert told_by_level(lights, 12)[0] == ["dark", "light", "light"]
    known = candidate(64, "dark", seed=9)
    assert told_by_level([*lights, known], 12)[0] == ["light", "light", "light", "dark"]


def test_nothing_is_read_or_said_where_kinds_are_known():
    def fail():
        raise AssertionError

    frames = [Candidate(FrameSource("a", fail), None, kind) for kind in ("dark", "light")]
    assert told_by_level(frames, 12) == (["dark", "light"], ())


def test_hot_pixels_do_not_widen_the_reference():
    """1 % of hot pixels make the standard deviation 100 times what the others have."""
    frames = [candidate(64, hot=48), candidate(64 + 41 + 1.5 * LIGHT_SPREADS * SPREAD, seed=1)]
    assert told_by_level(frames, 12)[0] == ["dark", "light"]


@pytest.mark.parametrize(
    ("spreads", "kind"),
    [(0.9 * DARK_SPREADS, "dark"), (1.3 * LIGHT_SPREADS, "light"), (2.0, None), (0.8 * LIGHT_SPREADS, None)],
)
def test_what_lies_between_is_refused(spreads, kind):
    frames = [candidate(64), candidate(64 + spreads * SPREAD, seed=1, name="b.tif")]
    if kind:
        assert told_by_level(frames, 12)[0] == ["dark", kind]
        return
    with pytest.raises(FileError, match=r"b\.tif: dark or light\? Neither .* above the darkest frames' 6.*--dark and"):
        told_by_level(frames, 12)


def test_bright_frames_alone_are_no_darks():
    with pytest.raises(FileError, match=r"reads 1100.* too much for a dark frame, and it is the darkest"):
        told_by_level([candidate(1100), candidate(2000)], 12)


def put(folder, name, level, seed, **metadata):
    RawFrame(frame(level, seed), bits=12, exposure_s=0.1, metadata=MappingProxyType(metadata)).save(folder / name)


def test_a_folder_is_told_by_level_and_says_so(tmp_path):
    for n, level in enumerate((64, 300, 64, 300)):
        put(tmp_path, f"DSC_{n}.png", level, n)
    with pytest.warns(PhotositeWarning, match="dark or light was told by level.*2 as dark .* and 2 as light") as caught:
        frames = open_frames(tmp_path)
    assert len(caught) == 1
    assert [(g.kind, [s.name[-5] for s in g.frames]) for g in frames.groups] == [
        ("dark", ["0", "2"]),
        ("light", ["1", "3"]),
    ]
    assert "told by level" in frames.notes[0]


def test_patterns_stand_before_everything(tmp_path):
    for n, level in enumerate((64, 300, 64, 300)):
        put(tmp_path, f"DSC_{n}.png", level, n, kind="light")
    frames = open_frames(tmp_path, dark=["DSC_0*", "*_2.png"])
    assert [len(group) for group in frames.groups] == [2, 2]
    frames = open_frames(tmp_path, dark="*_[02].*", light="*_[13].*")
    assert [group.kind for group in frames.groups] == ["dark", "light"]
    with pytest.raises(FileError, match=r"no frame matches the pattern 'IMG\*'; there is DSC_0\.png, say"):
        open_frames(tmp_path, dark="IMG*")
    with pytest.raises(FileError, match=r"DSC_1\.png: matches dark and light patterns, 'DSC_1\*' and '\*\.png'"):
        open_frames(tmp_path, dark="DSC_1*", light="*.png")
