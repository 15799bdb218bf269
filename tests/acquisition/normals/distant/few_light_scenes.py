"""Scenes with a dozen to fifty distant lights: traced shapes, matt, rough and glossy, with or without interreflection.

Rendered independently of the solvers. A rabbit-like body of smoothly joined ellipsoids, a wrinkled ball and the
simulated cell's own figures are seen from above or the side by an orthographic camera, four rays a pixel. Shadows are
traced; indirect light is the radiosity of the triangles, gathered along random rays, with all bounces between diffuse
surfaces. Sensor noise is 0.5 %, and nominal directions are 0.3° off.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import sparse

from acquisition.normals.images.image_set import DistantLights, ImageSet
from hardware_sim import implicit, objects
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import Tracer
from tests.acquisition.normals.distant.gloss_scenes import Rows

FloatArray = np.ndarray
FULL = 65535
RAYS = 32
"""Random rays that gather the indirect light at each point."""

SHAPES = ("rabbit", "wrinkled", "figure", "part")
MATERIALS = ("matt", "rough", "glossy", "shiny")
"""Lambert; Oren–Nayar of 0.35 rad; Lambert and GGX of F0 0.04 with α = 0.35 and 0.2."""


def directions(count: int, seed: int = 0, steepest_deg: float = 60.0) -> FloatArray:
    """Unit directions (F, 3) on a sunflower's spiral up to an angle off the viewing axis, turned by the seed."""
    rng = np.random.default_rng([17, seed])
    turn = rng.uniform(0, 2 * np.pi)
    number = np.arange(count)
    slant = np.radians(steepest_deg) * np.sqrt((number + 0.7) / count)
    azimuth = turn + number * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.cos(slant)], axis=-1)


# --------------------------------------------------------------------------------------------------------------- shapes


def _ellipsoids(seed: int) -> list[tuple[FloatArray, FloatArray]]:
    """Centres and radii of a sitting rabbit's parts, in decimetres, varied by the seed."""
    rng = np.random.default_rng([18, seed])
    parts = [
        ((0, 0, 0.35), (0.42, 0.33, 0.34)), ((0.34, 0, 0.72), (0.2, 0.18, 0.19)), ((-0.4, 0, 0.22), (0.13, 0.13, 0.13)),
        ((0.26, 0.13, 1.02), (0.07, 0.09, 0.3)), ((0.26, -0.13, 1.02), (0.07, 0.09, 0.3)),
        ((0.28, 0.2, 0.12), (0.22, 0.1, 0.12)), ((0.28, -0.2, 0.12), (0.22, 0.1, 0.12)),
        ((-0.12, 0.26, 0.22), (0.25, 0.13, 0.2)), ((-0.12, -0.26, 0.22), (0.25, 0.13, 0.2)),
    ]  # fmt: skip
    return [
        (np.array(centre) + rng.normal(0, 0.015, 3), np.array(radii) * rng.uniform(0.92, 1.08))
        for centre, radii in parts
    ]


def _rabbit(seed: int) -> Mesh:
    parts = _ellipsoids(seed)
    waves = np.random.default_rng([19, seed]).normal(0, 9.0, (8, 3))

    def field(points: FloatArray) -> FloatArray:
        total = 0.0
        for centre, radii in parts:
            scaled = np.linalg.norm((points - centre) / radii, axis=-1)
            total = total + np.exp(-25 * (scaled - 1) * radii.min())
        ripple = 0.012 * np.mean(np.cos(points @ waves.T), axis=-1)
        return 0.6 * (-np.log(total + 1e-30) / 25 + ripple)

    return implicit.mesh(field, np.array([-0.8, -0.8, -0.3]), np.array([0.9, 0.8, 1.6]), 0.018)


def _wrinkled(seed: int) -> Mesh:
    rng = np.random.default_rng([20, seed])
    waves, phases = rng.normal(0, 5.0, (10, 3)), rng.uniform(0, 6.3, 10)

    def field(points: FloatArray) -> FloatArray:
        bump = 0.12 * np.sqrt(2 / 10) * np.sum(np.cos(points @ waves.T + phases), axis=-1)
        return 0.5 * (np.linalg.norm(points, axis=-1) - 0.8 + bump)

    return implicit.mesh(field, np.full(3, -1.4), np.full(3, 1.4), 0.03)


@lru_cache(maxsize=8)
def mesh(shape: str, seed: int) -> Mesh:
    """A mesh in the view frame (x right, y up, z to the camera), two units wide, centred."""
    side = shape in {"rabbit", "figure"}
    built = {"rabbit": _rabbit, "wrinkled": _wrinkled}.get(shape)
    one = built(seed) if built else objects.build(shape, seed).mesh
    corners, normals = np.asarray(one.triangles, float), np.asarray(one.corner_normals, float)
    if side:  # the object's z axis up in the image, the camera on the side of its −y
        corners, normals = (part[..., [0, 2, 1]] * np.array([1.0, 1.0, -1.0]) for part in (corners, normals))
    low, high = corners.reshape(-1, 3).min(0), corners.reshape(-1, 3).max(0)
    corners = (corners - (low + high) / 2) * (2 / (high - low)[:2].max())
    return replace(one, triangles=corners.astype(np.float32), corner_normals=normals.astype(np.float32))


# ---------------------------------------------------------------------------------------------------------- reflectance


def _texture(points: FloatArray, seed: int) -> FloatArray:
    rng = np.random.default_rng([21, seed])
    waves, phases = rng.normal(0, 4.0, (6, 3)), rng.uniform(0, 6.3, 6)
    return 0.5 + 0.2 * np.tanh(1.5 * np.cos(points @ waves.T + phases).sum(1) / np.sqrt(3))


def _shading(material: str, normals: FloatArray, light: FloatArray, albedo: FloatArray) -> FloatArray:
    """BRDF · π · cos of the incidence, (N,), seen along +z."""
    nl, nv = np.maximum(normals @ light, 0), np.maximum(normals[:, 2], 1e-3)
    if material == "rough":
        squared = 0.35**2
        a, b = 1 - 0.5 * squared / (squared + 0.33), 0.45 * squared / (squared + 0.09)
        across = light[2] - nl * nv
        sines = np.sqrt((1 - nl**2) * (1 - nv**2))
        cosine = across / np.maximum(sines, 1e-4)
        return albedo * nl * (a + b * np.maximum(cosine, 0) * sines / np.maximum(np.maximum(nl, nv), 1e-3))
    if material == "matt":
        return albedo * nl
    alpha2 = {"glossy": 0.35, "shiny": 0.2}[material] ** 4
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    nh, lh = np.clip(normals @ half, 0, 1), light @ half
    density = alpha2 / (np.pi * (nh**2 * (alpha2 - 1) + 1) ** 2)
    smith = [2 * cosine / (cosine + np.sqrt(alpha2 + (1 - alpha2) * cosine**2) + 1e-9) for cosine in (nl, nv)]
    fresnel = 0.04 + 0.96 * (1 - lh) ** 5
    return albedo * nl + np.pi * density * smith[0] * smith[1] * fresnel / (4 * nv) * (nl > 0)


# ---------------------------------------------------------------------------------------------------------------- scene


@dataclass(frozen=True)
class Scene:
    """Images (F, H, W) in units of a white surface that faces its light, and the truth of each pixel."""

    images: FloatArray
    directions: FloatArray
    mask: FloatArray
    normals: FloatArray
    intensities: FloatArray
    """(F,) true relative intensities; the image set says 1."""

    def errors_deg(self, normals: FloatArray) -> FloatArray:
        """Angle to the true normals over the mask; 90° where there is none."""
        return np.degrees(np.arccos(np.clip(np.sum(normals * self.normals, axis=-1)[self.mask], -1, 1)))

    def image_set(self, *, masked: bool = True) -> ImageSet:
        """Stored images of sixteen bits under lights said to be equal."""
        level = 0.9 / np.quantile(self.images[:, self.mask], 0.999)
        stored = np.clip(np.round(self.images * level * FULL), 0, FULL).astype(np.uint16)
        count, height, width = stored.shape
        return ImageSet(
            names=tuple(f"{n:03d}.png" for n in range(1, count + 1)), height=height, width=width, channels=1,
            rows=Rows(stored), full_scale=FULL, saturated_from=0.999,
            lights=DistantLights(self.directions, np.ones((count, 1))),
            mask=self.mask if masked else np.ones_like(self.mask),
        )  # fmt: skip


def _gathered(tracer: Tracer, points: FloatArray, normals: FloatArray, rng: np.random.Generator) -> sparse.csr_matrix:
    """Share (N, T) of the cosine-weighted hemisphere at points that each triangle fills, by random rays."""
    total = sparse.csr_matrix((len(points), len(tracer.mesh.triangles)))
    for _ in range(RAYS):
        ball = rng.normal(size=points.shape)
        out = normals + 0.999 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
        hit = tracer.first_hits(points + 2e-3 * normals, out).triangles
        rows = np.flatnonzero(hit >= 0)
        total = total + sparse.csr_matrix((np.full(len(rows), 1 / RAYS), (rows, hit[rows])), shape=total.shape)
    return total


def scene(
    shape: str, material: str, count: int, seed: int = 0, *, size: int = 96, indirect: bool = True,
    intensity_sigma: float = 0.0, noise: float = 0.005, direction_sigma_deg: float = 0.3,
) -> Scene:  # fmt: skip
    """Renders one scene under `count` lights whose log intensities scatter by `intensity_sigma`, unknown to solvers."""
    rng = np.random.default_rng([22, seed])
    body, light = mesh(shape, seed), directions(count, seed)
    tracer = Tracer(body)
    step = 2.1 / size
    v, u = np.mgrid[:size, :size]
    samples = []
    for i, j in ((-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)):
        start = np.stack([(u + j - size / 2 + 0.5) * step, -(v + i - size / 2 + 0.5) * step, np.full(u.shape, 5.0)], -1)
        start = start.reshape(-1, 3)
        hits = tracer.first_hits(start, np.tile([0.0, 0.0, -1.0], (size * size, 1)))
        normal = np.einsum("nk,nkc->nc", hits.weights, body.corner_normals[np.maximum(hits.triangles, 0)])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        point = start - hits.distances[:, None] * np.array([0.0, 0.0, 1.0])
        samples.append((hits.triangles >= 0, point, normal))
    mask = np.all([one[0] & (one[2][:, 2] > 0.02) for one in samples], axis=0)
    radiosity = _radiosity(tracer, light, seed, rng) if indirect else None
    signal, normals = np.zeros((count, int(mask.sum()))), np.zeros((int(mask.sum()), 3))
    for _, points, every in samples:
        point, normal = points[mask], every[mask]
        albedo = _texture(point, seed)
        if radiosity is not None:
            signal += (_gathered(tracer, point, normal, rng) @ radiosity * albedo[:, None]).T / 4
        for f, one in enumerate(light):
            free = ~tracer.occluded(point + 2e-3 * normal, np.tile(one, (len(point), 1)))
            signal[f] += free * _shading(material, normal, one, albedo) / 4
        normals += normal / 4
    intensities = np.exp(intensity_sigma * rng.normal(size=count))
    signal *= intensities[:, None]
    images = np.zeros((count, size * size))
    images[:, mask] = signal
    images += noise * np.mean(signal) * rng.normal(size=images.shape)
    truth = np.zeros((size * size, 3))
    truth[mask] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    nominal = light + rng.normal(0, np.radians(direction_sigma_deg), light.shape)
    return Scene(
        np.maximum(images, 0).reshape(count, size, size), nominal / np.linalg.norm(nominal, axis=1, keepdims=True),
        mask.reshape(size, size), truth.reshape(size, size, 3), intensities,
    )  # fmt: skip


def _radiosity(tracer: Tracer, light: FloatArray, seed: int, rng: np.random.Generator) -> FloatArray:
    """Radiosity (T, F) of the triangles under each light, three bounces."""
    body = tracer.mesh
    middle, normal = body.triangles.mean(axis=1).astype(float), body.corner_normals.mean(axis=1).astype(float)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    direct = np.zeros((len(middle), len(light)))
    for f, one in enumerate(light):
        free = ~tracer.occluded(middle + 2e-3 * normal, np.tile(one, (len(middle), 1)))
        direct[:, f] = free * np.maximum(normal @ one, 0)
    albedo = _texture(middle, seed)[:, None]
    transport = _gathered(tracer, middle, normal, rng)
    total = albedo * direct
    for _ in range(2):
        total = albedo * (direct + transport @ total)
    return total
