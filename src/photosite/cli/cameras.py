"""`photosite cameras`: list and show cameras from profile files, compare camera files, check contributed cameras."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import listed, say, show, table, tabular
from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.library.profile import CameraProfile
    from photosite.library.sources import CameraSource

_profiles_option = click.option(
    "--profiles",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="File or folder with cameras: darktable's noiseprofiles.json, rawtoaces' JSON or CSV, an index of contributed "
    "cameras; may be repeated.  [default: the environment variable PHOTOSITE_PROFILES, and the places where darktable "
    "and rawtoaces install theirs]",
)


@click.group("cameras", cls=Group, invoke_without_command=True)
@click.pass_context
def command(context: click.Context) -> None:
    """List cameras by name with noise profiles, spectral sensitivities and measurements, from files that you have.

    photosite ships no such file. It reads darktable's noise profiles (noiseprofiles.json), rawtoaces' spectral
    sensitivities (JSON, CSV) and cameras that others contributed with `photosite calibrate --contribute`.

    Example: photosite cameras list --profiles noiseprofiles.json
    """
    if context.invoked_subcommand is None:
        context.invoke(list_, query=(), profiles=(), as_json=False)


@command.command("list")
@click.argument("query", nargs=-1)
@_profiles_option
@options.json_option
def list_(query: tuple[str, ...], profiles: tuple[Path, ...], as_json: bool) -> None:
    """List the cameras whose names contain all words of QUERY, with file, license and provenance.

    Example: photosite cameras list nikon d8 --profiles noiseprofiles.json
    """
    from photosite.frames.camera_names import nearest, searched
    from photosite.library.sources import find_cameras

    sources = find_cameras(profiles or None)
    names = [source.name for source in sources]
    asked = " ".join(query)
    found = [sources[k] for k in searched(asked, names)]
    if not found and sources:
        close = nearest(asked, names)
        hint = f"Did you mean {' or '.join(map(repr, close))}?" if close else "Without QUERY all are listed"
        raise InputError(f"no camera has '{asked}' in its name", hint=hint)
    show(as_json, {"cameras": [source.to_dict() for source in found]}, lambda: _list_text(found, profiles))


def _list_text(sources: list[CameraSource], profiles: tuple[Path, ...]) -> str:
    if not sources and profiles:
        from photosite.library.sources import LOOKED_FOR, entries_below

        below = entries_below(profiles)
        advice = f". Pass the folder of an entry, such as --profiles {below[0]}" if below else ""
        return f"no cameras in {', '.join(map(str, profiles))}: {LOOKED_FOR}{advice}"
    if not sources:
        return (
            "no files with cameras were found. Give some with --profiles or the environment variable "
            "PHOTOSITE_PROFILES; docs/howto/cameras.md lists the places that are searched"
        )
    files = list(dict.fromkeys(source.path for source in sources if source.kind != "contributed"))
    rows = [("camera", "kind", "ISO", "license", "provenance")]
    rows += [(source.name, source.kind, _isos(source.isos), source.license, source.provenance) for source in sources]
    return "\n\n".join([table(rows, "<<<<<"), *([listed("files:", map(str, files))] if files else [])])


def _isos(isos: tuple[float, ...]) -> str:
    if len(isos) < 2:
        return "".join(f"{iso:g}" for iso in isos)
    return f"{isos[0]:g} to {isos[-1]:g} ({len(isos)})"


@command.command("show")
@click.argument("name")
@options.quantity("--iso", unit="ISO", text="ISO speed, or gain setting.  [default: the only one]")
@_profiles_option
@click.option("--mono", is_flag=True, help="The camera has no color filters, for noise profiles that do not state it.")
@options.quantity(
    "--black-level", "black_level_dn", unit="DN", zero=True, text="Black level of the raw files, for noise profiles."
)
@options.quantity(
    "--white-level", "white_level_dn", unit="DN", text="White level of the raw files, for noise profiles."
)
@options.sensor_option(text="Sensor for all that the files do not contain. Required for -o.")
@options.file_option("-o", "--output", suffixes=options.SENSOR_SUFFIXES, text="Sensor file to write (YAML).")
@options.json_option
def show_camera(
    name: str, profiles: tuple[Path, ...], sensor_name: str | None, output: Path | None, as_json: bool, **stated: Any
) -> None:
    """Show what the files contain on a camera, and what is missing; with -o and --sensor, write a sensor file.

    Maker and model in any spelling. Between two ISO speeds of a noise profile, a and b are linear in ISO.

    Example: photosite cameras show "Nikon D850" --iso 6400 --profiles noiseprofiles.json
    """
    from photosite.library.profile import load_camera_profile
    from photosite.sensor.io.sensor_file import load_sensor

    if output is None:
        options.only_for("-o", "sensor_name")
    camera = load_camera_profile(name, profiles=profiles or None, **stated)
    if camera.measured is not None and sensor_name is not None:
        say("photosite: --sensor does not apply to a contributed camera, whose sensor file is complete")
    if output is not None:
        if sensor_name is None and camera.measured is None:
            raise click.UsageError("-o needs --sensor for what the files do not contain")
        base = load_sensor(sensor_name or "nikon-d200")
        camera.sensor(base).save(output)
        for diagnostic in (
            camera.noise.diagnostics(base) if camera.noise is not None and camera.measured is None else ()
        ):
            say(f"{diagnostic.id}: {diagnostic}")
    for note in camera.notes:
        say(note)
    show(as_json, _facts(camera), lambda: _camera_text(camera), sensor=output)


def _facts(camera: CameraProfile) -> dict[str, Any]:
    facts: dict[str, Any] = {"name": camera.name, "iso": camera.iso}
    if (noise := camera.noise) is not None:
        names = ("slope", "offset")
        facts["noise"] = {
            channel: {
                name: {"value": entry.value, "standard_uncertainty": entry.standard_uncertainty}
                for name, entry in zip(names, entries, strict=True)
            }
            for channel, *entries in zip(noise.channels, noise.slope, noise.offset, strict=True)
        }
        facts["electrons_at_white_95"] = list(camera.electrons_at_white_95)
        if noise.white_level_dn is not None:
            gain = noise.system_gain_dn_per_e
            facts["system_gain_dn_per_e"] = {"value": gain.value, "standard_uncertainty": gain.standard_uncertainty}
    if camera.spectra is not None:
        grid = camera.spectra.wavelength_nm
        facts["spectra"] = {"channels": list(camera.spectra.channels), "first_nm": grid[0], "last_nm": grid[-1]}
    facts["sources"] = [source.to_dict() for source in camera.sources]
    return {**facts, "missing": dict(camera.missing), "notes": list(camera.notes)}


def _camera_text(camera: CameraProfile) -> str:
    heading = camera.name + (f", ISO {camera.iso:g}" if camera.iso is not None else "")
    rows = []
    if (noise := camera.noise) is not None:
        slope, offset = noise.slope[0], noise.offset[0]
        low, high = camera.electrons_at_white_95
        rows += [
            (
                "slope",
                f"{slope.value:.4g}",
                f"{slope.standard_uncertainty:.2g}",
                "variance per signal, black 0, white 1",
            ),
            ("offset", f"{offset.value:.4g}", f"{offset.standard_uncertainty:.2g}", "variance in the dark"),
        ]
        if noise.white_level_dn is not None:
            gain = noise.system_gain_dn_per_e
            rows.append(("K, DN/e⁻", f"{gain.value:.4g}", f"{gain.standard_uncertainty:.2g}", "system gain"))
        ends = (f"{end:.4g}" if end < 1e4 else f"{float(f'{end:.4g}'):.0f}" for end in dict.fromkeys((low, high)))
        shown = " to ".join(ends)
        rows.append(("electrons at white", shown, "", "1 / slope" + ("" if low == high else ", 95 % interval")))
    if camera.spectra is not None:
        grid = camera.spectra.wavelength_nm
        span = f"{grid[0]:g} to {grid[-1]:g} nm"
        rows.append(("spectral sensitivity", span, "", f"relative, channels {', '.join(camera.spectra.channels)}"))
    facts = table([("", "value", "uncertainty", ""), *rows], "<>><")
    sources = [
        f"{source.kind}: {source.path}; license: {source.license}; provenance: {source.provenance}"
        for source in camera.sources
    ]
    missing = [f"{what}: {why}" for what, why in camera.missing.items()]
    return "\n\n".join([f"{heading}\n{facts}", listed("missing:", missing), listed("sources:", sources)])


@command.command("compare")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@options.exposure_option(text="Common exposure time in s, such as 0.01 or 1/15.", default="1/15")
@options.option("--illuminant", default="3200K", metavar="NAME", help=options.ILLUMINANT_HELP)
@options.luminance_option("Mean luminance of the chart's patches, in cd/m2.", default=40.0)
@options.distance_option("Distance from lens to chart, in m.", default=1.2)
@options.seed_option()
@options.values_option()
@options.json_option
def compare(files: tuple[Path, ...], as_json: bool, **conditions: Any) -> None:
    """Compare cameras in the same light: noise, dynamic range, sharpness, and the color error of a ColorChecker.

    FILE is a camera file (docs/formats/camera.md); its sensor, gain setting and lens are compared. Scene and exposure
    time are those of the options.

    Example: photosite cameras compare wide.camera.yaml tele.camera.yaml --exposure 1/60 --illuminant D65
    """
    from photosite.camera.file import load_camera
    from photosite.studies.camera_comparison import compare_cameras

    set_ups = [load_camera(file) for file in files]
    names = [set_up.name or str(file) for set_up, file in zip(set_ups, files, strict=True)]
    if len(set(names)) < len(names):
        raise InputError("name", value=names, expected="different for each camera file")
    cameras = {name: each.camera for name, each in zip(names, set_ups, strict=True)}
    found = compare_cameras(cameras, on_progress=say, **conditions)
    show(as_json, found.to_dict(), lambda: tabular(found))


@command.command("validate")
@click.argument("path", type=click.Path(path_type=Path))
@options.json_option
def validate(path: Path, as_json: bool) -> None:
    """Check contributed cameras: format, digests, license, plausible numbers, no personal data.

    PATH is an index (cameras.yaml), a folder with one, or an entry. The exit status is 0 if all entries are valid,
    otherwise 2 with the file, the line and the reason.

    Example: photosite cameras validate library
    """
    from photosite.library.contribute import validate_cameras

    found = validate_cameras(path)
    rows = [("camera", "license", "created", "frames", "folder")]
    rows += [
        (one.entry.camera, one.entry.license, one.entry.created, str(one.entry.frames), one.folder.name)
        for one in found
    ]
    content = {"path": path, "entries": [{**one.entry.model_dump(mode="json"), "folder": one.folder} for one in found]}
    show(as_json, content, lambda: f"{table(rows, '<<<><')}\n{path}: {len(found)} valid")


@command.command("schema")
@click.argument("form", metavar="FORMAT", type=click.Choice(["entry", "index", "table"]))
def schema(form: str) -> None:
    """Print the JSON Schema of a contributed camera's entry.yaml, of an index, or of the table emva1288.json.

    Example: photosite cameras schema entry
    """
    from photosite.library.entry import SCHEMAS

    click.echo(json.dumps(SCHEMAS[form].model_json_schema(), indent=2))
