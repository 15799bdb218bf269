"""Images by an independent path tracer (Mitsuba 3) of objects whose normals are known, and grades against these.

Nothing here comes from our own renderer but the triangle meshes and the ray tracer that asks where a pixel's ray ends:
light transport is Mitsuba's, and gloss, which it is not asked for, is added with the true geometry, averaged over the
pixel. The light is a point, the camera a pinhole at the origin, the object's middle 0.9 m in front of it: frame `view`.

Values y are those of `acquisition.photometry`: what a white matt surface that faces the lamp at REFERENCE_M would give
is 1. Renders are kept under build/path-traced by the hash of all that they depend on.
"""

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import mitsuba
import numpy as np

from acquisition.models.result import NormalMap
from acquisition.plan import baselines
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import START_M, Tracer
from tests.path_traced import objects

CACHE = Path(__file__).parents[2] / "build" / "path-traced"
VERSION = 2
"""To be raised when anything in this file changes what is rendered."""

TABLE_DEPTH_M = 0.93
CENTER = np.array([0.0, 0.0, -0.90])
REFERENCE_M = 0.45
FIELD_M = 0.14
"""What the image's side sees at the depth of CENTER."""

BOUNCES_DEPTH = 8
GRADED_DEG, CREASE_DEG = 78.0, 20.0
TENTH = 0.1
Gloss = Literal["blinn", "ggx"]
TEXTURE = "texture"


@dataclass(frozen=True)
class Truth:
    """Ground truth of each pixel of an (H, W) image: normals (H, W, 3), view frame; depth (H, W) along OpenCV's z."""

    name: str
    normals: np.ndarray
    depth_m: np.ndarray
    mask: np.ndarray  # the whole silhouette
    graded: np.ndarray  # those that have one normal, within 78° of the ray

    def error_deg(self, normals: np.ndarray) -> np.ndarray:
        """Angle (H, W) to the true normal."""
        return np.degrees(np.arccos(np.clip(np.sum(normals * self.normals, axis=-1), -1, 1)))


def focal_px(pixels: int) -> float:
    return pixels * -float(CENTER[2]) / FIELD_M


def rays(pixels: int, samples: int = 1) -> np.ndarray:
    """Directions (samples², H, W, 3) with z = −1 through an even grid of points in each pixel."""
    offset = (np.arange(samples) + 0.5) / samples - 0.5
    place = np.arange(pixels) - (pixels / 2 - 0.5)
    out = [
        np.stack(np.broadcast_arrays((place + dx)[None, :], -(place + dy)[:, None], -focal_px(pixels)), axis=-1)
        for dy in offset
        for dx in offset
    ]
    return np.array(out) / focal_px(pixels)


@functools.cache
def placed(name: str) -> Mesh:
    """The object's mesh in the view frame."""
    return objects.make(name).transformed(np.eye(3), np.array([0.0, 0.0, -TABLE_DEPTH_M]))


@functools.cache
def _tracer(name: str) -> Tracer:
    return Tracer(placed(name))


def _view_hits(name: str, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intersections of camera rays (N, 3) with the object: hit mask, points, normals."""
    mesh = placed(name)
    hits = _tracer(name).first_hits(np.zeros_like(direction), direction)
    hit = hits.triangles >= 0
    triangle = np.where(hit, hits.triangles, 0)
    normal = np.einsum("nc,nci->ni", hits.weights.astype(float), mesh.corner_normals[triangle])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return hit, np.where(hit[:, None], direction * hits.distances[:, None], 0.0), normal


@functools.lru_cache(maxsize=32)
def truth(name: str, pixels: int) -> Truth:
    """Ground truth at the pixels' centres."""
    direction = rays(pixels)[0]
    hits = _view_hits(name, direction.reshape(-1, 3))
    hit, point, normal = (part.reshape(pixels, pixels, *part.shape[1:]) for part in hits)
    return Truth(
        name,
        np.where(hit[..., None], normal, 0.0),
        np.where(hit, -point[..., 2], TABLE_DEPTH_M),
        hit,
        _graded(name, pixels),
    )


def _graded(name: str, pixels: int) -> np.ndarray:
    """Pixels (H, W) that have one normal: none of them within a pixel of what is seen at more than 78°, or is not the
    object; and no pixel that straddles a crease of more than 20°."""
    direction = rays(pixels, 4)
    hits = _view_hits(name, direction.reshape(-1, 3))
    hit, _, normal = (part.reshape(16, pixels, pixels, *part.shape[1:]) for part in hits)
    cosine = -np.sum(normal * direction, axis=-1) / np.linalg.norm(direction, axis=-1)
    steep = np.mean(~hit | (cosine < np.cos(np.radians(GRADED_DEG))), axis=0) >= TENTH
    core = cv2.erode((~steep).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    other = np.sum(normal * normal[:1], axis=-1) < np.cos(np.radians(CREASE_DEG))
    creased = np.minimum(np.mean(other, axis=0), 1 - np.mean(other, axis=0)) >= TENTH
    return core & ~creased


def two_rings(count: int, turn: float = 0.2) -> np.ndarray:
    """Positions (count, 3) of the best fixed pattern on the dome of 0.45 m."""
    return CENTER + REFERENCE_M * baselines.two_rings(count, turn)


def render(
    name: str, light_positions: np.ndarray, *, pixels: int = 128, bounces: bool, albedo: float | str = 0.7,
    samples: int | None = None, table: bool = False,
) -> np.ndarray:  # fmt: skip
    """Noise-free y (F, H, W) float32 of a matt object lit from each position (F, 3), m, view frame.

    `albedo` is a number or "texture" (0.3–0.8, patterned); `samples` per pixel, else 36 without and 100 with bounces;
    `table` puts a dark plane under the object.
    """
    samples = samples or (100 if bounces else 36)
    out = [
        _image(name, tuple(np.asarray(position, float).tolist()), number, pixels, bounces, albedo, samples, table)
        for number, position in enumerate(light_positions)
    ]
    return np.stack(out)


def _image(
    name: str, position: tuple[float, ...], number: int, pixels: int, bounces: bool, albedo: float | str, samples: int,
    table: bool,
) -> np.ndarray:  # fmt: skip
    key = hashlib.sha256(placed(name).triangles.tobytes())
    key.update(repr((VERSION, position, number, pixels, bounces, albedo, samples, table)).encode())
    path = CACHE / f"{key.hexdigest()[:32]}.npy"
    if path.exists():
        return np.load(path)
    scene, parameters = _scene(name, pixels, bounces, albedo, table)
    parameters["lamp.position"] = list(position)
    parameters.update()
    image = np.array(mitsuba.render(scene, spp=samples, seed=number), dtype=np.float32)[..., 0]
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, image)
    return image


@functools.lru_cache(maxsize=2)
def _scene(name: str, pixels: int, bounces: bool, albedo: float | str, table: bool) -> tuple[object, object]:
    """A Mitsuba scene and its parameters, of which only the lamp's position is changed."""
    if mitsuba.variant() is None:
        mitsuba.set_variant("scalar_rgb")
    matt: dict[str, object] = {"type": "rgb", "value": albedo} if isinstance(albedo, float) else {
        "type": "mesh_attribute", "name": "vertex_color"
    }  # fmt: skip
    scene: dict[str, object] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": BOUNCES_DEPTH if bounces else 2, "rr_depth": 100},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(FIELD_M / 2 / -CENTER[2]))),
            "to_world": mitsuba.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": pixels, "height": pixels, "rfilter": {"type": "box"},
                "pixel_format": "rgb", "component_format": "float32",
            },
            "sampler": {"type": "multijitter"},
        },
        "lamp": {"type": "point", "position": [0, 0, 0], "intensity": {"type": "rgb", "value": np.pi * REFERENCE_M**2}},
        "object": _mitsuba_mesh(name, {"type": "diffuse", "reflectance": matt}),
    }  # fmt: skip
    if table:
        scene["table"] = {
            "type": "rectangle",
            "to_world": mitsuba.ScalarTransform4f().translate([0, 0, -TABLE_DEPTH_M]).scale([1.0, 1.0, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.05}},
        }
    loaded = mitsuba.load_dict(scene)
    return loaded, mitsuba.traverse(loaded)


def _mitsuba_mesh(name: str, bsdf: dict[str, object]) -> object:
    mesh = placed(name)
    count = len(mesh.triangles)
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(bsdf)
    made = mitsuba.Mesh(name, vertex_count=3 * count, face_count=count, has_vertex_normals=True, props=properties)
    made.add_attribute("vertex_color", 3, np.repeat(texture(mesh.triangles.reshape(-1, 3)), 3).astype(np.float32))
    parameters = mitsuba.traverse(made)
    parameters["vertex_positions"] = mesh.triangles.astype(np.float32).ravel()
    parameters["vertex_normals"] = mesh.corner_normals.astype(np.float32).ravel()
    parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
    parameters.update()
    return made


def texture(points: np.ndarray) -> np.ndarray:
    """Albedo (N,) of the textured version at points (N, 3)."""
    x, y, z = points.T / 0.004
    return 0.55 + 0.25 * np.tanh(2 * np.sin(x + 0.4 * np.sin(y)) * np.sin(y + 0.5 * z))


def gloss(
    name: str, light_positions: np.ndarray, *, pixels: int = 128, kind: Gloss = "blinn", strength: float = 0.2,
    samples: int = 4,
) -> np.ndarray:  # fmt: skip
    """What gloss adds to y (F, H, W), averaged over samples² points of each pixel, shadows cast.

    "blinn": strength · |s| (n·h)³⁰. "ggx": π |s| (n·l) times the microfacet reflectance of roughness 0.25 and normal
    reflectance 0.04 (Walter 2007, Smith's shadowing).
    """
    direction = rays(pixels, samples).reshape(-1, 3)
    hit, point, normal = _view_hits(name, direction)
    to_camera = -direction / np.linalg.norm(direction, axis=1, keepdims=True)
    out = []
    for position in light_positions:
        d = position - point
        r = np.linalg.norm(d, axis=1, keepdims=True)
        to_lamp = d / r
        cosine = np.sum(normal * to_lamp, axis=1)
        half = to_lamp + to_camera
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        n_h = np.clip(np.sum(normal * half, axis=1), 0, 1)
        irradiance = (REFERENCE_M / r[:, 0]) ** 2
        if kind == "blinn":
            value = strength * irradiance * n_h**30
        else:
            value = irradiance * _ggx(n_h, cosine, np.sum(normal * to_camera, 1), np.sum(half * to_camera, 1))
        visible = hit & (cosine > 0)
        visible[visible] = ~_tracer(name).occluded(point[visible] + START_M * normal[visible], d[visible])
        out.append(np.where(visible, value, 0).reshape(-1, pixels, pixels).mean(axis=0))
    return np.array(out, dtype=np.float32)


def _ggx(n_h: np.ndarray, n_l: np.ndarray, n_v: np.ndarray, h_v: np.ndarray, roughness: float = 0.25) -> np.ndarray:
    a2 = roughness**2
    distribution = a2 / (np.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
    fresnel = 0.04 + 0.96 * (1 - np.clip(h_v, 0, 1)) ** 5
    n_l, n_v = np.clip(n_l, 1e-3, 1), np.clip(n_v, 1e-3, 1)
    smith = [2 * c / (c + np.sqrt(a2 + (1 - a2) * c**2)) for c in (n_l, n_v)]
    return np.pi * distribution * fresnel * smith[0] * smith[1] / (4 * n_v)


@dataclass(frozen=True)
class Grade:
    """How a normal map compares with the truth, over the graded pixels; σ's figures over those that are not flagged."""

    mean_deg: float
    median_deg: float
    p95_deg: float
    solved: float  # share of the graded pixels
    within: float  # P(e < σ)
    within_two: float  # P(e < 2σ)
    ratio: float  # rms of e/σ
    sure_half_deg: float  # mean error of the half with the smaller σ
    flagged: float
    intensity_error: float  # std of what is left of the log intensity errors


def grade(normal_map: NormalMap, true: Truth, log_intensity: Sequence[float] | np.ndarray) -> Grade:
    """Grades a normal map; pixels without a normal count with 90°."""
    where = true.graded
    error = np.where(normal_map.mask, true.error_deg(normal_map.normals), 90.0)
    sigma = normal_map.sigma_deg
    known = where & normal_map.mask & np.isfinite(sigma)
    valid = known & ~normal_map.doubtful
    e, s = error[valid], sigma[valid]
    half = sigma[known] <= np.median(sigma[known])
    left = np.log(normal_map.intensity_factors) - np.asarray(log_intensity)
    return Grade(
        mean_deg=float(np.mean(error[where])),
        median_deg=float(np.median(error[where])),
        p95_deg=float(np.percentile(error[where], 95)),
        solved=float(np.mean(normal_map.mask[where])),
        within=float(np.mean(e < s)),
        within_two=float(np.mean(e < 2 * s)),
        ratio=float(np.sqrt(np.mean((e / s) ** 2))),
        sure_half_deg=float(np.mean(error[known][half])),
        flagged=float(np.mean(normal_map.doubtful[where])),
        intensity_error=float(np.std(left)),
    )
