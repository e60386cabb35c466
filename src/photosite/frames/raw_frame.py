"""A raw frame: the digital numbers of a mosaic, the metadata needed to interpret them, and the masked border."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from photosite.errors import InputError
from photosite.values.cfa import MONOCHROME, Cfa, cfa_from, channel_names, plane_names, tile_text
from photosite.values.exposure import format_exposure
from photosite.values.read_only import ReadOnly
from photosite.values.region import Border
from photosite.values.saved import write
from photosite.values.shown import Shown, drawn, thumbnail
from photosite.values.thumbnail import thumbnail_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from photosite.sensor.model import Sensor


MOST_BITS = 24
"""Largest bit depth of combined captures."""

Numbers = NDArray[np.uint16] | NDArray[np.uint32]
"""Digital numbers: uint32 above 16 bits."""


def check_bits(bits: int | None, highest: int = 16) -> None:
    """Raise `InputError` for a bit depth outside 1 to `highest`."""
    if bits is not None and not 1 <= bits <= highest:
        raise InputError("bits", value=bits, expected=f"1 to {highest}")


def neutral_text(signal: Sequence[float]) -> str:
    """Return the channels' signal of a gray surface as the metadata "as_shot_neutral" state it, the largest 1.

    Examples
    --------
    >>> neutral_text([2.0, 1.8, 0.7])
    '1,0.9,0.35'
    """
    return ",".join(f"{part / max(signal):.6g}" for part in signal)


@dataclass(frozen=True, eq=False)
class RawFrame(Shown):
    """A raw frame.

    Parameters
    ----------
    dn
        (rows, cols) uint16, digital numbers, black level included; uint32 for 17 to 24 bits.
    bits
        Bit depth of the analog-to-digital converter, or of the combination of several captures, at most 24; the
        highest number is 2^bits - 1.
    cfa
        Tile of the color filter array, or its name such as "rggb"; `(("M",),)` for a monochrome sensor.
    black_level_dn
        Mean digital number of a pixel without light.
    white_level_dn
        Digital number at which the output saturates; default 2^bits - 1.
    exposure_s
        Exposure time, or None if unknown.
    color_matrix
        (channels, 3), CIE XYZ under D65 to camera channels (in the order of `channels`), as DNG's ColorMatrix, or None.
    color_matrix_a
        (channels, 3), the same under CIE A, or None.
    noise_profile
        (channels, 2), DNG's NoiseProfile, or None: a signal s in 0..1 (black 0, white 1) has variance scale s + offset.
    metadata
        Other metadata of the file: camera, ISO, temperature, seed, ... Values are strings and numbers. Read-only.
    captures
        Digital numbers (rows, cols) uint16 of each capture that `dn` combines, by name, for sensors with several
        captures. Files do not hold them. Read-only.

    Raises
    ------
    InputError
        If the array is not two-dimensional uint16 (uint32 above 16 bits), is empty or has values above 2^bits - 1, a
        capture has another shape, or a level is invalid.

    Examples
    --------
    >>> frame = RawFrame(np.full((2, 2), 64, np.uint16), bits=12, black_level_dn=64)
    >>> frame.shape, frame.white_level_dn, frame.is_mosaic
    ((2, 2), 4095.0, False)
    >>> np.asarray(frame) - frame.black_level_dn
    array([[0., 0.],
           [0., 0.]])
    """

    dn: Numbers
    bits: int
    cfa: Cfa = MONOCHROME
    black_level_dn: float = 0.0
    white_level_dn: float = field(default=None)  # type: ignore[assignment]  # set from bits below
    exposure_s: float | None = None
    color_matrix: NDArray[np.float64] | None = None
    color_matrix_a: NDArray[np.float64] | None = None
    noise_profile: NDArray[np.float64] | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    captures: Mapping[str, NDArray[np.uint16]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        dn = np.asarray(self.dn)
        check_bits(self.bits, MOST_BITS)
        object.__setattr__(self, "cfa", cfa_from(self.cfa))
        kind = "uint16" if self.bits <= 16 else "uint32"
        if dn.ndim != 2 or dn.size == 0 or dn.dtype != kind:
            found = f"{dn.shape} of {dn.dtype}"
            raise InputError("dn", value=found, expected=f"a (rows, cols) array of {kind}, for {self.bits} bits")
        for name, part in self.captures.items():
            if part.shape != dn.shape or part.dtype != np.uint16:
                found = f"{part.shape} of {part.dtype}"
                raise InputError(f"captures['{name}']", value=found, expected=f"{dn.shape} of uint16")
        top = (1 << self.bits) - 1
        if self.white_level_dn is None:
            object.__setattr__(self, "white_level_dn", float(top))
        if not 0 < self.white_level_dn <= top:
            raise InputError("white_level_dn", value=self.white_level_dn, expected=f"above 0 and at most {top}")
        if not 0 <= self.black_level_dn < self.white_level_dn:
            expected = f"0 or above and below the white level, {self.white_level_dn:g}"
            raise InputError("black_level_dn", value=self.black_level_dn, expected=expected)
        if self.bits != 16 and (highest := int(dn.max())) > top:
            raise InputError("dn", value=highest, expected=f"at most {top}, for {self.bits} bits")
        object.__setattr__(self, "black_level_dn", float(self.black_level_dn))  # signed where it is subtracted
        if not isinstance(self.metadata, ReadOnly):
            object.__setattr__(self, "metadata", ReadOnly(self.metadata))
        if not isinstance(self.captures, ReadOnly):
            object.__setattr__(self, "captures", ReadOnly(self.captures))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the digital numbers, so that `np.asarray(raw)` and `plt.imshow(raw)` work."""
        return np.array(self.dn, dtype=dtype, copy=copy)

    def _repr_html_(self) -> str:
        exposure = "" if self.exposure_s is None else f", {format_exposure(self.exposure_s)} s"
        size = f"{self.shape[0]} x {self.shape[1]} pixels, {tile_text(self.cfa)}, {self.bits} bits"
        return thumbnail_html(thumbnail(self), f"RawFrame: {size}{exposure}")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the digital numbers in gray on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.dn.shape
        return rows, cols

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the mosaic, each once, in reading order of the tile."""
        return channel_names(self.cfa)

    @property
    def is_mosaic(self) -> bool:
        """Whether the frame has more than one channel."""
        return len(self.channels) > 1

    @property
    def is_stacked(self) -> bool:
        """Whether the channels are layers of one pixel, read side by side: "stacked" in the metadata is 1."""
        return self.metadata.get("stacked") == 1

    def check_mosaic(self) -> None:
        """Raise `InputError` if the channels are stacked, so that columns are not those of pixels."""
        if self.is_stacked:
            raise InputError("the channels of the frame are stacked", hint="Pass one of its layers()")

    def layers(self) -> dict[str, RawFrame]:
        """Return the stacked channels as monochrome frames of all pixels.

        Raises
        ------
        InputError
            If the frame has no stacked channels, or part of a pixel.

        Examples
        --------
        >>> dn = np.arange(12, dtype=np.uint16).reshape(2, 6)
        >>> RawFrame(dn, bits=12, cfa=(("B", "G", "R"),), metadata={"stacked": 1}).layers()["G"].dn
        array([[ 1,  4],
               [ 7, 10]], dtype=uint16)
        """
        names = self.channels
        if not self.is_stacked or self.cfa != (names,) or self.shape[1] % len(names):
            expected = "one row of channels in each of whole pixels, and stacked = 1 in the metadata"
            raise InputError("cfa", where="layers", value=tile_text(self.cfa), expected=expected)
        metadata = {key: value for key, value in self.metadata.items() if key not in ("stacked", "as_shot_neutral")}
        return {
            name: replace(
                self,
                dn=self.dn[:, k :: len(names)],
                cfa=MONOCHROME,
                color_matrix=None,
                color_matrix_a=None,
                noise_profile=None if self.noise_profile is None else np.asarray(self.noise_profile)[k : k + 1],
                metadata=metadata,
                captures={},
            )
            for k, name in enumerate(names)
        }

    def capture(self, name: str, sensor: Sensor) -> RawFrame:
        """Return one of the captures that the frame combines as a single frame, in the sensor's converter numbers.

        The exposure time stays that of the frame. The metadata state the name, under "capture".

        Raises
        ------
        InputError
            If the frame has no such capture.

        Examples
        --------
        >>> import photosite as ps
        >>> phone = ps.load_sensor("dual-gain-phone").with_(rows=24, cols=32)
        >>> camera = ps.Camera(ps.DiffractionLimited(f_number=2, focal_length_mm=4), phone)
        >>> raw = camera.expose(np.full((24, 32), 5000, np.float32), 0.01)
        >>> raw.bits, raw.capture("low", phone).bits
        (14, 12)
        """
        if name not in self.captures:
            raise InputError("capture", value=name, expected=f"one of {', '.join(self.captures) or 'none'}")
        from photosite.sensor.saturation_level import capture_level_dn

        return replace(
            self,
            dn=self.captures[name],
            bits=sensor.readout.bits,
            black_level_dn=sensor.readout.black_level_dn.value,
            white_level_dn=capture_level_dn(sensor, name),
            noise_profile=None,
            metadata={**self.metadata, "capture": name},
            captures={},
        )

    @property
    def as_shot_neutral(self) -> tuple[float, ...] | None:
        """White of the light: a gray surface's signal in the order of `plane_names(cfa)`, the largest 1, or None.

        It is in the metadata, under "as_shot_neutral", as text: "1,0.9,0.4".

        Raises
        ------
        InputError
            If the metadata have something else than one number above 0 and at most 1 for each channel. Channels other
            than R, G and B may have 0, such as infrared ones under light without infrared.
        """
        stated = self.metadata.get("as_shot_neutral")
        if stated is None:
            return None
        try:
            neutral = tuple(float(part) for part in str(stated).split(","))
        except ValueError:
            neutral = ()
        names = plane_names(self.cfa)
        valid = len(neutral) == len(names) and max(neutral) > 0
        for name, part in zip(names, neutral, strict=False):
            valid &= 0 <= part <= 1 and (part > 0 or name not in ("R", "G", "B"))
        if not valid:
            expected = f"a number above 0 and at most 1 for each of {', '.join(names)}"
            raise InputError("as_shot_neutral", where="metadata", value=stated, expected=expected)
        return neutral

    def save(self, path: str | PathLike[str]) -> None:
        """Write the frame in the format of the suffix: .dng, .tif / .tiff, .png or .h5 / .hdf5.

        Raises
        ------
        InputError
            If the suffix is another, or the format cannot hold the frame.
        FileError
            If the file cannot be written. An existing file of that name is then unchanged.
        """
        write(self, path)


OPTICAL_BLACK = "optical_black"
"""Metadata: lines without light, rows at top and bottom and columns at left and right of the frame, `8,0,16,0`."""


def stated_border(metadata: Mapping[str, Any]) -> Border | None:
    """Return the lines without light that metadata state; None if they state none, or something else.

    Examples
    --------
    >>> stated_border({"optical_black": "8,0,16,0"}), stated_border({"optical_black": "yes"})
    ((8, 0, 16, 0), None)
    """
    try:
        top, bottom, left, right = map(int, str(metadata.get(OPTICAL_BLACK)).split(","))
    except ValueError:
        return None
    border = top, bottom, left, right
    return border if min(border) >= 0 < max(border) else None


MASKED_BORDER = "masked_border_dn"
"""Metadata name of the mean level of the masked pixels beside the frame."""

_TOLERANCE_DN, _TOLERANCE_FRACTION = 1.0, 1e-3
"""Levels disagree if they differ by more than this many DN and by more than this fraction of the range up to white."""


def levels_disagree(stated_dn: float, found_dn: float, white_level_dn: float) -> bool:
    """Return whether a measured black level contradicts the stated one.

    Examples
    --------
    >>> levels_disagree(256, 256.6, 4095), levels_disagree(256, 262, 4095), levels_disagree(512, 520, 16383)
    (False, True, False)
    """
    return abs(found_dn - stated_dn) > max(_TOLERANCE_DN, _TOLERANCE_FRACTION * (white_level_dn - stated_dn))


def masked_border_note(frame: RawFrame) -> tuple[str, ...]:
    """Return a note if the masked border contradicts the stated black level, else nothing."""
    found = frame.metadata.get(MASKED_BORDER)
    if not isinstance(found, float) or not levels_disagree(frame.black_level_dn, found, frame.white_level_dn):
        return ()
    return (
        f"the masked border has a mean of {found:.2f} DN, but the stated black level is {frame.black_level_dn:g} DN",
    )


def masked_border_level(strips: list[NDArray[np.uint16]]) -> float | None:
    """Return the level of a border whose lines need not all be masked: the median of the lines' means.

    Parameters
    ----------
    strips
        (lines, pixels along the edge of the frame) each. Some lines may be blank or receive light.

    Examples
    --------
    >>> masked_border_level([np.array([[0, 0], [64, 66], [65, 65], [64, 65], [90, 95]], np.uint16)])
    65.0
    """
    means = [float(line.mean()) for strip in strips for line in strip]
    return float(np.median(means)) if means else None
