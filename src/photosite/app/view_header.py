"""What the page writes beside the picture: histogram, SNR, response, and statistics of regions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.app.exact_frame import kept_frame
from photosite.app.kept_scenes import unit_scene
from photosite.app.preview_sensor import of_size
from photosite.app.state import PreparedState
from photosite.app.view_pixels import Rectangle, View, ViewPixels
from photosite.metrics.capture_snr import capture_budget
from photosite.sensor.capture_readout import largest_light_e
from photosite.sensor.clean_frame import clean_numbers
from photosite.sensor.model import Sensor
from photosite.studies.gray_surface import light_capacity_e, total_variance_e2
from photosite.values.cfa import channel_names, channel_sites

HISTOGRAM_BINS = 128


def view_header(found: PreparedState, shown: ViewPixels, view: View, folder: Path) -> dict[str, Any]:
    """Return what the page writes beside the picture, by name."""
    sensor, taken = found.camera.sensor, found.state.capture
    at = sensor if taken.temperature_c is None else sensor.at_temperature(taken.temperature_c)
    capacity = light_capacity_e(at, taken.exposure_s) if sensor.captures is None else float(shown.mean_e.max()) + 1.0
    array, taken_as = sensor.array, shown.taken
    assert taken_as.white_level_dn is not None
    return {
        "exact": shown.exact,
        "frame": found.state.frame_key,
        "step": shown.step,
        "row": int(shown.rows[0]),
        "col": int(shown.cols[0]),
        "rows": shown.rows.size,
        "cols": shown.cols.size,
        "frame_rows": array.rows,
        "frame_cols": array.cols,
        "cfa": [list(line) for line in array.cfa],
        "channels": list(channel_names(array.cfa)),
        "black_level_dn": taken_as.black_level_dn,
        "white_level_dn": taken_as.white_level_dn,
        "bits": taken_as.bits,
        "response": _response_table(sensor),
        "saturation_e": capacity,
        "sensor": sensor.name,
        "scene": unit_scene(found)[0].name,
        "exposure_s": taken.exposure_s,
        "snr": _snr_table(at, taken.exposure_s, max(capacity, 1.0)),
        "histogram": _histogram(shown.pixels, taken_as.white_level_dn, array.cfa),
        "saturated_fraction": float((shown.pixels >= taken_as.white_level_dn).mean()),
        "regions": [_statistics(found, shown, region, folder) for region in view.regions],
    }


_RESPONSE_POINTS = 513


def _response_table(sensor: Sensor) -> dict[str, list[float]]:
    """Return electrons from light, and the digital numbers that they have without noise: linear in between."""
    effects = {} if sensor.effects is None else sensor.effects.stated
    if sensor.captures is None and not any(section.changes_response for section in effects.values()):
        black_dn = sensor.output_levels_dn[0]
        return {"dn": [black_dn, black_dn + sensor.system_gain_dn_per_e], "electrons": [0.0, 1.0]}
    top_e = sensor.saturation_capacity_e if sensor.captures is None else largest_light_e(sensor)
    light = np.linspace(0.0, top_e, _RESPONSE_POINTS)
    tile = len(sensor.array.cfa), len(sensor.array.cfa[0])
    others = {name: None for name, section in effects.items() if not section.changes_response}
    small = of_size(sensor.with_(**others), tile[0], tile[1] * _RESPONSE_POINTS, [])
    mosaic = np.repeat(np.repeat(light, tile[1])[None], tile[0], axis=0).astype(np.float32)
    dn, first = np.unique(clean_numbers(small, mosaic)[0, :: tile[1]], return_index=True)
    return {"dn": dn.tolist(), "electrons": light[first].tolist()}


def _electrons(dn: NDArray[np.float64], response: dict[str, list[float]]) -> NDArray[np.float64]:
    """Return the electrons of digital numbers; below the table, those of its first two entries' line."""
    numbers, electrons = response["dn"], response["electrons"]
    if len(numbers) < 2:
        return np.zeros_like(dn)
    ends = [(electrons[k + 1] - electrons[k]) / (numbers[k + 1] - numbers[k]) for k in (0, len(numbers) - 2)]
    beyond = np.minimum(dn - numbers[0], 0.0) * ends[0] + np.maximum(dn - numbers[-1], 0.0) * ends[1]
    return np.asarray(np.interp(dn, numbers, electrons) + beyond)


def _snr_table(sensor: Sensor, exposure_s: float, capacity_e: float) -> dict[str, list[float]]:
    """Return the ratio of signal to the noise of one frame, in dB, over electrons from light."""
    signal = np.geomspace(0.01, capacity_e, 96)
    if sensor.captures is not None:
        ratio = capture_budget(sensor, signal, exposure_s).combined_db
    else:
        ratio = 10.0 * np.log10(signal**2 / total_variance_e2(sensor, signal, exposure_s))
    kept = np.isfinite(ratio)
    return {"signal_e": signal[kept].tolist(), "snr_db": ratio[kept].tolist()}


def _histogram(pixels: NDArray[Any], white_dn: float, cfa: tuple[tuple[str, ...], ...]) -> dict[str, Any]:
    """Return counts of digital numbers by channel, in bins of equal width from 0 to the white level."""
    top = white_dn + 1.0
    counts: dict[str, list[int]] = {}
    scaled = (pixels * np.float32(HISTOGRAM_BINS / top)).astype(np.int32)
    for name in channel_names(cfa):
        total: Any = 0
        for r, c in channel_sites(cfa, name):
            part = scaled[r :: len(cfa), c :: len(cfa[0])].ravel()
            total = total + np.bincount(np.clip(part, 0, HISTOGRAM_BINS - 1), minlength=HISTOGRAM_BINS)
        counts[name] = np.asarray(total).tolist()
    return {"dn_per_bin": top / HISTOGRAM_BINS, "counts": counts}


def _statistics(found: PreparedState, shown: ViewPixels, region: Rectangle, folder: Path) -> dict[str, Any]:
    """Return mean, standard deviation and SNR of each channel in a region of the frame."""
    sensor = found.camera.sensor
    r0, r1, c0, c1 = region
    cfa, response = sensor.array.cfa, _response_table(sensor)
    whole = kept_frame(found.state, folder)
    if whole is not None:
        rows, cols = np.arange(r0, min(r1, whole.shape[0])), np.arange(c0, min(c1, whole.shape[1]))
        dn = np.asarray(whole[r0:r1, c0:c1], np.float64)
    elif shown.step > 1:  # the spread of means is not that of pixels
        return {"region": list(region), "exact": False, "channels": dict.fromkeys(channel_names(cfa)), "waits": True}
    else:
        down, across = ((of >= low) & (of < high) for of, low, high in ((shown.rows, r0, r1), (shown.cols, c0, c1)))
        rows, cols = shown.rows[down], shown.cols[across]
        dn = shown.dn[down][:, across].astype(np.float64)
    channels: dict[str, Any] = {}
    for name in channel_names(cfa):
        sites = channel_sites(cfa, name)
        parts = [dn[np.ix_(rows % len(cfa) == r, cols % len(cfa[0]) == c)].ravel() for r, c in sites]
        values = np.concatenate(parts)
        if values.size < 2:
            channels[name] = None
            continue
        electrons = _electrons(values, response)
        signal, spread = float(electrons.mean()), float(electrons.std(ddof=1))
        ratio = 20.0 * np.log10(signal / spread) if signal > 0 and spread > 0 else None
        channels[name] = {
            "pixels": values.size,
            "mean_dn": float(values.mean()),
            "sd_dn": float(values.std(ddof=1)),
            "mean_e": signal,
            "snr_db": None if ratio is None else float(ratio),
        }
    return {"region": list(region), "exact": whole is not None or shown.exact, "channels": channels, "waits": False}
