"""
A portrait in low light
=======================

A portrait under CIE A at four mean luminances, D200 at f/8 and 1/60 s. Titles give the electrons of the green pixels
on the face and their signal-to-noise ratio, fixed pattern included. (Commodore Grace M. Hopper, U.S. Navy, 1984,
public domain; the file is part of matplotlib.)
"""

from dataclasses import replace

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
from drawing import d200, panels
from matplotlib.cbook import get_sample_data

import photosite as ps

FACE = np.s_[102:234, 126:248]  # pixels, forehead to chin
portrait = matplotlib.image.imread(get_sample_data("grace_hopper.jpg"))
lens = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
camera = ps.Camera(lens, d200(436, 364))
chip_m = 364 * camera.sensor.pixel.width_um.value * 1e-6
shown = []
for luminance_cd_m2 in (500.0, 50.0, 15.0, 5.0):
    scene = ps.pictures.from_rgb(portrait, "A", luminance_cd_m2)
    # The portrait is half a meter wide and fills the frame: |m| = f / (d - f).
    scene = replace(scene, distance_m=0.05 * (1 + 0.5 / chip_m), width_m=None)
    mean_e = camera.mean_electrons(scene, 1 / 60)
    raw = camera.expose(mean_e, 1 / 60, seed=2008, scene=scene)
    read_e = (raw.dn - raw.black_level_dn) / camera.sensor.system_gain_dn_per_e
    # Green pixels of the R G / G B tile in every second row.
    green_e, error_e = mean_e[FACE][0::2, 1::2], (read_e - mean_e)[FACE][0::2, 1::2]
    snr_db = 20 * np.log10(green_e.mean() / np.sqrt(np.mean(error_e**2)))
    title = f"{luminance_cd_m2:g} cd/m²: {green_e.mean():,.0f} e⁻ on the face, {snr_db:.1f} dB"
    shown.append((title, ps.develop(raw)))
panels([shown[:2], shown[2:]])
plt.show()
