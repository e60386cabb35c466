"""Developing a raw frame into a display picture, and writing it as PNG or JPEG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import D65_WHITE_XYZ, SRGB_FROM_XYZ, adaptation_to_d65, encode_srgb
from photosite.develop.camera_color import ColorMatrix, gray_world_gains, saturated_neighbourhood
from photosite.engine.threads import parallel_for
from photosite.errors import InputError, did_you_mean
from photosite.files.writing import atomic_path
from photosite.frames.companding import decompanded
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import plane_names

if TYPE_CHECKING:
    from photosite.develop.demosaic import Demosaic

T = TypeVar("T", bound=np.generic)

WHITE_BALANCES = ("as-shot", "gray-world", "none")

AUTO_EXPOSURE_PERCENTILE = 99.5
"""Automatic exposure maps this percentile of the brightest primary of each pixel to display white."""

_SAMPLE = 100_000
"""Values in the sample of a picture that bounds its percentile."""

_BLOCK_ROWS = 256
"""Rows processed at a time, to limit memory."""

BITS = (8, 16)

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")

_LARGE_PNG = 1 << 21
"""Numbers in a picture from which it is compressed in several threads."""


def develop(
    raw: RawFrame,
    white_balance: str | Sequence[float] = "as-shot",
    color_matrix: ColorMatrix | ArrayLike | None = None,
    exposure: float | str = "auto",
    *,
    demosaic: Demosaic = "bilinear",
) -> NDArray[np.float32]:
    """Develop a raw frame into a display picture.

    Steps: undo the companding that the frame states, scale black level to 0 and white level to 1, demosaic, white
    balance, color matrix to linear sRGB, exposure, sRGB encoding. A monochrome frame becomes gray, without the steps
    for color. So does a frame with other channels than R, G and B and without a matrix, such as one with polarizers:
    its balanced channels are averaged. Stacked channels need no demosaic; the picture has a column for each pixel.

    Parameters
    ----------
    raw
        The frame, with any color filter array.
    white_balance
        "as-shot": the light's own white, `raw.as_shot_neutral`, so that gray surfaces are gray, as in other raw
        developers; gray world for frames that do not state it. "gray-world": scale the means of all channels to that of
        green, without saturated pixels and their neighbors. "none": unbalanced. Or a gain for each channel, in the
        order of `plane_names(raw.cfa)`: red, green and blue. With a white balance, equal balanced values become
        neutral, whatever the matrix. Saturated pixels are limited to the level at which the first channel saturates,
        so that they are not tinted.
    color_matrix
        (3, channels), camera channels to XYZ under D65, or the result of `fit_color_matrix`; its scale is free.
        Default: the inverse of `raw.color_matrix`. Without that, camera RGB is taken as linear sRGB: a recognizable
        picture with wrong colors.
    exposure
        "auto": the 99.5th percentile over pixels of the brightest primary becomes display white. Or a factor; with 1 a
        neutral surface at the sensor's white level becomes display white.
    demosaic
        "bilinear" for every tile; "malvar" and "menon" for Bayer mosaics (`photosite.develop.demosaic.demosaic`).

    Returns
    -------
    numpy.ndarray
        (rows, cols, 3) float32, display sRGB, clipped to 0..1.

    Raises
    ------
    InputError
        If an argument or the frame's white is invalid, the matrix has no inverse or needs negative camera values for
        white, or "auto" finds no light.

    Notes
    -----
    White balance and matrix are combined as in the DNG specification 1.7, chapter 6: the matrix has a neutral, the
    camera RGB that it maps to the white of D65, and balanced values are in units of that neutral. With other channels
    than R, G and B the matrix comes first: it takes infrared light away from red, green and blue, and separates
    channels that overlap. The white of the light is then adapted to D65 by the Bradford transform.

    Examples
    --------
    >>> dn = np.tile(np.array([[800, 1600], [1600, 400]], np.uint16), (4, 4))
    >>> raw = RawFrame(dn, bits=12, cfa=(("R", "G"), ("G", "B")))
    >>> picture = develop(raw)
    >>> picture.shape, float(picture.min()), float(picture.max())
    ((8, 8, 3), 1.0, 1.0)
    """
    linear = _linear_srgb(raw, white_balance, color_matrix, exposure, demosaic)
    blocks = _blocks(linear)

    def encode(first: int, last: int) -> None:
        for block in blocks[first:last]:
            block[...] = encode_srgb(block)

    parallel_for(encode, len(blocks))
    return linear


def develop_rgba(raw: RawFrame, exposure: float | str = "auto") -> NDArray[np.uint8]:
    """Develop a raw frame with the defaults of `develop`, as bytes for a screen.

    Returns
    -------
    numpy.ndarray
        (rows, cols, 4) uint8: red, green and blue, 255 times those of `develop` rounded, and 255.

    Examples
    --------
    >>> raw = RawFrame(np.array([[0, 1024], [2048, 4095]], np.uint16), bits=12)
    >>> develop_rgba(raw, 1.0)[..., 0]
    array([[  0, 137],
           [188, 255]], dtype=uint8)
    >>> (develop(raw, exposure=1.0)[..., 0] * 255).round()
    array([[  0., 137.],
           [188., 255.]], dtype=float32)
    """
    from photosite.develop.display_codes import encoded_rgba

    return encoded_rgba(_linear_srgb(raw, "as-shot", None, exposure, "bilinear"))


def _linear_srgb(
    raw: RawFrame,
    white_balance: str | Sequence[float],
    color_matrix: ColorMatrix | ArrayLike | None,
    exposure: float | str,
    demosaic: Demosaic,
) -> NDArray[np.float32]:
    """Return the developed picture before its encoding for the display."""
    _check_exposure(exposure)
    raw = decompanded(raw)
    planes = _normalised_planes(raw, demosaic)
    if planes.shape[2] == 1:
        if not isinstance(white_balance, str):
            hint, arguments = "Omit {white_balance}", {"white_balance": white_balance}
            raise InputError("a monochrome frame has no white balance", hint=hint, arguments=arguments)
        if color_matrix is not None:
            raise InputError("a monochrome frame has no color matrix", hint="Omit color_matrix")
        _check_white_balance(white_balance)
        linear = np.repeat(planes, 3, axis=2)
    else:
        to_xyz = _camera_to_xyz(raw, color_matrix)
        light = None if white_balance == "none" else _white_of_light(planes, raw, white_balance)
        to_srgb = _to_srgb(to_xyz, plane_names(raw.cfa), light).T.astype(np.float32)
        linear = planes if planes.shape[2] == 3 else np.empty((*planes.shape[:2], 3), np.float32)
        for block, seen in zip(_blocks(linear), _blocks(planes), strict=True):
            block[...] = seen @ to_srgb
    scale = np.float32(_auto_exposure(linear) if exposure == "auto" else exposure)
    linear *= scale
    return linear


def develop_pair(
    first: RawFrame, second: RawFrame, color_matrix: ColorMatrix | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Develop two frames with the same color matrix and exposure, so that only the frames cause differences.

    Parameters
    ----------
    first, second
        Two frames of one scene, each with its own black and white level.
    color_matrix
        Camera RGB to XYZ under D65, fitted to the light of the scene, because there is no other white balance.
        Default: the matrix of the frames.

    Returns
    -------
    tuple of numpy.ndarray
        (rows, cols, 3) float32 each, display sRGB. White is the neutral that saturates the first channel.

    Examples
    --------
    >>> frame = RawFrame(np.full((4, 4), 255, np.uint16), bits=8)
    >>> one, other = develop_pair(frame, frame)
    >>> one.shape, float(one.min()), bool((one == other).all())
    ((4, 4, 3), 1.0, True)
    """
    return develop(first, "none", color_matrix, 1.0), develop(second, "none", color_matrix, 1.0)


def _blocks(picture: NDArray[T]) -> list[NDArray[T]]:
    """Return views of `_BLOCK_ROWS` rows each."""
    return [picture[r : r + _BLOCK_ROWS] for r in range(0, picture.shape[0], _BLOCK_ROWS)]


def _check_exposure(exposure: float | str) -> None:
    if exposure == "auto":
        return
    if isinstance(exposure, str) or not (math.isfinite(exposure) and exposure > 0):
        raise InputError("exposure", value=exposure, expected="'auto' or a factor above 0")


def _check_white_balance(name: str) -> str:
    if name not in WHITE_BALANCES:
        hint = did_you_mean(name, WHITE_BALANCES)
        expected = "'as-shot', 'gray-world', 'none' or a gain for each channel"
        raise InputError("white_balance", value=name, expected=expected, hint=hint)
    return name


def _normalised_planes(raw: RawFrame, demosaic: Demosaic) -> NDArray[np.float32]:
    """Return the channels at every pixel, black level at 0 and white level at 1."""
    if raw.is_stacked:
        layers = raw.layers()
        return np.concatenate([_normalised_planes(layers[name], demosaic) for name in plane_names(raw.cfa)], axis=2)
    signal = raw.dn.astype(np.float32)
    signal -= np.float32(raw.black_level_dn)
    signal /= np.float32(raw.white_level_dn - raw.black_level_dn)
    from photosite.develop.demosaic import demosaic as demosaic_planes

    return demosaic_planes(signal, raw.cfa, demosaic)


def _white_of_light(
    planes: NDArray[np.float32], raw: RawFrame, white_balance: str | Sequence[float]
) -> NDArray[np.float64]:
    """Return the signal of a gray surface, the largest 1, after limiting saturated pixels in place to its color."""
    saturated = saturated_neighbourhood(raw)
    if raw.is_stacked:
        saturated = np.logical_or.reduce(saturated.reshape(planes.shape), axis=2)
    names = plane_names(raw.cfa)
    if not isinstance(white_balance, str):
        gains = np.asarray(white_balance, dtype=np.float64)
        if gains.shape != (len(names),) or not (np.isfinite(gains).all() and (gains > 0).all()):
            expected = f"{len(names)} numbers above 0, for {', '.join(names)}"
            raise InputError("white_balance", value=white_balance, expected=expected)
        white = 1.0 / gains
    elif _check_white_balance(white_balance) == "as-shot" and (neutral := raw.as_shot_neutral) is not None:
        white = np.array(neutral)
    else:
        white = 1.0 / gray_world_gains(planes, saturated, names.index("G") if "G" in names else 0)
    white /= white.max()
    if saturated.any():
        # If a channel is clipped, its ratio to the others does not follow the light's color.
        planes[saturated] = np.minimum(planes[saturated], white.astype(np.float32))
    return white


def _camera_to_xyz(raw: RawFrame, color_matrix: ColorMatrix | ArrayLike | None) -> NDArray[np.float64] | None:
    """Return (3, channels), camera channels to XYZ in the order of the planes, or None if it is unknown."""
    names = plane_names(raw.cfa)
    if color_matrix is None:
        if raw.color_matrix is None:
            return None
        from_xyz = np.asarray(raw.color_matrix, dtype=np.float64)
        if from_xyz.shape != (len(names), 3):
            expected = f"of shape ({len(names)}, 3)"
            raise InputError("color_matrix", where="raw frame", value=from_xyz.shape, expected=expected)
        return _inverse(from_xyz[[raw.channels.index(name) for name in names]])
    matrix = color_matrix.matrix if isinstance(color_matrix, ColorMatrix) else color_matrix
    to_xyz = np.asarray(matrix, dtype=np.float64)
    if to_xyz.shape != (3, len(names)):
        raise InputError("color_matrix", value=to_xyz.shape, expected=f"of shape (3, {len(names)})")
    _inverse(to_xyz)
    return to_xyz


def _inverse(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse, for more than three channels the pseudoinverse."""
    if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < 3:
        raise InputError("color_matrix", value=matrix.tolist(), expected="a matrix of rank 3")
    return np.asarray(np.linalg.pinv(matrix), dtype=np.float64)


def _neutral(to_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the camera values that the matrix maps to the white of D65; of several, the least."""
    neutral = np.asarray(np.linalg.pinv(to_xyz) @ D65_WHITE_XYZ, dtype=np.float64)
    if to_xyz.shape[1] == 3 and not (neutral > 0).all():
        problem = f"white would need the camera values ({', '.join(f'{n:.4g}' for n in neutral)}), not all above 0"
        hint = "Check that the matrix is camera channels to XYZ, not its inverse"
        raise InputError(problem, where="color_matrix", hint=hint)
    return neutral


def _to_srgb(
    to_xyz: NDArray[np.float64] | None, names: Sequence[str], white: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return (3, channels), camera channels to linear sRGB.

    The signal of a gray surface becomes (1, 1, 1). Without it, the neutral that just saturates a channel does.
    """
    is_rgb = tuple(names) == ("R", "G", "B")
    if to_xyz is None:
        lit = np.ones(len(names)) if white is None else white
        shares = np.divide(1.0, lit, out=np.zeros_like(lit), where=lit > 0)
        return np.diag(shares) if is_rgb else np.tile(shares / np.count_nonzero(shares), (3, 1))
    if white is not None and not is_rgb:
        return np.asarray(SRGB_FROM_XYZ @ adaptation_to_d65(to_xyz @ white) @ to_xyz)
    neutral = _neutral(to_xyz)
    return np.asarray(SRGB_FROM_XYZ @ to_xyz * (neutral.max() if white is None else neutral / white))


def _auto_exposure(linear: NDArray[np.float32]) -> float:
    brightest = np.empty(linear.shape[:2], np.float32)
    seen, out = _blocks(linear), _blocks(brightest)

    def find(first: int, last: int) -> None:
        for block, values in zip(out[first:last], seen[first:last], strict=True):
            np.maximum(values[..., 0], values[..., 1], out=block)  # 5 times as fast as max(axis=2)
            np.maximum(block, values[..., 2], out=block)

    parallel_for(find, len(out))
    level = _high_percentile(brightest.ravel(), AUTO_EXPOSURE_PERCENTILE)
    if not level > 0:
        problem = "automatic exposure finds no light: 99.5 % of the pixels are not above black"
        raise InputError(problem, hint="Pass {exposure}", arguments={"exposure": 1.0})
    return 1.0 / level


def _high_percentile(values: NDArray[np.float32], percentile: float) -> float:
    """Return `np.percentile`, from the values above the percentile of a sample that is lower by 1."""
    low = np.percentile(values[:: max(1, values.size // _SAMPLE)], percentile - 1.0)
    high = values[values >= low]
    position = percentile / 100.0 * (values.size - 1) - (values.size - high.size)  # among the high values
    if position < 0 or not np.isfinite(low):
        return float(np.percentile(values, percentile))
    below = math.floor(position)
    neighbors = np.partition(high, [below, min(below + 1, high.size - 1)])[below : below + 2]
    return float(np.quantile(neighbors, math.fmod(percentile / 100.0 * (values.size - 1), 1.0)))


def _codes(picture: NDArray[Any], bits: int) -> NDArray[np.unsignedinteger]:
    """Return the integers of a picture from 0 to 1."""
    codes = np.empty(picture.shape, np.uint8 if bits == 8 else np.uint16)
    seen, out = _blocks(picture), _blocks(codes)

    def encode(first: int, last: int) -> None:
        for block, values in zip(out[first:last], seen[first:last], strict=True):
            block[...] = np.rint(values * ((1 << bits) - 1))

    parallel_for(encode, len(out))
    return codes


def with_color_space(jpeg: bytes) -> bytes:
    """Return a JFIF file with the Exif color space sRGB (CIPA DC-008-2019, 4.6.6), behind its first segment."""
    from PIL import Image

    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 1  # ColorSpace of the Exif IFD
    content = exif.tobytes()
    end = 4 + int.from_bytes(jpeg[4:6], "big")
    return jpeg[:end] + b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content + jpeg[end:]


def save_picture(picture: NDArray[np.float32], path: str | PathLike[str], bits: int = 8) -> None:
    """Write a developed picture as PNG or JPEG.

    Parameters
    ----------
    picture
        (rows, cols, 3), display sRGB, 0 to 1, from `develop`.
    path
        A name with the suffix .png, .jpg or .jpeg.
    bits
        Bits per channel, 8 or 16; JPEG has 8.

    Raises
    ------
    InputError
        If an argument is invalid.
    FileError
        If the file cannot be written.

    References
    ----------
    ISO/IEC 15948 (PNG), with an sRGB chunk; Pillow has no 16-bit color. ISO/IEC 10918-5 (JFIF), quality 95, all
    channels at full resolution, with the color space of Exif.

    Examples
    --------
    >>> import tempfile
    >>> from PIL import Image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_picture(np.full((2, 3, 3), 0.5, np.float32), f"{folder}/gray.png")
    ...     Image.open(f"{folder}/gray.png").getpixel((0, 0))
    (128, 128, 128)
    """
    values = np.asarray(picture)
    if values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise InputError("picture", value=values.shape, expected="of shape (rows, cols, 3)")
    if not (values.min() >= 0 and values.max() <= 1):
        raise InputError("picture", value=(float(values.min()), float(values.max())), expected="within 0 to 1")
    if bits not in BITS:
        raise InputError("bits", value=bits, expected="8 or 16")
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in PICTURE_SUFFIXES:
        raise InputError("path", value=target.name, expected=f"a name with the suffix {', '.join(PICTURE_SUFFIXES)}")
    if suffix != ".png" and bits != 8:
        raise InputError("bits", value=bits, expected="8 in JPEG", hint="Save as .png")
    codes = _codes(values, bits)
    if suffix == ".png" and codes.size > _LARGE_PNG:
        from photosite.develop.png import encode_png

        encoded: bytes | bytearray = encode_png(codes)
    elif suffix == ".png":
        from imagecodecs import png_encode

        from photosite.develop.png import with_chunks

        encoded = with_chunks(bytes(png_encode(codes, level=3)))
    else:
        from imagecodecs import jpeg8_encode

        encoded = with_color_space(bytes(jpeg8_encode(codes, level=95, subsampling="444")))
    with atomic_path(target) as temporary:
        temporary.write_bytes(encoded)
