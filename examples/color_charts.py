"""The ColorChecker Classic and the ColorChecker SG under daylight, as an eye sees them."""

from drawing import as_seen, save
from matplotlib.figure import Figure

import photosite as ps

figure = Figure(figsize=(8.8, 3.4), layout="constrained")
charts = {
    "ColorChecker Classic, measured reflectances": ps.charts.macbeth("D65"),
    "ColorChecker SG, from published colors": ps.charts.color_checker_sg("D65"),
}
for axes, (title, chart) in zip(figure.subplots(1, 2), charts.items(), strict=True):
    axes.imshow(as_seen(chart), interpolation="antialiased")
    axes.set_title(title)
    axes.set_axis_off()
save(figure, "color-charts.png")
