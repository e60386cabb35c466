"""Section 5, a dimly lit face: a portrait of 5 cd/m2, exposed for 66 ms, captured with both sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from photosite.camera.camera import Camera
from photosite.metrics.snr import noise_budget
from photosite.scene.scene import Scene
from photosite.studies.farrell2008.cameras import D200, VENDOR, Case, frame_key
from photosite.studies.farrell2008.portrait import (
    FACE,
    Shot,
    filling,
    portrait,
    portrait_scene,
    region_luminance_cd_m2,
    shoot_portrait,
    white_surface_electrons,
)

LUMINANCE_CD_M2, EXPOSURE_S = 5.0, 0.066
"""Values of the paper. That the luminance is the mean over the picture is an assumption; the face is brighter."""

ROWS, COLS = 300, 256
"""Size of the portrait on either chip in pixels, half of its 600 x 512 samples."""

CAMERAS: tuple[Case, ...] = (VENDOR, D200, replace(D200, key="d200_f2.8", f_number=VENDOR.f_number))
"""Both cameras with the lens of Table 1, and the D200 again with the f-number of the vendor camera, for the same
irradiance. The paper does not state the f-number of the D200 for this picture."""


@dataclass(frozen=True, eq=False)
class FaceShot:
    """The face captured with one camera.

    Parameters
    ----------
    case
        Camera.
    shot
        Frame, picture and noise.
    white_e
        Electrons of a white surface in this light, in the most sensitive channel.
    """

    case: Case
    shot: Shot
    white_e: float

    @property
    def read_dsnu_dominate_on_the_face(self) -> bool:
        """Whether read noise and DSNU exceed shot noise and PRNU at the green signal of the face."""
        sensor = self.shot.camera.sensor
        volts = self.shot.noise("G").mean_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        return volts < noise_budget(sensor, volts).dark_limited_below_volts


@dataclass(frozen=True, eq=False)
class DimFace:
    """Result of the chapter.

    Parameters
    ----------
    scene
        The portrait.
    face_luminance_cd_m2
        Mean luminance of the face.
    shots
        By camera, in the order of `CAMERAS`.
    """

    scene: Scene
    face_luminance_cd_m2: float
    shots: tuple[FaceShot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "portrait": portrait().to_dict(),
            "mean_luminance_cd_m2": LUMINANCE_CD_M2,
            "face_luminance_cd_m2": self.face_luminance_cd_m2,
            "cameras": {
                entry.case.key: {
                    "f_number": entry.case.f_number,
                    "white_surface_e": entry.white_e,
                    "read_noise_and_dsnu_dominate_on_the_face": entry.read_dsnu_dominate_on_the_face,
                    **entry.shot.to_dict(),
                }
                for entry in self.shots
            },
        }


def dim_face(seed: int) -> DimFace:
    """Capture the dimly lit face with each camera of `CAMERAS`.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 5. All frames are simulated with the sensors of Table 1; there is no
    measured camera.

    Examples
    --------
    >>> face = dim_face(2008)
    >>> [round(entry.shot.noise("G").expected_db) for entry in face.shots]
    [4, 22, 33]
    """
    scene = portrait_scene(LUMINANCE_CD_M2)
    return DimFace(scene, region_luminance_cd_m2(scene, FACE), tuple(_shoot(case, scene, seed) for case in CAMERAS))


def _shoot(case: Case, scene: Scene, seed: int) -> FaceShot:
    camera = Camera(case.lens, case.sensor(ROWS, COLS).with_(serial=f"{case.key}, section 5"))
    shot = shoot_portrait(camera, scene, EXPOSURE_S, frame_key(seed, f"dim face, {case.key}"))
    return FaceShot(case, shot, white_surface_electrons(camera, filling(scene, camera), EXPOSURE_S))
