"""Turned work that lies, stands, or is a face plate, with profiles of beads, coves, fillets, flares and grooves."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim.families.surfaces import creased, grid, turned_by, welded
from hardware_sim.sheets import Mesh

SEGMENTS = 200
"""Number of points round the axis: about 1.5 mm apart on the widest parts."""
STEP = 0.006
"""Greatest distance of points along a profile of unit length."""

Piece = Callable[[FloatArray], FloatArray]
"""Position along a piece, 0–1 → rise of the profile there."""


def shape(random: np.random.Generator) -> Mesh:
    """A spindle of unit length that lies or stands, or a face plate of unit width."""
    kind = random.choice(["lying", "lying", "standing", "plate"])
    profile = _plate(random) if kind == "plate" else _spindle(random, kind == "standing")
    rows = _fine(profile)
    angle = np.linspace(0, 2 * np.pi, SEGMENTS, endpoint=False)
    flutes, twist = int(random.integers(5, 18)), random.uniform(-8, 8)
    # Not on a face plate: flutes would fold its profile over itself where it runs inward at a constant height.
    depth = random.uniform(0.03, 0.12) if kind != "plate" and random.random() < 0.35 else 0.0
    low, high = np.sort(random.uniform(0.1, 0.9, 2))
    # Flutes run along a part of the work and fade at its ends.
    along = np.clip((rows[:, 1] / rows[:, 1].max() - low) / 0.06, 0, 1) * np.clip(
        (high - rows[:, 1] / rows[:, 1].max()) / 0.06, 0, 1
    )
    cut = depth * along[:, None] * np.abs(np.sin(flutes / 2 * (angle + twist * rows[:, 1:])))
    radius = rows[:, :1] * (1 - cut)
    height = np.broadcast_to(rows[:, 1:], radius.shape)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    # Rows go up the axis and columns round it, which is clockwise from outside.
    vertices, faces = welded(*grid(points, around=True))
    mesh = creased(vertices, faces[:, ::-1])
    if kind != "lying":
        return mesh
    return mesh.transformed(turned_by(np.array([0.0, 1.0, 0.0]), np.pi / 2 + random.uniform(-0.2, 0.2)), np.zeros(3))


def _pieces(random: np.random.Generator) -> Piece:
    """One turned element: how far the profile moves out (−1 to 1) over its length."""
    kind = random.choice(["bead", "cove", "flare", "taper", "step", "groove", "beads", "plain"])
    size = random.uniform(0.4, 1.0)
    count = int(random.integers(2, 5))
    pieces: dict[str, Piece] = {
        "bead": lambda t: size * np.sqrt(np.maximum(1 - (2 * t - 1) ** 2, 0)),
        "cove": lambda t: -size * np.sqrt(np.maximum(1 - (2 * t - 1) ** 2, 0)),
        "flare": lambda t: size * (3 * t**2 - 2 * t**3),
        "taper": lambda t: -size * t,
        "step": lambda t: np.where(t > 0.5, size, 0.0),
        "groove": lambda t: -size * np.maximum(1 - np.abs(2 * t - 1) * 1.5, 0),
        "beads": lambda t: 0.5 * size * np.abs(np.sin(np.pi * count * t)),
        "plain": lambda t: 0 * t,
    }
    return pieces[str(kind)]


def _run(random: np.random.Generator, count: int, unit: float) -> FloatArray:
    """Elements in sequence (N, 2): position along the run, 0–1, and offset in `unit`; steps stay vertical."""
    lengths = random.uniform(0.5, 1.6, count)
    ends = np.cumsum(lengths) / lengths.sum()
    points: list[FloatArray] = []
    level, start = 0.0, 0.0
    for end in ends:
        t = np.concatenate([np.linspace(0, 0.4999, 40), np.linspace(0.5001, 1, 40)])
        rise = _pieces(random)(t)
        points.append(np.stack([start + (end - start) * t, level + unit * (end - start) * count * rise], axis=1))
        start = float(end)
        level = 0.6 * float(points[-1][-1, 1]) + unit * random.uniform(-0.4, 0.4)  # a fillet between the elements
    return np.concatenate(points)


def _spindle(random: np.random.Generator, standing: bool) -> FloatArray:
    """Radius and height (N, 2) of a closed profile of unit height, which ends on the axis at both ends."""
    run = _run(random, int(random.integers(4, 9)), random.uniform(0.03, 0.09))
    thick, taper = random.uniform(0.12, 0.3), random.uniform(0.6, 0.9) if standing else random.uniform(-0.4, 0.4)
    radius = np.maximum(thick * (1 - taper * run[:, 0]) * (1.9 if standing else 1.0) + run[:, 1], 0.035)
    if standing:
        # The camera looks along the axis and sees what is below only if what is above is narrower.
        run[:, 0] *= random.uniform(0.4, 0.8)
    height = run[:, 0]
    inside = np.stack([radius, height], axis=1)
    # No hollow end: its profile would pass the heights of the flutes again.
    dome = random.uniform(0.0, 0.8) * radius[-1] if random.random() < 0.6 else 0.0
    bend = np.linspace(0, np.pi / 2, 30)
    cap = np.stack([radius[-1] * np.cos(bend), height[-1] + dome * np.sin(bend)], axis=1)
    return np.concatenate([[[0.0, 0.0]], inside, cap[1:-1], [[0.0, cap[-1, 1]]]])


def _plate(random: np.random.Generator) -> FloatArray:
    """Radius and height (N, 2) of a disc of unit width whose face is turned."""
    run = _run(random, int(random.integers(4, 10)), random.uniform(0.015, 0.06))
    dish = random.uniform(-0.15, 0.15)
    height = run[:, 1] + dish * (2 * run[:, 0] ** 2 - 1)
    height += random.uniform(0.04, 0.1) - height.min()
    face = np.stack([0.5 * (1 - run[:, 0]), height], axis=1)
    face[-1, 0] = 0.0
    return np.concatenate([[[0.0, 0.0], [0.5, 0.0]], face])


def _fine(profile: FloatArray) -> FloatArray:
    """The polygon (N, 2) with points at most `STEP` apart."""
    rows = [profile[:1]]
    for start, end in pairwise(profile):
        count = int(np.ceil(np.linalg.norm(end - start) / STEP))
        if count > 0:
            rows.append(start + (end - start) * (np.arange(1, count + 1) / count)[:, None])
    fine = np.concatenate(rows)
    # Points much closer than the step would make slivers.
    keep = [0]
    for number in range(1, len(fine)):
        if np.linalg.norm(fine[number] - fine[keep[-1]]) > STEP / 5:
            keep.append(number)
    keep[-1] = len(fine) - 1
    return fine[keep]
