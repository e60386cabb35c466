"""An instance of every public class, and of those that public functions return."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import photosite as ps
from photosite.calibration.gain_series.result import ConversionGainSwitch, GainMode, GainSeries, GainStep
from photosite.calibration.result import Calibration
from photosite.calibration.spectral.chart import ChartViews
from photosite.calibration.spectral.result import SpectralCalibration
from photosite.camera.file import SetUp
from photosite.frames.frame_set import FrameSet
from photosite.library.profile import CameraProfile
from photosite.library.sources import CameraSource
from photosite.library.spectra import SpectralFile, SpectralSensitivity
from photosite.metrics.sharpness.slanted_edge import SlantedEdge
from photosite.sensor.noise_profile import NoiseProfile
from photosite.validation.result import Validation
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate

GRID = np.arange(400.0, 701.0, 10.0)
SHAPE = (44, 64)


def sensor() -> ps.Sensor:
    return ps.load_sensor("nikon-d200").with_(rows=SHAPE[0], cols=SHAPE[1], black_level_dn=64)


def base() -> ps.DiffractionLimited:
    return ps.DiffractionLimited(f_number=8, focal_length_mm=50, transmittance=ps.Spectrum([300, 900], [0.9, 0.8]))


def lens() -> ps.Lens:
    return ps.Lens(
        ps.DiffractionLimited(4, 50),
        ps.optics.Wavefront({8: 50.0}),
        focus_distance_m=2.0,
        illumination=ps.optics.IlluminationTable(field(), [1, 0.8]),
        distortion=ps.optics.Distortion.polynomial(-0.1),
        lateral_color=ps.optics.LateralColor.from_magnification([450, 650], [1.0002, 1]),
        veiling_glare=ps.optics.VeilingGlare(0.02),
        name="test lens",
    )


def field() -> ps.optics.FieldPoints:
    return ps.optics.FieldPoints(angle_deg=[0, 20])


def psf_table() -> ps.optics.PsfTable:
    x = np.arange(-20, 21) * 0.5
    gauss = np.exp(-(x[:, None] ** 2 + x**2) / 2)
    return ps.optics.PsfTable([550.0], [gauss / gauss.sum()], spacing_um=0.5)


def design() -> ps.optics.LensDesign:
    axis = np.arange(-10, 11) * 0.5
    r2 = axis[:, None] ** 2 + axis**2
    psf = np.stack([np.exp(-r2 / 2), np.exp(-r2 / 4)])[:, None]
    return ps.optics.LensDesign(np.array([550.0]), psf, 0.5, np.zeros(2), np.array([0.0, 8.0]))


def scene() -> ps.Scene:
    return ps.charts.macbeth("D65", 100)


def planes() -> ps.scenes.Planes:
    near = ps.Scene(np.ones((1, 8, 8), np.float32), np.full((1, GRID.size), 5e14), GRID, distance_m=1, width_m=0.01)
    return ps.scenes.Planes((near, ps.Scene.uniform(np.full(GRID.size, 1e14), GRID, distance_m=3)))


def camera() -> ps.Camera:
    return ps.Camera(lens(), sensor())


@functools.cache
def raw() -> ps.RawFrame:
    return ps.Camera(base(), sensor()).capture(scene(), 1 / 30, seed=3)


@functools.cache
def frames() -> FrameSet:
    rng = np.random.default_rng(1)
    settings = [("dark", 0.01), ("dark", 0.1), ("light", 0.01), ("light", 0.02), ("light", 0.03)]

    def frame(kind: str, exposure_s: float) -> Any:
        electrons = rng.poisson(1e5 * exposure_s * (kind == "light"), (16, 16))
        return kind, exposure_s, np.uint16(64.5 + 0.5 * electrons + rng.normal(0, 2, (16, 16)))

    mono = sensor().with_(rows=16, cols=16, cfa=(("M",),), channels={"M": sensor().channels["G"]})
    return FrameSet.from_arrays([frame(*entry) for entry in settings for _ in range(4)], bits=12, sensor=mono)


@functools.cache
def calibration() -> Calibration:
    return ps.calibrate(frames())


def series() -> GainSeries:
    steps = tuple(GainStep(setting, calibration()) for setting in (100.0, 200.0))
    switch = ConversionGainSwitch(
        (100, 200), (100, 200), Estimate(3.0, 0.1), Estimate(0.3, 0.01), 1e-4, ("read noise",)
    )
    mode = GainMode((100.0, 200.0), Estimate(6.0, 0.1), Estimate(1.5, 0.02), 1.3, 1, 0.4)
    return GainSeries(
        steps,
        "proportional",
        switch,
        (mode,),
        Estimate(150.0, 2.0),
        (Diagnostic("odd", "warning", "a warning"),),
        "memory",
    )


@functools.cache
def validation() -> Validation:
    shots = [ps.Camera(base(), sensor()).capture(scene(), 1 / 30, seed=seed) for seed in (4, 5)]
    return ps.validate([shots[0]], [shots[1]], chart="macbeth")


def views() -> ChartViews:
    light = 1e3 * np.exp(-(((GRID - np.linspace(420, 680, 12)[:, None]) / 40) ** 2))
    channels = [sensor().response_at(name, GRID) for name in sensor().channel_names]
    electrons = light @ np.stack(channels).T
    patch, one = np.arange(12), np.zeros(12, np.int64)
    return ChartViews(GRID, light, electrons, 0.01 * electrons + 1, electrons > 0, patch, one, ("D65",))


@functools.cache
def spectral() -> SpectralCalibration:
    return ps.calibrate_chart(views(), sensor(), draws=50)


def edge() -> SlantedEdge:
    chart = ps.charts.slanted_edge("D65", 100)
    shot = ps.Camera(base(), sensor().with_(rows=64, cols=64), cells_per_pixel=3).capture(chart, 1 / 60)
    return ps.slanted_edge_mtf(shot, channel="G")


def pairs() -> ps.training.PairDataset:
    return ps.training.PairDataset(ps.training.Electrons([np.full((4, 4), 100.0)]), sensor(), crop=(2, 2), draws=2)


def camera_profile() -> CameraProfile:
    spectra = SpectralSensitivity(GRID, {"R": GRID / 700, "G": GRID / 800})
    file = SpectralFile("Acme", "X-1", "CC0-1.0", "a lab", spectra)
    source = CameraSource("Acme X-1", "spectral sensitivity", Path("x.json"), "CC0-1.0", "a lab", file)
    noise = NoiseProfile(("M",), (ps.Measured(1e-3, 1e-4),), (ps.Measured(1e-6),), 400.0)
    return CameraProfile("Acme X-1", 400.0, noise, spectra, sensor(), (source,), {"well": "unknown"}, ("a note",))


INSTANCES: dict[str, Callable[[], Any]] = {
    "AutoExposure": lambda: ps.AutoExposure(0.01),
    "Camera": camera,
    "CameraProfile": camera_profile,
    "DiffractionLimited": base,
    "Diagnostic": lambda: ps.Diagnostic("no-flats", "warning", "no light frames"),
    "Distortion": lambda: lens().distortion,
    "DynamicScene": lambda: ps.scenes.DynamicScene(scene(), flicker=ps.scenes.SineFlicker(100.0, 0.2)),
    "FieldPoints": field,
    "IlluminationTable": lambda: lens().illumination,
    "LateralColor": lambda: lens().lateral_color,
    "Lens": lens,
    "LensDesign": design,
    "Measured": lambda: ps.Measured(0.52, 0.004, source="150 dark frames"),
    "MeasuredChip": lambda: ps.MeasuredChip(
        offset_dn=np.full((4, 6), 0.5, np.float32), read_noise_dn=np.full((4, 6), 2.0, np.float32)
    ),
    "Motion": lambda: ps.scenes.Motion(10.0, 20.0, 5.0, 0.1),
    "OtfTable": lambda: ps.optics.OtfTable([550.0], [0.0, 50.0, 100.0], [[1.0, 0.5, 0.0]]),
    "Plane": lambda: planes().planes[0],
    "Planes": planes,
    "PsfTable": psf_table,
    "PulseFlicker": lambda: ps.scenes.PulseFlicker(1000.0, 0.1),
    "Pupil": lambda: ps.optics.Pupil(blades=7),
    "RawFrame": raw,
    "Region": lambda: ps.Region("white", 10, 20, 0, 5),
    "Scene": scene,
    "Sensor": sensor,
    "SignalModel": lambda: ps.SignalModel(ps.Camera(base(), sensor()), scene(), 0.01),
    "SineFlicker": lambda: ps.scenes.SineFlicker(100.0, 0.2),
    "Spectrum": lambda: ps.Spectrum(GRID, np.sin(GRID)),
    "TableFlicker": lambda: ps.scenes.TableFlicker(100.0, (0.5, 1.0, 1.5, 1.0)),
    "VeilingGlare": lambda: lens().veiling_glare,
    "Wavefront": lambda: lens().blur,
    # returned by public functions and methods
    "Calibration": calibration,
    "ChartViews": views,
    "Chart": lambda: ps.charts.ramp.chart(cols=64),
    "FieldPsf": lambda: ps.Lens(ps.DiffractionLimited(4, 50), design()).point_spread(math.inf),
    "FrameSet": frames,
    "GainSeries": series,
    "NoiseBudget": lambda: ps.noise_budget(sensor(), [0.001, 0.01, 0.1, 1.0]),
    "PairDataset": pairs,
    "PlanePsf": lambda: lens().point_spread(2.0),
    "RadialMapping": lambda: lens().mapping(2.0),
    "RadialPsf": lambda: base().point_spread(2.0),
    "SetUp": SetUp,
    "SlantedEdge": edge,
    "SpectralCalibration": spectral,
    "TablePsf": lambda: ps.Lens(ps.DiffractionLimited(4, 50), psf_table()).point_spread(2.0),
    "Validation": validation,
}
