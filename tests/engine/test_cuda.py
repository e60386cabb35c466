"""`device="cuda"` in numba's simulator, which runs the kernel's threads on the CPU; on a GPU; and without either.

numba selects the simulator at import, so the tests start processes of their own.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest
from numba import cuda

from photosite.camera.camera import Camera
from photosite.engine.cuda import NoCudaError, check_unfused
from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.sensor.io.sensor_file import load_sensor

# The simulator takes about 7 ms a pixel, so it runs on as few pixels as reach every branch; ROWS and COLS are no
# multiples of a thread block. A GPU runs on more.
SIZES = {"simulator": "ROWS, COLS = 9, 26\n", "gpu": "ROWS, COLS = 24, 40\n"}

KERNEL = """
import numpy as np
from photosite.engine.cuda import expose_drawn_cuda
from photosite.engine.jit import read_only
from photosite.engine.random_numbers import key_from_seed
from photosite.engine.pixel_model import DrawnConstants, DrawnMaps, Exposure, expose_drawn

rng = np.random.default_rng(4)
levels = [0, 1e-3, 0.5, 4, 9.99, 10, 11, 13, 16, 17, 40, 900, 29900, 60000]
mean = rng.permutation(np.resize(levels, ROWS * COLS)).reshape(ROWS, COLS).astype(np.float32)
key = key_from_seed(2**40 + 17)
for shape, lines, read_e, seconds in (((1, 1), (1, 1), 0.0, 1.0), (mean.shape, mean.shape, 12.5, 0.7)):
    prnu, offset = (rng.integers(-9000, 9000, shape).astype(np.int16) for _ in range(2))
    maps = DrawnMaps(prnu, offset, rng.random(shape).astype(np.float32), *(rng.normal(0, 3, n) for n in lines))
    exposure = Exposure(seconds, 30000.0, 0.4, -10.0, 11900.0, 70, 333, 5000, np.uint32(9), *key)
    maps = DrawnMaps(*map(read_only, maps))
    arguments = read_only(mean), maps, DrawnConstants(1e-5, 2e-3, read_e), exposure
    cpu, cuda = expose_drawn(*arguments), expose_drawn_cuda(*arguments)
    assert cuda.dtype == np.uint16
    assert cpu.min() == 0 and cpu.max() == 11900, "both ends of the converter"
    np.testing.assert_array_equal(cuda, cpu)
"""

STAGES = """
import numpy as np
from photosite.engine.charge import ConversionMaps, collect_charge, convert_charge
from photosite.engine.cuda import collect_charge_cuda, convert_charge_cuda
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure
from photosite.engine.random_numbers import key_from_seed

rng = np.random.default_rng(4)
shape = ROWS, COLS
mean = rng.permutation(np.resize([0, 0.5, 9.99, 10, 900, 29900, 60000], ROWS * COLS)).reshape(shape).astype(np.float32)
exposure = Exposure(0.7, 30000.0, 0.4, -10.0, 11900.0, 70, 333, 5000, np.uint32(9), *key_from_seed(2**40 + 17))
for size, counts, table in (((1, 1), (1, 1), 1), (shape, shape, 9)):
    prnu, dark, offset, noise = (read_only(rng.normal(0, 0.1, size).astype(np.float32)) for _ in range(4))
    dark, noise = read_only(abs(dark)), read_only(abs(noise) * 200 + 20)
    lines = [rng.normal(0, 3, count) for count in counts]
    group = rng.integers(0, 2, counts[0]) * (table > 1)
    channels = (1, 1) if table == 1 else (2, COLS)
    curve, error = np.linspace(0, 3.3e4, table) - 1e3 * np.sin(range(table)) ** 2, rng.normal(0, 3, table)
    parts = [*lines, group, rng.normal(1.1, 0.02, channels), rng.normal(0, 9, channels), curve]
    output = np.zeros(1, np.uint16) if table == 1 else (np.arange(11901) // 2 * 2).astype(np.uint16)
    maps = ConversionMaps(offset, noise, *map(read_only, parts), 3750.0, read_only(error), read_only(output))
    charge = collect_charge(read_only(mean), prnu, dark, exposure)
    np.testing.assert_array_equal(collect_charge_cuda(mean, prnu, dark, exposure), charge)
    cpu = convert_charge(read_only(charge), maps, exposure)
    assert cpu.min() < 9 and cpu.max() > 11880, "both ends of the converter, up to its error"
    np.testing.assert_array_equal(convert_charge_cuda(charge, maps, exposure), cpu)
"""

CHARGE = """
import numpy as np
from photosite.engine import charge_stages as cpu, cuda
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure
from photosite.engine.random_numbers import key_from_seed
from photosite.sensor.effects.charge_transfer import late_shares

rng = np.random.default_rng(5)
charge = rng.permutation(np.resize([0, 0.3, 1, 2, 30, 900, 40000], ROWS * COLS)).reshape(ROWS, COLS)
charge = read_only(charge.astype(np.float32))
exposure = Exposure(0.7, 30000.0, 0.4, -10.0, 11900.0, 70, 333, 5000, np.uint32(9), *key_from_seed(2**40 + 17))
shares = [read_only(late_shares(s, size)) for s, size in ((1e-3, ROWS), (4e-4, COLS))]
for stage, *arguments in (
    ("bloom_columns", 20000.0, 0.8),
    ("transfer_charge", *shares),
    ("multiply_charge", cpu.Register(1.02, 180.0, 1e6, 0.3), exposure),
    ("couple_pixels", 0.02, 0.003),
):
    expected = getattr(cpu, stage)(charge, *arguments)
    assert (expected != charge).any()
    np.testing.assert_array_equal(getattr(cuda, stage + "_cuda")(charge, *arguments), expected)
"""

CAMERA = """
import numpy as np
import photosite as ps

sensor = ps.load_sensor("nikon-d200").with_(rows=ROWS, cols=COLS, dark_voltage_mv_per_s=20.0, dcnu_percent=30.0)
camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
scene = ps.charts.macbeth(illuminant="A", mean_luminance_cd_m2=40)
region = (3, ROWS - 2, 5, COLS - 1)
whole = camera.capture(scene, 1 / 3, seed=7, device="cuda").dn
np.testing.assert_array_equal(whole, camera.capture(scene, 1 / 3, seed=7).dn)
assert np.unique(whole).size > 50
part = camera.capture(scene, 1 / 3, seed=7, region=region, device="cuda").dn
np.testing.assert_array_equal(part, whole[3 : ROWS - 2, 5 : COLS - 1])
streams = [camera.stream(scene, 1 / 3, frames=2, seed=7, device=device) for device in ("cuda", "cpu")]
for cuda, cpu in zip(*streams, strict=True):
    np.testing.assert_array_equal(cuda.dn, cpu.dn)
"""


@pytest.mark.parametrize(
    "program",
    [
        pytest.param(KERNEL, id="kernel"),
        pytest.param(STAGES, id="stages"),
        pytest.param(CHARGE, id="charge"),
        pytest.param(CAMERA, id="camera", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("target", ["simulator", "gpu"])
def test_frames_equal_those_of_the_cpu(program: str, target: str) -> None:
    if target == "gpu" and not gpu():
        pytest.skip("no NVIDIA GPU, or the extra gpu is not installed")
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "01"[target == "simulator"]}
    command = [sys.executable, "-c", SIZES[target] + program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def gpu() -> bool:
    return importlib.util.find_spec("numba_cuda") is not None and bool(cuda.is_available())


def camera() -> Camera:
    return Camera(DiffractionLimited(f_number=8, focal_length_mm=50), load_sensor("nikon-d200").with_(rows=4, cols=6))


def test_missing_gpu_is_an_input_error() -> None:
    if gpu():
        pytest.skip("there is a GPU")
    with pytest.raises(InputError, match=r"device 'cuda' needs an NVIDIA GPU and photosite's extra 'gpu'") as caught:
        camera().expose(np.ones((4, 6), np.float32), 0.1, device="cuda")
    assert caught.value.arguments == {"device": "cpu"}
    assert caught.value.__suppress_context__, "no chained traceback"


def test_missing_numba_cuda_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "photosite.engine.cuda", None)  # as after a failed import
    with pytest.raises(InputError, match=r"numba\.cuda cannot be imported"):
        camera().expose(np.ones((4, 6), np.float32), 0.1, device="cuda")


def test_unknown_device() -> None:
    with pytest.raises(InputError) as caught:
        camera().expose(np.ones((4, 6), np.float32), 0.1, device="gpu")  # type: ignore[arg-type]
    assert (caught.value.what, caught.value.value) == ("device", "gpu")


@pytest.mark.parametrize(
    "operation",
    [
        "fma.rn.f64",
        "fma.rn.f32",
        "mul.f64",
        "add.f32",
        "sub.ftz.f32",
        "div.full.f32",
        "sqrt.approx.f32",
        "add.rn.ftz.f32",
    ],
)
def test_inexact_operations_are_rejected(operation: str) -> None:
    with pytest.raises(NoCudaError, match=operation):
        check_unfused(f"\tmul.rn.f64 %fd3, %fd1, %fd2;\n\t{operation} %fd4, %fd3, %fd5;")


def test_exact_operations_are_accepted() -> None:
    exact = [
        "mul.rn.f64",
        "add.rn.f64",
        "div.rn.f64",
        "rcp.rn.f64",
        "sqrt.rn.f64",
        "min.f64",
        "neg.f64",
        "copysign.f64",
    ]
    check_unfused("\n".join(f"\t{name} %fd1, %fd2;" for name in [*exact, "mul.lo.s64", "mul.wide.u32", "mad.lo.s64"]))
