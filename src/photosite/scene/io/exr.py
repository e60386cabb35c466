"""OpenEXR: spectral images (radiance from renderers), and pictures of red, green and blue.

Channel names follow A. Fichet, R. Pacanowski and A. Wilkie, "An OpenEXR Layout for Spectral Images", Journal of
Computer Graphics Techniques 10(3), 2021: `S0.550,000000nm`, with a comma for the decimal point, since OpenEXR uses the
point for layers. PBRT's spectral film writes it too. Mitsuba 0.x names a band by its ends, `400.00-410.00nm`; a plain
`550nm` is accepted as well.

The library's present interface (`OpenEXR.File`) reads and writes whole parts. Its older one (`InputFile`, `OutputFile`)
works by scan lines, but only on the first part; large images are read and written through it.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import colour_science
from photosite.color.spectrum import energy_from_photons
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.quiet import no_stderr
from photosite.files.writing import atomic_path
from photosite.scene.cube import Block, SpectralCube, wavelengths_in_nm
from photosite.scene.io.picture import scene_of_light
from photosite.scene.options import ReadOptions
from photosite.scene.picture_colors import primaries_to_srgb
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, override_units, parse_units

Kind = Literal["emissive", "polarized", "reflective", "reradiated", "plain"]
"""S0; S1 to S3 and most of a Mueller matrix; T or M00; a reflectance from one wavelength to another; a wavelength."""

SRGB_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Rec. ITU-R BT.709: red, green, blue, white (x, y); the default of files without the attribute."""

_SIGNATURE = b"\x76\x2f\x31\x01"
_LARGEST_HALF = 65504.0
_DISTANCE, _WIDTH, _TITLE = "photosite.distance_m", "photosite.width_m", "photosite.name"
_UNITS = "emissiveUnits"
_LAYOUT_UNITS = "W.m^-2.sr^-1"
_WRITE_BYTES = 32 << 20
"""Bytes of the rows that are written together, in double precision."""
_READ_ROWS = 256
_POWERS = (("", 1.0), ("m", 1e3), ("u", 1e6), ("n", 1e9))
_VALUES_PER_BYTE = 2000
"""Limit for a file; deflate packs zeros a thousand to one, and a value has two bytes or four."""
_LARGEST_PART_BYTES = 4 << 30
"""Limit for a part that the library can only read as a whole."""
_TRUNCATED = "is truncated: not all rows were written"
_RENDER_AGAIN = "Copy or render it again"

_NUMBER = r"\d+(?:,\d*)?(?:[Ee][+-]?\d+)?"
_LAYOUT = re.compile(rf"(S[0-3]|T|M[0-3][0-3])\.({_NUMBER})(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)(\..+)?")
_BAND = re.compile(r"(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)nm")
_PLAIN = re.compile(r"(\d+(?:[.,]\d+)?)nm")


@dataclass(frozen=True)
class SpectralChannel:
    """A channel of one wavelength, the center of its band; `kind` is what it holds."""

    name: str
    kind: Kind
    wavelength_nm: float


def spectral_channel(name: str) -> SpectralChannel | None:
    """Parse a channel's name; return None for other channels.

    Examples
    --------
    >>> spectral_channel("S0.500,250000nm")
    SpectralChannel(name='S0.500,250000nm', kind='emissive', wavelength_nm=500.25)
    >>> spectral_channel("T.0,6um").wavelength_nm, spectral_channel("400.00-410.00nm").wavelength_nm
    (600.0, 405.0)
    >>> spectral_channel("R") is None
    True
    """
    if match := _LAYOUT.fullmatch(name):
        layer, number, prefix, unit, rest = match.groups()
        if not float(number.replace(",", ".")) > 0:
            return None
        wavelength_nm = colour_science().io.fichet2021.match_groups_to_nm(number, prefix or "", unit)
        kind: Kind = "emissive" if layer == "S0" else "reflective" if layer in ("T", "M00") else "polarized"
        return SpectralChannel(name, "reradiated" if rest else kind, float(f"{wavelength_nm:.9g}"))
    if match := _BAND.fullmatch(name):
        return SpectralChannel(name, "plain", (float(match[1]) + float(match[2])) / 2)
    if match := _PLAIN.fullmatch(name):
        return SpectralChannel(name, "plain", float(match[1].replace(",", ".")))
    return None


def channel_name(wavelength_nm: float) -> str:
    """Return the layout's name of the unpolarized radiance at a wavelength.

    Examples
    --------
    >>> channel_name(500.25)
    'S0.500,250000nm'
    """
    return f"S0.{wavelength_nm:.6f}nm".replace(".", ",").replace(",", ".", 1)


def spectral_channels(names: Iterable[str]) -> dict[Kind, tuple[SpectralChannel, ...]]:
    """Return the spectral channels among a file's, by kind, each kind in order of wavelength.

    Examples
    --------
    >>> found = spectral_channels(["B", "G", "R", "S0.1000,0nm", "S0.400,0nm"])
    >>> [channel.wavelength_nm for channel in found["emissive"]]
    [400.0, 1000.0]
    """
    found: dict[Kind, list[SpectralChannel]] = {}
    for name in names:
        if (channel := spectral_channel(name)) is not None:
            found.setdefault(channel.kind, []).append(channel)
    return {kind: tuple(sorted(group, key=lambda c: c.wavelength_nm)) for kind, group in found.items()}


def color_channels(names: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the names of red, green and blue, of the file itself or of its only layer that has them.

    Examples
    --------
    >>> color_channels(["A", "B", "G", "R"]), color_channels(["beauty.B", "beauty.G", "beauty.R", "depth.Z"])
    (('R', 'G', 'B'), ('beauty.R', 'beauty.G', 'beauty.B'))
    >>> color_channels(["Y"]) is None
    True
    """
    layers = [name[:-1] for name in names if name == "R" or name.endswith(".R")]
    whole = [layer for layer in layers if f"{layer}G" in names and f"{layer}B" in names]
    if "" in whole:
        whole = [""]
    if len(whole) != 1:
        return None
    return f"{whole[0]}R", f"{whole[0]}G", f"{whole[0]}B"


def open_cube(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """Open a spectral file as a cube, or read a picture as a scene."""
    parts = parts_of(path)
    units = None if options.units is None else parse_units(options.units)
    for part in parts:
        if found := spectral_channels(part.channels):
            return _spectral(part, found, units, options)
    for part in parts:
        if options.wavelength_nm is not None:
            return _unnamed(part, options)
        if (names := color_channels(part.channels)) is not None:
            return _picture(part, names, options)
    channels = _some(parts[0].channels)
    if {"Y", "RY", "BY"} & set(parts[0].channels):
        raise FileError(path, f"is a picture of luminance ({channels})", hint="Save it as R, G and B")
    raise FileError(
        path,
        f"has neither spectral channels ('S0.550,000000nm') nor R, G and B, but {channels}",
        hint="Name channels by wavelength, or pass wavelength_nm in the order of the names",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ExrCube(SpectralCube):
    """The spectral channels of a part, in order of wavelength; `scale` converts their values to SI."""

    part: ExrPart
    channels: tuple[str, ...]
    scale: float

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, planes in self.part.blocks(self.channels, rows):
            yield first, np.moveaxis(planes.astype(np.float64) * self.scale, 0, 2)


def _spectral(
    part: ExrPart, found: dict[Kind, tuple[SpectralChannel, ...]], units: Units | None, options: ReadOptions
) -> ExrCube:
    kind = _choose_kind(part.path, found, units)
    if kind in ("reradiated", "polarized"):
        raise FileError(part.path, f"has only {kind} light; a scene needs S0 channels, its radiance")
    if kind == "reflective":
        if "reradiated" in found:
            hint = "Leave those channels out"
            raise FileError(part.path, "has re-radiation (fluorescence), which is not supported", hint=hint)
        if units is not None and units.quantity != "reflectance":
            hint = "Leave the units out, and pass the illuminant"
            raise FileError(part.path, "has reflectances (T channels)", hint=hint)
        units = units or Units("reflectance")
    elif "polarized" in found:
        what = "S1 to S3 are ignored: the light counts as unpolarized"
        warnings.warn(PhotositeWarning(what, where=str(part.path)), stacklevel=2)
    channels = found[kind]
    grid = wavelengths_in_nm(part.path, [c.wavelength_nm for c in channels], "nm", options.wavelength_nm)
    names = tuple(channel.name for channel in channels)
    return _cube(part, names, grid, units if kind == "reflective" and units else _units_of(part, options))


def _choose_kind(path: Path, found: dict[Kind, tuple[SpectralChannel, ...]], units: Units | None) -> Kind:
    radiance: Kind = "emissive" if "emissive" in found else "plain"
    if "reflective" in found and radiance in found:
        if units is None:
            what, hint = "has radiance (S0) and reflectance (T)", "Pass {units}, or 'reflectance'"
            raise FileError(path, what, hint=hint, arguments={"units": "W/m2/sr/nm"})
        return "reflective" if units.quantity == "reflectance" else radiance
    return next(kind for kind in (radiance, "reflective", "reradiated", "polarized") if kind in found)


def _unnamed(part: ExrPart, options: ReadOptions) -> ExrCube:
    """Return channels in the order of their names, with the caller's wavelengths; RGB channels are ignored."""
    names = sorted(name for name in part.channels if name.rsplit(".", 1)[-1] not in ("R", "G", "B", "A", "Y", "Z"))
    grid = wavelengths_in_nm(part.path, None, None, options.wavelength_nm)
    if len(names) != grid.size:
        what = f"has {len(names)} channels ({_some(names)}), and {grid.size} wavelengths are given"
        raise FileError(part.path, what)
    return _cube(part, tuple(names), grid, _units_of(part, options))


def _cube(part: ExrPart, names: tuple[str, ...], grid: NDArray[np.float64], units: Units) -> ExrCube:
    return ExrCube(
        name=str(part.path),
        shape=(part.rows, part.cols, len(names)),
        wavelength_nm=grid,
        quantity=units.quantity,
        distance_m=part.number(_DISTANCE),
        width_m=part.number(_WIDTH),
        title=part.text(_TITLE) or part.path.stem,
        part=part,
        channels=names,
        scale=units.scale,
    )


def _units_of(part: ExrPart, options: ReadOptions) -> Units:
    """Return the caller's units of radiance, or else the file's.

    The layout's own "W.m^-2.sr^-1" names no wavelength; those who write it (its authors, ART, PBRT) mean per nanometer.
    Lights of PBRT have no absolute scale unless its scene gives them one.
    """
    stated = part.text(_UNITS)
    if options.units is not None:
        return override_units(part.path, options.units, stated)
    if stated is None:
        what, hint = "does not state the units of its radiance (emissiveUnits)", "Pass {units}, or 'relative' and "
        arguments = {"units": "W/m2/sr/nm", "mean_luminance_cd_m2": 100}
        raise FileError(part.path, what, hint=hint + "{mean_luminance_cd_m2}", arguments=arguments)
    try:
        return parse_units(stated)
    except InputError as error:
        try:
            units = parse_units(f"{stated}.nm^-1")
        except InputError:
            raise error.in_file(part.path) from None
    warnings.warn(
        PhotositeWarning(
            f"units '{stated}' name no wavelength and are taken as per nm; PBRT writes them for lights without an "
            "absolute scale too",
            where=str(part.path),
            hint="Pass {units}, or 'relative' and mean_luminance_cd_m2",
            arguments={"units": "W/m2/sr/nm"},
        ),
        stacklevel=2,
    )
    return units


def _some(names: tuple[str, ...] | list[str]) -> str:
    shown = ", ".join(f"'{name[:30]}'" for name in names[:8])
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown or "none"


def _picture(part: ExrPart, names: tuple[str, str, str], options: ReadOptions) -> Scene:
    """Return the light that a picture shows, with its full range: values above 1 are brighter than white.

    The attribute `chromaticities` defines red, green and blue; `whiteLuminance` is the luminance of 1 in all three, in
    cd/m2, unless the options give the mean.
    """
    mean, white = options.mean_luminance_cd_m2, part.number("whiteLuminance")
    if white is None:
        what = "does not state the luminance of white (whiteLuminance)"
        options.require(part.path, what, mean_luminance_cd_m2=100)
    linear = np.moveaxis(_linear_srgb(part, names, options), 0, 2)
    return scene_of_light(part.path, linear, options, white if mean is None else None)


def _linear_srgb(part: ExrPart, names: tuple[str, str, str], options: ReadOptions) -> NDArray[np.float32]:
    """Return (3, rows, cols), negative where sRGB has no such color."""
    to_srgb = _to_srgb(part)
    linear = np.empty((3, part.rows, part.cols), np.float32)
    for first, planes in part.blocks(names, _READ_ROWS):
        if np.isinf(planes).any():
            raise FileError(part.path, "has infinite values", hint="Correct them")
        block = np.tensordot(to_srgb, planes.astype(np.float64), axes=1)
        if np.isnan(block).any():
            if options.no_data != "zero":
                hint = "Correct them, or pass {no_data}"
                raise FileError(part.path, "has NaN values", hint=hint, arguments={"no_data": "zero"})
            block[:, np.isnan(block).any(axis=0)] = 0.0
        with np.errstate(over="ignore"):  # checked with the whole picture
            linear[:, first : first + block.shape[1]] = block
    return linear


def _to_srgb(part: ExrPart) -> NDArray[np.float64]:
    """Return (3, 3) from the file's primaries to sRGB's, whites matched by Bradford's transform."""
    stated: Any = part.attributes.get("chromaticities", SRGB_CHROMATICITIES)
    try:
        values = np.asarray(stated, np.float64).ravel()
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (8,) or not np.isfinite(values).all() or values[7] <= 0:
        raise FileError(part.path, "chromaticities", value=stated, expected="x and y of red, green, blue and white")
    if np.allclose(values, SRGB_CHROMATICITIES, atol=1e-4):
        return np.eye(3)
    try:
        return primaries_to_srgb(values[:6], values[6:])
    except InputError as error:
        raise error.within("chromaticities").in_file(part.path) from None


@dataclass(frozen=True, eq=False)
class ExrPart:
    """An image in a file of so many `parts`, before its values are read.

    Rows and columns are those of the data window, which has all the values; channels are in the file's order.
    """

    path: Path
    index: int
    rows: int
    cols: int
    first_row: int
    channels: tuple[str, ...]
    attributes: Mapping[str, Any]
    parts: int

    def text(self, name: str) -> str | None:
        """Return a text attribute, or None."""
        value = self.attributes.get(name)
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        return value.strip() if isinstance(value, str) and value.strip() else None

    def number(self, name: str) -> float | None:
        """Return an attribute above 0, or None; it may be text, which holds more digits than a float."""
        try:
            value = float(self.attributes.get(name, "nan"))
        except (TypeError, ValueError):
            return None
        return value if np.isfinite(value) and value > 0 else None

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Yield first row and (channels, n, cols) values of all rows in order."""
        if self.index == 0:
            yield from self._rows_of_first_part(names, rows)
            return
        values = self._whole(names)
        for first in range(0, self.rows, rows):
            yield first, values[:, first : first + rows]

    def _rows_of_first_part(self, names: Sequence[str], rows: int) -> Iterator[tuple[int, NDArray[np.float32]]]:
        library = _library(self.path)
        import Imath

        kind = Imath.PixelType(Imath.PixelType.FLOAT)
        with _library_errors(self.path):
            file = library.InputFile(os.fspath(self.path))
            complete = file.isComplete()
        try:
            if not complete:
                raise FileError(self.path, _TRUNCATED, hint=_RENDER_AGAIN)
            for first in range(0, self.rows, rows):
                count = min(rows, self.rows - first)
                top = self.first_row + first
                with _library_errors(self.path):
                    parts = file.channels(list(names), kind, top, top + count - 1)
                yield first, np.stack([np.frombuffer(part, np.float32).reshape(count, self.cols) for part in parts])
        finally:
            file.close()

    def _whole(self, names: Sequence[str]) -> NDArray[np.float32]:
        size = 4 * self.rows * self.cols * len(self.channels)
        if size > _LARGEST_PART_BYTES:
            what = f"has its image in part {self.index + 1}, which must be read as a whole, {size / 1e9:.0f} GB"
            raise FileError(self.path, what, hint="Write it as the first part")
        with _library_errors(self.path):
            file = _library(self.path).File(os.fspath(self.path), separate_channels=True)
        # A part whose values cannot be read is missing from the list.
        if len(file.parts) < self.parts:
            raise FileError(self.path, _TRUNCATED, hint=_RENDER_AGAIN)
        channels = file.channels(self.index)
        return np.stack([np.asarray(channels[name].pixels, np.float32) for name in names])


def parts_of(path: Path) -> tuple[ExrPart, ...]:
    """Read the headers of a file's parts."""
    library = _library(path)
    try:
        with path.open("rb") as file:
            head = file.read(len(_SIGNATURE))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    if head != _SIGNATURE:
        raise FileError(path, "is not an OpenEXR file")
    with _library_errors(path):
        heads = [part.header for part in library.File(os.fspath(path), header_only=True).parts]
    if not heads:
        raise FileError(path, "is damaged: it has no parts", hint=_RENDER_AGAIN)
    with _library_errors(path):  # text that is not UTF-8, attributes of the wrong type
        return tuple(_part(path, index, head, len(heads)) for index, head in enumerate(heads))


def _part(path: Path, index: int, head: Mapping[str, Any], parts: int) -> ExrPart:
    if "deep" in str(head.get("type", "")):
        raise FileError(path, "has deep samples, which are not supported", hint="Flatten it")
    ratio = float(head.get("pixelAspectRatio", 1.0))
    if not np.isclose(ratio, 1.0, rtol=1e-3):
        raise FileError(path, "pixelAspectRatio", value=ratio, expected="1, square pixels", hint="Resample it")
    channels = head["channels"]
    if any(channel.xSampling != 1 or channel.ySampling != 1 for channel in channels):
        raise FileError(path, "has subsampled channels, which are not supported", hint="Write all at full size")
    (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in head["dataWindow"])
    names = tuple(channel.name for channel in channels)
    rows, cols = bottom - top + 1, right - left + 1
    if rows * cols * max(len(names), 1) > _VALUES_PER_BYTE * path.stat().st_size:
        what = f"is damaged: its bytes cannot hold {rows} x {cols} samples of {len(names)} channels"
        raise FileError(path, what)
    return ExrPart(path, index, rows, cols, top, names, dict(head), parts)


def write(scene: Scene, path: Path, *, half: bool = False) -> None:
    """Write a scene's energy radiance in the layout for spectral images, some rows at a time.

    The layout has no place for regions and reflectances. With `half`, values are 16-bit floats in the unit (W, mW, uW
    or nW per m2, sr and nm) in which the brightest one still fits: relative errors up to 5e-4, of values down to a
    billionth of the brightest.
    """
    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    step = max(1, _WRITE_BYTES // (8 * cols * bands))
    per_photon = energy_from_photons(np.ones(scene.wavelength_nm.size), scene.wavelength_nm)
    prefix, factor = _POWERS[0]
    if half:
        prefix, factor = _power(max(float((block * per_photon).max()) for _, block in cube.blocks(step)))
    per_photon = per_photon * factor
    attributes = {
        "spectralLayoutVersion": "1.0",
        _UNITS: f"{prefix}{_LAYOUT_UNITS}.nm^-1",
        _DISTANCE: repr(float(scene.distance_m)),
        _TITLE: scene.name,
    }
    if scene.width_m is not None:
        attributes[_WIDTH] = repr(float(scene.width_m))
    planes = (np.moveaxis(block * per_photon, 2, 0).astype(np.float32) for _, block in cube.blocks(step))
    names = [channel_name(wavelength) for wavelength in scene.wavelength_nm]
    _write_rows(path, (rows, cols), names, planes, half, attributes)


def _power(brightest: float) -> tuple[str, float]:
    """Return the smallest unit of power in which 16-bit floats hold the brightest value in W/m2/sr/nm."""
    for prefix, factor in reversed(_POWERS):
        if brightest * factor <= _LARGEST_HALF:
            return prefix, factor
    expected = f"at most {_LARGEST_HALF:g} W/m2/sr/nm in 16-bit floats"
    raise InputError("radiance", value=brightest, expected=expected, hint="Write 32-bit floats")


def _write_rows(
    path: Path,
    shape: tuple[int, int],
    channels: Sequence[str],
    blocks: Iterator[NDArray[np.float32]],
    half: bool,
    attributes: Mapping[str, str],
) -> None:
    """Write a file of one part from (channels, n, cols) blocks of rows."""
    library = _library(path)
    import Imath

    kind = np.float16 if half else np.float32
    stored = Imath.Channel(Imath.PixelType(Imath.PixelType.HALF if half else Imath.PixelType.FLOAT))
    head = library.Header(shape[1], shape[0])
    head["channels"] = dict.fromkeys(channels, stored)
    head["compression"] = Imath.Compression(Imath.Compression.ZIP_COMPRESSION)
    head |= {name: value.encode() for name, value in attributes.items()}
    with atomic_path(path) as temporary:
        with _library_errors(path, writing=True):
            file = library.OutputFile(os.fspath(temporary), head)
        try:
            for block in blocks:
                rows = {name: plane.astype(kind).tobytes() for name, plane in zip(channels, block, strict=True)}
                with _library_errors(path, writing=True):
                    file.writePixels(rows, block.shape[1])
        finally:
            file.close()


def _library(path: Path) -> Any:
    try:
        import OpenEXR
    except ImportError:
        hint = "Run pip install '.[spectral]' in the clone"
        raise FileError(path, "is OpenEXR, which needs the extra 'spectral'", hint=hint) from None
    return OpenEXR


@contextmanager
def _library_errors(path: Path, *, writing: bool = False) -> Iterator[None]:
    """Turn the library's exceptions into a `FileError`, and discard what it prints on damaged files."""
    try:
        with no_stderr(), redirect_stdout(io.StringIO()):
            yield
    except (RuntimeError, OSError, ValueError, TypeError, KeyError) as error:
        reason = " ".join(str(error).replace(os.fspath(path), "it").split())
        if writing:
            system_reason = reason.rpartition('". ')[2].rstrip(".")  # the library names the temporary file before it
            raise FileError(path, f"cannot be written: {system_reason[:120]}") from None
        raise FileError(path, f"is damaged or truncated ({reason[:120]})", hint=_RENDER_AGAIN) from None
