"""A lens whose coma grows over the field, in the gallery: a few modes against each point's own spread."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import FieldPsf, PointSpread
from photosite.optics.protocols import Blur
from photosite.optics.sampled_psf import sample_positions
from photosite.report.style import BLUE, GRAY, VERMILION, styled
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor

Array = NDArray[np.float64]

BASE = DiffractionLimited(f_number=2.8, focal_length_mm=50)
COMA_WAVES, CURVATURE_WAVES = 0.8, 0.3
"""At the rim of the pupil and the edge of the field; the first grows with height, the second with its square."""
WAVELENGTH_NM = 550.0
SPACING_UM, SAMPLES = 0.55, 61
RANKS = (1, 2, 3, 4, 6, 8, 12, 16, 24)
_PUPIL = 96
_SEED = 6


def comatic_psf(height: float, azimuth_rad: float) -> Array:
    """(61, 61) point spread at a height, 0 to 1 of the field, by the Fourier integral over the pupil.

    Parameters
    ----------
    height
        Relative image height.
    azimuth_rad
        Of the point, from right (x) towards down (y); the coma's tail points outwards. The coma is Zernike's, about the
        best image point: how far that moves is distortion.
    """
    rim = (np.arange(_PUPIL) + 0.5) * (2 / _PUPIL) - 1
    v, u = rim[:, None], rim[None, :]
    along = u * math.cos(azimuth_rad) + v * math.sin(azimuth_rad)
    r2 = u**2 + v**2
    waves = COMA_WAVES * height * (r2 - 2 / 3) * along + CURVATURE_WAVES * height**2 * r2
    field = np.where(r2 <= 1, np.exp(2j * math.pi * waves), 0)
    # Of a point at x the path over the pupil is u x / (2 N): a wavefront that rises with u moves the image to +x.
    kernel = np.exp(
        -2j
        * math.pi
        * sample_positions(SAMPLES, SPACING_UM)[:, None]
        * rim
        / (2 * BASE.f_number * WAVELENGTH_NM * 1e-3)
    )
    psf = np.abs(kernel @ field @ kernel.T) ** 2
    return np.asarray(psf / psf.sum())


def comatic_design(
    edge_mm: float, *, heights: int = 9, nodes: int = 17, rank: int | None = None, detail_um: float | None = None
) -> LensDesign:
    """The lens as a design program would give it: point spreads along one radius, to the edge of the field.

    Parameters
    ----------
    edge_mm
        Image height of the last.
    heights
        How many, the axis among them.
    nodes
        Of the grid on each axis.
    rank
        Modes; None: as many as an error of 1 % takes.
    detail_um
        Side of the pixels for which they are chosen.
    """
    share = np.linspace(0, 1, heights)
    psf = np.stack([comatic_psf(h, 0.0) for h in share])[:, None]
    return LensDesign(
        np.array([WAVELENGTH_NM]),
        psf,
        SPACING_UM,
        np.zeros(heights),
        share * edge_mm,
        rank=rank,
        detail_um=detail_um,
        nodes=nodes,
    )


@dataclass(frozen=True, eq=False)
class FirstModes:
    """A blur with the first few modes of a design: they are the design's own for that rank."""

    design: LensDesign
    rank: int

    def point_spread(self, base: DiffractionLimited, distance_m: float, focus_distance_m: float | None) -> PointSpread:
        """The sum of the first modes."""
        whole = self.design.point_spread(base, distance_m, focus_distance_m)
        assert isinstance(whole, FieldPsf)
        error = float(self.design.low_rank.error_by_rank[self.rank - 1])
        return replace(whole, weights=whole.weights[: self.rank], modes=whole.modes[: self.rank], relative_error=error)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Frames of points by modes and by each point's own spread.

    Parameters
    ----------
    ranks
        (n,) numbers of modes.
    at_nodes
        (n,) relative RMS error of the point spreads at the nodes, blurred by a pixel: what the design states.
    of_frames
        (n,) relative RMS error of the frame: modes, turning, and interpolation between heights and nodes.
    direct, summed
        (rows, cols) electrons, each point by its own spread, and by the modes of an error of 1 %.
    chosen
        Number of these.
    """

    ranks: tuple[int, ...]
    at_nodes: Array
    of_frames: Array
    direct: Array
    summed: Array
    chosen: int


def compare_with_direct(
    rows: int = 96, cols: int = 160, *, points: tuple[int, int] = (3, 5), ranks: tuple[int, ...] = RANKS
) -> Comparison:
    """Points over a small frame, whose corner is the edge of the field, through the lens of growing coma.

    Parameters
    ----------
    rows, cols
        Of the frame.
    points
        Rows and columns of them, each near its place.
    ranks
        Numbers of modes.
    """
    chip = load_sensor("vendor-2.2um")
    sensor = chip.with_(rows=rows, cols=cols, cfa=(("G",),), channels={"G": chip.channels["G"]})
    pitch_um = sensor.pixel.width_um.value
    edge_mm = math.hypot(rows, cols) / 2 * pitch_um * 1e-3
    design = comatic_design(edge_mm, rank=max(ranks), detail_um=pitch_um)
    errors = design.low_rank.error_by_rank
    chosen = min(int(np.argmax(errors <= 0.01)) + 1, max(ranks))
    places = _places(rows, cols, points)

    def frame(weights: Array, blur: Blur) -> Array:
        scene = Scene(
            weights=weights[None].astype(np.float32),
            basis=np.array([[1e19]]),
            wavelength_nm=np.array([WAVELENGTH_NM]),
            distance_m=10.0,
        )
        lens = Lens(BASE, blur=blur)
        return Camera(lens, sensor).mean_electrons(scene, 1.0).astype(np.float64)

    direct = np.zeros((rows, cols))
    every = np.zeros((rows, cols))
    for row, col in places:
        y, x = (row + 0.5 - rows / 2) * pitch_um * 1e-3, (col + 0.5 - cols / 2) * pitch_um * 1e-3
        own = comatic_psf(math.hypot(y, x) / edge_mm, math.atan2(y, x))
        one = np.zeros((rows, cols))
        one[row, col] = every[row, col] = 1.0
        direct += frame(one, _alone(own))
    summed = {rank: frame(every, FirstModes(design, rank)) for rank in sorted({*ranks, chosen})}
    of_frames = np.array([np.linalg.norm(summed[rank] - direct) / np.linalg.norm(direct) for rank in ranks])
    at_nodes = errors[np.array(ranks) - 1]
    return Comparison(ranks, at_nodes, of_frames, direct, summed[chosen], chosen)


def _places(rows: int, cols: int, points: tuple[int, int]) -> list[tuple[int, int]]:
    """Pixels, well apart from each other and the border."""
    random = np.random.default_rng(_SEED)
    down, across = points
    return [
        (
            int((i + 0.5) * rows / down + random.integers(-4, 5)),
            int((j + 0.5) * cols / across + random.integers(-4, 5)),
        )
        for i in range(down)
        for j in range(across)
    ]


def _alone(psf: Array) -> LensDesign:
    """The same spread for the whole frame."""
    return LensDesign(np.array([WAVELENGTH_NM]), psf[None, None], SPACING_UM, np.zeros(1), np.zeros(1))


@styled()
def low_rank_figure() -> Figure:
    """Point spreads over a quarter of the field, the error by rank, and a frame of points with its error."""
    found = compare_with_direct()
    figure = Figure(figsize=(8.6, 5.8))
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.35, 1])[:, 0]
    spots, curve = above.subplots(1, 2, width_ratios=[1, 1.25])
    _draw_spots(spots)
    curve.semilogy(found.ranks, found.at_nodes, "o-", color=BLUE, label="pixel-blurred point spreads at the nodes")
    curve.semilogy(found.ranks, found.of_frames, "s--", color=VERMILION, label="frame of 15 points, against direct")
    curve.axhline(0.01, color=GRAY, linewidth=0.8, linestyle=":")
    curve.axvline(found.chosen, color=GRAY, linewidth=0.8, linestyle=":")
    curve.set(xlabel="modes", ylabel="relative RMS error")
    curve.set_title("Error by rank")
    curve.legend(loc="upper right")
    rows, cols = found.direct.shape
    corner = np.s_[rows // 2 :, cols // 2 :]
    direct, summed = (frame[corner] / found.direct.max() for frame in (found.direct, found.summed))
    panels = below.subplots(1, 3)
    scale = 0.005
    for axes, image, title, look in (
        (panels[0], np.sqrt(direct), "lower right: each by its own", ("gray", 0, 1)),
        (panels[1], np.sqrt(summed), f"by {found.chosen} modes", ("gray", 0, 1)),
        (panels[2], summed - direct, "difference, ±0.5 % of the peak", ("RdBu_r", -scale, scale)),
    ):
        axes.imshow(image, cmap=look[0], vmin=look[1], vmax=look[2], interpolation="nearest")
        axes.set_title(title)
        axes.set(xticks=[], yticks=[])
        axes.grid(False)
    return figure


def _draw_spots(axes: Axes) -> None:
    """Point spreads at 4 x 4 places of the lower right quarter, each over its own peak's root."""
    count, half = 4, 18
    middle = SAMPLES // 2
    tile = np.zeros((count * 2 * half, count * 2 * half))
    for i in range(count):
        for j in range(count):
            y, x = i / (count - 1) / math.sqrt(2), j / (count - 1) / math.sqrt(2)
            psf = comatic_psf(math.hypot(y, x), math.atan2(y, x))
            part = psf[middle - half : middle + half, middle - half : middle + half]
            tile[i * 2 * half : (i + 1) * 2 * half, j * 2 * half : (j + 1) * 2 * half] = np.sqrt(part / part.max())
    axes.imshow(tile, cmap="inferno", extent=(0, count, count, 0), interpolation="nearest")
    axes.set_title("Lower right quarter of the field")
    axes.set(xticks=[], yticks=[])
    axes.grid(False)
