"""Levels, noise profile and metadata of a camera's raw frames, as DNG defines them for raw files."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.image_over_time import AnyScene
from photosite.camera.mean_image import electrons_per_weight
from photosite.camera.optical_stack import channel_mixing
from photosite.camera.parts import CameraParts
from photosite.errors import InputError
from photosite.frames.companding import COMPANDING, companding_text
from photosite.frames.raw_frame import OPTICAL_BLACK, neutral_text
from photosite.scene.dynamic_scene import DynamicScene
from photosite.scene.planes import Planes
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import sensor_noise_profile
from photosite.sensor.noise_terms import NoiseTerms
from photosite.sensor.saturation_level import saturation_level_dn
from photosite.sensor.shot import Shot
from photosite.values.cfa import plane_names


def frame_fields(camera: CameraParts, exposure_s: float, shot: Shot, scene: AnyScene | None) -> dict[str, Any]:
    """Return the arguments of `RawFrame` other than digital numbers and captures; see `Camera.expose`."""
    sensor, region, celsius = camera.sensor, shot.region, shot.temperature_c
    at = sensor if celsius is None else sensor.at_temperature(celsius)
    several, cfa = sensor.captures, sensor.array.cfa
    if several is None:
        bits, (black_level_dn, highest_dn) = sensor.readout.bits, sensor.output_levels_dn
        white_level_dn = saturation_level_dn(sensor)
        profile = None
        if at.effects is None or not at.effects.companded:
            ratio = (highest_dn - black_level_dn) / (white_level_dn - black_level_dn)
            profile = noise_profile(at, exposure_s) * (ratio, ratio**2)
    else:
        profile, bits = None, several.combination.output_bits
        black_level_dn, white_level_dn = several.combination.output_black_level_dn, saturation_level_dn(sensor)
    metadata: dict[str, Any] = {"camera": sensor.name, "serial": sensor.serial, "seed": shot.seed, "frame": shot.frame}
    if several is not None and (table := several.combination.companding) is not None:
        metadata[COMPANDING] = companding_text(table.linear_dn, table.companded_dn)
    if sensor.gain_setting is not None:
        metadata["gain_setting"] = sensor.gain_setting
        if sensor.gain_setting_is_iso:
            metadata["iso"] = sensor.gain_setting
    if several is None:
        metadata["read_noise_e"] = math.sqrt(NoiseTerms(sensor).read_e2)
    if celsius is not None:
        metadata["temperature_c"] = float(celsius)
    lens = getattr(camera.optics, "base", camera.optics)
    metadata |= {key: value for key in ("f_number", "focal_length_mm") if (value := getattr(lens, key, None))}
    if (neutral := None if scene is None else _neutral_of(camera, scene)) is not None:
        metadata["as_shot_neutral"] = neutral
    if sensor.array.stacked:
        metadata["stacked"] = 1
        if region is not None and (region[2] % len(cfa[0]) or region[3] % len(cfa[0])):
            raise InputError("region", value=region, expected=f"columns in multiples of {len(cfa[0])}")
    if region is None and sensor.effects is not None and (border := sensor.effects.border) is not None:
        metadata[OPTICAL_BLACK] = ",".join(map(str, border))
    if region is not None:
        metadata["region"] = ",".join(map(str, region))
    return {
        "bits": bits,
        "cfa": shot.cfa(cfa),
        "black_level_dn": black_level_dn,
        "white_level_dn": white_level_dn,
        "exposure_s": exposure_s,
        "color_matrix": camera.color_matrices[0],
        "color_matrix_a": camera.color_matrices[1],
        "noise_profile": profile,
        "metadata": metadata,
    }


def as_shot_neutral(camera: CameraParts, light: Scene) -> str | None:
    """Return the neutral of a uniform field; see `Camera.as_shot_neutral`."""
    names = camera.sensor.channel_names
    if len(names) == 1:
        return None
    alone = electrons_per_weight(light, camera).sum(axis=(1, 2))
    electrons = channel_mixing(camera.sensor) @ alone
    signal = np.array([electrons[names.index(name)] for name in plane_names(camera.sensor.array.cfa)])
    colors = [value for name, value in zip(plane_names(camera.sensor.array.cfa), signal, strict=True) if name in "RGB"]
    if not min(colors, default=signal.max()) > 0:
        return None
    return neutral_text(signal.tolist())


def _neutral_of(camera: CameraParts, scene: AnyScene) -> str | None:
    """Return `as_shot_neutral` of a scene's light where its reflectance is known; of planes, the first such."""
    lit = next((one for one in flat_scenes(scene) if one.reflectance is not None), None)
    return None if lit is None else as_shot_neutral(camera, Scene.uniform(lit.light(), lit.wavelength_nm))


def flat_scenes(scene: AnyScene) -> list[Scene]:
    """Return the flat scenes that a scene consists of."""
    still = scene.scene if isinstance(scene, DynamicScene) else scene
    return [plane.scene for plane in still.planes] if isinstance(still, Planes) else [still]


def noise_profile(sensor: Sensor, exposure_s: float) -> NDArray[np.float64]:
    """Return (channels, 2) scale and offset: a signal s from 0 (black) to 1 (highest) has variance scale s + offset.

    The scale is photon shot noise. The offset is read noise, DSNU, dark current shot noise and quantization. The model
    has no PRNU, whose variance grows with the square of the signal. It is NoiseProfile of DNG 1.7.

    Examples
    --------
    >>> import photosite as ps
    >>> scale, offset = noise_profile(ps.load_sensor("nikon-d200"), 1 / 8000)[0]
    >>> float((1 / scale / 4095).round(2)), float((offset**0.5 * 4095).round(2))
    (7.98, 3.17)
    """
    profile = sensor_noise_profile(sensor, exposure_s)
    return np.array([(slope.value, offset.value) for slope, offset in zip(profile.slope, profile.offset, strict=True)])
