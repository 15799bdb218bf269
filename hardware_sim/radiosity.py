"""Interreflections of diffuse surfaces by radiosity on patches, table included.

A patch is a cluster of points sampled evenly from the surface that are close in position and normal. Thus any mesh
gives patches of similar size without remeshing. Form factors are Monte-Carlo estimates by rays, which are right at
contact too, where formulas for distant patches are not. They depend on shape alone and take a few seconds, so they are
not stored. Beside a wall indirect light changes within a patch, so that pixels do not take it from the patches there:
points of the image gather it anew from all patches (final gathering), and pixels interpolate between these points.

Source: C. M. Goral et al., Modeling the interaction of light between diffuse surfaces, SIGGRAPH 1984; form factors by
rays: F. X. Sillion and C. Puech, Radiosity and Global Illumination, 1994, section 4; final gathering: M. C. Reichert, A
two-pass radiosity method driven by lights and viewer position, Cornell University 1992.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from acquisition.models.base import BoolArray, FloatArray
from hardware_sim.sheets import Mesh
from hardware_sim.tracing import START_M, Tracer

TURN_M = 0.012
"""Weight of normals in clustering, m: two points with perpendicular normals count as √2 times this far apart."""
RAYS = 256
"""Number of rays that leave each patch or point to estimate its form factors."""
NEIGHBOURS = 10
OFF_PLANE = 15.0
"""Number of points from which a pixel's indirect light is interpolated, and the extra weight of their squared distance
from its tangent plane."""


@dataclass(frozen=True)
class Patches:
    """P patches: centres and unit normals (P, 3), areas (P,) m²; S sampled points and normals (S, 3), patches (S,)."""

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
    """Divides a mesh's exposed surface into about `count` patches by Lloyd's algorithm; deterministic."""
    random = np.random.default_rng(1)
    areas = mesh.areas
    total = float(areas.sum())
    # Systematic sampling: equal steps along the cumulative area, so that no region is left out by chance.
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
    # The mean of a curved patch's points lies off the surface; its point nearest to the mean does not.
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
    """Concatenates patches, those of `first` before those of `second`."""
    return Patches(
        np.concatenate([first.centres, second.centres]),
        np.concatenate([first.normals, second.normals]),
        np.concatenate([first.areas, second.areas]),
        np.concatenate([first.points, second.points]),
        np.concatenate([first.point_normals, second.point_normals]),
        np.concatenate([first.point_patches, second.point_patches + len(first.centres)]),
    )


def exposed(tracer: Tracer, points: FloatArray, normals: FloatArray) -> BoolArray:
    """Mask (N,) of points (N, 3) on the outside of the tracer's mesh, not buried in another of its overlapping solids.

    A ray that leaves a buried point along its normal (N, 3) first meets a face from behind.
    """
    starts = points + START_M * normals
    hits = tracer.first_hits(starts.astype(np.float32), normals.astype(np.float32))
    return (hits.triangles < 0) | (np.einsum("ni,ni->n", tracer.mesh.face_normals[hits.triangles], normals) < 1e-6)


def form_factors(patches: Patches, tracer: Tracer, table_m: float = 0.0) -> csr_array:
    """Form factors F (P, P) of the patches by cosine-weighted Monte-Carlo rays (Sillion & Puech 1994, section 4).

    F[i, j] is the cosine-weighted share of patch i's hemisphere that patch j fills. Rays leave the points of each
    patch. Rays that miss the mesh and go down meet the table, z = 0 within `table_m` of the axis.
    """
    count = len(patches.centres)
    order = np.argsort(patches.point_patches, kind="stable")
    first = np.searchsorted(patches.point_patches[order], np.arange(count + 1))
    which = order[first[:-1, None] + np.arange(RAYS) % np.diff(first)[:, None]]
    return _traced_factors(patches.points, patches.point_normals, which, patches, tracer, table_m)


def gathered_factors(
    points: FloatArray, normals: FloatArray, patches: Patches, tracer: Tracer, table_m: float = 0.0
) -> csr_array:
    """Form factors (N, P) from points (N, 3) with normals (N, 3) to the patches, by rays as in `form_factors`."""
    which = np.broadcast_to(np.arange(len(points))[:, None], (len(points), RAYS))
    return _traced_factors(points, normals, which, patches, tracer, table_m)


def _traced_factors(
    points: FloatArray, normals: FloatArray, which: npt.NDArray[np.int64], patches: Patches, tracer: Tracer,
    table_m: float,
) -> csr_array:  # fmt: skip
    """Form factors (N, P) by RAYS rays each, evenly over the cosine-weighted hemisphere.

    `which` (N, RAYS) are the numbers of the points that the rays leave, of (S, 3) with normals (S, 3). What a ray meets
    first is assigned to the patch nearest in position and normal.
    """
    count = len(which)
    tree = cKDTree(np.concatenate([patches.centres, TURN_M * patches.normals], axis=1))
    face_normals = tracer.mesh.face_normals
    turns = np.random.default_rng(2).uniform(size=(count, 2))
    rows, columns = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for start in range(0, count, 1000):
        some = np.arange(start, min(start + 1000, count))
        # A low-discrepancy sequence (Roberts' R2), shifted at random for each start.
        u = (turns[some, 0, None] + 0.7548776662466927 * np.arange(RAYS)) % 1.0
        v = (turns[some, 1, None] + 0.5698402909980532 * np.arange(RAYS)) % 1.0
        leaving = which[some].ravel()
        directions = _hemisphere(normals[leaving], u.ravel(), v.ravel())
        origins = points[leaving] + START_M * normals[leaving]
        hits = tracer.first_hits(origins.astype(np.float32), directions.astype(np.float32))
        on_mesh = hits.triangles >= 0
        down = ~on_mesh & (directions[:, 2] < -1e-6)
        reach = np.where(on_mesh, hits.distances, -origins[:, 2] / np.where(down, directions[:, 2], -1.0))
        ends = origins + reach[:, None] * directions
        met = on_mesh | (down & (np.hypot(ends[:, 0], ends[:, 1]) < table_m))
        facing = np.where(on_mesh[:, None], face_normals[hits.triangles], [0.0, 0.0, 1.0])
        _, nearest = tree.query(np.concatenate([ends[met], TURN_M * facing[met]], axis=1))
        rows.append(np.repeat(some, RAYS)[met])
        columns.append(np.asarray(nearest, dtype=np.int64))
    row, column = np.concatenate(rows), np.concatenate(columns)
    share = np.full(len(row), 1.0 / RAYS, dtype=np.float32)
    return csr_array((share, (row, column)), shape=(count, len(patches.centres)))


def _hemisphere(normals: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Cosine-weighted hemisphere samples (Malley): unit vectors (N, 3) about normals (N, 3); u, v (N,) in [0, 1)."""
    radius, angle = np.sqrt(u), 2 * np.pi * v
    side = np.where(np.abs(normals[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(side, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    across = (radius * np.cos(angle))[:, None] * first + (radius * np.sin(angle))[:, None] * second
    return across + np.sqrt(1 - u)[:, None] * normals


def indirect_irradiance(factors: csr_array, albedo: FloatArray, direct: FloatArray) -> FloatArray:
    """Solves the radiosity equation by Jacobi iteration: indirect irradiance (P,) from direct irradiance (P,)."""
    direct32, albedo32 = direct.astype(np.float32), albedo.astype(np.float32)
    indirect = np.zeros_like(direct32)
    for _ in range(60):
        before = indirect
        indirect = factors @ (albedo32 * (direct32 + before))
        if np.abs(indirect - before).max() <= 1e-4 * max(float(indirect.max()), 1e-12):
            break
    return indirect.astype(np.float64)


def interpolation(
    centres: FloatArray, centre_normals: FloatArray, points: FloatArray, normals: FloatArray
) -> csr_array:
    """Matrix (N, P) that interpolates values at `centres` (P, 3) with normals (P, 3) to points (N, 3) with theirs.

    Centres off a point's tangent plane count as farther, so that the top of a step has no weight at its foot. Weights
    fall to zero at the farthest of the neighbours used, so that they change smoothly from point to point. Where there
    are too few centres for that, as of an object of a few pixels, each point has the value of the nearest one.
    """
    queried, shape = 2 * NEIGHBOURS, (len(points), len(centres))
    places = np.concatenate([points, TURN_M * normals], axis=1)
    tree = cKDTree(np.concatenate([centres, TURN_M * centre_normals], axis=1))
    if len(centres) < queried:
        nearest = np.asarray(tree.query(places)[1])
        return csr_array((np.ones(len(points), np.float32), (np.arange(len(points)), nearest)), shape=shape)
    neighbours = tree.query(places, k=queried)
    distance, nearest = np.asarray(neighbours[0]), np.asarray(neighbours[1])
    height = np.einsum("ni,nki->nk", normals, centres[nearest]) - np.einsum("ni,ni->n", normals, points)[:, None]
    square = distance**2 + OFF_PLANE * height**2
    reach = np.partition(square, NEIGHBOURS, axis=1)[:, NEIGHBOURS, None]
    weight = np.clip(1 - square / reach, 0, None) ** 2
    weight /= weight.sum(axis=1, keepdims=True)
    rows = np.repeat(np.arange(len(points)), queried)
    matrix = csr_array((weight.ravel().astype(np.float32), (rows, nearest.ravel())), shape=shape)
    matrix.eliminate_zeros()
    return matrix
