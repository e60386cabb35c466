"""photosite measures image sensors and simulates the cameras around them.

Dark frames and flat fields give a sensor file. A spectral scene, a lens and a sensor file give simulated raw frames.
Measured and simulated frames are compared. Public names are imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# Imported here, because the folder of the same name would hide the function after `import photosite.develop`.
from photosite.develop.develop import develop as develop

__version__ = "0.1.0"

_MODULE_OF = {
    "AutoExposure": "photosite.camera.auto_exposure",
    "Camera": "photosite.camera.camera",
    "DiffractionLimited": "photosite.optics.diffraction",
    "Distortion": "photosite.optics.distortion",
    "DynamicScene": "photosite.scene.dynamic_scene",
    "FieldPoints": "photosite.optics.field_points",
    "IlluminationTable": "photosite.optics.illumination",
    "LateralColor": "photosite.optics.distortion",
    "Lens": "photosite.optics.lens",
    "LensDesign": "photosite.optics.lens_design",
    "Measured": "photosite.values.uncertain",
    "Motion": "photosite.scene.motion",
    "OtfTable": "photosite.optics.tables",
    "Plane": "photosite.scene.planes",
    "Planes": "photosite.scene.planes",
    "PsfTable": "photosite.optics.tables",
    "PulseFlicker": "photosite.scene.flicker",
    "Pupil": "photosite.optics.pupil",
    "RawFrame": "photosite.frames.raw_frame",
    "Scene": "photosite.scene.scene",
    "Sensor": "photosite.sensor.model",
    "SignalModel": "photosite.camera.signal_model",
    "SineFlicker": "photosite.scene.flicker",
    "Spectrum": "photosite.color.spectrum",
    "TableFlicker": "photosite.scene.flicker",
    "VeilingGlare": "photosite.optics.illumination",
    "Wavefront": "photosite.optics.wavefront",
    "bin_frame": "photosite.frames.binning",
    "calibrate": "photosite.calibration.calibrate",
    "calibrate_chart": "photosite.calibration.spectral.chart",
    "calibrate_spectral": "photosite.calibration.spectral.monochromator",
    "compare_cameras": "photosite.studies.camera_comparison",
    "compare_sensors": "photosite.studies.sensor_comparison",
    "convert": "photosite.scene.io.formats",
    "load_camera": "photosite.camera.file",
    "load_camera_profile": "photosite.library.profile",
    "load_optics": "photosite.optics.io.formats",
    "load_sensor": "photosite.sensor.io.sensor_file",
    "measure_polarizers": "photosite.calibration.light.polarizers",
    "noise_budget": "photosite.metrics.snr",
    "capture_budget": "photosite.metrics.capture_snr",
    "open_chart": "photosite.studies.chart_spectral",
    "open_frames": "photosite.frames.open",
    "open_spectral": "photosite.calibration.spectral.protocol",
    "read_lens_design": "photosite.optics.io.formats",
    "read_raw": "photosite.frames.io.formats",
    "read_scene": "photosite.scene.io.formats",
    "slanted_edge_mtf": "photosite.metrics.sharpness",
    "snr": "photosite.studies.gray_surface",
    "stokes": "photosite.develop.polarization",
    "sweep": "photosite.studies.sweep",
    "validate": "photosite.validation.validate",
    "write_scene": "photosite.scene.io.formats",
}
_MODULES = {
    "charts": "photosite.scene.charts",
    "data": "photosite.data",
    "illuminants": "photosite.color.illuminants",
    "lights": "photosite.scene.lights",
    "pictures": "photosite.scene.pictures",
    "render": "photosite.scene.render",
}

__all__ = [*_MODULE_OF, *_MODULES, "__version__", "develop"]

if TYPE_CHECKING:
    from photosite import data as data
    from photosite.calibration.calibrate import calibrate as calibrate
    from photosite.calibration.light.polarizers import measure_polarizers as measure_polarizers
    from photosite.calibration.spectral.chart import calibrate_chart as calibrate_chart
    from photosite.calibration.spectral.monochromator import calibrate_spectral as calibrate_spectral
    from photosite.calibration.spectral.protocol import open_spectral as open_spectral
    from photosite.camera.auto_exposure import AutoExposure as AutoExposure
    from photosite.camera.camera import Camera as Camera
    from photosite.camera.file import load_camera as load_camera
    from photosite.camera.signal_model import SignalModel as SignalModel
    from photosite.color import illuminants as illuminants
    from photosite.color.spectrum import Spectrum as Spectrum
    from photosite.develop.polarization import stokes as stokes
    from photosite.frames.binning import bin_frame as bin_frame
    from photosite.frames.io.formats import read_raw as read_raw
    from photosite.frames.open import open_frames as open_frames
    from photosite.frames.raw_frame import RawFrame as RawFrame
    from photosite.library.profile import load_camera_profile as load_camera_profile
    from photosite.metrics.capture_snr import capture_budget as capture_budget
    from photosite.metrics.sharpness import slanted_edge_mtf as slanted_edge_mtf
    from photosite.metrics.snr import noise_budget as noise_budget
    from photosite.optics.diffraction import DiffractionLimited as DiffractionLimited
    from photosite.optics.distortion import Distortion as Distortion
    from photosite.optics.distortion import LateralColor as LateralColor
    from photosite.optics.field_points import FieldPoints as FieldPoints
    from photosite.optics.illumination import IlluminationTable as IlluminationTable
    from photosite.optics.illumination import VeilingGlare as VeilingGlare
    from photosite.optics.io.formats import load_optics as load_optics
    from photosite.optics.io.formats import read_lens_design as read_lens_design
    from photosite.optics.lens import Lens as Lens
    from photosite.optics.lens_design import LensDesign as LensDesign
    from photosite.optics.pupil import Pupil as Pupil
    from photosite.optics.tables import OtfTable as OtfTable
    from photosite.optics.tables import PsfTable as PsfTable
    from photosite.optics.wavefront import Wavefront as Wavefront
    from photosite.scene import charts as charts
    from photosite.scene import lights as lights
    from photosite.scene import pictures as pictures
    from photosite.scene import render as render
    from photosite.scene.dynamic_scene import DynamicScene as DynamicScene
    from photosite.scene.flicker import PulseFlicker as PulseFlicker
    from photosite.scene.flicker import SineFlicker as SineFlicker
    from photosite.scene.flicker import TableFlicker as TableFlicker
    from photosite.scene.io.formats import convert as convert
    from photosite.scene.io.formats import read_scene as read_scene
    from photosite.scene.io.formats import write_scene as write_scene
    from photosite.scene.motion import Motion as Motion
    from photosite.scene.planes import Plane as Plane
    from photosite.scene.planes import Planes as Planes
    from photosite.scene.scene import Scene as Scene
    from photosite.sensor.io.sensor_file import load_sensor as load_sensor
    from photosite.sensor.model import Sensor as Sensor
    from photosite.studies.camera_comparison import compare_cameras as compare_cameras
    from photosite.studies.chart_spectral import open_chart as open_chart
    from photosite.studies.gray_surface import snr as snr
    from photosite.studies.sensor_comparison import compare_sensors as compare_sensors
    from photosite.studies.sweep import sweep as sweep
    from photosite.validation.validate import validate as validate
    from photosite.values.uncertain import Measured as Measured


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        value: Any = importlib.import_module(_MODULES[name])
    elif name in _MODULE_OF:
        value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    else:
        raise AttributeError(f"module 'photosite' has no attribute '{name}'")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
