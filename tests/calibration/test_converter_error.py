"""The converter's error is found in the code density of flat fields, and ideal converters have none."""

import numpy as np
import pytest

from photosite.calibration.converter_error import ConverterCodes, Density, converter_codes
from photosite.values.uncertain import Missing

WHITE, GAIN = 1023, 0.5
CODES = np.arange(WHITE + 1)
LEVELS = np.arange(120.0, 820.0, 40.0)
ERRORS = {
    "ideal": lambda rng: np.zeros(WHITE + 1),
    "random": lambda rng: rng.normal(0.0, 0.08, WHITE + 1),
    "every eighth": lambda rng: 0.3 * ((CODES % 8) / 8.0 - 0.5),
}


def edges(error_lsb):
    """Inputs at the upper ends of the codes: where x + error(x) is half above the code."""
    return np.interp(CODES + 0.5, CODES + error_lsb, CODES)


def densities(rng, error_lsb, pixels=60_000):
    """Counts of two halves of flat fields with shot noise and a PRNU of 1 %, drawn from their exact shares."""
    from scipy.stats import norm

    found = []
    for level in LEVELS:
        noise = np.sqrt(GAIN * level + 4.0)
        share = np.diff(norm.cdf(edges(error_lsb), level, np.hypot(noise, 0.01 * level)), prepend=0.0)
        found.append(Density(rng.poisson(pixels * share, (2, WHITE + 1)), noise))
    return found


def measured(seed, kind, **options):
    rng = np.random.default_rng(seed)
    error = ERRORS[kind](rng)
    found = converter_codes(densities(rng, error, **options), (LEVELS[0], LEVELS[-1]))
    assert isinstance(found, ConverterCodes)
    return found, np.diff(edges(error), prepend=-0.5)[found.code] - 1.0, error


def test_ideal_converters_have_no_error():
    found = [measured(seed, "ideal")[0] for seed in range(12)]
    assert not any(entry.significant or entry.section() is not None for entry in found)
    assert sum(entry.dnl_rms_lsb.interval_95[0] <= 0.0 for entry in found) >= 10


@pytest.mark.parametrize("kind", ["random", "every eighth"])
def test_widths_of_codes_are_found_with_their_intervals(kind):
    """94 to 96 % of the widths in six sensors are expected within 95 % intervals; the size within 4 uncertainties."""
    inside = []
    for seed in range(6):
        found, width, _ = measured(seed, kind)
        assert found.significant
        inside.append(np.abs(found.dnl_lsb - width) < 1.96 * found.dnl_uncertainty_lsb)
        size = float(np.sqrt((width**2).mean()))
        assert abs(found.dnl_rms_lsb.value - size) < 4.0 * found.dnl_rms_lsb.standard_uncertainty
        assert found.dnl_rms_lsb.standard_uncertainty < 0.2 * size
    assert 0.9 < np.concatenate(inside).mean() < 0.98


def test_the_file_has_the_error_of_the_codes():
    found, _, error = measured(3, "every eighth", pixels=2_000_000)
    section = found.section()
    assert section is not None
    table = section.table()
    assert table.size == WHITE + 1
    assert np.corrcoef(table[found.code], error[found.code])[0, 1] > 0.75
    assert table[found.code].std() == pytest.approx(error[found.code].std(), rel=0.3)


def test_few_pixels_cover_too_few_codes():
    rng = np.random.default_rng(1)
    found = converter_codes(densities(rng, np.zeros(WHITE + 1), pixels=60), (LEVELS[0], LEVELS[-1]))
    assert isinstance(found, Missing)
    assert "codes" in found.reason
