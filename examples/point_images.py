"""
Images of a point
=================

Irradiance of a point of light at 550 nm behind eight f/4 lenses, over four decades relative to the peak of the
perfect lens. Aberrations are Zernike terms of 80 nm RMS. Titles give the peak, which is the Strehl ratio where the
pupil is a full circle.
"""

import drawing  # noqa: F401 - the style of the figures
import matplotlib.pyplot as plt
import numpy as np

import photosite as ps
from photosite.optics.point_spread import RadialPsf

NM, HALF_UM, SAMPLES = 550.0, 14.0, 257
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
WAVEFRONTS = {  # Zernike terms by Noll's number, RMS in nm
    "no aberration": ps.optics.Wavefront(),
    "defocus": ps.optics.Wavefront({4: 80.0}),
    "coma": ps.optics.Wavefront({8: 80.0}),
    "astigmatism": ps.optics.Wavefront({6: 80.0}),
    "spherical aberration": ps.optics.Wavefront({11: 80.0}),
    "six blades": ps.optics.Wavefront(pupil=ps.optics.Pupil(blades=6)),
    "obscured by 0.4": ps.optics.Wavefront(pupil=ps.optics.Pupil(obscuration=0.4)),
    "obscured by 0.4, four vanes": ps.optics.Wavefront(pupil=ps.optics.Pupil(0.4, vanes=4, vane_width=0.02)),
}


def transfer(wavefront, fy, fx):
    """Return the transfer function; that of a symmetric lens depends on the radial frequency alone."""
    spread = wavefront.point_spread(LENS, np.inf)
    if isinstance(spread, RadialPsf):
        return spread.otf(np.hypot(fy, fx), NM)
    return spread.otf(fy, fx, NM)


def point_image(wavefront):
    """Return the point spread per m2, a Fourier sum fine enough that its periods do not overlap."""
    step = 1 / (16 * HALF_UM * 1e-6)
    highest = np.ceil(LENS.cutoff_per_m(NM, np.inf) / step)
    f = np.arange(-highest, highest + 1) * step
    at_m = (np.arange(SAMPLES) + 0.5 - SAMPLES / 2) * (2 * HALF_UM * 1e-6 / SAMPLES)
    wave = np.exp(2j * np.pi * at_m[:, None] * f)
    return (wave @ transfer(wavefront, f[:, None], f[None, :]) @ wave.T).real * step**2


peak = (np.pi / 4) / (NM * 1e-9 * LENS.f_number) ** 2  # of the perfect lens
figure, grid = plt.subplots(4, 2, figsize=(7.36, 14.2), layout="constrained")
for axes, (title, wavefront) in zip(grid.flat, WAVEFRONTS.items(), strict=True):
    image = point_image(wavefront) / peak
    extent = [-HALF_UM, HALF_UM, HALF_UM, -HALF_UM]
    drawn = axes.imshow(np.log10(np.maximum(image, 1e-4)), vmin=-4, vmax=0, cmap="magma", extent=extent)
    axes.set_title(f"{title}; peak {image.max():.2f}")
    axes.set(xlabel="µm", yticks=[])
    axes.grid(False)
bar = figure.colorbar(drawn, ax=grid, location="bottom", aspect=60, ticks=[-4, -3, -2, -1, 0])
bar.set_label("log₁₀ of irradiance / peak of the perfect lens")

# %%
# The modulation transfer functions of the same lenses, in two directions.

figure, grid = plt.subplots(4, 2, figsize=(7.36, 9.6), layout="constrained", sharex=True, sharey=True)
f = np.linspace(0.0, LENS.cutoff_per_m(NM, np.inf), 401)
for axes, (title, wavefront) in zip(grid.flat, WAVEFRONTS.items(), strict=True):
    axes.plot(f * 1e-3, LENS.otf(f, NM, np.inf), "gray", linestyle=":", label="no aberration")
    axes.plot(f * 1e-3, np.abs(transfer(wavefront, 0 * f, f)), label="horizontal")
    axes.plot(f * 1e-3, np.abs(transfer(wavefront, f, 0 * f)), "C3--", label="vertical")
    axes.set(title=title, xlim=(0, f[-1] * 1e-3), ylim=(0, 1.02))
grid[0, 0].legend(loc="upper right")
figure.supxlabel("spatial frequency (cycles/mm)")
figure.supylabel("MTF")
plt.show()
