"""The color matrix of a sensor, as DNG defines it for raw files."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.camera.optical_stack import channel_mixing
from photosite.color.colorimetry import xyz
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, integration_weights, photons_from_energy
from photosite.scene.charts import macbeth_reflectance
from photosite.sensor.model import Sensor

_INFRARED_NM = np.arange(790.0, 1101.0, 10.0)


def color_matrix(sensor: Sensor, illuminant_name: str = "D65") -> NDArray[np.float64] | None:
    """Return the matrix from CIE XYZ under an illuminant to the camera's channels: ColorMatrix of DNG 1.7.

    It is the (pseudo)inverse of the least-squares matrix from camera channels to XYZ over the ColorChecker's 24 patches
    under the illuminant (Farrell, Okincha and Parmar 2008, section 3). It is scaled so that the largest channel is 1
    for the illuminant's white. With more than three channels, light beyond 780 nm is one more patch, which is black to
    the eye: the matrix takes it away by means of an infrared channel.

    Returns
    -------
    ndarray or None
        (channels, 3) in the order of the sensor's channels; None if fewer than three of these are linearly
        independent.

    Examples
    --------
    >>> import photosite as ps
    >>> color_matrix(ps.load_sensor("nikon-d200")).shape
    (3, 3)
    """
    names = sensor.channel_names
    if len(names) < 3:
        return None
    responses = channel_mixing(sensor) @ np.stack([sensor.response_at(name, DEFAULT_WAVELENGTH_NM) for name in names])
    infrared = np.zeros(len(names))
    if len(names) > 3:
        beyond = np.stack([sensor.response_at(name, _INFRARED_NM) for name in names])
        infrared = channel_mixing(sensor) @ beyond @ integration_weights(_INFRARED_NM)
    return _color_matrix(tuple(map(tuple, responses.tolist())), tuple(infrared.tolist()), illuminant_name)


@lru_cache(maxsize=8)
def _color_matrix(
    responses: tuple[tuple[float, ...], ...], infrared: tuple[float, ...], illuminant_name: str
) -> NDArray[np.float64] | None:
    grid = DEFAULT_WAVELENGTH_NM
    light = photons_from_energy(illuminant(illuminant_name, grid), grid)
    patches = macbeth_reflectance(grid) * light
    camera = patches @ (np.array(responses) * integration_weights(grid)).T
    if np.linalg.matrix_rank(camera) < 3:
        return None
    white = xyz(light, grid)
    target = xyz(patches, grid) / white[1]
    camera, target = np.vstack([camera, np.array(infrared) * light.mean()]), np.vstack([target, np.zeros(3)])
    to_xyz, *_ = np.linalg.lstsq(camera, target, rcond=None)
    matrix = np.asarray(np.linalg.pinv(to_xyz.T), dtype=np.float64)
    matrix /= (matrix @ (white / white[1])).max()
    matrix.flags.writeable = False
    return matrix
