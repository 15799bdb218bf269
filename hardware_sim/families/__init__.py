"""Random objects by code: eight families of shapes, each with random parameters, textures and reflectances.

They stand for objects to which neither planner nor solver was tuned. A family and a seed determine an object, the same
on every call. Seeds below 1000 are design seeds, free to look at and to tune on. Seeds from 1000 on are report seeds,
which are run once, for the closing note of a change (`CONTRIBUTING.md`).
"""

from dataclasses import dataclass

import numpy as np

from hardware_sim.families import blob, cluster, knot, machined, relief, sheet, turned, vessel
from hardware_sim.families.appearance import Texture, reflectance_of, texture_of
from hardware_sim.families.surfaces import placed, turned_by
from hardware_sim.reflectance import Reflectance
from hardware_sim.sheets import Mesh

SHAPES = {
    "turned": turned.shape,
    "relief": relief.shape,
    "machined": machined.shape,
    "vessel": vessel.shape,
    "cluster": cluster.shape,
    "blob": blob.shape,
    "knot": knot.shape,
    "sheet": sheet.shape,
}
"""Each family's function that makes a mesh of any size from random numbers."""

NAMES = tuple(SHAPES)

EXTENT_M = (0.07, 0.13)
"""Range of the largest extent along an axis, m, for which table and keep-out of the cell leave room for the lamp."""


@dataclass(frozen=True)
class RandomObject:
    """An object of a family; its mesh stands on z = 0 of the object frame, centred in x and y, below lights and camera.

    `dataclasses.replace` gives it another texture or reflectance.
    """

    family: str
    seed: int
    mesh: Mesh
    texture: Texture
    reflectance: Reflectance


def make(family: str, seed: int) -> RandomObject:
    """Makes an object, bit-identical for the same family and seed. Raises ValueError that names the families."""
    if family not in SHAPES:
        raise ValueError(f"there is no family {family!r}: choose one of {', '.join(NAMES)}")
    if seed < 0:
        raise ValueError(f"the seed is {seed}: it must be 0 or more")
    random = np.random.default_rng([NAMES.index(family), seed])
    extent, yaw = random.uniform(*EXTENT_M), random.uniform(-np.pi, np.pi)
    mesh = SHAPES[family](random)
    upright = mesh.transformed(turned_by(np.array([0.0, 0.0, 1.0]), yaw), np.zeros(3))
    return RandomObject(family, seed, placed(upright, extent), texture_of(seed), reflectance_of(seed))
