"""Hard scenes for distant light: many lights, measured kinds of gloss, cast shadows and interreflection.

Rendered independently of the solvers: meshes by ray casting, reflectances that no solver's basis contains (Ward,
Beckmann–Cook–Torrance, GGX mixtures, Lafortune, Ashikhmin's coupled diffuse, Oren–Nayar), with different gloss in
different places, interreflection by Monte Carlo over diffuse reflection, errors in light directions and intensities,
and a sensor with shot and read noise.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from acquisition.normals.images.image_set import DistantLights, ImageSet
from hardware_sim import objects

FloatArray = np.ndarray
Reflectance = Callable[[dict[str, FloatArray], FloatArray], FloatArray]
"""(cosines, albedo) → BRDF × cos θ_l."""


def lights(columns: int = 12, rows: int = 8) -> FloatArray:
    """Directions (F, 3) on a slightly irregular grid over about ±45° × ±32°."""
    rng = np.random.default_rng(96)
    x, y = np.meshgrid(np.linspace(-0.98, 0.98, columns), np.linspace(-0.6, 0.62, rows))
    grid = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) + rng.normal(0, 0.01, (columns * rows, 3))
    return grid / np.linalg.norm(grid, axis=1, keepdims=True)


# --------------------------------------------------------------------------------------------------------- reflectances


def _fresnel(cosine: FloatArray, f0: float) -> FloatArray:
    return f0 + (1 - f0) * (1 - cosine) ** 5


def _ggx(c: dict[str, FloatArray], alpha: float, f0: float) -> FloatArray:
    a2 = alpha**2
    d = a2 / (np.pi * (c["nh"] ** 2 * (a2 - 1) + 1) ** 2)

    def smith(cosine: FloatArray) -> FloatArray:
        return 2 * cosine / (cosine + np.sqrt(a2 + (1 - a2) * cosine**2) + 1e-9)

    return d * smith(c["nl"]) * smith(c["nv"]) * _fresnel(c["lh"], f0) / (4 * c["nv"] + 1e-3)


def _beckmann(c: dict[str, FloatArray], m: float, f0: float) -> FloatArray:
    nh2 = np.maximum(c["nh"] ** 2, 1e-4)
    d = np.exp(-(1 - nh2) / (nh2 * m**2)) / (np.pi * m**2 * nh2**2)
    g = np.minimum(1, np.minimum(2 * c["nh"] * c["nv"] / c["lh"], 2 * c["nh"] * c["nl"] / c["lh"]))
    return d * g * _fresnel(c["lh"], f0) / (4 * c["nv"] + 1e-3)


def _ward(c: dict[str, FloatArray], alpha: float, k: float) -> FloatArray:
    nh2 = np.maximum(c["nh"] ** 2, 1e-4)
    return (
        k * np.exp(-(1 - nh2) / nh2 / alpha**2) / (4 * np.pi * alpha**2) * np.sqrt(c["nl"] / np.maximum(c["nv"], 0.05))
    )


def _coupled(c: dict[str, FloatArray], albedo: FloatArray, f0: float) -> FloatArray:
    fall = (1 - (1 - c["nl"] / 2) ** 5) * (1 - (1 - c["nv"] / 2) ** 5)
    return 28 / 23 * albedo / np.pi * (1 - f0) * fall * c["nl"]


def _oren_nayar(c: dict[str, FloatArray], albedo: FloatArray, sigma: float) -> FloatArray:
    s2 = sigma**2
    a, b = 1 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)
    sl, sv = np.sqrt(1 - c["nl"] ** 2), np.sqrt(1 - c["nv"] ** 2)
    across = (c["lv"] - c["nl"] * c["nv"]) / np.maximum(sl * sv, 1e-4)
    sine_tangent = sl * sv / np.maximum(np.maximum(c["nl"], c["nv"]), 1e-3)
    return albedo / np.pi * c["nl"] * (a + b * np.maximum(across, 0) * sine_tangent)


def _lafortune(c: dict[str, FloatArray], albedo: FloatArray) -> FloatArray:
    """Diffuse, a forward lobe off the mirror direction and a faint one back to the light."""
    across = c["lv"] - c["nl"] * c["nv"]  # tangential parts of l and v
    forward = np.maximum(0.95 * c["nl"] * c["nv"] - 1.02 * across, 0)
    back = np.maximum(0.7 * across + 0.7 * c["nl"] * c["nv"], 0)
    return (albedo / np.pi + 0.22 * forward**14 + 0.05 * back**5) * c["nl"]


REFLECTANCES: dict[str, Reflectance] = {
    "plastic": lambda c, a: a / np.pi * c["nl"] + _ward(c, 0.13, 0.09),
    "lacquer": lambda c, a: _coupled(c, a, 0.05) + _beckmann(c, 0.28, 0.06) + _beckmann(c, 0.1, 0.02),
    "glaze": lambda c, a: _coupled(c, a, 0.05) + _ggx(c, 0.09, 0.05) + 0.6 * _ggx(c, 0.4, 0.04),
    "satin": lambda c, a: 0.6 * a / np.pi * c["nl"] + _lafortune(c, 0.4 * a),
    "bronze": lambda c, a: 0.25 * a / np.pi * c["nl"] + _ggx(c, 0.4, 0.25) + 0.15 * _beckmann(c, 0.18, 0.6),
    "plaster": lambda c, a: _oren_nayar(c, a, 0.45) + _ggx(c, 0.5, 0.03),
}


# --------------------------------------------------------------------------------------------------------------- shapes


def _turned(triangles: FloatArray) -> FloatArray:
    """Triangles in a side view: the object's z axis up in the image, the camera along its −y."""
    return triangles[..., [0, 2, 1]] * np.array([1.0, 1.0, -1.0])


def mesh(shape: str) -> trimesh.Trimesh:
    """A mesh in the view frame, about 2 units wide, seen along −z."""
    if shape == "ball":
        return trimesh.creation.icosphere(6, 1.0)
    name, _, side = shape.partition("-")
    triangles = objects.build(name, 3).mesh.triangles.astype(float)
    corners = _turned(triangles) if side == "side" else triangles
    low, high = corners.reshape(-1, 3).min(0), corners.reshape(-1, 3).max(0)
    corners = (corners - (low + high) / 2) * (2 / (high - low)[:2].max())
    if side == "side":
        corners = corners[..., ::-1, :]  # the exchange of two axes and the change of one sign keep the sense twice
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)


# ---------------------------------------------------------------------------------------------------------------- scene


@dataclass(frozen=True)
class Scene:
    """Images (F, H, W, 3) as fractions of full scale, and the ground truth of each pixel."""

    name: str
    images: FloatArray
    directions: FloatArray
    intensities: FloatArray
    mask: FloatArray
    normals: FloatArray
    lit: FloatArray  # (F, H, W) neither attached nor cast shadow

    def errors_deg(self, normals: FloatArray) -> FloatArray:
        """Angle to the true normals, all pixels of the mask."""
        cosine = np.sum(normals[self.mask] * self.normals[self.mask], axis=-1)
        return np.degrees(np.arccos(np.clip(cosine, -1, 1)))

    def image_set(self, bits: int = 16) -> ImageSet:
        """The images as quantised integers with the nominal lights, as a folder reader returns them."""
        full = 2**bits - 1
        stored = np.clip(np.round(self.images * full), 0, full).astype(np.uint16)
        count, height, width, channels = stored.shape
        return ImageSet(
            names=tuple(f"{n:03d}.png" for n in range(1, count + 1)),
            height=height,
            width=width,
            channels=channels,
            rows=Rows(stored),
            full_scale=full,
            saturated_from=0.999,
            lights=DistantLights(self.directions, self.intensities),
            mask=self.mask,
            truth=self.normals.astype(np.float32),
        )


@dataclass(frozen=True)
class Rows:
    """Rows of a stack in memory."""

    stored: FloatArray

    def __call__(self, image: int, start: int, stop: int) -> FloatArray:
        return np.ascontiguousarray(self.stored[image, start:stop])


def scene(shape: str, material: str, size: int = 128, seed: int = 0, bounces: int = 48) -> Scene:
    """Renders one scene."""
    rng = np.random.default_rng(seed + 1000)
    body = mesh(shape)
    caster = RayMeshIntersector(body)
    step = 2.1 / size
    v, u = np.mgrid[:size, :size]
    # Four rays a pixel: normals and light are means over the pixel, as a camera's are.
    inside = np.zeros((4, size, size), bool)
    hits = []
    for number, (i, j) in enumerate(((-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25))):
        x, y = (u + j - size / 2 + 0.5) * step, -(v + i - size / 2 + 0.5) * step
        origin = np.stack([x, y, np.full_like(x, 5.0)], axis=-1).reshape(-1, 3)
        down = np.tile([0.0, 0.0, -1.0], (size * size, 1))
        triangle, ray, place = caster.intersects_id(origin, down, multiple_hits=False, return_locations=True)
        inside[number].reshape(-1)[ray] = True
        hits.append((ray, place, _smooth_normals(body, triangle, place, shape)))
    mask = inside.all(axis=0)
    shading = [
        _sample(caster, body, shape, mask, ray, place, normal, material, seed, rng, bounces // 4, step)
        for ray, place, normal in hits
    ]
    signal = np.mean([one for one, _, _ in shading], axis=0)  # (F, N, 3)
    normal = np.sum([one for _, one, _ in shading], axis=0)
    lit = np.mean([one for _, _, one in shading], axis=0) > 0.99
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    directions = lights()
    intensities = np.array([1.0, 0.9, 0.7]) * rng.uniform(0.7, 1.3, (len(directions), 1))
    signal *= intensities[:, None, :] * rng.normal(1, 0.01, (len(directions), 1, 1))
    level = 0.85 / np.quantile(signal, 0.998)
    electrons = np.minimum(signal * level * 30_000 * 4, 30_000 * 4)  # four frames averaged
    electrons = rng.poisson(electrons) + rng.normal(0, 20, electrons.shape)
    images = np.zeros((len(directions), size, size, 3))
    images[:, mask] = np.clip(electrons / (30_000 * 4), 0, 1)
    normals = np.zeros((size, size, 3))
    normals[mask] = normal
    lit_map = np.zeros((len(directions), size, size), bool)
    lit_map[:, mask] = lit
    nominal = directions + rng.normal(0, np.radians(0.4), directions.shape)
    nominal /= np.linalg.norm(nominal, axis=1, keepdims=True)
    return Scene(f"{shape}/{material}", images, nominal, intensities * level, mask, normals, lit_map)


def _smooth_normals(body: trimesh.Trimesh, triangle: FloatArray, place: FloatArray, shape: str) -> FloatArray:
    if shape == "ball":
        return place / np.linalg.norm(place, axis=1, keepdims=True)
    normal = body.face_normals[triangle]
    return normal * np.where(normal[:, 2:] < 0, -1, 1)


def _sample(caster, body, shape, mask, ray, place, normal, material, seed, rng, bounces, step):
    """Radiance (F, N, 3), normals (N, 3) and lit mask (F, N) at one sample of each pixel of the mask."""
    size = mask.shape[0]
    row = np.full(size * size, -1)
    row[ray] = np.arange(len(ray))
    chosen = row[np.flatnonzero(mask)]
    point, normal = place[chosen], normal[chosen]
    directions = lights()
    texture = np.random.default_rng(seed)
    waves, phases = texture.normal(0, 4.0, (6, 3)), texture.uniform(0, 6.3, 6)
    pattern = np.tanh(1.5 * np.cos(point @ waves.T + phases).sum(1) / np.sqrt(3))
    tint = np.array([0.55, 0.45, 0.35])
    albedo = tint * (1 + 0.35 * pattern[:, None])
    view = np.array([0.0, 0.0, 1.0])
    lit = np.zeros((len(directions), len(point)), bool)
    direct = np.zeros((len(directions), len(point), 3))
    irradiance = np.zeros((len(directions), len(point)))
    # Gloss differs from place to place by up to a third.
    gloss_pattern = 1 + 0.3 * np.tanh(np.cos(point @ waves[:, ::-1].T + phases[::-1]).sum(1))
    for f, direction in enumerate(directions):
        nl = normal @ direction
        half = (direction + view) / np.linalg.norm(direction + view)
        visible = ~caster.intersects_any(point + normal * 2e-3, np.tile(direction, (len(point), 1)))
        lit[f] = visible & (nl > 0)
        cosines = {
            "nl": np.maximum(nl, 1e-6), "nv": np.maximum(normal[:, 2], 1e-3), "nh": np.clip(normal @ half, 0, 1),
            "lh": np.full(len(point), direction @ half), "lv": np.full(len(point), direction[2]),
        }  # fmt: skip
        matt = REFLECTANCES[material](cosines, np.zeros(len(point)))
        for channel in range(3):
            full = REFLECTANCES[material](cosines, albedo[:, channel])
            direct[f, :, channel] = ((full - matt) + gloss_pattern * matt) * lit[f]
        irradiance[f] = np.maximum(nl, 0) * lit[f]
    bounced = _bounced(caster, point, normal, albedo, irradiance, mask, step, rng, bounces)
    return direct + bounced, normal, lit


def _bounced(caster, point, normal, albedo, irradiance, mask, step, rng, count):
    """Diffuse indirect radiance (F, N, 3) from other visible points of the object, two bounces."""
    if count == 0:
        return 0.0
    size = mask.shape[0]
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(len(point))
    share = np.zeros_like(irradiance[..., None] * np.ones(3))
    once = np.zeros_like(share)
    sources = []
    for _ in range(count):
        ball = rng.normal(size=point.shape)
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        direction = normal + 0.999 * ball
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        _, ray, place = caster.intersects_id(
            point + normal * 2e-3, direction, multiple_hits=False, return_locations=True
        )
        column = np.round(place[:, 0] / step + size / 2 - 0.5).astype(int)
        line = np.round(-place[:, 1] / step + size / 2 - 0.5).astype(int)
        good = (column >= 0) & (column < size) & (line >= 0) & (line < size)
        ray, place, column, line = ray[good], place[good], column[good], line[good]
        hit = number[line, column]
        # A point hidden from the camera has no shading: the pixel it projects to replaces it, at half radiance.
        hidden = np.abs(point[hit][:, 2] - place[:, 2]) > 0.1
        sources.append((ray, hit, np.where(hidden, 0.5, 1.0) * (hit >= 0)))
    for ray, hit, weight in sources:
        np.add.at(once, (slice(None), ray), irradiance[:, hit, None] * albedo[hit] * weight[None, :, None] / count)
    for ray, hit, weight in sources:
        np.add.at(share, (slice(None), ray), once[:, hit] * albedo[hit] * weight[None, :, None] / count)
    return (once + share) * albedo / np.pi
