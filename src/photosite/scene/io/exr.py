"""OpenEXR: spectral images (what a renderer calls radiance), and pictures of red, green and blue.

Names of channels: `photosite.scene.io.exr_names`. The library's side: `photosite.scene.io.openexr`. Pictures:
`photosite.scene.io.exr_picture`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import energy_from_photons
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.scene.bands import wavelengths_in_nm
from photosite.scene.cube import Block, CubeHead, SpectralCube
from photosite.scene.io.exr_names import Kind, SpectralChannel, channel_name, spectral_channels
from photosite.scene.io.exr_picture import colour_channels, picture_scene
from photosite.scene.io.hdf5_cube import said_units
from photosite.scene.io.openexr import LARGEST_HALF, ExrPart, parts_of, write_rows
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, parse_units

_DISTANCE, _WIDTH, _TITLE = "photosite.distance_m", "photosite.width_m", "photosite.name"
_UNITS = "emissiveUnits"
_LAYOUT_UNITS = "W.m^-2.sr^-1"
_WRITE_BYTES = 32 << 20
"""Of the double precision values of the rows that are written together."""
_POWERS = (("", 1.0), ("m", 1e3), ("u", 1e6), ("n", 1e9))


@dataclass(frozen=True, eq=False, kw_only=True)
class ExrCube(CubeHead):
    """The spectral channels of a part.

    Parameters
    ----------
    part
        The part.
    channels
        Their names, in order of wavelength.
    scale
        Times a value gives SI.
    """

    part: ExrPart
    channels: tuple[str, ...]
    scale: float

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, planes in self.part.blocks(self.channels, rows):
            yield first, np.moveaxis(planes.astype(np.float64) * self.scale, 0, 2)


def open_cube(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """A spectral file as a cube, a picture as a scene.

    Raises
    ------
    FileError
        If the file is damaged, has neither spectral channels nor red, green and blue, or does not say its units and the
        options do not either.
    """
    parts = parts_of(path)
    units = None if options.units is None else parse_units(options.units)
    for part in parts:
        found = spectral_channels(part.channels)
        if found:
            return _spectral(part, found, units, options)
    for part in parts:
        if options.wavelength_nm is not None:
            return _unnamed(part, options)
        if (names := colour_channels(part.channels)) is not None:
            return picture_scene(part, names, options)
    if {"Y", "RY", "BY"} & set(parts[0].channels):
        raise FileError(path, f"is a picture of luminance ({_some(parts[0].channels)}); save it as R, G and B")
    raise FileError(
        path,
        f"has neither spectral channels ('S0.550,000000nm') nor R, G and B, but {_some(parts[0].channels)}; name them "
        "after their wavelengths, or say these in the order of the names (wavelength_nm=[...])",
    )


def _spectral(
    part: ExrPart, found: dict[Kind, tuple[SpectralChannel, ...]], units: Units | None, options: ReadOptions
) -> ExrCube:
    kind = _kind(part.path, found, units)
    if kind in ("reradiated", "polarised"):
        raise FileError(part.path, f"holds {kind} light alone; a scene is made of S0 channels, its radiance")
    if kind == "reflective":
        if "reradiated" in found:
            raise FileError(
                part.path, "holds re-radiation (fluorescence), which a scene cannot; leave those channels out"
            )
        if units is not None and units.quantity != "reflectance":
            raise FileError(part.path, "holds reflectances (T channels); leave the units out, and say the illuminant")
        units = units or Units("reflectance")
    elif "polarised" in found:
        warnings.warn(
            PhotositeWarning(f"{part.path}: S1 to S3 are left out: a camera's pixels do not see polarisation"),
            stacklevel=2,
        )
    channels = found[kind]
    grid = wavelengths_in_nm(part.path, [c.wavelength_nm for c in channels], "nm", options.wavelength_nm)
    names = tuple(channel.name for channel in channels)
    return _cube(part, names, grid, units if kind == "reflective" and units else _units_of(part, options))


def _kind(path: Path, found: dict[Kind, tuple[SpectralChannel, ...]], units: Units | None) -> Kind:
    radiance: Kind = "emissive" if "emissive" in found else "plain"
    if "reflective" in found and radiance in found:
        if units is None:
            raise FileError(
                path,
                "holds radiance (S0) and reflectance (T); say which is wanted: units='W/m2/sr/nm' or "
                "units='reflectance'",
            )
        return "reflective" if units.quantity == "reflectance" else radiance
    return next(kind for kind in (radiance, "reflective", "reradiated", "polarised") if kind in found)


def _unnamed(part: ExrPart, options: ReadOptions) -> ExrCube:
    """Channels whose wavelengths the caller says, in the order of their names; the picture beside them left out."""
    names = sorted(name for name in part.channels if name.rsplit(".", 1)[-1] not in ("R", "G", "B", "A", "Y", "Z"))
    grid = wavelengths_in_nm(part.path, None, None, options.wavelength_nm)
    if len(names) != grid.size:
        raise FileError(
            part.path, f"has the channels {_some(names)}, {len(names)}, and {grid.size} wavelengths are given"
        )
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
    """What the caller says of the radiance, else the file.

    The layout's own word for radiance, "W.m^-2.sr^-1", names no wavelength; the numbers of all who write it (its
    authors', ART, PBRT) are per nanometre. Lights of PBRT have no scale unless its scene gives them one.
    """
    said = part.text(_UNITS)
    if options.units is not None:
        return said_units(part.path, options.units, said)
    if said is None:
        raise FileError(
            part.path,
            "does not say the units of its radiance (emissiveUnits); say them (units='W/m2/sr/nm'), or "
            "units='relative' and how bright the scene is (mean_luminance_cd_m2=100)",
        )
    try:
        return parse_units(said)
    except InputError as error:
        try:
            units = parse_units(f"{said}.nm^-1")
        except InputError:
            raise FileError(part.path, f"{error} (emissiveUnits); say what they are (units='W/m2/sr/nm')") from None
    warnings.warn(
        PhotositeWarning(
            f"{part.path}: its units '{said}' name no wavelength and are taken as per nm; PBRT writes them for lights "
            "without a scale too: say units='W/m2/sr/nm', or units='relative' and mean_luminance_cd_m2"
        ),
        stacklevel=2,
    )
    return units


def _some(names: tuple[str, ...] | list[str]) -> str:
    shown = ", ".join(f"'{name[:30]}'" for name in names[:8])
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown or "none"


def write(scene: Scene, path: Path, *, half: bool = False) -> None:
    """Write a scene's energy radiance in the layout for spectral images, some rows at a time.

    Parameters
    ----------
    scene
        The scene. Its regions and reflectances are not kept: the layout has no place for them.
    path
        The file; it appears whole or not at all.
    half
        16-bit floats, in the unit (W, mW, uW or nW per m2, sr and nm) in which the brightest value still fits: an error
        of 5e-4 of values down to a billionth of that one.

    Raises
    ------
    FileError
        If it cannot be written, or the extra is missing.
    """
    cube = cube_of_scene(scene)
    rows, cols, _ = cube.shape
    prefix, factor = _power(scene) if half else _POWERS[0]
    per_photon = energy_from_photons(np.ones(scene.wavelength_nm.size), scene.wavelength_nm) * factor
    attributes = {
        "spectralLayoutVersion": "1.0",
        _UNITS: f"{prefix}{_LAYOUT_UNITS}.nm^-1",
        _DISTANCE: repr(float(scene.distance_m)),
        _TITLE: scene.name,
    }
    if scene.width_m is not None:
        attributes[_WIDTH] = repr(float(scene.width_m))
    planes = (np.moveaxis(block * per_photon, 2, 0).astype(np.float32) for _, block in cube.blocks(_rows_of(cube)))
    names = [channel_name(wavelength) for wavelength in scene.wavelength_nm]
    write_rows(path, (rows, cols), names, planes, half=half, attributes=attributes)


def _rows_of(cube: SpectralCube) -> int:
    """How many rows are written together, wide and narrow scenes alike."""
    _, cols, bands = cube.shape
    return max(1, _WRITE_BYTES // (8 * cols * bands))


def _power(scene: Scene) -> tuple[str, float]:
    """The smallest unit of power in which 16-bit floats hold the scene's brightest value."""
    cube = cube_of_scene(scene)
    per_photon = energy_from_photons(np.ones(scene.wavelength_nm.size), scene.wavelength_nm)
    brightest = max(float((block * per_photon).max()) for _, block in cube.blocks(_rows_of(cube)))
    for prefix, factor in reversed(_POWERS):
        if brightest * factor <= LARGEST_HALF:
            return prefix, factor
    raise InputError(f"16-bit floats end at {LARGEST_HALF:g} and the scene reaches {brightest:.3g} W/m2/sr/nm; use 32")
