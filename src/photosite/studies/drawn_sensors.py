"""Clean sensors and measurements drawn at random over the range of practice, in plain NumPy, and their files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.studies.effect_study import log_uniform

Frames = NDArray[np.uint16]
"""(frames, rows, cols) digital numbers."""

MOST_NUMBERS = 20_000_000
"""Largest number of digital numbers of a measurement: small chips have more frames than large ones."""

ROUTES = "HDF5", "TIFF", "PNG", "DNG", "EMVA 1288"
"""How frames are stored: one HDF5 file; TIFF files of a level each, with a protocol; PNG and DNG files of a frame
each, whose names state kind and exposure time; an EMVA 1288 descriptor with TIFF files."""

NO_PATTERN = (
    *("row_offset_e", "column_offset_e", "column_gain_percent"),
    *("dsnu1288_row_e", "dsnu1288_column_e", "prnu1288_row_percent", "prnu1288_column_percent"),
)
"""Standard deviations that are 0: the chips have no row or column pattern."""

_TILES = "rggb", "bggr", "grbg", "gbrg"


@dataclass(frozen=True)
class Level:
    """Frames of one kind, exposure time in seconds, and light in photons per pixel (0 for dark frames)."""

    kind: str
    exposure_s: float
    photons: float
    count: int


@dataclass(frozen=True, kw_only=True)
class DrawnSensor:
    """A sensor and its measurement.

    Parameters
    ----------
    number
        Number of the sensor, the seed of everything drawn.
    shape, bits, tile
        Size of the chip, bits of the converter, and color filter array: "mono", or a name of Bayer's.
    gain, black_dn, read_noise_e, dsnu_e, prnu, well_e
        System gain in DN/e-, black level in DN, read noise and DSNU in e-, PRNU relative to 1, full well in e-.
    dark_e_per_s, dcnu
        Mean dark current, and its standard deviation over pixels relative to the mean (log-normal).
    efficiency
        Electrons per photon by the name of a channel.
    levels
        The frames.
    photons_stated
        Whether the files state the light.
    route
        One of `ROUTES`.
    """

    number: int
    shape: tuple[int, int]
    bits: int
    tile: str
    gain: float
    black_dn: float
    read_noise_e: float
    dsnu_e: float
    prnu: float
    well_e: float
    dark_e_per_s: float
    dcnu: float
    efficiency: Mapping[str, float]
    levels: tuple[Level, ...]
    photons_stated: bool
    route: str

    @property
    def white_dn(self) -> int:
        """Largest digital number."""
        return (1 << self.bits) - 1

    @property
    def saturation_e(self) -> float:
        """Electrons at which a pixel saturates, by its well or by the converter."""
        return min(self.well_e, (self.white_dn - self.black_dn) / self.gain)

    @property
    def lights(self) -> tuple[Level, ...]:
        """The levels of the flat fields, from the dimmest to the brightest."""
        return tuple(level for level in self.levels if level.kind == "light")

    @property
    def dark_times_s(self) -> tuple[float, ...]:
        """Exposure times of the dark frames."""
        return tuple(sorted({level.exposure_s for level in self.levels if level.kind == "dark"}))

    def to_dict(self) -> dict[str, Any]:
        """Return the sensor in words and numbers, for JSON."""
        lights = self.lights
        return {
            **{name: value for name, value in vars(self).items() if name != "levels"},
            "read_noise_dn": self.read_noise_e * self.gain,
            "saturation_e": self.saturation_e,
            "brightest": lights[-1].photons * max(self.efficiency.values()) / self.saturation_e,
            "light_levels": len(lights),
            "frames_per_level": lights[0].count,
            "light_times_s": [lights[0].exposure_s, lights[-1].exposure_s],
            "dark_times_s": list(self.dark_times_s),
        }

    def frames(self) -> Iterator[tuple[Level, Frames]]:
        """Draw the chip, and yield the frames of each level."""
        rng = np.random.default_rng([self.number, 1])
        response = 1.0 + self.prnu * rng.normal(size=self.shape)
        for (row, col), channel in self.sites.items():
            response[row::2, col::2] *= self.efficiency[channel]
        offset = self.black_dn + self.gain * self.dsnu_e * rng.normal(size=self.shape)
        sigma = math.sqrt(math.log1p(self.dcnu**2))
        dark = self.dark_e_per_s * np.exp(sigma * rng.normal(size=self.shape) - sigma**2 / 2)
        for level in self.levels:
            expected = level.photons * response + dark * level.exposure_s
            dn = np.empty((level.count, *self.shape), np.uint16)
            for frame in dn:
                charge = np.minimum(rng.poisson(expected), self.well_e)
                signal = offset + self.gain * (charge + self.read_noise_e * rng.normal(size=self.shape))
                frame[...] = np.clip(np.rint(signal), 0, self.white_dn)
            yield level, dn

    @property
    def sites(self) -> dict[tuple[int, int], str]:
        """The channel of each place in the tile of 2 x 2 pixels."""
        names = 4 * "M" if self.tile == "mono" else self.tile.upper()
        return {(place // 2, place % 2): name for place, name in enumerate(names)}

    def truth(self, dsnu1288_exposure_s: Mapping[str, float], *, hidden: bool = False) -> dict[str, float]:
        """Return the true parameters by name, as EMVA 1288 R4.0 and the 2008 paper define them.

        Nonuniformities are those of the population that the chip is drawn from. With dark frames of one exposure time,
        black level, read noise and DSNU contain the dark current of that time, and the saturation capacity does not.

        Parameters
        ----------
        dsnu1288_exposure_s
            Exposure time of the dark frames of DSNU1288, which contains their dark current, by channel.
        hidden
            Whether quantization hides the read noise: sensitivity threshold and dynamic range are then those of the
            standard's least dark variance, 0.24 DN^2.
        """
        times = self.dark_times_s
        time_s = times[0] if len(times) == 1 else 0.0
        charge_e, spread_e = self.dark_e_per_s * time_s, self.dark_e_per_s * self.dcnu
        read_e = math.sqrt(self.read_noise_e**2 + charge_e)
        dsnu_e = math.hypot(self.dsnu_e, spread_e * time_s)
        black_dn = self.black_dn + self.gain * charge_e
        seconds = [dsnu1288_exposure_s.get(name, math.nan) for name in self.sites.values()]
        dsnu1288_e = math.sqrt(self.dsnu_e**2 + spread_e**2 * float(np.mean(np.square(seconds))))
        dark_variance_e2 = 0.24 / self.gain**2 if hidden else read_e**2 + 1.0 / (12.0 * self.gain**2)
        threshold_e = math.sqrt(dark_variance_e2 + 0.25) + 0.5
        capacity_e = self.saturation_e - charge_e
        efficiency = float(np.mean([self.efficiency[name] for name in self.sites.values()]))
        truth = {
            "read_noise_dn": read_e * self.gain,
            "read_noise_e": read_e,
            "dsnu_dn": dsnu_e * self.gain,
            "dsnu_e": dsnu_e,
            "prnu_percent": 100.0 * self.prnu,
            **dict.fromkeys(NO_PATTERN, 0.0),
            "interpixel_coupling_percent": 0.0,
            "dark_current_dn_per_s": self.dark_e_per_s * self.gain,
            "dark_current_e_per_s": self.dark_e_per_s,
            "dark_current_from_variance_e_per_s": self.dark_e_per_s,
            "dcnu_percent": 100.0 * self.dcnu,
            "black_level_dn": black_dn,
            "system_gain_dn_per_e": self.gain,
            "saturation_dn": self._saturation_dn(),
            "saturation_capacity_e": capacity_e,
            "temporal_dark_noise_e": read_e,
            "snr_max_db": 10.0 * math.log10(capacity_e),
            "dynamic_range_db": 20.0 * math.log10(capacity_e / threshold_e),
            "dsnu1288_e": dsnu1288_e,
            "dsnu1288_pixel_e": dsnu1288_e,
            "prnu1288_percent": 100.0 * self.prnu,
            "prnu1288_pixel_percent": 100.0 * self.prnu,
            "prnu1288_unfiltered_percent": 100.0 * self.prnu,
        }
        if self.photons_stated:
            truth |= {
                "responsivity_dn_per_photon": self.gain * efficiency,
                "quantum_efficiency_percent": 100.0 * efficiency,
                "sensitivity_threshold_photons": threshold_e / efficiency,
                "saturation_capacity_photons": capacity_e / max(self.efficiency.values()),
            }
        return truth

    def _saturation_dn(self) -> float:
        """Return the mean digital number of full wells: the sum over k of P(n > k), with n rounded and clipped."""
        mean = self.black_dn + self.gain * self.well_e
        sigma = self.gain * math.hypot(self.read_noise_e, self.dsnu_e)
        clipped = math.floor(mean - 10.0 * sigma)
        codes = range(max(min(clipped, self.white_dn), 0), self.white_dn)
        return codes.start + math.fsum(
            math.erfc((k + 0.5 - mean) / (sigma * math.sqrt(2.0))) / 2.0 for k in codes if k < mean + 10.0 * sigma
        )

    def write(self, folder: Path) -> tuple[Path, dict[str, Any]]:
        """Write the frames, and return what `open_frames` opens, and its options."""
        return _WRITERS[self.route](self, folder)


def draw_sensor(number: int) -> DrawnSensor:
    """Draw a sensor and its measurement.

    Gain, read noise, well and size are uniform in their logarithms, as long as they fit: read noise of 0.05 DN or more,
    a saturation of 30 times the read noise and of 500 electrons or more, and a well that holds 0.3 to 10 times the
    range of the converter.

    Examples
    --------
    >>> sensor = draw_sensor(0)
    >>> sensor.read_noise_e * sensor.gain > 0.05, sensor.white_dn
    (True, 65535)
    """
    rng = np.random.default_rng([number, 0])
    between = partial(log_uniform, rng)
    while True:
        bits = int(rng.choice((8, 10, 12, 14, 16)))
        gain, read_e, well_e = between(0.02, 20.0), between(0.7, 40.0), between(2e3, 2e5)
        dsnu_e = read_e * between(0.2, 1.5)
        white_dn = (1 << bits) - 1
        black_dn = float(rng.uniform(2.0, 3.0)) + between(6.0, 30.0) * gain * math.hypot(read_e, dsnu_e)
        range_e = (white_dn - black_dn) / gain
        fits = black_dn < 0.1 * white_dn and gain * read_e >= 0.05 and 0.3 < well_e / range_e < 10.0
        if fits and min(well_e, range_e) > max(30.0 * read_e, 500.0):
            break
    tile = str(rng.choice(_TILES)) if rng.random() < 0.5 else "mono"
    quantum = rng.uniform(0.3, 0.8)
    relative = {"M": 1.0} if tile == "mono" else {"R": rng.uniform(0.6, 0.9), "G": 1.0, "B": rng.uniform(0.5, 0.8)}
    efficiency = {name: float(quantum * factor) for name, factor in relative.items()}
    saturation_e = min(well_e, range_e)
    dark_e_per_s = between(0.5, 200.0)
    route = str(rng.choice(ROUTES))
    stated = route == "EMVA 1288" or (route in ("HDF5", "TIFF") and rng.random() < 0.6)
    levels = _levels(rng, saturation_e / quantum, 0.2 * saturation_e / dark_e_per_s, stated and rng.random() < 0.5)
    aspect = between(1.0, 1.5)
    rows = min(between(64.0, 400.0), math.sqrt(MOST_NUMBERS / sum(level.count for level in levels) / aspect))
    shape = 2 * round(rows / 2.0), 2 * round(rows * aspect / 2.0)
    return DrawnSensor(
        number=number,
        shape=shape,
        bits=bits,
        tile=tile,
        gain=gain,
        black_dn=black_dn,
        read_noise_e=read_e,
        dsnu_e=dsnu_e,
        prnu=between(0.001, 0.03),
        well_e=well_e,
        dark_e_per_s=dark_e_per_s,
        dcnu=between(0.05, 0.4),
        efficiency=efficiency,
        levels=levels,
        photons_stated=stated,
        route=route,
    )


def _levels(
    rng: np.random.Generator, saturation_photons: float, longest_dark_s: float, by_light: bool
) -> tuple[Level, ...]:
    """Draw the protocol: flat fields by exposure time or by light, dark frames at the same times, at one, or more."""
    between = partial(log_uniform, rng)
    lights, count = round(between(4.0, 40.0)), round(between(2.0, 50.0))
    part = np.arange(1, lights + 1) / lights
    if lights >= 8 and rng.random() < 0.4:
        part = np.geomspace(between(0.01, 0.05), 1.0, lights)
    photons = rng.uniform(0.8, 1.3) * saturation_photons * part
    longest_s = min(between(2e-3, 1.0), longest_dark_s)
    times = [float(f"{longest_s * (1.0 if by_light else x):.6g}") for x in part]
    per_s = photons[-1] / times[-1]
    light = [
        Level("light", t, float(f"{each if by_light else per_s * t:.9g}"), count)
        for t, each in zip(times, photons, strict=True)
    ]
    plan, several = rng.random(), max(count, round(between(4.0, 40.0)))
    if plan < 0.35:
        dark = [Level("dark", t, 0.0, several if by_light else count) for t in sorted(set(times))]
    elif plan < 0.6:
        dark = [Level("dark", times[0], 0.0, several)]
    else:
        most_s = max(min(between(0.5, 10.0), longest_dark_s), 2.0 * times[0])
        series = np.geomspace(times[0], most_s, round(between(4.0, 9.0)))
        dark = [Level("dark", float(f"{t:.6g}"), 0.0, several if n == 0 else count) for n, t in enumerate(series)]
    return (*dark, *light)


def _write_hdf5(sensor: DrawnSensor, folder: Path) -> tuple[Path, dict[str, Any]]:
    import h5py

    path = folder / "frames.h5"
    with h5py.File(path, "w") as file:
        file.attrs.update({"bits": sensor.bits, "cfa": sensor.tile})
        for number, (level, dn) in enumerate(sensor.frames()):
            stack = file.create_dataset(f"{level.kind}/{number:03d}", data=dn)
            stack.attrs.update({"kind": level.kind, "exposure_s": level.exposure_s})
            if sensor.photons_stated and level.kind == "light":
                stack.attrs["photons_per_pixel"] = level.photons
    return path, {}


def _write_tiff(sensor: DrawnSensor, folder: Path) -> tuple[Path, dict[str, Any]]:
    import tifffile

    lines = ["photosite_protocol: 1", f"bits: {sensor.bits}", f"cfa: {sensor.tile}", "frames:"]
    for number, (level, dn) in enumerate(sensor.frames()):
        tifffile.imwrite(folder / f"{number:03d}.tif", dn, photometric="minisblack", metadata=None)
        light = f", photons_per_pixel: {level.photons!r}" if sensor.photons_stated and level.kind == "light" else ""
        lines.append(f"  - {{kind: {level.kind}, exposure: {level.exposure_s!r}, files: {number:03d}.tif{light}}}")
    path = folder / "protocol.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path, {}


def _named(sensor: DrawnSensor, folder: Path, suffix: str) -> Iterator[tuple[Path, Frames]]:
    for number, (level, dn) in enumerate(sensor.frames()):
        for index, frame in enumerate(dn):
            kind = "dark" if level.kind == "dark" else "flat"
            yield folder / f"{kind}_{level.exposure_s * 1e6:.9g}us_{number:03d}_{index:03d}{suffix}", frame


def _write_png(sensor: DrawnSensor, folder: Path) -> tuple[Path, dict[str, Any]]:
    from imagecodecs import png_encode

    for path, frame in _named(sensor, folder, ".png"):
        path.write_bytes(png_encode(frame, level=1))
    return folder, {"bits": sensor.bits, "cfa": sensor.tile}


def _write_dng(sensor: DrawnSensor, folder: Path) -> tuple[Path, dict[str, Any]]:
    from photosite.frames.raw_frame import RawFrame
    from photosite.values.cfa import cfa_from

    for path, frame in _named(sensor, folder, ".dng"):
        RawFrame(frame, sensor.bits, cfa_from(sensor.tile), float(round(sensor.black_dn))).save(path)
    return folder, {}


def _write_descriptor(sensor: DrawnSensor, folder: Path) -> tuple[Path, dict[str, Any]]:
    import tifffile

    lines = ["v 4.0", f"n {sensor.bits} {sensor.shape[1]} {sensor.shape[0]}"]
    for number, (level, dn) in enumerate(sensor.frames()):
        ns = f"{level.exposure_s * 1e9:.9g}"
        lines.append(f"d {ns}" if level.kind == "dark" else f"b {ns} {level.photons!r}")
        for index, frame in enumerate(dn):
            name = f"{number:03d}_{index:03d}.tif"
            tifffile.imwrite(folder / name, frame, photometric="minisblack", metadata=None)
            lines.append(f"i {name}")
    path = folder / "EMVA1288_Data.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path, {"cfa": sensor.tile}


_WRITERS: Mapping[str, Callable[[DrawnSensor, Path], tuple[Path, dict[str, Any]]]] = dict(
    zip(ROUTES, (_write_hdf5, _write_tiff, _write_png, _write_dng, _write_descriptor), strict=True)
)
