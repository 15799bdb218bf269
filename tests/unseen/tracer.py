"""Path tracer for many point lights: paths from the camera are traced once, and their light is summed for each lamp.

The bench needs thousands of images on two cores, and the paths do not depend on the lamp. Direct light is exact: a
shadow ray from each of 4 × 4 points of a pixel, and the full reflectance. Indirect light arrives along stored paths.
About a hundred rays from each pixel, drawn by the reflectance, end at vertices, whose light is that of the nearest of
16,384 points spread over the surface. The points' irradiance takes one shadow ray each. Light between them is diffuse
radiosity with form factors by rays (Goral et al., SIGGRAPH 1984), a product with a sparse matrix. If there is a lobe,
paths continue by reflection in it, a metal's over eight vertices, since its light is not diffuse. An image takes
0.1–0.3 s, and 10–60 s with Mitsuba; `test_mitsuba.py` tests their agreement.

The camera is at the origin and looks along −z (view frame, m). Values y are those of the product: a white Lambertian
surface that faces the lamp at the reference distance on the lamp's axis gives 1. Only the mesh is shared with solver or
simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from hardware_sim.sheets import Mesh
from tests.unseen import brdf
from tests.unseen.brdf import Brdf

VERSION = {"lambert": 3, "oren-nayar": 3, "ggx": 3, "metal": 3}
"""Versions by kind of reflectance; must be raised when a change here changes the rendered images."""

POINTS, POINT_RAYS = 16_384, 64
"""Number of points on the surface that carry indirect light, and of the rays for each one's form factors."""
DIFFUSE_RAYS, LOBE_RAYS = 7, 4
"""Number of final-gather rays from each of a pixel's 16 points, by the diffuse part and by a glossy surface's lobe."""
METAL_RAYS = 12
"""Number of a metal's final-gather rays from each of the 16 points."""
METAL_VERTICES, GLOSS_VERTICES = 8, 3
"""Number of vertices over which paths are followed by reflection in the lobe: with 4 a metal mug is 2 % too dark."""
MOST_BOUNCES, LAST_BOUNCE = 40, 1e-3
"""Most bounces of diffuse light, and the share of added light below which they end earlier."""
TURN_M = 0.006
"""Weight of normals in the search for the nearest point, m: two places with perpendicular normals count as √2 times
this far apart, so that the two sides of a thin sheet are distinguished."""
OFFSET_M = 2e-5
"""Distance above the surface, m, at which rays start."""
PROBE_M = 0.5e-3
"""Least height, m, above the tangent plane from which the entry point of scattered light is searched."""
ENTRIES = 3
"""Number of entry points of scattered light for each of a pixel's 16 points."""
PHI2 = np.array([0.7548776662466927, 0.5698402909980532])
"""Roberts' R₂ sequence: evenly spread points of the unit square."""

Texture = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Hits:
    """Front sides that rays hit: numbers of the rays (N,), points, shading and face normals (N, 3), albedo (N,)."""

    ray: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    albedo: np.ndarray

    def only(self, chosen: np.ndarray) -> "Hits":
        """The chosen hits."""
        return Hits(*(values[chosen] for values in (self.ray, self.point, self.normal, self.face, self.albedo)))

    @property
    def start(self) -> np.ndarray:
        """Starting points of rays that leave the surface."""
        return self.point + OFFSET_M * self.face


@dataclass(frozen=True)
class Lamp:
    """A point light, m, view frame, its axis, and its lobe (h, m) as in `brdf.falloff`."""

    position: np.ndarray
    axis: np.ndarray
    lobe: tuple[float, float] = (0.0, 0.0)

    @property
    def pose(self) -> np.ndarray:
        return np.concatenate([self.position, self.axis]).astype(float)


class Surface:
    """Ray queries of a mesh in the view frame."""

    def __init__(self, mesh: Mesh, texture: Texture) -> None:
        self.mesh, self._texture = mesh, texture
        self._faces = mesh.face_normals
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(mesh.triangles, dtype=np.float32))

    def hits(self, start: np.ndarray, direction: np.ndarray) -> tuple[Hits, np.ndarray]:
        """First front sides along rays (N, 3), and a mask (N,) of rays that hit a back side, as inside a solid."""
        hit_record = self._scene.run(_single(start), _single(direction), query="INTERSECT", output=1)
        ray = np.flatnonzero(hit_record["primID"] >= 0)
        triangle = hit_record["primID"][ray]
        front = np.sum(self._faces[triangle] * direction[ray], axis=1) < 0
        back = np.zeros(len(start), bool)
        back[ray[~front]] = True
        ray, triangle = ray[front], triangle[front]
        u, v = hit_record["u"][ray].astype(float), hit_record["v"][ray].astype(float)
        weight = np.stack([1 - u - v, u, v], axis=1)
        return self.at(triangle, weight, ray), back

    def at(self, triangle: np.ndarray, weight: np.ndarray, ray: np.ndarray | None = None) -> Hits:
        """Surface points by triangle (N,) and barycentric weights (N, 3)."""
        point = np.einsum("nc,nci->ni", weight, self.mesh.triangles[triangle])
        normal = np.einsum("nc,nci->ni", weight, self.mesh.corner_normals[triangle])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        ray = np.arange(len(triangle)) if ray is None else ray
        return Hits(ray, point, normal, self._faces[triangle], self._texture(point))

    def sees(self, hits: Hits, lamp: np.ndarray) -> np.ndarray:
        """Mask (N,) of the points that a lamp at (3,) reaches."""
        to_lamp = lamp - hits.start
        out = np.sum(to_lamp * hits.normal, axis=1) > 0
        where = np.flatnonzero(out)
        once = np.ones(len(where), np.float32)  # up to the lamp, not beyond
        start, to_lamp = _single(hits.start[where]), _single(to_lamp[where])
        blocked = self._scene.run(start, to_lamp, dists=once, query="OCCLUDED") >= 0
        out[where[blocked]] = False
        return out


def _single(vectors: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(vectors, dtype=np.float32)


def camera_rays(pixels: int, focal_px: float, samples: int) -> np.ndarray:
    """Directions (H · W · samples², 3) with z = −1 through an even grid of points in each pixel, pixel by pixel."""
    offset = (np.arange(samples) + 0.5) / samples - 0.5
    place = np.arange(pixels) - (pixels - 1) / 2
    v, dy, u, dx = np.meshgrid(place, offset, place, offset, indexing="ij")
    x, y = (u + dx).transpose(0, 2, 1, 3), -(v + dy).transpose(0, 2, 1, 3)
    return np.stack([x, y, np.full_like(x, -focal_px)], axis=-1).reshape(-1, 3) / focal_px


@dataclass(frozen=True)
class Paths:
    """Vertices of stored paths: pixel, nearest point and weight (V,), position; `closing`: no further vertex."""

    pixel: np.ndarray
    nearest: np.ndarray
    weight: np.ndarray
    closing: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    outward: np.ndarray
    albedo: np.ndarray


class Tracer:
    """Images of one scene for any number of lamps."""

    def __init__(
        self, mesh: Mesh, texture: Texture, reflectance: Brdf, *, pixels: int, focal_px: float, scatter_m: float = 0.0,
        samples: int = 4, reference_m: float, indirect: bool = True, seed: int = 0,
    ) -> None:  # fmt: skip
        self.surface, self.brdf = Surface(mesh, texture), reflectance
        self.pixels, self.samples, self.reference_m = pixels, samples, reference_m
        self._rng = np.random.default_rng(seed)
        direction = camera_rays(pixels, focal_px, samples)
        self._seen, _ = self.surface.hits(np.zeros_like(direction), direction)
        self._outward = _towards(direction[self._seen.ray])
        self._pixel = self._seen.ray // samples**2
        self._entry = self._entries(scatter_m) if scatter_m > 0 and reflectance.diffuse > 0 else None
        self._albedo_share = reflectance.base.hemispherical_albedo() if reflectance.diffuse > 0 else 0.0
        self._lobe_share = reflectance.lobe.hemispherical_albedo() if reflectance.alpha > 0 else 0.0
        self._paths: Paths | None = None
        if indirect:
            self._spread_points()
            self._paths = self._gather()
            if reflectance.lambertian:  # a path's light is a multiple of its point's radiosity
                paths = self._paths
                entries = (paths.weight, (paths.pixel, paths.nearest))
                self._product = csr_array(entries, shape=(pixels**2, len(self._points.point)))

    def render(self, lamp: Lamp) -> np.ndarray:
        """Values y (H, W), float32, as means over each pixel."""
        out = np.bincount(self._pixel, self._direct(lamp), self.pixels**2) / self.samples**2
        if self._paths is not None:
            out += self._indirect(lamp, self._paths)
        return out.reshape(self.pixels, self.pixels).astype(np.float32)

    def ambient(self) -> np.ndarray:
        """Values y (H, W) under light of radiance 1 from all round, with reflections between surfaces."""
        assert self._paths is not None
        escaped = np.maximum(1 - np.asarray(self._form.sum(axis=1)).ravel() - self._buried, 0)
        light = self._radiosity(escaped)
        behind = np.bincount(self._paths.pixel, self._paths.weight * light[self._paths.nearest], self.pixels**2)
        hidden = np.bincount(self._paths.pixel, self._paths.weight, self.pixels**2)
        albedo = np.bincount(self._pixel, self._seen.albedo * self.brdf.hemispherical_albedo(), self.pixels**2)
        return (np.maximum(albedo / self.samples**2 - hidden, 0) + behind).reshape(self.pixels, self.pixels)

    def _direct(self, lamp: Lamp) -> np.ndarray:
        """Direct light (N,) of the points that the camera sees."""
        seen, pose, lobe = self._seen, lamp.pose, np.array(lamp.lobe)
        visible = self.surface.sees(seen, lamp.position)
        if self._entry is None:
            return brdf.lit(
                self.brdf.parameters, pose, lobe, self.reference_m, seen.point, seen.normal, self._outward,
                seen.albedo, visible,
            )  # fmt: skip
        entry = self._entry
        sees = self.surface.sees(entry, lamp.position)
        entering = brdf.lit(
            self.brdf.base.parameters, pose, lobe, self.reference_m, entry.point, entry.normal,
            np.repeat(self._outward, ENTRIES, axis=0), entry.albedo, sees,
        )  # fmt: skip
        out = entering.reshape(-1, ENTRIES).mean(axis=1)
        if self.brdf.alpha > 0:
            out += brdf.lit(
                self.brdf.lobe.parameters, pose, lobe, self.reference_m, seen.point, seen.normal, self._outward,
                seen.albedo, visible,
            )  # fmt: skip
        return out

    def _indirect(self, lamp: Lamp, paths: Paths) -> np.ndarray:
        points, pose, lobe = self._points, lamp.pose, np.array(lamp.lobe)
        sees = self.surface.sees(points, lamp.position)
        direct = brdf.received(pose, lobe, self.reference_m, points.point, points.normal, sees)
        radiosity = self._radiosity(direct)
        if self.brdf.lambertian:
            return self._product @ radiosity
        light = brdf.lit(
            self.brdf.parameters, pose, lobe, self.reference_m, paths.point, paths.normal, paths.outward, paths.albedo,
            sees[paths.nearest],
        )  # fmt: skip
        incoming = (radiosity / self._share - direct)[paths.nearest]
        diffuse = self._albedo_share * self._points.albedo[paths.nearest]
        light += np.where(paths.closing, self._share[paths.nearest], diffuse) * incoming
        return np.bincount(paths.pixel, paths.weight * light, self.pixels**2)

    def _radiosity(self, direct: np.ndarray) -> np.ndarray:
        """Radiosity (P,) of the points under irradiance (P,), by Jacobi iteration of B = ρ (E + F B)."""
        out = self._share * direct
        light = np.sum(out)
        for _ in range(MOST_BOUNCES):
            out = self._share * (direct + self._form @ out)
            if (more := np.sum(out)) < (1 + LAST_BOUNCE) * light:
                break
            light = more
        return out

    def _entries(self, scatter_m: float) -> Hits:
        """Samples where light that leaves the seen points has entered, ENTRIES points for each: at an exponential
        distance along the tangent plane, then down to the surface; the point itself if none faces a similar way there.
        """
        origin = np.repeat(np.arange(len(self._seen.ray)), ENTRIES)
        seen, square = self._seen.only(origin), self._camera_squares(ENTRIES)
        s, t = brdf.frames(seen.normal)
        angle, away = 2 * np.pi * square[:, 1:], -scatter_m * np.log(1 - square[:, :1])
        height = PROBE_M + 2 * away
        start = seen.point + away * (np.cos(angle) * s + np.sin(angle) * t) + height * seen.normal
        hits, _ = self.surface.hits(start, -seen.normal)
        near = np.linalg.norm(hits.point - start[hits.ray], axis=1) < 2 * height[hits.ray, 0]
        near &= np.sum(hits.normal * seen.normal[hits.ray], axis=1) > 0.3
        for values, samples in ((seen.point, hits.point), (seen.normal, hits.normal), (seen.face, hits.face)):
            values[hits.ray[near]] = samples[near]
        return seen

    def _spread_points(self) -> None:
        """Makes points spread evenly by area, form factors between them (rows: receivers), and a search tree of them.

        Points that see mostly back sides lie inside another solid and are left out.
        """
        areas = np.cumsum(self.surface.mesh.areas)
        steps = (np.arange(POINTS) + self._rng.random(POINTS)) * (areas[-1] / POINTS)
        triangle = np.minimum(np.searchsorted(areas, steps), len(areas) - 1)
        u, v = self._rng.random((2, POINTS))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        points = self.surface.at(triangle, np.stack([1 - u - v, u, v], axis=1))
        origin = np.repeat(np.arange(POINTS), POINT_RAYS)
        square = self._squares(POINTS, POINT_RAYS).reshape(-1, 2)
        direction = brdf.scattered(points.normal[origin], square)
        hits, back = self.surface.hits(points.start[origin], direction)
        buried = np.bincount(origin, back, POINTS) / POINT_RAYS
        kept = buried < 0.5
        self._points = points.only(np.flatnonzero(kept))
        self._buried = buried[kept]
        self._tree = cKDTree(_key(self._points))
        number = np.cumsum(kept) - 1
        receiver, use = number[origin[hits.ray]], kept[origin[hits.ray]]
        nearest = self._nearest(hits)
        count = int(np.count_nonzero(kept))
        entries = (np.full(int(use.sum()), 1.0 / POINT_RAYS), (receiver[use], nearest[use]))
        self._form = csr_array(entries, shape=(count, count))
        tint = self._points.albedo if self.brdf.tinted else 1.0
        self._share = self._points.albedo * self._albedo_share + tint * self._lobe_share

    @property
    def _vertices(self) -> int:
        if self.brdf.alpha == 0:
            return 1
        return GLOSS_VERTICES if self.brdf.diffuse > 0 else METAL_VERTICES

    def _gather(self) -> Paths:
        """Paths from the camera's points by diffuse and lobe rays, over `_vertices` vertices each."""
        seen, outward = self._seen, self._outward
        made: list[tuple[np.ndarray, ...]] = []
        if self.brdf.diffuse > 0:
            origin = np.repeat(np.arange(len(seen.ray)), DIFFUSE_RAYS)
            direction = brdf.scattered(seen.normal[origin], self._camera_squares(DIFFUSE_RAYS))
            weight = brdf.values(
                self.brdf.base.parameters, seen.albedo[origin], seen.normal[origin], outward[origin], direction
            )
            made += self._followed(origin, direction, weight / DIFFUSE_RAYS, self._vertices)
        if self.brdf.alpha > 0:
            count = LOBE_RAYS if self.brdf.diffuse > 0 else METAL_RAYS
            origin = np.repeat(np.arange(len(seen.ray)), count)
            square = self._camera_squares(count)
            direction, weight = brdf.reflected(
                self.brdf, seen.albedo[origin], seen.normal[origin], outward[origin], square
            )
            made += self._followed(origin, direction, weight / count, self._vertices)
        return Paths(*(np.concatenate(parts) for parts in zip(*made, strict=True)))

    def _followed(
        self, origin: np.ndarray, direction: np.ndarray, weight: np.ndarray, vertices: int
    ) -> list[tuple[np.ndarray, ...]]:
        """Vertices of paths that leave seen points (N,) in directions (N, 3), as columns of `Paths`."""
        start, pixel = self._seen.start[origin], self._pixel[origin]
        weight = weight / self.samples**2
        out: list[tuple[np.ndarray, ...]] = []
        for number in range(vertices):
            hits, _ = self.surface.hits(start, direction)
            useful = weight[hits.ray] > 0
            hits = hits.only(useful)
            pixel, weight, outward = pixel[hits.ray], weight[hits.ray], -direction[hits.ray]
            closing = np.full(len(pixel), number == vertices - 1)
            place = (hits.point, hits.normal, outward, hits.albedo)
            # Single precision halves the memory of millions of vertices.
            out.append((pixel, self._nearest(hits), _single(weight), closing, *(_single(part) for part in place)))
            if number < vertices - 1:
                square = self._rng.random((len(pixel), 2))
                direction, on = brdf.reflected(self.brdf, hits.albedo, hits.normal, outward, square)
                start, weight = hits.start, weight * on * (np.sum(outward * hits.normal, axis=1) > 0)
        return out

    def _camera_squares(self, count: int) -> np.ndarray:
        """Points (N · count, 2) of the unit square for the seen points; those of a pixel are evenly spread together."""
        per_pixel = self._squares(self.pixels**2, count * self.samples**2).reshape(-1, count, 2)
        return per_pixel[self._seen.ray].reshape(-1, 2)

    def _squares(self, sets: int, count: int) -> np.ndarray:
        """Sets (sets, count, 2) of evenly spread points of the unit square, each shifted at random."""
        return (np.arange(count)[:, None] * PHI2 + self._rng.random((sets, 1, 2))) % 1.0

    def _nearest(self, hits: Hits) -> np.ndarray:
        return self._tree.query(_key(hits))[1]


def _key(hits: Hits) -> np.ndarray:
    return np.concatenate([hits.point, TURN_M * hits.normal], axis=1)


def _towards(direction: np.ndarray) -> np.ndarray:
    return -direction / np.linalg.norm(direction, axis=1, keepdims=True)
