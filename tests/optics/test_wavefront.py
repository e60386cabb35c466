"""Wavefronts against closed forms: Airy, Hopkins, Marechal, and the centroid of coma."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises
from scipy.integrate import quad
from scipy.special import j1

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.annular import Waves, aberration_free_otf, defocused_otf, overlap_quadrature
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.optics.pupil import Pupil, PupilAutocorrelation, cells_for, largest_slope
from photosite.optics.wavefront import Wavefront
from photosite.optics.zernike import zernike_terms, zernike_values

Array = NDArray[np.float64]
LENS = DiffractionLimited(f_number=8, focal_length_mm=50)
FAR = math.inf
S = np.linspace(0, 1.05, 316)
NEARLY_ROUND = Pupil(blades=7, roundness=1 - 1e-9)
"""A circle that is computed as a general pupil."""


def plane_otf(spread: PlanePsf | RadialPsf, y: Array, x: Array, wavelength_nm: float) -> NDArray[np.complex128]:
    assert isinstance(spread, PlanePsf)
    cutoff = spread.cutoff_per_m(wavelength_nm)
    return spread.otf(np.asarray(y) * cutoff, np.asarray(x) * cutoff, wavelength_nm)


def point_spread(spread: PlanePsf | RadialPsf, wavelength_nm: float, count: int) -> Array:
    """(count, count) samples at half a period of the cutoff, the center at count // 2; peak of the Airy pattern 1."""
    f = np.fft.fftfreq(count) * 2
    otf = plane_otf(spread, f[:, None], f[None], wavelength_nm)
    spectrum = otf * (4 / count**2) / (math.pi / 4)
    image = np.fft.ifft2(spectrum).real * count**2
    return np.fft.fftshift(image)


@pytest.mark.parametrize(("f_number", "wavelength_nm"), [(2.8, 450.0), (8.0, 650.0)])
def test_sampled_circle_has_the_airy_pattern_and_its_mtf(f_number: float, wavelength_nm: float) -> None:
    lens = DiffractionLimited(f_number, 50)
    spread = Wavefront(pupil=NEARLY_ROUND).point_spread(lens, 1.2)
    cutoff = lens.cutoff_per_m(wavelength_nm, 1.2)
    assert spread.cutoff_per_m(wavelength_nm) == pytest.approx(cutoff, rel=1e-12)
    for angle in (0.0, 0.4, 2.5):
        otf = plane_otf(spread, S * math.sin(angle), S * math.cos(angle), wavelength_nm)
        assert otf == pytest.approx(lens.otf(S * cutoff, wavelength_nm, 1.2).astype(complex), abs=1e-4)
    # The samples repeat after 256 periods, where the pattern is below 1e-7 of its peak.
    psf = point_spread(spread, wavelength_nm, 512)
    periods = (np.arange(512) - 256) / 2
    v = math.pi * np.hypot(periods[:, None], periods)
    v[256, 256] = 1.0
    airy = (2 * j1(v) / v) ** 2
    airy[256, 256] = 1.0
    assert np.abs(psf - airy).max() < 1e-4
    assert psf.min() > -1e-6


def annular_otf(s: Array, waves: Waves, obscuration: float, count: int) -> Array:
    """The OTF of an annulus with a wavefront of terms (n, 0), by the quadrature without the spline."""
    difference, weight = overlap_quadrature(s, tuple(waves), obscuration, count)
    phase = 2 * math.pi * np.tensordot(np.array(list(waves.values())), difference, 1)
    return np.asarray((weight * np.cos(phase)).sum(axis=1))


@pytest.mark.parametrize("rim_waves", [0.0, 0.25, 0.5, 1.0, 2.0])
def test_defocus_against_hopkins_by_three_methods(rim_waves: float) -> None:
    """Adaptive quadrature of the integral against the radial function, the annular quadrature and the transforms."""

    def hopkins(s: float) -> float:
        return float(
            4
            / math.pi
            * quad(lambda u: math.sqrt(1 - u * u) * math.cos(8 * math.pi * rim_waves * s * (u - s)), s, 1)[0]
        )

    s = np.array([0.0, 0.03, 0.1, 0.25, 0.4, 0.63, 0.8, 0.97])
    exact = np.array([hopkins(v) for v in s])
    rms = rim_waves / math.sqrt(12)
    assert defocused_otf(s, rim_waves) == pytest.approx(exact, abs=1e-8)
    assert annular_otf(s, {(2, 0): rms}, 0.0, 40) == pytest.approx(exact, abs=1e-8)
    lens = DiffractionLimited(2.8, 50)
    radial = Wavefront({4: rms}, unit="waves", reference_nm=500).point_spread(lens, FAR)
    assert isinstance(radial, RadialPsf)
    assert radial.otf(s * radial.cutoff_per_m(500), 500.0) == pytest.approx(exact, abs=1e-8)
    plane = Wavefront({4: rms}, unit="waves", reference_nm=500, pupil=NEARLY_ROUND).point_spread(lens, FAR)
    assert plane_otf(plane, 0.6 * s, 0.8 * s, 500.0) == pytest.approx(exact.astype(complex), abs=1e-4)


@pytest.mark.parametrize(
    ("waves", "obscuration"),
    [({(4, 0): 0.15}, 0.0), ({(2, 0): 0.2, (6, 0): 0.1}, 0.35), ({(4, 0): 0.5, (2, 0): -0.3}, 0.35)],
)
def test_quadrature_and_transforms_agree_on_spherical_aberration(
    waves: dict[tuple[int, int], float], obscuration: float
) -> None:
    pupil = Pupil(obscuration=obscuration)
    s = np.linspace(0, 1, 31)
    exact = annular_otf(s, waves, obscuration, 60)
    count = cells_for(largest_slope(pupil, waves))
    by_transforms = PupilAutocorrelation(pupil, tuple(waves), count).otf(waves)
    assert by_transforms(0.28 * s, -0.96 * s) == pytest.approx(exact.astype(complex), abs=2e-4)
    noll = {(2, 0): 4, (4, 0): 11, (6, 0): 22}
    wavefront = Wavefront({noll[t]: w for t, w in waves.items()}, unit="waves", reference_nm=600, pupil=pupil)
    spread = wavefront.point_spread(LENS, FAR)
    assert isinstance(spread, RadialPsf)
    got = spread.otf(s * spread.cutoff_per_m(600), 600.0)
    assert got == pytest.approx(exact, abs=1e-4)  # through the spline


def test_strong_defocus_by_transforms_against_hopkins() -> None:
    """At 32 waves, the sampling limit, and beyond by the same rays at a longer wavelength."""
    for rim_waves, tolerance in ((32.0, 6e-4), (80.0, 8e-3)):
        coefficient = {4: rim_waves / math.sqrt(12)}
        spread = Wavefront(coefficient, unit="waves", reference_nm=550, pupil=NEARLY_ROUND).point_spread(LENS, FAR)
        s = np.linspace(0, 4 / rim_waves, 400)
        got = plane_otf(spread, 0.6 * s, 0.8 * s, 550.0)
        assert np.abs(got - defocused_otf(s, rim_waves)).max() < tolerance


TERMS = [(n, m) for n in range(2, 5) for m in range(-n, n + 1, 2)]


@pytest.mark.parametrize(("term", "rms"), [*((term, 0.05) for term in TERMS), ((2, 0), 0.02), ((3, 1), 0.02)])
def test_strehl_ratio_against_marechal(term: tuple[int, int], rms: float) -> None:
    """exp(-(2 pi rms)^2): it omits at most 1.3 (2 pi rms)^4 / 24 and the third moment of the phase."""
    wavefront = Wavefront({term: rms}, index="nm", unit="waves", reference_nm=550, pupil=NEARLY_ROUND)
    spread = wavefront.point_spread(LENS, FAR)
    step = 1 / 64
    f = np.arange(-65, 66) * step
    otf = plane_otf(spread, f[:, None], f[None], 550.0)
    bare = aberration_free_otf(np.hypot(f[:, None], f[None]))
    strehl = float(otf.sum().real / bare.sum())
    phase = 2 * math.pi * rms
    # The exact ratio: the squared mean of the phasor over the pupil, on a separate fine grid.
    t = (np.arange(400) + 0.5) / 200 - 1
    x, y = np.meshgrid(t, t)
    inside = np.hypot(x, y) < 1
    exact = abs(np.exp(1j * phase * zernike_values([term], x[inside], y[inside])[0]).mean()) ** 2
    assert strehl == pytest.approx(exact, abs=1e-3)
    assert strehl == pytest.approx(math.exp(-(phase**2)), abs=0.2 * phase**4 + 5e-4)
    assert strehl < 1 - 0.9 * phase**2 + phase**4 / 2


def test_centroids_of_tilt_and_coma() -> None:
    """The centroid of the PSF is 2 N times the mean slope of the wavefront over the pupil."""
    for term, (right, up) in {
        (1, 1): (2.0, 0.0),  # Z = 2 x
        (1, -1): (0.0, 2.0),
        (3, 1): (math.sqrt(8), 0.0),  # Z = sqrt 8 (3 r^3 - 2 r) cos: mean slope sqrt 8 (6 <r^2> - 2) = sqrt 8
        (3, -1): (0.0, math.sqrt(8)),
    }.items():
        spread = Wavefront({term: 5.0}, index="nm").point_spread(LENS, FAR)
        # otf = (1 - 2 pi i f . centroid) near 0: by its imaginary part, extrapolated to f = 0 from two frequencies.
        down, across = (
            2 * centroid(spread, 0.01 * y, 0.01 * x) - centroid(spread, 0.02 * y, 0.02 * x)
            for y, x in ((1.0, 0.0), (0.0, 1.0))
        )
        expected = 2 * 8 * 5e-9
        assert across == pytest.approx(right * expected, rel=1e-2, abs=1e-11)
        assert down == pytest.approx(-up * expected, rel=1e-2, abs=1e-11)


def centroid(spread: PlanePsf | RadialPsf, y: float, x: float) -> float:
    step_per_m = math.hypot(y, x) * spread.cutoff_per_m(550.0)
    return float(-plane_otf(spread, np.array([y]), np.array([x]), 550.0).imag[0] / (2 * math.pi * step_per_m))


def test_the_tail_of_coma_follows_its_sign() -> None:
    """Most energy is near the chief ray, and the tail is to the right."""
    psf = point_spread(Wavefront({8: 80.0}, pupil=NEARLY_ROUND).point_spread(LENS, FAR), 550.0, 256)
    row, col = np.unravel_index(psf.argmax(), psf.shape)
    assert row == 128
    right, left = psf[:, col + 4 : col + 20].sum(), psf[:, col - 19 : col - 3].sum()
    assert right > 1.5 * left
    assert np.abs(psf - np.roll(psf[::-1], 1, axis=0)).max() < 1e-5


def test_diffraction_star_of_a_hexagon() -> None:
    """A corner to the right means horizontal edges at top and bottom: vertical arms, no horizontal ones."""
    psf = point_spread(Wavefront(pupil=Pupil(blades=6)).point_spread(LENS, FAR), 550.0, 256)
    arm, gap = psf[64:108, 128].sum(), psf[128, 64:108].sum()
    assert arm > 5 * gap


@pytest.mark.parametrize(
    "wavefront",
    [
        Wavefront({8: 40.0, 6: -30.0, 9: 20.0}),
        Wavefront({4: 90.0}, pupil=Pupil(blades=6)),
        Wavefront({7: 60.0}, pupil=Pupil(0.3, vanes=4, vane_width=0.02)),
    ],
)
def test_psf_has_unit_energy_and_is_not_negative(wavefront: Wavefront) -> None:
    spread = wavefront.point_spread(LENS, FAR)
    at_zero = plane_otf(spread, np.zeros(1), np.zeros(1), 550.0)[0]
    assert abs(at_zero - 1) < 1e-12
    psf = point_spread(spread, 550.0, 128)
    assert psf.sum() * (math.pi / 4) / 4 == pytest.approx(1, abs=1e-9)
    assert psf.min() > -1e-6 * psf.max()
    f = np.random.default_rng(3).uniform(-0.7, 0.7, (2, 300))
    forth, back = plane_otf(spread, *f, 550.0), plane_otf(spread, *-f, 550.0)
    assert np.abs(forth - back.conj()).max() < 1e-15
    assert (np.abs(forth) <= 1).all()


def test_defocus_by_distance_equals_defocus_by_shift() -> None:
    """An object nearer than the plane in focus is imaged behind the sensor; both forms agree paraxially."""
    lens = DiffractionLimited(4, 50)
    distance, focus = 3.0, 3.1
    image, sensor = (1 / (1 / 0.05 - 1 / d) for d in (distance, focus))
    assert image > sensor
    by_distance = Wavefront().waves(550.0, lens, distance, focus)[2, 0]
    by_shift = Wavefront(defocus_um=(image - sensor) * 1e6).waves(550.0, lens, focus)[2, 0]
    assert by_distance == pytest.approx(by_shift, rel=1e-3)
    assert by_distance > 0
    # Geometrical blur: aperture diameter over image distance, at the sensor. The rim ray is 4 W N away.
    rim_waves = by_distance * math.sqrt(12)
    assert 2 * 4 * rim_waves * 550e-9 * lens.working_f_number(focus) == pytest.approx(
        (image - sensor) / image * (0.05 / 4), rel=1e-9
    )
    spread = Wavefront().point_spread(lens, 1.0, math.inf)
    assert spread.cutoff_per_m(550.0) == pytest.approx(1 / (550e-9 * 4))
    assert set(Wavefront().waves(550.0, lens, 2.0, 2.0)) == set()


def test_sign_of_defocus_with_spherical_aberration() -> None:
    """For W = a r^4 the best focus has the opposite sign; the Zernike term includes it."""

    def strehl(defocus_nm: float) -> float:
        spread = Wavefront({4: defocus_nm, 11: 40.0}).point_spread(LENS, FAR)
        assert isinstance(spread, RadialPsf)
        s = np.linspace(0, 1, 2001)
        return float((spread.otf(s * spread.cutoff_per_m(550.0), 550.0) * s).sum())

    assert strehl(0.0) > strehl(30.0)
    assert strehl(0.0) > strehl(-30.0)


def test_chromatic_focus() -> None:
    table = Spectrum([450.0, 650.0], [-20.0, 40.0])
    wavefront = Wavefront(defocus_um=5.0, chromatic_focus=table)
    for wavelength, shift_um in ((400.0, -15.0), (550.0, 15.0), (700.0, 45.0)):
        alone = Wavefront(defocus_um=shift_um)
        ours, other = (w.waves(wavelength, LENS, 2.0)[2, 0] for w in (wavefront, alone))
        assert ours == pytest.approx(other, rel=1e-12)
        rim = shift_um * 1e3 / (8 * LENS.working_f_number(2.0) ** 2) / wavelength
        assert ours * math.sqrt(12) == pytest.approx(rim, rel=1e-12)


def test_chromatic_focus_of_zero_at_one_wavelength() -> None:
    """A wavelength without defocus has fewer Zernike terms than the others."""
    focus = Spectrum(np.array([450.0, 550.0, 650.0]), np.array([-10.0, 0.0, 12.0]))
    both = Wavefront({6: 50.0}, pupil=NEARLY_ROUND, chromatic_focus=focus).point_spread(LENS, FAR)
    alone = Wavefront({6: 50.0}, pupil=NEARLY_ROUND).point_spread(LENS, FAR)
    f = np.linspace(0, 0.6, 9)
    for nm in (450.0, 550.0):
        got = plane_otf(both, f, 0 * f, nm)
    np.testing.assert_allclose(got, plane_otf(alone, f, 0 * f, 550.0), atol=1e-12)


def test_reach_encloses_the_stated_energy() -> None:
    """Encircled energy from the OTF is 99.5 %."""
    for wavefront in (Wavefront({4: 300.0}), Wavefront({11: 100.0}, pupil=Pupil(obscuration=0.3))):
        spread = wavefront.point_spread(LENS, FAR)
        assert isinstance(spread, RadialPsf)
        cutoff, reach = spread.cutoff_per_m(550.0), spread.reach_m(550.0)
        s = np.linspace(0, 1, 40_001)
        # Energy within R: 2 pi R integral of otf(f) J1(2 pi R f) df.
        held = (
            2
            * math.pi
            * reach
            * cutoff
            * np.trapezoid(spread.otf(s * cutoff, 550.0) * j1(2 * math.pi * reach * cutoff * s), s)
        )
        assert 0.994 < held < 0.9985


def test_phase_goes_as_one_over_wavelength() -> None:
    in_nm, in_waves = Wavefront({8: 63.28}), Wavefront({8: 0.1}, unit="waves", reference_nm=632.8)
    assert in_nm.terms_nm == pytest.approx(dict(in_waves.terms_nm))
    assert in_nm.waves(316.4, LENS, FAR)[3, 1] == pytest.approx(0.2)


def test_indices_against_the_published_tables() -> None:
    """Noll 1976, table I; the University of Arizona's Fringe list."""
    noll = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2)]
    assert list(zernike_terms(dict.fromkeys(range(1, 14), 1.0))) == noll
    fringe = [(0, 0), (1, 1), (1, -1), (2, 0), (2, 2), (2, -2), (3, 1), (3, -1), (4, 0), (3, 3), (3, -3)]
    fringe += [(4, 2), (4, -2)]
    assert list(zernike_terms(dict.fromkeys(range(1, 14), 1.0), "fringe")) == fringe
    # Fringe 9 is 6 r^4 - 6 r^2 + 1, whose RMS is 1 / sqrt 5; Fringe 7 is (3 r^3 - 2 r) cos, 1 / sqrt 8.
    peak = zernike_terms({9: 1.0, 7: 1.0}, "fringe")
    assert peak == pytest.approx({(4, 0): 1 / math.sqrt(5), (3, 1): 1 / math.sqrt(8)})


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"coefficients": {0: 1.0}}, "Zernike term"),
        ({"coefficients": {4: math.nan}}, "coefficients[4]"),
        ({"coefficients": {(3, 2): 1.0}, "index": "nm"}, "Zernike term"),
        ({"coefficients": {4: 1.0}, "index": "nm"}, "Zernike term"),
        ({"coefficients": {4: 1.0}, "index": "ansi"}, "index"),
        ({"coefficients": {5000: 1.0}}, "Zernike term"),
        ({"unit": "waves"}, "reference_nm"),
        ({"reference_nm": 550.0}, "reference_nm"),
        ({"unit": "um"}, "unit"),
        ({"norm": "pv"}, "norm"),
        ({"defocus_um": math.inf}, "defocus_um"),
    ],
)
def test_invalid_wavefronts(change: dict[str, object], what: str) -> None:
    with raises(InputError, what):
        Wavefront(**change)  # type: ignore[arg-type]


def test_array_of_a_disc_agrees_with_the_disc() -> None:
    """Partly open cells at the rim give an error of 0.7 over the cells across."""
    n = 512
    amplitude, _, _ = Pupil().cells(n)
    spread = replace(Wavefront({8: 60.0}), pupil=Pupil(amplitude=np.minimum(amplitude, 1.0))).point_spread(LENS, FAR)
    disc = Wavefront({8: 60.0}).point_spread(LENS, FAR)
    f = np.linspace(-0.9, 0.9, 41)
    difference = plane_otf(spread, f[:, None], f[None], 550.0) - plane_otf(disc, f[:, None], f[None], 550.0)
    assert np.abs(difference).max() < 1.5e-3
