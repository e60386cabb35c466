"""The cache of transfers, and the tolerance with few modes, compared with lenses without a cache."""

from __future__ import annotations

import gc
import pickle
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.camera import channel_transfers
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import LateralColor
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread

BASE = DiffractionLimited(4, 50)
D200 = ps.load_sensor("nikon-d200").with_(rows=44, cols=64)
FEW: dict[str, Any] = {"wavelength_nm": np.arange(380, 781, 40)}


@dataclass(frozen=True, eq=False)
class Counted:
    """A Gaussian that grows with distance and wavelength, and the calls of its transfer function."""

    calls: list[float]

    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> PointSpread:
        def otf(fy: NDArray[np.float64], fx: NDArray[np.float64], wavelength_nm: float) -> NDArray[np.complex128]:
            self.calls.append(wavelength_nm)
            sigma_m = 2e-6 * distance_m * wavelength_nm / 550
            return np.asarray(np.exp(-2 * (np.pi * sigma_m) ** 2 * (fy**2 + fx**2)), np.complex128)

        return PlanePsf(otf, lambda w: 0.6e6 / distance_m * 550 / w, lambda w: 8e-6 * distance_m * w / 550)


def counted(**parts: Any) -> tuple[Lens, list[float]]:
    calls: list[float] = []
    return Lens(BASE, Counted(calls), **parts), calls


def test_second_frame_uses_the_cache() -> None:
    lens, calls = counted()
    scene = ps.charts.macbeth(**FEW)
    first = ps.Camera(lens, D200).mean_electrons(scene, 0.1)
    asked = len(calls)
    again = ps.Camera(lens, D200.with_(rows=44, cols=64)).mean_electrons(scene, 0.1)
    assert asked > 0
    assert len(calls) == asked
    assert (again == first).all()
    ps.Camera(lens, D200.with_(rows=88, cols=96)).mean_electrons(scene, 0.3)
    assert len(calls) == asked  # the lens does not depend on the size of the frame or the exposure


def test_cache_key_has_scene_distance_sensor_and_cells() -> None:
    """Alternating frames through one lens, compared with a new lens for each frame."""
    chart, color = ps.charts.macbeth(**FEW), LateralColor.from_magnification([400, 700], [1.0005, 0.9995])
    lens, _ = counted(lateral_color=color)
    smaller = D200.with_(fill_factor=D200.pixel.fill_factor.value / 2)
    cases: list[tuple[ps.Scene, ps.Sensor, int]] = [
        (chart, D200, 1),
        (ps.charts.macbeth("A", **FEW), D200, 1),
        (ps.charts.macbeth(distance_m=1.5, **FEW), D200, 1),
        (chart, smaller, 1),
        (chart, D200.with_(cfa=(("B", "G"), ("G", "R"))), 1),
        (chart, D200, 3),
    ]
    for scene, sensor, cells in [*cases, cases[0]]:
        fresh, _ = counted(lateral_color=color)
        expected = ps.Camera(fresh, sensor, cells_per_pixel=cells).mean_electrons(scene, 0.1)
        assert (ps.Camera(lens, sensor, cells_per_pixel=cells).mean_electrons(scene, 0.1) == expected).all()


def test_lateral_colour_samples_each_wavelength_once() -> None:
    scene, sensor = ps.charts.macbeth(**FEW), D200
    alone, calls_alone = counted()
    ps.Camera(alone, sensor).mean_electrons(scene, 0.1)
    lens, calls = counted(lateral_color=LateralColor.from_magnification([400, 700], [1.004, 0.996]))
    ps.Camera(lens, sensor).mean_electrons(scene, 0.1)
    assert len(calls) == len(calls_alone)


def test_cache_is_limited_and_freed_with_the_lens() -> None:
    lens, calls = counted()
    camera = ps.Camera(lens, D200)
    for distance_m in np.linspace(1, 2, 9):
        camera.mean_electrons(ps.charts.macbeth(distance_m=distance_m, **FEW), 0.1)
    asked = len(calls)
    camera.mean_electrons(ps.charts.macbeth(distance_m=1.0, **FEW), 0.1)
    assert len(calls) > asked  # the first was dropped
    before = len(channel_transfers._cache)
    del lens, camera
    gc.collect()
    assert len(channel_transfers._cache) < before


def test_used_lens_pickles() -> None:
    lens = Lens(DiffractionLimited(8, 50), focus_distance_m=2.0)
    before = ps.Camera(lens, D200).mean_electrons(ps.charts.macbeth(distance_m=1.5, **FEW), 0.1)
    other = pickle.loads(pickle.dumps(lens))
    assert (ps.Camera(other, D200).mean_electrons(ps.charts.macbeth(distance_m=1.5, **FEW), 0.1) == before).all()


@dataclass(frozen=True, eq=False)
class Stated:
    """A design's field with another stated error, which decides how well its terms are combined."""

    design: LensDesign
    relative_error: float

    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> PointSpread:
        whole = self.design.point_spread(base, distance_m, focus_distance_m)
        assert isinstance(whole, FieldPsf)
        return replace(whole, relative_error=self.relative_error)


def growing() -> LensDesign:
    """Gaussians that grow to one side, and shift, towards the edge of a small field."""
    axis = np.arange(-20, 21) * 0.6
    places = np.linspace(0, 0.25, 5)
    y, x = axis[:, None], axis[None, :]
    spots = np.stack(
        [
            [np.exp(-(y**2 + (x - 8 * h * color) ** 2) / (2 * (1 + 6 * h * color) ** 2)) for color in (0.7, 1.0, 1.4)]
            for h in places
        ]
    )
    return LensDesign(np.array([450.0, 550, 650]), spots, 0.6, np.zeros(5), places, rank=6)


def test_tolerance_is_a_hundredth_of_the_error_of_the_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    design, scene = growing(), ps.charts.macbeth(**FEW)
    terms: list[int] = []
    plain = channel_transfers._terms

    def noted(*arguments: Any) -> Any:
        terms.append(len((found := plain(*arguments))[1]))
        return found

    monkeypatch.setattr(channel_transfers, "_terms", noted)
    frames = [ps.Camera(Lens(BASE, Stated(design, error)), D200).mean_electrons(scene, 0.1) for error in (0.0, 0.03)]
    assert terms[0] > terms[1]
    assert 0 < np.linalg.norm(frames[1] - frames[0]) < 0.01 * 0.03 * np.linalg.norm(frames[0])
