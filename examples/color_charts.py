"""
Color charts
============

The ColorChecker Classic and the ColorChecker SG under daylight, as an eye sees them. The reflectances of the Classic
were measured. Those of the SG are smooth spectra with the published colors under D50.
"""

import matplotlib.pyplot as plt
from drawing import as_seen, pictures

import photosite as ps

charts = {
    "ColorChecker Classic, measured reflectances": ps.charts.macbeth("D65"),
    "ColorChecker SG, from published colors": ps.charts.color_checker_sg("D65"),
}
pictures([(title, as_seen(chart)) for title, chart in charts.items()], cols=1, height_in=10.2)
plt.show()
