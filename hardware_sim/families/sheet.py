"""Thin sheets with two sides and an edge: crumpled or folded paper, leaves, ribbons, and rolls with loose corners."""

import numpy as np
from scipy.ndimage import gaussian_filter

from acquisition.models.base import FloatArray
from hardware_sim.families.noise import waves
from hardware_sim.families.surfaces import creased, grid, turned_by
from hardware_sim.sheets import Mesh

SIZE = 210
"""Points along either side of the sheet: 0.3–0.6 mm apart."""


def shape(random: np.random.Generator) -> Mesh:
    """A sheet of about unit size, 0.8–2 % thick, lying or leaning."""
    v, u = np.meshgrid(np.linspace(-0.5, 0.5, SIZE), np.linspace(-0.5, 0.5, SIZE))
    kind = random.choice(["crumpled", "folded", "leaf", "ribbon", "curled"])
    make = {"crumpled": _crumpled, "folded": _folded, "leaf": _leaf, "ribbon": _ribbon, "curled": _curled}[str(kind)]
    surface = make(random, u, v)
    mesh = _thick(surface, random.uniform(0.008, 0.02))
    tilt_rad = random.uniform(0, np.radians(30)) if kind != "folded" else random.uniform(0, np.radians(60))
    return mesh.transformed(turned_by(np.array([*random.normal(size=2), 0.0]), tilt_rad), np.zeros(3))


def _crumpled(random: np.random.Generator, u: FloatArray, v: FloatArray) -> FloatArray:
    """Straight creases across the sheet, each between two slopes; a slight bend makes overhangs in places."""
    z = np.zeros_like(u)
    for _ in range(int(random.integers(8, 28))):
        azimuth, offset = random.uniform(0, 2 * np.pi), random.uniform(-0.5, 0.5)
        soft = random.choice([0.002, 0.01, 0.03])
        across = u * np.cos(azimuth) + v * np.sin(azimuth) - offset
        # Some creases die out half-way.
        fade = 1 / (1 + np.exp(-random.uniform(0, 14) * (v * np.cos(azimuth) - u * np.sin(azimuth))))
        z += random.uniform(-1, 1) * fade * np.sqrt(across**2 + soft**2)
    z *= random.uniform(0.12, 0.4) / np.ptp(z)
    wide = random.uniform(0.65, 1.0)
    points = np.stack([u, v * wide, z], axis=-1)
    sway = [waves(random, 0.5, 1.2, 10) for _ in range(3)]
    return points + random.uniform(0.01, 0.05) * np.stack([wave(points) for wave in sway], axis=-1)


def _folded(random: np.random.Generator, u: FloatArray, v: FloatArray) -> FloatArray:
    """Parallel folds, alternating like an accordion or all in one direction."""
    count = int(random.integers(1, 8))
    places = np.sort(random.uniform(-0.4, 0.4, count))
    angles = random.uniform(0.5, 1.4, count) * np.where(np.arange(count) % 2, -1, 1)
    if count < 4 and random.random() < 0.4:
        angles = np.abs(angles)
    skew = random.uniform(-0.3, 0.3)
    tight = random.uniform(0.002, 0.015)
    # The sheet's direction turns by each angle at its fold; its profile is the integral of the direction.
    turn = (angles * (0.5 + 0.5 * np.tanh((u[:, :1] - places) / tight))).sum(axis=1)
    turn -= (turn[0] + turn[-1]) / 2
    step = 1.0 / (SIZE - 1)
    x, z = np.cumsum(np.cos(turn)) * step, np.cumsum(np.sin(turn)) * step
    wide = random.uniform(0.5, 0.9)
    bow = random.uniform(-0.3, 0.3)
    return np.stack([x[:, None] + skew * v * wide, v * wide, z[:, None] + bow * v**2], axis=-1)


def _leaf(random: np.random.Generator, u: FloatArray, v: FloatArray) -> FloatArray:
    """A pointed outline, a midrib with veins, lengthwise and crosswise curl, and sometimes a wavy margin."""
    t = u + 0.5
    outline = random.uniform(0.35, 0.7) * (
        0.03 + np.sin(np.pi * t ** random.uniform(0.6, 1.2)) ** random.uniform(0.7, 1.2)
    )
    if random.random() < 0.5:
        outline = outline * (1 + random.uniform(0.05, 0.15) * np.abs(np.sin(random.integers(4, 12) * np.pi * t)))
    y = v * outline
    spacing = random.uniform(0.06, 0.14)
    vein = np.abs(np.mod((t - np.abs(y) * random.uniform(0.5, 1.2)) / spacing, 1.0) - 0.5)
    relief = random.uniform(0.004, 0.012) * np.exp(-((vein / 0.15) ** 2)) + 0.02 * np.exp(-((y / 0.02) ** 2))
    margin = random.uniform(0.0, 0.1) * (2 * np.abs(v)) ** 3 * np.sin(random.integers(3, 9) * np.pi * t * 2)
    # No veins or waves where the leaf is barely wider than it is thick.
    z = (relief + margin) * np.minimum(outline / 0.15, 1) ** 2
    z += random.uniform(-0.2, 1.2) * np.abs(y) + random.uniform(-1.5, 1.5) * y**2
    curl = random.uniform(-2.5, 2.5)
    if abs(curl) < 0.1:
        return np.stack([u, y, z], axis=-1)
    radius = 1 / curl + z
    return np.stack([radius * np.sin(curl * u), y, 1 / curl - radius * np.cos(curl * u)], axis=-1) * [1, 1, -1]


def _ribbon(random: np.random.Generator, u: FloatArray, v: FloatArray) -> FloatArray:
    """A strip along a winding line, twisted about it by up to two turns."""
    t = (u[:, 0] + 0.5)[:, None]
    line = np.concatenate([1.2 * t, np.zeros_like(t), np.zeros_like(t)], axis=1)
    for harmonic in range(1, 4):
        phase = random.uniform(0, 2 * np.pi, 3)
        line += random.uniform(0.05, 0.22, 3) / harmonic * np.sin(2 * np.pi * harmonic * t + phase)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.15, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent)
    angle = random.uniform(-0.6, 0.6) + random.uniform(-2, 2) * 2 * np.pi * t * random.choice([0.25, 1.0])
    across = np.cos(angle) * side + np.sin(angle) * up
    wide = random.uniform(0.2, 0.5)
    return line[:, None] + wide * v[..., None] * across[:, None]


def _curled(random: np.random.Generator, u: FloatArray, v: FloatArray) -> FloatArray:
    """A sheet rolled up from one or both ends, oblique to its edges, with a curvature that grows towards the ends."""
    first, last = random.uniform(0, 7), random.choice([0.0, random.uniform(0, 7)])
    askew = random.uniform(-0.6, 0.6)
    wide = random.uniform(0.4, 0.9)
    along = u + askew * v * wide
    power = random.uniform(1.0, 3.0)
    line = np.linspace(-0.9, 0.9, 2000)
    bend = last * np.clip(2 * line, 0, None) ** power - first * np.clip(-2 * line, 0, None) ** power
    step = line[1] - line[0]
    turn = np.cumsum(np.abs(bend)) * step
    turn -= np.interp(0.0, line, turn)
    x, z = np.cumsum(np.cos(turn)) * step, np.cumsum(np.sin(turn)) * step
    bow = random.uniform(-0.2, 0.2)
    return np.stack([np.interp(along, line, x), v * wide, np.interp(along, line, z) + bow * v**2], axis=-1)


def _thick(surface: FloatArray, thickness: float) -> Mesh:
    """A closed solid from a surface (R, C, 3): two sides, half a thickness away along the normals, and an edge."""
    normal = np.cross(np.gradient(surface, axis=0), np.gradient(surface, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    # Smoothed, because at a crease tighter than the sheet's thickness the inner side would fold over itself.
    normal = np.stack([gaussian_filter(normal[..., k], 3, mode="nearest") for k in range(3)], axis=-1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    above, below = surface + normal * thickness / 2, surface - normal * thickness / 2
    # Once round: over the upper side and back along the lower one.
    tube = np.concatenate([above, below[:, ::-1]], axis=1)
    vertices, faces = grid(tube, around=True)
    rows, columns = surface.shape[:2]
    ends: list[np.ndarray] = []
    for row in (0, rows - 1):
        number = row * 2 * columns + np.arange(2 * columns)
        upper, lower = number[:columns], number[columns:][::-1]
        a, b, c, d = upper[:-1], upper[1:], lower[1:], lower[:-1]
        if row:
            b, d = d, b
        ends += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return creased(vertices, np.concatenate([faces, *ends]))
