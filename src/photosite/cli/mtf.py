"""`photosite mtf`: sharpness from a slanted edge in a raw frame."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import show, table

if TYPE_CHECKING:
    from photosite.metrics.sharpness.slanted_edge import SlantedEdge

_SHOWN_CYCLES_PER_PIXEL = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.75, 1.0)


def _region(text: str) -> tuple[int, int, int, int]:
    """Parse R0,R1,C0,C1."""
    try:
        r0, r1, c0, c1 = (int(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"must be rows and columns R0,R1,C0,C1, such as 400,700,900,1100, got '{text}'"
        ) from None
    return r0, r1, c0, c1


@click.command("mtf", cls=Command)
@click.argument("raw", type=click.Path(path_type=Path))
@click.option(
    "--region",
    type=_region,
    metavar="R0,R1,C0,C1",
    help="Rows R0 to R1 and columns C0 to C1, ends excluded, divided by one edge.  [default: the whole frame]",
)
@click.option(
    "--channel", metavar="NAME", help="Channel to measure.  [default: G; the only channel of a monochrome frame]"
)
@options.quantity("--pitch", "pitch_um", unit="UM", text="Pixel pitch in um, for frequencies in cycles/mm.")
@click.option("--oversampling", type=options.Whole(1, 16), default=4, help="Bins of the edge profile per pixel.")
@click.option(
    "--window",
    type=click.Choice(["tukey", "hamming"]),
    default="tukey",
    help="Window on the line spread function; hamming is that of ISO 12233:2014 and 2017.",
)
@options.sensor_option(text="Sensor that took the frame, for bits and mosaic that the file does not state.")
@options.black_level_option("; by default the file's")
@options.reading_options
@options.json_option
def command(
    raw: Path,
    region: tuple[int, int, int, int] | None,
    channel: str | None,
    pitch_um: float | None,
    oversampling: int,
    window: Any,
    black_level_dn: float | None,
    sensor_name: str | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Measure the modulation transfer function (MTF) on a slanted edge in a raw frame, without demosaicing.

    RAW is a raw frame in any format that is read. The edge must be straight, a few degrees off the vertical or
    horizontal, and reach from side to side of the region. The method is the e-SFR of ISO 12233, on the pixels of one
    channel. 0.5 cycles/pixel is the Nyquist frequency.

    \b
    Example: photosite mtf edge.dng --region 800,1800,1500,2400 --pitch 6.05
    with     photosite simulate --scene slanted-edge --cells 3 --exposure auto -o edge.dng
    """
    from dataclasses import replace

    from photosite.frames.io.formats import read_raw
    from photosite.metrics.sharpness.slanted_edge import slanted_edge_mtf

    frame = read_raw(raw, sensor=options.sensor_or(None, sensor_name), **reading)
    if black_level_dn is not None:
        frame = replace(frame, black_level_dn=black_level_dn)
    if channel is None and "G" in frame.channels:
        channel = "G"
    edge = slanted_edge_mtf(frame, region, channel, pitch_um=pitch_um, oversampling=oversampling, window=window)
    show(as_json, _facts(edge), lambda: _text(edge))


def _facts(edge: SlantedEdge) -> dict[str, Any]:
    per_mm = None if edge.pitch_um is None else 1e3 / edge.pitch_um
    return {
        "channel": edge.channel,
        "direction": edge.direction,
        "angle_deg": edge.angle_deg,
        "mtf50_cycles_per_pixel": edge.mtf50,
        "mtf50_cycles_per_mm": None if edge.mtf50 is None or per_mm is None else edge.mtf50 * per_mm,
        "mtf50_standard_uncertainty_cycles_per_pixel": edge.mtf50_standard_uncertainty,
        "frequency_cycles_per_pixel": edge.frequency_cycles_per_pixel.tolist(),
        "frequency_cycles_per_mm": None if per_mm is None else edge.frequency_cycles_per_mm.tolist(),
        "mtf": edge.mtf.tolist(),
        "standard_uncertainty": edge.standard_uncertainty.tolist(),
    }


def _text(edge: SlantedEdge) -> str:
    import numpy as np

    from photosite.report.numbers import format_uncertain

    per_mm = None if edge.pitch_um is None else 1e3 / edge.pitch_um
    mtf50 = "MTF50 is above 1 cycle/pixel"
    if edge.mtf50 is not None and (spread := edge.mtf50_standard_uncertainty) is not None:
        mtf50 = f"MTF50 {format_uncertain(edge.mtf50, spread)} cycles/pixel"
        mtf50 += "" if per_mm is None else f", {format_uncertain(edge.mtf50 * per_mm, spread * per_mm)} cycles/mm"
    rows = [("cycles/pixel", *(() if per_mm is None else ("cycles/mm",)), "MTF")]
    frequencies = np.array(_SHOWN_CYCLES_PER_PIXEL)
    uncertainties = np.interp(frequencies, edge.frequency_cycles_per_pixel, edge.standard_uncertainty)
    for frequency, value, uncertainty in zip(frequencies, edge.at(frequencies), uncertainties, strict=True):
        shown = "1" if frequency == 0 else format_uncertain(float(value), float(uncertainty))
        rows.append((f"{frequency:g}", *(() if per_mm is None else (f"{frequency * per_mm:.4g}",)), shown))
    heading = f"channel {edge.channel}, edge {abs(edge.angle_deg):.2f} degrees off the {edge.direction}; {mtf50}"
    return f"{heading}\n\n{table(rows, '>' * len(rows[0]))}"
