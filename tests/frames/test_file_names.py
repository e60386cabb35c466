"""Settings in the names of files and folders."""

from __future__ import annotations

from pathlib import Path

import pytest
from raising import raises

from photosite.errors import FileError, InputError
from photosite.frames.frame_settings import FrameSettings, exposure_by_pattern, kinds_in_name, settings_from_names


def settings(*names):
    return settings_from_names(Path("frame.tif"), names)


@pytest.mark.parametrize(
    ("name", "exposure_s"),
    [
        ("dark_1-8000s_001", 1 / 8000),
        ("dark 1-60s", 1 / 60),
        ("flat_10ms_iso400", 0.01),
        ("FLAT_0.04s_1", 0.04),
        ("flat-250us-3", 250e-6),
        ("flat_40000ns", 40e-6),
        ("flat_3µs", 3e-6),
        ("flat_exp5ms", 0.005),
        ("t=2.5s", 2.5),
        ("exposure_30sec", 30.0),
        ("flat_1e-3s", 1e-3),
        ("flat_exp0.001", 0.001),
        ("exposure_0,5_dark", 0.5),
        ("exp1.5ms_1", 0.0015),
        ("exp001", None),
        ("exp0.001x", None),
        ("flat_10_ms", 0.01),
        ("10ms", 0.01),
        ("flat_10ms_again_10ms", 0.01),
        ("dark_0,5s_1", 0.5),
        ("dark_1,5s", 1.5),
        ("dark_0,125s", 0.125),
        ("dark 2,50ms", 0.0025),
        ("t=0,04s", 0.04),
        ("flat_1,5e-3s", 0.0015),
        ("flat_10ms,iso400", 0.01),
        ("flat,10ms", 0.01),
        ("dark_01_30s", 30.0),
        ("dark_11_30s", 30.0),
        ("dark_1_0.5s", 0.5),
        ("dark_1_30ms", 0.03),
        ("dark_30s_1", 30.0),
        ("dark_1_1s", 1.0),
        ("flat_1e999999999s", None),
        ("b_000_snap_001", None),
        ("flats10", None),
        ("IMG_2024s3", None),
        ("flat_10mss", None),
        ("lens50mm_flat", None),
        ("flat_0s", None),
    ],
)
def test_exposures(name, exposure_s):
    assert settings(name).exposure_s == exposure_s


@pytest.mark.parametrize(
    "name",
    [
        "flat_10ms_20ms",
        "run-1-30s",  # 1/30 s, or run 1 at 30 s
        "1_8000s",
        "dark_1_8000s_001",
        "dark 1 30sec",
        "dark0,5s",  # 0.5 s, or dark0 at 5 s
        "iso400,10ms",
        "gain_2,10ms",  # gain 2 at 10 ms, or 2.1 ms
        "dark_1,500ms",  # 1.5 or 1500 ms
    ],
)
def test_ambiguous_exposures(name):
    with raises(FileError, f"the name '{name}' states two exposure times"):
        settings(name)


@pytest.mark.parametrize("name", ["iso1,600", "gain_2_iso_400"])
def test_ambiguous_gains(name):
    with raises(FileError, f"the name '{name}' states two gain settings"):
        settings(name)


def test_settings_that_the_metadata_state_are_not_searched_for():
    known = FrameSettings(exposure_s=1 / 8000)
    assert settings_from_names(Path("x"), ["dark_1_8000s_iso100"], known) == FrameSettings("dark", gain_setting=100.0)


@pytest.mark.parametrize(
    ("name", "gain"),
    [
        ("flat_10ms_iso400", 400.0),
        ("ISO_1600_dark", 1600.0),
        ("iso-100", 100.0),
        ("gain_2.5_dark", 2.5),
        ("gain12dB", 12.0),
        ("gain_2,5", 2.5),
        ("gain_2,5_dark_0,5s", 2.5),
        ("iso_1600,dark", 1600.0),
        ("again3", None),
        ("iso", None),
        ("isolated_400", None),
    ],
)
def test_gains(name, gain):
    assert settings(name).gain_setting == gain


@pytest.mark.parametrize(
    ("name", "celsius"),
    [
        ("dark_-10C_1", -10.0),
        ("dark_-10,5C_1", -10.5),
        ("dark_21.5degC", 21.5),
        ("temp20c", 20.0),
        ("dark-10C", None),
        ("abc", None),
    ],
)
def test_temperatures(name, celsius):
    """A hyphen after a word can be a minus or not, so the number is ignored."""
    assert settings(name).temperature_c == celsius


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("b_012_snap_001", {"light"}),
        ("d_012_snap_001", {"dark"}),
        ("d_first", set()),
        ("wd_012", set()),
        ("DARKS1", {"dark"}),
        ("Dark Frame", {"dark"}),
        ("dark flat", {"dark", "light"}),
        ("d_1_flat", {"light"}),
    ],
)
def test_kinds(name, kinds):
    assert kinds_in_name(name) == kinds


@pytest.mark.parametrize(
    ("pattern", "name", "exposure_s"),
    [
        (r"t([0-9.]+ms)", "flat_t2.5ms_001.tif", 0.0025),
        (r"_(?P<us>[0-9]+)_", "flat_250_001.tif", 250e-6),
        (r"s([0-9-]+)", "s1-60.tif", 1 / 60),
        (r"@(.*)\.tif", "a@0.02.tif", 0.02),
    ],
)
def test_a_pattern_of_exposure_times(pattern, name, exposure_s):
    assert exposure_by_pattern(Path(name), [name], pattern) == pytest.approx(exposure_s, rel=1e-15)


def test_invalid_patterns_of_exposure_times():
    for pattern in ("(", "[0-9]+", "([0-9]+)-([0-9]+)", "(?P<minutes>[0-9]+)"):
        with raises(InputError, "exposure_from_name", value=pattern):
            exposure_by_pattern(Path("flat_10.tif"), ["flat_10.tif"], pattern)
    for pattern in ("t([0-9]+)", "(flat)"):
        with raises(FileError, "" if pattern == "t([0-9]+)" else "exposure_s", path="flat_10.tif"):
            exposure_by_pattern(Path("flat_10.tif"), ["flat_10.tif"], pattern)


def test_the_first_name_that_states_a_setting_decides():
    assert settings("10ms", "flat_20ms", "dark_iso100") == FrameSettings("light", 0.01, gain_setting=100.0)
    with raises(FileError, "the name 'dark_flat' states both dark and light"):
        settings("10ms", "dark_flat")
