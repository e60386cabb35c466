"""A ColorChecker: positions and colors of its patches, and its detection in a frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from photosite.errors import InputError, did_you_mean
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.scene.charts import macbeth
from photosite.scene.placement import Homography, field_corners, seen_patches
from photosite.values.cfa import channel_sites
from photosite.values.choice import check_choice
from photosite.values.region import Corners, Region

Chart = Literal["macbeth"]

_LONG_SIDE = 480  # pixels on the longer side of the reduced picture that is searched
_EVEN_FRACTIONS = (
    0.75,
    0.65,
    0.55,
    0.45,
    0.35,
)  # fractions of the picture, by evenness, tried as the inside of patches
_PARALLELOGRAM = (0.88, 1.06)  # area over 12 times the root of the determinant of the second moments: ideally 1
_MOST_ELONGATED = 3.0
_SMALLEST = 30  # pixels of the smallest patch in the reduced picture
_ALIKE = 2.2  # largest ratio of areas of two patches, in perspective and with damaged borders
_MISS = 0.3  # largest deviation from the position predicted by neighbors, in distances between patches
_FEWEST = 17  # patches needed of the 24; dark patches on a black border may not be found
_CORRELATION = 0.5  # smallest correlation of the patches' brightness with that of a ColorChecker

_ROWS, _COLS = 4, 6
_EXAMPLE_CORNERS = ((412, 388), (420, 3391), (2201, 3377), (2188, 405))
_PASS_CORNERS: Any = {"hint": "Pass {corners}", "arguments": {"corners": _EXAMPLE_CORNERS}}


def chart_regions(chart: str, rows: int, cols: int) -> tuple[Region, ...]:
    """Return the patches of a chart that fills the frame; `InputError` if it is unknown or the frame too small.

    Examples
    --------
    >>> len(chart_regions("macbeth", 300, 450))
    24
    """
    from photosite.scene.charts import macbeth_regions

    check_choice("chart", chart, Chart)
    return macbeth_regions(rows, cols)


def chart_xyz_d65(chart: str, names: Sequence[str]) -> NDArray[np.float64]:
    """Return tristimulus values of some of a chart's patches under D65, with Y = 1 for the perfect white.

    Returns
    -------
    numpy.ndarray
        (patches, 3), CIE 1931 observer, from the reflectance spectra at 5 nm, trapezoidal rule.

    Raises
    ------
    InputError
        If the chart or a patch is unknown.

    Examples
    --------
    >>> chart_xyz_d65("macbeth", ["white", "neutral 5"])[:, 1].round(3)
    array([0.887, 0.203])
    """
    from photosite.color.colorimetry import xyz
    from photosite.color.illuminants import illuminant
    from photosite.color.spectrum import photons_from_energy
    from photosite.scene.charts import MACBETH_NAMES, macbeth_reflectance

    check_choice("chart", chart, Chart)
    if unknown := [name for name in names if name not in MACBETH_NAMES]:
        where, hint = f"chart '{chart}'", did_you_mean(unknown[0], MACBETH_NAMES)
        raise InputError("names", where=where, value=unknown[0], expected="names of its patches", hint=hint)
    grid = np.arange(380.0, 781.0, 5.0)
    light = photons_from_energy(illuminant("D65", grid), grid)
    chosen = macbeth_reflectance(grid)[[MACBETH_NAMES.index(name) for name in names]]
    return np.asarray(xyz(chosen * light, grid) / xyz(light, grid)[1])


# Detection of a ColorChecker in a raw frame: 24 even patches in four rows of six.


@dataclass(frozen=True, eq=False)
class _Blobs:
    """Even parts of the picture: (n, 2) centers and (n,) areas, in pixels."""

    middle: NDArray[np.float64]
    area: NDArray[np.float64]


def find_chart(frame: RawFrame) -> Corners:
    """Find the corners of a ColorChecker's field of patches in a raw frame.

    The detector looks for even parallelograms of similar size on a grid of four by six. The orientation follows from
    their brightness. The frame must show one chart, in focus and not mirrored, tilted by less than about 40 degrees,
    with borders between its patches, over at least a third of the longer side. Check the outline in the report; corners
    set by hand are more reliable.

    Returns
    -------
    tuple
        Four (row, col): the outer corners of the dark skin, bluish green, black and white patches.

    Raises
    ------
    InputError
        If no such chart is found, or its brightness is not that of a ColorChecker.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=64)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> found = find_chart(camera.capture(ps.charts.macbeth(), 1 / 3))
    >>> bool(np.abs(np.array(found) - [(8, 8), (8, 384), (256, 384), (256, 8)]).max() < 2)
    True
    """
    picture, scale = _picture(frame)
    best: dict[tuple[int, int], int] = {}
    middles: NDArray[np.float64] = np.empty((0, 2))
    steepness = np.max([ndimage.gaussian_gradient_magnitude(plane, 1.0) for plane in picture], axis=0)
    for fraction in _EVEN_FRACTIONS:
        blobs = _blobs(steepness < np.quantile(steepness, fraction))
        for found in _grids(blobs):
            if len(found) > len(best):
                best, middles = found, blobs.middle
            if len(best) == _ROWS * _COLS:
                return _oriented(frame, best, middles * scale)
    if len(best) < _FEWEST:
        what = f"no ColorChecker found: {len(best)} of its 24 patches were found and {_FEWEST} are needed"
        raise InputError(what, **_PASS_CORNERS)
    return _oriented(frame, best, middles * scale)


def _picture(frame: RawFrame) -> tuple[NDArray[np.float64], float]:
    """Return the reduced picture, (channels, rows, cols) square roots of signals, and its reduction factor."""
    tile = (len(frame.cfa), len(frame.cfa[0]))
    rows, cols = frame.shape[0] // tile[0], frame.shape[1] // tile[1]
    if tile[0] != tile[1] or min(rows, cols) < 1:
        raise InputError("cfa", value=tile, expected="a square tile for chart detection", **_PASS_CORNERS)
    factor = max(1, round(max(rows, cols) / _LONG_SIDE))
    planes = []
    for channel in frame.channels:
        sites = [frame.dn[r :: tile[0], c :: tile[1]][:rows, :cols] for r, c in channel_sites(frame.cfa, channel)]
        signal = np.mean(sites, axis=0) - frame.black_level_dn
        small = signal[: rows // factor * factor, : cols // factor * factor]
        planes.append(small.reshape(rows // factor, factor, cols // factor, factor).mean(axis=(1, 3)))
    # The square root makes shot noise uniform. Values below black are noise only.
    return np.sqrt(np.maximum(np.stack(planes), 0.0)), float(factor * tile[0])


def _blobs(even: NDArray[np.bool_]) -> _Blobs:
    """Return the even parts that may be patches."""
    labels, count = ndimage.label(even)
    middle, area = [], []
    for label, where in enumerate(ndimage.find_objects(labels, count), start=1):
        row, col = np.nonzero(labels[where] == label)
        if row.size < _SMALLEST or row.size > even.size / (_ROWS * _COLS):
            continue
        spread = np.cov(row, col, bias=True) + np.eye(2) / 12.0
        low, high = np.linalg.eigvalsh(spread)
        fullness = row.size / (12.0 * np.sqrt(low * high))
        if _PARALLELOGRAM[0] < fullness < _PARALLELOGRAM[1] and high < _MOST_ELONGATED**2 * low:
            middle.append((where[0].start + row.mean() + 0.5, where[1].start + col.mean() + 0.5))
            area.append(float(row.size))
    return _Blobs(np.asarray(middle, dtype=np.float64).reshape(-1, 2), np.asarray(area))


def _grids(blobs: _Blobs) -> Iterator[dict[tuple[int, int], int]]:
    """Yield four-by-six windows of grids of similar blobs: which blob is at which place."""
    for first in range(len(blobs.area)):
        ratio = blobs.area / blobs.area[first]
        alike = np.flatnonzero((ratio < _ALIKE) & (ratio > 1 / _ALIKE))
        if alike.size < _FEWEST:
            continue
        away = blobs.middle[alike] - blobs.middle[first]
        near = alike[np.argsort(np.hypot(*away.T))[1:7]]
        for one in near:
            for other in near:
                along, down = blobs.middle[one] - blobs.middle[first], blobs.middle[other] - blobs.middle[first]
                length, height = np.hypot(*along), np.hypot(*down)
                # (row, col): clockwise from along to down, and not too slanted.
                turn = (down[0] * along[1] - down[1] * along[0]) / (length * height)
                if turn > 0.6 and 0.5 < length / height < 2.0:
                    yield _window(_grown(blobs, alike, first, along, down))


def _grown(
    blobs: _Blobs, alike: NDArray[np.intp], first: int, along: NDArray[np.float64], down: NDArray[np.float64]
) -> dict[tuple[int, int], int]:
    """Grow a grid from one blob to its neighbors: which blob is at which place."""
    places = {(0, 0): first}
    steps = {(0, 0): (down, along)}
    queue = [(0, 0)]
    taken = {first}
    while queue:
        place = queue.pop(0)
        here = blobs.middle[places[place]]
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            there = (place[0] + sign * (axis == 0), place[1] + sign * (axis == 1))
            step = steps[place][axis]
            if there in places or max(map(abs, there)) >= _COLS:
                continue
            away = np.hypot(*(blobs.middle[alike] - here - sign * step).T)
            nearest = int(alike[np.argmin(away)])
            if nearest in taken or away.min() > _MISS * np.hypot(*step):
                continue
            places[there] = nearest
            taken.add(nearest)
            # Perspective changes the step slowly, so the last step predicts the next.
            new = list(steps[place])
            new[axis] = sign * (blobs.middle[nearest] - here)
            steps[there] = (new[0], new[1])
            queue.append(there)
    return places


def _window(places: dict[tuple[int, int], int]) -> dict[tuple[int, int], int]:
    """Return the four-by-six window with most blobs, in either orientation of the grid."""
    best: dict[tuple[int, int], int] = {}
    turned = {(col, -row): blob for (row, col), blob in places.items()}
    for grid in (places, turned):
        rows, cols = {r for r, _ in grid}, {c for _, c in grid}
        for r0 in range(min(rows) - _ROWS + 1, max(rows) + 1):
            for c0 in range(min(cols) - _COLS + 1, max(cols) + 1):
                shifted = {(r - r0, c - c0): blob for (r, c), blob in grid.items()}
                inside = {(r, c): blob for (r, c), blob in shifted.items() if 0 <= r < _ROWS and 0 <= c < _COLS}
                if len(inside) > len(best):
                    best = inside
    return best


def _oriented(frame: RawFrame, places: dict[tuple[int, int], int], middle_px: NDArray[np.float64]) -> Corners:
    """Return the corners, with the orientation that matches the patches' brightness."""
    chart = macbeth()
    centers = np.array([((p.r0 + p.r1) / 2, (p.c0 + p.c1) / 2) for p in chart.regions])
    field = np.array(field_corners(chart))
    wanted = chart_xyz_d65("macbeth", [region.name for region in chart.regions])[:, 1]
    seen = np.array([middle_px[blob] for blob in places.values()])
    found: list[tuple[float, Corners]] = []
    for turned in (False, True):
        at = [centers[(_ROWS - 1 - r) * _COLS + _COLS - 1 - c] if turned else centers[r * _COLS + c] for r, c in places]
        a, b, c, d = ((float(row), float(col)) for row, col in Homography.between(at, seen)(field))
        corners = (a, b, c, d)
        brightness = patch_statistics(frame, seen_patches(chart, corners, 0.5)).mean_dn.mean(axis=1)
        found.append((float(np.corrcoef(brightness, wanted)[0, 1]), corners))
    correlation, corners = max(found)
    if not correlation > _CORRELATION:
        what = f"the brightness of the grid found is not that of a ColorChecker (correlation {correlation:.2f})"
        raise InputError(what, **_PASS_CORNERS)
    return corners
