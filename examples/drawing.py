"""Helpers that the examples share: exposing, developing, and laying out pictures without resampling them."""

from __future__ import annotations

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import photosite as ps
from photosite.scene.scene import preview

WIDTH, DPI = 736, 100  # pixels of a figure: the width of a page of the documentation
GAP, TITLE = 10, 24
matplotlib.rcParams.update({"font.size": 9, "axes.titlesize": 9, "axes.grid": True, "grid.alpha": 0.3})
matplotlib.rcParams.update({"figure.dpi": DPI, "image.interpolation": "nearest"})


def d200(rows, cols, **changes):
    """Return a Nikon D200 of fewer pixels, with a black level that keeps dark pixels from clipping."""
    return ps.load_sensor("nikon-d200").with_(rows=rows, cols=cols, black_level_dn=64, **changes)


def as_seen(scene, white_cd_m2=None):
    """Return a scene as an eye adapted to daylight (D65) sees it, (rows, cols, 3) display sRGB."""
    return preview(scene, white_cd_m2, white_xy=(0.3127, 0.3290))


def shoot(camera, scene, exposure_s=None):
    """Return a raw frame; by default the brightest half percent of the pixels stay just below saturation."""
    rate = camera.mean_electrons(scene, 1.0)
    if exposure_s is None:
        exposure_s = camera.auto_exposure_s(rate)
    return camera.expose(rate * np.float32(exposure_s), exposure_s, seed=2008, scene=scene)


def mean_on(image, camera, region, channel="G"):
    """Return the mean of an image over the pixels of a channel in a region."""
    tile = np.array(camera.sensor.array.cfa)
    names = np.tile(tile, [-(-size // step) for size, step in zip(image.shape, tile.shape, strict=True)])
    inside = np.s_[region.r0 : region.r1, region.c0 : region.c1]
    return image[inside][names[: image.shape[0], : image.shape[1]][inside] == channel].mean()


def crop(picture, rows, cols, times=1):
    """Return a part of a picture, each pixel enlarged to a square."""
    return picture[rows, cols].repeat(times, axis=0).repeat(times, axis=1)


def panels(rows):
    """Draw rows of (title, picture), one figure pixel per pixel."""
    heights = [TITLE + max(picture.shape[0] for _, picture in row) for row in rows]
    width = max(sum(picture.shape[1] + GAP for _, picture in row) - GAP for row in rows)
    figure = plt.figure(figsize=(width / DPI, sum(heights) / DPI), dpi=DPI)
    for row, top in zip(rows, np.cumsum([0, *heights[:-1]]), strict=True):
        left = 0
        for title, picture in row:
            tall, wide = picture.shape[:2]
            box = (left / width, 1 - (top + TITLE + tall) / sum(heights), wide / width, tall / sum(heights))
            axes = figure.add_axes(box)
            axes.imshow(picture, cmap="gray", vmin=0, vmax=1, aspect="auto")
            axes.set_title(title, loc="left", pad=5)
            axes.set_axis_off()
            left += wide + GAP


def pictures(shown, cols, height_in):
    """Draw a grid of (title, picture), scaled to the width of a page."""
    grid = plt.figure(figsize=(WIDTH / DPI, height_in), layout="constrained").subplots(-(-len(shown) // cols), cols)
    for axes, (title, picture) in zip(np.ravel(grid), shown, strict=True):
        axes.imshow(picture, interpolation="antialiased", cmap="gray", vmin=0, vmax=1)
        axes.set_title(title, fontsize=8)
        axes.set_axis_off()
