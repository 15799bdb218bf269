"""Blobs: a sphere displaced by noise, so that it is wrinkled, wax-like, pitted or smooth."""

import numpy as np

from hardware_sim import sheets
from hardware_sim.families.noise import waves
from hardware_sim.families.surfaces import creased, grid, welded
from hardware_sim.sheets import Mesh


def shape(random: np.random.Generator) -> Mesh:
    """A blob of about unit radius."""
    kind = random.choice(["wrinkled", "wax", "smooth", "pitted"])
    grids = [side if k in (0, 3, 4) else side.transpose(1, 0, 2) for k, side in enumerate(sheets.cube_directions(120))]
    parts = [grid(side) for side in grids]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)])
    unit, faces = welded(vertices, faces)

    coarse, fine = waves(random, 1.0, 3.0), waves(random, 0.15, 0.5, 32)
    radius = 1 + random.uniform(0.05, 0.16) * coarse(unit)
    amplitude = random.uniform(0.4, 1.0)
    if kind == "wrinkled":  # valleys where a warped field crosses zero
        folds = waves(random, 0.35, 0.9)
        radius += 0.10 * amplitude * (np.sqrt(folds(unit + 0.06 * fine(unit)[:, None]) ** 2 + 0.01) - 0.5)
    elif kind == "wax":  # drops that hang over the hollows under them
        drops = waves(random, 0.5, 1.0)
        radius += 0.16 * amplitude * np.tanh(3 * drops(unit))
    elif kind == "pitted":
        pits = waves(random, 0.25, 0.6, 40)
        radius -= 0.12 * amplitude / (1 + np.exp(-8 * (pits(unit) - 1.0)))
    else:
        radius += 0.02 * amplitude * fine(unit)
    points = unit * np.maximum(radius, 0.35)[:, None] * random.uniform(0.65, 1.0, 3)
    # Displacing all space by a slow field gives overhangs, which a radius per direction cannot have.
    bend = [waves(random, 2.5, 6.0, 12) for _ in range(3)]
    points = points + random.uniform(0.05, 0.25) * np.stack([wave(points) for wave in bend], axis=1)
    return creased(points, faces)
