"""A virtual monochromator: frames of a virtual sensor in narrow bands of light, and readings of a photodiode.

The light is uniform on the bare sensor, as from an integrating sphere. Errors of the readings and of the photodiode's
scale are drawn from the seed, with the stated uncertainties.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spectral.bands import Band, Passband, Photodiode, SpectralFrames, triangular_passband
from photosite.camera.camera import Camera
from photosite.camera.optical_stack import channel_mixing
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import Spectrum, photons_from_energy
from photosite.errors import InputError
from photosite.files.writing import atomic_folder
from photosite.frames.frame_set import FrameSource
from photosite.frames.raw_frame import RawFrame
from photosite.optics.diffraction import DiffractionLimited
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_mask
from photosite.values.exposure import format_exposure
from photosite.values.uncertain import Measured

PROTOCOL_NAME, TRUTH_NAME, NOMINAL_NAME, DIODE_NAME = (
    "spectral.yaml",
    "truth.sensor.yaml",
    "nominal.sensor.yaml",
    "photodiode.csv",
)
_STEP_NM = 0.05
"""Step of the sum over a band, a reference for the exact integrals of the calibration."""

_FILL = 0.6
"""Signal of the brightest channel in each band relative to saturation."""

_DIODE_AREA_MM2 = 100.0
_QUANTUM_YIELD = 0.8
"""Electrons per photon of the photodiode at all wavelengths."""


@dataclass(frozen=True)
class MonochromatorRun:
    """A virtual measurement of quantum efficiency.

    Parameters
    ----------
    sensor
        The virtual sensor; its dark frames must not clip (`photosite.studies.virtual_lab.with_pedestal`).
    centres_nm
        Centers of the bands.
    bandwidth_nm
        Full width at half maximum of the triangular bands.
    frames, dark_frames
        Light frames per band, and dark frames per exposure.
    reading_percent
        Relative standard uncertainty of each reading, and the spread of its error.
    scale_percent
        Relative standard uncertainty of the photodiode's scale, and the spread of its error.
    flicker_percent
        PointSpread of the light from frame to frame.
    seed
        Key of noise and errors.

    Examples
    --------
    >>> import photosite as ps
    >>> from photosite.studies.virtual_lab import with_pedestal
    >>> sensor = with_pedestal(ps.load_sensor("nikon-d200").with_(rows=8, cols=8))
    >>> MonochromatorRun(sensor, centres_nm=(500.0, 550.0)).frame_set().frame_count
    24
    """

    sensor: Sensor
    centres_nm: tuple[float, ...] = tuple(np.arange(380.0, 781.0, 10.0).tolist())
    bandwidth_nm: float = 5.0
    frames: int = 4
    dark_frames: int = 8
    reading_percent: float = 0.3
    scale_percent: float = 0.5
    flicker_percent: float = 0.0
    seed: int = 0

    def passband(self, number: int) -> Passband:
        """Return the passband of a band."""
        return triangular_passband(self.centres_nm[number], self.bandwidth_nm)

    def exposure_s(self, number: int) -> float:
        """Return the exposure time at which the brightest channel comes near 60 % of saturation."""
        fullest = max(self.electron_rate(number).values())
        if not fullest > 0:
            raise InputError(
                f"'{self.sensor.name}' does not respond at {self.centres_nm[number]:g} nm", hint="Omit this band"
            )
        wanted = min(_FILL * self.sensor.saturation_capacity_e / fullest, 10.0)
        # Powers of two, so that bands share exposure times and dark frames.
        return float(2.0 ** math.floor(math.log2(wanted)))

    def irradiance_w_m2(self, number: int) -> float:
        """Return the irradiance of a tungsten lamp, 5 mW/m2 at 560 nm."""
        centre = self.centres_nm[number]
        return 5e-3 * float(illuminant("A", [centre])[0]) / 100.0

    def electron_rate(self, number: int) -> dict[str, float]:
        """Return mean electrons per second and pixel by channel, a sum over the band; crosstalk included."""
        band = self.passband(number).energy
        sensor = self.sensor
        grid = np.arange(band.wavelength_nm[0], band.wavelength_nm[-1] + _STEP_NM / 2, _STEP_NM)
        shape = band.at(grid) if grid.size > 1 else np.ones(1)
        photons = photons_from_energy(self.irradiance_w_m2(number) * shape / shape.sum(), grid)
        area_m2 = sensor.pixel_area_m2 * sensor.pixel.fill_factor.value
        names = sensor.channel_names
        alone = [float(photons @ sensor.response_at(name, grid)) * area_m2 for name in names]
        return dict(zip(names, (channel_mixing(sensor) @ alone).tolist(), strict=True))

    def photodiode(self) -> Photodiode:
        """Return the photodiode with its certified responsivity, q lambda / (h c) times its yield."""
        grid = np.arange(350.0, 851.0, 10.0)
        return Photodiode(
            Spectrum(grid, _QUANTUM_YIELD * grid / 1239.841984), np.zeros(grid.size), Measured(_DIODE_AREA_MM2)
        )

    def reading_a(self, number: int) -> Measured:
        """Return the photocurrent with its error and uncertainty."""
        errors = np.random.default_rng([self.seed, 31, number])
        scale = np.random.default_rng([self.seed, 32])
        response = self.passband(number).mean_responsivity_a_per_w(self.photodiode().responsivity_a_per_w)
        true = self.irradiance_w_m2(number) * response * _DIODE_AREA_MM2 * 1e-6
        wrong = 1.0 + self.reading_percent / 100 * errors.standard_normal()
        reading = true * wrong * (1.0 + self.scale_percent / 100 * scale.standard_normal())
        return Measured(reading, reading * self.reading_percent / 100)

    def frame_set(self, sensor: Sensor | None = None) -> SpectralFrames:
        """Return the measurement for `calibrate_spectral`; each frame is simulated when it is read.

        Parameters
        ----------
        sensor
            Sensor as known before the measurement; the virtual sensor by default.
        """
        diode = self.photodiode()
        bands = tuple(
            Band(
                f"{centre:g} nm",
                self.passband(number),
                self.exposure_s(number),
                tuple(
                    FrameSource(f"band {centre:g} nm, frame {n}", partial(self._light_dn, number, n))
                    for n in range(self.frames)
                ),
                self.reading_a(number),
                diode,
            )
            for number, centre in enumerate(self.centres_nm)
        )
        darks = {
            exposure_s: tuple(
                FrameSource(f"dark at {exposure_s:g} s, frame {n}", partial(self._dark_dn, exposure_s, n))
                for n in range(self.dark_frames)
            )
            for exposure_s in sorted({band.exposure_s for band in bands})
        }
        array, bits = self.sensor.array, self.sensor.readout.bits
        return SpectralFrames(
            bands, darks, array.rows, array.cols, bits, array.cfa, sensor or self.sensor,
            scale_uncertainty_percent=self.scale_percent, source="virtual monochromator",
        )  # fmt: skip

    def write(self, folder: str | PathLike[str]) -> None:
        """Write frames, spectral.yaml, the responsivity of the photodiode and sensor files to a new folder."""
        with atomic_folder(folder) as place:
            self.sensor.save(place / TRUTH_NAME)
            without_spectra(self.sensor).save(place / NOMINAL_NAME)
            self._write_diode(place / DIODE_NAME)
            (place / "dark").mkdir()
            (place / "band").mkdir()
            entries: dict[str, list[dict[str, Any]]] = {"darks": [], "bands": []}
            exposures = sorted({self.exposure_s(number) for number in range(len(self.centres_nm))})
            for step, exposure_s in enumerate(exposures):
                for n in range(self.dark_frames):
                    self._dark(exposure_s, n).save(place / "dark" / f"{step:02d}_{n:03d}.tif")
                files = f"dark/{step:02d}_*.tif"
                entries["darks"].append({"exposure": format_exposure(exposure_s), "files": files})
            for number, centre in enumerate(self.centres_nm):
                for n in range(self.frames):
                    self._light(number, n).save(place / "band" / f"{number:03d}_{n:03d}.tif")
                reading = self.reading_a(number)
                entries["bands"].append(
                    {
                        "centre_nm": float(centre),
                        "bandwidth_nm": self.bandwidth_nm,
                        "exposure": format_exposure(self.exposure_s(number)),
                        "files": f"band/{number:03d}_*.tif",
                        "photocurrent_a": {
                            "value": float(reading.value),
                            "standard_uncertainty": float(reading.standard_uncertainty),
                        },
                    }
                )
            self._write_protocol(place / PROTOCOL_NAME, entries)

    def _write_protocol(self, path: Path, entries: dict[str, list[dict[str, Any]]]) -> None:
        from ruamel.yaml import YAML

        content = {
            "photosite_spectral": 1,
            "name": f"{self.sensor.name}, virtual monochromator, {self.bandwidth_nm:g} nm",
            "sensor": NOMINAL_NAME,
            "photodiode": {"area_mm2": _DIODE_AREA_MM2, "responsivity": DIODE_NAME},
            "scale_uncertainty_percent": self.scale_percent,
            **entries,
        }
        yaml = YAML()
        yaml.default_flow_style = None
        yaml.width = 1 << 16
        with path.open("w", encoding="utf-8") as stream:
            yaml.dump(content, stream)

    def _write_diode(self, path: Path) -> None:
        responsivity = self.photodiode().responsivity_a_per_w
        lines = ["wavelength_nm,responsivity_a_per_w"]
        lines += [
            f"{nm:g},{float(value)!r}"
            for nm, value in zip(responsivity.wavelength_nm, responsivity.values, strict=True)
        ]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def _camera(self) -> Camera:
        return Camera(DiffractionLimited(f_number=8, focal_length_mm=50), self.sensor)  # the lens is not used

    def _mosaic(self, rates: dict[str, float], exposure_s: float) -> NDArray[np.float32]:
        array = self.sensor.array
        mosaic = np.zeros((array.rows, array.cols), np.float32)
        for name, rate in rates.items():
            mosaic[channel_mask(array.cfa, name, mosaic.shape)] = rate * exposure_s
        return mosaic

    def _light(self, number: int, frame: int) -> RawFrame:
        exposure_s = self.exposure_s(number)
        lamp = np.random.default_rng([self.seed, 33, number, frame])
        factor = 1.0 + self.flicker_percent / 100 * lamp.standard_normal()
        rates = {name: rate * factor for name, rate in self.electron_rate(number).items()}
        place = self.dark_frames * 64 + number * self.frames + frame
        return self._camera().expose(self._mosaic(rates, exposure_s), exposure_s, seed=self.seed, frame=place)

    def _dark(self, exposure_s: float, frame: int) -> RawFrame:
        # Exposure times are powers of two, 2^-40 to 2^23 s, so that each has its own frame numbers.
        place = (math.frexp(exposure_s)[1] + 40) * self.dark_frames + frame
        return self._camera().expose(self._mosaic({}, exposure_s), exposure_s, seed=self.seed, frame=place)

    def _light_dn(self, number: int, frame: int) -> NDArray[np.uint16]:
        return self._light(number, frame).dn

    def _dark_dn(self, exposure_s: float, frame: int) -> NDArray[np.uint16]:
        return self._dark(exposure_s, frame).dn


def without_spectra(sensor: Sensor) -> Sensor:
    """Return the sensor with a placeholder quantum efficiency of 50 %, without filters and crosstalk.

    Examples
    --------
    >>> import photosite as ps
    >>> without_spectra(ps.load_sensor("nikon-d200")).channels["G"].quantum_efficiency
    (0.5, 0.5)
    """
    placeholder = {
        "wavelength_nm": (380.0, 780.0),
        "quantum_efficiency": (0.5, 0.5),
        "source": "placeholder: to be measured",
        "assumed": True,
    }
    parts = dict.fromkeys(("infrared_filter", "cover_glass", "crosstalk"))
    return sensor.with_(channels=dict.fromkeys(sensor.channels, placeholder), **parts)
