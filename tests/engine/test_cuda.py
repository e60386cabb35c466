"""`device="cuda"` in numba's simulator, which runs the kernel's threads on the CPU; on a GPU; and without either.

numba selects the simulator at import, so the tests start processes of their own.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import cuda

from photosite.camera.camera import Camera
from photosite.engine.cuda import NoCudaError, check_unfused
from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.sensor.io.sensor_file import load_sensor

# The simulator takes about 1 ms a thread, so it runs on as few pixels as reach every branch, in small blocks; ROWS and
# COLS are no multiples of a block. A GPU runs on more.
SIZES = {"simulator": "ROWS, COLS = 7, 13\nTHREADS = 8, 4\n", "gpu": "ROWS, COLS = 24, 40\nTHREADS = 32, 8\n"}

SETUP = """
import numba
import numpy as np
from photosite.engine import charge, charge_stages, cuda, pixel_model
from photosite.engine.arrays import Arrays
from photosite.engine.jit import read_only
from photosite.engine.pixel_model import Exposure
from photosite.engine.random_numbers import key_from_seed

cuda.THREADS = THREADS
run = cuda.run

def types_of(value):
    if isinstance(value, tuple):
        return tuple(map(types_of, value))
    kind = numba.typeof(getattr(value, "_array", value))
    return (kind.dtype, kind.ndim, kind.layout) if isinstance(kind, numba.types.Array) else kind

def types_in(kind):
    if isinstance(kind, (tuple, numba.types.BaseTuple)):
        return tuple(map(types_in, kind))
    return (kind.dtype, kind.ndim, kind.layout) if isinstance(kind, numba.types.Array) else kind

def checked_run(arrays, name, *arguments):
    # The simulator ignores the types that a kernel is compiled for.
    signature = cuda.KERNELS[name].signature[: len(arguments)]
    on_host = [arrays.get(part) if hasattr(part, "device") and not isinstance(part, np.ndarray) else part
               for part in arguments]
    assert tuple(map(types_of, on_host)) == tuple(map(types_in, signature)), name
    return run(arrays, name, *arguments)

cuda.run = checked_run

def check(kernel, *arguments):
    arguments = [read_only(part) if isinstance(part, np.ndarray) else part for part in arguments]
    arrays = cuda.gpu_arrays()
    computed = arrays.get(cuda.run(arrays, kernel.__name__, *arguments))
    expected = kernel(*arguments)
    assert computed.dtype == expected.dtype
    np.testing.assert_array_equal(computed, expected, kernel.__name__)
    return expected

rng = np.random.default_rng(4)
shape = ROWS, COLS
levels = [0, 1e-3, 0.5, 4, 9.99, 10, 11, 13, 16, 17, 40, 900, 29900, 60000]
mean = read_only(rng.permutation(np.resize(levels, ROWS * COLS)).reshape(shape).astype(np.float32))
exposure = Exposure(0.7, 30000.0, 0.4, -10.0, 11900.0, 70, 333, 5000, np.uint32(9), *key_from_seed(2**40 + 17))
"""

DRAWN = """
chip = 70 + ROWS, 5000
for size, lines, read_e, seconds in (((1, 1), (1, 1), 0.0, 1.0), (chip, shape, 12.5, 0.7)):
    prnu, offset = (rng.integers(-9000, 9000, size).astype(np.int16) for _ in range(2))
    maps = map(read_only, [prnu, offset, rng.random(size).astype(np.float32)])
    maps = pixel_model.DrawnMaps(*maps, *(rng.normal(0, 3, n) for n in lines))
    constants = pixel_model.DrawnConstants(1e-5, 2e-3, read_e)
    frame = check(pixel_model.expose_drawn, mean, maps, constants, exposure._replace(exposure_s=seconds))
    assert frame.min() == 0 and frame.max() == 11900, "both ends of the converter"
"""

MEASURED = """
maps = [rng.normal(at, spread, shape).astype(np.float32) for at, spread in ((0, 0.5), (0, 9), (0, 5), (4, 5))]
maps.append(rng.uniform(0.6, 1.7, shape).astype(np.float32))
lines = [rng.normal(0, 3, count) for count in shape]
maps = pixel_model.MeasuredMaps(*map(read_only, maps), *lines, 2.5, 0.3)
frame = check(pixel_model.expose_measured, mean, maps, exposure)
place = np.stack(np.unravel_index(np.arange(3, ROWS * COLS, 5), shape), axis=1)
blinking = [rng.normal(size=len(place)) * 200, rng.random(len(place)), rng.random(len(place)) * 9]
blinking = pixel_model.BlinkingPixels(place, *blinking)
arrays = cuda.gpu_arrays()
computed = arrays.get(cuda.run(arrays, "expose_blinking", arrays.put(frame.copy()), blinking, mean, maps, exposure))
expected = pixel_model.expose_blinking(frame.copy(), blinking, mean, maps, exposure)
assert (expected != frame).any()
np.testing.assert_array_equal(computed, expected)
numbers = rng.integers(0, 4000, len(place)).astype(np.uint16)
place, numbers = read_only(place), read_only(numbers)
computed = arrays.get(cuda.run(arrays, "replace_pixels", arrays.put(frame.copy()), place, numbers))
np.testing.assert_array_equal(computed, pixel_model.replace_pixels(frame.copy(), place, numbers))
"""

STAGES = """
for size, counts, table in (((1, 1), (1, 1), 1), (shape, shape, 9)):
    prnu, dark, offset, noise = (read_only(rng.normal(0, 0.1, size).astype(np.float32)) for _ in range(4))
    dark, noise = read_only(abs(dark)), read_only(abs(noise) * 200 + 20)
    lines = [rng.normal(0, 3, count) for count in counts]
    group = rng.integers(0, 2, counts[0]) * (table > 1)
    channels = (1, 1) if table == 1 else (2, COLS)
    curve, error = np.linspace(0, 3.3e4, table) - 1e3 * np.sin(range(table)) ** 2, rng.normal(0, 3, table)
    parts = [*lines, group, rng.normal(1.1, 0.02, channels), rng.normal(0, 9, channels), curve]
    output = np.zeros(1, np.uint16) if table == 1 else (np.arange(11901) // 2 * 2).astype(np.uint16)
    maps = [*map(read_only, [offset, noise, *parts]), 3750.0, read_only(error), read_only(output)]
    collected = check(charge.collect_charge, mean, prnu, dark, exposure)
    frame = check(charge.convert_charge, collected, charge.ConversionMaps(*maps), exposure)
    assert frame.min() < 9 and frame.max() > 11880, "both ends of the converter, up to its error"
"""

CHARGE = """
from photosite.sensor.effects.charge_transfer import late_shares

electrons = rng.permutation(np.resize([0, 0.3, 1, 2, 30, 900, 40000], ROWS * COLS)).reshape(shape).astype(np.float32)
shares = [read_only(late_shares(s, size)) for s, size in ((1e-3, ROWS), (4e-4, COLS))]
for stage, *arguments in (
    (charge_stages.bloom_columns, 20000.0, 0.8),
    (charge_stages.transfer_charge, *shares),
    (charge_stages.multiply_charge, charge_stages.Register(1.02, 180.0, 1e6, 0.3), exposure),
    (charge_stages.couple_pixels, 0.02, 0.003),
):
    assert (check(stage, electrons, *arguments) != electrons).any()
"""

CAMERA = """
import tempfile
import photosite as ps
from photosite.errors import InputError
from photosite.studies.bench.effects import SENSORS
from virtual_chips import drawn_maps, plant_blinking

plain = ps.load_sensor("nikon-d200").with_(
    rows=ROWS, cols=COLS, dark_voltage_mv_per_s=20.0, dcnu_percent=30.0, row_noise_mv=0.1
)
folder = tempfile.TemporaryDirectory()
maps = plant_blinking(drawn_maps(plain), np.full(4, 60.0), np.full(4, 0.5)).save(f"{folder.name}/a.maps.h5")
border = {"optical_black": {"top": 2, "left": 2}, "pixel_defects": {"stuck_fraction": 0.1}}
spread = {"telegraph_noise": {"fraction": 0.3, "amplitude_e": 20}, "glow": {**SENSORS["em"]["glow"], "decay_pixels": 5}}
few = {**border, **spread}
sensors = {
    "plain": plain,
    "measured": plain.with_(maps=maps),
    "em": plain.with_(**SENSORS["em"] | few),
    "curve": plain.with_(**SENSORS["curve"] | few),
    "measured with effects": plain.with_(maps=maps, response_curve=SENSORS["curve"]["response_curve"]),
    "captures": plain.with_(**SENSORS["captures"]),
}
region = (1, ROWS - 2, 4, COLS - 1)
for name, sensor in sensors.items():
    camera, place = ps.Camera(ps.DiffractionLimited(8, 50), sensor), {"seed": 7, "frame": 3}
    cpu = camera.expose(mean, 1 / 3, **place)
    for part in (None, region):
        expected = cpu.dn if part is None else cpu.dn[part[0] : part[1], part[2] : part[3]]
        if name in ("plain", "captures") or part is None:
            np.testing.assert_array_equal(camera.expose(mean, 1 / 3, region=part, device="cuda", **place).dn, expected)
        if name == "captures":
            continue
        frame = camera.on_gpu(ARRAYS()).expose(mean, 1 / 3, region=part, **place)
        raw = frame.to_host()
        np.testing.assert_array_equal(raw.dn, expected)
        if part is None:
            assert (raw.metadata, raw.black_level_dn, raw.cfa) == (cpu.metadata, cpu.black_level_dn, cpu.cfa)
        if hasattr(frame.array, "__cuda_array_interface__"):
            assert frame.__cuda_array_interface__["data"] == frame.array.__cuda_array_interface__["data"]
"""

STRICT = {
    "simulator": "from device_arrays import StrictArrays as ARRAYS\n",
    "gpu": "ARRAYS = cuda.gpu_arrays\n",
}


@pytest.mark.parametrize("target", ["simulator", "gpu"])
def test_frames_equal_those_of_the_cpu(target: str) -> None:
    if target == "gpu" and not gpu():
        pytest.skip("no NVIDIA GPU, or the extra gpu is not installed")
    if target == "simulator":
        pytest.importorskip("array_api_strict", reason="needs array-api-strict, of the extra dev")
    path = os.pathsep.join([str(Path(__file__).parents[1] / "helpers"), *sys.path])
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "01"[target == "simulator"], "PYTHONPATH": path}
    program = SIZES[target] + SETUP + DRAWN + MEASURED + STAGES + CHARGE + STRICT[target] + CAMERA
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def gpu() -> bool:
    return importlib.util.find_spec("numba_cuda") is not None and bool(cuda.is_available())


def camera() -> Camera:
    return Camera(DiffractionLimited(f_number=8, focal_length_mm=50), load_sensor("nikon-d200").with_(rows=4, cols=6))


def test_missing_gpu_is_an_input_error() -> None:
    if gpu():
        pytest.skip("there is a GPU")
    for work in (lambda: camera().expose(np.ones((4, 6), np.float32), 0.1, device="cuda"), lambda: camera().on_gpu()):
        with pytest.raises(
            InputError, match=r"device 'cuda' needs an NVIDIA GPU and photosite's extra 'gpu'"
        ) as caught:
            work()
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
