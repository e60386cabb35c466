"""Mean electrons of every pixel: the image of a scene, flat or in depth, through a lens on a sensor, without noise.

`Camera` is the public interface. The functions here combine scene, optics and sensor, and pass arrays to the engine.
docs/theory/model.md derives the equations.

Planes at different distances are imaged separately and combined from the farthest to the nearest. Every plane has its
own magnification, defocus, distortion and relative illumination. Neighboring planes that the lens blurs alike, for
example all planes in focus, occlude each other on the frame's cells, before the blur. Planes blurred differently are
combined by their opacity alpha, imaged in the same way as the plane itself, channel by channel::

    image = image_p(alpha radiance) + (1 - image_p(alpha)) * image behind

The image of the opacity is taken in the light that it blocks: the mean spectrum of what is behind. These are linear
layers. A real lens sees each point of a plane through its whole pupil, and through each part of the pupil another part
of the plane behind. The product is exact if either plane is in focus, except for the lens's smallest blur, and if the
plane behind is uniform. It errs near edges of opacity if both planes are out of focus (docs/theory/depth.md).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from photosite.camera.channel_transfers import ReducedTransfer, reduced_transfers
from photosite.camera.optical_stack import apply_optical_stack, low_pass_split_m
from photosite.camera.parts import CameraParts
from photosite.camera.sampled_otf import Progress, field_scale
from photosite.camera.veiling_glare import add_glare
from photosite.color.spectrum import integration_weights
from photosite.engine.layers import Field, Grid, Layer, View
from photosite.engine.mosaic import mosaic_of_layers
from photosite.engine.resample import Warp
from photosite.engine.threads import threads_for
from photosite.engine.transfer import Sampling
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.distortion import RadialMapping, image_height, inverse_scale, wavelength_nodes
from photosite.optics.lens import Optics
from photosite.optics.point_spread import FieldPsf, PointSpread, RadialPsf, in_part_of_field
from photosite.scene.placement import Placement, field_size, place
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_sites
from photosite.values.region import Region

Mosaic = NDArray[np.float32]

_STRIP = 256
_MISSING_LIGHT_LIMIT = 0.01
"""Fraction of a channel's response outside the scene's wavelengths above which a warning is issued."""
_MOST_ELECTRONS_PER_S = 1e30
"""For weight 1; 32-bit floats then hold the products with weights, transforms and exposure times."""
_ROUNDING = 1e-5
"""How far below 0 rounding of the transforms may leave a dark pixel, relative to the brightest sample's electrons."""
_REDUCTION_FACTOR = 3.0
"""A channel sees part of the wavelengths, and may have this multiple of the scene's error over all wavelengths."""

_FEWEST_SAMPLES, _MOST_SAMPLES = 1e-9, 1e6
_SMALLEST_IMAGE_M = 1e-30

_STEP_PIXELS = 0.1
_SAME_PLACE_PIXELS = 1e-6
"""Largest distance between places in the frame that count as the same."""
_POINTS_PER_SIDE = 65
"""Points on each side of a region whose images are computed."""

Pitch = tuple[float, float]
Array = NDArray[np.float64]


def electron_rate(scene: Scene, camera: CameraParts, progress: Progress | None = None) -> Mosaic:
    """Return (rows, cols) mean electrons from light per second; see `Camera.mean_electrons`."""
    warn_of_missing_light(scene, camera.sensor)
    relative_error = scene.relative_error + low_rank_error(camera.optics, scene.distance_m)
    return finish_mosaic(image_rate(scene, camera, progress=progress), camera, [scene], relative_error)


def image_rate(
    scene: Scene, camera: CameraParts, occluders: Sequence[Scene] = (), progress: Progress | None = None
) -> Mosaic:
    """Return (rows, cols) electrons per second of a scene's image; rounding may leave values slightly below 0.

    Occluders are scenes whose only weights are opacities: what hides parts of the scene, before the lens blurs it.
    A channel with a polarizer sees the sum of the images of the Stokes parameters S0, S1 and S2, which are linear.
    """
    coupling = checked_coupling(scene, camera)
    if scene.shape == (1, 1) and not occluders:
        mosaic = uniform_mosaic(coupling.sum(axis=2) @ scene.weights[:, 0, 0].astype(np.float64), camera.sensor)
    else:
        mosaic = _blurred_mosaic(scene, camera, coupling, occluders, progress)
        for part, seen in polarization_maps(scene, camera.sensor):
            polarized = replace(scene, weights=scene.weights * part, polarization=None)
            mosaic += _blurred_mosaic(polarized, camera, coupling * seen[:, None, None], occluders, progress)
    apply_relative_illumination(mosaic, camera, scene.distance_m)
    return mosaic


def checked_coupling(scene: Scene, camera: CameraParts) -> NDArray[np.float64]:
    """Return `electrons_per_weight`; raise `InputError` if it is beyond the range of 32-bit floats."""
    coupling = electrons_per_weight(scene, camera)
    if not (brightest := float(np.abs(coupling.sum(axis=2)).max())) < _MOST_ELECTRONS_PER_S:
        raise InputError(
            "the scene's electrons per second in a pixel for weight 1",
            value=brightest,
            expected=f"below {_MOST_ELECTRONS_PER_S:g}, the range of 32-bit floats",
            hint="Give the scene a lower luminance",
        )
    return coupling


def fine_images(
    scene: Scene, camera: CameraParts, margin: tuple[int, int], progress: Progress | None = None
) -> NDArray[np.float32]:
    """Return (channels, R, C) electrons per second that a pixel of each channel collects at each cell of a field.

    The field is the frame with a margin of (rows, cols) pixels on all sides. Relative illumination and what follows it
    are left out, and the lens has neither distortion nor a blur that varies over the field.
    """
    warn_of_missing_light(scene, camera.sensor)
    if polarization_maps(scene, camera.sensor):
        hint = "Give it one degree and angle, or record a function of time"
        raise InputError("motion does not apply to a scene whose polarization varies", hint=hint)
    sensor, cells, where = camera.sensor, camera.cells_per_pixel, placement(scene, camera)
    array, pitch, side = sensor.array, pitch_m(sensor), math.sqrt(sensor.pixel.fill_factor.value)
    coupling, spread = electrons_per_weight(scene, camera), camera.optics.point_spread(scene.distance_m)
    sampling = Sampling(
        (pitch[0] / cells, pitch[1] / cells), (pitch[0] * side, pitch[1] * side), 1, low_pass_split_m(sensor)
    )
    start = where.row_start - margin[0] * where.row_step, where.col_start - margin[1] * where.col_step
    view = View(scene.weights, start, (where.row_step / cells, where.col_step / cells))
    shape = (array.rows + 2 * margin[0]) * cells, (array.cols + 2 * margin[1]) * cells
    images = np.zeros((len(coupling), *shape), np.float32)
    for image, of_channel in zip(images, coupling, strict=True):
        fractions = np.ones((1, scene.wavelength_nm.size))
        transfers = reduced_transfers(spread, of_channel[None], scene.wavelength_nm, sampling, fractions, progress)
        if not transfers:  # the channel receives no light
            continue
        # A photodetector is wider than a cell.
        padding = cells + math.ceil(max(reduced.padding_m for reduced in transfers) / min(sampling.pitch_m))
        layers = [_layer(reduced, (view,), None) for reduced in transfers]
        with threads_for(image.size):
            image[:] = mosaic_of_layers(layers, sampling, Grid(shape, padding, (1, 1)), [[(0, 0)]], progress)
        clip_negative(image, scene.relative_error, lambda: brightest_sample(scene, camera))
    return images


def finish_moving_mosaic(mosaic: Mosaic, camera: CameraParts, scene: Scene) -> Mosaic:
    """Apply what stays with the camera to a mosaic from `fine_images`; the mosaic may be changed."""
    apply_relative_illumination(mosaic, camera, scene.distance_m)
    return finish_mosaic(mosaic, camera, [scene], 0.0)


def finish_mosaic(mosaic: Mosaic, camera: CameraParts, scenes: Sequence[Scene], relative_error: float) -> Mosaic:
    """Check that a mosaic is not negative, then apply veiling glare and the sensor's optical stack.

    - `mosaic`: (rows, cols) electrons per second; may be changed.
    - `camera`: Lens and sensor.
    - `scenes`: The scenes of the image, near to far.
    - `relative_error`: RMS error of the scenes' and the lens's low-rank approximations, which may leave values below 0.
    """
    optics, sensor = camera.optics, camera.sensor
    clip_negative(mosaic, relative_error, lambda: max(brightest_sample(scene, camera) for scene in scenes))
    if optics.veiling_glare is not None:
        add_glare(mosaic, optics.veiling_glare, sensor.array.cfa, pitch_m(sensor))
    return apply_optical_stack(mosaic, sensor, optics, scenes[-1].distance_m)


def low_rank_error(optics: Optics, distance_m: float) -> float:
    """Return the RMS error of a lens whose point spreads are a sum of few modes; 0 for any other lens."""
    spread = optics.point_spread(distance_m)
    return spread.relative_error if isinstance(spread, FieldPsf) else 0.0


def pitch_m(sensor: Sensor) -> tuple[float, float]:
    """Return the (vertical, horizontal) pixel pitch in m."""
    return sensor.pixel.height_um.value * 1e-6, sensor.pixel.width_um.value * 1e-6


def placement(scene: Scene, camera: CameraParts) -> Placement:
    """Return where the scene's samples fall on the sensor's pixels."""
    pixel, array = camera.sensor.pixel, camera.sensor.array
    samples, content = None, None
    if scene.width_m is None:
        content = field_size(scene)
    else:
        image_width_m = scene.width_m * camera.optics.magnification(scene.distance_m)
        samples = scene.shape[1] * pixel.width_um.value * 1e-6 / max(image_width_m, _SMALLEST_IMAGE_M)
        if not _FEWEST_SAMPLES <= samples <= _MOST_SAMPLES:
            expected = f"that of an image with {_FEWEST_SAMPLES:g} to {_MOST_SAMPLES:g} samples a pixel"
            raise InputError("width_m", value=scene.width_m, expected=expected)
    aspect = pixel.height_um.value / pixel.width_um.value
    return place(scene.shape, (array.rows, array.cols), pixel_aspect=aspect, cols_per_pixel=samples, content=content)


def image_regions(scene: Scene, camera: CameraParts) -> tuple[Region, ...]:
    """Return the scene's regions in pixels of the frame; see `Camera.image_regions`."""
    mapping = camera.optics.mapping(scene.distance_m)
    return warped_regions(mapping, placement(scene, camera), scene.regions, pitch_m(camera.sensor))


def electrons_per_weight(scene: Scene, camera: CameraParts) -> NDArray[np.float64]:
    """Return the coupling: (channels, K, wavelengths) electrons per second in a pixel for weight 1.

    The sum over wavelength is the integral; the integration weights are included. So is the response of polarizers to
    light whose polarization is the same everywhere.
    """
    grid, sensor = scene.wavelength_nm, camera.sensor
    irradiance = scene.basis * camera.optics.irradiance_per_radiance(grid, scene.distance_m)
    area_m2 = sensor.pixel_area_m2 * sensor.pixel.fill_factor.value
    responses = np.stack([sensor.response_at(name, grid) for name in sensor.channel_names])
    if scene.polarization is not None and scene.polarization.degree.size == 1:
        responses *= 1.0 + _polarizers(sensor) @ scene.polarization.stokes.reshape(2, 1)
    return responses[:, None, :] * (irradiance * integration_weights(grid, camera.integration) * area_m2)


def _polarizers(sensor: Sensor) -> NDArray[np.float64]:
    """Return (channels, 2): how the channels respond to the Stokes parameters S1 and S2."""
    return np.array([sensor.channels[name].polarizer for name in sensor.channel_names])


def polarization_maps(scene: Scene, sensor: Sensor) -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Return (rows, cols) S1 and S2 over S0 with the channels' responses to each; none without such maps."""
    polarizers = _polarizers(sensor)
    if scene.polarization is None or scene.polarization.degree.size == 1 or not polarizers.any():
        return []
    return list(zip(scene.polarization.stokes.astype(np.float32), polarizers.T, strict=True))


def _blurred_mosaic(
    scene: Scene,
    camera: CameraParts,
    coupling: NDArray[np.float64],
    occluders: Sequence[Scene],
    progress: Progress | None,
) -> Mosaic:
    """Return (rows, cols) electrons per second of a scene that is not uniform."""
    parts, array = mosaic_parts(scene, camera, coupling, occluders, progress), camera.sensor.array
    if not parts.layers:  # no channel receives light
        return np.zeros((array.rows, array.cols), np.float32)
    with threads_for(array.rows * array.cols * camera.cells_per_pixel**2):
        return mosaic_of_layers(*parts, progress)


class MosaicParts(NamedTuple):
    """What `engine.mosaic` computes a mosaic from."""

    layers: list[Layer]
    sampling: Sampling
    grid: Grid
    sites: list[tuple[tuple[int, int], ...]]


def mosaic_parts(
    scene: Scene,
    camera: CameraParts,
    coupling: NDArray[np.float64],
    occluders: Sequence[Scene] = (),
    progress: Progress | None = None,
) -> MosaicParts:
    """Return the layers of a scene that is not uniform, and their grid; no layers if no channel receives light."""
    optics, sensor, cells = camera.optics, camera.sensor, camera.cells_per_pixel
    array, pitch = sensor.array, pitch_m(sensor)
    shape, side = (array.rows, array.cols), math.sqrt(sensor.pixel.fill_factor.value)
    sampling = Sampling(pitch, (pitch[0] * side, pitch[1] * side), cells, low_pass_split_m(sensor))
    spread, mapping = _spread_on_frame(camera, scene.distance_m), optics.mapping(scene.distance_m)
    nodes_nm, fractions = frame_wavelength_nodes(mapping, scene.wavelength_nm, shape, pitch)
    transfers = reduced_transfers(spread, coupling, scene.wavelength_nm, sampling, fractions, progress)
    padding = math.ceil(max((reduced.padding_m for reduced in transfers), default=0.0) / min(pitch))
    grid = Grid(shape, padding, (len(array.cfa), len(array.cfa[0])), cells)
    reach_m = math.hypot(*(grid.farthest(axis) * pitch[axis] for axis in (0, 1)))
    views = []
    for node_nm in nodes_nm:
        covers = [_view(cover, cover.weights[:1], camera, node_nm, reach_m) for cover in occluders]
        views.append(_view(scene, scene.weights, camera, node_nm, reach_m, tuple(covers)))
    field = _field(spread, sensor) if isinstance(spread, FieldPsf) else None
    layers = [_layer(reduced, tuple(views), field) for reduced in transfers]
    return MosaicParts(layers, sampling, grid, [channel_sites(array.cfa, name) for name in sensor.channel_names])


def _spread_on_frame(camera: CameraParts, distance_m: float) -> PointSpread:
    """Return the point spread, of a lens that varies over the field with the modes that the frame needs only."""
    spread = camera.optics.point_spread(distance_m)
    if not isinstance(spread, FieldPsf):
        return spread
    array, pitch = camera.sensor.array, pitch_m(camera.sensor)
    wavelengths = (550.0,) if spread.modes[0].wavelength_nm is None else spread.modes[0].wavelength_nm
    reach_m = max(mode.reach_m(float(nm)) for mode in spread.modes for nm in wavelengths)
    y_m, x_m = (count * size / 2 + reach_m for count, size in zip((array.rows, array.cols), pitch, strict=True))
    kept = _frame_spreads.get(spread)
    if kept is None or kept[0] != (y_m, x_m):
        _frame_spreads[spread] = kept = (y_m, x_m), in_part_of_field(spread, (-y_m, y_m), (-x_m, x_m))
    return kept[1]


_frame_spreads: WeakKeyDictionary[FieldPsf, tuple[tuple[float, float], FieldPsf]] = WeakKeyDictionary()
"""The latest result of each lens, for as long as it lives: a series of frames repeats the same call."""


def _layer(reduced: ReducedTransfer, views: tuple[View, ...], field: Field | None) -> Layer:
    """Return the engine's layer, in single precision."""
    node_maps = None if reduced.node_maps is None else tuple(maps.astype(np.float32) for maps in reduced.node_maps)
    return Layer(views, reduced.mixing.astype(np.float32), reduced.transfer, node_maps, field, reduced.channel)


def _view(
    scene: Scene, weights: Mosaic, camera: CameraParts, node_nm: float, reach_m: float, occluders: tuple[View, ...] = ()
) -> View:
    """Return a scene's maps as the lens places them on the frame at a wavelength."""
    where, pitch, array = placement(scene, camera), pitch_m(camera.sensor), camera.sensor.array
    start, step = (where.row_start, where.col_start), (where.row_step, where.col_step)
    warp = frame_warp(camera.optics.mapping(scene.distance_m), node_nm, reach_m, pitch)
    if warp is not None and np.ptp(warp.scale) * reach_m <= _SAME_PLACE_PIXELS * min(pitch):
        # A magnification, as of lateral color without distortion: rows and columns are resampled separately.
        scale, warp = float(warp.scale[0]), None
        start = (start[0] + (1 - scale) * step[0] * array.rows / 2, start[1] + (1 - scale) * step[1] * array.cols / 2)
        step = (scale * step[0], scale * step[1])
    return View(weights, start, step, warp, occluders)


def _field(spread: FieldPsf, sensor: Sensor) -> Field:
    """Return the spread's field weights on the frame, divided by `field_scale`, which the transfer contains."""
    array, pitch = sensor.array, pitch_m(sensor)
    return Field(
        row=spread.y_m / pitch[0] + array.rows / 2,
        col=spread.x_m / pitch[1] + array.cols / 2,
        weights=spread.weights / field_scale(spread)[:, None, None],
    )


def uniform_mosaic(electrons: NDArray[np.float64], sensor: Sensor) -> Mosaic:
    """Return (rows, cols) with each pixel at its channel's electrons."""
    array = sensor.array
    mosaic = np.empty((array.rows, array.cols), np.float32)
    for value, name in zip(electrons, sensor.channel_names, strict=True):
        for r, c in channel_sites(array.cfa, name):
            mosaic[r :: len(array.cfa), c :: len(array.cfa[0])] = value
    return mosaic


def apply_relative_illumination(mosaic: Mosaic, camera: CameraParts, distance_m: float) -> None:
    """Multiply by the lens's relative illumination, in strips, because a map in double precision is large.

    It is computed in a quarter of the frame. The others are mirror images.
    """
    if camera.optics.relative_illumination(np.zeros(1), distance_m) is None:
        return
    pixel, (rows, cols) = camera.sensor.pixel, mosaic.shape
    above, left = rows // 2, cols // 2
    y_m = (np.arange(above, rows) + 0.5 - rows / 2) * pixel.height_um.value * 1e-6
    x_m = (np.arange(left, cols) + 0.5 - cols / 2) * pixel.width_um.value * 1e-6
    for first in range(above, rows, _STRIP):
        end = min(first + _STRIP, rows)
        height_m = np.hypot(y_m[first - above : end - above, None], x_m)
        quarter = camera.optics.relative_illumination(height_m, distance_m)
        assert quarter is not None
        falloff = np.empty((end - first, cols), np.float32)
        falloff[:, left:] = quarter
        falloff[:, :left] = falloff[:, : cols - left - 1 : -1]
        mosaic[first:end] *= falloff
        mirrored = mosaic[rows - end : min(rows - first, above)]  # without the middle row of an odd number
        mirrored *= falloff[::-1][: len(mirrored)]


def clip_negative(mosaic: Mosaic, relative_error: float, full_scale: Callable[[], float]) -> None:
    """Set to 0, in place, what rounding and low-rank approximations left below 0; raise an error if it is more."""
    lowest, highest = float(mosaic.min()), float(mosaic.max())
    negative = lowest < -_ROUNDING * max(highest, 0.0) and lowest < -_ROUNDING * full_scale()
    if negative and not _within_reduction(mosaic, relative_error):
        raise InputError(
            "the scene's radiance is negative in places",
            value=f"{lowest:g} electrons per second in a pixel",
            hint="Change its weights and basis so that all radiances are 0 or more",
        )
    np.maximum(mosaic, np.float32(0), out=mosaic)


def brightest_sample(scene: Scene, camera: CameraParts) -> float:
    """Return the electrons per second of a pixel that sees nothing but the brightest sample.

    Errors of the transforms are proportional to this, not to the brightest pixel: the image of a point is far darker.
    """
    coupling = electrons_per_weight(scene, camera).sum(axis=2).astype(np.float32)
    return max(
        float(np.tensordot(coupling, scene.weights[:, first : first + _STRIP], axes=1).max())
        for first in range(0, scene.shape[0], _STRIP)
    )


def _within_reduction(mosaic: Mosaic, relative_error: float) -> bool:
    """Return whether the RMS of values below 0 is within the stated error of few spectra or few lens modes."""
    below = np.minimum(mosaic, np.float32(0)).ravel()
    whole = mosaic.ravel()
    return float(below @ below) <= (_REDUCTION_FACTOR * relative_error) ** 2 * float(whole @ whole)


def warn_of_missing_light(scene: Scene, sensor: Sensor) -> None:
    """Warn if a channel responds to light outside the scene's wavelengths."""
    for name in sensor.channel_names:
        outside = scene.light_outside(*sensor.response(name))
        if outside > _MISSING_LIGHT_LIMIT:
            grid = scene.wavelength_nm
            what = (
                f"{outside:.1%} of channel {name}'s response lies outside the scene's wavelengths, {grid[0]:g} to "
                f"{grid[-1]:g} nm; the result lacks the light there"
            )
            hint = "Extend the scene's spectra if it emits light there"
            warnings.warn(PhotositeWarning(what, hint=hint), stacklevel=5)
            return


# Distortion and lateral color on a frame: wavelength nodes, warps, and the regions of a distorted image.


def frame_wavelength_nodes(
    mapping: RadialMapping | None, wavelength_nm: Array, shape: tuple[int, int], pitch_m: Pitch
) -> tuple[list[float], Array]:
    """Return a few wavelengths whose images stand for all, and the fraction of each wavelength's light at each of them.

    The images of neighboring nodes are at most a quarter of a pixel apart anywhere in the frame.

    - `mapping`: Distortion of the lens; None is no distortion, and one node.
    - `wavelength_nm`: (wavelengths,) of the light.
    - `shape`, `pitch_m`: (rows, cols) of the frame, and its pixel pitch.

    Returns N wavelengths in nm, and the fractions, (N, wavelengths).
    """
    middle = float(wavelength_nm[wavelength_nm.size // 2])
    if mapping is None:
        return [middle], np.ones((1, wavelength_nm.size))
    corner_m = math.hypot(shape[0] * pitch_m[0], shape[1] * pitch_m[1]) / 2
    known_m = float(mapping.real_m[:, -1].min())
    if corner_m > known_m * (1 + 1e-6):
        what = (
            f"the distortion of the lens is known up to an image height of {known_m * 1e3:.4g} mm, but the frame's "
            f"corner is at {corner_m * 1e3:.4g} mm; a straight line continues it"
        )
        warnings.warn(PhotositeWarning(what, hint="Extend the table to the corner"), stacklevel=2)
    ideal_m = corner_m * float(inverse_scale(mapping, middle, corner_m)[0][-1])
    nodes, fractions = wavelength_nodes(mapping, wavelength_nm, ideal_m, _STEP_PIXELS * min(pitch_m))
    used = fractions.any(axis=1)
    return [float(node) for node in nodes[used]], fractions[used]


def frame_warp(mapping: RadialMapping | None, wavelength_nm: float, reach_m: float, pitch_m: Pitch) -> Warp | None:
    """Return the warp of a wavelength, up to a distance from the axis; None without a mapping."""
    if mapping is None:
        return None
    scale, step_m2 = inverse_scale(mapping, wavelength_nm, reach_m)
    return Warp(scale, step_m2, pitch_m)


def warped_regions(
    mapping: RadialMapping | None, where: Placement, regions: tuple[Region, ...], pitch_m: Pitch
) -> tuple[Region, ...]:
    """Return a scene's regions in pixels: the largest upright rectangles inside their images at all wavelengths."""
    if mapping is None:
        return where.regions(regions)
    curves = [image_height(mapping, w) for w in mapping.wavelength_nm]
    fraction = np.linspace(0.0, 1.0, _POINTS_PER_SIDE)

    def image(row: Array, col: Array) -> tuple[Array, Array]:
        """Return (wavelengths, n) rows and columns in pixels of points in scene samples."""
        y_m = ((row - where.row_start) / where.row_step - where.shape[0] / 2) * pitch_m[0]
        x_m = ((col - where.col_start) / where.col_step - where.shape[1] / 2) * pitch_m[1]
        ideal_m = np.hypot(y_m, x_m)
        on_axis = ideal_m == 0
        factor = np.stack([curve(ideal_m) / np.where(on_axis, 1.0, ideal_m) for curve in curves])
        return (factor * y_m / pitch_m[0] + where.shape[0] / 2, factor * x_m / pitch_m[1] + where.shape[1] / 2)

    found = []
    for region in regions:
        down = region.r0 + fraction * (region.r1 - region.r0)
        across = region.c0 + fraction * (region.c1 - region.c0)
        top = image(np.full(_POINTS_PER_SIDE, region.r0), across)[0].max()
        bottom = image(np.full(_POINTS_PER_SIDE, region.r1), across)[0].min()
        left = image(down, np.full(_POINTS_PER_SIDE, region.c0))[1].max()
        right = image(down, np.full(_POINTS_PER_SIDE, region.c1))[1].min()
        found.append(where.whole_pixels(region.name, (top, bottom), (left, right)))
    return tuple(found)


_ALIKE = 0.05
"""Difference of transfer functions up to which planes count as blurred alike."""
_FREQUENCIES = 33
_DIRECTIONS = 8


def planes_electron_rate(planes: Planes, camera: CameraParts, progress: Progress | None = None) -> NDArray[np.float32]:
    """Return (rows, cols) mean electrons from light per second of a scene in depth; see `Camera.mean_electrons`."""
    sensor = camera.sensor
    for plane in planes.planes:
        warn_of_missing_light(plane.scene, sensor)
    mosaic = np.zeros((sensor.array.rows, sensor.array.cols), np.float32)
    behind: tuple[Plane, ...] = ()
    for group in reversed(_groups(planes.planes, camera)):
        if behind:
            _occlude(mosaic, group, behind, camera)
        covers = [plane.cover(True, *_mean_light(group)) for plane in group]
        for index, plane in enumerate(group):
            ends = bool(behind) or index < len(group) - 1
            mosaic += image_rate(plane.light(ends), camera, covers[:index], progress)
        behind = (*group, *behind)
    scenes = [plane.scene for plane in planes.planes]
    relative_error = max(scene.relative_error + low_rank_error(camera.optics, scene.distance_m) for scene in scenes)
    return finish_mosaic(mosaic, camera, scenes, relative_error)


def _groups(planes: tuple[Plane, ...], camera: CameraParts) -> list[tuple[Plane, ...]]:
    """Group neighboring planes that the lens blurs alike."""
    groups: list[tuple[Plane, ...]] = []
    for plane in planes:
        if groups and _alike(camera, groups[-1][0].scene, plane.scene):
            groups[-1] = (*groups[-1], plane)
        else:
            groups.append((plane,))
    return groups


def _alike(camera: CameraParts, one: Scene, other: Scene) -> bool:
    """Return whether the transfer functions of two scenes differ by at most `_ALIKE` below the Nyquist frequency."""
    if one.distance_m == other.distance_m:
        return True
    spreads = [camera.optics.point_spread(scene.distance_m) for scene in (one, other)]
    frequency = np.linspace(0.0, 0.5 / min(pitch_m(camera.sensor)), _FREQUENCIES)
    wavelengths = one.wavelength_nm[[0, one.wavelength_nm.size // 2, -1]]
    a, b = (_samples(spread, frequency, wavelengths) for spread in spreads)
    return a.shape == b.shape and bool(np.abs(a - b).max() <= _ALIKE)


def _samples(
    spread: PointSpread, frequency_per_m: NDArray[np.float64], wavelength_nm: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return samples of a spread's transfer function; for a `FieldPsf`, at every field node."""
    if isinstance(spread, RadialPsf):
        return np.concatenate([spread.otf(frequency_per_m, float(w)) for w in wavelength_nm]).astype(np.complex128)
    if isinstance(spread, FieldPsf):
        modes = np.stack([_samples(mode, frequency_per_m, wavelength_nm) for mode in spread.modes])
        at_nodes: NDArray[np.complex128] = np.tensordot(spread.weights, modes, axes=(0, 0)).ravel()
        return at_nodes
    angle = np.arange(_DIRECTIONS)[:, None] * (np.pi / _DIRECTIONS)
    fy, fx = frequency_per_m * np.sin(angle), frequency_per_m * np.cos(angle)
    return np.concatenate([spread.otf(fy, fx, float(w)).ravel() for w in wavelength_nm])


def _occlude(
    mosaic: NDArray[np.float32], group: tuple[Plane, ...], behind: tuple[Plane, ...], camera: CameraParts
) -> None:
    """Attenuate the image of what is behind a group of planes by the group's opacity, in place."""
    spectrum, grid = _mean_light(behind)
    covers = [plane.cover(True, spectrum, grid) for plane in group]
    hidden = np.zeros_like(mosaic)
    for index, cover in enumerate(covers):
        opaque = image_rate(cover, camera, covers[:index])
        # The image of opacity 1: the quotient cancels relative illumination and the channel's response.
        full = image_rate(Scene.uniform(spectrum, grid, cover.distance_m), camera)
        # 0 for a channel that receives none of the light behind.
        hidden += np.divide(opaque, full, out=np.zeros_like(full), where=full > 0)
    # Rounding of the transforms may make it exceed 1.
    mosaic *= np.maximum(np.float32(1) - hidden, np.float32(0))


def _mean_light(planes: tuple[Plane, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the sum of the planes' mean radiances, and its wavelengths."""
    grid = np.unique(np.concatenate([plane.scene.wavelength_nm for plane in planes]))
    total = np.zeros(grid.size)
    for plane in planes:
        total += np.interp(grid, plane.scene.wavelength_nm, plane.mean_radiance(), left=0.0, right=0.0)
    return np.maximum(total, 0.0), grid
