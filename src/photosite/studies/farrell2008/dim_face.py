"""Section 5, a dimly lit face: a portrait of 5 cd/m2, exposed for 66 ms, captured with both sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from photosite.camera.camera import Camera
from photosite.metrics.snr import noise_budget
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import Column, Paragraph, Table
from photosite.scene.scene import Scene
from photosite.studies.farrell2008.cameras import D200, VENDOR, Case, frame_key
from photosite.studies.farrell2008.drawing import Drawing, Part, SummaryRow, paragraph, text
from photosite.studies.farrell2008.portrait import (
    FACE,
    Captioned,
    Shot,
    filling,
    portrait,
    portrait_scene,
    portrait_source,
    portraits_figure,
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
    """The face captured with one camera; `white_e` are the electrons of a white surface in the most sensitive channel
    in this light."""

    case: Case
    shot: Shot
    white_e: float

    @property
    def title(self) -> str:
        """Camera and f-number."""
        return f"{self.case.title}, f/{self.case.f_number:g}"

    @property
    def read_dsnu_dominate_on_the_face(self) -> bool:
        """Whether read noise and DSNU exceed shot noise and PRNU at the green signal of the face."""
        sensor = self.shot.camera.sensor
        volts = self.shot.face["G"].mean_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
        return volts < noise_budget(sensor, volts).dark_limited_below_volts

    @property
    def floor_e(self) -> float:
        """Read noise and DSNU combined."""
        sensor = self.shot.camera.sensor
        read_mv, dsnu_mv = sensor.noise.read_noise_mv.value, sensor.noise.dsnu_mv.value
        return float(np.hypot(sensor.electrons(read_mv), sensor.electrons(dsnu_mv)))


@dataclass(frozen=True, eq=False)
class DimFace:
    """Result of the chapter: mean luminance of the face, and captures in the order of `CAMERAS`."""

    face_luminance_cd_m2: float
    shots: tuple[FaceShot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for `results.json`."""
        return {
            "portrait": portrait_source(),
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

    def part(self) -> Part:
        """Return the pictures, the noise on the face, and a comparison with the paper."""
        columns = [Captioned("the print", portrait(), "no camera")]
        columns += [Captioned.of(entry.title, entry.shot) for entry in self.shots]
        return (
            paragraph(
                "dim_face",
                level=LUMINANCE_CD_M2,
                milliseconds=1e3 * EXPOSURE_S,
                face=self.face_luminance_cd_m2,
                source=text("portrait_source"),
            ),
            Drawing.of("section5-dim-face", portraits_figure(columns), rows=ROWS, cols=COLS),
            self._table(),
            self._words(),
        )

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the line of the face."""
        shots = ", ".join(f"{entry.shot.face['G'].snr_db:.0f} dB ({entry.title})" for entry in self.shots)
        limited = sum(entry.read_dsnu_dominate_on_the_face for entry in self.shots)
        return (
            (
                f"Face in dim light, {LUMINANCE_CD_M2:g} cd/m², {1e3 * EXPOSURE_S:g} ms",
                "pictures; portrait not published",
                f"SNR of green on the face: {shots}",
                f"Read noise and DSNU dominate with {limited} of {len(self.shots)} cameras. Simulated, not measured.",
            ),
        )

    def _table(self) -> Table:
        rows = tuple(
            (
                entry.title if channel == "R" else "",
                channel,
                format_number(noise.mean_e, 3),
                format_uncertain(noise.snr_db, noise.standard_error_db),
                f"{noise.expected_db:.2f}".replace("-", "−"),
            )
            for entry in self.shots
            for channel, noise in entry.shot.face.items()
        )
        numeric = ("Mean signal, e⁻", "SNR of the frame, dB", "SNR from the noise model, dB")
        return Table(
            "Signal-to-noise ratio on the face, raw mosaic",
            (Column("Camera"), Column("Channel"), *(Column(title, numeric=True) for title in numeric)),
            rows,
        )

    def _words(self) -> Paragraph:
        limited = [entry.title for entry in self.shots if entry.read_dsnu_dominate_on_the_face]
        free = [entry.title for entry in self.shots if not entry.read_dsnu_dominate_on_the_face]
        vendor, d200 = self.shots[:2]
        return paragraph(
            "dim_face_noise",
            limited=" and ".join(limited),
            others=f", but not with {' and '.join(free)}" if free else "",
            more=d200.shot.face["G"].snr_db - vendor.shot.face["G"].snr_db,
            light=(vendor.case.f_number / d200.case.f_number) ** 2,
            area=d200.shot.camera.sensor.pixel_area_m2 / vendor.shot.camera.sensor.pixel_area_m2,
            noise=d200.floor_e / vendor.floor_e,
        )


def dim_face(seed: int) -> DimFace:
    """Capture the dimly lit face with each camera of `CAMERAS`, simulated with the sensors of Table 1."""
    scene = portrait_scene(LUMINANCE_CD_M2)
    return DimFace(region_luminance_cd_m2(scene, FACE), tuple(_shoot(case, scene, seed) for case in CAMERAS))


def _shoot(case: Case, scene: Scene, seed: int) -> FaceShot:
    camera = Camera(case.lens, case.sensor(ROWS, COLS).with_(serial=f"{case.key}, section 5"))
    shot = shoot_portrait(camera, scene, EXPOSURE_S, frame_key(seed, f"dim face, {case.key}"))
    return FaceShot(case, shot, white_surface_electrons(camera, filling(scene, camera), EXPOSURE_S))
