"""Rigid transforms (SE(3)) as twelve numbers, in plain Python.

The 500-Hz tick needs a handful of small products, for which NumPy's call overhead would cost ten times the arithmetic.
A `Frame` is the upper three rows of `a_from_b`, row by row. UR's pose (x, y, z, rx, ry, rz) is converted only here.
"""

import math
from collections.abc import Sequence

Frame = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
Vector = tuple[float, float, float]

IDENTITY: Frame = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
_SMALL = 1e-12


def compose(a: Frame, b: Frame) -> Frame:
    """The product: `a_from_c` of `a_from_b` and `b_from_c`."""
    a0, a1, a2, ax, a4, a5, a6, ay, a8, a9, a10, az = a
    b0, b1, b2, bx, b4, b5, b6, by, b8, b9, b10, bz = b
    return (
        a0 * b0 + a1 * b4 + a2 * b8, a0 * b1 + a1 * b5 + a2 * b9,
        a0 * b2 + a1 * b6 + a2 * b10, a0 * bx + a1 * by + a2 * bz + ax,
        a4 * b0 + a5 * b4 + a6 * b8, a4 * b1 + a5 * b5 + a6 * b9,
        a4 * b2 + a5 * b6 + a6 * b10, a4 * bx + a5 * by + a6 * bz + ay,
        a8 * b0 + a9 * b4 + a10 * b8, a8 * b1 + a9 * b5 + a10 * b9,
        a8 * b2 + a9 * b6 + a10 * b10, a8 * bx + a9 * by + a10 * bz + az,
    )  # fmt: skip


def invert(a: Frame) -> Frame:
    """`b_from_a` of `a_from_b`."""
    r00, r01, r02, x, r10, r11, r12, y, r20, r21, r22, z = a
    return (
        r00, r10, r20, -(r00 * x + r10 * y + r20 * z),
        r01, r11, r21, -(r01 * x + r11 * y + r21 * z),
        r02, r12, r22, -(r02 * x + r12 * y + r22 * z),
    )  # fmt: skip


def from_ur(pose: Sequence[float]) -> Frame:
    """The frame of a UR pose: m, and a rotation vector in rad."""
    x, y, z, rx, ry, rz = pose
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < _SMALL:
        return (1.0, -rz, ry, x, rz, 1.0, -rx, y, -ry, rx, 1.0, z)
    ux, uy, uz = rx / angle, ry / angle, rz / angle
    c, s = math.cos(angle), math.sin(angle)
    t = 1.0 - c
    return (
        c + ux * ux * t, ux * uy * t - uz * s, ux * uz * t + uy * s, x,
        ux * uy * t + uz * s, c + uy * uy * t, uy * uz * t - ux * s, y,
        ux * uz * t - uy * s, uy * uz * t + ux * s, c + uz * uz * t, z,
    )  # fmt: skip


def rotation_vector(a: Frame) -> Vector:
    """The rotation vector in rad, its length in [0, π]."""
    r00, r01, r02, _, r10, r11, r12, _, r20, r21, r22, _ = a
    # Shepperd's quaternion: the largest of the four components is never small, so that angles near π stay exact.
    trace = r00 + r11 + r22
    largest = max(trace, r00, r11, r22)
    if largest == trace:
        w, x, y, z = 1.0 + trace, r21 - r12, r02 - r20, r10 - r01
    elif largest == r00:
        w, x, y, z = r21 - r12, 1.0 + r00 - r11 - r22, r01 + r10, r02 + r20
    elif largest == r11:
        w, x, y, z = r02 - r20, r01 + r10, 1.0 + r11 - r00 - r22, r12 + r21
    else:
        w, x, y, z = r10 - r01, r02 + r20, r12 + r21, 1.0 + r22 - r00 - r11
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    norm = math.sqrt(x * x + y * y + z * z)
    if norm < _SMALL * w:
        return (2.0 * x / w, 2.0 * y / w, 2.0 * z / w)
    factor = 2.0 * math.atan2(norm, w) / norm
    return (x * factor, y * factor, z * factor)


def to_ur(a: Frame) -> list[float]:
    """The UR pose (x, y, z, rx, ry, rz) of a frame."""
    return [a[3], a[7], a[11], *rotation_vector(a)]


def rotate(a: Frame, v: Sequence[float]) -> Vector:
    """The direction `v`, given in frame b, in frame a."""
    x, y, z = v
    return (a[0] * x + a[1] * y + a[2] * z, a[4] * x + a[5] * y + a[6] * z, a[8] * x + a[9] * y + a[10] * z)


def position(a: Frame) -> Vector:
    """The origin of the frame."""
    return (a[3], a[7], a[11])


def with_position(a: Frame, place: Sequence[float]) -> Frame:
    """The frame with its origin at `place`."""
    x, y, z = place
    return (*a[0:3], x, *a[4:7], y, *a[8:11], z)


def rotated(a: Frame, turn: Sequence[float], share: float = 1.0) -> Frame:
    """The frame rotated about its own origin by `share` of a rotation vector given in the frame itself."""
    x, y, z = turn
    return compose(a, from_ur((0.0, 0.0, 0.0, x * share, y * share, z * share)))


def interpolate(a: Frame, b: Frame, share: float) -> Frame:
    """The frame at `share` between a and b: position on the straight line, rotation about one fixed axis."""
    x, y, z = (p + (q - p) * share for p, q in zip(position(a), position(b), strict=True))
    return with_position(rotated(a, rotation_vector(compose(invert(a), b)), share), (x, y, z))


def minus(a: Vector, b: Vector) -> Vector:
    """a − b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Vector, b: Vector) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def distance(a: Frame, b: Frame) -> tuple[float, float]:
    """Distance in m and angle in rad between two frames."""
    rx, ry, rz = rotation_vector(compose(invert(a), b))
    return math.dist(position(a), position(b)), math.sqrt(rx * rx + ry * ry + rz * rz)


def difference(a: Frame, b: Frame) -> tuple[Vector, Vector]:
    """The translation in m and the rotation vector in rad, both in the common frame, that bring frame a to frame b."""
    return minus(position(b), position(a)), rotation_vector(compose(b, invert(a)))


def matrix(a: Frame) -> list[list[float]]:
    """The frame as a 4×4 list of rows."""
    return [list(a[0:4]), list(a[4:8]), list(a[8:12]), [0.0, 0.0, 0.0, 1.0]]
