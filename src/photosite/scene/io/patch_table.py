"""Measured charts: a table of named spectra, to and from the scene of a chart.

File formats of such tables: `photosite.scene.io.cgats`, `photosite.scene.io.chart_csv`.
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
from photosite.files.small_files import read_small
from photosite.scene.charts.patches import reflectance_chart
from photosite.scene.cube import band_order, within_range
from photosite.scene.options import ReadOptions
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.units import Units, bright_count, check_reflectances, override_units
from photosite.values.region import Region

LARGEST_BYTES = 1 << 24
"""Limit for a file: 20 000 patches of 100 wavelengths."""

_OUTLIER_FRACTION = 0.02
"""Fraction of a chart's values; a white among 24 patches is more."""
_LONGEST_ROW = 8
"""Patches that may form one row by their names alone."""
_UNEVEN = 1e-3
"""RMS difference from a patch's mean, relative to the mean, above which writing the mean alone is a warning."""
_BRIGHTEST_FRACTION, _DARKEST_PERCENT, _CHART_OF = 1.3, 5.0, 6
"""Reflectance factors are below 5, fluorescence included; of 6 patches or more, one reflects more than 1.3 %."""


@dataclass(frozen=True, eq=False)
class PatchTable:
    """Named spectra of a file.

    Parameters
    ----------
    path
        The file.
    names
        Names of the patches, all different.
    wavelength_nm
        (wavelengths,) in the file's order.
    values
        (patches, wavelengths) as in the file.
    units, cols, title
        Units of the values, patches across, and title, where the file states them.
    """

    path: Path
    names: tuple[str, ...]
    wavelength_nm: NDArray[np.float64]
    values: NDArray[np.float64]
    units: Units | None = None
    cols: int | None = None
    title: str | None = None


def read_text(path: Path) -> str:
    """Read a file's text: UTF-8 (with or without a byte order mark), UTF-16 with one, or else Windows-1252.

    Unprintable characters become U+FFFD, so that messages can show them.
    """
    return decoded_text(read_small(path, "a chart's table", LARGEST_BYTES))


def decoded_text(content: bytes) -> str:
    """Return the text of a file's bytes, as `read_text` does."""
    marked = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(marked)
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    text = re.sub(r"\r\n?", "\n", text)
    if text.replace("\t", "").replace("\n", "").isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign in "\t\n" else "\ufffd" for sign in text)


def number(path: Path, text: str, line: int | None, what: str, *, gaps: bool = False) -> float:
    """Parse a finite number, with a decimal point or comma; with `gaps`, empty text and NaN are NaN."""
    if gaps and not text.strip():
        return math.nan
    try:
        value = float(text.replace(",", ".") if text.count(",") == 1 else text)
    except ValueError:
        raise FileError(path, what, line, value=text[:40], expected="a number") from None
    if math.isinf(value) or (math.isnan(value) and not gaps):
        raise FileError(path, what, line, value=text[:40], expected="a finite number")
    return value


def patches_across(text: str) -> int | None:
    """Parse a number of patches; return None if it is invalid."""
    return int(text) if re.fullmatch(r"[1-9]\d{0,3}", text.strip(), re.ASCII) else None


def chart_scene(table: PatchTable, options: ReadOptions) -> Scene:
    """Return the chart of a table: reflectances under an illuminant, or radiances as they are.

    Patches whose names are a letter and a number (A1, B12) and fill a rectangle are placed by name, letters down and
    numbers across, as in ISO 12641. Others keep the order of the file: `options.patch_cols` across, or as stated in the
    file, or half as many again across as down. More than 8 names that would form one row (P1 to P24) are placed in this
    way too, with a warning.

    Raises
    ------
    FileError
        If required data are neither in the table nor in the options, or a spectrum is invalid.
    """
    if options.wavelength_nm is not None:
        raise FileError(table.path, "states its wavelengths", hint="Leave wavelength_nm out")
    table = _selected(table, options)
    units = _units(table, options)
    values = _without_gaps(table, options) * units.scale
    if units.quantity == "reflectance":
        check_reflectances(table.path, float(values.max()), bright_count(values), values.size)
    rows, cols, places = _layout(table, options)
    names, values = tuple(table.names[k] for k in places), values[places]
    title = table.title or table.path.stem
    if units.quantity == "reflectance":
        what = "has reflectances, which need an illuminant and a luminance"
        options.require(table.path, what, illuminant="D65", mean_luminance_cd_m2=100)
        assert options.illuminant is not None
        light: str | float | Spectrum = options.illuminant
    else:
        light = _even_light(table, units, options)
    if not values.any():
        raise FileError(table.path, "has no light: all values are 0")
    try:
        chart = reflectance_chart(values, table.wavelength_nm, rows=rows, cols=cols, names=names, name=title).under(
            light,
            1.0 if options.mean_luminance_cd_m2 is None else options.mean_luminance_cd_m2,
            distance_m=options.distance_m or DEFAULT_DISTANCE_M,
            width_m=options.width_m,
        )
    except InputError as error:
        raise error.in_file(table.path) from None
    if units.quantity == "reflectance":
        return chart
    chart = replace(chart, reflectance=None, name=title)
    if options.mean_luminance_cd_m2 is not None:
        return chart
    # Charts are drawn to a luminance; scale back to the measured radiance.
    brightest = int(values.sum(axis=1).argmax())
    region = chart.regions[brightest]
    measured = values[brightest] * _photons(units, table.wavelength_nm)
    return chart.scaled(float(measured.sum() / chart.radiance(region.r0, region.c0).sum()))


def patch_table(scene: Scene, path: Path) -> PatchTable:
    """Return the named patches of a scene, to be written: mean reflectance where it is known, else energy radiance."""
    if not scene.regions:
        hint = "Write it as an image (.h5, .exr)"
        raise FileError(path, f"cannot be written: the scene '{scene.name}' has no patches", hint=hint)
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
        what = f"only the means of uneven patches are written (up to {uneven:.1%} RMS within one)"
        warnings.warn(PhotositeWarning(what, where=str(path), hint="Write .h5 to keep the scene"), stacklevel=3)
    across = {part.c0 for part in scene.regions}
    names = tuple(part.name for part in scene.regions)
    title = scene.name.split(", illuminant ")[0] if units.quantity == "reflectance" else scene.name
    return PatchTable(path, names, scene.wavelength_nm, np.array(means) @ basis, units, len(across), title)


def _unevenness(scene: Scene, part: Region) -> float:
    """Return the RMS difference of the radiance from a patch's mean, relative to the mean."""
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
    outliers = np.argwhere(table.values > _BRIGHTEST_FRACTION)
    if brightest > _DARKEST_PERCENT and len(outliers) < _OUTLIER_FRACTION * table.values.size:
        patch, band = np.unravel_index(int(np.nanargmax(table.values)), table.values.shape)
        raise FileError(
            table.path,
            f"has an outlier, {brightest:g}, where nearly all values are below {_BRIGHTEST_FRACTION:g}",
            where=_place(table, patch, band),
            hint="Correct it, or pass {units} if all are percent",
            arguments={"units": "percent"},
        )
    if brightest > _DARKEST_PERCENT:
        return Units("reflectance", 0.01)
    if brightest <= _BRIGHTEST_FRACTION and len(table.values) >= _CHART_OF:
        return Units("reflectance")
    raise FileError(
        table.path,
        f"does not state whether its values, up to {brightest:g}, are percent or fractions",
        hint="Pass {units}, 'reflectance', or the units of a radiance",
        arguments={"units": "percent"},
    )


def _place(table: PatchTable, patch: np.intp, band: np.intp) -> str:
    return f"patch '{table.names[patch]}' at {table.wavelength_nm[band]:g} nm"


def _selected(table: PatchTable, options: ReadOptions) -> PatchTable:
    """Return the wanted bands, in order of wavelength."""
    wanted = within_range(table.wavelength_nm, options.band_range_nm)
    if not wanted.any():
        raise FileError(table.path, "has no wavelength in band_range_nm", hint="Choose another range")
    grid, values = table.wavelength_nm[wanted], table.values[:, wanted]
    order = band_order(str(table.path), grid, sort=options.sort_bands)
    return replace(table, wavelength_nm=grid[order], values=values[:, order])


def _without_gaps(table: PatchTable, options: ReadOptions) -> NDArray[np.float64]:
    """Return the values; missing and negative ones are 0 where the options allow it, with a warning."""
    below, gaps = table.values < 0, np.isnan(table.values)
    for wrong, option, replacement, what in (
        (below, "negative", options.negative, "negative"),
        (gaps, "no_data", options.no_data, "missing"),
    ):
        if wrong.any() and replacement != "zero":
            patch, band = np.argwhere(wrong)[0]
            raise FileError(
                table.path,
                f"has a {what} value, {table.values[patch, band]:g}",
                where=_place(table, patch, band),
                hint=f"Measure it again, or pass {{{option}}} to replace such values by 0",
                arguments={option: "zero"},
            )
    counts = ((int(gaps.sum()), "missing"), (int(below.sum()), "negative"))
    if changed := " and ".join(f"{count} {what}" for count, what in counts if count):
        warnings.warn(PhotositeWarning(f"{changed} values are set to 0", where=str(table.path)), stacklevel=2)
    return np.where(below | gaps, 0.0, table.values)


def _layout(table: PatchTable, options: ReadOptions) -> tuple[int, int, list[int]]:
    """Return rows, columns, and the indices of the patches row by row."""
    count = len(table.names)
    in_order = list(range(count))
    if options.patch_cols is not None:
        return -(-count // options.patch_cols), options.patch_cols, in_order
    cols = min(count, table.cols or math.ceil(math.sqrt(1.5 * count)))
    found = [re.fullmatch(r"([A-Za-z]{1,2}) ?0*(\d{1,3})", name) for name in table.names]
    if count > 1 and all(found):
        places = [((len(m[1]), m[1].upper()), int(m[2])) for m in found if m is not None]
        downs, acrosses = {place[0] for place in places}, {place[1] for place in places}
        if len(set(places)) == count == len(downs) * len(acrosses):
            in_order = sorted(in_order, key=places.__getitem__)
            if table.cols is not None or count <= _LONGEST_ROW or 1 not in (len(downs), len(acrosses)):
                return len(downs), len(acrosses), in_order
            names = f"{table.names[in_order[0]]} to {table.names[in_order[-1]]}"
            warnings.warn(
                PhotositeWarning(
                    f"the names of the {count} patches, {names}, define no rows; they are placed {cols} across",
                    where=str(table.path),
                    hint="Pass {patch_cols} to choose the number",
                    arguments={"patch_cols": cols},
                ),
                stacklevel=2,
            )
    return -(-count // cols), cols, in_order


def _photons(units: Units, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    ones = np.ones(grid.size)
    return ones if units.quantity == "photon radiance" else photons_from_energy(ones, grid)


def _even_light(table: PatchTable, units: Units, options: ReadOptions) -> Spectrum:
    """Return a light under which a chart of these reflectances has the measured radiances."""
    if options.illuminant is not None:
        raise FileError(table.path, "has radiances, which include their light", hint="Leave the illuminant out")
    if units.quantity == "relative":
        what = "has relative values, which need a luminance"
        options.require(table.path, what, ", or the units of a radiance", mean_luminance_cd_m2=100)
    energy = _photons(units, table.wavelength_nm) / photons_from_energy(1.0, table.wavelength_nm)
    return Spectrum(table.wavelength_nm, energy)


def checked_names(path: Path, names: list[str], lines: list[int]) -> tuple[str, ...]:
    """Return the names of patches, once all are different."""
    seen: dict[str, int] = {}
    for name, line in zip(names, lines, strict=True):
        if name in seen:
            hint = "Average them, or rename one"
            raise FileError(path, f"patch '{name[:40]}' is in line {seen[name]} too", line, hint=hint)
        seen[name] = line
    return tuple(names)
