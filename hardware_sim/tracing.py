"""Ray casting against one triangle mesh by Embree: the only module that imports the ray tracer."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from hardware_sim.sheets import Mesh

START_M = 3e-5
"""Distance, m, above a surface at which rays that leave it start, so that they do not hit their own triangle."""


@dataclass(frozen=True)
class Hits:
    """First hits of rays: `triangles` (N,) int32, −1 where nothing is hit; distances (N,) in units of the direction's
    length; barycentric weights (N, 3) of the triangle's corners."""

    triangles: npt.NDArray[np.int32]
    distances: Float32Array
    weights: Float32Array


class Tracer:
    """First-hit and occlusion queries against one mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(mesh.triangles, dtype=np.float32))

    def first_hits(self, origins: Float32Array, directions: Float32Array) -> Hits:
        """The first hit of each ray; origins and directions (N, 3)."""
        hits = self._scene.run(_rays(origins), _rays(directions), query="INTERSECT", output=1)
        u, v = hits["u"], hits["v"]
        return Hits(hits["primID"], hits["tfar"], np.stack([1 - u - v, u, v], axis=1))

    def occluded(self, origins: Float32Array, directions: Float32Array) -> BoolArray:
        """Whether each ray (N, 3) hits anything."""
        return self._scene.run(_rays(origins), _rays(directions), query="OCCLUDED") >= 0


def _rays(vectors: Float32Array | FloatArray) -> Float32Array:
    return np.ascontiguousarray(vectors, dtype=np.float32)
