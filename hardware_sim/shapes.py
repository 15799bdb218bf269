"""The six built-in shapes of the simulated cell; a random generator varies the small details of each.

Each is 0.10–0.15 m long and stands on z = 0 round the z axis. Each tests photometric stereo in another way: `sphere`
(every slant, an analytic truth), `vase` (a curved outline), `relief` (flat, fine, grazing light), `part` (steps, holes
and edges), `bumps` (smooth valleys), `figure` (arms and legs that shadow and occlude one another).
"""

from itertools import pairwise

import cv2
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, map_coordinates

from acquisition.models.base import FloatArray
from hardware_sim import implicit, sheets
from hardware_sim.sheets import Mesh


def sphere(random: np.random.Generator) -> Mesh:
    """A sphere of about 0.10 m."""
    radius = 0.049 * random.uniform(0.97, 1.03)
    centre = np.array([0.0, 0.0, radius])
    return sheets.joined([sheets.sheet(radius * unit + centre, unit) for unit in sheets.cube_directions(128)])


def vase(random: np.random.Generator) -> Mesh:
    """A vase of 0.136 m that lies on its belly, its axis along x, so that the camera sees its outline."""
    along = np.array([-0.068, -0.045, -0.015, 0.020, 0.042, 0.058, 0.068])
    radii = np.array([0.022, 0.034, 0.042, 0.027, 0.0165, 0.0195, 0.026]) * random.uniform(0.96, 1.04, 7)
    profile = CubicSpline(along, radii)
    height = np.linspace(along[0], along[-1], 400)
    radius = profile(height)
    slope = profile(height, 1)
    body = sheets.revolved(radius, height, np.stack([np.ones_like(slope), -slope], axis=1), 360)
    foot = sheets.cone((0.0, height[0]), (float(radius[0]), height[0]), (0.0, -1.0), 360)
    mouth = sheets.cone((0.0, height[-1]), (float(radius[-1]), height[-1]), (0.0, 1.0), 360)
    lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the axis z becomes x
    return sheets.joined([body, foot, mouth]).transformed(lying, np.array([0.0, 0.0, radius.max()]))


def relief(random: np.random.Generator) -> Mesh:
    """A coin of 0.12 m, 10 mm thick, with a rim, letters, a star and a soft profile, at most 2.5 mm high."""
    radius, fillet, base = 0.060, 0.0012, 0.010
    pixel = 1e-4
    size = 1241  # 0.124 m
    middle = (size - 1) / 2
    heights: FloatArray = np.asarray(gaussian_filter(_stamp(random, size, pixel), 0.00042 / pixel), float)

    ring = np.linspace(0.0, radius - fillet, 210)
    angle = np.linspace(0, 2 * np.pi, 1101)
    angle[-1] = 0.0
    x, y = np.outer(ring, np.cos(angle)), np.outer(ring, np.sin(angle))
    where = np.stack([y / pixel + middle, x / pixel + middle])
    z = _at(heights, where)
    dx, dy = (_at(np.asarray(np.gradient(heights, pixel, axis=axis), float), where) for axis in (1, 0))
    face = sheets.sheet(np.stack([x, y, base + z], axis=-1), np.stack([-dx, -dy, np.ones_like(dx)], axis=-1))

    bend = np.linspace(0, np.pi / 2, 12)
    rim = float(z[-1].mean())  # the stamp is flat at the rim
    edge = sheets.revolved(
        radius - fillet + fillet * np.sin(bend),
        base + rim - fillet + fillet * np.cos(bend),
        np.stack([np.sin(bend), np.cos(bend)], axis=1),
        1100,
    )
    wall = sheets.cone((radius, base + rim - fillet), (radius, 0.0), (1.0, 0.0), 1100)
    floor = sheets.cone((0.0, 0.0), (radius, 0.0), (0.0, -1.0), 1100)
    return sheets.joined([face, edge, wall, floor])


def _at(image: FloatArray, where: FloatArray) -> FloatArray:
    """The image interpolated at rows and columns `where` (2, R, C)."""
    return np.asarray(map_coordinates(image, where, order=1), float)


def _stamp(random: np.random.Generator, size: int, pixel: float) -> FloatArray:
    """The coin's heights in m before they are smoothed, (size, size)."""
    middle = (size - 1) / 2
    y, x = (np.mgrid[0:size, 0:size] - middle) * pixel
    distance = np.hypot(x, y)
    heights = np.where(distance > 0.055, 0.0011, 0.0)
    turn = random.uniform(0, 2 * np.pi)
    for k in range(24):  # beads inside the rim
        bead = turn + 2 * np.pi * k / 24
        heights += 0.0007 * (np.hypot(x - 0.0505 * np.cos(bead), y - 0.0505 * np.sin(bead)) < 0.0018)
    for _ in range(4):  # a soft profile: shallow overlapping domes
        cx, cy = random.uniform(-0.012, 0.012, 2)
        wide, high = random.uniform(0.009, 0.016), random.uniform(0.0009, 0.0014)
        dome = 1 - ((x - cx) ** 2 + (y - cy - 0.006) ** 2) / wide**2
        heights = np.maximum(heights, high * np.sqrt(np.clip(dome, 0, None)))
    points = int(random.integers(5, 9))
    azimuth = np.arctan2(y - 0.006, x) + turn
    star = 0.010 + 0.004 * np.cos(points * azimuth)
    heights += 0.0005 * (np.hypot(x, y - 0.006) < star)
    letters = np.zeros((size, size), dtype=np.uint8)
    for text, row, scale in (("LIGHT", 0.21, 3.6), ("POSE", 0.845, 3.0), (f"{random.integers(1000, 9999)}", 0.73, 2.2)):
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 14)
        place = (int(middle - width / 2), int(row * size + height / 2))
        cv2.putText(letters, text, place, cv2.FONT_HERSHEY_DUPLEX, scale, 255, 14, cv2.LINE_AA)
    return heights + 0.0008 * letters[::-1] / 255.0  # y points up, rows point down


def part(random: np.random.Generator) -> Mesh:
    """A machined part of 0.126 m: two steps, a plate with two blind holes, a ramp and a bored, chamfered boss."""
    x0, x1, x2, x3, x4 = -0.063, -0.042, -0.025, 0.020, 0.063
    y0, y1 = -0.044, 0.044
    floor, plate, step, top = 0.018, 0.024, 0.028, 0.038
    wide, narrow = 0.0145 * random.uniform(0.9, 1.1), 0.0095 * random.uniform(0.9, 1.1)
    solids = [
        sheets.box((x0, y0, 0.0), (x4, y1, floor)),
        # Side by side, not one on the other: `radiosity.exposed` has to tell inside from outside.
        sheets.box((x1, y0, floor), (x2, y1, step)),
        sheets.box((x0, y0, floor), (x1, y1, top)),
    ]
    for low, high, hole in ((y0, 0.0, wide), (0.0, y1, narrow)):
        solids.append(_plate_with_hole((x2, low), (x3, high), hole, floor, plate))
    solids += [  # the plate's outer walls
        sheets.quad((x3, y0, floor), (x3, y1, floor), (x3, y1, plate), (x3, y0, plate)),
        sheets.quad((x2, y0, floor), (x3, y0, floor), (x3, y0, plate), (x2, y0, plate)),
        sheets.quad((x3, y1, floor), (x2, y1, floor), (x2, y1, plate), (x3, y1, plate)),
    ]
    high, side = floor + (x4 - x3) * np.tan(np.radians(random.uniform(14, 20))), 0.002
    solids += [  # the ramp
        sheets.quad((x3, y0, floor), (x4, y0, high), (x4, side, high), (x3, side, floor)),
        sheets.quad((x4, y0, floor), (x4, side, floor), (x4, side, high), (x4, y0, high)),
        sheets.quad((x4, y0, floor), (x4, y0, high), (x3, y0, floor), (x3, y0, floor)),
        sheets.quad((x4, side, high), (x4, side, floor), (x3, side, floor), (x3, side, floor)),
    ]
    outer, bore, crown, chamfer = 0.014, 0.0065 * random.uniform(0.9, 1.1), 0.030, 0.003
    boss = sheets.joined(
        [
            sheets.cone((outer, floor), (outer, crown - chamfer), (1.0, 0.0), 192),
            sheets.cone((outer, crown - chamfer), (outer - chamfer, crown), (1.0, 1.0), 192),
            sheets.cone((outer - chamfer, crown), (bore, crown), (0.0, 1.0), 192),
            sheets.cone((bore, crown), (bore, 0.025), (-1.0, 0.0), 192),
            sheets.cone((bore, 0.025), (0.0, 0.025), (0.0, 1.0), 192),
        ]
    )
    solids.append(boss.transformed(np.eye(3), np.array([0.0415, 0.0245, 0.0])))
    return sheets.joined(solids)


def _plate_with_hole(
    low: tuple[float, float], high: tuple[float, float], hole: float, floor: float, top: float
) -> Mesh:
    """A rectangle's top at height `top` with a round hole down to `floor` in its middle, without outer walls."""
    centre = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2])
    half = np.array([high[0] - low[0], high[1] - low[1]]) / 2
    corner = np.arctan2(half[1], half[0])
    corners = np.array([corner, np.pi - corner, np.pi + corner, 2 * np.pi - corner])
    # Symmetric angles, so that two plates side by side share the points of their common edge.
    angle = np.unique(np.concatenate([np.linspace(0, 2 * np.pi, 193), corners]))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = np.min(half / np.maximum(np.abs(direction), 1e-12), axis=1)
    rings = np.stack([centre + hole * direction, centre + reach[:, None] * direction])
    up = np.broadcast_to([0.0, 0.0, 1.0], (2, len(angle), 3))
    face = sheets.sheet(np.concatenate([rings, np.full((2, len(angle), 1), top)], axis=-1), up)
    wall = sheets.cone((hole, top), (hole, floor), (-1.0, 0.0), 192)
    return sheets.joined([face, wall.transformed(np.eye(3), np.array([*centre, 0.0]))])


def bumps(random: np.random.Generator) -> Mesh:
    """A smooth blob of about 0.13 m with hills and valleys."""
    count = 16
    centres = random.normal(size=(count, 3))
    centres[:10, 2] = np.abs(centres[:10, 2])  # most of them where the camera looks
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    heights = random.uniform(0.06, 0.14, count) * np.where(random.random(count) < 0.3, -1.0, 1.0)
    sharpness = random.uniform(9.0, 22.0, count)
    axes = np.array([0.060, 0.050, 0.040])
    grids: list[tuple[FloatArray, FloatArray]] = []
    for unit in sheets.cube_directions(128):
        bump = heights * np.exp(sharpness * (unit @ centres.T - 1))
        radius = 1 + bump.sum(axis=-1)
        slope = (bump * sharpness) @ centres
        tangent = slope - np.einsum("rci,rci->rc", slope, unit)[..., None] * unit
        # The normal of |x| = radius(x / |x|), then of its stretched image.
        normal = unit - tangent / radius[..., None]
        grids.append((unit * radius[..., None] * axes, normal / axes))
    length = max(float(np.hypot(points[..., 0], points[..., 1]).max()) for points, _ in grids)
    scale = 0.066 / length
    lowest = min(float(points[..., 2].min()) for points, _ in grids)
    shift = np.array([0.0, 0.0, -lowest * scale])
    return sheets.joined([sheets.sheet(points * scale + shift, normals) for points, normals in grids])


def figure(random: np.random.Generator) -> Mesh:
    """A reclining figure of about 0.14 m: deep folds between arms and legs, arms that cross above the body."""
    chains = [  # joints and radii of body, arms and legs, mm
        ([(-26, 0, 27), (16, 0, 25)], 25),
        ([(-53, 4, 30), (-50, 4, 32)], 16),
        ([(-24, 22, 38), (2, 43, 24), (8, 10, 62)], 9),
        ([(-24, -22, 38), (0, -43, 24), (-8, -8, 66)], 9),
        ([(22, 14, 26), (45, 24, 60), (62, 18, 13)], 12.5),
        ([(22, -14, 26), (50, -18, 50), (60, -26, 13)], 12.5),
    ]
    starts: list[FloatArray] = []
    ends: list[FloatArray] = []
    radii: list[float] = []
    for joints, radius in chains:
        points = np.array(joints) * 1e-3 + random.uniform(-1.5e-3, 1.5e-3, (len(joints), 3))
        thickness = radius * 1e-3 * random.uniform(0.96, 1.04)
        for start, end in pairwise(points):
            starts.append(start)
            ends.append(end)
            radii.append(thickness)
    blend = 0.003

    def field(points: FloatArray) -> FloatArray:
        total = np.zeros(points.shape[:-1])
        for start, end, radius in zip(starts, ends, radii, strict=True):
            bone = end - start
            along = np.clip((points - start) @ bone / (bone @ bone), 0, 1)
            distance = np.linalg.norm(points - start - along[..., None] * bone, axis=-1) - radius
            # A bound keeps far segments from vanishing in the exponential; they do not matter there.
            total += np.exp(-np.minimum(distance, 0.09) / blend)
        return -blend * np.log(total)

    mesh = implicit.mesh(field, np.array([-0.080, -0.065, -0.010]), np.array([0.085, 0.065, 0.095]), 0.0009)
    return mesh.transformed(np.eye(3), np.array([0.0, 0.0, -mesh.triangles[..., 2].min()]))
