"""Pictures of the gallery that a renderer makes."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.style import styled
from photosite.scene.preview import preview
from photosite.scene.render import example_scene
from photosite.studies.gallery.panels import pictures
from photosite.studies.gallery.through_a_camera import d200, shot


@styled()
def still_life() -> Figure:
    """The example scene as an eye adapted to its lamp sees it, and as a D200 does."""
    scene = example_scene(rows=240, cols=360)
    seen = preview(scene, white_xy=(0.4234, 0.3990))  # a blackbody of 3200 K
    lens = DiffractionLimited(f_number=4, focal_length_mm=4.4)  # spans the scene's width with few pixels
    taken = shot(scene, Camera(lens, d200(240, 360)), "3200K")
    return pictures([[("the scene", seen), ("240 x 360 pixels of a D200 at f/4", taken)]])
