"""Noise profiles made as darktable makes them, of virtual cameras: the scale of a and b, and the coverage of the gain.

Each camera has its own gain, read noise, photo response nonuniformity and color of the light, and its own way to
demosaic. A raw frame of a gradient is drawn by NumPy, demosaiced (by LibRaw, and RCD by the published algorithm), and
analyzed as by darktable's tool.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.frames.io.darktable_scale import BINS, DEMOSAICING, LARGEST_WELL_E, PRNU_PERCENT, slope_and_offset
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95

Image = NDArray[np.float64]

BITS, BLACK_DN = 14, 512
SHAPE = 512, 768
_BORDER = 16
"""Pixels at each edge that are left out: demosaicing differs there."""
_TOP = 0.8
"""Brightness up to which darktable fits green."""
_MAD = 0.6745
"""Median of the absolute values of a standard normal distribution."""
_SMALLEST_WHITE_E = 300.0


@dataclass(frozen=True)
class VirtualCamera(Shown):
    """A camera to profile.

    Parameters
    ----------
    electrons_at_white, read_noise_e, prnu_percent
        Of all its pixels.
    red, blue
        Signal relative to green.
    way
        Demosaicing, a name in `DEMOSAICING`.
    """

    electrons_at_white: float
    read_noise_e: float
    prnu_percent: float
    red: float
    blue: float
    way: str


@dataclass(frozen=True)
class ProfiledCamera(Shown):
    """A camera, the a and b of its profile, and the 95 % intervals of slope and offset that were found in them."""

    camera: VirtualCamera
    a: float
    b: float
    slope_95: tuple[float, float]
    offset_95: tuple[float, float]

    @property
    def covered(self) -> bool:
        """Whether the interval of the slope contains the true one, 1 / electrons at white."""
        low, high = self.slope_95
        return low <= 1.0 / self.camera.electrons_at_white <= high

    @property
    def offset_covered(self) -> bool:
        """Whether the interval of the offset contains the variance of read noise and rounding."""
        rounding = QUANTIZATION_DN2 / ((1 << BITS) - 1 - BLACK_DN) ** 2
        low, high = self.offset_95
        return low <= (self.camera.read_noise_e / self.camera.electrons_at_white) ** 2 + rounding <= high

    @property
    def factor(self) -> float:
        """The profile's a over the true slope."""
        return self.a * self.camera.electrons_at_white


def draw_camera(rng: np.random.Generator, *, prnu: bool = True) -> VirtualCamera:
    """Draw a camera from the distributions that `slope_and_offset` assumes; without `prnu` its pixels are alike."""
    shares = np.array([way.fraction for way in DEMOSAICING.values()])
    return VirtualCamera(
        electrons_at_white=float(np.exp(rng.uniform(np.log(_SMALLEST_WHITE_E), np.log(LARGEST_WELL_E)))),
        read_noise_e=float(np.exp(rng.uniform(0.0, np.log(8.0)))),
        prnu_percent=float(rng.uniform(*PRNU_PERCENT)) if prnu else 0.0,
        red=float(rng.uniform(0.35, 0.95)),
        blue=float(rng.uniform(0.35, 0.95)),
        way=str(rng.choice(list(DEMOSAICING), p=shares / shares.sum())),
    )


def raw_frame(camera: VirtualCamera, rng: np.random.Generator, shape: tuple[int, int] = SHAPE) -> RawFrame:
    """Return a raw frame of a gradient from black to above white."""
    rows, cols = shape
    white = float((1 << BITS) - 1)
    level = 1.05 * (0.9 * np.linspace(0, 1, cols)[None, :] + 0.1 * np.linspace(0, 1, rows)[:, None])
    level[0::2, 0::2] *= camera.red
    level[1::2, 1::2] *= camera.blue
    response = 1.0 + 0.01 * camera.prnu_percent * rng.standard_normal(shape)
    photo = rng.poisson(level * camera.electrons_at_white * response)
    electrons = photo + camera.read_noise_e * rng.standard_normal(shape)
    dn = np.rint(BLACK_DN + electrons * (white - BLACK_DN) / camera.electrons_at_white)
    return RawFrame(np.clip(dn, 0, white).astype(np.uint16), BITS, (("R", "G"), ("G", "B")), BLACK_DN)


def green_plane(raw: RawFrame, way: str) -> Image:
    """Return green at every pixel, black 0 and white 1, demosaiced in one of the ways of `DEMOSAICING`."""
    if way == "RCD":
        return _ratio_corrected((np.asarray(raw) - raw.black_level_dn) / (raw.white_level_dn - raw.black_level_dn))
    import rawpy

    algorithm = {"bilinear": rawpy.DemosaicAlgorithm.LINEAR}.get(way) or getattr(rawpy.DemosaicAlgorithm, way)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.dng"
        raw.save(path)
        with rawpy.imread(str(path)) as decoder:
            picture = decoder.postprocess(
                demosaic_algorithm=algorithm,
                output_color=rawpy.ColorSpace.raw,
                user_wb=[1.0] * 4,
                gamma=(1, 1),
                no_auto_bright=True,
                adjust_maximum_thr=0.0,
                output_bps=16,
                user_flip=0,
            )
    return np.asarray(picture[..., 1] / 65535.0, dtype=np.float64)


def _ratio_corrected(mosaic: Image) -> Image:
    """Return green by ratio corrected demosaicing, darktable's default since version 3.

    References
    ----------
    L. Sanz Rodríguez, "Ratio Corrected Demosaicing", version 2.3, 2017.
    """
    small = 1e-5

    def at(values: Image, row: int, col: int) -> Image:
        return np.roll(values, (-row, -col), (0, 1))

    def roughness(axis: int) -> Image:
        filtered = sum(
            tap * np.roll(mosaic, 3 - k, axis) for k, tap in enumerate((1.0, -3.0, -1.0, 6.0, -1.0, -3.0, 1.0))
        )
        square = np.square(filtered)
        return np.roll(square, 1, axis) + square + np.roll(square, -1, axis) + small**2

    vertical, horizontal = roughness(0), roughness(1)
    share = vertical / (vertical + horizontal)  # near 0: constant along columns
    around = 0.25 * sum(at(share, row, col) for row in (-1, 1) for col in (-1, 1))
    share = np.where(np.abs(0.5 - share) < np.abs(0.5 - around), around, share)
    near = ((-1, 0), (1, 0), (0, -1), (0, 1))
    low = 0.25 * mosaic + 0.125 * sum(at(mosaic, *step) for step in near)
    low = low + 0.0625 * sum(at(mosaic, row, col) for row in (-1, 1) for col in (-1, 1))

    def estimate(row: int, col: int) -> tuple[Image, Image]:
        one, two, three, four = (at(mosaic, k * row, k * col) for k in (1, 2, 3, 4))
        gradient = small + np.abs(at(mosaic, -row, -col) - one) + np.abs(mosaic - two)
        gradient = gradient + np.abs(one - three) + np.abs(two - four)
        far = at(low, 2 * row, 2 * col)
        return gradient, one * (1.0 + (low - far) / (small + low + far))

    (grad_n, north), (grad_s, south), (grad_w, west), (grad_e, east) = (estimate(*step) for step in near)
    along_columns = (grad_s * north + grad_n * south) / (grad_n + grad_s)
    along_rows = (grad_w * east + grad_e * west) / (grad_e + grad_w)
    green = share * along_rows + (1.0 - share) * along_columns
    rows, cols = np.indices(mosaic.shape)
    return np.where((rows + cols) % 2 == 1, mosaic, green)


def profile_line(green: Image) -> tuple[float, float]:
    """Return a and b of a demosaiced green plane as darktable's tool finds them.

    The diagonal details of a 2 x 2 Haar transform are sorted by the mean of their four pixels into `BINS` bins. Each
    bin's standard deviation is the median of the absolute details over 0.6745. A line is fitted to the variances, with
    weights of the squared counts, against the lower edges of the bins.
    """
    rows, cols = (size // 2 * 2 for size in np.subtract(green.shape, 2 * _BORDER))
    inner = np.maximum(green[_BORDER : _BORDER + rows, _BORDER : _BORDER + cols], 0.0)
    a, b, c, d = inner[0::2, 0::2], inner[0::2, 1::2], inner[1::2, 0::2], inner[1::2, 1::2]
    mean, detail = 0.25 * (a + b + c + d).ravel(), 0.25 * np.abs(a - b - c + d).ravel()
    bins = np.clip((mean * BINS).astype(np.int64), 0, BINS - 1)
    order = np.argsort(bins, kind="stable")
    first = np.searchsorted(bins[order], np.arange(BINS + 1))
    parts = [detail[order[begin:end]] for begin, end in pairwise(first)]
    edges = np.arange(BINS) / BINS
    used = [k for k, part in enumerate(parts) if part.size and edges[k] <= _TOP]
    variance = [(float(np.median(parts[k])) / _MAD) ** 2 for k in used]
    slope, offset = np.polyfit(edges[used], variance, 1, w=[parts[k].size for k in used])
    return float(slope), float(offset)


def profile_camera(seed: int, *, prnu: bool = True, shape: tuple[int, int] = SHAPE) -> ProfiledCamera:
    """Draw a camera, make its profile, and return what `slope_and_offset` finds in it."""
    rng = np.random.default_rng((20_261, seed))
    camera = draw_camera(rng, prnu=prnu)
    a, b = profile_line(green_plane(raw_frame(camera, rng, shape), camera.way))
    slope, offset = (
        (found.value - COVERAGE_95 * found.standard_uncertainty, found.value + COVERAGE_95 * found.standard_uncertainty)
        for found in slope_and_offset(a, b, pixels=shape[0] * shape[1])
    )
    return ProfiledCamera(camera, a, b, slope, offset)


def coverage_table(cameras: Sequence[ProfiledCamera]) -> list[dict[str, Any]]:
    """Return how often the intervals contain the truth: of all cameras, by demosaicing, and by electrons at white."""
    groups: dict[str, Callable[[ProfiledCamera], bool]] = {"all": lambda _: True}
    groups |= {way: lambda one, way=way: one.camera.way == way for way in DEMOSAICING}  # type: ignore[misc]
    edges = (_SMALLEST_WHITE_E, 3_000.0, 20_000.0, LARGEST_WELL_E)
    for low, high in pairwise(edges):
        name = f"{low:g} to {high:g} electrons"
        groups[name] = lambda one, low=low, high=high: low <= one.camera.electrons_at_white < high  # type: ignore[misc]
    rows = []
    for name, belongs in groups.items():
        group = [one for one in cameras if belongs(one)]
        if not group:
            continue
        factors = np.array([one.factor for one in group])
        rows.append(
            {
                "group": name,
                "cameras": len(group),
                "covered": sum(one.covered for one in group) / len(group),
                "offset_covered": sum(one.offset_covered for one in group) / len(group),
                "mean_factor": float(factors.mean()),
                "relative_spread": float(factors.std(ddof=1) / factors.mean()) if len(group) > 1 else 0.0,
                "half_width": float(
                    np.median([(high - low) / (high + low) for low, high in (one.slope_95 for one in group)])
                ),
            }
        )
    return rows
