"""`photosite dataset`: pairs of clean and noisy frames in a folder of shards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, many, say_if_compiling, show
from photosite.errors import FileError, InputError
from photosite.values.exposure import format_exposure

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor
    from photosite.training.light import Source


def _crop(text: str) -> tuple[int, int]:
    """Parse ROWSxCOLS."""
    rows, _, cols = text.lower().partition("x")
    if not (rows.isdigit() and cols.isdigit() and int(rows) and int(cols)):
        raise click.BadParameter(f"must be ROWSxCOLS, such as 512x512, got '{text}'")
    return int(rows), int(cols)


def _range_of(parse: Callable[[str], float]) -> Callable[[str], float | tuple[float, float]]:
    def parsed(text: str) -> float | tuple[float, float]:
        low, sign, high = text.partition(":")
        return (parse(low), parse(high)) if sign else parse(low)

    return parsed


_SETTINGS_OF = {
    "scenes": (
        *("illuminants", "white_luminance_cd_m2", "samples_per_pixel", "no_lens_blur"),
        *("optics_file", "f_number", "focal_length_mm"),
    ),
    "raw": ("input_sensor", "averaged"),
}
"""Parameters that apply to one kind of inputs."""

_number, _time = _range_of(options.above()), _range_of(options.exposure_time)


@click.command("dataset", cls=Command)
@click.argument("inputs", nargs=-1, required=True, metavar="NAME|FILE...")
@click.option(
    "--inputs-are",
    "kind",
    type=click.Choice(["scenes", "raw", "electrons"]),
    default="scenes",
    help="What the inputs are: pictures, scene files and built-in scenes; linear raw frames; .npy arrays of electrons.",
)
@options.sensor_option("nikon-d200")
@click.option(
    "--gain-setting",
    "gain_settings",
    type=options.above(),
    multiple=True,
    metavar="ISO",
    help="Gain setting of a sensor file with several; repeatable: patches get one by chance.",
)
@click.option(
    "--chips",
    type=options.Whole(1, 10_000),
    default=1,
    metavar="N",
    help="Chips with different fixed patterns, of which patches get one by chance; their serials are 0 to N-1.",
)
@options.size_options()
@options.black_level_option("; by default the sensor's")
@click.option("--input-sensor", metavar="NAME|FILE", help="Sensor of raw inputs, instead of their noise profiles.")
@click.option("--averaged", type=options.Whole(1), default=1, metavar="N", help="Exposures averaged in each raw input.")
@click.option("--crop", type=_crop, default="512x512", metavar="ROWSxCOLS", help="Size of a patch in pixels.")
@click.option("--crops", type=options.Whole(1), default=16, metavar="N", help="Patches of each input.")
@click.option("--draws", type=options.Whole(1), default=1, metavar="N", help="Noisy frames of each patch.")
@click.option("--light", type=_number, default="1", metavar="X[:X]", help="Factor on the light, or a range: 0.05:1.")
@click.option(
    "--exposure",
    "exposure_s",
    type=_time,
    default="1/100",
    metavar="TIME[:TIME]",
    help="Exposure time, or a range: 1/1000:1/30. For raw inputs and electrons, that of the dark current.",
)
@click.option("--flips", is_flag=True, help="Reverse rows and columns of half the patches; the filter array stays.")
@click.option("--unit", type=click.Choice(["dn", "electrons"]), default="dn", help="Unit of both frames.")
@click.option(
    "--illuminant", "illuminants", multiple=True, metavar="NAME", help=f"{options.ILLUMINANT_HELP} Repeatable."
)
@options.quantity(
    "--white", "white_luminance_cd_m2", unit="CD/M2", default=100.0, text="Luminance of display white in pictures."
)
@click.option(
    "--samples-per-pixel",
    type=_number,
    default="1",
    metavar="X[:X]",
    help="Samples of a scene across a pixel, or a range; 2 and more average the noise of a picture.",
)
@click.option("--no-lens-blur", is_flag=True, help="Give each pixel its nearest sample, without blur and crosstalk.")
@options.path_option("--optics", "optics_file", text="Optics file (YAML).")
@options.lens_options(late=True)
@options.seed_option()
@click.option(
    "--format", "shard_format", type=click.Choice(["hdf5", "webdataset"]), default="hdf5", help="Files of the shards."
)
@click.option("--pairs-per-shard", type=options.Whole(1), default=64, metavar="N", help="Pairs in a file.")
@options.workers_options()
@click.option("--license", default="", metavar="TEXT", help="License of the inputs, for the data card.")
@options.folder_option(options.shared_folder, "Folder to write; an interrupted dataset is resumed.")
@options.json_option
def command(
    inputs: tuple[str, ...], kind: str, output: Path, pairs_per_shard: int, as_json: bool, **given: Any
) -> None:
    """Write pairs of clean and noisy raw frames for training, in shards with a manifest and a data card.

    A pair is a function of the settings and the seed. If the command is interrupted, the same command goes on where it
    stopped; shards appear whole or not at all, and the files are the same.

    \b
    Example: photosite dataset photos/*.jpg --sensor vendor-2.2um --crop 256x256 --exposure 1/1000:1/30 -o pairs
    Example: photosite dataset clean/*.dng --inputs-are raw --sensor mine.sensor.yaml --light 0.01:0.1 -o pairs
    """
    from photosite.cli.memory_need import dataset_bytes, warn_if_short
    from photosite.training.dataset import PairDataset
    from photosite.training.shards import CARD, write_shards

    for of_kind, settings in _SETTINGS_OF.items():
        if of_kind != kind:
            options.only_for(f"--inputs-are {of_kind}", *settings)
    names = ("crop", "crops", "draws", "light", "exposure_s", "flips", "unit", "seed")
    dataset = PairDataset(_source(kind, inputs, given), _sensors(given), **{name: given[name] for name in names})
    processes = given["processes"]
    need = dataset_bytes(dataset.shape[0] * dataset.shape[1], processes)
    warn_if_short(f"a data set with --processes {processes}", need, "Use fewer --processes, or a smaller --crop")
    say_if_compiling()
    progress, written = Stages(), []

    def report(done: int, count: int) -> None:
        written.append(done)
        progress(done, count, unit="shards")

    how = {name: given[name] for name in ("shard_format", "processes", "scheduler", "license")}
    manifest = write_shards(dataset, output, pairs_per_shard=pairs_per_shard, report=report, **how)
    facts = {
        "path": output,
        "manifest": manifest,
        "card": output / CARD,
        "pairs": len(dataset),
        "shards": -(-len(dataset) // pairs_per_shard),
        "shards_written": len(written),
        "rows": dataset.shape[0],
        "cols": dataset.shape[1],
        "seed": given["seed"],
    }
    show(as_json, facts, lambda: _text(facts, given))


def _text(facts: dict[str, Any], given: dict[str, Any]) -> str:
    times = given["exposure_s"] if isinstance(given["exposure_s"], tuple) else (given["exposure_s"],)
    written, shards = facts["shards_written"], many(facts["shards"], "shard")
    done = "wrote" if written == facts["shards"] else f"wrote {written} of {shards}, checked the others:"
    return (
        f"{done if written else 'checked'} {many(facts['pairs'], 'pair')} of {facts['rows']} x {facts['cols']} pixels "
        f"in {shards} {'to' if written else 'in'} {facts['path']}: "
        f"{' to '.join(map(format_exposure, times))} s, seed {facts['seed']}"
    )


def _sensors(given: dict[str, Any]) -> list[Sensor]:
    from photosite.sensor.io.sensor_file import load_sensor

    changes = {name: given[name] for name in ("rows", "cols", "black_level_dn") if given[name] is not None}
    base = load_sensor(given["sensor_name"]).with_(**changes)
    at_settings = [base.at_gain_setting(setting) for setting in given["gain_settings"]] or [base]
    chips = given["chips"]
    if chips > 1 and base.maps is not None:
        hint = "Omit {chips}: the maps are those of one chip"
        raise InputError("chips", value=chips, expected="1 for measured maps", hint=hint, arguments={"chips": 1})
    return [
        sensor.with_(serial=str(number)) if chips > 1 else sensor for sensor in at_settings for number in range(chips)
    ]


def _source(kind: str, inputs: tuple[str, ...], given: dict[str, Any]) -> Source:
    if kind == "electrons":
        from photosite.training.light import Electrons

        return Electrons(inputs)
    if kind == "raw":
        from photosite.sensor.io.sensor_file import load_sensor
        from photosite.training.light import RawFrames

        sensor = None if given["input_sensor"] is None else load_sensor(given["input_sensor"])
        return RawFrames(inputs, sensor, given["averaged"])
    from photosite.training.scenes import Scenes

    if arrays := [name for name in inputs if name.lower().endswith(".npy")]:
        hint = "Add --inputs-are electrons for arrays of mean electrons"
        raise FileError(arrays[0], "an array of numbers is not a scene", hint=hint)
    names = ("samples_per_pixel", "illuminants", "white_luminance_cd_m2")
    settings = {name: given[name] for name in names}
    return Scenes(inputs, _optics(given), lens_blur=not given["no_lens_blur"], **settings)


def _optics(given: dict[str, Any]) -> Any:
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.optics.io.formats import load_optics

    numbers = {name: given[name] for name in ("f_number", "focal_length_mm") if given[name] is not None}
    if given["optics_file"] is None:
        return DiffractionLimited(**{"f_number": 8.0, "focal_length_mm": 50.0} | numbers)
    if numbers:
        name, value = next(iter(numbers.items()))
        hint = f"Omit {{{name}}}, or change the file"
        raise InputError("the optics file defines the lens", hint=hint, arguments={name: value})
    return load_optics(given["optics_file"])
