"""A face in good light and in little, through the gallery's D200, after section 5 of the 2008 paper."""

from __future__ import annotations

from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.style import styled
from photosite.studies.farrell2008.portrait import FACE, portrait_scene, region_luminance_cd_m2, shoot_portrait
from photosite.studies.gallery.panels import Panel, pictures
from photosite.studies.gallery.through_a_camera import SEED, d200

_LUMINANCES_CD_M2 = (500.0, 50.0, 5.0)
_EXPOSURE_S = 1 / 60


@styled()
def low_light() -> Figure:
    """One portrait at three luminances, the exposure the same; how far its face stands above the noise."""
    camera = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), d200(360, 300))
    panels: list[Panel] = []
    for luminance in _LUMINANCES_CD_M2:
        scene = portrait_scene(luminance)
        taken = shoot_portrait(camera, scene, _EXPOSURE_S, SEED)
        face, noise = region_luminance_cd_m2(scene, FACE), taken.noise("G")
        panels.append((f"face of {face:,.0f} cd/m²: {noise.mean_e:,.0f} e⁻, {noise.snr_db:.1f} dB", taken.picture))
    return pictures([panels])
