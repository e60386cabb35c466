"""darktable's and libcamera's noise profiles: closed forms, round trips, published entries, damaged files."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from photosite.errors import FileError, InputError
from photosite.frames.io.noise_profiles import (
    at_setting,
    looks_like_libcamera,
    read_darktable,
    read_libcamera,
    write_darktable,
    write_libcamera,
)
from photosite.sensor.noise_profile import NoiseProfile
from photosite.values.measured import Measured


def profile(iso=100.0, gain=0.25, dark=3.0, channels=("R", "G", "B"), black=64.0, white=4095.0):
    span = white - black
    n = len(channels)
    slopes, offsets = (Measured(gain / span, 1e-9),) * n, (Measured((dark / span) ** 2, 1e-12),) * n
    return NoiseProfile(channels, slopes, offsets, iso, black, white, "X-1")


def test_darktable_numbers_are_haar_details_of_interpolated_green():
    """The share 1/16, by the slow way: white noise on a Bayer mosaic, green filled in along rows, one Haar step.

    1.2 million details: standard error of their variance 0.13 % (times 1.3 for their correlation), 4.5 of those.
    """
    noise = np.random.default_rng(5).normal(0.0, 1.0, (2200, 2200))
    rows, cols = np.indices(noise.shape)
    is_green = (rows + cols) % 2 == 1
    green = np.where(is_green, noise, 0.5 * (np.roll(noise, 1, 1) + np.roll(noise, -1, 1)))

    def details(plane):
        across = 0.5 * (plane[:, 1::2] - plane[:, 0::2])
        return 0.5 * (across[1::2] - across[0::2])

    assert details(green)[1:-1, 1:-1].var() == pytest.approx(1 / 16, rel=0.0077)
    assert details(noise).var() == pytest.approx(1 / 4, rel=0.0077)


def test_darktable_entries(tmp_path):
    path = tmp_path / "noise.json"
    write_darktable([profile(), profile(400.0, gain=1.0)], path, maker="Acme", model="X-1")
    data = json.loads(path.read_text())
    (maker,) = data["noiseprofiles"]
    (model,) = maker["models"]
    assert (data["version"], maker["maker"], model["model"]) == (0, "Acme", "X-1")
    assert "lost" in model["comment"]
    low, high = model["profiles"]
    assert (low["iso"], high["iso"]) == (100, 400)
    assert low["a"] == pytest.approx([0.25 / 4031 / 16] * 3, rel=1e-12)
    assert low["b"] == pytest.approx([9 / 4031**2 / 16] * 3, rel=1e-12)
    assert high["a"][1] == pytest.approx(4 * low["a"][1])


@pytest.mark.parametrize("channels", [("M",), ("R", "G", "B")])
def test_darktable_round_trip(tmp_path, channels):
    path = tmp_path / "noise.json"
    written = profile(channels=channels)
    write_darktable([written], path)
    (again,) = read_darktable(path)
    assert (again.channels, again.gain_setting, again.camera) == (channels, 100.0, "X-1")
    assert again.slope[0].value == written.slope[0].value
    assert again.offset[0].value == written.offset[0].value
    assert again.black_level_dn is None
    assert not any("factor of two" in note for note in again.notes)


def test_darktables_share_is_the_files_where_it_says_one(tmp_path):
    """Others' files do not: there the caller says, and a contradiction to the file is refused."""
    path = tmp_path / "noise.json"
    write_darktable([profile()], path)
    with pytest.raises(InputError, match="has a colour filter mosaic"):
        read_darktable(path, mono=True)
    data = json.loads(path.read_text())
    model = data["noiseprofiles"][0]["models"][0]
    comment, model["comment"] = model["comment"], "somebody's"
    path.write_text(json.dumps(data))
    colour, mono = read_darktable(path)[0], read_darktable(path, mono=True)[0]
    assert colour.slope[0].value == 4 * mono.slope[0].value
    assert "factor of two" in mono.notes[0]
    model["comment"] = comment.replace("0.0625 of", "0.5 of")
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"are 0\.5 of the raw noise variance"):
        read_darktable(path)
    with pytest.raises(InputError, match="all of a colour filter mosaic, or none"):
        write_darktable([profile(), profile(200.0, channels=("M",))], path)


def test_a_published_darktable_entry_is_a_plausible_camera(tmp_path):
    """darktable's own entry of the Fujifilm GFX 100 at ISO 100; the 3.76 um pixel holds some 50 000 electrons there."""
    entry = {"name": "GFX 100 iso 100", "iso": 100}
    entry["a"] = [2.48411617899134e-06, 1.1488878678279e-06, 2.52058136296402e-06]
    entry["b"] = [2.9919722337491e-09, 1.79727271817946e-09, 2.73888492124164e-09]
    skipped = {**entry, "skip": True}
    model = {"comment": "", "model": "GFX 100", "profiles": [entry, skipped]}
    path = tmp_path / "noise.json"
    path.write_text(json.dumps({"version": 0, "noiseprofiles": [{"maker": "Fujifilm", "models": [model]}]}))
    (found,) = read_darktable(path)
    full_well_e = 1 / found.slope[0].value
    assert 25_000 < full_well_e < 100_000
    assert "factor of two" in found.notes[0]


def test_libcamera_slope_is_the_root_of_the_gain_where_darkness_is_silent(tmp_path):
    """Without dark noise the line is exact: constant 0, slope sqrt(K) on the scale of 16 bits."""
    path = tmp_path / "tuning.json"
    write_libcamera(profile(gain=0.2, dark=0.0, black=64, white=1023), path)
    data = json.loads(path.read_text())
    levels, noise = (next(iter(entry.values())) for entry in data["algorithms"])
    assert levels == {"black_level": 4096.0}
    assert noise["reference_constant"] == pytest.approx(0.0, abs=1e-9)
    assert noise["reference_slope"] == pytest.approx(math.sqrt(0.2 * 64), rel=1e-12)
    assert "lost" in data["description"]


def test_libcamera_line_is_the_least_squares_one(tmp_path):
    """The slow way: the line of a dense, even set of sqrt(signal), by the normal equations."""
    path = tmp_path / "tuning.json"
    write_libcamera(profile(gain=0.2, dark=8.0, black=64, white=1023), path)
    noise = json.loads(path.read_text())["algorithms"][1]["rpi.noise"]
    root = np.linspace(0, math.sqrt(65535 - 4096), 20_001)
    sigma = np.sqrt((8.0 * 64) ** 2 + 0.2 * 64 * root**2)
    slope = np.cov(root, sigma)[0, 1] / root.var(ddof=1)
    assert noise["reference_slope"] == pytest.approx(slope, rel=1e-3)
    assert noise["reference_constant"] == pytest.approx(sigma.mean() - slope * root.mean(), rel=1e-3)


@pytest.mark.parametrize("dark", [0.0, 0.4, 3.0, 40.0])
@pytest.mark.parametrize("bits", [10, 12, 16])
def test_libcamera_round_trip(tmp_path, dark, bits):
    path = tmp_path / "tuning.json"
    scale = 2.0 ** (bits - 12)
    black, white = 64 * scale, 2.0**bits - 1
    write_libcamera(profile(gain=0.25 * scale, dark=dark * scale, black=black, white=white), path)
    assert looks_like_libcamera(path)
    again = read_libcamera(path)
    assert again.system_gain_dn_per_e.value == pytest.approx(0.25 * 16, rel=1e-9)
    assert again.dark_noise_dn.value == pytest.approx(dark * 16, rel=1e-6, abs=1e-5)
    assert again.black_level_dn == 64 * 16


def test_a_published_tuning_file(tmp_path):
    """The IMX219's slope of 3.67: sqrt(K) on 16 bits makes 0.21 DN per electron on 10, 4 550 electrons at white.

    The maker's data sheets give its pixels a little under 5 000.
    """
    path = tmp_path / "imx219.json"
    algorithms = [
        {"rpi.black_level": {"black_level": 4096}},
        {"rpi.noise": {"reference_constant": 0, "reference_slope": 3.67}},
    ]
    path.write_text(json.dumps({"version": 2.0, "target": "bcm2835", "algorithms": algorithms}))
    found = read_libcamera(path)
    assert found.system_gain_dn_per_e.value == pytest.approx(3.67**2, rel=1e-9)
    assert found.dark_noise_dn.value == 0
    assert 1 / found.slope[0].value == pytest.approx((65535 - 4096) / 3.67**2, rel=1e-9)
    assert any("came out below" in note for note in found.notes)
    assert "numbers of 16 bits" in found.notes[0]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "is not JSON"),
        ("[]", "not an object"),
        ('{"a": 1}', "neither a darktable"),
        ('{"algorithms": [{"rpi.noise": {}}]}', "lacks 'reference_constant'"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 0, "reference_slope": NaN}}]}', "finite number"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 0, "reference_slope": 0}}]}', "cannot be"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 9e99, "reference_slope": 1}}]}', "no photon noise"),
        ('{"algorithms": 4}', "is no Raspberry Pi tuning file"),
        ('{"noiseprofiles": 4, "version": 0}', "is no darktable noise profile"),
        ('{"noiseprofiles": [], "version": 1}', "version 1"),
        ('{"noiseprofiles": [], "version": 0}', "holds no cameras"),
        (
            '{"version": 0, "noiseprofiles": [{"models": [{"model": "m", "profiles": '
            '[{"iso": 100, "a": [1, -1, 1], "b": [0, 0, 0]}]}]}]}',
            "slope is above 0",
        ),
        (
            '{"version": 0, "noiseprofiles": [{"models": [{"model": "m", "profiles": '
            f'[{{"iso": 1{"0" * 400}, "a": [1, 1, 1], "b": [0, 0, 0]}}]}}]}}]}}',
            "finite number",
        ),
    ],
)
def test_damaged_files_are_one_error(tmp_path, text, why):
    path = tmp_path / "profile.json"
    path.write_text(text)
    with pytest.raises(FileError, match=why) as caught:
        _ = read_libcamera(path) if looks_like_libcamera(path) else read_darktable(path)
    assert str(path) in str(caught.value)


def test_what_must_be_named(tmp_path):
    path = tmp_path / "noise.json"
    models = [{"model": m, "profiles": [{"iso": 100, "a": [1e-5] * 3, "b": [0] * 3}]} for m in ("D200", "D300")]
    path.write_text(json.dumps({"version": 0, "noiseprofiles": [{"models": models}]}))
    with pytest.raises(InputError, match="holds 2 cameras; name one"):
        read_darktable(path)
    with pytest.raises(InputError, match="did you mean 'D200'"):
        read_darktable(path, "D20")
    assert read_darktable(path, "D300")[0].camera == "D300"
    with pytest.raises(InputError, match="does not say its gain setting"):
        write_darktable([profile(None)], tmp_path / "x.json")
    two = [profile(100.0), profile(400.0)]
    assert at_setting(two, 400.0) is two[1]
    with pytest.raises(InputError, match="name a gain setting of 100, 400"):
        at_setting(two, None)
    with pytest.raises(InputError, match="no noise profile of gain setting 200; there are 100, 400"):
        at_setting(two, 200.0)
