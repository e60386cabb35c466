"""The optical stack compared with closed forms, sums by hand, and a loop over pixels and their neighbors."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.camera.optical_stack import apply_optical_stack, crosstalk_fractions, warn_of_transmittance_range
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.sensor.optical_stack import Crosstalk

LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
D200 = ps.load_sensor("nikon-d200").with_(rows=40, cols=44)
GRID = np.arange(380.0, 781.0, 10)
BAYER = (("R", "G"), ("G", "B"))


def one_light(sensor: ps.Sensor, name: str = "M") -> ps.Sensor:
    """A monochrome sensor for light of 550 nm."""
    return sensor.with_(cfa="mono", channels={name: {"wavelength_nm": [550], "quantum_efficiency": [0.5]}})


def kernels(size: int, seed: int) -> dict[str, list[list[float]]]:
    """A kernel for each color, different in every direction."""
    rng = np.random.default_rng(seed)
    drawn = rng.random((3, size, size))
    return {name: (kernel / kernel.sum()).tolist() for name, kernel in zip("RGB", drawn, strict=True)}


def handed_out(mosaic: NDArray[np.float64], of: dict[str, Any], tile: tuple[tuple[str, ...], ...]) -> Any:
    """Each pixel gives its fractions to its neighbors; shares outside the frame are lost."""
    rows, cols = mosaic.shape
    out = np.zeros_like(mosaic)
    for r, c in np.ndindex(rows, cols):
        kernel = np.array(of[tile[r % len(tile)][c % len(tile[0])]])
        reach = len(kernel) // 2
        for i, j in np.ndindex(kernel.shape):
            row, col = r + i - reach, c + j - reach
            if 0 <= row < rows and 0 <= col < cols:
                out[row, col] += kernel[i, j] * mosaic[r, c]
    return out


# Crosstalk


def test_uniform_colours_match_the_mixing_matrix_by_hand() -> None:
    """RGGB, shares p to each side and d to each corner: every pixel at every site, borders included."""
    p, d = {"R": 0.02, "G": 0.01, "B": 0.005}, {"R": 0.004, "G": 0.002, "B": 0.001}
    plus = {n: [[d[n], p[n], d[n]], [p[n], 1 - 4 * p[n] - 4 * d[n], p[n]], [d[n], p[n], d[n]]] for n in "RGB"}
    light = ps.charts.uniform("A", 40)
    bare = ps.Camera(LENS, D200).mean_electrons(light, 0.1)
    red, green, blue = float(bare[0, 0]), float(bare[0, 1]), float(bare[1, 1])
    expected = {
        (0, 0): red * (1 - 4 * p["R"] - 4 * d["R"]) + 4 * p["G"] * green + 4 * d["B"] * blue,
        (0, 1): green * (1 - 4 * p["G"]) + 2 * p["R"] * red + 2 * p["B"] * blue,
        (1, 0): green * (1 - 4 * p["G"]) + 2 * p["R"] * red + 2 * p["B"] * blue,
        (1, 1): blue * (1 - 4 * p["B"] - 4 * d["B"]) + 4 * p["G"] * green + 4 * d["R"] * red,
    }
    for kind in ("optical", "electrical"):
        mixed = ps.Camera(LENS, D200.with_(crosstalk={kind: plus})).mean_electrons(light, 0.1)
        for (r, c), value in expected.items():
            assert np.abs(mixed[r::2, c::2] / value - 1).max() < 1e-6
    # The matrix takes light from none: R + 2 G + B of a tile stays.
    assert sum(expected.values()) == pytest.approx(red + 2 * green + blue, rel=1e-9)


def test_neutral_and_color_matrix_include_crosstalk() -> None:
    """The neutral in the metadata is the reading of a uniform field, and a chart is developed to its colors."""
    plus = [[0, 0.03, 0], [0.05, 0.84, 0.05], [0, 0.03, 0]]
    wide = [[0.02, 0.02, 0.02], [0.02, 0.84, 0.02], [0.02, 0.02, 0.02]]
    sensor = D200.with_(crosstalk={"optical": {"R": wide, "G": plus, "B": plus}})
    camera, light = ps.Camera(LENS, sensor), ps.charts.uniform("A", 100)
    even = camera.mean_electrons(light, 0.1)
    reading = np.array(
        [even[0::2, 0::2].mean(), (even[0::2, 1::2].mean() + even[1::2, 0::2].mean()) / 2, even[1::2, 1::2].mean()]
    )
    neutral = np.array(camera.as_shot_neutral(light).split(","), float)
    assert neutral == pytest.approx(reading / reading.max(), rel=1e-4)
    daylight = camera.mean_electrons(ps.charts.uniform("D65", 100), 0.1)
    white = np.array([daylight[0::2, 0::2].mean(), daylight[0::2, 1::2].mean(), daylight[1::2, 1::2].mean()])
    matrix = camera.capture(light, 0.1).color_matrix
    assert matrix @ [0.9505, 1.0, 1.089] == pytest.approx(white / white.max(), rel=0.02)
    bare = ps.Camera(LENS, D200).capture(light, 0.1).color_matrix
    assert np.abs(bare - matrix).max() > 0.05


def test_optical_crosstalk_precedes_electrical() -> None:
    """Random kernels per color, away from the border: the two stages, pixel by pixel."""
    crosstalk = Crosstalk.model_validate({"optical": kernels(3, 1), "electrical": kernels(5, 2)})
    rng = np.random.default_rng(3)
    mosaic = np.zeros((24, 30))
    mosaic[4:-4, 4:-4] = 1000 * rng.random((16, 22))
    expected = handed_out(handed_out(mosaic, crosstalk.optical, BAYER), crosstalk.electrical, BAYER)
    sensor = D200.with_(rows=24, cols=30, crosstalk=crosstalk.model_dump())
    got = apply_optical_stack(mosaic.astype(np.float32), sensor, LENS, 1.2)
    assert np.abs(got - expected)[3:-3, 3:-3].max() < 1e-6 * expected.max()
    assert got[4:-4, 4:-4].sum() < mosaic.sum()  # some of it has moved outside the lit part
    # All that is handed out arrives: the fractions of a lit pixel far from the border sum to 1.
    assert got[1:-1, 1:-1].sum(dtype=np.float64) == pytest.approx(mosaic.sum(), rel=1e-6)


def test_image_of_a_point_is_its_kernel() -> None:
    """A red point spreads by the red kernel, in the right orientation."""
    for name, place in {"R": (10, 12), "G": (10, 13), "B": (11, 13)}.items():
        point = np.zeros((40, 44), np.float32)
        point[place] = 1.0
        of = kernels(5, 7)
        got = apply_optical_stack(point, D200.with_(crosstalk={"electrical": of}), LENS, 1.2)
        r, c = place
        assert got[r - 2 : r + 3, c - 2 : c + 3] == pytest.approx(np.array(of[name]), abs=1e-7)
        assert np.count_nonzero(got) == 25


def test_fractions_of_each_pixel_sum_to_1() -> None:
    """For any tile, the fractions from one site sum to 1."""
    tile = (("R", "G", "G"), ("B", "G", "R"))
    crosstalk = Crosstalk.model_validate({"optical": kernels(5, 4), "electrical": kernels(3, 5)})
    fractions = crosstalk_fractions(crosstalk, tile)
    given = np.zeros((2, 3))
    for r, c, i, j in np.ndindex(fractions.shape):
        given[(r + i - 3) % 2, (c + j - 3) % 3] += fractions[r, c, i, j]
    assert given == pytest.approx(1.0, abs=1e-12)


# Filters


def test_electrons_behind_filters_are_the_integral_by_hand() -> None:
    table = {"wavelength_nm": [300, 600, 650, 900], "transmittance": [0.96, 0.9, 0.1, 0.0]}
    light = ps.charts.uniform("A", 40)
    sensor = D200.with_(infrared_filter=table, cover_glass=0.92)
    electrons = ps.Camera(LENS, sensor).mean_electrons(light, 0.1)
    grid = light.wavelength_nm
    passed = 0.92 * np.interp(grid, table["wavelength_nm"], table["transmittance"])
    for (r, c), name in {(0, 0): "R", (0, 1): "G", (1, 1): "B"}.items():
        efficiency = np.interp(grid, D200.channels[name].wavelength_nm, D200.channels[name].quantum_efficiency)
        irradiance = light.basis[0] * light.weights[0, 0, 0] * LENS.irradiance_per_radiance(grid, light.distance_m)
        rate = np.trapezoid(irradiance * passed * efficiency, grid) * D200.pixel_area_m2 * 0.9
        assert electrons[r, c] == pytest.approx(0.1 * rate, rel=1e-6)


def test_blocked_light_gives_no_warning() -> None:
    """The D200 responds to 780 nm, the scene ends at 700 nm: a warning, unless the filter ends there too."""
    scene = ps.Scene.uniform(np.full(31, 1e14), np.arange(400, 701, 10))
    edge = {"wavelength_nm": [300, 400, 410, 690, 700, 900], "transmittance": [0, 0, 1, 1, 0, 0]}
    broad = {"wavelength_nm": [380, 780], "quantum_efficiency": [0.5, 0.5]}
    sensor = D200.with_(channels=dict.fromkeys("RGB", broad))
    with pytest.warns(ps.errors.PhotositeWarning, match="response lies outside"):
        ps.Camera(LENS, sensor).mean_electrons(scene, 0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ps.Camera(LENS, sensor.with_(infrared_filter=edge)).mean_electrons(scene, 0.1)


def test_color_matrix_includes_filters() -> None:
    """A filter in the file equals the same filter in the quantum efficiencies."""
    table = {"wavelength_nm": [300, 500, 650, 800], "transmittance": [0.9, 1, 0.2, 0]}
    passed = np.interp(GRID, table["wavelength_nm"], table["transmittance"])
    channels = {
        name: {"wavelength_nm": GRID, "quantum_efficiency": passed * D200.channels[name].quantum_efficiency_at(GRID)}
        for name in "RGB"
    }
    inside, before = D200.with_(channels=channels), D200.with_(infrared_filter=table)
    light = ps.charts.macbeth()
    frames = [ps.Camera(LENS, sensor).capture(light, 0.1, seed=3) for sensor in (inside, before)]
    assert frames[0].color_matrix == pytest.approx(frames[1].color_matrix, rel=1e-9)
    assert not np.allclose(frames[0].color_matrix, ps.Camera(LENS, D200).capture(light, 0.1).color_matrix, rtol=1e-2)
    assert (frames[0].dn == frames[1].dn).mean() > 0.999


# The low-pass filter


def texture(rows: int, cols: int) -> ps.Scene:
    rng = np.random.default_rng(8)
    return ps.Scene(rng.random((1, rows, cols)).astype(np.float32), np.full((1, 3), 1e15), np.array([540.0, 550, 560]))


def test_four_spots_are_four_shifted_images() -> None:
    """Splits of two and four pixels: each pixel is the mean of the four that the spots come from."""
    sensor = one_light(D200.with_(rows=60, cols=70))
    pitch = sensor.pixel.width_um.value
    plain = ps.Camera(LENS, sensor).mean_electrons(texture(60, 70), 0.1).astype(np.float64)
    split = sensor.with_(low_pass_filter={"split_x_um": 2 * pitch, "split_y_um": 4 * pitch})
    got = ps.Camera(LENS, split).mean_electrons(texture(60, 70), 0.1)
    expected = sum(plain[8 + y : -8 + y, 8 + x : (-8 + x)] for y in (-2, 2) for x in (-1, 1)) / 4
    # With the filter the frame is padded by two pixels more: the Airy pattern's far tails differ.
    assert np.abs(got[8:-8, 8:-8] - expected).max() < 3e-5 * plain.max()


class Spot(ps.DiffractionLimited):
    """A Gaussian spot of a fifth of a pixel, as a spread of either kind."""

    kind = "radial"

    def point_spread(self, distance_m: float) -> Any:
        sigma_m = 1.2e-6

        def radial(frequency_per_m: NDArray[np.float64], wavelength_nm: float) -> NDArray[np.float64]:
            otf: NDArray[np.float64] = np.exp(-2 * (math.pi * sigma_m * frequency_per_m) ** 2)
            return otf

        ends = {"cutoff_per_m": lambda nm: 1.0 / sigma_m, "reach_m": lambda nm: 4 * sigma_m}
        if self.kind == "radial":
            return RadialPsf(otf=radial, **ends)
        return PlanePsf(otf=lambda fy, fx, nm: radial(np.hypot(fy, fx), nm) + 0j, **ends)


class Plane(Spot):
    kind = "plane"


@pytest.mark.parametrize(("lens", "pixels"), [(Spot(4, 50), 8), (Plane(4, 50), 30)], ids=["radial", "plane"])
def test_widely_split_spots_are_separate(lens: ps.DiffractionLimited, pixels: int) -> None:
    """Splits of many times the size of the PSF: the kernel contains both spots."""
    sensor = one_light(D200.with_(rows=60, cols=90))
    split = sensor.with_(low_pass_filter={"split_x_um": pixels * 6.05})
    plain, got = (
        ps.Camera(lens, chip, cells_per_pixel=3).mean_electrons(texture(60, 90), 0.1).astype(np.float64)
        for chip in (sensor, split)
    )
    half = pixels // 2
    expected = (plain[:, : -2 * half] + plain[:, 2 * half :]) / 2
    assert np.abs(got[:, half:-half] - expected)[4:-4, 4:-4].max() < 5e-6 * plain.max()


@pytest.mark.parametrize("periods", [4, 9, 16, 20])
def test_the_low_pass_filters_transfer_is_the_cosine(periods: int) -> None:
    """A sinusoid along the rows: the filter reduces its modulation by |cos(pi f split)|, and not across."""
    sensor = one_light(D200.with_(rows=20, cols=64))
    pitch_um = sensor.pixel.width_um.value
    # The wave goes on beyond the frame. Five samples and cells a pixel: what they add lies beyond the lens's cutoff.
    samples = np.arange(5 * 192)
    wave = 1 + 0.5 * np.cos(2 * np.pi * (samples + 0.5) * periods / (5 * 64))
    scene = ps.Scene(
        np.tile(wave, (1, 100, 1)).astype(np.float32),
        np.full((1, 3), 1e15),
        np.array([540.0, 550, 560]),
        width_m=192 * pitch_um * 1e-6 / LENS.magnification(1.2),
    )

    def modulation(changed: ps.Sensor) -> float:
        row = ps.Camera(LENS, changed, cells_per_pixel=5).mean_electrons(scene, 0.1)[10].astype(np.float64)
        spectrum = np.fft.rfft(row)
        return float(2 * abs(spectrum[periods]) / spectrum[0].real)

    split_um = 0.8 * pitch_um
    ratio = modulation(sensor.with_(low_pass_filter={"split_x_um": split_um})) / modulation(sensor)
    assert ratio == pytest.approx(abs(math.cos(math.pi * periods / 64 * 0.8)), abs=1e-4)
    across = modulation(sensor.with_(low_pass_filter={"split_y_um": split_um}))
    assert across == pytest.approx(modulation(sensor), rel=1e-5)


def test_low_pass_filter_keeps_a_uniform_field() -> None:
    light = ps.charts.uniform("A", 40)
    split = D200.with_(low_pass_filter={"split_x_um": 6, "split_y_um": 6})
    assert (ps.Camera(LENS, split).mean_electrons(light, 1) == ps.Camera(LENS, D200).mean_electrons(light, 1)).all()


# Angular response


def test_angular_response_follows_the_table() -> None:
    """The chief ray's angle from the exit pupil: each channel by its own table, linear in the angle."""
    angles, tables = [0.0, 10.0, 25.0], {"R": [1, 0.95, 0.8], "G": [1, 0.9, 0.6], "B": [1, 0.8, 0.3]}
    response = {"angle_deg": angles, "relative_response": tables, "exit_pupil_mm": 0.4}
    light = ps.charts.uniform("A", 40)
    bare = ps.Camera(LENS, D200).mean_electrons(light, 0.1)
    fallen = ps.Camera(LENS, D200.with_(angular_response=response)).mean_electrons(light, 0.1)
    for r, c in [(0, 0), (0, 43), (39, 0), (20, 22), (13, 7), (14, 7), (14, 8)]:
        y_mm, x_mm = (r + 0.5 - 20) * 6.05e-3, (c + 0.5 - 22) * 6.05e-3
        angle_deg = math.degrees(math.atan(math.hypot(y_mm, x_mm) / 0.4))
        expected = np.interp(angle_deg, angles, tables[BAYER[r % 2][c % 2]])
        assert fallen[r, c] / bare[r, c] == pytest.approx(expected, rel=1e-6)


def test_default_exit_pupil_is_a_thin_lens() -> None:
    """Image distance f (1 + |m|), m = f / (d - f): 1.3 mm and an object at 5 mm."""
    lens = ps.DiffractionLimited(f_number=4, focal_length_mm=1.3)
    image_mm = 1.3 * (1 + 1.3 / (5 - 1.3))
    table: dict[str, Any] = {"angle_deg": [0, 20], "relative_response": [1, 0.5]}
    light = ps.charts.uniform("A", 40, distance_m=5e-3)
    thin, given = (
        ps.Camera(lens, D200.with_(angular_response=table | more)).mean_electrons(light, 0.1)
        for more in ({}, {"exit_pupil_mm": image_mm})
    )
    assert thin == pytest.approx(given, rel=1e-6)
    assert thin[0, 0] < 0.95 * thin[20, 22]


def test_light_beyond_the_angular_response_table_is_an_error() -> None:
    table = {"angle_deg": [0, 10], "relative_response": [1, 0.9], "exit_pupil_mm": 0.4}
    with pytest.raises(InputError, match=r"at least 2\d\.\d+ degrees") as caught:
        ps.Camera(LENS, D200.with_(angular_response=table)).mean_electrons(ps.charts.uniform("A", 40), 0.1)
    assert (caught.value.where, caught.value.what) == ("optical_stack.angular_response", "angle_deg")
    assert caught.value.value == 10


def test_angular_response_comes_before_crosstalk() -> None:
    """The two in this order, by hand, in one row of a monochrome chip."""
    table = {"angle_deg": [0, 60], "relative_response": [1, 0], "exit_pupil_mm": 0.02}
    right = {"M": [[0, 0, 0], [0, 0.75, 0.25], [0, 0, 0]]}
    sensor = one_light(D200.with_(rows=1, cols=8))
    took = apply_optical_stack(np.ones((1, 8), np.float32), sensor.with_(angular_response=table), LENS, 1.2)
    both = apply_optical_stack(
        np.ones((1, 8), np.float32), sensor.with_(angular_response=table, crosstalk={"optical": right}), LENS, 1.2
    )
    assert both[0, 1:] == pytest.approx(0.75 * took[0, 1:] + 0.25 * took[0, :-1], rel=1e-6)


@pytest.mark.parametrize(
    ("wavelengths", "values", "warned"),
    [
        ([500, 600], [0.9, 0.9], True),
        ([380, 600], [0.9, 0.9], True),
        ([380, 780], [0.9, 0.9], False),
        ([490, 500, 600, 610], [0, 0.9, 0.9, 0], False),  # a table that ends at 0
    ],
)
def test_lens_table_that_ends_where_the_sensor_responds_is_a_warning(
    wavelengths: list[float], values: list[float], warned: bool
) -> None:
    table = ps.Spectrum(np.array(wavelengths, float), np.array(values, float))
    base = ps.DiffractionLimited(4, 50, table)
    for optics in (base, ps.Lens(base)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            ps.Camera(optics, D200).mean_electrons(ps.charts.uniform("A", 1), 0.1)
        assert any("transmittance table" in str(w.message) for w in caught) if warned else not caught


def test_fraction_outside_the_lens_table() -> None:
    """A uniform response from 400 to 700 nm and a table from 400 to 600 nm: a third lies outside."""
    sensor = D200.with_(cfa="mono", channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}})
    table = ps.Spectrum(np.array([400.0, 600.0]), np.array([0.9, 0.9]))
    with pytest.warns(PhotositeWarning, match=r"33\.3% of channel M's response .*, 400 to 600 nm, where"):
        warn_of_transmittance_range(ps.DiffractionLimited(4, 50, table), sensor)
