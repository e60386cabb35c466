"""Charts and patterns as scenes: one file per kind.

Each is a reflectance, which a light falls on. `charts.ramp("D65", 100, contrast=50)` returns the scene under a light;
`charts.ramp.chart(contrast=50)` returns the reflectances, to be put `.under(light, luminance)`. The arguments of the
light and the place are those of `photosite.scene.charts.chart.Chart.under`; the luminance is the mean of the patches
(`macbeth`, `color_checker_sg`, `hdr_patches`), of all samples of the others. A sample holds the mean of the pattern
over its own rectangle, in closed form where there is one. An invalid option raises `InputError`.
"""

from photosite.scene.charts.chart import Chart as Chart
from photosite.scene.charts.color_checker import MACBETH_NAMES as MACBETH_NAMES
from photosite.scene.charts.color_checker import SG_NAMES as SG_NAMES
from photosite.scene.charts.color_checker import color_checker_sg as color_checker_sg
from photosite.scene.charts.color_checker import color_checker_sg_reflectance as color_checker_sg_reflectance
from photosite.scene.charts.color_checker import macbeth as macbeth
from photosite.scene.charts.color_checker import macbeth_reflectance as macbeth_reflectance
from photosite.scene.charts.color_checker import macbeth_regions as macbeth_regions
from photosite.scene.charts.dead_leaves import dead_leaves as dead_leaves
from photosite.scene.charts.flare_traps import flare_traps as flare_traps
from photosite.scene.charts.gray_steps import gray_steps as gray_steps
from photosite.scene.charts.iso_12233 import edge_star as edge_star
from photosite.scene.charts.iso_12233 import siemens_star as siemens_star
from photosite.scene.charts.iso_12233 import slanted_edge as slanted_edge
from photosite.scene.charts.iso_12233 import slanted_squares as slanted_squares
from photosite.scene.charts.led_bar import led_bar as led_bar
from photosite.scene.charts.light_source import light_source as light_source
from photosite.scene.charts.patches import hdr_patches as hdr_patches
from photosite.scene.charts.patches import reflectance_chart as reflectance_chart
from photosite.scene.charts.patterns import checkerboard as checkerboard
from photosite.scene.charts.patterns import frequency_sweep as frequency_sweep
from photosite.scene.charts.patterns import point_grid as point_grid
from photosite.scene.charts.patterns import ramp as ramp
from photosite.scene.charts.patterns import sinusoid as sinusoid
from photosite.scene.charts.patterns import uniform as uniform
from photosite.scene.charts.patterns import zone_plate as zone_plate

__all__ = [
    "MACBETH_NAMES",
    "SG_NAMES",
    "Chart",
    "checkerboard",
    "color_checker_sg",
    "color_checker_sg_reflectance",
    "dead_leaves",
    "edge_star",
    "flare_traps",
    "frequency_sweep",
    "gray_steps",
    "hdr_patches",
    "led_bar",
    "light_source",
    "macbeth",
    "macbeth_reflectance",
    "macbeth_regions",
    "point_grid",
    "ramp",
    "reflectance_chart",
    "siemens_star",
    "sinusoid",
    "slanted_edge",
    "slanted_squares",
    "uniform",
    "zone_plate",
]
__dir__ = __all__.copy
