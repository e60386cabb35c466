"""The image of a chart: one or more frames of it, proportional to light."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, InputError
from photosite.frames.companding import decompanded
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.model import Sensor
from photosite.values.cfa import MONOCHROME, Cfa, channel_mask, channel_names, channel_sites, shifted
from photosite.values.choice import check_choice
from photosite.values.region import Patch, Region
from photosite.values.shown import Shown

if TYPE_CHECKING:
    from photosite.scene.io.color_space import RgbSpace

Array = NDArray[np.float64]
Origin = Literal["raw", "picture", "electrons"]
ToneCurveName = Literal["file", "srgb", "linear"]
Tone = Literal["linear", "given", "stated", "assumed", "chart"]
"""How values became proportional to light: they were; by a space that the caller or the file states; by sRGB's, which
nothing states; by a curve that was measured on a chart."""
T = TypeVar("T")
_SHARED_PART = 0.25
"""Part of a frame from which its values in double precision are kept for other channels and measurements."""

LUMA = "Y"
"""Channel of pictures: 0.2126 R + 0.7152 G + 0.0722 B of linear sRGB (IEC 61966-2-1)."""
_LUMA_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
_PICTURE_CHANNELS = ("R", "G", "B", LUMA)


@dataclass(frozen=True, eq=False)
class ChartImage(Shown):
    """Frames of a chart.

    Parameters
    ----------
    frames
        Of one setting: (rows, cols) mosaics, or (rows, cols, 3) pictures, proportional to light.
    origin
        "raw" frames, "picture" of a developer, or mean "electrons" without noise.
    cfa
        Tile of the color filter array; pictures have none.
    black, white
        Values without light and at saturation, in the unit of the frames.
    sensor
        Source of the system gain; None where it is not known.
    exposure_s, f_number, focal_length_mm
        Of the frames; None where unknown.
    tone
        How the values became proportional to light.
    quantization
        Largest quantization step of luma of JPEG files; None for others.
    stamps
        Times of the frames as they state them (ISO 8601); empty unless all do.

    Examples
    --------
    >>> image = chart_image(np.ones((4, 4)))
    >>> image.origin, image.channels, image.pixels(Region("all", 0, 4, 0, 4), "M").shape
    ('electrons', ('M',), (1, 16))
    """

    frames: tuple[NDArray[Any], ...]
    origin: Origin
    cfa: Cfa = MONOCHROME
    black: float = 0.0
    white: float = np.inf
    sensor: Sensor | None = None
    exposure_s: float | None = None
    f_number: float | None = None
    focal_length_mm: float | None = None
    tone: Tone = "linear"
    quantization: float | None = None
    stamps: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.frames[0].shape[:2]
        return rows, cols

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels; a picture has R, G, B and their luma Y."""
        return _PICTURE_CHANNELS if self.origin == "picture" else channel_names(self.cfa)

    @property
    def dark_signal(self) -> float:
        """Mean signal of the sensor's dark current above black; 0 where sensor or exposure time are not known."""
        if self.sensor is None or self.exposure_s is None or self.origin != "raw" or self.sensor.captures is not None:
            return 0.0
        dark_e = self.sensor.electrons(self.sensor.noise.dark_voltage_mv_per_s.value) * self.exposure_s
        return float(dark_e * self.sensor.system_gain_dn_per_e)

    def density(self, channel: str) -> float:
        """Return the fraction of the pixels that have a channel."""
        if self.origin == "picture":
            return 1.0
        return len(channel_sites(self.cfa, channel)) / (len(self.cfa) * len(self.cfa[0]))

    @property
    def sharp_channel(self) -> str:
        """The channel that stands for the image where one is chosen: luma, green, or the first."""
        return next((name for name in (LUMA, "G") if name in self.channels), self.channels[0])

    @cached_property
    def mean(self) -> NDArray[np.floating[Any]]:
        """Mean of the frames, black level included."""
        if len(self.frames) == 1:
            return self.frames[0]
        total = np.zeros(self.frames[0].shape, np.float64)
        for frame in self.frames:
            total += frame
        return total / len(self.frames)

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what `make` returns; the first call of a key makes it, for all measurements of the image."""
        if key not in self._shared:
            self._shared[key] = make()
        found: T = self._shared[key]
        return found

    @cached_property
    def _shared(self) -> dict[Hashable, Any]:
        return {}

    def check_channel(self, channel: str) -> None:
        """Raise `InputError` for a channel that the image has not."""
        if channel not in self.channels:
            raise InputError("channel", value=channel, expected=f"one of {', '.join(self.channels)}")

    def plane(self, channel: str, region: Region | None = None) -> tuple[Array, Cfa]:
        """Return (rows, cols) mean values above black in a region, and the tile there; other channels are included.

        A picture's plane holds the channel at every pixel, and its tile is monochrome.
        """
        self.check_channel(channel)
        rows, cols = self.shape
        box = region or Region("frame", 0, rows, 0, cols)
        if box.r1 > rows or box.c1 > cols:
            corners = (box.r0, box.r1, box.c0, box.c1)
            raise InputError("region", value=corners, expected=f"within the frame of {rows} x {cols} pixels")
        where = slice(box.r0, box.r1), slice(box.c0, box.c1)
        if self.origin == "picture":
            return _channel_of_picture(self.mean[where], channel), MONOCHROME
        large = box.shape[0] * box.shape[1] > _SHARED_PART * rows * cols
        values = self._above_black[where] if large else self.mean[where].astype(np.float64) - self.black
        return values, shifted(self.cfa, box.r0, box.c0)

    @cached_property
    def _above_black(self) -> Array:
        """Mean values of a mosaic above black, for the planes of all channels."""
        values = self.mean.astype(np.float64)
        values -= self.black
        values.flags.writeable = False
        return values

    def planes(self, channel: str, region: Region) -> Iterator[Array]:
        """Yield the values above black of each frame in a region, as `plane` returns those of the mean."""
        for frame in self.frames:
            part = frame[region.r0 : region.r1, region.c0 : region.c1]
            yield _channel_of_picture(part, channel) if self.origin == "picture" else part - self.black

    def mask(self, channel: str, region: Region) -> NDArray[np.bool_]:
        """Return which pixels of a region belong to a channel."""
        if self.origin == "picture":
            return np.ones(region.shape, np.bool_)
        return channel_mask(shifted(self.cfa, region.r0, region.c0), channel, region.shape)

    def pixels(self, patch: Patch, channel: str) -> Array:
        """Return the (frames, pixels) values above black of a channel in a patch."""
        self.check_channel(channel)
        return np.stack([self._pixels_of(frame, patch, channel) for frame in self.frames])

    def _pixels_of(self, frame: NDArray[Any], patch: Patch, channel: str) -> Array:
        inside = patch.inside()
        if self.origin == "picture":
            return _channel_of_picture(frame[patch.r0 : patch.r1, patch.c0 : patch.c1], channel)[inside]
        part = frame[patch.r0 : patch.r1, patch.c0 : patch.c1]
        parts = [part[where][inside[where]] for where in self._sites(patch, channel)]
        return np.concatenate(parts).astype(np.float64) - self.black

    def places(self, patch: Patch, channel: str) -> tuple[Array, Array]:
        """Return the rows and columns of the centers of `pixels`, in pixels."""
        row, col = np.indices((patch.r1 - patch.r0, patch.c1 - patch.c0)) + 0.5
        inside = patch.inside()
        if self.origin == "picture":
            return patch.r0 + row[inside], patch.c0 + col[inside]
        rows, cols = [], []
        for where in self._sites(patch, channel):
            which = inside[where]
            rows.append(row[where][which])
            cols.append(col[where][which])
        return patch.r0 + np.concatenate(rows), patch.c0 + np.concatenate(cols)

    def _sites(self, patch: Patch, channel: str) -> list[tuple[slice, slice]]:
        """Return the sites of a channel as slices of the rectangle around a patch."""
        height, width = len(self.cfa), len(self.cfa[0])
        sites = channel_sites(self.cfa, channel)
        return [
            (slice((r - patch.r0) % height, None, height), slice((c - patch.c0) % width, None, width)) for r, c in sites
        ]

    def mosaic_frame(self) -> RawFrame:
        """Return the first frame as a raw frame of 16 bits, for the detection of charts; a picture's luma."""
        values = self.frames[0] if self.origin != "picture" else _channel_of_picture(self.frames[0], LUMA)
        top = self.white if np.isfinite(self.white) else float(values.max())
        scaled = np.clip((values - self.black) / max(top - self.black, 1e-300), 0.0, 1.0) * 65535.0
        return RawFrame(np.rint(scaled).astype(np.uint16), 16, self.cfa)

    def saturated_fraction(self, patch: Patch, channel: str) -> float:
        """Return the fraction of a channel's pixels at or above the white level."""
        return float((self.pixels(patch, channel) >= self.white - self.black).mean())


def _channel_of_picture(part: NDArray[Any], channel: str) -> Array:
    if channel == LUMA:
        return np.asarray(part @ _LUMA_WEIGHTS, dtype=np.float64)
    return part[..., _PICTURE_CHANNELS.index(channel)].astype(np.float64)


Frames = RawFrame | ArrayLike | str | PathLike[str] | Sequence[RawFrame] | Sequence[str | PathLike[str]] | ChartImage


@dataclass(frozen=True, eq=False)
class _Picture:
    """Linear sRGB values of a picture file, how they became linear, its largest quantization step, and its time."""

    values: Array
    tone: Tone
    quantization: float | None = None
    stamp: str | None = None


def chart_image(
    frames: Frames, *, sensor: Sensor | None = None, tone_curve: ToneCurveName = "file", **reading: Any
) -> ChartImage:
    """Return frames of a chart as an image.

    Parameters
    ----------
    frames
        One raw frame, or several of one scene and setting, companded ones as linear numbers; files of raw frames or of
        pictures (PNG, JPEG, TIFF in color); (rows, cols) mean electrons; or (rows, cols, 3) linear values of a picture.
    sensor
        Source of the system gain.
    tone_curve
        Of picture files: that of the space that the "file" states, and of sRGB where it states none; "srgb"; or
        "linear" where codes are proportional to light.
    **reading
        Arguments of `photosite.read_raw` for files.

    Raises
    ------
    InputError
        If there are no frames, or they differ in size, tile, levels, exposure time or kind.
    FileError
        If a file cannot be read.
    """
    if isinstance(frames, ChartImage):
        return frames
    check_choice("tone_curve", tone_curve, ToneCurveName)
    given = list(frames) if isinstance(frames, list | tuple) else [frames]
    if not given:
        raise InputError("frames", value=0, expected="one or more")
    read: list[Any] = [_read(each, tone_curve, reading) if isinstance(each, str | PathLike) else each for each in given]
    pictures = [each for each in read if isinstance(each, _Picture)]
    read = [each.values if isinstance(each, _Picture) else each for each in read]
    if all(isinstance(each, RawFrame) for each in read):
        return _of_raw(read, sensor)
    arrays = [np.asarray(each, dtype=np.float64) for each in read]
    if any(isinstance(each, RawFrame) for each in read) or len({each.shape for each in arrays}) > 1:
        raise InputError("frames", expected="of one kind and size")
    first = arrays[0]
    if not (first.ndim == 2 or (first.ndim == 3 and first.shape[2] == 3)) or first.size == 0:
        expected = "(rows, cols) of mean electrons, or (rows, cols, 3) of a picture"
        raise InputError("frames", value=first.shape, expected=expected)
    if not all(np.isfinite(each).all() for each in arrays):
        raise InputError("frames", expected="finite")
    if first.ndim == 2:
        return ChartImage(tuple(arrays), "electrons", MONOCHROME if sensor is None else sensor.array.cfa, sensor=sensor)
    tones = {each.tone for each in pictures} or {"linear"}
    if len(tones) > 1:
        raise InputError("color space of the pictures", expected="stated by all or none")
    quantization = max((each.quantization for each in pictures if each.quantization is not None), default=None)
    (tone,) = tones
    stamps = tuple(each.stamp for each in pictures if each.stamp)
    return ChartImage(
        tuple(arrays),
        "picture",
        white=1.0,
        tone=tone,
        quantization=quantization,
        stamps=stamps if len(stamps) == len(arrays) else (),
    )


def _of_raw(frames: Sequence[RawFrame], sensor: Sensor | None) -> ChartImage:
    frames = [decompanded(frame) for frame in frames]
    first = frames[0]
    first.check_mosaic()
    for what in ("shape", "cfa", "bits", "black_level_dn", "white_level_dn", "exposure_s"):
        for number, frame in enumerate(frames[1:], start=2):
            one, other = getattr(first, what), getattr(frame, what)
            if one != other:
                raise InputError(what, where=f"frame {number}", value=other, expected=f"{one}, as in frame 1")
    f_number, focal_length_mm = (
        None if (value := first.metadata.get(name)) is None else float(value)
        for name in ("f_number", "focal_length_mm")
    )
    stamps = [frame.metadata.get("date_time") for frame in frames]
    return ChartImage(
        tuple(frame.dn for frame in frames),
        "raw",
        first.cfa,
        first.black_level_dn,
        first.white_level_dn,
        sensor,
        first.exposure_s,
        f_number,
        focal_length_mm,
        stamps=tuple(map(str, stamps)) if all(stamps) else (),
    )


def _read(path: str | PathLike[str], tone_curve: ToneCurveName, reading: dict[str, Any]) -> RawFrame | _Picture:
    """Return a raw frame, or a picture."""
    from photosite.frames.io.formats import is_own_output, read_raw
    from photosite.scene.io.picture import largest_quantization, read_codes, time_of

    file = Path(path)
    if file.suffix.lower() in (".jpg", ".jpeg", ".png") and (
        file.suffix.lower() != ".png" or is_own_output(file) or _is_color_png(file)
    ):
        codes, space = read_codes(file)
        return replace(_picture(codes, space, tone_curve, largest_quantization(file)), stamp=time_of(file))
    if file.suffix.lower() in (".tif", ".tiff") and (found := _color_tiff(file)) is not None:
        return _picture(*found, tone_curve)
    return read_raw(path, **reading)


def _picture(
    codes: NDArray[Any], space: RgbSpace, tone_curve: ToneCurveName, quantization: float | None = None
) -> _Picture:
    from photosite.scene.picture_colors import linear_srgb_of

    if tone_curve != "file":
        return _Picture(linear_srgb_of(codes, "sRGB", linear=tone_curve == "linear"), "given", quantization)
    values = linear_srgb_of(space.decoded(codes), space.name, linear=space.linear)
    return _Picture(values, "stated" if space.stated else "assumed", quantization)


_PNG_COLOR_TYPE = 25
"""Byte of a PNG file's IHDR; 2 and 6 are in color, 3 has a palette."""


def _is_color_png(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            head = stream.read(_PNG_COLOR_TYPE + 1)
    except OSError as error:
        raise FileError(file, error.strerror or str(error)) from None
    return len(head) > _PNG_COLOR_TYPE and head[_PNG_COLOR_TYPE] in (2, 3, 6)


def _color_tiff(file: Path) -> tuple[NDArray[Any], RgbSpace] | None:
    """Return the codes of a TIFF picture in color, and their space; None for any other file."""
    import tifffile

    from photosite.scene.io.color_space import space_of_tiff

    try:
        with tifffile.TiffFile(file) as content:
            page = content.pages[0]
            if page.ndim == 3 and page.shape[-1] == 3 and page.dtype in (np.uint8, np.uint16):
                return np.asarray(page.asarray()), space_of_tiff(file, page)
    except (OSError, tifffile.TiffFileError):
        return None
    return None
