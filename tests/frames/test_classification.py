"""Classification of frames as dark or light by their level."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError, PhotositeWarning
from photosite.frames.frame_set import FrameSource
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.from_files import DARK_SPREADS, LIGHT_SPREADS, classify_by_level
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame

SPREAD = 4.0


def frame(level, seed=0, hot=0):
    dn = np.random.default_rng(seed).normal(level, SPREAD, (60, 80)).round().clip(0, 4095).astype(np.uint16)
    dn.flat[:hot] = 4095
    return dn


def candidate(level, kind=None, gain=None, seed=0, hot=0, name="a"):
    dn = frame(level, seed, hot)
    return FrameSource(name, lambda: dn), FrameSettings(kind, gain_setting=gain)


def kinds(frames, bits=12):
    return [settings.kind for settings in classify_by_level(frames, bits)[0]]


def test_dark_and_light_of_each_gain_setting():
    """Dark frames at the higher gain have the level of light frames at the lower gain."""
    frames = [
        candidate(level, gain=gain, seed=n)
        for n, (level, gain) in enumerate([(64, 100), (200, 100), (64, 100), (200, 400), (1000, 400), (201, 400)])
    ]
    settings, warning = classify_by_level(frames, 12)
    assert [s.kind for s in settings] == ["dark", "light", "dark", "dark", "light", "dark"]
    assert "4 dark (mean 6" in warning.what
    assert "2 light" in warning.what


def test_frames_known_to_be_dark_are_the_reference():
    """Without a known dark frame the dimmest light frame is classified as dark."""
    lights = [candidate(level, seed=n) for n, level in enumerate((100, 200, 400))]
    assert kinds(lights) == ["dark", "light", "light"]
    known = candidate(64, "dark", seed=9)
    assert kinds([*lights, known]) == ["light", "light", "light", "dark"]


def test_known_kinds_need_no_reading_and_no_warning():
    def fail():
        raise AssertionError

    frames = [(FrameSource("a", fail), FrameSettings(kind)) for kind in ("dark", "light")]
    assert classify_by_level(frames, 12) == ([FrameSettings("dark"), FrameSettings("light")], None)


def test_hot_pixels_do_not_widen_the_reference():
    """1 % of hot pixels make the standard deviation 100 times as large."""
    frames = [candidate(64, hot=48), candidate(64 + 41 + 1.5 * LIGHT_SPREADS * SPREAD, seed=1)]
    assert kinds(frames) == ["dark", "light"]


@pytest.mark.parametrize(
    ("spreads", "kind"),
    [(0.9 * DARK_SPREADS, "dark"), (1.3 * LIGHT_SPREADS, "light"), (2.0, None), (0.8 * LIGHT_SPREADS, None)],
)
def test_levels_between_the_limits(spreads, kind):
    frames = [candidate(64), candidate(64 + spreads * SPREAD, seed=1, name="b.tif")]
    if kind:
        assert kinds(frames) == ["dark", kind]
        return
    with raises(FileError, "the frame can be dark or light", path="b.tif"):
        classify_by_level(frames, 12)


def test_bright_frames_without_a_dark_one():
    with raises(FileError, "the darkest frame has a mean of 1100"):
        classify_by_level([candidate(1100), candidate(2000)], 12)


def put(folder, name, level, seed, **metadata):
    RawFrame(frame(level, seed), bits=12, exposure_s=0.1, metadata=MappingProxyType(metadata)).save(folder / name)


def test_classifying_a_folder_gives_a_warning(tmp_path):
    for n, level in enumerate((64, 300, 64, 300)):
        put(tmp_path, f"DSC_{n}.png", level, n)
    with pytest.warns(PhotositeWarning, match="classified by level: 2 dark .* and 2 light") as caught:
        frames = open_frames(tmp_path)
    assert len(caught) == 1
    assert [(g.kind, [s.name[-5] for s in g.frames]) for g in frames.groups] == [
        ("dark", ["0", "2"]),
        ("light", ["1", "3"]),
    ]
    assert "classified by level" in frames.warnings[0]


def test_patterns_override_metadata(tmp_path):
    for n, level in enumerate((64, 300, 64, 300)):
        put(tmp_path, f"DSC_{n}.png", level, n, kind="light")
    frames = open_frames(tmp_path, dark=["DSC_0*", "*_2.png"])
    assert [len(group) for group in frames.groups] == [2, 2]
    frames = open_frames(tmp_path, dark="*_[02].*", light="*_[13].*")
    assert [group.kind for group in frames.groups] == ["dark", "light"]
    with raises(FileError, "pattern", value="IMG*"):
        open_frames(tmp_path, dark="IMG*")
    with raises(FileError, "dark and light patterns match", path=str(tmp_path / "DSC_1.png")):
        open_frames(tmp_path, dark="DSC_1*", light="*.png")
