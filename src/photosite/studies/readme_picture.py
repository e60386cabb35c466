"""The picture at the top of the README: a ColorChecker shot with a virtual Nikon D200 at the 2008 paper's conditions.

To make it again, from the root of the repository: `python -m photosite.studies.readme_picture`.
"""

from __future__ import annotations

import io
from os import PathLike

from PIL import Image

from photosite.camera.camera import Camera
from photosite.develop.color_matrix import fit_color_matrix
from photosite.develop.develop import develop
from photosite.files.atomic import atomic_path
from photosite.metrics.patches import patch_statistics
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.figures.validation import overview_figure
from photosite.report.pictures import shrink
from photosite.report.style import png_bytes
from photosite.scene.charts import macbeth
from photosite.sensor.io.sensor_file import load_sensor
from photosite.validation.charts import chart_xyz_d65

DEFAULT_PATH = "docs/images/colorchecker-d200.png"


def write_readme_picture(path: str | PathLike[str] = DEFAULT_PATH, *, rows: int = 2592, cols: int = 3872) -> None:
    """Simulate the chart, develop it, and set its patches on the sensor's noise budget.

    Parameters
    ----------
    path
        The PNG.
    rows, cols
        Size of the chip; the D200's unless a smaller one shall be quicker.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    sensor = load_sensor("nikon-d200").with_(rows=rows, cols=cols)
    camera = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    chart = macbeth("A", 40)
    raw = camera.capture(chart, 1 / 3, seed=7)
    patches = patch_statistics(raw, camera.image_regions(chart), sensor)
    order = [patches.channels.index(channel) for channel in "RGB"]
    matrix = fit_color_matrix(patches.mean_dn[:, order], chart_xyz_d65("macbeth", patches.names))
    picture = develop(raw, "none", matrix, 1.0)
    figure = overview_figure(shrink(picture, 660), patches, sensor)
    # 256 colours hold the patches and the lines; what noise is left in 36-pixel means is not worth 200 kB.
    whole = Image.open(io.BytesIO(png_bytes(figure, 125))).convert("RGB")
    with atomic_path(path) as temporary:
        whole.quantize(256, dither=Image.Dither.NONE).save(temporary, format="PNG", optimize=True)


if __name__ == "__main__":
    write_readme_picture()
