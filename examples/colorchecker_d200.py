"""A ColorChecker captured with the Nikon D200 of the 2008 paper, and its patches on the sensor's noise budget."""

from drawing import save

import photosite as ps
from photosite.develop.color_matrix import fit_color_matrix
from photosite.metrics.patches import patch_statistics
from photosite.report.figures.validation import overview_figure
from photosite.report.pictures import shrink
from photosite.validation.charts import chart_xyz_d65

sensor = ps.load_sensor("nikon-d200")
camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
chart = ps.charts.macbeth("A", 40)
raw = camera.capture(chart, 1 / 3, seed=7)
patches = patch_statistics(raw, camera.image_regions(chart), sensor)
rgb_dn = patches.mean_dn[:, [patches.channels.index(channel) for channel in "RGB"]]
matrix = fit_color_matrix(rgb_dn, chart_xyz_d65("macbeth", patches.names))
picture = shrink(ps.develop(raw, "none", matrix, 1.0), 660)
save(overview_figure(picture, patches, sensor), "colorchecker-d200.png")
