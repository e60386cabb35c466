"""The converter's error is found in the code density of flat fields, and ideal converters have none."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.effects.converter_error import ConverterCodes, Density, converter_codes
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.errors import FileError, InputError
from photosite.frames.io.formats import read_raw
from photosite.frames.open import open_frames
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.protocol import ShootingProtocol, Step, series
from photosite.studies.virtual_lab import virtual_lab, with_pedestal
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import Missing

SENSOR = load_sensor("nikon-d200")

WHITE, GAIN = 1023, 0.5
CODES = np.arange(WHITE + 1)
LEVELS = np.arange(120.0, 820.0, 40.0)
ERRORS = {
    "ideal": lambda rng: np.zeros(WHITE + 1),
    "random": lambda rng: rng.normal(0.0, 0.08, WHITE + 1),
    "every eighth": lambda rng: 0.3 * ((CODES % 8) / 8.0 - 0.5),
    "independent widths": lambda rng: without_line(np.cumsum(rng.normal(0.0, 0.08, WHITE + 1))),
}


def without_line(error_lsb):
    return error_lsb - np.linspace(error_lsb[0], error_lsb[-1], len(error_lsb))


def edges(error_lsb):
    """Inputs at the upper ends of the codes: where x + error(x) is half above the code."""
    return np.interp(CODES + 0.5, CODES + error_lsb, CODES)


def densities(rng, error_lsb, pixels=60_000, levels=LEVELS):
    """Counts of two halves of flat fields with shot noise and a PRNU of 1 %, drawn from their exact shares."""
    from scipy.stats import norm

    found = []
    for level in levels:
        noise = np.sqrt(GAIN * level + 4.0)
        fraction = np.diff(norm.cdf(edges(error_lsb), level, np.hypot(noise, 0.01 * level)), prepend=0.0)
        found.append(Density(rng.poisson(pixels * fraction, (2, WHITE + 1)), noise))
    return found


def measured(seed, kind, **options):
    rng = np.random.default_rng(seed)
    error = ERRORS[kind](rng)
    found = converter_codes(densities(rng, error, **options), (LEVELS[0], LEVELS[-1]))
    assert isinstance(found, ConverterCodes)
    return found, np.diff(edges(error), prepend=-0.5) - 1.0, error


def test_ideal_converters_have_no_error():
    found = [measured(seed, "ideal")[0] for seed in range(8)]
    assert not any(entry.significant or entry.section(SENSOR, "")["converter_error"] is not None for entry in found)
    assert sum(entry.dnl_rms_lsb.interval_95[0] <= 0.0 for entry in found) >= 7


@pytest.mark.parametrize("pixels", [60_000, 2_000_000])
@pytest.mark.parametrize("kind", ["random", "every eighth", "independent widths"])
def test_errors_of_codes_are_found_with_their_intervals(kind, pixels):
    """Of 200 converters (see the documentation), 93 to 98 % of the codes lie within their 95 % intervals.

    In four converters, codes that are not independent of each other let the fractions vary by 0.03. Errors of the INL
    that were 1.5 times their uncertainties would have 0.81 within.
    """
    dnl_inside, inl_inside = [], []
    for seed in range(4):
        found, width, _ = measured(seed, kind, pixels=pixels)
        dnl, inl = found.fast_part(width)
        assert found.significant
        dnl_inside.append(np.abs(found.dnl_lsb - dnl) < 1.96 * found.dnl_uncertainty_lsb)
        inl_inside.append(np.abs(found.inl_lsb - inl) < 1.96 * found.inl_uncertainty_lsb)
        for size, part, fraction in ((found.dnl_rms_lsb, dnl, 0.2), (found.inl_rms_lsb, inl, 0.3)):
            assert abs(size.value - np.sqrt((part**2).mean())) < 4.0 * size.standard_uncertainty
            assert size.standard_uncertainty < fraction * size.value
    assert 0.9 < np.concatenate(dnl_inside).mean() < (0.98 if pixels < 100_000 else 1.0)
    assert np.concatenate(inl_inside).mean() > 0.9


def test_most_of_an_error_is_found():
    """A moving polynomial of white widths takes 5 of 41 parts of the variance, 5 of 17 at the dimmest level."""
    found, width, _ = measured(1, "independent widths", pixels=2_000_000)
    dnl, _ = found.fast_part(width)
    assert np.corrcoef(dnl, width[found.code])[0, 1] > 0.85
    assert np.corrcoef(found.dnl_lsb, width[found.code])[0, 1] > 0.85


def test_the_fast_part_needs_a_width_for_each_code():
    found, width, _ = measured(1, "random")
    with pytest.raises(InputError) as caught:
        found.fast_part(width[:-1])
    assert caught.value.what == "dnl_lsb"


def test_the_file_has_the_error_of_the_codes():
    found, _, error = measured(3, "every eighth", pixels=2_000_000, levels=np.arange(120.0, 820.0, 15.0))
    section = found.section(SENSOR, "")["converter_error"]
    table = section.table()
    assert table.size == WHITE + 1
    assert np.corrcoef(table[found.code], error[found.code])[0, 1] > 0.9
    assert table[found.code].std() == pytest.approx(error[found.code].std(), rel=0.2)
    at_the_ends = 0.5 * (table[found.code] + table[found.code + 1])
    assert at_the_ends[2:-2] == pytest.approx(found.inl_lsb[2:-2], abs=0.015)


def noise_after(error_lsb, mean_dn, noise_dn):
    """Standard deviation of the codes of a normal input, from the exact shares."""
    from scipy.stats import norm

    share = np.diff(norm.cdf(edges(error_lsb), mean_dn, noise_dn), prepend=0.0)
    return np.sqrt(share @ CODES**2 - (share @ CODES) ** 2)


def test_unequal_codes_are_named_with_the_error_of_dark_noise():
    """The size is the spread of the noise that an input of 1.5 DN has at different codes."""
    found, _, error = measured(2, "every eighth", pixels=2_000_000)
    (named,) = replace(found, dark_dn=1.5).diagnostics
    noise = np.array([noise_after(error, mean, 1.5) for mean in np.arange(150.0, 800.0)])
    assert named.size == pytest.approx(noise.std() / 1.5, rel=0.1)
    concerned = DiagnosticKind("", "note", "", "", "", named.parameters).concerns(PARAMETER_LABELS)
    assert {"read_noise_dn", "read_noise_e", "dsnu_e", "black_level_dn", "dynamic_range_db"} <= set(concerned)
    assert "system_gain_dn_per_e" not in concerned
    ideal, _, _ = measured(1, "ideal")
    assert replace(ideal, dark_dn=1.5).diagnostics == ()
    assert found.diagnostics == ()  # without dark frames, there are no figures of them


def test_few_pixels_cover_too_few_codes():
    rng = np.random.default_rng(1)
    found = converter_codes(densities(rng, np.zeros(WHITE + 1), pixels=60), (LEVELS[0], LEVELS[-1]))
    assert isinstance(found, Missing)
    assert found.id == "effect-not-measured"


def calibrated(folder):
    sensor = with_pedestal(load_sensor("nikon-d200").with_(rows=200, cols=260))
    protocol = ShootingProtocol("test", (Step("dark", 1e-3, 4), *series("light", 2e-3, 2e-2, exposures=5, count=4)))
    virtual_lab(sensor, protocol, seed=1).write(folder)
    return calibrate(open_frames(folder))


def test_codes_are_counted_when_the_error_is_first_read(tmp_path):
    first, again = calibrated(tmp_path / "frames"), calibrate(open_frames(tmp_path / "frames"))
    assert isinstance(first.converter, ConverterCodes)
    assert pickle.loads(pickle.dumps(again)).converter.to_dict() == first.converter.to_dict()


@pytest.mark.parametrize("change", ["changed", "missing"])
def test_a_frame_that_is_missing_or_has_changed_is_an_error(tmp_path, change):
    found = calibrated(tmp_path / "frames")
    for file in (tmp_path / "frames" / "light").iterdir():
        if change == "missing":
            file.unlink()
        else:
            frame = read_raw(file)
            replace(frame, dn=frame.dn - (frame.dn > 0)).save(file)
    with pytest.raises(FileError):
        _ = found.converter
