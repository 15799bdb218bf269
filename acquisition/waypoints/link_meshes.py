"""The maker's meshes of the arm's links, for drawings and audits only; the capsules alone decide what is safe.

They are the collision meshes of `ur_description` (BSD-3-Clause, `meshes/LICENSE`), unchanged but for their packing:
7,500 to 10,300 triangles per arm, few enough for a browser. The UR15's, UR20's and UR30's are the UR10e's, stretched
(`estimated_links`).
"""

from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
import numpy.typing as npt

from acquisition.models.base import Float32Array
from acquisition.waypoints.kinematics import arm_model


@dataclass(frozen=True)
class LinkMesh:
    """Triangles of one link in its Denavit–Hartenberg frame: `vertices` (V, 3) in m, `faces` (F, 3), outwards."""

    link: int
    name: str
    vertices: Float32Array
    faces: npt.NDArray[np.uint16]


@cache
def link_meshes(model: str) -> tuple[LinkMesh, ...]:
    """Returns the meshes of links 0 (base) to 6 (flange) of an arm such as `ur5e`. Raises RigError config.invalid."""
    file = resources.files("acquisition.waypoints").joinpath("meshes", f"{arm_model(model).links_of}.npz")
    with file.open("rb") as opened, np.load(opened) as stored:
        stems = sorted(name.removesuffix("_faces") for name in stored.files if name.endswith("_faces"))
        return tuple(
            LinkMesh(
                link=int(stem.partition("_")[0]),
                name=stem.partition("_")[2],
                vertices=np.asarray(stored[f"{stem}_vertices"], np.float32),
                faces=np.asarray(stored[f"{stem}_faces"], np.uint16),
            )
            for stem in stems
        )
