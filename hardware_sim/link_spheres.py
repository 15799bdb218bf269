"""Sphere covers of an arm's links, from convex meshes, for the collision check of `controller.contact`.

Spheres are used because the distance of two is one subtraction: a few hundred thousand a second cost the controller
almost nothing, and the same sets serve against table, camera, object and the arm itself. A link's spheres protrude from
its convex mesh by at most `OUT_M` and leave no point of its surface (sampled every 2.5 mm) more than `GAP_M` outside.
So a contact is detected at the latest when a body is `GAP_M` deep, and never while it is further off than `OUT_M`.

    python -m hardware_sim.link_spheres FOLDER

FOLDER holds a folder for each model to be made again, with seven convex, watertight STL files in m, sorted from base to
flange, each in its Denavit–Hartenberg frame. They are the collision meshes of UR's public robot description
(BSD-3-Clause), or those that `acquisition.waypoints.estimated_links` makes of them, which puts an empty file
`estimated` beside them. In the table, a model with the links of another one holds that one's name.
"""

import heapq
import json
import sys
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import KDTree

from acquisition.models.base import FloatArray

OUT_M = 0.001
GAP_M = 0.002
UNIT_M = 1e-4
"""Numbers are stored as whole tenths of a millimetre."""
ESTIMATED = 3.0
"""Factor of the tolerances for arms whose shape is an estimate, which itself is wrong by centimetres."""

_SAMPLE_M = 0.0025
_LATTICE_M = 0.006
_DEPTHS_M = (0.002, 0.004, 0.008, 0.016, 0.025, 0.035)


def packed(mesh: trimesh.Trimesh, coarse: float = 1.0) -> FloatArray:
    """Greedy set cover of a convex mesh by spheres (S, 4), centre and radius in m; tolerances times `coarse`."""
    out_m, gap_m = coarse * OUT_M, coarse * GAP_M
    surface = np.vstack([mesh.sample(int(mesh.area / (coarse * _SAMPLE_M) ** 2), seed=0), mesh.vertices])
    centers = np.vstack([_candidates(mesh, coarse), surface])  # a point of the surface covers at least itself
    offsets = (mesh.face_normals * mesh.triangles_center).sum(axis=1)
    radii = (offsets - centers @ mesh.face_normals.T).min(axis=1) + out_m
    inside = radii > out_m - UNIT_M
    centers, radii = centers[inside], np.maximum(radii[inside], out_m)
    reached = [np.array(r, dtype=int) for r in KDTree(surface).query_ball_point(centers, radii + gap_m - UNIT_M)]
    missing = np.ones(len(surface), dtype=bool)
    best = [(-len(points), number) for number, points in enumerate(reached)]
    heapq.heapify(best)
    chosen: list[int] = []
    while missing.any():
        if not best:
            raise ValueError(f"{int(missing.sum())} of {len(surface)} points stay uncovered: the mesh is not convex")
        _, number = heapq.heappop(best)
        gain = int(missing[reached[number]].sum())
        if gain and best and gain < -best[0][0]:
            heapq.heappush(best, (-gain, number))
        elif gain:
            chosen.append(number)
            missing[reached[number]] = False
    return np.column_stack([centers[chosen], radii[chosen]])


def _candidates(mesh: trimesh.Trimesh, coarse: float) -> FloatArray:
    """Candidate centres: a lattice, and points at several depths below the surface and below the vertices."""
    low, high = mesh.bounds
    step = coarse * _LATTICE_M
    axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
    points, faces = trimesh.sample.sample_surface(mesh, 3000, seed=1)[:2]
    under = [
        start - coarse * depth * normals
        for start, normals in ((points, mesh.face_normals[faces]), (mesh.vertices, mesh.vertex_normals))
        for depth in _DEPTHS_M
    ]
    return np.vstack([np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), *under])


def main(folder: Path) -> None:
    """Writes the controller's table: model → seven lists of integers x, y, z, radius, x, y, …"""
    table = Path(__file__).parent / "controller" / "link_spheres.json"
    models: dict[str, list[list[int]] | str] = json.loads(table.read_text(encoding="utf-8"))
    for model in sorted(folder.iterdir()):
        coarse = ESTIMATED if (model / "estimated").exists() else 1.0
        links = [packed(trimesh.load_mesh(path), coarse) for path in sorted(model.glob("*.stl"))]
        models[model.name] = [np.rint(link / UNIT_M).astype(int).ravel().tolist() for link in links]
    table.write_text(json.dumps(models, separators=(",", ":")).replace("],[", "],\n[") + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
