"""Demosaicing: from a mosaic to one plane per channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import colour_science
from photosite.engine.threads import parallel_for
from photosite.errors import InputError
from photosite.values.cfa import Cfa, plane_names, tile_name, tile_text
from photosite.values.choice import check_choice

Demosaic = Literal["bilinear", "malvar", "menon"]
"""Ways to demosaic; the first serves every tile, the others Bayer mosaics."""

Tap = tuple[int, int, int]
"""Rows and columns away, and weight."""

Taps = dict[tuple[int, int, int], list[Tap]]
"""By row and column of the tile, and channel."""

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_TILES = 1 << 17
"""Tiles that are interpolated at a time; their sums fit the cache of a core."""

BAYER = ("rggb", "bggr", "grbg", "gbrg")


def demosaic(mosaic: ArrayLike, cfa: Cfa, method: Demosaic = "bilinear") -> NDArray[np.float32]:
    """Interpolate every channel of a mosaic to every pixel.

    Parameters
    ----------
    mosaic
        (rows, cols), any real numbers.
    cfa
        Tile of the color filter array.
    method
        "bilinear", see `demosaic_bilinear`. For Bayer mosaics also "malvar", linear filters that add the other
        channels' second differences, and "menon", which interpolates along edges. These two need the extra `demosaic`.

    Returns
    -------
    numpy.ndarray
        (rows, cols, channels) float32, planes in the order of `plane_names(cfa)`.

    Raises
    ------
    InputError
        If the mosaic is not two-dimensional or too small, the method is unknown, does not serve the tile, or its
        package is not installed.

    References
    ----------
    H. S. Malvar, L.-W. He and R. Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color
    images", ICASSP 2004. D. Menon, S. Andriani and G. Calvagno, "Demosaicing with directional filtering and a
    posteriori decision", IEEE Transactions on Image Processing 16(1), 2007. Both by the package colour-demosaicing.

    Examples
    --------
    >>> planes = demosaic([[1, 2, 1], [4, 8, 4], [1, 2, 1]], (("R", "G"), ("G", "B")))
    >>> planes[1, 1], planes[0, 1]
    (array([1., 3., 8.], dtype=float32), array([1., 2., 8.], dtype=float32))
    """
    check_choice("demosaic", method, Demosaic)
    if method == "bilinear":
        return demosaic_bilinear(mosaic, cfa)
    if tile_name(cfa) not in BAYER:
        expected = f"{', '.join(BAYER)} for the method '{method}'"
        raise InputError("cfa", value=tile_text(cfa), expected=expected, hint="Use the method 'bilinear'")
    values = _checked(mosaic)
    library = _colour_demosaicing()
    kernels = {"malvar": library.demosaicing_CFA_Bayer_Malvar2004, "menon": library.demosaicing_CFA_Bayer_Menon2007}
    return np.asarray(kernels[method](values, tile_name(cfa).upper()), dtype=np.float32)


def demosaic_bilinear(mosaic: ArrayLike, cfa: Cfa, half_width: int | None = None) -> NDArray[np.float32]:
    """Interpolate every channel linearly to every pixel, by normalized convolution.

    A pixel keeps its channel's value. For another channel it gets the weighted mean of that channel's pixels, with the
    weight (h - rows away) (w - columns away), where h and w are the periods of the channel's pixels. In a Bayer mosaic
    this is the bilinear kernel: 2 for direct neighbors and 1 for diagonal ones.

    The weights of every site of the tile then add up to 1 and reproduce linear functions, so that a channel that is
    linear in row and column stays linear, whatever the tile. At the borders the mean is over the pixels that exist: a
    constant stays constant.

    Parameters
    ----------
    mosaic
        (rows, cols), any real numbers.
    cfa
        Tile of the color filter array.
    half_width
        Used in place of h and w. With a smaller one more detail remains, and linear functions bend.

    Returns
    -------
    numpy.ndarray
        (rows, cols, channels) float32, planes in the order of `plane_names(cfa)`.

    Raises
    ------
    InputError
        If the mosaic is not two-dimensional, a channel has no pixel within reach, or the half width is below 1.

    References
    ----------
    H. Knutsson and C.-F. Westin, "Normalized and differential convolution", CVPR 1993.

    Examples
    --------
    >>> from photosite.values.cfa import cfa_from
    >>> ramp = np.add.outer(3.0 * np.arange(24), 2.0 * np.arange(24))
    >>> planes = demosaic_bilinear(ramp, cfa_from("x-trans"))
    >>> bool(np.allclose(planes[6:-6, 6:-6], ramp[6:-6, 6:-6, None], rtol=1e-5))
    True
    """
    values = _checked(mosaic)
    if half_width is not None and half_width < 1:
        raise InputError("half_width", value=half_width, expected="1 or more")
    names = plane_names(cfa)
    taps = _taps(cfa, names, half_width)
    planes = np.empty((*values.shape, len(names)), dtype=np.float32)
    height, width = len(cfa), len(cfa[0])
    step = height * max(1, _TILES * width // values.shape[1])

    def interpolate(begin: int, end: int) -> None:
        for first in range(begin * step, end * step, step):
            block = _Block(values, cfa, slice(first, first + step), taps)
            for (r, c, k), site in taps.items():
                mean = block.mean(r, c, site)
                if mean is None:
                    expected = f"one whose channels all have pixels near every pixel of a {values.shape} mosaic"
                    raise InputError("cfa", where="bilinear demosaic", value=tile_text(cfa), expected=expected)
                planes[first + r : first + step : height, c::width, k] = mean

    parallel_for(interpolate, -(-len(values) // step))
    return planes


def _taps(cfa: Cfa, names: Sequence[str], half_width: int | None) -> Taps:
    """Return the pixels that each channel at each site of the tile is a mean of."""
    rows, cols = len(cfa), len(cfa[0])
    taps: Taps = {}
    for r, c, k in np.ndindex(rows, cols, len(names)):
        h, w = (half_width or period for period in _periods(cfa, names[k]))
        if cfa[r][c] == names[k]:
            h = w = 1
        taps[r, c, k] = [
            (dr, dc, (h - abs(dr)) * (w - abs(dc)))
            for dr in range(1 - h, h)
            for dc in range(1 - w, w)
            if cfa[(r + dr) % rows][(c + dc) % cols] == names[k]
        ]
    return taps


class _Block:
    """Rows of a mosaic, in double precision, with zeros around the mosaic; each site of the tile is contiguous."""

    def __init__(self, values: F32, cfa: Cfa, rows: slice, taps: Taps) -> None:
        self._shape, self._tile = values.shape, (len(cfa), len(cfa[0]))
        self._rows = np.arange(len(values))[rows]
        height, width = self._tile
        reach = max(max(abs(dr), abs(dc)) for site in taps.values() for dr, dc, _ in site)
        self._margin = top, left = -(-reach // height), -(-reach // width)
        """Tiles of zeros, or of other rows, on each side."""
        tall, wide = -(-self._rows.size // height) + 2 * top, -(-values.shape[1] // width) + 2 * left
        padded = np.zeros((tall * height, wide * width), np.float32)
        first = self._rows[0] - top * height
        low, high = max(0, first), min(len(values), first + len(padded))
        padded[low - first : high - first, left * width : left * width + values.shape[1]] = values[low:high]
        sites = padded.reshape(tall, height, wide, width).transpose(1, 3, 0, 2)
        self._sites = np.ascontiguousarray(sites, dtype=np.float64)

    def mean(self, r: int, c: int, taps: Sequence[Tap]) -> F64 | None:
        """Return the weighted means at a site of the tile over the taps inside the mosaic; None if one has no tap."""
        height, width = self._tile
        rows, cols = self._rows[r::height], np.arange(c, self._shape[1], width)
        total = np.zeros((rows.size, cols.size))
        scaled = np.empty_like(total)
        for dr, dc, share in taps:
            down, along = (r + dr) // height + self._margin[0], (c + dc) // width + self._margin[1]
            plane = self._sites[(r + dr) % height, (c + dc) % width]
            seen = plane[down : down + rows.size, along : along + cols.size]
            total += seen if share == 1 else np.multiply(seen, share, out=scaled)
        weight = self._weight(taps, rows, cols)
        return np.divide(total, weight, out=total) if (weight > 0).all() else None

    def _weight(self, taps: Sequence[Tap], rows: I64, cols: I64) -> F64:
        """Return the sum of the weights inside the mosaic: (rows, cols), or (1, cols) where all rows have the same."""
        offsets = sorted({dr for dr, _, _ in taps})
        inside = np.array([(rows + dr >= 0) & (rows + dr < self._shape[0]) for dr in offsets], np.float64).T
        shares = np.zeros((len(offsets), cols.size))
        for dr, dc, share in taps:
            shares[offsets.index(dr)] += share * ((cols + dc >= 0) & (cols + dc < self._shape[1]))
        return (inside[:1] if inside.all() else inside) @ shares


def _checked(mosaic: ArrayLike) -> NDArray[np.float32]:
    values = np.asarray(mosaic, dtype=np.float32)
    if values.ndim != 2:
        raise InputError("mosaic", value=values.shape, expected="of shape (rows, cols)")
    return values


def _periods(cfa: Cfa, name: str) -> tuple[int, int]:
    """Return the smallest shifts along rows and columns that map a channel's pixels onto themselves."""
    own = np.array([[channel == name for channel in row] for row in cfa])
    rows, cols = (
        next(shift for shift in range(1, size + 1) if (np.roll(own, shift, axis) == own).all())
        for axis, size in enumerate(own.shape)
    )
    return rows, cols


def _colour_demosaicing() -> Any:
    """Return the package `colour_demosaicing`; importing it leaves NumPy's print options as they are."""
    colour_science()
    options = np.get_printoptions()
    try:
        import colour_demosaicing
    except ImportError:
        hint = "Run pip install '.[demosaic]' in the clone"
        raise InputError("the methods 'malvar' and 'menon' need the extra 'demosaic'", hint=hint) from None
    finally:
        np.set_printoptions(**options)
    return colour_demosaicing
