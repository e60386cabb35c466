"""Lateral chromatic aberration with few node maps and terms, compared with one frame per wavelength node."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.camera import channel_transfers
from photosite.camera import mean_image as mosaic
from photosite.camera.mean_image import frame_wavelength_nodes
from photosite.engine.layers import Layer
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor, RadialMapping
from photosite.optics.lens import Lens, Optics
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import PointSpread
from photosite.optics.wavefront import Wavefront
from photosite.scene.scene import Scene

BASE = DiffractionLimited(4, 50)
SENSOR = ps.load_sensor("nikon-d200").with_(rows=60, cols=88)
COLORS = LateralColor.from_magnification([400, 550, 700], [1.012, 1.0, 0.99])


def comet() -> LensDesign:
    """Return a lens whose Gaussian PSFs have a tail that grows towards the edge and with wavelength."""
    axis = np.arange(-20, 21) * 0.6
    places = np.linspace(0, 0.4, 5)
    y, x = axis[:, None], axis[None, :]
    spots = np.stack(
        [
            [np.exp(-(y**2 + (x - 8 * h * color) ** 2) / (2 * (1 + 6 * h * color) ** 2)) for color in (0.7, 1.0, 1.4)]
            for h in places
        ]
    )
    return LensDesign(np.array([450.0, 550, 650]), spots, 0.6, np.zeros(5), places, rank=4)


def scene() -> Scene:
    """Return a scene of six spectra in blocks, one of them a narrow line."""
    grid = np.arange(400.0, 701, 10)
    random = np.random.default_rng(12)
    basis = random.random((6, grid.size)) * 1e15
    basis[5] = 3e16 * (grid == 610)
    weights = np.kron(random.random((6, 20, 29)), np.ones((3, 3))).astype(np.float32)
    return Scene(weights, basis, grid)


class OneColor:
    """A lens whose distortion is that of one wavelength."""

    def __init__(self, lens: Lens, wavelength_nm: float) -> None:
        self._lens, self._at = lens, wavelength_nm

    def __getattr__(self, name: str) -> object:
        return getattr(self._lens, name)

    def point_spread(self, distance_m: float) -> PointSpread:
        return self._lens.point_spread(distance_m)

    def mapping(self, distance_m: float) -> RadialMapping | None:
        from photosite.optics.distortion import heights_at

        whole = self._lens.mapping(distance_m)
        assert whole is not None
        return RadialMapping(np.array([self._at]), whole.ideal_m, heights_at(whole, self._at)[None])


def sum_over_nodes(lens: Lens, what: Scene) -> NDArray[np.float64]:
    """Return the sum of one frame per wavelength node, each reduced separately."""
    pitch = mosaic.pitch_m(SENSOR)
    nodes_nm, fractions = frame_wavelength_nodes(lens.mapping(what.distance_m), what.wavelength_nm, (60, 88), pitch)
    assert len(nodes_nm) > 3
    total = np.zeros((60, 88))
    for node_nm, fraction in zip(nodes_nm, fractions, strict=True):
        optics: Optics = OneColor(lens, node_nm)  # type: ignore[assignment]
        total += mosaic.image_rate(replace(what, basis=what.basis * fraction), ps.Camera(optics, SENSOR))
    return total


@pytest.mark.parametrize(
    "lens",
    [
        Lens(BASE, lateral_color=COLORS),
        pytest.param(
            Lens(BASE, Wavefront({8: 120.0}), lateral_color=COLORS, distortion=Distortion.polynomial(-0.2)),
            marks=pytest.mark.slow,
        ),
        Lens(BASE, comet(), lateral_color=COLORS),
    ],
    ids=["diffraction", "coma and distortion", "lens design"],
)
def test_lateral_color_equals_the_sum_over_nodes(lens: Lens, monkeypatch: pytest.MonkeyPatch) -> None:
    what = scene()
    monkeypatch.setattr(channel_transfers, "_TOLERANCE_PER_FIELD_ERROR", 0.0)
    expected = sum_over_nodes(lens, what)
    got = mosaic.image_rate(what, ps.Camera(lens, SENSOR))
    assert np.abs(got - expected).max() < 5e-5 * expected.max()
    monkeypatch.setattr(channel_transfers, "_TOLERANCE_WITH_NODES", 3e-7)
    monkeypatch.setattr(channel_transfers, "TOLERANCE", 3e-7)
    closer = mosaic.image_rate(replace(what), ps.Camera(lens, SENSOR))
    assert np.abs(closer - expected).max() < 1e-5 * expected.max()


def layers_of(lens: Lens, what: Scene, monkeypatch: pytest.MonkeyPatch) -> list[Layer]:
    seen: list[Layer] = []
    plain = mosaic.mosaic_of_layers
    monkeypatch.setattr(mosaic, "mosaic_of_layers", lambda layers, *rest: seen.extend(layers) or plain(layers, *rest))
    ps.Camera(lens, SENSOR).mean_electrons(what, 0.1)
    return seen


def test_one_spectrum_needs_one_map_per_node(monkeypatch: pytest.MonkeyPatch) -> None:
    """For all channels together, since they see multiples of one map."""
    one = Scene(scene().weights[:1], scene().basis[:1], scene().wavelength_nm)
    (layer,) = layers_of(Lens(BASE, lateral_color=COLORS), one, monkeypatch)
    assert layer.channel is None
    assert layer.node_maps is not None
    assert [len(few) for few in layer.node_maps] == [1] * len(layer.views)
    assert len(layer.mixing) <= len(layer.views)


def test_few_node_maps_and_terms_suffice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Per channel the number of terms is similar to that of the lens's modes, for any number of nodes."""
    seen = layers_of(Lens(BASE, comet(), lateral_color=COLORS), ps.charts.macbeth(), monkeypatch)
    assert [layer.channel for layer in seen] == [0, 1, 2]
    for layer in seen:
        assert len(layer.views) > 3
        assert layer.node_maps is not None
        assert sum(map(len, layer.node_maps)) <= 3 * len(layer.views)
        assert 4 <= len(layer.mixing) <= 16


@pytest.mark.parametrize("without_light", [("R", "G", "B"), ("G",)])
def test_channels_without_light_stay_dark(without_light: tuple[str, ...]) -> None:
    channels = {
        name: {
            "wavelength_nm": [400.0, 700.0],
            "quantum_efficiency": [0.0, 0.0] if name in without_light else [0.5, 0.5],
        }
        for name in ("R", "G", "B")
    }
    sensor = SENSOR.with_(channels=channels)
    got = ps.Camera(Lens(BASE, comet(), lateral_color=COLORS), sensor).mean_electrons(scene(), 0.1)
    for (r, c), name in np.ndenumerate(np.array(sensor.array.cfa)):
        assert got[r::2, c::2].any() == (name not in without_light)
