"""The mean image on a device against the CPU's, in arrays that refuse every implicit way to the host.

The device is array-api-strict's: NumPy's memory behind the functions of the array API standard, which CuPy has too.
tests/engine/test_cuda.py tests the digital numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from raising import raises

import photosite as ps

pytest.importorskip("array_api_strict", reason="needs array-api-strict, of the extra dev")
from device_arrays import DEVICE, StrictArrays

from photosite.errors import InputError
from photosite.frames.gpu_frame import GpuFrame
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.illumination import VeilingGlare
from photosite.optics.point_spread import FieldPsf, PlanePsf, RadialPsf
from photosite.scene.scene import Scene

TOLERANCE = 1e-6
"""Of the brightest pixel: rounding of 32-bit transforms; the cases differ by 2.6e-7 to 4.5e-7, the uniform one by 0."""

D200 = ps.load_sensor("nikon-d200").with_(rows=38, cols=54)
LOW_PASS = {"split_y_um": 3, "split_x_um": 5}
CROSSTALK = {"electrical": {name: [[0, 0.01, 0], [0.03, 0.9, 0.02], [0, 0.04, 0]] for name in "RGB"}}
ANGLES = {"angle_deg": [0, 0.05, 1], "relative_response": [1, 0.9, 0.5], "exit_pupil_mm": 50}


@dataclass(frozen=True)
class Lens(DiffractionLimited):
    """A lens with a given PSF, and darker corners."""

    f_number: float = 8.0
    focal_length_mm: float = 50.0
    given: Any = None
    veiling_glare: VeilingGlare | None = None

    def point_spread(self, distance_m: float) -> Any:
        return self.given or super().point_spread(distance_m)

    def relative_illumination(self, image_height_m: Any, distance_m: float) -> Any:
        return 1 / (1 + (image_height_m / 2e-4) ** 2)


def flare(y_m: float, x_m: float) -> PlanePsf:
    """Return a core of light, and a flare beside it."""

    def otf(fy: Any, fx: Any, wavelength_nm: float) -> Any:
        core, wide = (np.exp(-2 * (math.pi * sigma_m) ** 2 * (fy**2 + fx**2)) for sigma_m in (2.5e-6, 5e-6))
        return 0.7 * core + 0.3 * wide * np.exp(-2j * math.pi * (fy * y_m + fx * x_m))

    return PlanePsf(otf, lambda w: 1.2 / 2.5e-6, lambda w: 6 * 5e-6 + math.hypot(y_m, x_m))


def varying() -> FieldPsf:
    """Return a flare to one side at the upper left of the frame, to the other at the lower right."""
    nodes = np.array([-9e-5, 2e-5, 8e-5])
    first = np.add.outer([0.5, 0.3, 0.0], [0.5, 0.2, 0.0])
    weights = np.stack([first, 1.0 - first])
    return FieldPsf(nodes, nodes, weights, (flare(1.4e-5, 7e-6), flare(0.0, -2e-5)))


def ends_abruptly() -> RadialPsf:
    """Return a PSF whose transfer is 0.4 up to its cutoff, below the highest frequency of the cells, and 0 beyond."""
    return RadialPsf(lambda f, w: np.where(f <= 7e4, 1 - 0.6 * f / 7e4, 0.0), lambda w: 7e4, lambda w: 6e-5)


def patches(rows: int = 11, cols: int = 13) -> Scene:
    rng = np.random.default_rng(2)
    grid = np.arange(400.0, 701, 20)
    return Scene(rng.random((4, rows, cols)).astype(np.float32), 1e14 * rng.random((4, grid.size)), grid)


CASES: dict[str, tuple[Any, dict[str, Any], int, Any]] = {
    "radial": (DiffractionLimited(8, 50), {}, 1, patches()),
    "fine scene": (DiffractionLimited(2.8, 50), {}, 1, patches(90, 131)),
    "low-pass filter": (
        DiffractionLimited(4, 50),
        {"low_pass_filter": {"split_y_um": 3, "split_x_um": 5}},
        1,
        patches(),
    ),
    "abrupt cutoff": (Lens(given=ends_abruptly()), {}, 3, patches()),
    "any shape": (Lens(given=flare(1.4e-5, 7e-6)), {}, 1, patches()),
    "varying": (Lens(given=varying()), {}, 1, patches()),
    "optical stack": (Lens(), {"crosstalk": CROSSTALK, "angular_response": ANGLES}, 1, patches()),
    "even": (Lens(), {}, 1, ps.charts.uniform("A", 40)),
    "light that changes": (
        DiffractionLimited(8, 50),
        {"line_time_us": 100},
        1,
        ps.scenes.DynamicScene(patches(), flicker=ps.scenes.SineFlicker(100.0, 0.5)),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_mean_image_stays_on_the_device_and_is_that_of_the_cpu(case: str) -> None:
    lens, changes, cells, scene = CASES[case]
    camera = ps.Camera(lens, D200.with_(**changes), cells_per_pixel=cells)
    arrays = StrictArrays()
    on_gpu = camera.on_gpu(arrays)
    assert on_gpu.computes(scene)
    mean = on_gpu.mean_electrons(scene, 0.02, start_s=0.003)
    assert mean.device == DEVICE
    assert mean.dtype == arrays.xp.float32
    assert arrays.host_copies == 0
    expected = camera.mean_electrons(scene, 0.02, start_s=0.003)
    assert np.ptp(expected) > 0.1 * expected.max()
    assert np.abs(arrays.get(mean) - expected).max() < TOLERANCE * expected.max()


def test_what_the_device_does_not_compute_comes_from_the_cpu() -> None:
    camera, arrays = ps.Camera(Lens(veiling_glare=VeilingGlare(0.1)), D200), StrictArrays()
    on_gpu = camera.on_gpu(arrays)
    assert not on_gpu.computes(patches())
    mean = on_gpu.mean_electrons(patches(), 0.01)
    assert mean.device == DEVICE
    assert (arrays.get(mean) == camera.mean_electrons(patches(), 0.01)).all()


def test_frame_shares_its_memory_with_other_libraries() -> None:
    arrays, dn = StrictArrays(), np.arange(6, dtype=np.uint16).reshape(2, 3)
    frame = GpuFrame(arrays.put(dn), {"bits": 12, "black_level_dn": 2.0}, arrays)
    shared = np.from_dlpack(frame)
    assert np.shares_memory(shared, frame.array._array)
    assert (shared == dn).all()
    assert arrays.host_copies == 0
    raw = frame.to_host()
    assert (raw.dn == dn).all()
    assert (raw.bits, raw.black_level_dn, frame.shape) == (12, 2.0, (2, 3))


def test_negative_radiance_is_an_error() -> None:
    scene = Scene(patches().weights, -patches().basis, patches().wavelength_nm)
    with raises(InputError, "the scene's radiance is negative"):
        ps.Camera(ps.DiffractionLimited(8, 50), D200).on_gpu(StrictArrays()).mean_electrons(scene, 0.01)


@pytest.mark.parametrize(
    ("given", "what"),
    [({"frames": 0}, "frames"), ({"start_s": math.nan}, "start_s"), ({"exposures_s": [0.1, -1.0]}, "exposure_s")],
)
def test_calls_of_a_stream_are_checked_as_on_the_cpu(given: dict[str, Any], what: str) -> None:
    camera = ps.Camera(ps.DiffractionLimited(8, 50), D200)
    for on in (camera, camera.on_gpu(StrictArrays())):
        with pytest.raises(InputError) as caught:
            next(on.stream(patches(), **{"exposures_s": 0.1} | given))
        assert caught.value.what == what


def test_sensors_with_several_captures_are_an_error() -> None:
    captures = {"parts": [{"name": "a"}, {"name": "b", "relative_gain": 0.25}], "combination": {"dn_per_e": 1}}
    with raises(InputError, "captures are combined on the host"):
        ps.Camera(ps.DiffractionLimited(8, 50), D200.with_(captures=captures)).on_gpu(StrictArrays())


def test_maps_of_a_chip_are_copied_to_the_device_once() -> None:
    arrays, maps = StrictArrays(), np.ones((3, 4), np.float32)
    assert arrays.put(maps) is not arrays.put(maps), "the map could change"
    maps.flags.writeable = False
    kept = arrays.put(maps[:2])
    assert arrays.put(maps[:2]) is kept
    assert arrays.put(maps[1:]) is not kept
