"""Which large libraries each command imports, and how many modules: most of the time of a short command."""

import json
import os
import subprocess
import sys

import pytest

LARGE = {
    *("colour", "fpdf", "h5py", "imagecodecs", "jinja2", "matplotlib", "numba", "numpy", "pandas", "PIL", "pydantic"),
    "numba.np.arrayobj",  # what numba compiles, which a command with kernels in the cache does not need
    *("rawpy", "ruamel.yaml", "scipy.fft", "scipy.interpolate", "scipy.io", "scipy.linalg", "scipy.ndimage"),
    *("scipy.optimize", "scipy.signal", "scipy.special", "scipy.stats", "tifffile", "torch", "xarray"),
}
SENSOR_FILE = {"numpy", "pydantic", "ruamel.yaml"}
SCENE = {"numpy", "pydantic"}
STATISTICS = {"scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.special"}

COMMANDS = {
    "--help": (set(), 170),
    "sensors list": (SENSOR_FILE, 500),
    "sensors show nikon-d200": (SENSOR_FILE, 500),
    "scenes list": (SCENE, 470),
    "scenes show macbeth": (SCENE, 470),
    "optics check lens.optics.yaml": (SENSOR_FILE | {"numba", "scipy.fft", "scipy.ndimage", "scipy.special"}, 880),
    "simulate --force --rows 64 --cols 96 -o new.dng": (SENSOR_FILE | {"imagecodecs", "numba", "tifffile"}, 870),
    "develop shot.dng --force -o shot.png": ({"imagecodecs", "numpy"}, 380),
    "calibrate stack": (SENSOR_FILE | STATISTICS | {"numba"}, 1300),
}
"""Large libraries, and the most modules, those of Python included."""

RUN = """
import json, sys
from photosite.cli.main import run
status = run(sys.argv[1:])
with open("modules.json", "w") as file:
    json.dump(sorted(sys.modules), file)
sys.exit(status)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    (folder / "lens.optics.yaml").write_text(
        "photosite_optics: 1\nf_number: 8\nfocal_length_mm: 50\nblur: {kind: wavefront, zernike: {8: 50}, unit: nm}\n"
    )
    for line in ("simulate --rows 64 --cols 96 -o shot.dng", "shoot --rows 64 --cols 96 -o stack"):
        subprocess.run([sys.executable, "-m", "photosite", *line.split()], cwd=folder, check=True, capture_output=True)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_imported_modules(command, folder):
    environment = os.environ | {"PHOTOSITE_CACHE": str(folder / "cache")}
    for _ in range(2 if "numba" in COMMANDS[command][0] else 1):  # the first may compile kernels and compute transfers
        line = [sys.executable, "-c", RUN, *command.split()]
        subprocess.run(line, cwd=folder, env=environment, check=True, capture_output=True)
    modules = set(json.loads((folder / "modules.json").read_text()))
    large, most = COMMANDS[command]
    assert modules & LARGE <= large
    assert len(modules) <= most
