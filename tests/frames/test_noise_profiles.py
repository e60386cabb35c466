"""Noise profiles of darktable and libcamera: closed forms, round trips, published entries, damaged files."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames.io.darktable import read_darktable, write_darktable
from photosite.frames.io.libcamera import is_libcamera, read_libcamera, write_libcamera
from photosite.sensor.noise_profile import NoiseProfile, profile_at_setting
from photosite.values.uncertain import Measured


def profile(iso=100.0, gain=0.25, dark=3.0, channels=("R", "G", "B"), black=64.0, white=4095.0):
    span = white - black
    n = len(channels)
    slopes, offsets = (Measured(gain / span, 1e-9),) * n, (Measured((dark / span) ** 2, 1e-12),) * n
    return NoiseProfile(channels, slopes, offsets, iso, black, white, "X-1")


def covers_95(measured, true):
    return abs(measured.value - true) <= 1.96 * measured.standard_uncertainty


def test_darktable_numbers_are_haar_details_of_interpolated_green():
    """The factor 1/16, by simulation: white noise on a Bayer mosaic, green filled in along rows, one Haar step.

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
    assert "not in the file" in model["comment"]
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
    assert again.slope[0].standard_uncertainty == 0


def test_darktable_factor_from_the_comment_or_the_caller(tmp_path):
    """In files of other programs the caller decides; a contradiction to the file is an error."""
    path = tmp_path / "noise.json"
    write_darktable([profile()], path)
    with raises(InputError, "mono", value=True):
        read_darktable(path, mono=True)
    data = json.loads(path.read_text())
    model = data["noiseprofiles"][0]["models"][0]
    comment, model["comment"] = model["comment"], "somebody's"
    path.write_text(json.dumps(data))
    colour, mono = read_darktable(path)[0], read_darktable(path, mono=True)[0]
    true = profile().slope[0].value
    assert covers_95(colour.slope[0], true)
    # Without interpolation the factor is 1/4, and only the nonuniformity of the pixels is unknown: it takes off.
    assert 0.9 < (mono.slope[0].value + 1.96 * mono.slope[0].standard_uncertainty) / (true / 4) <= 1.0
    assert mono.channels == ("M",)
    assert "does not state how" in mono.notes[0]
    model["comment"] = comment.replace("0.0625 of", "0.5 of")
    path.write_text(json.dumps(data))
    with raises(FileError, "the file is not a valid darktable noise profile: the comment states a factor of 0.5"):
        read_darktable(path)
    with raises(InputError, "profiles"):
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
    assert covers_95(found.slope[0], 1 / 50_000)
    assert "does not state how" in found.notes[0]


def test_libcamera_slope_is_the_root_of_the_gain_where_darkness_is_silent(tmp_path):
    """Without dark noise the line is exact: constant 0, slope sqrt(K) on the scale of 16 bits."""
    path = tmp_path / "tuning.json"
    write_libcamera(profile(gain=0.2, dark=0.0, black=64, white=1023), path)
    data = json.loads(path.read_text())
    levels, noise = (next(iter(entry.values())) for entry in data["algorithms"])
    assert levels == {"black_level": 4096.0}
    assert noise["reference_constant"] == pytest.approx(0.0, abs=1e-9)
    assert noise["reference_slope"] == pytest.approx(math.sqrt(0.2 * 64), rel=1e-12)
    assert "not in the file" in data["description"]


def test_libcamera_line_is_the_least_squares_one(tmp_path):
    """Compared with the line of a dense, even set of sqrt(signal), by the normal equations."""
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
    assert is_libcamera(path)
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
    assert any("no dark noise" in note for note in found.notes)
    assert "scale of 16 bits" in found.notes[0]


def tuning(noise, levels="{}", version="2.0"):
    return f'{{"version": {version}, "algorithms": [{{"rpi.black_level": {levels}}}, {{"rpi.noise": {noise}}}]}}'


NOISE = '{"reference_constant": 12, "reference_slope": 3.5}'


@pytest.mark.parametrize(
    ("text", "black"),
    [
        (tuning(NOISE, '{"black_level": 1024}'), 1024),
        # A YAML parser reads tunings: trailing commas, comments, texts as numbers.
        (tuning('{"reference_constant": 12, "reference_slope": 3.5,}', '{"black_level": 1024} # of 16 bits\n'), 1024),
        (tuning('{"reference_constant": "12", "reference_slope": "3.5"}', '{"black_level": "1024"}'), 1024),
        ("version: 2.0\nalgorithms:\n  - rpi.noise:\n      reference_constant: 12\n      reference_slope: 3.5\n", 0),
        # Version 1 has no list; other algorithms may hold anything.
        (f'{{"rpi.awb": {{"bayes": 0}}, "rpi.black_level": {{"black_level": 1024}}, "rpi.noise": {NOISE}}}', 1024),
        (tuning(NOISE), 4096),
        (tuning(NOISE, '{"black_level_r": 1000, "black_level_g": 1024, "black_level_b": 1001}'), 1024),
        (tuning(NOISE, '{"black_level": 1024, "enabled": false}'), 0),
    ],
)
def test_forms_of_a_tuning(tmp_path, text, black):
    """All forms that libcamera's parser accepts give the numbers of the plain form."""
    path, plain = tmp_path / "tuning.json", tmp_path / "plain.json"
    path.write_text(text)
    plain.write_text(tuning(NOISE, f'{{"black_level": {black}}}'))
    assert is_libcamera(path)
    found, expected = read_libcamera(path), read_libcamera(plain)
    assert found.black_level_dn == black
    assert (found.slope, found.offset) == (expected.slope, expected.offset)


def test_a_negative_constant_is_the_closest_curve_without_dark_noise(tmp_path):
    path = tmp_path / "tuning.json"
    path.write_text(tuning('{"reference_constant": -15, "reference_slope": 3.5}', '{"black_level": 4096}'))
    root = np.linspace(0, math.sqrt(65535 - 4096), 20_001)
    gain = np.linalg.lstsq(root[:, None], 3.5 * root - 15, rcond=None)[0][0] ** 2
    found = read_libcamera(path)
    assert found.system_gain_dn_per_e.value == pytest.approx(gain, rel=2e-4)
    assert found.dark_noise_dn.value == 0
    path.write_text(tuning('{"reference_constant": -900, "reference_slope": 3.5}'))
    with pytest.raises(FileError, match="makes the noise negative"):
        read_libcamera(path)


@pytest.mark.parametrize("offset", [-1e-5, 0.0, 4e-9])
def test_the_least_read_noise_of_an_offset_below_rounding(offset):
    """1/12 DN^2 is 4.97e-9 of (4095 DN)^2."""
    base = ps.load_sensor("nikon-d200")
    sensor = NoiseProfile(("M",), (Measured(2e-4),), (Measured(offset, 1e-6),)).sensor(base)
    (found,) = NoiseProfile(("M",), (Measured(2e-4),), (Measured(offset, 1e-6),)).diagnostics(base)
    assert found.id == "negative-dark-noise"
    assert found.size == pytest.approx(offset * 4095**2 - 1 / 12, rel=1e-12)
    assert (sensor.noise.read_noise_mv.value, sensor.noise.read_noise_mv.assumed) == (0.0, True)
    # One standard uncertainty above the variance is the largest read noise.
    above = math.sqrt(max(found.size + 1e-6 * 4095**2, 0.0)) * base.mv_per_dn
    assert sensor.noise.read_noise_mv.standard_uncertainty == pytest.approx(above, rel=1e-12)
    assert sensor.system_gain_dn_per_e == pytest.approx(2e-4 * 4095, rel=1e-12)


def test_an_offset_above_rounding_has_no_diagnostic():
    base = ps.load_sensor("nikon-d200")
    above = NoiseProfile(("M",), (Measured(2e-4),), (Measured(5e-9, 1e-6),))
    assert above.diagnostics(base) == ()
    assert above.sensor(base).noise.read_noise_mv.assumed is False


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "is not JSON"),
        (tuning(NOISE, version="3.1"), "version must be below 3"),
        (tuning(NOISE).replace("rpi.black_level", "rpi.noise"), "'rpi.noise' is there twice"),
        (tuning('{"enabled": false}'), "rpi.noise is disabled"),
        (tuning('{"reference_constant": "a", "reference_slope": 1}'), "'reference_constant' must be a finite number"),
        ("[]", "holds no object"),
        ('{"a": 1}', "neither a darktable"),
        ('{"algorithms": [{"rpi.noise": {}}]}', "'reference_constant' is missing"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 0, "reference_slope": NaN}}]}', "finite number"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 0, "reference_slope": 0}}]}', "out of range"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 10, "reference_slope": 1e300}}]}', "out of range"),
        ('{"algorithms": [{"rpi.noise": {"reference_constant": 9e99, "reference_slope": 1}}]}', "out of range"),
        ('{"algorithms": 4}', "is not a Raspberry Pi tuning file"),
        ('{"noiseprofiles": 4, "version": 0}', "is not a valid darktable noise profile"),
        ('{"noiseprofiles": [], "version": 1}', "version must be 0"),
        ('{"noiseprofiles": [], "version": 0}', "holds no cameras"),
        (
            '{"version": 0, "noiseprofiles": [{"models": [{"model": "m", "profiles": '
            '[{"iso": 100, "a": [1, -1, 1], "b": [0, 0, 0]}]}]}]}',
            "a must be a slope that some sensor has",
        ),
        (
            '{"version": 0, "noiseprofiles": [{"models": [{"model": "m", "profiles": '
            f'[{{"iso": 1{"0" * 400}, "a": [1, 1, 1], "b": [0, 0, 0]}}]}}]}}]}}',
            "finite number",
        ),
    ],
)
def test_damaged_files(tmp_path, text, why):
    path = tmp_path / "profile.json"
    path.write_text(text)
    with pytest.raises(FileError, match=why) as caught:
        _ = read_libcamera(path) if is_libcamera(path) else read_darktable(path)
    assert str(path) in str(caught.value)


def test_missing_and_unknown_names(tmp_path):
    path = tmp_path / "noise.json"
    models = [{"model": m, "profiles": [{"iso": 100, "a": [1e-5] * 3, "b": [0] * 3}]} for m in ("D200", "D300")]
    path.write_text(json.dumps({"version": 0, "noiseprofiles": [{"models": models}]}))
    with raises(InputError, "the file holds 2 cameras", arguments={"model": "D200"}):
        read_darktable(path)
    with raises(InputError, "model", value="D20", hint="Did you mean 'D200' or 'D300'?"):
        read_darktable(path, "D20")
    for name in ("D300", "d300", "d-300"):
        assert read_darktable(path, name)[0].camera == "D300"
    with raises(InputError, "the noise profile does not state its gain setting"):
        write_darktable([profile(None)], tmp_path / "x.json")
    two = [profile(100.0), profile(400.0)]
    assert profile_at_setting(two, 400.0) is two[1]
    with raises(InputError, "gain_setting", value=None):
        profile_at_setting(two, None)
    with raises(InputError, "gain_setting", value=200.0):
        profile_at_setting(two, 200.0)
