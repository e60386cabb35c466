"""
Built-in test patterns
======================

Twelve patterns, one scene sample per pixel. Edges lie between samples where the geometry puts them. The sweep and the
zone plate lose contrast at the highest frequencies, because a sample is the mean over its area.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import as_seen, pictures

import photosite as ps

SIZE = {"rows": 360, "cols": 360}


def on_a_log_scale(scene, decades):
    """Return the luminance of a scene, white to black over some decades."""
    level = scene.weights.sum(axis=0)
    share = 1 + np.log10(np.maximum(level / level.max(), 10.0**-decades)) / decades
    return np.repeat(np.clip(share, 0, 1)[:, :, None], 3, axis=2)


charts = ps.charts
patterns = {
    "slanted edge, contrast 4 : 1": as_seen(charts.slanted_edge(**SIZE)),
    "slanted star, 8 edges": as_seen(charts.edge_star(**SIZE)),
    "Siemens star, 72 cycles, sine": as_seen(charts.siemens_star(cycles=72, **SIZE)),
    "Siemens star, 36 cycles, square": as_seen(
        charts.siemens_star(cycles=36, waveform="square", patches=False, **SIZE)
    ),
    "zone plate to 0.5 cycles/sample": as_seen(charts.zone_plate(**SIZE)),
    "bars, 0.04 cycles/sample, 30°": as_seen(
        charts.sinusoid(frequency=0.04, direction_deg=30, waveform="square", **SIZE)
    ),
    "sweep, 0.01 to 0.5 cycles/sample": as_seen(charts.frequency_sweep(lowest=0.01, **SIZE)),
    "dead leaves": as_seen(charts.dead_leaves(contrast=10, **SIZE)),
    "points, diameter 5 samples": as_seen(charts.point_grid(pitch=30, diameter=5.0, **SIZE)),
    "checkerboard, squares of 27.5 samples": as_seen(charts.checkerboard(square=27.5, **SIZE)),
    "logarithmic ramp, 1 : 1000": as_seen(charts.ramp(logarithmic=True, **SIZE)),
    "36 gray patches, 6 decades (log scale)": on_a_log_scale(charts.hdr_patches(decades=6), 6.6),
}
pictures(list(patterns.items()), cols=2, height_in=22.0)
plt.show()
