"""
Sharpness from a slanted edge
=============================

An edge that leans by 5°, measured on the green pixels of the mosaic at 550 nm. Lines are the product of lens,
photodetector and low-pass filter; the lower plot is the difference.
"""

import drawing  # noqa: F401 - the style of the figures
import matplotlib.pyplot as plt
import numpy as np

import photosite as ps

PIXELS, CELLS, ANGLE_DEG, NM = 160, 9, 5.0, 550.0
sensor = ps.load_sensor("nikon-d200").with_(rows=PIXELS, cols=PIXELS)
pitch_um = sensor.pixel.width_um.value
filtered = sensor.with_(low_pass_filter={"split_x_um": pitch_um, "split_y_um": pitch_um})
sharp, small, wide = (ps.DiffractionLimited(f_number=n, focal_length_mm=50) for n in (2.8, 8, 2))
aberrations = ps.optics.Wavefront({7: 70.0, 8: 90.0, 11: 110.0})  # coma and spherical aberration, RMS in nm
cases = {
    "f/2.8": (sharp, sensor),
    "f/2.8, low-pass filter of one pixel": (sharp, filtered),
    "f/2, coma and spherical aberration": (ps.Lens(wide, blur=aberrations), sensor),
    "f/8": (small, sensor),
}


def expected_mtf(lens, sensor, frequency):
    """Return lens x photodetector x low-pass filter across the edge, at frequencies in cycles per pixel."""
    across = frequency / (pitch_um * 1e-6)
    fy, fx = across * np.sin(np.radians(ANGLE_DEG)), across * np.cos(np.radians(ANGLE_DEG))
    if isinstance(lens, ps.Lens):
        mtf = np.abs(lens.point_spread(scene.distance_m).otf(fy, fx, NM))
    else:
        mtf = lens.otf(across, NM, scene.distance_m)
    side_m = pitch_um * 1e-6 * np.sqrt(sensor.pixel.fill_factor.value)
    split_m = pitch_um * 1e-6 if sensor is filtered else 0.0
    for f in (fy, fx):
        mtf = mtf * np.abs(np.sinc(f * side_m) * np.cos(np.pi * f * split_m))
    return mtf


edge = ps.charts.slanted_edge("D65", 100, angle_deg=ANGLE_DEG, rows=PIXELS * CELLS, cols=PIXELS * CELLS)
only = int(np.argmin(np.abs(edge.wavelength_nm - NM)))  # one wavelength, so that the MTF is known exactly
scene = ps.Scene(edge.weights, edge.basis[:, [only]], edge.wavelength_nm[[only]], distance_m=edge.distance_m)
figure, (above, below) = plt.subplots(
    2, 1, figsize=(7.36, 6.6), layout="constrained", sharex=True, height_ratios=[3, 1.2]
)
for (label, (lens, chip)), marker in zip(cases.items(), "osD^", strict=True):
    camera = ps.Camera(lens, chip, cells_per_pixel=CELLS)
    exposure_s = 0.5 * chip.saturation_capacity_e / camera.mean_electrons(scene, 1.0).max()
    found = ps.slanted_edge_mtf(camera.mean_electrons(scene, exposure_s), channel="G", cfa=chip.array.cfa)
    frequency = found.frequency_cycles_per_pixel
    expected = expected_mtf(lens, chip, frequency)
    (line,) = above.plot(frequency, expected, linewidth=1.2)
    above.plot(frequency[::4], found.mtf[::4], marker, color=line.get_color(), markersize=4.5, label=label)
    below.plot(frequency[:51], (found.mtf - expected)[:51], color=line.get_color())
above.plot([], [], color="black", linewidth=1.2, label="lens × pixel × low-pass filter")
for axes in (above, below):
    axes.axvline(0.5, color="gray", linewidth=0.8, linestyle="--")
above.text(0.505, 0.97, "Nyquist", color="gray")
above.set(ylabel="MTF", xlim=(0, 1), ylim=(0, 1.02))
above.legend(loc="upper right", bbox_to_anchor=(1.0, 0.95))
below.axhspan(-0.01, 0.01, color="gray", alpha=0.15, linewidth=0)
below.set(xlabel="cycles/pixel across the edge", ylabel="measured − expected", ylim=(-0.0145, 0.0145))
plt.show()
