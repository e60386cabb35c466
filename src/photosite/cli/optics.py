"""`photosite optics`: check and describe optics files, trace lens prescriptions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import many, show, table
from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.optics.lens import Lens

_FREQUENCIES_PER_MM = (10.0, 20.0, 40.0, 80.0, 160.0)
_SHARES_OF_FIELD = (0.5, 0.7, 1.0)
_KINDS = {"Wavefront": "wavefront", "OtfTable": "otf", "PsfTable": "psf", "LensDesign": "lens_design"}
"""Kinds of blur as optics files name them."""


@click.group("optics", cls=Group)
def command() -> None:
    """Check optics files, and trace lens prescriptions into them.

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
@options.json_option
def check(file: Path, distance_m: float | None, wavelength_nm: float, as_json: bool) -> None:
    """Check an optics file and print the MTF.

    The exit status is 0 if the file describes a lens, otherwise 2 with the line and the reason.

    FILE may also be the ISETPARMS.txt of a ray trace by ISET's macros, or its folder (docs/howto/optics.md).

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
    spread = lens.point_spread(distance_m)
    facts = {"file": file, **_facts(lens), "distance_m": distance_m if math.isfinite(distance_m) else None}
    design = _design(lens, spread, wavelength_nm)
    if design is not None:
        facts["lens_design"] = design
    mtf = _mtf(spread, wavelength_nm)
    facts["mtf"] = {"wavelength_nm": wavelength_nm, **_columns(mtf, "along_rows", "along_columns")}
    where = f"an object at {distance_m:g} m" if math.isfinite(distance_m) else "an object at infinity"
    blocks = [
        f"{file}: describes {facts['name'] or 'a lens'}: f/{facts['f_number']:g}, {facts['focal_length_mm']:g} mm; "
        f"blur: {facts['blur']}; holds: {', '.join(facts['holds']) or 'nothing else'}"
        + ("" if design is None else f"\n{_design_text(design)}"),
        f"MTF on the axis at {wavelength_nm:g} nm, {where}:",
        table([("cycles/mm", "along rows", "along columns"), *_rows(*zip(*mtf, strict=True))], ">>>"),
    ]
    if design is not None and design["mtf_over_field"]:
        heading, columns = ["cycles/mm"], [_FREQUENCIES_PER_MM]
        for at in design["mtf_over_field"]:
            heading += [f"{at['height_mm']:.3g} mm T", "S"]
            columns += [at["tangential"], at["sagittal"]]
        blocks.append("MTF to the right of the axis, tangential and sagittal:")
        blocks.append(table([heading, *_rows(*columns)], ">" * len(heading)))
    show(as_json, facts, lambda: "\n\n".join(blocks))


@command.command("trace")
@click.argument("file", type=click.Path(path_type=Path))
@options.file_option("-o", "--output", suffixes=(".yaml", ".yml"), text="Optics file to write (YAML).", required=True)
@options.file_option("--page", suffixes=(".html", ".pdf"), text="Page of layout, spots, MTF and distortion to write.")
@options.option("--fields", type=int, metavar="N", default=6, help="Field points from the axis to the corner.")
@options.json_option
def trace(file: Path, output: Path, page: Path | None, fields: int, as_json: bool) -> None:
    """Trace a lens prescription into an optics file: PSFs, distortion, lateral color, illumination and vignetting.

    FILE is Zemax .zmx, CODE V .seq, or a plain table (docs/howto/lens-designs.md). Needs rayoptics, the extra `lenses`.

    Example: photosite optics trace lens.zmx -o lens.optics.yaml --page lens.html
    """
    import numpy as np

    from photosite.cli.output import Stages
    from photosite.optics.trace import trace_lens

    stages = Stages()
    traced = trace_lens(file, fields=fields, progress=stages)
    traced.lens.save(output)
    if page is not None:
        from photosite.report.lens import lens_page
        from photosite.report.write import write_report

        write_report(lens_page(traced), page)
    lens, reference = traced.lens, traced.reference
    rows = [
        {
            "field_deg": float(angle),
            "height_mm": float(np.hypot(*row[reference].chief)),
            "distortion_percent": None if np.isnan(distortion) else float(distortion),
            "illumination": None if lens.illumination is None else float(lens.illumination.relative[k]),
            "rms_spot_um": row[reference].spot_radius_mm * 1e3,
        }
        for k, (angle, distortion, row) in enumerate(
            zip(traced.field_deg, traced.distortion_percent, traced.bundles, strict=True)
        )
    ]
    facts = {"focal_length_mm": lens.base.focal_length_mm, "f_number": lens.base.f_number, "name": lens.name}
    content = {**facts, "wavelength_nm": traced.wavelength_nm.tolist(), "fields": rows}

    def text() -> str:
        heading = ("field, degrees", "height, mm", "distortion, %", "illumination", "RMS spot, um")
        shown = [tuple("" if value is None else f"{value:.4g}" for value in row.values()) for row in rows]
        head = f"{lens.name}: {lens.base.focal_length_mm:.5g} mm, f/{lens.base.f_number:.4g}"
        return f"{head}\n{table([heading, *shown], '>>>>>')}"

    show(as_json, content, text, optics=output)


def _columns(mtf: list[tuple[float, float, float]], rows: str, columns: str) -> dict[str, list[float]]:
    return dict(zip(("frequency_per_mm", rows, columns), map(list, zip(*mtf, strict=True)), strict=True))


def _rows(frequencies: Iterable[float], *columns: Iterable[float]) -> list[tuple[str, ...]]:
    return [(f"{f:g}", *(f"{value:.3f}" for value in row)) for f, *row in zip(frequencies, *columns, strict=True)]


def _facts(lens: Lens) -> dict[str, Any]:
    from photosite.color.spectrum import Spectrum

    base, blur = lens.base, lens.blur
    holds = {
        "a transmittance": isinstance(base.transmittance, Spectrum) or base.transmittance != 1,
        "cos4 falloff": base.falloff == "cos4",
        "a fixed focus": lens.focus_distance_m is not None,
        "relative illumination": lens.illumination is not None,
        "distortion": lens.distortion is not None,
        "lateral color": lens.lateral_color is not None,
        "veiling glare": lens.veiling_glare is not None,
    }
    return {
        "name": lens.name,
        "f_number": base.f_number,
        "focal_length_mm": base.focal_length_mm,
        "blur": "diffraction" if blur is None else _KINDS.get(type(blur).__name__, type(blur).__name__),
        "holds": [name for name, there in holds.items() if there],
    }


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
            # To the right of the axis, tangential is along the rows.
            columns = _columns(_mtf(spread, wavelength_nm, share * farthest_m), "tangential", "sagittal")
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
        f"PSFs: {many(len(waves), 'wavelength')}, {', '.join(f'{w:g}' for w in waves)} nm; "
        f"{many(len(field), 'field point')} {kind} to {farthest:.4g} {unit}; "
        f"{size} x {size} samples {spacing:g} um apart; "
        f"{many(design['modes'], 'mode')}, RMS error of their sum {error:.2%}{blurred}"
    )


def _mtf(spread: Any, wavelength_nm: float, right_m: float = 0.0) -> list[tuple[float, float, float]]:
    """Return frequency per mm, MTF along rows and MTF along columns, at a distance to the right of the axis."""
    import numpy as np

    from photosite.optics.point_spread import otf_at

    f = np.array(_FREQUENCIES_PER_MM) * 1e3
    zero = np.zeros(f.size)
    rows, cols = (np.abs(otf_at(spread, fy, fx, wavelength_nm, x_m=right_m)) for fy, fx in ((zero, f), (f, zero)))
    return [(per_mm, float(x), float(y)) for per_mm, x, y in zip(_FREQUENCIES_PER_MM, rows, cols, strict=True)]
