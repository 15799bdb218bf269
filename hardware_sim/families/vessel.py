"""Vessels into which the camera looks: cups, bowls and jugs with two walls, a rim, handles and a foot."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from acquisition.models.base import FloatArray
from hardware_sim.families import fields
from hardware_sim.families.contour import contour
from hardware_sim.families.fields import smooth_minimum
from hardware_sim.families.surfaces import turned_by
from hardware_sim.implicit import Field
from hardware_sim.sheets import Mesh

SPACING = 1 / 140
"""Lattice of the contouring, in parts of the widest extent without handles: 0.5–0.9 mm."""


def shape(random: np.random.Generator) -> Mesh:
    """A vessel of about unit size, upright or leaning by up to 20°."""
    kind = random.choice(["cup", "bowl", "jug"])
    high, radii = _proportions(random, kind)
    knots = np.linspace(0, high, len(radii))
    table = np.linspace(0, high, 1500)
    outer = np.asarray(PchipInterpolator(knots, radii)(table), dtype=np.float64)
    thick, floor = random.uniform(0.028, 0.06), random.uniform(0.04, 0.1)
    rings, pitch = random.choice([0.0, random.uniform(0.002, 0.006)]), random.uniform(0.03, 0.09)
    flutes = int(random.choice([0, 0, 0, 6, 8, 10, 14]))
    groove = random.uniform(0.02, 0.05) if flutes else 0.0
    steepest = np.hypot(
        np.hypot(1.0, np.abs(np.gradient(outer, table)).max() + 2 * np.pi * rings / pitch), groove * flutes
    )
    rim = random.uniform(0.004, 0.024)
    extras = [_handle(random, table, outer, thick) for _ in range(int(random.choice([0, 1, 1, 2])))]
    spout, lip = random.uniform(0, 2 * np.pi), random.uniform(0.05, 0.12) if kind == "jug" else 0.0
    content = _content(random, radii[0], floor) if random.random() < 0.3 else None

    def field(points: FloatArray) -> FloatArray:
        z = points[..., 2] + high / 2
        radius = np.hypot(points[..., 0], points[..., 1])
        wall = np.interp(z, table, outer)
        if lip > 0:  # drawn out towards one azimuth, more so near the rim
            towards = (points[..., 0] * np.cos(spout) + points[..., 1] * np.sin(spout)) / np.maximum(radius, 1e-6)
            wall = wall + lip * np.clip(towards, 0, 1) ** 8 * np.clip(2 * z / high - 1, 0, 1) ** 2
        side = wall
        if flutes:
            side = side - groove * np.abs(np.sin(flutes / 2 * np.arctan2(points[..., 1], points[..., 0])))
        scale = steepest + 6 * lip
        body = np.maximum((radius - side) / scale, np.abs(points[..., 2]) - high / 2)
        for handle in extras:
            body = smooth_minimum(body, handle(points), 0.03)
        hollow = (radius - wall + groove + thick + rings * np.cos(2 * np.pi * z / pitch)) / scale
        hollow = -smooth_minimum(-hollow, z - floor, 0.08)
        solid = -smooth_minimum(-body, hollow, rim)
        return solid if content is None else np.minimum(solid, content(points + np.array([0.0, 0.0, high / 2])))

    reach = max(float(outer.max()) + (0.34 if extras else 0.0), float(outer.max()) + lip) + 0.04
    mesh = contour(field, np.array([reach, reach, high / 2 + 0.04]), SPACING)
    tilt_rad = random.uniform(0, np.radians(20)) if random.random() < 0.4 else 0.0
    return mesh.transformed(turned_by(np.array([*random.normal(size=2), 0.0]), tilt_rad), np.zeros(3))


def _proportions(random: np.random.Generator, kind: str) -> tuple[float, FloatArray]:
    """Height and outer radii at equal steps from foot to rim."""
    if kind == "bowl":
        high, widest = random.uniform(0.2, 0.42), random.uniform(0.42, 0.5)
        foot = random.uniform(0.16, 0.28)
        middle = foot + (widest - foot) * np.array([0.3, 0.62, 0.86]) * random.uniform(0.9, 1.12, 3)
        return high, np.array([foot, *middle, widest])
    if kind == "cup":
        high, widest = random.uniform(0.35, 0.8), random.uniform(0.3, 0.42)
        return high, widest * np.array([random.uniform(0.6, 1.0), *random.uniform(0.85, 1.05, 2), 1.0])
    high, belly = random.uniform(0.6, 0.95), random.uniform(0.34, 0.44)
    neck = random.uniform(0.5, 0.75)
    return high, belly * np.array([random.uniform(0.55, 0.8), 1.0, random.uniform(0.85, 1.0), neck, neck * 1.25])


def _handle(random: np.random.Generator, table: FloatArray, outer: FloatArray, thick: float) -> Field:
    """A bent tube in an upright plane, with its ends in the wall."""
    high = float(table[-1])
    low_end, high_end = random.uniform(0.12, 0.4) * high, random.uniform(0.65, 0.92) * high
    azimuth, reach = random.uniform(0, 2 * np.pi), random.uniform(0.12, 0.26)
    tube = random.uniform(0.022, 0.05)
    bend = np.linspace(0, np.pi, 9)
    z = low_end + (high_end - low_end) * (1 - np.cos(bend)) / 2
    foot = np.interp([low_end, high_end], table, outer) - thick / 2
    radius = np.linspace(foot[0], foot[1], len(bend)) + reach * np.sin(bend) ** 0.8
    line = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z - high / 2], axis=1)
    bones = [fields.capsule(line[k], line[k + 1], tube) for k in range(len(line) - 1)]
    middle, hold = line.mean(axis=0), float(np.linalg.norm(line - line.mean(axis=0), axis=1).max()) + tube

    def field(points: FloatArray) -> FloatArray:
        bound = np.linalg.norm(points - middle, axis=-1) - hold
        near = bound < 0.05
        local = points[near]
        distance = np.full(len(local), np.inf)
        for bone in bones:
            distance = np.minimum(distance, bone(local))
        bound[near] = distance
        return bound

    return field


def _content(random: np.random.Generator, foot: float, floor: float) -> Field:
    """A ball or a block on the floor inside."""
    size = foot * random.uniform(0.25, 0.5)
    place = np.array([*(random.uniform(-0.4, 0.4, 2) * foot), floor + 0.8 * size])
    solid = fields.sphere(size) if random.random() < 0.5 else fields.box(size * random.uniform(0.5, 0.9, 3))
    return fields.moved(solid, place, turned_by(random.normal(size=3), random.uniform(0, np.pi)))
