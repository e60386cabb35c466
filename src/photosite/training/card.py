"""The data card: what a folder of pairs holds, for people who use it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from photosite.sensor.model import Sensor
from photosite.training.dataset import PairDataset
from photosite.values.cfa import tile_text
from photosite.values.exposure import format_exposure

_MOST_INPUTS = 50


def card_text(manifest: Mapping[str, Any], dataset: PairDataset) -> str:
    """Return the card in Markdown: counts, sensors, light, inputs with their license, and how to make it again."""
    settings, source = manifest["dataset"]["settings"], manifest["dataset"]["source"]
    rows, cols = dataset.shape
    lines = [
        "# Pairs of clean and noisy raw frames",
        "",
        f"{manifest['pairs']} pairs of {rows} x {cols} pixels in {len(manifest['shards'])} {manifest['shard_format']} "
        f"shards, simulated with photosite {manifest['photosite']}.",
        "",
        "## Sensors",
        "",
        "| name | serial | gain setting | CFA | bits | black level (DN) | gain (DN/e-) | read noise (e-) | source |",
        "|---|---|---|---|---|---|---|---|---|",
        *(_sensor_row(sensor) for sensor in dataset.all_sensors),
        "",
        "## Light and exposure",
        "",
        f"- Factor on the light: {_range(settings['light'])}.",
        f"- Exposure time: {_range(settings['exposure_s'], format_exposure)} s.",
        f"- {settings['crops']} patches of each image, {settings['draws']} noisy frames of each patch"
        + (", half of them reversed along each axis." if settings["flips"] else "."),
        f"- Unit: {'digital numbers, black level included' if settings['unit'] == 'dn' else 'electrons'}.",
        *_light_lines(source),
        "",
        "## Inputs",
        "",
        f"License: {manifest['license_of_inputs']}",
        "",
        *_input_lines(source["images"]),
        "",
        "## Use",
        "",
        "`manifest.json` has the SHA-256 of every shard and all settings. Each pair's metadata has black level, gain, "
        "noise parameters, and its place in image and chip. Seed and settings give the same bytes again.",
        "",
    ]
    return "\n".join(lines)


def _sensor_row(sensor: Sensor) -> str:
    cells = (
        sensor.name,
        sensor.serial,
        "" if sensor.gain_setting is None else f"{sensor.gain_setting:g}",
        tile_text(sensor.array.cfa),
        str(sensor.readout.bits),
        f"{sensor.readout.black_level_dn.value:g}",
        f"{sensor.system_gain_dn_per_e:.4g}",
        f"{sensor.electrons(sensor.noise.read_noise_mv.value):.3g}",
        sensor.provenance.source or "",
    )
    return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"


def _range(value: float | list[float], written: Callable[[float], str] = "{:g}".format) -> str:
    return " to ".join(map(written, value if isinstance(value, list) else [value]))


def _light_lines(source: Mapping[str, Any]) -> list[str]:
    kind = source["kind"]
    if kind == "scenes":
        lights = ", ".join(map(str, source["illuminants"])) or "D65 on pictures; other scenes have their own"
        optics = source["optics"]
        lens = ", ".join(f"{name} {value:g}" for name, value in optics.items() if isinstance(value, float))
        blur = "" if source["lens_blur"] else ", without its blur"
        return [
            f"- Illuminants: {lights}.",
            f"- Display white: {source['white_luminance_cd_m2']:g} cd/m2.",
            f"- Lens: {optics['type']} ({lens}){blur}.",
        ]
    if kind == "raw frames":
        return ["- The clean frames are raw frames, with the noise that is left in them; only missing noise was added."]
    return ["- The clean frames are given electrons."]


def _input_lines(images: list[Any]) -> list[str]:
    lines = [
        f"- {entry if isinstance(entry, str) else entry.get('file') or entry.get('name') or entry.get('array')}"
        for entry in images[:_MOST_INPUTS]
    ]
    rest = len(images) - _MOST_INPUTS
    return [*lines, f"- and {rest} more, in `manifest.json`"] if rest > 0 else lines
