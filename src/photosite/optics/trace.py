"""Lenses from prescriptions: rays of rayoptics become point spreads, distortion, lateral color and illumination.

For each field point and wavelength, rays through the pupil give the optical path W and the direction cosines (L, M) at
the image. W is fitted by a polynomial of the direction, and the amplitude is the Debye integral over directions::

    U(x, y) = integral a(L, M) exp(2 pi i (W(L, M) + L x + M y) / wavelength) dL dM

about the point where the chief ray meets the sensor. a^2 is the pupil area per solid angle; beyond the rim, which rays
that clear apertures do not block define, it is 0. The relative illumination is the ratio of the rims' areas in (L, M).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io.prescription import Prescription, read_prescription
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_PUPIL_RAYS, _RIM_RAYS, _DEGREE = 21, 48, 10
_DIRECTIONS = 160
_MOST_SAMPLES = 256
_BISECTIONS = 12
_NO_APERTURE_MM = 1e6


@dataclass(frozen=True, eq=False)
class RayBundle(Shown):
    """Rays of one field point and wavelength at the image, lengths in mm.

    Parameters
    ----------
    pupil
        (n, 2) relative coordinates of the rays in the entrance pupil.
    direction
        (n, 2) direction cosines L, M at the image.
    landing
        (n, 2) points on the sensor from the axis.
    path
        (n,) optical path to the chief ray's point.
    rim
        (m, 2) direction cosines of the rim of the pupil, in order.
    chief
        (2,) point of the chief ray on the sensor.
    even
        (n,) whether a ray is of the even grid over the pupil, not of the rim.
    """

    pupil: Array
    direction: Array
    landing: Array
    path: Array
    rim: Array
    chief: Array
    even: NDArray[np.bool_]

    @property
    def projected_solid_angle(self) -> float:
        """Area of the rim in the plane of direction cosines."""
        x, y = self.rim.T
        return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    @property
    def spot_radius_mm(self) -> float:
        """RMS distance of the rays from their centroid."""
        points = self.landing[self.even]
        return math.sqrt(float(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class TracedLens(Shown):
    """What the rays through a prescription say.

    Parameters
    ----------
    lens
        The lens that a camera uses.
    field_deg
        (F,) field angles.
    wavelength_nm
        (L,).
    bundles
        Per field, per wavelength.
    prescription
        What was traced.
    reference
        Index of the reference wavelength.
    surfaces, paths
        Sections of the surfaces, and rays of the field angles, as (n, 2) points z, y in mm.
    """

    lens: Lens
    field_deg: Array
    wavelength_nm: Array
    bundles: tuple[tuple[RayBundle, ...], ...]
    prescription: Prescription
    reference: int
    surfaces: tuple[Array, ...]
    paths: tuple[tuple[Array, ...], ...]

    @property
    def distortion_percent(self) -> Array:
        """(F,) distortion of the reference wavelength, percent of f tan(angle); NaN on the axis, which has none."""
        distortion = self.lens.distortion
        if distortion is None:
            return np.full(self.field_deg.shape, np.nan)
        return np.asarray(np.where(self.field_deg > 0.0, 100.0 * (distortion.ratio - 1.0), np.nan))


def trace_lens(
    path: str | PathLike[str], *, fields: int = 6, progress: Callable[[int, int, str], None] | None = None
) -> TracedLens:
    """Trace a lens prescription.

    Parameters
    ----------
    path
        Zemax `.zmx`, CODE V `.seq`, or a plain table (`photosite.optics.io.prescription`).
    fields
        Field points from the axis to the largest field of the file, 2 or more.
    progress
        Called with (done, total, unit).

    Raises
    ------
    FileError
        If the file cannot be read, or a chief ray does not reach the sensor.
    InputError
        If `fields` is too small.
    """
    if fields < 2:
        raise InputError("fields", value=fields, expected="2 or more")
    prescription = read_prescription(Path(path))
    rays = _Rays(prescription)
    angles = np.linspace(0.0, rays.largest_field_deg, fields) if rays.largest_field_deg > 0 else np.zeros(1)
    wavelengths = np.array(sorted(rays.wavelength_nm))
    reference = int(np.argmin(np.abs(wavelengths - rays.reference_nm)))
    bundles = []
    total = angles.size * wavelengths.size
    for k, angle in enumerate(angles):
        bundles.append(tuple(rays.bundle(float(angle), float(wavelength)) for wavelength in wavelengths))
        if progress is not None:
            progress((k + 1) * wavelengths.size, total, "fields and wavelengths")
    lens = _lens(rays, angles, wavelengths, reference, bundles)
    drawn = angles[[0, angles.size // 2, -1]] if angles.size > 1 else angles
    return TracedLens(
        *(lens, angles, wavelengths, tuple(bundles), prescription, reference),
        rays.surfaces(),
        tuple(rays.paths(float(angle)) for angle in drawn),
    )


def _lens(rays: _Rays, angles: Array, wavelengths: Array, reference: int, bundles: list[tuple[RayBundle, ...]]) -> Lens:
    """Return the lens of traced rays; field points lie downwards in the frame."""
    real = np.array([math.hypot(*row[reference].chief) for row in bundles])
    solid = np.array([row[reference].projected_solid_angle for row in bundles])
    spacing_mm, samples = _sampling(wavelengths, bundles)
    psf = np.array(
        [[point_spread(b, w, spacing_mm, samples) for b, w in zip(row, wavelengths, strict=True)] for row in bundles]
    )
    blur = LensDesign(wavelengths, psf, spacing_mm * 1e3, real, np.zeros(real.size), unit="mm")
    base = DiffractionLimited(rays.f_number, rays.focal_length_mm, falloff="none")
    if angles.size == 1:
        return Lens(base, blur, name=rays.name)
    distortion = Distortion.from_real_heights(FieldPoints(angle_deg=angles), real, rays.focal_length_mm)
    color = None
    if wavelengths.size > 1:
        heights = np.array([[math.hypot(*b.chief) for b in row] for row in bundles])
        shift_um = (heights - real[:, None]).T * 1e3
        color = LateralColor(wavelengths, FieldPoints(height_mm=real), shift_um)
    illumination = IlluminationTable(FieldPoints(height_mm=real), solid / solid[0])
    return Lens(base, blur, illumination=illumination, distortion=distortion, lateral_color=color, name=rays.name)


def _sampling(wavelengths: Array, bundles: list[tuple[RayBundle, ...]]) -> tuple[float, int]:
    """Return the spacing of samples in mm, and their number on a side: the Airy disc and the rays fit."""
    aperture = max(float(np.abs(b.rim - b.rim.mean(axis=0)).max()) for row in bundles for b in row)
    spacing = float(wavelengths[0]) * 1e-6 / (4.0 * aperture)
    reach = max(float(np.abs(b.landing - b.chief).max()) for row in bundles for b in row)
    reach = 1.2 * reach + 5.0 * float(wavelengths[-1]) * 1e-6 / (2.0 * aperture)
    samples = 2 * math.ceil(reach / spacing) + 1
    if samples > _MOST_SAMPLES:
        return 2.0 * reach / (_MOST_SAMPLES - 1), _MOST_SAMPLES - 1
    return spacing, samples


def point_spread(bundle: RayBundle, wavelength_nm: float, spacing_mm: float, samples: int) -> Array:
    """Return the (samples, samples) PSF about the chief ray's point, outwards downwards; its sum is 1."""
    wave_mm = wavelength_nm * 1e-6
    center = bundle.rim.mean(axis=0)
    radius = float(np.abs(bundle.rim - center).max()) * 1.0001
    scaled = (bundle.direction - center) / radius
    path = _fit(scaled, bundle.path)
    pupil_x, pupil_y = (_fit(scaled, bundle.pupil[:, axis]) for axis in (0, 1))
    axis = (np.arange(_DIRECTIONS) + 0.5) * (2.0 / _DIRECTIONS) - 1.0
    u, v = np.meshgrid(axis, axis, indexing="ij")
    inside = _in_polygon(u, v, (bundle.rim - center) / radius)
    points = np.column_stack([u[inside], v[inside]])
    step = 2.0 / _DIRECTIONS
    density = np.zeros_like(u)
    px, py = (np.zeros_like(u) for _ in range(2))
    px[...], py[...] = (
        _evaluate(f, np.column_stack([u.ravel(), v.ravel()])).reshape(u.shape) for f in (pupil_x, pupil_y)
    )
    jacobian = np.gradient(px, step, axis=0) * np.gradient(py, step, axis=1)
    jacobian -= np.gradient(px, step, axis=1) * np.gradient(py, step, axis=0)
    density[inside] = np.sqrt(np.abs(jacobian[inside]))
    amplitude = np.zeros(u.shape, np.complex128)
    amplitude[inside] = density[inside] * np.exp(2j * np.pi / wave_mm * _evaluate(path, points))
    outward = -1.0 if bundle.chief[1] < 0 else 1.0
    place = (np.arange(samples) - samples // 2) * spacing_mm
    across = np.exp(2j * np.pi / wave_mm * radius * np.outer(place, axis))
    down = np.exp(2j * np.pi / wave_mm * radius * np.outer(outward * place, axis))
    field = down @ amplitude.T @ across.T
    intensity = np.abs(field) ** 2
    return np.asarray(intensity / intensity.sum())


def _powers(points: Array) -> Array:
    x, y = (np.polynomial.legendre.legvander(points[:, k], _DEGREE) for k in (0, 1))
    return np.stack([x[:, i] * y[:, j] for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)], axis=1)


def _fit(points: Array, values: Array) -> Array:
    return np.asarray(np.linalg.lstsq(_powers(points), values, rcond=1e-12)[0], np.float64)


def _evaluate(coefficients: Array, points: Array) -> Array:
    return np.asarray(_powers(points) @ coefficients)


def _in_polygon(u: Array, v: Array, rim: Array) -> NDArray[np.bool_]:
    from matplotlib.path import Path as Outline

    return np.asarray(Outline(rim).contains_points(np.column_stack([u.ravel(), v.ravel()]))).reshape(u.shape)


class _Rays:
    """Rays through a model of rayoptics."""

    def __init__(self, prescription: Prescription) -> None:
        self.path, model = prescription.path, prescription.model
        self.model = model
        for surface in model["seq_model"].ifcs:  # rayoptics gives a surface without a stated aperture one of 1 mm
            if not getattr(surface, "clear_apertures", None):
                surface.set_max_aperture(_NO_APERTURE_MM)
        spec = model["optical_spec"]
        data = model["analysis_results"]["parax_data"].fod
        self.focal_length_mm, self.f_number = float(data.efl), abs(float(data.fno))
        if not (math.isfinite(self.focal_length_mm) and self.focal_length_mm > 0):
            raise FileError(self.path, "focal length", value=self.focal_length_mm, expected="finite and above 0 mm")
        self._shift_mm = float(spec["focus"].focus_shift)
        self._reach = [0.0] * len(model["seq_model"].ifcs)
        self.wavelength_nm = [float(wavelength) for wavelength in spec["wvls"].wavelengths]
        self.reference_nm = float(spec["wvls"].central_wvl)
        self.name = str(model["system_spec"].title or self.path.stem)
        fov = spec["fov"]
        own = [
            math.hypot(field.xv, field.yv) if hasattr(field, "xv") else math.hypot(field.x, field.y)
            for field in fov.fields
        ]
        scale = float(fov.value) if fov.is_relative else 1.0
        kind = tuple(fov.key)
        values = [scale * value for value in own]
        if kind[-1] != "angle":
            values = [math.degrees(math.atan(value / self.focal_length_mm)) for value in values]
        self.largest_field_deg = max(values)
        order = np.argsort(values)
        self._known = np.array(values)[order]
        self._vignetting = {
            name: np.array([float(getattr(field, name)) for field in fov.fields])[order]
            for name in ("vux", "vlx", "vuy", "vly")
        }
        spec["fov"].set_from_list([0.0, self.largest_field_deg])
        fov.key, fov.value, fov.is_relative = ("object", "angle"), 1.0, False

    def bundle(self, angle_deg: float, wavelength_nm: float) -> RayBundle:
        """Trace the rays of a field angle."""
        field = self._field(angle_deg, wavelength_nm)
        chief = self._ray((0.0, 0.0), field, wavelength_nm)
        if chief is None:
            raise FileError(
                self.path, f"the chief ray at {angle_deg:g} degrees and {wavelength_nm:g} nm does not reach the sensor"
            )
        axis = np.linspace(-1.0, 1.0, _PUPIL_RAYS)
        rays: list[tuple[float, float, tuple[Array, Array, float]]] = []
        for x in axis[_PUPIL_RAYS // 2 :]:
            for y in axis:
                if x * x + y * y <= 1.0 and (ray := self._ray((x, y), field, wavelength_nm)) is not None:
                    rays.append((x, y, ray))
        rim_rays = [
            self._rim(turn, field, wavelength_nm) for turn in np.linspace(-0.5, 0.5, _RIM_RAYS // 2 + 1) * np.pi
        ]
        rays += rim_rays
        pupil = np.array([(x, y) for x, y, _ in rays])
        landing, direction, optical = (np.array([ray[k] for *_, ray in rays]) for k in range(3))
        start, _, length = chief
        path = optical - length + ((start - landing) * direction[:, :2]).sum(axis=1)
        rim = np.array([ray[1][:2] for *_, ray in rim_rays])
        # The lens and the field are symmetric about the plane x = 0.
        mirrored = np.array([-1.0, 1.0])
        off = pupil[:, 0] > 1e-9
        return RayBundle(
            np.concatenate([pupil, pupil[off] * mirrored]),
            np.concatenate([direction[:, :2], direction[off, :2] * mirrored]),
            np.concatenate([landing, landing[off] * mirrored]),
            np.concatenate([path, path[off]]),
            np.concatenate([rim, rim[-2:0:-1] * mirrored]),
            start,
            np.concatenate(
                [
                    np.arange(len(pupil)) < len(rays) - len(rim_rays),
                    (np.arange(len(pupil)) < len(rays) - len(rim_rays))[off],
                ]
            ),
        )

    def surfaces(self) -> tuple[Array, ...]:
        """Return the sections of the surfaces between the object and the image."""
        sequence, found, z = self.model["seq_model"], [], 0.0
        for k, surface in enumerate(sequence.ifcs[1:-1], start=1):
            semi = 1.05 * self._reach[k]  # of the traced rays
            y = np.linspace(-semi, semi, 61)
            sag = np.array([float(surface.profile.sag(0.0, value)) for value in y])
            found.append(np.column_stack([z + sag, y]))
            z += float(sequence.gaps[k].thi)
        found.append(np.column_stack([np.full(2, z + self._shift_mm), np.array([-1.0, 1.0]) * self._reach[-1]]))
        return tuple(found)

    def paths(self, angle_deg: float) -> tuple[Array, ...]:
        """Return rays through the pupil's edges and center from the first surface to the sensor."""
        field, found = self._field(angle_deg, self.reference_nm), []
        for y in (-1.0, 0.0, 1.0):
            if (ray := self._traced((0.0, y), field, self.reference_nm)) is not None:
                z = np.concatenate([[0.0], np.cumsum([gap.thi for gap in self.model["seq_model"].gaps[1:]])])
                points = np.array([[z[k] + segment[0][2], segment[0][1]] for k, segment in enumerate(ray[1:])])
                found.append(points)
        return tuple(found)

    def _field(self, angle_deg: float, wavelength_nm: float) -> Any:
        from rayoptics.raytr.opticalspec import Field
        from rayoptics.raytr.trace import aim_chief_ray

        field = Field(y=angle_deg, fov=self.model["optical_spec"]["fov"])
        for name, values in self._vignetting.items():
            setattr(field, name, float(np.interp(angle_deg, self._known, values)))
        field.aim_info = aim_chief_ray(self.model, field, wvl=self.reference_nm)
        return field

    def _rim(self, turn: float, field: Any, wavelength_nm: float) -> tuple[float, float, tuple[Array, Array, float]]:
        """Return the outermost ray of an azimuth that passes."""
        x, y = math.cos(turn), math.sin(turn)
        low, high, found = 0.0, 1.0, self._ray((x, y), field, wavelength_nm)
        if found is not None:
            return x, y, found
        best = self._ray((0.0, 0.0), field, wavelength_nm)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            ray = self._ray((middle * x, middle * y), field, wavelength_nm)
            low, high, best = (middle, high, ray) if ray is not None else (low, middle, best)
        assert best is not None
        return low * x, low * y, best

    def _ray(self, pupil: tuple[float, float], field: Any, wavelength_nm: float) -> tuple[Array, Array, float] | None:
        """Return point on the sensor, direction there, and optical path; None for a ray that is blocked or misses."""
        ray = self._traced(pupil, field, wavelength_nm)
        if ray is None:
            return None
        self._reach = [max(old, math.hypot(*segment[0][:2])) for old, segment in zip(self._reach, ray, strict=True)]
        first, start = np.asarray(ray[1][0]), np.asarray(ray[0][1])
        length = float(first @ start)  # from a plane wave through the vertex of the first surface
        gaps = self.model["seq_model"].gaps
        for segment, gap in zip(ray[1:-1], gaps[1:], strict=True):
            length += float(gap.medium.rindex(wavelength_nm)) * float(segment[2])
        direction = np.asarray(ray[-2][1])
        to_sensor = self._shift_mm / direction[2]
        length += float(gaps[-1].medium.rindex(wavelength_nm)) * to_sensor
        return np.asarray(ray[-1][0][:2]) + direction[:2] * to_sensor, direction, length

    def _traced(self, pupil: tuple[float, float], field: Any, wavelength_nm: float) -> Any:
        """Return rayoptics' segments of a ray, None if it is blocked or misses a surface."""
        from rayoptics.raytr.trace import trace_base
        from rayoptics.raytr.traceerror import TraceError

        try:
            return trace_base(self.model, list(pupil), field, wavelength_nm, check_apertures=True)[0]
        except TraceError:
            return None
