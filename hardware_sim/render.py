"""Ray-traced images of an object on a table under a near point light: the signal of the pixels, before the sensor.

Everything happens in the object's frame, where coordinates are small and single precision is good to a micrometre. The
camera's rays are traced once (`trace_view`): each pixel keeps n × n samples of the surface behind it, so that
silhouettes and shadow edges blend as they do on a sensor. A shot then shades these samples and traces their shadow
rays.

The surface's `Reflectance` is evaluated at each of these samples, so that a highlight narrower than a pixel is averaged
over the pixel's footprint. Subsurface scatter is not a function of one point: `scattered` averages the diffuse image
over the object's neighbouring pixels.

Light is relative to the calibration's reference: 1 is what a white Lambertian surface sends to the camera if it faces
the lamp on the lamp's axis at the reference distance.
"""

from dataclasses import dataclass, field

import cv2
import numba
import numpy as np
import numpy.typing as npt

from acquisition import geometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from hardware_sim.lamp_lobe import LampLobe
from hardware_sim.objects import LAMBERT, SceneObject
from hardware_sim.tracing import START_M, Tracer

TABLE_ALBEDO = 0.05
"""Albedo of the table, which is covered with black cloth, as is usual."""


@dataclass(frozen=True)
class Lens:
    """A camera: size in pixels, OpenCV matrix (3, 3) and distortion (5,), and its pose in the object's frame."""

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    object_from_camera: FloatArray

    def directions(self, columns: FloatArray, rows: FloatArray) -> Float32Array:
        """Directions (N, 3), object frame, unit OpenCV z, of the rays through image points in pixels (N,)."""
        flat = geometry.undistorted(np.stack([columns, rows], axis=-1), self.matrix, self.distortion)
        rays = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
        return geometry.rotate(self.object_from_camera, rays).astype(np.float32)

    @property
    def eye(self) -> FloatArray:
        """The camera's centre (3,), m."""
        return self.object_from_camera[:3, 3]


@dataclass(frozen=True)
class Lamp:
    """Near point light: position (3,) m, axis (3,), object frame; power 1 gives 1 at `reference_m` on the axis.

    Towards a unit direction d it sends ahead^`lobe_exponent` · profile(ahead) · (1 + tilt · d); ahead is the cosine to
    the axis. `profile` (K,) is sampled at cosines equally spaced from 0 to 1; `tilt` (3,) is normal to the axis.
    """

    position: FloatArray
    axis: FloatArray
    power: float
    reference_m: float
    lobe_exponent: float
    profile: Float32Array = field(default_factory=lambda: np.ones(2, np.float32))
    tilt: FloatArray = field(default_factory=lambda: np.zeros(3))

    @staticmethod
    def posed(object_from_lamp: FloatArray, power: float, reference_m: float, lobe: LampLobe) -> "Lamp":
        """A lamp at a pose (4, 4), with its lobe rotated into that pose."""
        turn = object_from_lamp[:3, :3]
        tilt = turn[:, :2] @ np.array(lobe.tilt)
        return Lamp(object_from_lamp[:3, 3], turn[:, 2], power, reference_m, lobe.exponent, lobe.profile, tilt)

    def emission(self, directions: FloatArray) -> FloatArray:
        """Intensity (N,) towards unit directions (N, 3), relative to the axis; 0 behind the lamp."""
        ahead = np.clip(directions @ self.axis, 0, 1)
        profile = np.interp(ahead, np.linspace(0, 1, len(self.profile)), self.profile)
        return np.where(ahead > 0, ahead**self.lobe_exponent * profile * (1 + directions @ self.tilt), 0.0)

    def irradiance(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Unshadowed irradiance (N,) of surface points (N, 3) with unit normals (N, 3)."""
        to_lamp = self.position - points
        distance = np.linalg.norm(to_lamp, axis=1)
        falling = np.clip(np.einsum("ni,ni->n", normals, to_lamp) / distance, 0, None)
        emission = self.emission(-to_lamp / distance[:, None])
        return self.power * falling * emission * (self.reference_m / distance) ** 2


@dataclass(frozen=True)
class Samples:
    """Hits of a set of camera rays: flat pixel numbers (N,), points and unit normals (N, 3), albedo (N,)."""

    pixels: npt.NDArray[np.int32]
    points: Float32Array
    normals: Float32Array
    albedo: Float32Array


@dataclass(frozen=True)
class View:
    """Samples of object and table behind a camera's pixels; each sample covers a fraction `share` of its pixel."""

    lens: Lens
    share: float
    surface: Samples
    table: Samples


def object_samples(scene: SceneObject, tracer: Tracer, eye: FloatArray, directions: Float32Array) -> Samples:
    """Where rays (N, 3) from `eye` (3,) first meet the object; `pixels` are the rays' numbers."""
    origins = np.broadcast_to(eye.astype(np.float32), directions.shape)
    hits = tracer.first_hits(origins, directions)
    rays = np.nonzero(hits.triangles >= 0)[0]
    triangles, weights = hits.triangles[rays], hits.weights[rays]
    points = np.einsum("nc,nci->ni", weights, scene.mesh.triangles.astype(np.float32)[triangles])
    normals = np.einsum("nc,nci->ni", weights, scene.mesh.corner_normals.astype(np.float32)[triangles])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Samples(rays.astype(np.int32), points, normals, scene.texture(points).astype(np.float32))


def trace_view(scene: SceneObject, tracer: Tracer, lens: Lens, subdivision: int) -> View:
    """Traces the camera's rays, subdivision × subdivision for each pixel."""
    count = lens.width * lens.height
    rows, columns = np.divmod(np.arange(count, dtype=np.float64), lens.width)
    offsets = (np.arange(subdivision) + 0.5) / subdivision - 0.5
    surfaces: list[Samples] = []
    tables: list[Samples] = []
    eye = lens.eye.astype(np.float32)
    for down in offsets:
        for right in offsets:
            directions = lens.directions(columns + right, rows + down)
            surface = object_samples(scene, tracer, lens.eye, directions)
            surfaces.append(surface)
            past = np.ones(count, dtype=bool)
            past[surface.pixels] = False
            past &= directions[:, 2] < 0
            pixels = np.nonzero(past)[0].astype(np.int32)
            points = eye + directions[past] * (-eye[2] / directions[past, 2])[:, None]
            points[:, 2] = 0.0
            tables.append(
                Samples(
                    pixels,
                    points,
                    np.tile(np.array([0.0, 0.0, 1.0], dtype=np.float32), (len(points), 1)),
                    np.full(len(points), TABLE_ALBEDO, dtype=np.float32),
                )
            )
    return View(lens, 1.0 / subdivision**2, joined(surfaces), joined(tables))


def joined(parts: list[Samples]) -> Samples:
    """Concatenates the samples of several views of the same pixels."""
    return Samples(
        np.concatenate([part.pixels for part in parts]),
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.albedo for part in parts]),
    )


def lit_mask(
    points: Float32Array, normals: Float32Array, position: FloatArray, tracer: Tracer, scene: SceneObject
) -> BoolArray:
    """Lit mask (N,): points (N, 3) that face the lamp at `position` (3,) and lie outside the object's cast shadow."""
    facing, needs_ray = _facing(
        points, normals, position.astype(np.float32), np.float32(scene.radius_m), np.float32(scene.height_m)
    )
    target = position.astype(np.float32)
    starts = (points[needs_ray] + START_M * normals[needs_ray]).astype(np.float32)
    facing[needs_ray] = ~tracer.occluded(starts, target - starts)
    return facing


def lit_samples(view: View, scene: SceneObject, tracer: Tracer, lamp: Lamp) -> tuple[BoolArray, BoolArray]:
    """Lit masks of the samples of the surface and of the table."""
    surface, table = (
        lit_mask(samples.points, samples.normals, lamp.position, tracer, scene)
        for samples in (view.surface, view.table)
    )
    return surface, table


def direct_image(
    view: View, scene: SceneObject, tracer: Tracer, lamp: Lamp, free: tuple[BoolArray, BoolArray] | None = None
) -> Float32Array:
    """Image (H, W) of the lamp's direct light, by the object's reflectance; the table is Lambertian.

    `free` are the masks of `lit_samples`, if they are known already.
    """
    image = np.zeros(view.lens.width * view.lens.height, dtype=np.float32)
    on_surface, on_table = lit_samples(view, scene, tracer, lamp) if free is None else free
    parts = [(view.surface, on_surface, scene.gloss), (view.table, on_table, 0.0)]
    if scene.reflectance != LAMBERT:
        image += reflected_image(view, scene, lamp, on_surface).ravel()
        parts = parts[1:]
    for samples, where, gloss in parts:
        _shade(
            samples.points,
            samples.normals,
            samples.albedo,
            samples.pixels,
            where,
            lamp.position.astype(np.float32),
            lamp.axis.astype(np.float32),
            np.float32(lamp.lobe_exponent),
            np.ascontiguousarray(lamp.profile, np.float32),
            lamp.tilt.astype(np.float32),
            np.float32(view.share * lamp.power * lamp.reference_m**2),
            view.lens.eye.astype(np.float32),
            np.float32(gloss),
            np.float32(scene.gloss_exponent),
            image,
        )
    return image.reshape(view.lens.height, view.lens.width)


def reflected_image(view: View, scene: SceneObject, lamp: Lamp, lit: BoolArray) -> Float32Array:
    """Image (H, W) of the object alone under a lamp's direct light, by its `reflectance`; `lit` are its lit samples."""
    size = view.lens.height * view.lens.width
    normals = view.surface.normals[lit].astype(float)
    points, albedo = view.surface.points[lit].astype(float), view.surface.albedo[lit].astype(float)
    to_lamp, to_eye = lamp.position - points, view.lens.eye - points
    distance = np.linalg.norm(to_lamp, axis=1)
    to_lamp /= distance[:, None]
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    arriving = view.share * lamp.power * lamp.emission(-to_lamp) * (lamp.reference_m / distance) ** 2
    diffuse, specular = (
        np.bincount(view.surface.pixels[lit], arriving * part(normals, to_lamp, to_eye, albedo), size).astype(float)
        for part in (scene.reflectance.diffuse, scene.reflectance.specular)
    )
    if scene.reflectance.scatter_m > 0:
        diffuse = scattered(view, diffuse.reshape(view.lens.height, view.lens.width), scene.reflectance.scatter_m)
    return (diffuse.ravel() + specular).astype(np.float32).reshape(view.lens.height, view.lens.width)


def scattered(view: View, image: FloatArray, scatter_m: float) -> FloatArray:
    """Diffuse image (H, W) after subsurface scatter with exponential path lengths along the surface, mean `scatter_m`.

    Light leaves at a distance r from where it entered with density exp(−r / ℓ) / (2 π ℓ r) per area. The image is
    averaged over the object's pixels, with lengths at the object's mean distance. Hence a slanted surface scatters too
    far by 1 / cosine, and light passes between surfaces that are neighbours only in the image.
    """
    if len(view.surface.pixels) == 0:
        return image
    away = float(np.linalg.norm(view.surface.points - view.lens.eye, axis=1).mean())
    kernel = _scatter_kernel(scatter_m * float(view.lens.matrix[0, 0]) / away)
    share = view.share * np.bincount(view.surface.pixels, minlength=image.size).reshape(image.shape)
    spread, weight = (cv2.filter2D(part, -1, kernel, borderType=cv2.BORDER_CONSTANT) for part in (image, share))
    return np.where(share > 0, share * spread / np.maximum(weight, 1e-12), 0.0)


def _scatter_kernel(mean_px: float) -> FloatArray:
    """Weights (K, K), sum 1, of exp(−r / ℓ) / (2 π ℓ r), ℓ in px, cut off at 5 ℓ, beyond which 0.7 % of it lies."""
    reach, fine = max(1, int(np.ceil(5 * mean_px))), 8
    across = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    radius = np.hypot(*np.meshgrid(across, across))
    density = np.exp(-radius / mean_px) / radius
    blocks = density.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum(axis=(1, 3))
    return blocks / blocks.sum()


@numba.njit(
    "Tuple((boolean[::1], boolean[::1]))(float32[:, ::1], float32[:, ::1], float32[::1], float32, float32)",
    cache=True,
    fastmath=True,
)
def _facing(
    points: Float32Array, normals: Float32Array, lamp: Float32Array, radius: np.float32, height: np.float32
) -> tuple[BoolArray, BoolArray]:
    """Which points face the lamp, and for which of these the object's bounding cylinder may be in the way."""
    count = len(points)
    facing = np.zeros(count, dtype=np.bool_)
    needs_ray = np.zeros(count, dtype=np.bool_)
    for i in range(count):
        dx, dy, dz = lamp[0] - points[i, 0], lamp[1] - points[i, 1], lamp[2] - points[i, 2]
        if normals[i, 0] * dx + normals[i, 1] * dy + normals[i, 2] * dz <= 0:
            continue
        facing[i] = True
        # Seen from above, the part of the ray below the object's top is tested against the object's circle.
        reach = np.float32(1.0)
        if dz > 0:
            reach = min(reach, (height - points[i, 2]) / dz)
        across = dx * dx + dy * dy
        nearest = np.float32(0.0)
        if across > 0:
            nearest = min(max(-(points[i, 0] * dx + points[i, 1] * dy) / across, np.float32(0.0)), reach)
        x, y = points[i, 0] + nearest * dx, points[i, 1] + nearest * dy
        needs_ray[i] = x * x + y * y <= radius * radius
    return facing, needs_ray


@numba.njit(
    "void(float32[:, ::1], float32[:, ::1], float32[::1], int32[::1], boolean[::1], float32[::1], float32[::1],"
    " float32, float32[::1], float32[::1], float32, float32[::1], float32, float32, float32[::1])",
    cache=True,
    fastmath=True,
)
def _shade(  # noqa: PLR0913 - a numba kernel
    points: Float32Array,
    normals: Float32Array,
    albedo: Float32Array,
    pixels: npt.NDArray[np.int32],
    free: BoolArray,
    lamp: Float32Array,
    axis: Float32Array,
    lobe: np.float32,
    profile: Float32Array,
    tilt: Float32Array,
    strength: np.float32,
    eye: Float32Array,
    gloss: np.float32,
    gloss_exponent: np.float32,
    image: Float32Array,
) -> None:
    """Adds each sample's diffuse and specular (Blinn–Phong) light to its pixel."""
    last = len(profile) - 1
    for i in range(len(points)):
        if not free[i]:
            continue
        lx, ly, lz = lamp[0] - points[i, 0], lamp[1] - points[i, 1], lamp[2] - points[i, 2]
        square = lx * lx + ly * ly + lz * lz
        inverse = np.float32(1.0) / np.sqrt(square)
        lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
        ahead = -(axis[0] * lx + axis[1] * ly + axis[2] * lz)
        if ahead <= 0:
            continue
        at = min(ahead, np.float32(1.0)) * np.float32(last)
        below = min(int(at), last - 1)
        above = at - np.float32(below)
        shape = profile[below] + above * (profile[below + 1] - profile[below])
        shape *= np.float32(1.0) - (tilt[0] * lx + tilt[1] * ly + tilt[2] * lz)
        arriving = strength * shape * ahead**lobe / square
        value = albedo[i] * max(np.float32(0.0), normals[i, 0] * lx + normals[i, 1] * ly + normals[i, 2] * lz)
        if gloss > 0:
            vx, vy, vz = eye[0] - points[i, 0], eye[1] - points[i, 1], eye[2] - points[i, 2]
            away = np.float32(1.0) / np.sqrt(vx * vx + vy * vy + vz * vz)
            hx, hy, hz = lx + vx * away, ly + vy * away, lz + vz * away
            half = (normals[i, 0] * hx + normals[i, 1] * hy + normals[i, 2] * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
            if half > 0:
                value += gloss * half**gloss_exponent
        image[pixels[i]] += arriving * value
