"""Five objects of 0.11–0.13 m for the path tracer, two of them deep hollows; they stand on z = 0, z to the camera.

They ask different things of a solver: steps and holes (`part`), smooth shapes whose sides the camera does not see
(`animal`, `rabbit`), a hollow that lights itself all over (`bowl`), and walls that face one another (`vee`).
"""

from collections.abc import Sequence

import numpy as np

from acquisition.models.base import FloatArray
from hardware_sim import implicit, sheets
from hardware_sim.sheets import Mesh

NAMES = ("part", "animal", "rabbit", "bowl", "vee")


def make(name: str) -> Mesh:
    """One of the five, m."""
    return {"part": _part, "animal": _animal, "rabbit": _rabbit, "bowl": _bowl, "vee": _vee}[name]()


def _square_with_hole(x: float, y: float, z: float, half: float, radius: float, depth: float) -> Mesh:
    """A flat square whose middle is a blind hole."""
    angle = np.linspace(0, 2 * np.pi, 257)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    square = circle / np.max(np.abs(circle), axis=-1, keepdims=True)
    rim = np.stack([radius * circle, half * square], axis=1) + np.array([x, y])
    top = np.concatenate([rim, np.full((*rim.shape[:2], 1), z)], axis=-1)
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), top.shape)
    wall = sheets.cone((radius, z), (radius, z - depth), (-1.0, 0.0), 256)
    floor = sheets.cone((0.0, z - depth), (radius, z - depth), (0.0, 1.0), 256)
    shift = np.array([x, y, 0.0])
    return sheets.joined(
        [sheets.sheet(top, up), wall.transformed(np.eye(3), shift), floor.transformed(np.eye(3), shift)]
    )


def _part() -> Mesh:
    """A machined plate: two levels, a boss, a ramp, two blind holes."""
    z = 0.014
    left, right, half_y = -0.017, 0.055, 0.040
    holes = [(-0.002, 0.022, 0.012, 0.009), (0.038, -0.020, 0.014, 0.011)]  # x, y, half of its square, radius
    pieces = [_square_with_hole(x, y, z, half, radius, 0.008) for x, y, half, radius in holes]
    # The rest of the lower level: bands left, right, below and above each hole's square, and the strip between them.
    for x, y, half, _ in holes:
        x0, x1 = (left, 0.018) if x < 0.018 else (0.018, right)
        for a, b, c, d in [
            (x0, x - half, -half_y, half_y),
            (x + half, x1, -half_y, half_y),
            (x - half, x + half, -half_y, y - half),
            (x - half, x + half, y + half, half_y),
        ]:
            pieces.append(sheets.quad((a, c, z), (b, c, z), (b, d, z), (a, d, z)))
    for (ax, ay), (bx, by) in [
        ((left, -half_y), (right, -half_y)),
        ((right, -half_y), (right, half_y)),
        ((right, half_y), (left, half_y)),
    ]:
        pieces.append(sheets.quad((ax, ay, 0), (bx, by, 0), (bx, by, z), (ax, ay, z)))
    pieces.append(sheets.box((-0.055, -0.040, 0.0), (left, 0.040, 0.026)))
    pieces.append(sheets.box((-0.050, -0.012, 0.026), (-0.026, 0.012, 0.031)))
    boss = [
        sheets.cone((0.010, z), (0.010, 0.026), (1.0, 0.0), 256),
        sheets.cone((0.0, 0.026), (0.010, 0.026), (0.0, 1.0), 256),
    ]
    pieces += [piece.transformed(np.eye(3), np.array([0.004, -0.020, 0.0])) for piece in boss]
    low, high, y0, y1 = 0.024, 0.052, 0.008, 0.034
    top = 0.025
    pieces.append(sheets.quad((low, y0, z), (high, y0, top), (high, y1, top), (low, y1, z)))
    pieces.append(sheets.quad((high, y0, z), (high, y1, z), (high, y1, top), (high, y0, top)))
    for y, sign in ((y0, -1.0), (y1, 1.0)):
        side = np.array([[[low, y, z], [low, y, z]], [[high, y, z], [high, y, top]]])
        pieces.append(sheets.sheet(side, np.broadcast_to(np.array([0.0, sign, 0.0]), side.shape)))
    return sheets.joined(pieces)


def _capsules(points: FloatArray, bones: Sequence[tuple[Sequence[float], Sequence[float], float, float]]) -> FloatArray:
    """Signed distances (…, B), m, to cones with round ends; bones in mm: start, end, radius at either."""
    out = np.empty((*points.shape[:-1], len(bones)))
    for number, (start, end, first, last) in enumerate(bones):
        a, b = np.array(start) * 1e-3, np.array(end) * 1e-3
        bone = b - a
        along = np.clip((points - a) @ bone / max(float(bone @ bone), 1e-12), 0, 1)
        radius = 1e-3 * (first + (last - first) * along)
        out[..., number] = np.linalg.norm(points - a - along[..., None] * bone, axis=-1) - radius
    return out


def _blended(distances: FloatArray, blend_m: float) -> FloatArray:
    return -blend_m * np.log(np.sum(np.exp(-np.minimum(distances, 0.1) / blend_m), axis=-1))


def _grounded(mesh: Mesh) -> Mesh:
    return mesh.transformed(np.eye(3), np.array([0.0, 0.0, -float(mesh.triangles[..., 2].min())]))


def _animal() -> Mesh:
    """An animal on its side: a body, a head, four legs and a tail, with overhangs under all of them."""
    bones = [
        ((-22, 0, 26), (20, 2, 27), 23, 19),
        ((38, 14, 34), (44, 18, 34), 16, 13),
        ((36, 26, 40), (34, 36, 44), 6, 3),
        ((48, 28, 36), (52, 37, 38), 6, 3),
        ((18, -12, 30), (34, -36, 20), 9, 7),
        ((8, -14, 18), (12, -42, 12), 9, 7),
        ((-24, -12, 32), (-14, -40, 26), 11, 7),
        ((-32, -10, 18), (-36, -40, 12), 10, 7),
        ((-42, 4, 28), (-54, 22, 34), 7, 6),
        ((-54, 22, 34), (-44, 38, 36), 6, 5),
    ]
    low, high = np.array([-0.076, -0.064, -0.014]), np.array([0.076, 0.058, 0.076])
    return _grounded(implicit.mesh(lambda p: _blended(_capsules(p, bones), 0.0045), low, high, 0.0008))


def _rabbit() -> Mesh:
    """A crouching rabbit from above: ears, haunches, a head, and a wavy coat."""
    bones = [
        ((-16, 0, 28), (10, 0, 30), 27, 22),
        ((-20, 22, 18), (-8, 27, 16), 17, 12),
        ((-20, -22, 18), (-8, -27, 16), 17, 12),
        ((32, 0, 40), (42, 0, 37), 16, 12),
        ((24, 8, 52), (-4, 18, 60), 6, 7),
        ((24, -8, 52), (-2, -20, 58), 6, 7),
        ((22, 14, 14), (44, 18, 9), 9, 7),
        ((22, -14, 14), (44, -18, 9), 9, 7),
        ((-46, 0, 26), (-48, 0, 27), 9, 8),
    ]

    def field(points: FloatArray) -> FloatArray:
        x, y, z = np.moveaxis(points, -1, 0) / 0.003
        coat = 0.0006 * (np.sin(x + 0.6 * y) * np.cos(0.8 * y - 0.5 * z) + 0.5 * np.sin(1.3 * z + y))
        return (_blended(_capsules(points, bones), 0.004) + coat) / 1.5

    low, high = np.array([-0.074, -0.062, -0.014]), np.array([0.074, 0.062, 0.088])
    return _grounded(implicit.mesh(field, low, high, 0.0008))


def _bowl() -> Mesh:
    """A spherical cap of 63° at the rim, 26 mm deep, in a thick dish with a flat rim."""
    rim = np.radians(63.0)
    radius = 0.026 / (1 - np.cos(rim))
    angle = np.linspace(0, rim, 160)
    bottom = 0.004
    up = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    inner = sheets.revolved(radius * np.sin(angle), bottom + radius * (1 - np.cos(angle)), up, 512)
    edge, top = float(radius * np.sin(rim)), bottom + 0.026
    flat = sheets.cone((edge, top), (edge + 0.010, top), (0.0, 1.0), 512)
    outside = sheets.cone((edge + 0.010, top), (edge + 0.010, 0.0), (1.0, 0.0), 512)
    return sheets.joined([inner, flat, outside])


def _vee() -> Mesh:
    """Three grooves of 90°, 18 mm deep, side by side."""
    pieces: list[Mesh] = []
    deep, wide, half = 0.018, 0.036, 0.050
    for number in range(3):
        x = (number - 1.5) * wide
        low, high = 0.005, 0.005 + deep
        middle = x + wide / 2
        pieces.append(sheets.quad((x, -half, high), (middle, -half, low), (middle, half, low), (x, half, high)))
        pieces.append(
            sheets.quad((middle, -half, low), (x + wide, -half, high), (x + wide, half, high), (middle, half, low))
        )
    for sign in (-1.0, 1.0):
        x = sign * 1.5 * wide
        side = np.array([[[x, -half, 0.0], [x, half, 0.0]], [[x, -half, 0.023], [x, half, 0.023]]])
        pieces.append(sheets.sheet(side, np.broadcast_to(np.array([sign, 0.0, 0.0]), side.shape)))
        for number in range(3):
            start = (number - 1.5) * wide
            for a, b, za, zb in [
                (start, start + wide / 2, 0.023, 0.005),
                (start + wide / 2, start + wide, 0.005, 0.023),
            ]:
                y = sign * half
                end = np.array([[[a, y, 0.0], [b, y, 0.0]], [[a, y, za], [b, y, zb]]])
                pieces.append(sheets.sheet(end, np.broadcast_to(np.array([0.0, sign, 0.0]), end.shape)))
    return sheets.joined(pieces)
