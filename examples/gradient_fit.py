"""
Fill factor and crosstalk by gradient descent
=============================================

One noisy frame of a color chart gives both parameters at once: the likelihood of all pixels is maximized with its
gradient, from `photosite.SignalModel`. The fit of patch means, with the crosstalk that was found, gives the same fill
factor.
"""

import drawing
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import photosite as ps
from photosite.metrics.patches import patch_statistics
from photosite.validation.fill_factor import fit_fill_factor

TRUTH, START = np.array([0.82, 0.020]), np.array([0.90, 0.0])  # fill factor; share of charge to each of four neighbors
SPREAD = np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]])  # derivative of the kernel by that share


def camera(fill_factor, leak, serial):
    kernel = np.outer([0, 1, 0], [0, 1, 0]) + leak * SPREAD
    crosstalk = {"electrical": dict.fromkeys("RGB", kernel.tolist())}
    sensor = drawing.d200(124, 184, serial=serial, fill_factor=fill_factor, crosstalk=crosstalk)
    return ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)


chart = ps.charts.macbeth("D65", 100)
measured, simulated = camera(*TRUTH, "measured"), camera(*START, "simulated")
exposure_s = 0.8 * measured.auto_exposure_s(measured.mean_electrons(chart, 1.0))
raw = measured.capture(chart, exposure_s, seed=1)
model = ps.SignalModel(simulated, chart, exposure_s)
no_crosstalk = model.values["electrical_crosstalk"]


def values(x):
    return {"fill_factor": x[0], "electrical_crosstalk": no_crosstalk + x[1] * SPREAD}


def minus_log_likelihood(x):
    """Return it per pixel, for normal noise, and its gradient."""
    mean, variance = model(values(x))
    error = raw.dn - mean
    by_mean, by_variance = -error / variance, (1 - error**2 / variance) / (2 * variance)
    of = model.vjp(values(x), (by_mean, by_variance))
    gradient = np.array([of["fill_factor"], (of["electrical_crosstalk"] * SPREAD).sum()])
    return (error**2 / variance + np.log(variance)).mean() / 2, gradient / error.size


path = [START]
bounds = [(0.1, 1.0), (0.0, 0.2)]
found = minimize(minus_log_likelihood, START, jac=True, bounds=bounds, callback=lambda x: path.append(x.copy()))
mean, variance = model(values(found.x))
directions = {"fill_factor": 1.0}, {"electrical_crosstalk": np.array([SPREAD] * 3)}
slopes = [model.jvp(values(found.x), direction) for direction in directions]
information = [[np.sum(a / variance * b + c * d / variance**2 / 2) for b, d in slopes] for a, c in slopes]
covariance = np.linalg.inv(information)
error = np.sqrt(np.diag(covariance))
again = camera(START[0], found.x[1], "simulated").capture(chart, exposure_s, seed=2)
patches = (patch_statistics(shot, model.camera.image_regions(chart)) for shot in (raw, again))
fit = fit_fill_factor(*patches, fill_factor=START[0])
difference = (found.x[0] - fit.value) / np.hypot(error[0], fit.standard_error)
print(f"gradient descent: fill factor {found.x[0]:.5f} ± {error[0]:.5f}, crosstalk {found.x[1]:.5f} ± {error[1]:.5f}")
print(f"patch means: fill factor {fit.value:.5f} ± {fit.standard_error:.5f}, {difference:+.2f} of both errors away")
print(f"{found.nit} steps, {found.nfev} evaluations, {found.message}")

figure, (far, near, residual) = plt.subplots(1, 3, figsize=(7.36, 3.1), layout="constrained", width_ratios=[1, 1, 1.2])
circle = np.exp(1j * np.linspace(0, 2 * np.pi, 200))
ellipse = found.x[:, None] + 2.448 * np.linalg.cholesky(covariance) @ [circle.real, circle.imag]  # 95 % of two numbers
for axes in (far, near):
    axes.axvspan(*fit.interval_95, color="C1", alpha=0.25, linewidth=0, label="fit of patch means, 95 %")
    axes.plot(*np.transpose(path), ".-", color="C0", linewidth=1)
    axes.plot(*ellipse, color="C0", label="gradient descent, 95 %")
    axes.plot(*TRUTH, "k+", markersize=9, label="truth")
    axes.set_xlabel("fill factor")
far.set(ylabel="charge to each of four neighbors", title="path of the fit")
near.set(title="end of the path", xlim=fit.value + np.array([-4, 3]) * fit.standard_error)
near.set_ylim(found.x[1] + np.array([-4, 4]) * error[1])
shown = residual.imshow((raw.dn - mean) / np.sqrt(variance), cmap="RdBu", vmin=-4, vmax=4, interpolation="antialiased")
residual.set(title="residuals over noise", xticks=[], yticks=[])
figure.colorbar(shown, ax=residual, shrink=0.7)
figure.legend(*near.get_legend_handles_labels(), loc="outside lower left", ncols=3)
plt.show()
