"""Clusters: five to twelve plain solids in any orientation, sunk into a plate, heaped on one another or apart."""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.families import fields
from hardware_sim.families.contour import contour
from hardware_sim.families.surfaces import turned_by
from hardware_sim.implicit import Field
from hardware_sim.sheets import Mesh

SPACING = 1 / 150
"""Lattice of the contouring, in parts of the largest extent: 0.5–0.9 mm."""


@dataclass(frozen=True)
class _Solid:
    """A rotated and shifted solid, with radii of an enclosing and of an enclosed sphere round its centre."""

    field: Field
    centre: FloatArray  # (3,)
    outer: float
    inner: float


def shape(random: np.random.Generator) -> Mesh:
    """Solids on a plate of about unit width."""
    thick = random.uniform(0.03, 0.08)
    outline = fields.disc(0.5) if random.random() < 0.4 else fields.box((0.5, random.uniform(0.35, 0.5)))
    plate = fields.prism(outline, 0.0, thick, random.choice([0.0, thick / 3]))
    crowd = random.uniform(0.65, 1.1)
    solids: list[_Solid] = []
    for _ in range(int(random.integers(5, 13))):
        solids.append(_solid(random, thick, crowd, solids))

    def field(points: FloatArray) -> FloatArray:
        centred = points + np.array([0.0, 0.0, 0.4])
        nearest = plate(centred)
        for solid in solids:
            bound = np.linalg.norm(centred - solid.centre, axis=-1) - solid.outer
            near = bound < nearest
            nearest[near] = np.minimum(nearest[near], solid.field(centred[near]))
        return np.maximum(nearest, -centred[..., 2])

    return contour(field, np.array([0.66, 0.66, 0.46]), SPACING)


def _solid(random: np.random.Generator, floor: float, crowd: float, others: list[_Solid]) -> _Solid:
    """Makes one more solid: three in ten stand on another one, the rest in the plate."""
    size = random.uniform(0.07, 0.17)
    kind = random.choice(["sphere", "box", "cylinder", "cone", "ring", "hexagon", "capsule"])
    stretch = random.uniform(0.5, 1.0, 3)
    if kind == "sphere":
        field, outer, inner = fields.sphere(size), size, size
    elif kind == "box":
        half = size * stretch
        field, outer, inner = fields.box(half), float(np.linalg.norm(half)), float(half.min())
    elif kind == "ring":
        field, outer, inner = fields.torus(size, size / 3), 1.34 * size, size / 3
    elif kind == "capsule":
        field, outer, inner = fields.capsule((0, 0, -size), (0, 0, size), size / 2.5), 1.4 * size, size / 2.5
    elif kind == "hexagon":
        high = size * stretch[0]
        field = fields.prism(fields.polygon(6, size), -high, high)
        outer, inner = float(np.hypot(1.16 * size, high)), min(size, high)
    else:
        top = size * (random.uniform(0.0, 0.3) if kind == "cone" else 1.0)
        high = size * random.uniform(0.5, 1.5)
        field = fields.cone(size, 2 * high, top)
        outer, inner = float(np.hypot(size, high)), min(high, size / 3)
    turn = turned_by(random.normal(size=3), random.uniform(0, np.pi)) if random.random() < 0.7 else np.eye(3)
    place = random.uniform(-0.36, 0.36, 2) * crowd
    centre = np.array([*place, floor + inner * random.uniform(0.2, 0.95)])
    if others and random.random() < 0.3:
        below = others[int(random.integers(len(others)))]
        aside = random.normal(size=3)
        aside[2] = 2 * abs(aside[2]) + 0.5
        centre = below.centre + aside / np.linalg.norm(aside) * 0.9 * (inner + below.inner)
        centre[:2] = np.clip(centre[:2], -0.42, 0.42)
        centre[2] = min(centre[2], 0.6)
    return _Solid(fields.moved(field, centre, turn), centre, outer, inner)
