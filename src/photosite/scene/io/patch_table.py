"""Measured charts: a table of named spectra, and the chart that is drawn from it or was.

How files write such a table: `photosite.scene.io.cgats`, `photosite.scene.io.chart_csv`.
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.small import read_small
from photosite.scene.bands import band_order, within_range
from photosite.scene.charts.patches import reflectance_chart
from photosite.scene.io.units import override_units
from photosite.scene.options import ReadOptions
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.units import Units, bright_count, check_reflectances
from photosite.values.region import Region

LARGEST_BYTES = 1 << 24
"""Of a file that is read at all: 20 000 patches of 100 wavelengths."""

_WILD_SHARE = 0.02
"""Of a chart's values: a white among 24 patches is more of them."""
_LONGEST_ROW = 8
"""Patches that lie in one row for their names alone; a chart of more has rows."""
_UNEVEN = 1e-3
"""RMS difference from a patch's mean, relative to that, above which it is said that the mean alone is written."""
_BRIGHTEST_FRACTION, _DARKEST_PERCENT, _CHART_OF = 1.3, 5.0, 6
"""No reflectance factor is above 5, not of fluorescence; and of 6 patches or more, one reflects more than 1.3 %."""


@dataclass(frozen=True, eq=False)
class PatchTable:
    """Named spectra.

    Parameters
    ----------
    path
        The file.
    names
        Of the patches, all different.
    wavelength_nm
        (wavelengths,) in the file's order.
    values
        (patches, wavelengths) as the file has them.
    units
        Of the values, where the file says them.
    cols
        Patches across, where the file says it.
    title
        What the file calls itself.
    """

    path: Path
    names: tuple[str, ...]
    wavelength_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    units: Units | None = None
    cols: int | None = None
    title: str | None = None


def read_text(path: Path) -> str:
    """A file's text, in UTF-8 (with or without its mark), UTF-16 with its mark, or else Windows-1252.

    What cannot be printed is read as U+FFFD, so that an error line can show it.

    Raises
    ------
    FileError
        If it cannot be read or is too large for a chart's.
    """
    content = read_small(path, "a chart's table", LARGEST_BYTES)
    marked = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(marked)
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    lines = re.split(r"\r\n|\r|\n", text)
    return "\n".join(line if line.replace("\t", "").isprintable() else _printable(line) for line in lines)


def _printable(line: str) -> str:
    return "".join(sign if sign.isprintable() or sign == "\t" else "\ufffd" for sign in line)


def number(path: Path, text: str, line: int | None, what: str, *, gaps: bool = False) -> float:
    """A finite number, or NaN where there may be gaps and nothing or NaN stands; a decimal comma is understood.

    Raises
    ------
    FileError
        If it is none.
    """
    if gaps and not text.strip():
        return math.nan
    try:
        value = float(text.replace(",", ".") if text.count(",") == 1 else text)
    except ValueError:
        raise FileError(path, f"expected a number for {what}, got {text[:40]!r}", line) from None
    if math.isinf(value) or (math.isnan(value) and not gaps):
        raise FileError(path, f"expected a finite number for {what}, got {text[:40]!r}", line)
    return value


def patches_across(text: str) -> int | None:
    """A number of patches that a file says, or None where it says none that could be."""
    return int(text) if re.fullmatch(r"[1-9]\d{0,3}", text.strip(), re.ASCII) else None


def chart_scene(table: PatchTable, options: ReadOptions) -> Scene:
    """The chart of a table: reflectances under a light, or radiances as they are.

    Patches whose names are a letter and a number (A1, B12) and fill a rectangle lie there, letters down and numbers
    across, as ISO 12641 has it; others in the order of the file, `options.patch_cols` across, or as many as the file
    says, or half as many again across as down. More than 8 that would make one row (P1 to P24) count as others, and
    that is said.

    Raises
    ------
    FileError
        If the table does not say what is needed and the options do not either, or a spectrum cannot be.
    """
    if options.wavelength_nm is not None:
        raise FileError(table.path, "says its wavelengths itself; leave wavelength_nm out")
    table = _taken(table, options)
    units = _units(table, options)
    values = _without_gaps(table, options) * units.scale
    if units.quantity == "reflectance":
        check_reflectances(table.path, float(values.max()), bright_count(values), values.size)
    rows, cols, places = _layout(table, options)
    names, values = tuple(table.names[k] for k in places), values[places]
    title = table.title or table.path.stem
    if units.quantity == "reflectance":
        if options.illuminant is None:
            raise FileError(
                table.path,
                "holds reflectances; say the light on them (illuminant='D65', mean_luminance_cd_m2=100)",
            )
        if options.mean_luminance_cd_m2 is None:
            raise FileError(
                table.path, "holds reflectances; say how bright they are lit on average (mean_luminance_cd_m2=100)"
            )
        light: str | float | Spectrum = options.illuminant
    else:
        light = _even_light(table, units, options)
    if not values.any():
        raise FileError(table.path, "holds darkness: all its values are 0")
    try:
        chart = reflectance_chart(
            values,
            table.wavelength_nm,
            rows=rows,
            cols=cols,
            names=names,
            name=title,
        ).under(
            light,
            1.0 if options.mean_luminance_cd_m2 is None else options.mean_luminance_cd_m2,
            distance_m=options.distance_m or DEFAULT_DISTANCE_M,
            width_m=options.width_m,
        )
    except InputError as error:
        raise FileError(table.path, str(error)) from None
    if units.quantity == "reflectance":
        return chart
    chart = replace(chart, reflectance=None, name=title)
    if options.mean_luminance_cd_m2 is not None:
        return chart
    # A chart is drawn to a luminance: back to the radiance measured.
    brightest = int(values.sum(axis=1).argmax())
    region = chart.regions[brightest]
    measured = values[brightest] * _photons(units, table.wavelength_nm)
    return chart.scaled(float(measured.sum() / chart.radiance(region.r0, region.c0).sum()))


def patch_table(scene: Scene, path: Path) -> PatchTable:
    """The named patches of a scene: mean reflectance where it is known, else energy radiance.

    Parameters
    ----------
    scene
        A scene with regions.
    path
        The file that the table is for.

    Raises
    ------
    FileError
        If it has no regions.
    """
    if not scene.regions:
        raise FileError(path, f"cannot be written: '{scene.name}' has no patches; write it as an image (.h5, .exr)")
    basis = scene.reflectance
    units = Units("reflectance")
    if basis is None:
        basis, units = scene.basis / photons_from_energy(1.0, scene.wavelength_nm), Units("energy radiance")
    means = [
        scene.weights[:, part.r0 : part.r1, part.c0 : part.c1].mean(axis=(1, 2), dtype=np.float64)
        for part in scene.regions
    ]
    uneven = max(_unevenness(scene, part) for part in scene.regions)
    if uneven > _UNEVEN:
        warnings.warn(
            PhotositeWarning(
                f"{path}: holds the means of patches that are not even (up to {uneven:.1%} RMS within one); write "
                ".h5 to keep the scene as it is"
            ),
            stacklevel=3,
        )
    across = {part.c0 for part in scene.regions}
    names = tuple(part.name for part in scene.regions)
    title = scene.name.split(", illuminant ")[0] if units.quantity == "reflectance" else scene.name
    return PatchTable(path, names, scene.wavelength_nm, np.array(means) @ basis, units, len(across), title)


def _unevenness(scene: Scene, part: Region) -> float:
    """RMS of the radiance's difference from a patch's mean, relative to the mean's own."""
    weights = scene.weights[:, part.r0 : part.r1, part.c0 : part.c1].reshape(len(scene.basis), -1).astype(np.float64)
    mean = weights.mean(axis=1)
    apart = weights - mean[:, None]
    gram = scene.basis @ scene.basis.T
    power = float(mean @ gram @ mean)
    spread = float(np.einsum("kn,kl,ln->", apart, gram, apart)) / apart.shape[1]
    return math.sqrt(max(spread, 0.0) / power) if power > 0 else 0.0


def _units(table: PatchTable, options: ReadOptions) -> Units:
    if options.units is not None:
        percent = table.units == Units("reflectance", 0.01)
        stated = "percent" if percent else None if table.units is None else table.units.quantity
        return override_units(table.path, options.units, stated, table.units)
    if table.units is not None:
        return table.units
    brightest = float(np.nanmax(table.values))
    wild = np.argwhere(table.values > _BRIGHTEST_FRACTION)
    if brightest > _DARKEST_PERCENT and len(wild) < _WILD_SHARE * table.values.size:
        patch, band = np.unravel_index(int(np.nanargmax(table.values)), table.values.shape)
        raise FileError(
            table.path,
            f"patch '{table.names[patch]}' has {brightest:g} at {table.wavelength_nm[band]:g} nm where nearly all else "
            f"is below {_BRIGHTEST_FRACTION:g}; mend it, or say units='percent' if all are percent",
        )
    if brightest > _DARKEST_PERCENT:
        return Units("reflectance", 0.01)
    if brightest <= _BRIGHTEST_FRACTION and len(table.values) >= _CHART_OF:
        return Units("reflectance")
    raise FileError(
        table.path,
        f"does not say whether its values, up to {brightest:g}, are percent or fractions; say units='percent' or "
        "units='reflectance' (or the units of a radiance)",
    )


def _taken(table: PatchTable, options: ReadOptions) -> PatchTable:
    """The bands that are wanted, in order of wavelength."""
    wanted = within_range(table.wavelength_nm, options.band_range_nm)
    if not wanted.any():
        raise FileError(table.path, "has no wavelength in band_range_nm; choose another range")
    grid, values = table.wavelength_nm[wanted], table.values[:, wanted]
    order = band_order(str(table.path), grid, sort=options.sort_bands)
    return replace(table, wavelength_nm=grid[order], values=values[:, order])


def _without_gaps(table: PatchTable, options: ReadOptions) -> NDArray[np.float64]:
    """The values, those that lack or are below 0 made 0 where that is said; how many is told."""
    below, gaps = table.values < 0, np.isnan(table.values)
    if below.any() and options.negative != "zero":
        patch, band = np.argwhere(below)[0]
        raise FileError(
            table.path,
            f"patch '{table.names[patch]}' has {table.values[patch, band]:g} at {table.wavelength_nm[band]:g} nm; "
            "measure it again, or make what is below 0 zero (negative='zero')",
        )
    if gaps.any() and options.no_data != "zero":
        patch, band = np.argwhere(gaps)[0]
        raise FileError(
            table.path,
            f"patch '{table.names[patch]}' has no number at {table.wavelength_nm[band]:g} nm; measure it again, or "
            "make what is missing 0 (no_data='zero')",
        )
    counts = ((int(gaps.sum()), "missing"), (int(below.sum()), "negative"))
    if told := " and ".join(f"{count} {what}" for count, what in counts if count):
        warnings.warn(PhotositeWarning(f"{table.path}: {told} values were taken as 0"), stacklevel=2)
    return np.where(below | gaps, 0.0, table.values)


def _layout(table: PatchTable, options: ReadOptions) -> tuple[int, int, list[int]]:
    """Rows, columns, and the patches in the order of their places."""
    count = len(table.names)
    in_order = list(range(count))
    if options.patch_cols is not None:
        return -(-count // options.patch_cols), options.patch_cols, in_order
    found = [re.fullmatch(r"([A-Za-z]{1,2}) ?0*(\d{1,3})", name) for name in table.names]
    if count > 1 and all(found):
        places = [((len(m[1]), m[1].upper()), int(m[2])) for m in found if m is not None]
        downs, acrosses = sorted({place[0] for place in places}), sorted({place[1] for place in places})
        if len(set(places)) == count == len(downs) * len(acrosses):
            in_order = sorted(in_order, key=places.__getitem__)
            if table.cols is None and count > _LONGEST_ROW and 1 in (len(downs), len(acrosses)):
                return _near_square(table, in_order)
            return len(downs), len(acrosses), in_order
    cols = min(count, table.cols or math.ceil(math.sqrt(1.5 * count)))
    return -(-count // cols), cols, in_order


def _near_square(table: PatchTable, in_order: list[int]) -> tuple[int, int, list[int]]:
    """Patches that are numbered through: their names tell their order and no rows."""
    count = len(in_order)
    cols = math.ceil(math.sqrt(1.5 * count))
    warnings.warn(
        PhotositeWarning(
            f"{table.path}: the names of its {count} patches, {table.names[in_order[0]]} to "
            f"{table.names[in_order[-1]]}, do not give rows; the chart has {cols} in a row",
            hint="Pass the right number: {patch_cols}",
            arguments={"patch_cols": cols},
        ),
        stacklevel=2,
    )
    return -(-count // cols), cols, in_order


def _photons(units: Units, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    ones = np.ones(grid.size)
    return ones if units.quantity == "photon radiance" else photons_from_energy(ones, grid)


def _even_light(table: PatchTable, units: Units, options: ReadOptions) -> Spectrum:
    """A light under which a reflectance chart's values are the radiances that were measured."""
    if options.illuminant is not None:
        raise FileError(table.path, "holds radiances, whose light is in them; leave the illuminant out")
    if units.quantity == "relative" and options.mean_luminance_cd_m2 is None:
        raise FileError(
            table.path, "holds relative values; say how bright the chart is (mean_luminance_cd_m2=100) or their units"
        )
    energy = _photons(units, table.wavelength_nm) / photons_from_energy(1.0, table.wavelength_nm)
    return Spectrum(table.wavelength_nm, energy)


def checked_names(path: Path, names: list[str], lines: list[int]) -> tuple[str, ...]:
    """Names of patches.

    Raises
    ------
    FileError
        If two are one; with the line of the second.
    """
    seen: dict[str, int] = {}
    for name, line in zip(names, lines, strict=True):
        if name in seen:
            raise FileError(
                path, f"patch '{name[:40]}' stands in line {seen[name]} too; average them, or name one otherwise", line
            )
        seen[name] = line
    return tuple(names)
