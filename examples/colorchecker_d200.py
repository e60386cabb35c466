"""
A ColorChecker and the noise budget of the camera
=================================================

A virtual Nikon D200 at the conditions of the 2008 paper: a ColorChecker of 40 cd/m² under CIE A, f/8, 1/3 s. The
signal-to-noise ratio of each patch on the raw mosaic lies on the curve that the sensor's noise parameters predict.
"""

import matplotlib.pyplot as plt
import numpy as np

import photosite as ps
from photosite.develop.camera_color import fit_color_matrix
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.metrics.patches import patch_statistics
from photosite.metrics.snr import noise_budget
from photosite.report.page import shrink
from photosite.report.style import BLACK, GRAY, channel_style, styled

sensor = ps.load_sensor("nikon-d200")
camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
chart = ps.charts.macbeth("A", 40)
raw = camera.capture(chart, 1 / 3, seed=7)
patches = patch_statistics(raw, camera.image_regions(chart), sensor)
rgb_dn = patches.mean_dn[:, [patches.channels.index(channel) for channel in "RGB"]]
matrix = fit_color_matrix(rgb_dn, chart_xyz_d65("macbeth", patches.names))
picture = shrink(ps.develop(raw, "none", matrix, 1.0), 736)
swing = sensor.pixel.voltage_swing_v.value
budget = noise_budget(sensor, np.geomspace(5e-3 * swing, swing, 200))
volts = patches.mean_dn * sensor.mv_per_dn * 1e-3

with styled():
    figure, (left, right) = plt.subplots(2, 1, figsize=(7.36, 9.6), height_ratios=(1.0, 0.9))
    left.imshow(picture, interpolation="none")
    left.set_axis_off()
    left.set_title(f"ColorChecker, tungsten, simulated with the {sensor.name}", loc="left")
    right.plot(budget.volts, budget.total_db, color=BLACK, linewidth=2.0, label="total")
    parts = {
        "shot noise": (budget.shot_db, "--"),
        "read noise": (budget.read_db, "-."),
        "DSNU": (budget.dsnu_db, ":"),
        "PRNU": (budget.prnu_db, (0, (6, 1.5))),
    }
    for name, (level, line) in parts.items():
        right.plot(budget.volts, level, color=GRAY, linestyle=line, linewidth=1.1, label=name)
    right.set_ylim(budget.total_db.min() - 4.0, budget.total_db.max() + 12.0)
    for k, channel in enumerate(patches.channels):
        shown = ~patches.saturated[:, k]
        color, marker, _ = channel_style(channel, k)
        points = volts[shown, k], patches.spatial_snr_db[shown, k]
        right.plot(*points, marker, color=color, label=f"patches, {channel}", alpha=0.9)
    right.set(xscale="log", xlabel="signal at the pixel (V)", ylabel="signal-to-noise ratio (dB)")
    right.set_title("24 patches of the raw frame on the noise budget", loc="left")
    right.legend(loc="lower right", ncols=2)
plt.show()
