"""Every public object pickles, copies, fits a screen and lists public names only; tables, thumbnails and plots."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import multiprocessing
import operator
import pickle
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from object_instances import INSTANCES, base, calibration, frames, lens, raw, scene, sensor, series, validation
from pydantic import BaseModel

import photosite as ps
from photosite.errors import InputError
from photosite.frames.frame_set import FrameSource
from photosite.values.deferred import Deferred
from photosite.values.uncertain import Source, Uncertain

WAYS = {"pickle": lambda one: pickle.loads(pickle.dumps(one)), "copy": copy.copy, "deepcopy": copy.deepcopy}


def plain_camera() -> ps.Camera:
    return ps.Camera(ps.Lens(base(), veiling_glare=ps.optics.VeilingGlare(0.1)), sensor())


def fields(one: object) -> dict[str, Any]:
    if isinstance(one, BaseModel):
        return {name: getattr(one, name) for name in type(one).model_fields}
    return {entry.name: getattr(one, entry.name) for entry in dataclasses.fields(one)}  # type: ignore[arg-type]


def has_fields(one: object) -> bool:
    return isinstance(one, BaseModel) or (dataclasses.is_dataclass(one) and not isinstance(one, type))


def assert_same(one: Any, other: Any, where: str) -> None:
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, where
        np.testing.assert_array_equal(one, other, where)
    elif isinstance(one, FrameSource):
        np.testing.assert_array_equal(one.read(), other.read(), where)
    elif isinstance(one, Deferred):
        assert_same(one.value, other.value, where)
    elif isinstance(one, Mapping):
        if any(isinstance(key, Source) for key in one):  # equal only if they are the same object
            one, other = dict(enumerate(one.values())), dict(enumerate(other.values()))
        assert list(one) == list(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}[{key}]")
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for number, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where}[{number}]")
    elif has_fields(one):
        assert type(one) is type(other), where
        for name, value in fields(one).items():
            assert_same(value, fields(other)[name], f"{where}.{name}")
    elif not callable(one):
        assert one == other or (one != one and other != other), where


def parts(one: Any, seen: set[int]) -> Iterator[Any]:
    """Yield an object of photosite and those that it holds."""
    if id(one) in seen or isinstance(one, np.ndarray | str):
        return
    seen.add(id(one))
    if has_fields(one):
        yield one
        for value in fields(one).values():
            yield from parts(value, seen)
    elif isinstance(one, Mapping | tuple | list):
        for value in one.values() if isinstance(one, Mapping) else one:
            yield from parts(value, seen)


def test_every_public_class_has_an_instance() -> None:
    public = [getattr(module, name) for module in (ps, ps.optics, ps.scenes) for name in module.__all__]
    classes = {one.__name__: one for one in public if inspect.isclass(one) and not issubclass(one, Exception)}
    assert classes.keys() <= set(INSTANCES)
    assert all(isinstance(INSTANCES[name](), one) for name, one in classes.items())


@pytest.mark.parametrize("name", INSTANCES)
@pytest.mark.parametrize("way", WAYS)
def test_pickles_and_copies(name: str, way: str) -> None:
    one = INSTANCES[name]()
    assert_same(one, WAYS[way](one), name)


@pytest.mark.parametrize("way", WAYS)
def test_copies_compute_the_same(way: str) -> None:
    again = WAYS[way]
    shots = [one.capture(scene(), 0.01, seed=2) for one in (plain_camera(), again(plain_camera()))]
    np.testing.assert_array_equal(*shots)
    fy, fx = np.array([0.0, 2e4]), np.array([3e4, 0.0])
    for name in ("PlanePsf", "TablePsf"):
        spread = INSTANCES[name]()
        np.testing.assert_array_equal(again(spread).otf(fy, fx, 550.0), spread.otf(fy, fx, 550.0))
    radial = base().point_spread(2.0)
    np.testing.assert_array_equal(again(radial).otf(fx, 550.0), radial.otf(fx, 550.0))
    assert again(radial).reach_m(550.0) == radial.reach_m(550.0)
    assert again(calibration()).to_dict() == calibration().to_dict()
    assert ps.calibrate(again(frames())).to_dict() == calibration().to_dict()
    assert isinstance(again(calibration()).read_noise_e.uncertain, Uncertain)


@pytest.mark.slow
def test_another_process_computes_the_same() -> None:
    """A process that starts afresh receives every object, and captures the same frame."""
    capture = operator.methodcaller("capture", scene(), 0.01, seed=2)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for name, make in INSTANCES.items():
            assert_same(make(), pool.apply(copy.copy, (make(),)), name)
        np.testing.assert_array_equal(pool.apply(capture, (plain_camera(),)), capture(plain_camera()))


@pytest.mark.parametrize("name", INSTANCES)
def test_fits_a_screen(name: str) -> None:
    for part in parts(INSTANCES[name](), set()):
        lines = repr(part).splitlines()
        assert len(lines) <= 12, repr(part)[:400]
        assert max(map(len, lines)) <= 100, repr(part)[:400]
        assert not [entry for entry in dir(part) if entry.startswith("_")], type(part)


def test_modules_list_public_names() -> None:
    groups = (module for name in ps.__all__ if inspect.ismodule(module := getattr(ps, name)))
    for module in (ps, *groups):
        assert dir(module) == sorted(module.__all__)
        assert all(hasattr(module, name) for name in dir(module))
    assert not {"np", "annotations", "model_dump", "copy"} & {*dir(sensor()), *dir(ps.illuminants)}
    assert {"with_", "pixel", "save"} <= set(dir(sensor()))


def test_raw_frames_are_arrays() -> None:
    shot = raw()
    assert np.asarray(shot) is shot.dn
    assert np.array(shot) is not shot.dn
    assert np.asarray(shot, dtype=np.float32).dtype == np.float32
    assert np.mean(shot) == shot.dn.mean()
    with pytest.raises(ValueError, match="copy"):
        np.asarray(shot, dtype=np.float32, copy=False)
    axes = pyplot.figure().add_subplot()
    assert axes.imshow(shot).get_array().shape == shot.shape
    pyplot.close("all")


def test_metadata_are_read_only() -> None:
    with pytest.raises(TypeError):
        raw().metadata["iso"] = 100  # type: ignore[index]
    assert dict(raw().metadata)["seed"] == 3


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ((sensor(), base()), "optics"),
        ((base(), base()), "sensor"),
        ((8, sensor()), "optics"),
        ((base(), "d200"), "sensor"),
    ],
)
def test_camera_refuses_the_wrong_order(arguments: tuple[Any, Any], what: str) -> None:
    with pytest.raises(InputError) as caught:
        ps.Camera(*arguments)
    assert caught.value.what == what
    assert caught.value.value is arguments[0 if what == "optics" else 1]
    assert "Camera(optics, sensor)" in (caught.value.hint or "")


TABLES = {
    "Calibration": ("parameter", "read_noise_e"),
    "FrameSet": ("exposure_s", 0.03),
    "GainSeries": ("setting", 200.0),
    "NoiseBudget": ("volts", 0.1),
    "Sensor": ("field", "read_noise_mv"),
    "Spectrum": ("wavelength_nm", 550.0),
    "Validation": ("patch", "black"),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables(name: str, monkeypatch: pytest.MonkeyPatch, read_page: Any) -> None:
    pandas = pytest.importorskip("pandas")
    one, (column, cell) = INSTANCES[name](), TABLES[name]
    page = read_page(one._repr_html_())
    assert len(page.rows) - 1 == min(len(one.to_dataframe()), 60) + (len(one.to_dataframe()) > 60)
    assert isinstance(one.to_dict(), dict)
    frame = one.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert cell in set(frame[column])
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError) as caught:
        one.to_dataframe()
    assert "[dataframe]" in (caught.value.hint or "")


def test_data_frames_hold_the_values() -> None:
    pytest.importorskip("pandas")
    found = calibration().to_dataframe().set_index("parameter")
    assert found.loc["read_noise_dn", "value"] == calibration().read_noise_dn.value
    assert found.loc["quantum_efficiency_percent", "reason"] == calibration().quantum_efficiency_percent.reason
    groups = frames().to_dataframe()
    assert groups["frames"].tolist() == [4] * 5
    compared = validation().to_dataframe()
    np.testing.assert_array_equal(compared["measured_dn"], validation().measured.mean_dn.ravel())


def test_thumbnails_are_small() -> None:
    """Also of large frames, which are read in steps."""
    large = ps.RawFrame(np.full((3000, 4000), 700, np.uint16), bits=12, cfa=(("R", "G"), ("G", "B")))
    quad = ps.RawFrame(np.full((600, 800), 700, np.uint16), bits=12, cfa=(("R", "W"), ("G", "B")))
    dark = ps.RawFrame(np.zeros((20, 30), np.uint16), bits=12)
    tiny = ps.RawFrame(np.ones((1, 1), np.uint16), bits=12, cfa=(("R", "G"), ("G", "B")))
    big = ps.charts.zone_plate("D65", 100, cols=1500)
    for one in (raw(), large, quad, dark, tiny, scene(), big, scene().scaled(0)):
        text = one._repr_html_()
        assert text.startswith('<figure><img src="data:image/png;base64,')
        assert len(text) < 800_000


PLOTS = {
    "sensor": (sensor, {}, "quantum efficiency (%)"),
    "calibration": (calibration, {}, None),
    "calibration dark": (calibration, {"kind": "dark_signal"}, None),
    "series": (series, {}, "Read noise (e⁻)"),
    "budget": (INSTANCES["NoiseBudget"], {}, "signal-to-noise ratio (dB)"),
    "validation": (validation, {}, "measured (DN)"),
    "spectrum": (INSTANCES["Spectrum"], {}, "value"),
    "raw": (raw, {}, "row"),
    "scene": (scene, {}, "row"),
    "mtf": (lens, {"distance_m": 2.0}, "modulation"),
    "psf": (lens, {"kind": "psf", "distance_m": 2.0}, "y (µm)"),
    "airy mtf": (base, {}, "modulation"),
    "field psf": (lambda: ps.Lens(base(), INSTANCES["LensDesign"]()), {"kind": "psf", "at_mm": (0, 8)}, "y (µm)"),
}


@pytest.mark.parametrize("name", PLOTS)
def test_plots(name: str) -> None:
    make, options, label = PLOTS[name]
    axes = make().plot(**options)
    assert isinstance(axes, Axes)
    assert axes.has_data()
    assert label is None or axes.get_ylabel() == label
    own = pyplot.figure().add_subplot()
    assert make().plot(**options, ax=own) is own
    pyplot.close("all")


def test_the_plotted_mtf_is_the_lens_s() -> None:
    lines = base().plot(wavelength_nm=550.0).get_lines()
    frequency, modulation = lines[0].get_data()
    np.testing.assert_allclose(modulation, base().otf(np.asarray(frequency) * 1e3, 550.0, np.inf))
    pyplot.close("all")


@pytest.mark.parametrize(("make", "options"), [(lens, {"kind": "otf"}), (calibration, {"kind": "transfer"})])
def test_unknown_plots_are_refused(make: Any, options: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        make().plot(**options)
    assert (caught.value.what, caught.value.value) == ("kind", options["kind"])
