"""Derivatives of mean and variance: finite differences, adjoints, frames, and torch."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2, norm

import photosite as ps
from photosite.camera.signal_model import SignalModel
from photosite.errors import InputError
from photosite.metrics.patches import patch_statistics
from photosite.validation.fill_factor import fit_fill_factor

Array = NDArray[np.float64]

D200 = ps.load_sensor("nikon-d200").with_(rows=22, cols=31, black_level_dn=12)
AT_F8 = ps.DiffractionLimited(8, 50)
GRID = np.arange(380.0, 781.0, 50.0)
EXPOSURE_S = 1 / 20


def kernels(**leaks: float) -> dict[str, Any]:
    """Return kernels that are not symmetric, from the fraction that goes to the right."""
    return {name: [[0, k / 2, 0], [k / 4, 1 - 2.25 * k, k], [0, k / 2, 0]] for name, k in leaks.items()}


FULL = D200.with_(
    dark_current_e_per_s=900.0,
    dcnu_percent=30.0,
    well_capacity_e=32_600.0,
    low_pass_filter={"split_x_um": 5.0, "split_y_um": 3.0},
    angular_response={"angle_deg": [0.0, 30.0], "relative_response": [1.0, 0.6], "exit_pupil_mm": 0.5},
    crosstalk={"optical": kernels(R=0.05, G=0.02, B=0.01), "electrical": kernels(R=0.03, G=0.02, B=0.04)},
)
"""A D200 with all that has derivatives but effects; well and converter limit the signal at nearly the same light."""

EFFECTS = FULL.with_(
    response_curve={"polynomial_percent": [-3.0, 0.0, -4.0]},
    interpixel_capacitance={"coupling_percent": 2.0, "diagonal_percent": 0.4},
)
TABLE = {"charge_e": [0, 10000, 22000, 31000], "deviation_percent": [0, -0.5, -2.5, -3.0]}


def scene(rows: int = 9, cols: int = 14, count: int = 3, seed: int = 1) -> ps.Scene:
    """Return a scene of few spectra, from black to saturation."""
    rng = np.random.default_rng(seed)
    weights = (rng.random((count, rows, cols)) * np.linspace(0, 1, cols) ** 2).astype(np.float32)
    return ps.Scene(weights, 8e15 * rng.random((count, GRID.size)), GRID)


def full_model(**changes: Any) -> SignalModel:
    lens = ps.DiffractionLimited(4, 6, falloff="cos4")
    return SignalModel(replace(ps.Camera(lens, FULL), **changes), scene(), EXPOSURE_S)


MODELS = {
    "full": full_model(),
    "effects": full_model(sensor=EFFECTS),
    "table": full_model(sensor=FULL.with_(response_curve=TABLE)),
}
CASES = [("full", name) for name in MODELS["full"].parameters]
CASES += [("effects", name) for name in MODELS["effects"].parameters if name != "black_level_dn"]
CASES += [("table", name) for name in ("weights", "system_gain_dn_per_e", "well_capacity_e", "read_noise_e")]


@pytest.fixture(scope="module")
def model() -> SignalModel:
    return MODELS["full"]


def directions(model: SignalModel, seed: int = 2) -> dict[str, Array]:
    """Return a direction for every parameter, of about the size of its value; of the well 1 % of it."""
    rng = np.random.default_rng(seed)
    sizes = {name: np.abs(value) + 0.1 for name, value in model.values.items()}
    sizes["well_capacity_e"] = 0.01 * sizes["well_capacity_e"]
    return {name: np.asarray(size * rng.normal(size=size.shape)) for name, size in sizes.items()}


CAMERAS = {
    "diffraction": ps.Camera(AT_F8, D200),
    "three cells": ps.Camera(ps.DiffractionLimited(2.8, 20, falloff="cos4"), D200, cells_per_pixel=3),
    "all": ps.Camera(ps.DiffractionLimited(4, 6, falloff="cos4"), FULL),
    "defocus": ps.Camera(ps.Lens(ps.DiffractionLimited(4, 50), ps.optics.Wavefront({4: 80.0})), D200),
    "monochrome": ps.Camera(AT_F8, D200.with_(cfa="mono", channels={"M": D200.channels["G"]})),
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_light_is_that_of_the_camera(camera: ps.Camera) -> None:
    """Within what single precision and the reduction to few terms leave."""
    expected = camera.mean_electrons(scene(), EXPOSURE_S)
    found = SignalModel(camera, scene(), EXPOSURE_S).mean_electrons()
    assert np.abs(found - expected).max() < 5e-6 * expected.max()


def test_other_values_are_those_of_another_camera() -> None:
    model = MODELS["effects"]
    values: dict[str, Any] = {
        "fill_factor": 0.5,
        "f_number": 5.6,
        "focal_length_mm": 9.0,
        "electrical_crosstalk": [kernels(M=k)["M"] for k in (0.01, 0.1, 0.03)],
        "system_gain_dn_per_e": 0.2,
        "read_noise_e": 25.0,
        "dsnu_e": 3.0,
        "prnu_percent": 2.0,
        "dark_current_e_per_s": 100.0,
        "dcnu_percent": 10.0,
        "black_level_dn": 40.0,
        "well_capacity_e": 30_000.0,
        "quantum_efficiency": 0.9 * model.values["quantum_efficiency"] + 0.02,
        "polynomial_percent": [-2.0, -5.0, 1.0],
        "diagonal_percent": 0.2,
    }
    weights, time_s = 0.5 * scene().weights, 0.03
    camera = model.camera_at(values)
    changed = {"weights": weights, "exposure_s": time_s}
    own = SignalModel(camera, replace(scene(), weights=weights), time_s)
    for found, expected in zip(model(values | changed), own(), strict=True):
        assert np.abs(found - expected).max() < 1e-9 * expected.max()
    light = camera.mean_electrons(replace(scene(), weights=weights), time_s)
    assert np.abs(model.mean_electrons(values | changed) - light).max() < 5e-6 * light.max()


@pytest.mark.parametrize(("of", "name"), CASES)
def test_derivatives_agree_with_finite_differences(of: str, name: str) -> None:
    """Within 1e-6 of the largest derivative, over dark, lit and saturated pixels."""
    model = MODELS[of]
    values = model.values
    for positive in ("weights", "quantum_efficiency"):
        values[positive] = values[positive] + 0.05  # both sides are positive
    direction = directions(model)[name]
    assert values[name].any()
    step = 1e-4

    def at(times: float) -> Array:
        return np.stack(model(values | {name: values[name] + times * step * direction}))

    near, far = (at(k) - at(-k) for k in (1.0, 2.0))
    differences = (8 * near - far) / (12 * step)
    exact = model.jvp(values, {name: direction})
    for found, expected in zip(exact, differences, strict=True):
        if name in ("read_noise_e", "dsnu_e", "prnu_percent", "dcnu_percent") and found is exact.mean_dn:
            assert np.abs(found - expected).max() < 1e-6 * np.abs(exact.variance_dn2).max()
        else:
            assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_gradient_is_the_adjoint_of_the_derivative(model: SignalModel) -> None:
    """<c, J t> = <J^T c, t> for each parameter alone and for all together."""
    rng = np.random.default_rng(3)
    cotangents = rng.normal(size=(2, 22, 31)) * [[[1.0]], [[0.01]]]
    along = directions(model)
    gradient = model.vjp({}, tuple(cotangents), model.parameters)

    def product(names: tuple[str, ...]) -> float:
        return float((cotangents * np.stack(model.jvp({}, {name: along[name] for name in names}))).sum())

    for names in (*((name,) for name in model.parameters), model.parameters):
        terms = [float((gradient[name] * along[name]).sum()) for name in names]
        assert sum(terms) == pytest.approx(product(names), rel=1e-12, abs=1e-12 * max(map(abs, terms)))


@pytest.mark.parametrize("cells", [1, 3])
def test_the_image_has_an_exact_adjoint(cells: int) -> None:
    model = SignalModel(replace(CAMERAS["diffraction"], cells_per_pixel=cells), scene(), EXPOSURE_S)
    rng = np.random.default_rng(4)
    w, y = rng.random((3, 9, 14)), rng.normal(size=(22, 31))
    image = model.mean_electrons({"weights": w})
    # Far from the limits the mean is black level plus gain times electrons.
    far = {"system_gain_dn_per_e": 1e-2, "black_level_dn": 2000.0, "well_capacity_e": 1e6}
    adjoint = 100.0 * model.vjp(far, (y, np.zeros_like(y)), ["weights"])["weights"]
    assert (adjoint * w).sum() == pytest.approx((y * image).sum(), rel=1e-12, abs=1e-12 * np.abs(y * image).sum())


# Frames: mean and variance over pixels of many chips, close to black and to saturation

PI = ps.load_sensor("raspberry-pi-hq")  # its full well is 6 DN above its white level
COLUMNS, ROWS, CHIPS, FALSE_ALARM = 48, 4096, 6, 1e-3


@pytest.mark.parametrize(
    ("sensor", "brightest"),
    [
        pytest.param(PI.with_(prnu_percent=1.0, dsnu_e=2.0), 1.0, id="both limits at once"),
        pytest.param(D200.with_(well_capacity_e=20_000), 1.0, id="well"),
        pytest.param(D200.with_(dark_current_e_per_s=2e3, dcnu_percent=3), 1.0, id="dark current"),
        pytest.param(D200.with_(black_level_dn=0, read_noise_e=8, dsnu_e=2), 0.004, id="clipped blacks"),
        pytest.param(D200.with_(response_curve=TABLE), 1.0, id="response curve"),
        pytest.param(
            PI.with_(
                interpixel_capacitance={"coupling_percent": 2.5, "diagonal_percent": 0.5},
                response_curve={"polynomial_percent": [0.0, -4.0]},
            ),
            1.0,
            id="coupled and bent",
        ),
    ],
)
def test_moments_are_those_of_frames(sensor: ps.Sensor, brightest: float) -> None:
    """At most 96 normal deviates, the largest of which exceeds the limit in one of 1000 seeds.

    `brightest` is the light of column 42 over that of saturation. The rows of a column see the same light, with another
    fixed pattern each.
    """
    name = sensor.channel_names[0]
    sensor = sensor.with_(rows=48, cols=COLUMNS, cfa="mono", channels={"M": sensor.channels[name]}, gain_settings=())
    ramp = np.broadcast_to(np.linspace(0, 1.25, COLUMNS) ** 3, (1, 48, COLUMNS)).astype(np.float32)
    light = ps.Scene(ramp, np.full((1, GRID.size), 1e17), GRID)
    camera = ps.Camera(AT_F8, sensor)
    time_s = brightest * sensor.saturation_capacity_e / float(camera.mean_electrons(light, 1.0)[24, 42])
    mean, variance = (each[24] for each in SignalModel(camera, light, time_s)())
    electrons = np.tile(camera.mean_electrons(light, time_s)[24], (ROWS, 1))
    chips = [replace(camera, sensor=sensor.with_(rows=ROWS, serial=str(n))) for n in range(CHIPS)]
    frames = [chip.expose(electrons, time_s, seed=n).dn for n, chip in enumerate(chips)]
    if sensor.effects is not None and sensor.effects.interpixel_capacitance is not None:
        frames = [frame[1:-1:3] for frame in frames]  # pixels without a common neighbor
    dn = np.concatenate(frames).astype(np.float64)
    assert variance.min() < variance.max() / 2
    from_mean = dn - mean
    fourth = (from_mean**4).mean(axis=0)
    of_mean = from_mean.mean(axis=0) / np.sqrt(variance / len(dn) + 1e-12)
    seen = variance > 0.01  # less is of a few numbers below the limit, whose squares are not normal
    of_variance = ((from_mean**2).mean(axis=0) - variance)[seen] / np.sqrt((fourth - variance**2)[seen] / len(dn))
    limit = norm.isf(FALSE_ALARM / (4 * COLUMNS))
    assert variance.min() < variance.max() / 2
    assert np.abs(of_mean).max() < limit
    assert np.abs(of_variance).max() < limit


# torch


def test_torch_gradients() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed (extra ml)")
    camera = ps.Camera(AT_F8, EFFECTS.with_(rows=4, cols=6, low_pass_filter=None))
    model = SignalModel(camera, scene(3, 4, 2), EXPOSURE_S)
    names = (
        *("weights", "quantum_efficiency", "fill_factor", "f_number", "electrical_crosstalk", "read_noise_e"),
        *("exposure_s", "polynomial_percent", "coupling_percent"),
    )
    tensors = [torch.tensor(model.values[name] + 0.05, requires_grad=True) for name in names]

    def moments(*given: Any) -> Any:
        mean, variance = model.torch(dict(zip(names, given, strict=True)))
        return mean, variance.sqrt()

    assert torch.autograd.gradcheck(moments, tensors, eps=1e-5, rtol=1e-4, atol=1e-3, fast_mode=True)
    single = torch.tensor(0.5, dtype=torch.float32, requires_grad=True)
    model.torch({"fill_factor": single})[0].sum().backward()
    expected = model.vjp({"fill_factor": 0.5}, (np.ones((4, 6)), np.zeros((4, 6))))["fill_factor"]
    assert single.grad.dtype == torch.float32
    mean, _ = model.torch({"fill_factor": single, "f_number": 5.6})  # a number is a constant
    assert np.array_equal(mean.detach().numpy(), model({"fill_factor": 0.5, "f_number": 5.6}).mean_dn)
    assert float(single.grad) == pytest.approx(float(expected), rel=1e-6)


def test_torch_is_optional(model: SignalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    model()
    with pytest.raises(InputError) as caught:
        model.torch({})
    assert "ml" in (caught.value.hint or "")


# What has no derivatives


def test_a_camera_without_derivatives_is_an_error() -> None:
    gauss = np.exp(-np.add.outer(np.arange(-9.0, 10) ** 2 / 8, np.arange(-9.0, 10) ** 2 / 16))
    table = ps.optics.PsfTable([550.0], [gauss / gauss.sum()], spacing_um=0.25)
    lens, plain = ps.DiffractionLimited(4, 50), scene()
    wrong: list[tuple[str, Any, Any]] = [
        ("optics", ps.Camera(ps.Lens(lens, table), D200), plain),
        ("optics.distortion", ps.Camera(ps.Lens(lens, distortion=ps.optics.Distortion.polynomial(-0.1)), D200), plain),
        ("optics.veiling_glare", ps.Camera(ps.Lens(lens, veiling_glare=ps.optics.VeilingGlare(0.02)), D200), plain),
        ("sensor.effects.blooming", ps.Camera(lens, EFFECTS.with_(blooming={"drained": 0.9})), plain),
        ("sensor.captures", ps.Camera(lens, ps.load_sensor("dual-gain-phone").with_(rows=8, cols=8)), plain),
        ("scene", ps.Camera(lens, D200), ps.scenes.DynamicScene(plain, motion=ps.scenes.Motion(cols_per_s=3))),
    ]
    for what, camera, seen in wrong:
        with pytest.raises(InputError) as caught:
            SignalModel(camera, seen, EXPOSURE_S)
        assert caught.value.what == what


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"fill_factor": 1.2}, "fill_factor"),
        ({"exposure_s": 0.0}, "exposure_s"),
        ({"read_noise_e": -1.0}, "read_noise_e"),
        ({"read_noise_e": np.nan}, "read_noise_e"),
        ({"weights": np.zeros((3, 9, 13))}, "weights"),
        ({"weights": np.full((3, 9, 14), -1.0)}, "electrons from light"),
        ({"fill": 0.5}, "unknown parameter 'fill'"),
        ({"fill_factor": "most"}, "fill_factor"),
        (0.5, "values"),
        ({"quantum_efficiency": np.full((3, 41), 1.1)}, "quantum_efficiency"),
    ],
)
def test_invalid_values_are_errors(values: dict[str, Any], what: str, model: SignalModel) -> None:
    with pytest.raises(InputError) as caught:
        model(values)
    assert caught.value.what == what


def test_parameters_that_a_camera_lacks_are_errors() -> None:
    fixed = SignalModel(ps.Camera(ps.Lens(AT_F8), D200), scene(), EXPOSURE_S)
    for name in ("f_number", "focal_length_mm", "optical_crosstalk"):
        assert name not in fixed.parameters
        with pytest.raises(InputError) as caught:
            fixed.jvp({}, {name: 1.0})
        assert caught.value.hint
    for name in ("polynomial_percent", "coupling_percent"):
        with pytest.raises(InputError) as caught:
            MODELS["table"].jvp({}, {name: 1.0})
        assert caught.value.hint
    other = {name: one.model_dump() for name, one in D200.channels.items()}
    other["R"] |= {"wavelength_nm": (400, 700), "quantum_efficiency": (0.1, 0.2), "standard_uncertainty": None}
    uneven = SignalModel(ps.Camera(AT_F8, D200.with_(channels=other)), scene(), EXPOSURE_S)
    with pytest.raises(InputError) as caught:
        uneven({"quantum_efficiency": np.ones((3, 2))})
    assert caught.value.hint
    with pytest.raises(InputError) as caught:
        MODELS["effects"]({"polynomial_percent": [0.0, 0.0, -90.0]})
    assert caught.value.what == "polynomial_percent"
    wide = SignalModel(ps.Camera(AT_F8, D200), replace(scene(), width_m=0.004), EXPOSURE_S)
    assert "focal_length_mm" not in wide.parameters
    assert "f_number" in wide.parameters


# A fit


@pytest.mark.slow
def test_fits_by_gradient_find_the_truth_and_agree_with_the_fit_of_patch_means() -> None:
    """20 pulls of chi-square at 1 of 1000 on either side; and 10 differences at 1 of 1000 altogether.

    Both fits see the same frame. Their errors are taken as independent, so that the differences tend to be smaller.
    """
    spread, seeds = np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]]), 10
    chart = ps.charts.macbeth("D65", 100)

    def camera(fill_factor: float, leak: float, serial: str) -> ps.Camera:
        kernel = (np.outer([0, 1, 0], [0, 1, 0]) + leak * spread).tolist()
        crosstalk = {"electrical": dict.fromkeys("RGB", kernel)}
        sensor = D200.with_(rows=84, cols=124, black_level_dn=64, serial=serial, fill_factor=fill_factor)
        return ps.Camera(AT_F8, sensor.with_(crosstalk=crosstalk))

    pulls, differences = [], []
    for seed in range(seeds):
        truth = np.random.default_rng(seed).uniform([0.6, 0.005], [0.95, 0.04])
        measured, start = camera(*truth, f"measured {seed}"), camera(0.8, 0.0, "simulated")
        time_s = 0.5 * measured.auto_exposure_s(measured.mean_electrons(chart, 1.0))
        raw = measured.capture(chart, time_s, seed=seed)
        model = SignalModel(start, chart, time_s)
        bare = model.values["electrical_crosstalk"]

        def values(x: Array, bare: Array = bare) -> dict[str, Any]:
            return {"fill_factor": x[0], "electrical_crosstalk": bare + x[1] * spread}

        def cost(x: Array, raw: Any = raw, model: SignalModel = model) -> tuple[float, Array]:
            mean, variance = model(values(x))
            error = raw.dn - mean
            cotangents = -error / variance, (1 - error**2 / variance) / (2 * variance)
            of = model.vjp(values(x), cotangents)
            gradient = np.array([of["fill_factor"], (of["electrical_crosstalk"] * spread).sum()])
            return float((error**2 / variance + np.log(variance)).mean() / 2), gradient / error.size

        found = minimize(cost, [0.8, 0.0], jac=True, bounds=[(0.1, 1.0), (0.0, 0.2)])
        _, variance = model(values(found.x))
        along: tuple[dict[str, Any], ...] = {"fill_factor": 1.0}, {"electrical_crosstalk": np.array([spread] * 3)}
        slopes = [model.jvp(values(found.x), direction) for direction in along]
        information = [[np.sum(a * b / variance + c * d / variance**2 / 2) for b, d in slopes] for a, c in slopes]
        covariance = np.linalg.inv(information)
        pulls.append((found.x - truth) @ np.linalg.inv(covariance) @ (found.x - truth))
        again = camera(0.8, found.x[1], "simulated").capture(chart, time_s, seed=1000 + seed)
        regions = model.camera.image_regions(chart)
        fit = fit_fill_factor(*(patch_statistics(shot, regions) for shot in (raw, again)), fill_factor=0.8)
        differences.append((found.x[0] - fit.value) / np.hypot(np.sqrt(covariance[0, 0]), fit.standard_error))
    assert chi2.ppf(1e-3, 2 * seeds) < np.sum(pulls) < chi2.isf(1e-3, 2 * seeds)
    assert np.abs(differences).max() < norm.isf(1e-3 / (2 * seeds))
