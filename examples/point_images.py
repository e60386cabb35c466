"""Images of a point and transfer functions of eight f/4 lenses at 550 nm."""

import numpy as np
from drawing import save
from matplotlib.figure import Figure

import photosite as ps
from photosite.optics.point_spread import RadialPsf

NM, HALF_UM, SAMPLES = 550.0, 20.0, 257
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
WAVEFRONTS = {  # Zernike terms by Noll's number, RMS in nm
    "no aberration": ps.Wavefront(),
    "defocus, 80 nm": ps.Wavefront({4: 80.0}),
    "coma, 80 nm": ps.Wavefront({8: 80.0}),
    "astigmatism, 80 nm": ps.Wavefront({6: 80.0}),
    "spherical, 80 nm": ps.Wavefront({11: 80.0}),
    "six blades": ps.Wavefront(pupil=ps.Pupil(blades=6)),
    "obscured by 0.4": ps.Wavefront(pupil=ps.Pupil(obscuration=0.4)),
    "0.4 and four vanes": ps.Wavefront(pupil=ps.Pupil(0.4, vanes=4, vane_width=0.02)),
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
    f = np.arange(-np.ceil(LENS.cutoff_per_m(NM, np.inf) / step), np.ceil(LENS.cutoff_per_m(NM, np.inf) / step) + 1)
    f *= step
    at_m = (np.arange(SAMPLES) + 0.5 - SAMPLES / 2) * (2 * HALF_UM * 1e-6 / SAMPLES)
    wave = np.exp(2j * np.pi * at_m[:, None] * f)
    return (wave @ transfer(wavefront, f[:, None], f[None, :]) @ wave.T).real * step**2


figure = Figure(figsize=(11.0, 9.4), layout="constrained")
grid = figure.subplots(4, 4, height_ratios=(1.15, 1, 1.15, 1))
f = np.linspace(0.0, LENS.cutoff_per_m(NM, np.inf), 401)
peak = (np.pi / 4) / (NM * 1e-9 * LENS.f_number) ** 2  # of the perfect lens
for k, (title, wavefront) in enumerate(WAVEFRONTS.items()):
    above, below = grid[2 * (k // 4), k % 4], grid[2 * (k // 4) + 1, k % 4]
    image = point_image(wavefront) / peak
    drawn = above.imshow(np.log10(np.maximum(image, 1e-4)), vmin=-4, vmax=0, cmap="magma", extent=[-20, 20, 20, -20])
    above.set_title(f"{title}; peak {image.max():.2f}")
    above.set(xticks=[-20, 0, 20], xlabel="µm", yticks=[])
    above.grid(False)
    below.plot(f * 1e-3, LENS.otf(f, NM, np.inf), "gray", linestyle=":", label="no aberration")
    below.plot(f * 1e-3, np.abs(transfer(wavefront, 0 * f, f)), label="horizontal")
    below.plot(f * 1e-3, np.abs(transfer(wavefront, f, 0 * f)), "C3--", label="vertical")
    below.set(xlim=(0, f[-1] * 1e-3), ylim=(0, 1.02), xlabel="cycles/mm", ylabel="MTF" if k % 4 == 0 else "")
grid[1, 0].legend(loc="upper right")
bar = figure.colorbar(drawn, ax=grid[0::2, :], fraction=0.02, ticks=[-4, -3, -2, -1, 0])
bar.set_label("log₁₀ of irradiance / peak of the perfect lens")
save(figure, "point-images.png")
