"""The slanted edge in the gallery: what is measured on raw pixels against what lens and pixel should give."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from photosite.camera.camera import Camera
from photosite.camera.mean_image import electrons_per_weight
from photosite.camera.optical_stack import low_pass_split_m
from photosite.errors import InputError
from photosite.metrics.sharpness import slanted_edge_mtf
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Lens
from photosite.optics.point_spread import PlanePsf, RadialPsf
from photosite.optics.protocols import Optics
from photosite.optics.wavefront import Wavefront
from photosite.report.style import BLACK, BLUE, GRAY, GREEN, ORANGE, VERMILION, styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor

ANGLE_DEG = 5.0
_PIXELS, _CELLS = 160, 9


def optics_times_aperture(
    camera: Camera, scene: Scene, channel: str, frequency_cycles_per_pixel: ArrayLike, angle_deg: float
) -> NDArray[np.float64]:
    """Modulation transfer that a camera should show across an edge: its lens, low-pass filter and photodetector.

    Parameters
    ----------
    camera
        Its pixels are square, and its lens blurs alike all over the frame.
    scene
        The edge; its light counts.
    channel
        Whose electrons weigh the wavelengths.
    frequency_cycles_per_pixel
        (n,) across the edge.
    angle_deg
        By which the edge leans clockwise from the vertical.

    Returns
    -------
    ndarray
        (n,). What the scene loses by being laid on cells is left out; it shrinks as their number grows.

    Raises
    ------
    InputError
        If the lens's blur differs over the field.
    """
    sensor = camera.sensor
    pitch_m = sensor.pixel.width_um.value * 1e-6
    side_m = pitch_m * math.sqrt(sensor.pixel.fill_factor.value)
    across = np.asarray(frequency_cycles_per_pixel, np.float64) / pitch_m
    fy, fx = across * math.sin(math.radians(angle_deg)), across * math.cos(math.radians(angle_deg))
    spread = camera.optics.point_spread(scene.distance_m)
    of_channel = electrons_per_weight(scene, camera.optics, sensor)[sensor.channel_names.index(channel)].sum(axis=0)
    transfer = np.zeros(across.shape, np.complex128)
    for share, wavelength_nm in zip(of_channel / of_channel.sum(), scene.wavelength_nm, strict=True):
        if isinstance(spread, RadialPsf):
            transfer += share * spread.otf(across, wavelength_nm)
        elif isinstance(spread, PlanePsf):
            transfer += share * spread.otf(fy, fx, wavelength_nm)
        else:
            raise InputError("a lens whose blur differs over the field has no one transfer; take it at one place")
    for f, split_m in zip((fy, fx), low_pass_split_m(sensor), strict=True):
        transfer *= np.sinc(f * side_m) * np.cos(math.pi * f * split_m)
    return np.abs(transfer)


@styled()
def slanted_edge_figure() -> Figure:
    """Edges by a D200 through four lenses: measured on the green sites of the mosaic, expected, and the difference."""
    sensor = load_sensor("nikon-d200").with_(rows=_PIXELS, cols=_PIXELS)
    pitch_um = sensor.pixel.width_um.value
    sharp, small = (DiffractionLimited(f_number=n, focal_length_mm=50) for n in (2.8, 8))
    wide = DiffractionLimited(f_number=2, focal_length_mm=50)
    # Noll's 7 and 8 are coma, 11 is spherical aberration: RMS in nm.
    worn = Lens(wide, blur=Wavefront({7: 70.0, 8: 90.0, 11: 110.0}))
    split = sensor.with_(low_pass_filter={"split_x_um": pitch_um, "split_y_um": pitch_um})
    cases: list[tuple[str, Optics, Sensor, str, str]] = [
        ("f/2.8", sharp, sensor, BLUE, "o"),
        ("f/2.8, low-pass filter of one pixel", sharp, split, GREEN, "s"),
        ("f/2, coma and spherical aberration", worn, sensor, VERMILION, "D"),
        ("f/8", small, sensor, ORANGE, "^"),
    ]
    figure = Figure(figsize=(7.0, 6.4))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.2])
    samples = _PIXELS * _CELLS
    scene = charts.slanted_edge("D65", 100, angle_deg=ANGLE_DEG, rows=samples, cols=samples)
    for label, optics, chip, color, marker in cases:
        camera = Camera(optics, chip, cells_per_pixel=_CELLS)
        found = slanted_edge_mtf(camera.mean_electrons(scene, 1 / 60), channel="G", cfa=sensor.array.cfa)
        frequency = found.frequency_cycles_per_pixel
        expected = optics_times_aperture(camera, scene, "G", frequency, ANGLE_DEG)
        above.plot(frequency, expected, color=color, linewidth=1.2)
        above.plot(frequency[::4], found.mtf[::4], marker, color=color, markersize=4.5, label=label)
        below.plot(frequency[:51], (found.mtf - expected)[:51], color=color)
    above.plot([], [], color=BLACK, linewidth=1.2, label="lens × pixel aperture")
    for axes in (above, below):
        axes.axvline(0.5, color=GRAY, linewidth=0.8, linestyle="--")
    above.text(0.505, 0.97, "Nyquist", color=GRAY, fontsize=9)
    above.set(ylabel="modulation transfer", xlim=(0, 1), ylim=(0, 1.02))
    above.set_title("Slanted edge on the green sites of a mosaic, without demosaicing")
    above.legend(loc="upper right", bbox_to_anchor=(1.0, 0.95))
    below.text(0.51, 0.0105, "±0.01", color=GRAY, fontsize=9)
    below.axhspan(-0.01, 0.01, color=GRAY, alpha=0.15, linewidth=0)
    below.set(xlabel="cycles/pixel across the edge", ylabel="difference", ylim=(-0.0145, 0.0145))
    return figure
