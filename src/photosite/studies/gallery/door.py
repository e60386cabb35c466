"""What lies on the chip, in the gallery: a low-pass filter against false colours, and colours mixed by crosstalk."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.studies.gallery.panels import Panel, enlarged, pictures
from photosite.studies.gallery.through_a_camera import d200, exposure_for, shot, taken
from photosite.values.cfa import channel_mask

LEAKS = {"R": 0.04, "G": 0.02, "B": 0.01}
"""What each of a pixel's four neighbours collects of its light: red goes deepest into silicon, and farthest."""

_EXPOSURE_S = 1 / 10
_DISPLAY = 1.5
"""What is exposed to 0.6 of the range is shown nearly white; fixed, so that pictures side by side are alike."""


@styled()
def low_pass_filter() -> Figure:
    """A zone plate by a D200 at f/4: false colours, and what a four-spot filter of one pixel leaves of them."""
    plate = charts.zone_plate("D65", 100, highest=0.5, rows=1260, cols=1260)
    lens = DiffractionLimited(f_number=4, focal_length_mm=50)
    bare = d200(420, 420)
    pitch_um = bare.pixel.width_um.value
    split = bare.with_(low_pass_filter={"split_x_um": pitch_um, "split_y_um": pitch_um})
    panels: list[Panel] = []
    exposure_s = 0.0
    for title, chip in (("no low-pass filter", bare), (f"four spots, {pitch_um:g} µm apart", split)):
        camera = Camera(lens, chip, cells_per_pixel=3)
        exposure_s = exposure_s or exposure_for(camera, plate)
        panels.append((title, taken(camera, plate, exposure_s, "D65", _DISPLAY)))
    return pictures([panels])


@styled()
def crosstalk() -> Figure:
    """A ColorChecker by pixels that keep their light to themselves, and by pixels that share it; and their edges."""
    chart = charts.macbeth("D65", 100)
    lens, sensor = DiffractionLimited(f_number=8, focal_length_mm=50), d200(300, 446)
    kernels = {name: _plus(leak) for name, leak in LEAKS.items()}
    panels: list[Panel] = []
    for label, chip in (("no crosstalk", sensor), ("with crosstalk", sensor.with_(crosstalk={"optical": kernels}))):
        camera = Camera(lens, chip)
        ratio = red_over_green(camera, chart)
        panels.append((f"{label}: the red patch reads R : G = {ratio:.2f}", shot(chart, camera, "D65", sensor)))
    # The corner where blue, green, orange and purplish blue meet.
    corners = [("its edges, 4 times", enlarged(picture[130:168, 46:157], 4)) for _, picture in panels]
    return pictures([panels, corners])


def red_over_green(camera: Camera, chart: Scene) -> float:
    """Mean electrons of red pixels over those of green ones, on the ColorChecker's red patch."""
    region = next(region for region in camera.image_regions(chart) if region.name == "red")
    inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))
    electrons = camera.mean_electrons(chart, _EXPOSURE_S)
    red, green = (
        electrons[inside][channel_mask(camera.sensor.array.cfa, name, electrons.shape)[inside]].mean() for name in "RG"
    )
    return float(red / green)


def _plus(leak: float) -> list[list[float]]:
    return [[0.0, leak, 0.0], [leak, 1 - 4 * leak, leak], [0.0, leak, 0.0]]
