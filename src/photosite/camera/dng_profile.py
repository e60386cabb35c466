"""The color matrix and the noise profile of a camera, as DNG defines them for raw files."""

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
    """Return the matrix from CIE XYZ under D65 to the camera's channels: ColorMatrix1 of DNG 1.7.

    It is the inverse of the least-squares 3 x 3 matrix from camera R, G, B to XYZ over the ColorChecker's 24 patches
    under D65 (Farrell, Okincha and Parmar 2008, section 3). It is scaled so that the largest channel is 1 for D65.

    Returns
    -------
    ndarray or None
        (channels, 3) in the order of the sensor's channels; None if these are not R, G and B, or if their responses are
        linearly dependent.

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
    """Return (channels, 2) scale and offset: a signal s from 0 (black) to 1 (white) has the variance scale s + offset.

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
