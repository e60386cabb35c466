"""Section 5, the dimly lit face: 5 cd/m2 and 66 ms under both sensors, with gray world."""

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
"""Of the paper. That the luminance is the mean over the picture is an assumption; the face is brighter."""

ROWS, COLS = 300, 256
"""Pixels that the portrait covers on either chip, half of its own 600 x 512."""

CAMERAS: tuple[Case, ...] = (VENDOR, D200, replace(D200, key="d200_f2.8", f_number=VENDOR.f_number))
"""Each with the lens of Table 1; and the D200 once more with the vendor's f-number, for the same light on each square
millimetre: which of its lens's openings the paper took for the face is not known here."""


@dataclass(frozen=True, eq=False)
class FaceShot:
    """The face under one camera.

    Parameters
    ----------
    case
        Which.
    shot
        Frame, picture and noise.
    white_e
        Electrons of a white surface in this light, in the channel that sees most of it.
    """

    case: Case
    shot: Shot
    white_e: float

    @property
    def read_dsnu_rule_on_the_face(self) -> bool:
        """Whether read noise and DSNU are more than shot noise and PRNU at the face's green."""
        sensor = self.shot.camera.sensor
        volts = self.shot.noise("G").mean_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        return volts < noise_budget(sensor, volts).dark_limited_below_volts


@dataclass(frozen=True, eq=False)
class DimFace:
    """The dimly lit face.

    Parameters
    ----------
    scene
        What was shot.
    face_luminance_cd_m2
        Of the face alone.
    shots
        By camera, as in `CAMERAS`.
    """

    scene: Scene
    face_luminance_cd_m2: float
    shots: tuple[FaceShot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Its numbers for `results.json`."""
        return {
            "portrait": portrait().to_dict(),
            "mean_luminance_cd_m2": LUMINANCE_CD_M2,
            "face_luminance_cd_m2": self.face_luminance_cd_m2,
            "cameras": {
                entry.case.key: {
                    "f_number": entry.case.f_number,
                    "white_surface_e": entry.white_e,
                    "read_noise_and_dsnu_rule_on_the_face": entry.read_dsnu_rule_on_the_face,
                    **entry.shot.to_dict(),
                }
                for entry in self.shots
            },
        }


def dim_face(seed: int) -> DimFace:
    """Shoot the dimly lit face with each camera of `CAMERAS`.

    Parameters
    ----------
    seed
        Of the study.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 5. The frames are simulated with Table 1's sensors; nothing here stands
    for a measurement.

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
