"""Light that surfaces throw at one another: radiosity on a coarse mesh of patches, hidden sides and table included.

A patch is a cluster of points drawn evenly from the surface, near one another in place and direction, so that any mesh
gives patches of like size without being remeshed. Form factors are those of small discs with visibility by ray casting;
they depend on shape alone and take less than a second, so that they are not stored. The indirect light is smooth except
at contact, so that its interpolation from patches to pixels of the fine mesh loses little.

Source: C. M. Goral et al., Modeling the interaction of light between diffuse surfaces, SIGGRAPH 1984; the disc's form
factor is J. R. Wallace et al., A ray tracing algorithm for progressive radiosity, SIGGRAPH 1989.
"""

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from acquisition.types import BoolArray, Float32Array, FloatArray
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import START_M, Tracer

TURN_M = 0.012
"""Two points whose normals are at right angles count as √2 times this far apart when points are clustered."""
NEAR_AREAS = 20.0
NEAR_CONNECTIONS = 16
"""Patches nearer than the root of so many patch areas are compared by so many pairs of points."""
LIFT_M = 6e-5
"""Connections run this far above the surface."""
NEIGHBOURS = 10
"""Patches that a pixel's indirect light is interpolated from."""


@dataclass(frozen=True)
class Patches:
    """P patches: centres and unit normals (P, 3), areas (P,) m²; S points drawn from them (S, 3), each one's patch."""

    centres: FloatArray
    normals: FloatArray
    areas: FloatArray
    points: FloatArray
    point_normals: FloatArray
    point_patches: npt.NDArray[np.int64]

    def mean(self, values: FloatArray) -> FloatArray:
        """The mean (P,) over each patch of values (S,) at its points."""
        count = len(self.centres)
        return np.bincount(self.point_patches, values, count) / np.bincount(self.point_patches, minlength=count)


def cluster(mesh: Mesh, tracer: Tracer, count: int, points_per_patch: int = 20) -> Patches:
    """About `count` patches of what is exposed of a mesh, always the same for the same mesh."""
    random = np.random.default_rng(1)
    areas = mesh.areas
    total = float(areas.sum())
    # Systematic sampling: equal steps along the cumulated area, so that no region is left out by chance.
    steps = (np.arange(count * points_per_patch) + random.uniform(size=count * points_per_patch)) * (
        total / (count * points_per_patch)
    )
    faces = np.minimum(np.searchsorted(np.cumsum(areas), steps), len(areas) - 1)
    u, v = random.uniform(size=(2, len(faces)))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    corners = mesh.triangles[faces]
    points = corners[:, 0] + u[:, None] * (corners[:, 1] - corners[:, 0]) + v[:, None] * (corners[:, 2] - corners[:, 0])
    normals = mesh.face_normals[faces]
    outside = exposed(tracer, points, normals)
    points, normals = points[outside], normals[outside]

    place = np.concatenate([points, TURN_M * normals], axis=1)
    seeds = place[random.choice(len(place), count, replace=False)]
    nearest = np.zeros(len(place), dtype=np.int64)
    for _ in range(4):  # Lloyd's iterations
        _, nearest = cKDTree(seeds).query(place)
        occupied, nearest = np.unique(nearest, return_inverse=True)
        sums = np.stack([np.bincount(nearest, column, len(occupied)) for column in place.T], axis=1)
        seeds = sums / np.bincount(nearest, minlength=len(occupied))[:, None]
    # The middle of a curved patch lies off the surface; its own point nearest to the middle does not.
    distance = np.linalg.norm(place - seeds[nearest], axis=1)
    order = np.lexsort((distance, nearest))
    middle = order[np.unique(nearest[order], return_index=True)[1]]
    mean_normal = seeds[:, 3:] / np.linalg.norm(seeds[:, 3:], axis=1, keepdims=True)
    share = np.bincount(nearest) / len(nearest)
    return Patches(points[middle], mean_normal, total * float(outside.mean()) * share, points, normals, nearest)


def disc(radius_m: float, rings: int, sectors: int, far_m: float) -> Patches:
    """Patches of a table, facing up: `rings` within `radius_m` of the z axis, and wider ones out to `far_m`."""
    within = radius_m * np.linspace(0, 1, rings + 1) ** 1.3
    beyond = np.geomspace(radius_m, far_m, 1 + round(np.log(far_m / radius_m) / 0.4))
    edges = np.concatenate([within, beyond[1:]])
    rings = len(edges) - 1
    angles = 2 * np.pi * np.arange(sectors) / sectors
    inner, outer = edges[:-1, None], edges[1:, None]
    middle = np.sqrt((inner**2 + outer**2) / 2)
    spread = 2 * np.pi / sectors / 4
    points = [
        np.stack(np.broadcast_arrays(r * np.cos(a), r * np.sin(a), 0.0), axis=-1).reshape(-1, 3)
        for r in (np.sqrt(0.75 * inner**2 + 0.25 * outer**2), np.sqrt(0.25 * inner**2 + 0.75 * outer**2))
        for a in (angles - spread, angles + spread)
    ]
    centres = np.stack([middle * np.cos(angles), middle * np.sin(angles), np.zeros((rings, sectors))], axis=-1).reshape(
        -1, 3
    )
    areas = np.repeat(np.pi * (outer**2 - inner**2)[:, 0] / sectors, sectors)
    up = np.array([0.0, 0.0, 1.0])
    return Patches(
        centres,
        np.tile(up, (len(centres), 1)),
        areas,
        np.concatenate(points),
        np.tile(up, (4 * len(centres), 1)),
        np.tile(np.arange(len(centres)), 4),
    )


def joined(first: Patches, second: Patches) -> Patches:
    """All patches of both, those of `first` before those of `second`."""
    return Patches(
        np.concatenate([first.centres, second.centres]),
        np.concatenate([first.normals, second.normals]),
        np.concatenate([first.areas, second.areas]),
        np.concatenate([first.points, second.points]),
        np.concatenate([first.point_normals, second.point_normals]),
        np.concatenate([first.point_patches, second.point_patches + len(first.centres)]),
    )


def exposed(tracer: Tracer, points: FloatArray, normals: FloatArray) -> BoolArray:
    """Which points (N, 3) of the tracer's mesh lie on its outside, not buried in another of its overlapping solids.

    A ray that leaves a buried point along its normal (N, 3) stops at a face that it meets from behind.
    """
    starts = points + START_M * normals
    hits = tracer.first_hits(starts.astype(np.float32), normals.astype(np.float32))
    return (hits.triangles < 0) | (np.einsum("ni,ni->n", tracer.mesh.face_normals[hits.triangles], normals) < 1e-6)


def form_factors(patches: Patches, tracer: Tracer) -> Float32Array:
    """F (P, P): the share of patch i's hemisphere, weighted by the cosine, that patch j fills as i sees it.

    Patches close to each other are compared point by point, since part of one may be hidden from the other; far ones
    from centre to centre.
    """
    count = len(patches.centres)
    order = np.argsort(patches.point_patches, kind="stable")
    first = np.searchsorted(patches.point_patches[order], np.arange(count + 1))
    points, normals = patches.points[order], patches.point_normals[order]
    rows, columns, starts, ends, kernel = _pairs(
        patches.centres, patches.normals, patches.areas, points, normals, first.astype(np.int64)
    )
    seen = np.empty(len(rows), dtype=bool)
    for start in range(0, len(rows), 1_000_000):
        part = slice(start, start + 1_000_000)
        # A ray has no end, so what it hits beyond the far patch does not count.
        hits = tracer.first_hits(starts[part], ends[part] - starts[part])
        seen[part] = (hits.triangles < 0) | (hits.distances > 1 - 1e-3)
    rows, columns, kernel = rows[seen], columns[seen], kernel[seen]
    both = np.concatenate([rows * count + columns, columns * count + rows])
    share = np.concatenate([kernel * patches.areas[columns], kernel * patches.areas[rows]])
    factors = np.bincount(both, share, count * count).astype(np.float32).reshape(count, count)
    # Discs in touch can fill more than the hemisphere; nobody can.
    return factors / np.maximum(factors.sum(axis=1, keepdims=True), 1.0)


@numba.njit(
    "Tuple((int64[::1], int64[::1], float32[:, ::1], float32[:, ::1], float64[::1]))"
    "(float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1], int64[::1])",
    cache=True,
)
def _pairs(
    centres: FloatArray,
    normals: FloatArray,
    areas: FloatArray,
    points: FloatArray,
    point_normals: FloatArray,
    first: npt.NDArray[np.int64],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Float32Array, Float32Array, FloatArray]:
    """Connections between patches that face each other: both patches, both ends, and the part of F_ij / A_j.

    The points of patch i are points[first[i] : first[i + 1]].
    """
    count = len(centres)
    rows = np.empty(0, dtype=np.int64)
    columns = np.empty(0, dtype=np.int64)
    starts = np.empty((0, 3), dtype=np.float32)
    ends = np.empty((0, 3), dtype=np.float32)
    kernel = np.empty(0, dtype=np.float64)
    p, q, m, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    total = 0
    for fill in (False, True):
        if fill:
            rows, columns = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
            starts, ends = np.empty((total, 3), dtype=np.float32), np.empty((total, 3), dtype=np.float32)
            kernel = np.empty(total, dtype=np.float64)
            total = 0
        for i in range(count):
            for j in range(i + 1, count):
                x, y, z = centres[j, 0] - centres[i, 0], centres[j, 1] - centres[i, 1], centres[j, 2] - centres[i, 2]
                area = (areas[i] + areas[j]) / 2
                near = x * x + y * y + z * z < NEAR_AREAS * area
                in_first, in_second = first[i + 1] - first[i], first[j + 1] - first[j]
                connections = NEAR_CONNECTIONS if near else 1
                for k in range(connections):
                    if near:
                        one, other = first[i] + k % in_first, first[j] + (7 * k + 3) % in_second
                        p[:], m[:] = points[one], point_normals[one]
                        q[:], n[:] = points[other], point_normals[other]
                    else:
                        p[:], m[:], q[:], n[:] = centres[i], normals[i], centres[j], normals[j]
                    x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
                    out = m[0] * x + m[1] * y + m[2] * z
                    back = -(n[0] * x + n[1] * y + n[2] * z)
                    if out <= 0 or back <= 0:
                        continue
                    if fill:
                        square = x * x + y * y + z * z
                        rows[total], columns[total] = i, j
                        kernel[total] = out * back / (square * (np.pi * square + area / connections)) / connections
                        for axis in range(3):
                            starts[total, axis] = p[axis] + LIFT_M * m[axis]
                            ends[total, axis] = q[axis] + LIFT_M * n[axis]
                    total += 1
    return rows, columns, starts, ends, kernel


def bounced(factors: Float32Array, albedo: FloatArray, direct: FloatArray) -> FloatArray:
    """Indirect light (P,) falling on each patch, all bounces, from the direct light (P,) that falls on it."""
    direct32, albedo32 = direct.astype(np.float32), albedo.astype(np.float32)
    indirect = np.zeros_like(direct32)
    for _ in range(60):
        before = indirect
        indirect = factors @ (albedo32 * (direct32 + before))
        if np.abs(indirect - before).max() <= 1e-4 * max(float(indirect.max()), 1e-12):
            break
    return indirect.astype(np.float64)


def interpolation(patches: Patches, points: FloatArray, normals: FloatArray) -> csr_array:
    """The matrix (N, P) that takes values of patches to points (N, 3) with normals (N, 3).

    Weights fall to zero at the farthest of the neighbours used, so that they change smoothly from point to point.
    """
    neighbours = min(NEIGHBOURS, len(patches.centres) - 1)
    tree = cKDTree(np.concatenate([patches.centres, TURN_M * patches.normals], axis=1))
    found = tree.query(np.concatenate([points, TURN_M * normals], axis=1), k=neighbours + 1)
    distance, patch = np.asarray(found[0]), np.asarray(found[1])
    weight = (1 - (distance[:, :-1] / distance[:, -1:]) ** 2) ** 2 + 1e-9
    weight /= weight.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), neighbours)
    return csr_array(
        (weight.ravel().astype(np.float32), (rows, patch[:, :-1].ravel())), shape=(len(points), len(patches.centres))
    )
