"""The commands that write, with small inputs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

from inputs import SMALL, few_frames

from faults import Case

_FIGURE = b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9" viewBox="0 0 9 9"><path d="M0 0H9"/></svg>'


@contextmanager
def _short() -> Iterator[None]:
    """Let commands shoot few frames, make figures without rendering them, and take no time where they state it."""
    page, study = "photosite.report.page", "photosite.studies.farrell2008"
    with (
        mock.patch("photosite.studies.protocol.paper_d200_protocol", few_frames),
        mock.patch("photosite.studies.closed_loop.paper_d200_protocol", few_frames),
        mock.patch(f"{page}.svg_bytes", return_value=_FIGURE),
        mock.patch(f"{study}.drawing.svg_bytes", return_value=_FIGURE),
        mock.patch(f"{study}.drawing.png_bytes", return_value=b"png"),
        mock.patch(f"{study}.study.time", SimpleNamespace(perf_counter=lambda: 0.0)),
    ):
        yield


def cases(inputs: Path) -> list[Case]:
    """Return the cases, with inputs in a folder."""

    def two(name: str, suffix: str = "") -> tuple[str, str]:
        return f"{inputs}/{name}0{suffix}", f"{inputs}/{name}1{suffix}"

    stacks = two("stack")
    sweeps = f"{inputs}/4.sweep.yaml", f"{inputs}/5.6.sweep.yaml"
    seeds = ("1", "2")
    sensors = ("sony-a7r2", "sony-imx571")
    to_sensor = "-o mine.sensor.yaml --force"
    calibrate = f"calibrate {{value}} {to_sensor}"
    pair = ("mine.sensor.yaml", "mine.maps.h5")
    convert = f"convert {inputs}/scene.h5 --distance {{value}} --force -o"
    distances = ("2", "3")
    pairs = f"dataset {inputs}/e.npy --inputs-are electrons --sensor vendor-2.2um --crop 16x16 --crops 6"
    sheet = "--pixel-um 3.45 --full-well-e 10500 --qe-peak 0.65 --bits 12 --rows 2048 --cols 2448"
    d850 = f"{inputs}/noiseprofiles.json --sensor nikon-d200 {to_sensor}"
    chart = "--illuminant A --luminance 40 --corners 2,2 2,96 64,96 64,2"
    multiplied = "emgain {value}/unity {value}/gain"
    return [
        Case("sensors new", f"sensors new {sheet} --read-noise-e {{value}} {to_sensor}", seeds),
        Case("sensors export", f"sensors export {{value}} {to_sensor}", ("vendor-2.2um", "nikon-d200")),
        Case("sensors compare", "sensors compare {value} vendor-2.2um --report sensors.html --force", sensors),
        Case("import", f"import --model D850 --gain-setting {{value}} {d850}", ("64", "400")),
        Case("cameras show", f"cameras show nikon-d850 --iso {{value}} --profiles {d850}", ("64", "400")),
        Case("scenes show", "scenes show {value} --picture scene.png --force", ("macbeth", "hdr-patches")),
        Case(
            "render",
            "render -o scene.h5 --spp 1 --rows 4 --cols 6 --wavelengths 500:540:20 --seed {value} --force",
            seeds,
        ),
        Case("simulate", f"simulate {SMALL} --seed {{value}} -o shot.dng --force", seeds),
        Case("simulate, HDF5", f"simulate {SMALL} --seed {{value}} -o shot.h5 --clean clean.h5 --force", seeds),
        Case("develop", f"develop {inputs}/shot.dng --brightness {{value}} -o shot.png --force", seeds),
        Case("convert, HDF5", f"{convert} scene.h5", distances),
        Case("convert, ENVI", f"{convert} scene.hdr", distances),
        Case(
            "export, darktable",
            "export {value} darktable --maker A --model B --gain-setting 100 -o noise.json --force",
            sensors,
        ),
        Case("export, EMVA", "export {value} emva -o emva", stacks, overwrites=False, folder="emva"),
        Case("sweep", "sweep {value} -o a.csv --figure a.png --force", sweeps, checkpoint="a.csv.partial"),
        Case("dataset", f"{pairs} --seed {{value}} --pairs-per-shard 2 -o pairs", seeds, overwrites=False),
        Case(
            "shoot",
            "shoot --rows 24 --cols 32 --seed {value} -o stack",
            seeds,
            overwrites=False,
            folder="stack",
            within=_short,
        ),
        Case("calibrate", f"{calibrate} --maps --report report.html", stacks, pairs=(pair,), within=_short),
        Case("calibrate, checkpoint", f"{calibrate} --checkpoint kept", stacks, checkpoint="kept"),
        Case("calibrate, several", "calibrate {value} --into results --maps", stacks, overwrites=False),
        Case("calibrate, PDF", "calibrate {value} --report report.pdf --force", stacks, within=_short),
        Case("calibrate, gain series", f"{calibrate} --report report.html", two("series"), within=_short),
        Case(
            "calibrate, contribute",
            "calibrate {value} --contribute library --license CC0-1.0",
            stacks,
            overwrites=False,
        ),
        Case("spectral", f"spectral {{value}}/spectral.yaml --figure qe.png {to_sensor}", two("bands")),
        Case("temperature", f"temperature {{value}} --sensor nikon-d200 --report dark.html {to_sensor}", two("darks")),
        Case(
            "polarizers",
            f"polarizers {{value}} --sensor {inputs}/polarized.sensor.yaml --figure p.png {to_sensor}",
            two("turned"),
        ),
        Case(
            "emgain",
            f"{multiplied} --sensor {inputs}/register.sensor.yaml --report em.html {to_sensor}",
            two("register"),
            within=_short,
        ),
        Case(
            "validate",
            f"validate --measured {{value}} --sensor {inputs}/chart.sensor.yaml {chart} --report page.html --force",
            two("chart", ".dng"),
            within=_short,
        ),
        Case("demo", "demo --rows 66 --cols 98 --seed {value} -o demo", seeds, within=_short),
        Case(
            "reproduce",
            "reproduce farrell2008 --only snr --seed {value} -o study",
            seeds,
            overwrites=False,
            folder="study",
            within=_short,
        ),
    ]
