"""
Hot pixels, glow, telegraph noise and drift
===========================================

Dark frames of a sensor with effects of its pixels: 10 s at 20 and 40 °C, the values of three blinking pixels in 60
frames, the spread of the read noise over the pixels, and the black level of 300 frames.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import d200

import photosite as ps

sensor = d200(
    120,
    180,
    dark_current_e_per_s=2,
    dark_current_temperature_c=20,
    dark_doubling_c=6.5,
    read_noise_e=6,
    system_gain_dn_per_e=0.5,
    dsnu_mv=0,
)
lens = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
dark_e = np.zeros((120, 180), np.float32)


def frames(changed, count, rows=slice(None)):
    """Return short dark frames, DN above the black level."""
    camera = ps.Camera(lens, changed)
    shot = (camera.expose(dark_e, 0.01, seed=3, frame=n).dn[rows] for n in range(count))
    return np.array([dn.astype(float) - 64 for dn in shot])


warm = ps.Camera(
    lens,
    sensor.with_(
        hot_pixels={"fraction": 0.01, "median_e_per_s": 20, "log_spread": 1.0},
        glow={"places": ["top_left", "bottom_left"], "peak_e_per_s": 60, "decay_pixels": 25},
        pixel_defects={"listed": [{"kind": "stuck", "rows": [0, 119], "cols": [120, 120], "value": 300}]},
    ),
)
figure, axes = plt.subplot_mosaic([["20", "40"], ["blink", "spread"], ["drift", "drift"]], figsize=(7.36, 7.4))
for celsius in (20, 40):
    axes[f"{celsius}"].imshow(warm.expose(dark_e, 10, seed=1, temperature_c=celsius).dn, "gray", vmin=50, vmax=500)
    axes[f"{celsius}"].set(title=f"10 s at {celsius} °C", xticks=[], yticks=[])
blinking = frames(sensor.with_(telegraph_noise={"fraction": 0.05, "amplitude_e": 40, "correlation_frames": 4}), 60)
for row, col in np.argwhere(np.isin(blinking.std(axis=0), np.sort(blinking.std(axis=0).ravel())[[-20, -60, -150]]))[:3]:
    axes["blink"].step(np.arange(60), blinking[:, row, col], where="mid", linewidth=0.9)
axes["blink"].set(xlabel="frame", ylabel="DN above black level", title="Blinking pixels")
for spread in (0.0, 0.4):
    noise = frames(sensor.with_(read_noise_spread={"log_spread": spread}), 40).std(axis=0, ddof=1)
    axes["spread"].hist(
        noise.ravel(), np.linspace(0, 10, 80), histtype="step", log=True, label=f"log spread {spread:g}"
    )
axes["spread"].set(xlabel="temporal noise of a pixel in 40 frames, DN", ylabel="pixels", title="Read noise")
axes["spread"].legend()
level = frames(sensor.with_(black_level_drift={"standard_deviation_e": 2}), 300, slice(20)).mean(axis=(1, 2))
axes["drift"].plot(level, linewidth=0.9)
axes["drift"].set(xlabel="frame", ylabel="DN", title="Mean of 20 rows, above the stated black level")
figure.tight_layout()
plt.show()
