"""Demosaicing: from a mosaic to one plane per channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import colour_science
from photosite.engine.jit import F32, I64, compiled, read_only
from photosite.errors import InputError
from photosite.values.cfa import Cfa, plane_names, tile_name, tile_text
from photosite.values.validated import check_choice

Demosaic = Literal["bilinear", "malvar", "menon"]
"""Ways to demosaic; the first serves every tile, the others Bayer mosaics."""

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
    planes = np.empty((*values.shape, len(names)), dtype=np.float32)
    if not _convolve(read_only(values), *_taps(cfa, names, half_width), planes):
        expected = f"one whose channels all have pixels near every pixel of a {values.shape} mosaic"
        raise InputError("cfa", where="bilinear demosaic", value=tile_text(cfa), expected=expected)
    return planes


def _taps(cfa: Cfa, names: Sequence[str], half_width: int | None) -> tuple[I64, I64]:
    """Return the pixels that the channels at each site of the tile are a mean of.

    - (tile rows, tile cols, channels + 1): where the taps of each channel begin, and where those of the last end.
    - (taps, 3): rows and columns away, and weight.
    """
    rows, cols = len(cfa), len(cfa[0])
    first = np.zeros((rows, cols, len(names) + 1), np.int64)
    taps: list[tuple[int, int, int]] = []
    for r, c in np.ndindex(rows, cols):
        first[r, c, 0] = len(taps)
        for k, name in enumerate(names):
            h, w = (half_width or period for period in _periods(cfa, name))
            if cfa[r][c] == name:
                h = w = 1
            for dr, dc in ((dr, dc) for dr in range(1 - h, h) for dc in range(1 - w, w)):
                if cfa[(r + dr) % rows][(c + dc) % cols] == name:
                    taps.append((dr, dc, (h - abs(dr)) * (w - abs(dc))))
            first[r, c, k + 1] = len(taps)
    return first, np.array(taps, np.int64).reshape(-1, 3)


@compiled()
def _convolve(values: F32, first: I64, taps: I64, out: F32) -> bool:
    """Set `out` to the weighted means over the taps inside the frame; return whether every pixel had a tap."""
    rows, cols, channels = out.shape
    reach = taps[:, :2].max()
    complete = True
    for r in range(rows):
        for c in range(cols):
            inside = reach <= r < rows - reach and reach <= c < cols - reach
            site = first[r % first.shape[0], c % first.shape[1]]
            for k in range(channels):
                total = weight = 0.0
                for i in range(site[k], site[k + 1]):
                    row, col, share = r + taps[i, 0], c + taps[i, 1], taps[i, 2]
                    if inside or (0 <= row < rows and 0 <= col < cols):
                        total += share * values[row, col]
                        weight += share
                complete &= weight > 0.0
                out[r, c, k] = total / weight
    return complete


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
