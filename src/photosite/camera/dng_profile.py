"""What a raw file says of its camera: the colour matrix and the noise profile, as DNG defines them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.camera.optical_stack import channel_mixing
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, integration_weights, photons_from_energy
from photosite.color.tristimulus import xyz
from photosite.scene.charts import macbeth_reflectance
from photosite.sensor.model import Sensor
from photosite.sensor.noise_profile import sensor_noise_profile


def color_matrix(sensor: Sensor) -> NDArray[np.float64] | None:
    """(channels, 3), CIE XYZ under D65 to camera channels, in the order of the sensor's channels.

    The inverse of the least-squares 3 x 3 from camera R, G, B to XYZ over the ColorChecker's 24 patches under D65
    (Farrell, Okincha and Parmar 2008, section 3), scaled so that the white of D65 has 1 in its fullest channel.

    Returns
    -------
    ndarray or None
        None where the channels are not R, G and B, or their responses do not span three colours.

    Notes
    -----
    DNG specification 1.7, ColorMatrix1, calibration illuminant D65.

    Examples
    --------
    >>> import photosite as ps
    >>> color_matrix(ps.load_sensor("nikon-d200")).shape
    (3, 3)
    """
    names = sensor.channel_names
    if set(names) != {"R", "G", "B"}:
        return None
    responses = channel_mixing(sensor) @ np.stack([sensor.response_at(name, DEFAULT_WAVELENGTH_NM) for name in names])
    return _color_matrix(tuple(tuple(response.tolist()) for response in responses))


@lru_cache(maxsize=8)
def _color_matrix(responses: tuple[tuple[float, ...], ...]) -> NDArray[np.float64] | None:
    grid = DEFAULT_WAVELENGTH_NM
    light = photons_from_energy(illuminant("D65", grid), grid)
    patches = macbeth_reflectance(grid) * light
    camera = patches @ (np.array(responses) * integration_weights(grid)).T
    if np.linalg.matrix_rank(camera) < 3:
        return None
    white = xyz(light, grid)
    to_xyz, *_ = np.linalg.lstsq(camera, xyz(patches, grid) / white[1], rcond=None)
    matrix = np.asarray(np.linalg.inv(to_xyz.T), dtype=np.float64)
    matrix /= (matrix @ (white / white[1])).max()
    matrix.flags.writeable = False
    return matrix


def noise_profile(sensor: Sensor, exposure_s: float) -> NDArray[np.float64]:
    """(channels, 2), scale and offset: a signal s in 0..1 (black to white) varies by scale s + offset.

    The scale is the photons' noise; the offset is read noise, DSNU, the dark current's shot noise and rounding. PRNU
    grows with the square of the signal and has no place in this model.

    Notes
    -----
    DNG specification 1.7, NoiseProfile.

    Examples
    --------
    >>> import photosite as ps
    >>> scale, offset = noise_profile(ps.load_sensor("nikon-d200"), 1 / 8000)[0]
    >>> float((1 / scale / 4095).round(2)), float((offset**0.5 * 4095).round(2))
    (7.98, 3.17)
    """
    profile = sensor_noise_profile(sensor, exposure_s)
    return np.array([(slope.value, offset.value) for slope, offset in zip(profile.slope, profile.offset, strict=True)])
