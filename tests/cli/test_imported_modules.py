"""Which large libraries each command imports, and how many modules: most of the time of a short command."""

import json
import subprocess
import sys

import pytest

LARGE = {
    *("colour", "fpdf", "h5py", "imagecodecs", "jinja2", "matplotlib", "numba", "numpy", "pandas", "PIL", "pydantic"),
    *("rawpy", "ruamel.yaml", "scipy.fft", "scipy.interpolate", "scipy.io", "scipy.linalg", "scipy.ndimage"),
    *("scipy.optimize", "scipy.signal", "scipy.special", "scipy.stats", "tifffile", "torch", "xarray"),
}
SENSOR_FILE = {"numba", "numpy", "pydantic", "ruamel.yaml"}
SCENE = {"numba", "numpy", "pydantic"}
FRAME = SENSOR_FILE | {"scipy.fft", "scipy.linalg", "scipy.special"}
DNG = {"imagecodecs", "tifffile"}
LENS = {"scipy.interpolate", "scipy.optimize"}

COMMANDS = {
    "--help": (set(), 170),
    "sensors list": (SENSOR_FILE, 770),
    "sensors show nikon-d200": (SENSOR_FILE, 770),
    "scenes list": (SCENE, 740),
    "scenes show macbeth": (SCENE, 740),
    "optics check lens.optics.yaml": (FRAME | LENS | {"scipy.ndimage"}, 1050),
    "simulate --rows 64 --cols 96 -o new.dng": (FRAME | LENS | DNG, 1400),
    "develop shot.dng -o shot.png": (SCENE | {"imagecodecs"}, 780),
    "calibrate stack": (FRAME | LENS, 1450),
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
    subprocess.run([sys.executable, "-c", RUN, *command.split()], cwd=folder, check=True, capture_output=True)
    modules = set(json.loads((folder / "modules.json").read_text()))
    large, most = COMMANDS[command]
    assert modules & LARGE <= large
    assert len(modules) <= most
