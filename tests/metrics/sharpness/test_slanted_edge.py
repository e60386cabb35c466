"""The slanted edge against the known MTF of simulated raw frames and of closed-form profiles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises
from scipy.special import erf

import photosite as ps
from photosite.camera.mean_image import electrons_per_weight
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.sharpness.slanted_edge import SlantedEdge, slanted_edge_mtf
from photosite.optics.lens import Lens
from photosite.optics.point_spread import PlanePsf
from photosite.optics.wavefront import Wavefront

D200 = ps.load_sensor("nikon-d200")
MONO = D200.with_(cfa="mono", channels={"M": D200.channels["G"].model_dump()})
CELLS = 5
UP_TO_NYQUIST = slice(0, 51)


def camera_of(sensor: ps.Sensor, f_number: float, rows: int = 160, cols: int = 160, cells: int = CELLS) -> ps.Camera:
    lens = ps.DiffractionLimited(f_number=f_number, focal_length_mm=50)
    return ps.Camera(lens, sensor.with_(rows=rows, cols=cols), cells_per_pixel=cells)


def edge_of(camera: ps.Camera, angle_deg: float) -> ps.Scene:
    """One scene sample per cell: every cell holds its exact fraction of the bright side."""
    rows, cols = (n * camera.cells_per_pixel for n in (camera.sensor.array.rows, camera.sensor.array.cols))
    return ps.charts.slanted_edge("D65", 100, angle_deg=angle_deg, rows=rows, cols=cols)


def optics_and_aperture(camera: ps.Camera, scene: ps.Scene, channel: str, angle_deg: float) -> NDArray[np.float64]:
    """(101,) MTF across the edge, 0 to 1 cycle/pixel: diffraction of the channel's light times the photodetector."""
    pitch_m = camera.sensor.pixel.width_um.value * 1e-6
    frequency_per_m = np.linspace(0, 1, 101) / pitch_m
    electrons = electrons_per_weight(scene, camera).sum(axis=1)
    fraction = electrons[camera.sensor.channel_names.index(channel)]
    otf = np.zeros(101)
    for part, wavelength_nm in zip(fraction / fraction.sum(), scene.wavelength_nm, strict=True):
        cutoff = 1 / (wavelength_nm * 1e-9 * camera.optics.working_f_number(scene.distance_m))
        r = np.minimum(frequency_per_m / cutoff, 1.0)
        otf += part * 2 / math.pi * (np.arccos(r) - r * np.sqrt(1 - r * r))
    return otf * box(camera.sensor.pixel.fill_factor.value**0.5, angle_deg)


def box(side_pixels: float, angle_deg: float) -> NDArray[np.float64]:
    """(101,) MTF of a square along a direction."""
    frequency, angle = np.linspace(0, 1, 101), math.radians(angle_deg)
    across: NDArray[np.float64] = np.sinc(frequency * math.cos(angle) * side_pixels)
    return across * np.sinc(frequency * math.sin(angle) * side_pixels)


def cell_mtf(cells: int, angle_deg: float) -> NDArray[np.float64]:
    """(101,) MTF of sampling the scene on cells: a mean over each cell, uniform within it."""
    return box(1 / cells, angle_deg) ** 2


@pytest.mark.parametrize("f_number", [2.8, 8.0])
def test_mtf_is_optics_times_aperture(f_number: float) -> None:
    """Within 0.01 up to Nyquist; with nine cells per pixel the MTF of the cells is negligible."""
    camera = camera_of(MONO, f_number, cells=9)
    scene = edge_of(camera, 5)
    found = slanted_edge_mtf(camera.mean_electrons(scene, 1 / 60))
    expected = optics_and_aperture(camera, scene, "M", 5)
    assert np.abs(found.mtf - expected)[UP_TO_NYQUIST].max() < 0.01
    assert np.abs(found.mtf - expected * cell_mtf(9, 5))[UP_TO_NYQUIST].max() < 0.004


@pytest.mark.parametrize("angle_deg", [-8.0, 3.0, 5.0, 12.0, 20.0])
@pytest.mark.parametrize("f_number", [2.8, 8.0])
def test_at_any_angle(f_number: float, angle_deg: float) -> None:
    camera = camera_of(MONO, f_number)
    scene = edge_of(camera, angle_deg)
    found = slanted_edge_mtf(camera.mean_electrons(scene, 1 / 60))
    expected = optics_and_aperture(camera, scene, "M", angle_deg) * cell_mtf(CELLS, angle_deg)
    assert np.abs(found.mtf - expected)[UP_TO_NYQUIST].max() < 0.005
    assert found.angle_deg == pytest.approx(angle_deg, abs=0.005)
    assert found.direction == "vertical"


def test_through_an_aberrated_lens() -> None:
    """Oblique coma and spherical aberration, green sites of the mosaic: within 0.01 up to Nyquist."""
    lens = Lens(ps.DiffractionLimited(f_number=2, focal_length_mm=50), blur=Wavefront({7: 70.0, 8: 90.0, 11: 110.0}))
    response = {"wavelength_nm": (520.0, 550.0, 580.0), "quantum_efficiency": (0.2, 0.5, 0.3)}
    sensor = D200.with_(rows=160, cols=160, channels=dict.fromkeys("RGB", response))
    samples = 160 * CELLS
    scene = ps.charts.slanted_edge(
        "D65", 100, angle_deg=-12, rows=samples, cols=samples, wavelength_nm=response["wavelength_nm"]
    )
    found = slanted_edge_mtf(
        ps.Camera(lens, sensor, cells_per_pixel=CELLS).mean_electrons(scene, 1 / 60), channel="G", cfa=sensor.array.cfa
    )
    across = found.frequency_cycles_per_pixel / 6.05e-6
    fy, fx = across * math.sin(math.radians(-12)), across * math.cos(math.radians(-12))
    green = electrons_per_weight(scene, ps.Camera(lens, sensor))[0].sum(axis=0)
    spread = lens.point_spread(scene.distance_m)
    assert isinstance(spread, PlanePsf)
    otf = sum(part * spread.otf(fy, fx, nm) for part, nm in zip(green / green.sum(), scene.wavelength_nm, strict=True))
    expected = np.abs(otf) * box(0.9**0.5, -12) * cell_mtf(CELLS, -12)
    assert expected[50] < 0.3  # without the aberrations 0.58
    assert np.abs(found.mtf - expected)[UP_TO_NYQUIST].max() < 0.01


@pytest.mark.parametrize("channel", ["R", "G", "B"])
@pytest.mark.parametrize("f_number", [2.8, 8.0])
def test_on_the_sites_of_one_channel(f_number: float, channel: str) -> None:
    """Each channel has its own spectrum, and so its own diffraction."""
    camera = camera_of(D200, f_number)
    scene = edge_of(camera, 5)
    electrons = camera.mean_electrons(scene, 1 / 60)
    found = slanted_edge_mtf(electrons, channel=channel, cfa=D200.array.cfa)
    expected = optics_and_aperture(camera, scene, channel, 5) * cell_mtf(CELLS, 5)
    assert np.abs(found.mtf - expected)[UP_TO_NYQUIST].max() < 0.005
    assert found.channel == channel


def test_noisy_raw_frames() -> None:
    """Mean of eight raw frames, green sites, all noise except the fixed pattern: within 0.01."""
    camera = camera_of(D200.with_(prnu_percent=0, dsnu_mv=0, black_level_dn=50), 2.8, rows=320, cols=112)
    scene = edge_of(camera, 5)
    frames = [raw.dn - 50.0 for raw in camera.stream(scene, 1 / 60, frames=8, seed=4)]
    region = (0, 320, 6, 106)
    found = slanted_edge_mtf(np.mean(frames, axis=0), region, "G", cfa=D200.array.cfa)
    expected = optics_and_aperture(camera, scene, "G", 5) * cell_mtf(CELLS, 5)
    assert np.abs(found.mtf - expected)[UP_TO_NYQUIST].max() < 0.01
    assert 0.0005 < found.standard_uncertainty[50] < 0.004


def test_black_level_is_subtracted() -> None:
    """One noisy frame with fixed pattern: within the stated uncertainty."""
    camera = camera_of(D200.with_(black_level_dn=200), 2.8, rows=160, cols=112)
    scene = edge_of(camera, 5)
    found = slanted_edge_mtf(camera.capture(scene, 1 / 60, seed=2), channel="G", pitch_um=6.05)
    expected = optics_and_aperture(camera, scene, "G", 5) * cell_mtf(CELLS, 5)
    off = (found.mtf - expected)[1:51] / np.hypot(found.standard_uncertainty[1:51], 0.004)
    assert np.abs(off).max() < 4
    assert found.frequency_cycles_per_mm[50] == pytest.approx(1 / (2 * 6.05e-3))


def test_the_uncertainty_is_the_spread_over_frames() -> None:
    camera = camera_of(D200.with_(prnu_percent=0, dsnu_mv=0), 2.8, rows=120, cols=120)
    frames = camera.stream(edge_of(camera, 5), 1 / 60, frames=40, seed=5)
    found = [slanted_edge_mtf(raw, channel="G") for raw in frames]
    spread = np.std([edge.mtf for edge in found], axis=0, ddof=1)
    stated = np.mean([edge.standard_uncertainty for edge in found], axis=0)
    # 40 frames give a standard deviation to 11 %; these five frequencies are nearly independent.
    apart = [10, 20, 30, 40, 50]
    assert np.sqrt(np.mean((spread[apart] / stated[apart]) ** 2)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(
    ("full_e", "sigma", "size", "options"),
    [
        (5000.0, 0.6, (80, 64), {}),
        (300.0, 0.6, (80, 64), {}),  # the uncertainty is 8 % of the value
        (1000.0, 1.2, (120, 100), {"window": "hamming"}),
        (2000.0, 0.8, (80, 64), {"cfa": (("R", "G"), ("G", "B")), "channel": "G"}),
    ],
)
def test_intervals_of_mtf50_hold_the_truth(
    full_e: float, sigma: float, size: tuple[int, int], options: dict[str, Any]
) -> None:
    """A fraction of 0.91 to 0.99 of 250 intervals of 95 %; others have a chance of 1 % if 95 to 97 % hold it."""
    edge = full_e * (gaussian_edge(*size, 0.1, sigma) - 50) / 350
    truth = slanted_edge_mtf(edge, **options).mtf50
    rng, inside = np.random.default_rng(7), []
    for _ in range(250):
        found = slanted_edge_mtf(rng.poisson(edge) + rng.normal(0, 4, size), **options)
        assert found.mtf50 is not None
        assert found.mtf50_standard_uncertainty is not None
        inside.append(abs(found.mtf50 - truth) < 1.96 * found.mtf50_standard_uncertainty)
    assert 0.91 <= np.mean(inside) <= 0.99


def test_the_uncertainty_of_mtf50_follows_the_noise() -> None:
    edge, rng = gaussian_edge(80, 64, 0.1, 0.6), np.random.default_rng(1)
    noise = rng.normal(0, 1, edge.shape)
    little, much = (slanted_edge_mtf(edge + spread * noise).mtf50_standard_uncertainty for spread in (0.5, 2.0))
    assert much == pytest.approx(4 * little, rel=0.2)
    # An edge of a tenth of a pixel's blur: its MTF is above 0.5 up to the sampling frequency.
    sharp = slanted_edge_mtf(gaussian_edge(80, 64, 0.1, 0.1))
    assert sharp.mtf50 is None
    assert sharp.mtf50_standard_uncertainty is None


def gaussian_edge(rows: int, cols: int, slope: float, sigma: float, position: float | None = None) -> Any:
    """Point values of an edge with Gaussian blur: its MTF is exp(-2 (pi f sigma)^2)."""
    y, x = np.mgrid[:rows, :cols] + 0.5
    middle = cols / 2 if position is None else position
    distance = (x - middle - slope * (y - rows / 2)) / math.hypot(1, slope)
    return 100 + 150 * (1 + erf(distance / (sigma * math.sqrt(2))))


def gaussian(sigma: float) -> NDArray[np.float64]:
    transfer: NDArray[np.float64] = np.exp(-2 * (math.pi * np.linspace(0, 1, 101) * sigma) ** 2)
    return transfer


@pytest.mark.parametrize("oversampling", [2, 4, 8])
def test_losses_by_differences_and_bins_are_corrected(oversampling: int) -> None:
    """A Gaussian has no tails to truncate: the rest is the error of the method."""
    found = slanted_edge_mtf(gaussian_edge(200, 80, -0.0871, 0.6), oversampling=oversampling)
    assert np.abs(found.mtf - gaussian(0.6))[UP_TO_NYQUIST].max() < 0.002
    assert found.mtf50 == pytest.approx(math.sqrt(math.log(2) / 2) / (math.pi * 0.6), abs=1e-3)


def test_the_hamming_window_smooths_the_curve() -> None:
    """The window attenuates the flanks of a Gaussian line spread function; compare with the computed transform."""
    found = slanted_edge_mtf(gaussian_edge(200, 80, -0.0871, 3.0), window="hamming")
    x = np.arange(-found.distance[-1], found.distance[-1], 0.01)
    spread = np.exp(-0.5 * (x / 3) ** 2) * (0.54 + 0.46 * np.cos(math.pi * x / (found.distance[-1] + 0.125)))
    wave = np.cos(2 * math.pi * np.linspace(0, 1, 101)[:, None] * x)
    assert found.mtf[:30] == pytest.approx((wave @ spread)[:30] / spread.sum(), abs=1e-3)
    assert np.abs(found.mtf - gaussian(3.0)).max() > 3e-3


@pytest.mark.parametrize("flip", ["left-right", "up-down", "transposed", "bright left"])
def test_any_orientation(flip: str) -> None:
    plain = gaussian_edge(160, 160, 0.1, 0.8, 70.0)
    turned = {
        "left-right": plain[:, ::-1],
        "up-down": plain[::-1],
        "transposed": plain.T,
        "bright left": plain.max() - plain,
    }[flip]
    found = slanted_edge_mtf(turned)
    assert np.abs(found.mtf - gaussian(0.8))[UP_TO_NYQUIST].max() < 0.002
    angle = math.degrees(math.atan(0.1))
    assert found.direction == ("horizontal" if flip == "transposed" else "vertical")
    expected = {"left-right": angle, "up-down": angle, "transposed": angle}.get(flip, -angle)
    assert found.angle_deg == pytest.approx(expected, abs=0.01)
    assert found.profile[0] == pytest.approx(0, abs=1e-3)
    assert found.profile[-1] == pytest.approx(1, abs=1e-3)
    assert (np.diff(found.distance) > 0).all()


def test_edge_position_in_frame_coordinates() -> None:
    """Coordinates are those of the frame for any region, and the tile starts at the first pixel of the region."""
    frame = gaussian_edge(200, 180, -0.09, 0.7, 83.3)
    frame[0::2, 1::2] *= 3  # another channel, which must not contribute
    found = slanted_edge_mtf(frame, (31, 190, 33, 140), "A", cfa=(("A", "B"), ("A", "A")))
    assert found.line.tolist() == list(range(31, 190))
    expected = 83.3 - 0.09 * (found.line + 0.5 - 100)
    assert np.abs(found.edge_position - expected).max() < 0.01
    assert np.abs(found.mtf - gaussian(0.7))[UP_TO_NYQUIST].max() < 0.003


def test_slope_and_position_are_near_the_cramer_rao_bound() -> None:
    """Scatter of slope and position over noisy frames against the Cramer-Rao bound."""
    slope, sigma, noise = 0.1, 0.7, 30.0
    clean = gaussian_edge(120, 60, slope, sigma)
    y, x = np.mgrid[:120, :60] + 0.5
    distance = (x - 30 - slope * (y - 60)) / math.hypot(1, slope)
    steepness = 300 / (sigma * math.sqrt(2 * math.pi)) * np.exp(-0.5 * (distance / sigma) ** 2) / math.hypot(1, slope)
    rng = np.random.default_rng(9)
    found = [slanted_edge_mtf(clean + rng.normal(0, noise, clean.shape)) for _ in range(40)]
    slopes = np.array([-math.tan(math.radians(edge.angle_deg)) for edge in found])
    places = np.array([edge.edge_position[59:61].mean() for edge in found])
    # 40 frames give a standard deviation to 11 %. The position uses two bins of the profile and is not optimal.
    assert np.sqrt(np.mean((slopes - slope) ** 2)) < 1.3 * noise / math.sqrt(((steepness * (y - 60)) ** 2).sum())
    assert np.sqrt(np.mean((places - 30) ** 2)) < 1.8 * noise / math.sqrt((steepness**2).sum())


def raw_edge(scale: float = 10.0) -> RawFrame:
    dn = np.minimum(gaussian_edge(100, 80, 0.1, 0.7) * scale, 4095).astype(np.uint16)
    return RawFrame(dn, bits=12, cfa=(("R", "G"), ("G", "B")))


BENT = 100.0 + 100 * (np.mgrid[:100, :80][1] > 25 + 0.01 * (np.arange(100)[:, None] - 40) ** 2)
NOISE = np.random.default_rng(1).normal(100, 10, (100, 80))
INVALID: list[tuple[Any, dict[str, Any], str]] = [
    (raw_edge(), {}, "channel"),
    (raw_edge(), {"channel": "g"}, "channel"),
    (raw_edge(11), {"channel": "G"}, "fraction of saturated G pixels"),
    (raw_edge(), {"channel": "G", "region": (0, 101, 0, 80)}, "region"),
    (np.ones((100, 80)), {}, "contrast of the edge"),
    (np.zeros((100, 80)), {}, "contrast of the edge"),
    (NOISE, {}, "contrast of the edge"),
    (NOISE + 30 * (np.mgrid[:100, :80][1] > 70), {}, ""),
    (BENT, {}, "deviation of the edge from a straight line"),
    (gaussian_edge(100, 80, 0.0, 0.7), {}, "displacement of the edge"),
    (gaussian_edge(100, 80, 0.012, 0.7), {"cfa": (("A", "B"),), "channel": "A"}, "displacement of the edge"),
    (gaussian_edge(100, 120, 0.5, 0.7), {}, "angle of the edge"),
    (gaussian_edge(100, 80, 0.1, 0.7, 12.0), {}, "distance of the edge from the sides of the region"),
    (gaussian_edge(10, 80, 0.1, 0.7), {"region": (0, 10, 10, 70)}, "lines of pixels across the edge"),
    (gaussian_edge(100, 80, 0.1, 0.7), {"oversampling": 0}, "oversampling"),
    (gaussian_edge(100, 80, 0.1, 0.7), {"window": "hann"}, "window"),
    (gaussian_edge(100, 80, 0.1, 0.7), {"pitch_um": 0}, "pitch_um"),
    (np.full((100, 80), np.nan), {}, "frame"),
    (np.ones((100, 80, 3)), {}, "frame"),
]


@pytest.mark.parametrize(("frame", "options", "what"), INVALID)
def test_invalid_edges_are_rejected(frame: Any, options: dict[str, Any], what: str) -> None:
    with raises(InputError, what):
        slanted_edge_mtf(frame, **options)


def test_unmeasured_values_are_not_returned() -> None:
    found = slanted_edge_mtf(gaussian_edge(160, 80, 0.1, 0.05))
    assert isinstance(found, SlantedEdge)
    assert found.mtf50 is None
    with raises(InputError, "pitch_um"):
        _ = found.frequency_cycles_per_mm
    with raises(InputError, "frequency_cycles_per_pixel"):
        found.at(1.2)
    assert found.at([0.0, 0.105]) == pytest.approx([1.0, (found.mtf[10] + found.mtf[11]) / 2])
