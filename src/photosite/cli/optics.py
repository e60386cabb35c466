"""`photosite optics`: check and describe optics files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli.command import Group
from photosite.cli.options import json_option
from photosite.cli.output import print_json, table
from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.optics.lens import Lens

_FREQUENCIES_PER_MM = (10.0, 20.0, 40.0, 80.0, 160.0)
_SHARES_OF_FIELD = (0.5, 0.7, 1.0)
_OF_FIELD = ("frequency_per_mm", "tangential", "sagittal")
"""To the right of the axis, tangential is along the rows."""


@click.group("optics", cls=Group)
def command() -> None:
    """Check optics files.

    Example: photosite optics check mine.optics.yaml
    """


@command.command("check")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--distance",
    "distance_m",
    type=float,
    metavar="M",
    help="Object distance in m.  [default: focus distance, or infinity]",
)
@click.option(
    "--wavelength", "wavelength_nm", type=float, default=550.0, metavar="NM", help="Wavelength of the MTF in nm."
)
@json_option
def check(file: Path, distance_m: float | None, wavelength_nm: float, as_json: bool) -> None:
    """Check an optics file and print the MTF.

    The exit status is 0 if the file describes a lens, otherwise 2 with the line and the reason.

    FILE may also be the ISETPARMS.txt of a ray trace by ISET's macros, or its folder (docs/optics.md).

    Prints the parts of the lens, and the MTF on the axis at a few frequencies on the sensor, along rows and columns.
    For lens-design data, also prints wavelengths, field points, modes, the error of their sum, and the MTF at points to
    the right of the axis: tangential (detail along the radius) and sagittal.

    Example: photosite optics check mine.optics.yaml --distance 2
    """
    from photosite.optics.checks import camera_wavelengths
    from photosite.optics.io.formats import load_optics

    if not 0 < wavelength_nm < math.inf:
        raise InputError("wavelength_nm", value=wavelength_nm, expected="above 0")
    camera_wavelengths([wavelength_nm])
    lens = load_optics(file)
    if distance_m is None:
        distance_m = math.inf if lens.focus_distance_m is None else lens.focus_distance_m
    facts = {"file": str(file), **_facts(lens), "distance_m": distance_m if math.isfinite(distance_m) else None}
    spread = lens.point_spread(distance_m)
    mtf = _mtf(spread, wavelength_nm)
    design = _design(lens, spread, wavelength_nm)
    if as_json:
        names = ("frequency_per_mm", "along_rows", "along_columns")
        columns = {name: list(column) for name, column in zip(names, zip(*mtf, strict=True), strict=True)}
        more = {} if design is None else {"lens_design": design}
        print_json({**facts, **more, "mtf": {"wavelength_nm": wavelength_nm, **columns}})
        return
    click.echo(
        f"{file}: describes {facts['name'] or 'a lens'}: f/{facts['f_number']:g}, {facts['focal_length_mm']:g} mm; "
        f"blur: {facts['blur']}; holds: {', '.join(facts['holds']) or 'nothing else'}"
    )
    if design is not None:
        click.echo(_design_text(design))
    where = f"an object at {distance_m:g} m" if math.isfinite(distance_m) else "an object at infinity"
    click.echo(f"\nMTF on the axis at {wavelength_nm:g} nm, {where}:\n")
    heading = ("cycles/mm", "along rows", "along columns")
    click.echo(table([heading, *((f"{f:g}", f"{x:.3f}", f"{y:.3f}") for f, x, y in mtf)], ">>>"))
    if design is not None and design["mtf_over_field"]:
        click.echo("\nMTF to the right of the axis, tangential and sagittal:\n")
        click.echo(_field_table(design["mtf_over_field"]))


def _facts(lens: Lens) -> dict[str, Any]:
    from photosite.color.spectrum import Spectrum

    base, blur = lens.base, lens.blur
    holds = {
        "a transmittance": isinstance(base.transmittance, Spectrum) or base.transmittance != 1,
        "cos4 falloff": base.falloff == "cos4",
        "a fixed focus": lens.focus_distance_m is not None,
        "relative illumination": lens.illumination is not None,
        "distortion": lens.distortion is not None,
        "lateral colour": lens.lateral_color is not None,
        "veiling glare": lens.veiling_glare is not None,
    }
    return {
        "name": lens.name,
        "f_number": base.f_number,
        "focal_length_mm": base.focal_length_mm,
        "blur": "diffraction" if blur is None else _KINDS.get(type(blur).__name__, type(blur).__name__),
        "holds": [name for name, there in holds.items() if there],
    }


_KINDS = {"Wavefront": "wavefront", "OtfTable": "otf", "PsfTable": "psf", "LensDesign": "lens_design"}
"""Kinds of blur as optics files name them."""


def _design(lens: Lens, spread: Any, wavelength_nm: float) -> dict[str, Any] | None:
    """Return the properties of lens-design data; None for other lenses."""
    import numpy as np

    from photosite.optics.lens_design import LensDesign
    from photosite.optics.point_spread import FieldPsf

    if not isinstance(design := lens.blur, LensDesign):
        return None
    over_field = []
    if isinstance(spread, FieldPsf):
        farthest_m = float(spread.x_m[-1])
        for share in _SHARES_OF_FIELD if farthest_m > 0 else ():
            found = _mtf(spread, wavelength_nm, share * farthest_m)
            columns = {name: [row[k] for row in found] for k, name in enumerate(_OF_FIELD)}
            over_field.append({"height_mm": share * farthest_m * 1e3, **columns})
    field = np.stack([design.field_x, design.field_y], axis=1)
    return {
        "wavelength_nm": design.wavelength_nm.tolist(),
        "field_xy": field.tolist(),
        "field_unit": design.unit,
        "spacing_um": float(design.spacing_um),
        "samples": int(design.psf.shape[-1]),
        "symmetric": bool(design.symmetric),
        "modes": len(spread.modes) if isinstance(spread, FieldPsf) else 1,
        "relative_error": spread.relative_error if isinstance(spread, FieldPsf) else 0.0,
        "detail_um": design.detail_um,
        "mtf_over_field": over_field,
    }


def _design_text(design: dict[str, Any]) -> str:
    waves, field, unit = design["wavelength_nm"], design["field_xy"], design["field_unit"]
    farthest = max(math.hypot(x, y) for x, y in field)
    blurred = "" if design["detail_um"] is None else f", blurred by pixels of {design['detail_um']:g} um"
    kind = "along a radius" if design["symmetric"] else "on a grid"
    size, spacing, error = design["samples"], design["spacing_um"], design["relative_error"]
    return (
        f"PSFs: {_many(len(waves), 'wavelength')}, {', '.join(f'{w:g}' for w in waves)} nm; "
        f"{_many(len(field), 'field point')} {kind} to {farthest:.4g} {unit}; "
        f"{size} x {size} samples {spacing:g} um apart; "
        f"{_many(design['modes'], 'mode')}, RMS error of their sum {error:.2%}{blurred}"
    )


def _many(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _field_table(over_field: list[dict[str, Any]]) -> str:
    """Return a table with tangential and sagittal columns for each height."""
    heading = ["cycles/mm"]
    for at in over_field:
        heading += [f"{at['height_mm']:.3g} mm T", "S"]
    rows = [heading]
    for k, frequency in enumerate(_FREQUENCIES_PER_MM):
        values = [at[name][k] for at in over_field for name in ("tangential", "sagittal")]
        rows.append([f"{frequency:g}", *(f"{value:.3f}" for value in values)])
    return table(rows, ">" * len(heading))


def _mtf(spread: Any, wavelength_nm: float, right_m: float = 0.0) -> list[tuple[float, float, float]]:
    """Return frequency per mm, MTF along rows and MTF along columns, at a distance to the right of the axis."""
    import numpy as np

    from photosite.optics.point_spread import FieldPsf, PlanePsf, RadialPsf

    f = np.array(_FREQUENCIES_PER_MM) * 1e3
    zero = np.zeros(f.size)

    def plane(of: PlanePsf) -> Any:
        """(2, frequencies)"""
        # Tables are linear between their wavelengths.
        grid = np.array([wavelength_nm]) if of.wavelength_nm is None else np.asarray(of.wavelength_nm)
        shares = [float(np.interp(wavelength_nm, grid, unit)) for unit in np.eye(grid.size)]
        used = [(share, float(w)) for share, w in zip(shares, grid, strict=True) if share]
        return sum(share * np.stack([of.otf(zero, f, w), of.otf(f, zero, w)]) for share, w in used)

    if isinstance(spread, RadialPsf):
        both = np.stack([spread.otf(f, wavelength_nm)] * 2)
    elif isinstance(spread, FieldPsf):
        both = sum(
            _weight(spread, weights, right_m) * plane(mode)
            for weights, mode in zip(spread.weights, spread.modes, strict=True)
        )
    else:
        both = plane(spread)
    return [(per_mm, float(x), float(y)) for per_mm, x, y in zip(_FREQUENCIES_PER_MM, *np.abs(both), strict=True)]


def _weight(spread: Any, weights: Any, right_m: float) -> float:
    """Return the weight of a mode at a distance to the right of the axis, linear between nodes."""
    import numpy as np

    along = [np.interp(right_m, spread.x_m, row) for row in weights]
    return float(np.interp(0.0, spread.y_m, along))
