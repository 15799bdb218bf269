# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
"""Compiled distances of line segments to each other, to obstacles, and to the cones of view and light.

An obstacle is one row of numbers: kind, clearance, and its shape. All shapes are convex, so the distance of a point on
a segment is a convex function of one variable, minimised by golden-section search. The result is a *lower* bound (the
function's slope is at most the segment's length), so rounding errors can only refuse, never accept. The search ends as
soon as the bounds decide on which side of the given thresholds the distance lies.

Rows are passed as matrix and number: a view of each row would cost as much as the computation on it.
"""

import math

import numpy as np
from numba import boolean, float64, int64, njit

from acquisition.waypoints.hull_kernels import hull_distance

HALF_SPACE, CAPSULE, CYLINDER, BOX, CONE, HULL = 0, 1, 2, 3, 4, 5
"""Kinds of obstacles, the first number of a row."""
ROW = 17
"""Length of an obstacle's row: kind, clearance in m, then by kind: normal, offset · start, end, radius · base point,
axis, radius, height · centre, rotation by rows, half extents · base point, axis, radius, height, radius at the top ·
centre (twice) and radius of the bounding sphere, and the rows of `vertices` (first, count) whose convex hull it is."""
_GOLDEN = 0.6180339887498949
"""(√5 − 1)/2, the reduction of the interval by one step of the golden-section search."""
_STEPS = 26
"""Maximum number of golden-section steps: 0.618^26 = 4e-6 of the segment's length."""

_matrix = float64[:, ::1]


@njit(float64(_matrix, int64, int64, _matrix, int64), cache=True)
def between_lines(first, i, at, second, j):
    """Distance of two line segments: columns at … at + 5 of row i, and row j (Ericson, Real-Time Collision Detection,
    5.1.9)."""
    px, py, pz = first[i, at], first[i, at + 1], first[i, at + 2]
    qx, qy, qz = second[j, 0], second[j, 1], second[j, 2]
    ux, uy, uz = first[i, at + 3] - px, first[i, at + 4] - py, first[i, at + 5] - pz
    vx, vy, vz = second[j, 3] - qx, second[j, 4] - qy, second[j, 5] - qz
    wx, wy, wz = px - qx, py - qy, pz - qz
    a, e = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    f, c, b = vx * wx + vy * wy + vz * wz, ux * wx + uy * wy + uz * wz, ux * vx + uy * vy + uz * vz
    if a < 1e-14 and e < 1e-14:
        s, t = 0.0, 0.0
    elif a < 1e-14:
        s, t = 0.0, min(max(f / e, 0.0), 1.0)
    elif e < 1e-14:
        s, t = min(max(-c / a, 0.0), 1.0), 0.0
    else:
        determinant = a * e - b * b
        s = min(max((b * f - c * e) / determinant, 0.0), 1.0) if determinant > 1e-14 * a * e else 0.0
        t = (b * s + f) / e
        if t < 0.0:
            s, t = min(max(-c / a, 0.0), 1.0), 0.0
        elif t > 1.0:
            s, t = min(max((b - c) / a, 0.0), 1.0), 1.0
    x, y, z = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return math.sqrt(x * x + y * y + z * z)


@njit(float64(float64, float64, float64, float64), cache=True)
def _point_to_cylinder(along, square, radius, height):
    """Distance of a point to a cylinder, from its axial coordinate and squared distance from the foot's centre."""
    across = math.sqrt(max(square - along * along, 0.0))
    over = max(-along, along - height, 0.0)
    out = max(across - radius, 0.0)
    return math.sqrt(over * over + out * out)


@njit(float64(_matrix, int64, float64, float64, float64), cache=True)
def _point_to_shape(shapes, o, x, y, z):
    """Distance of a point to the cylinder, cone or box in row o; zero inside."""
    x, y, z = x - shapes[o, 2], y - shapes[o, 3], z - shapes[o, 4]
    kind = int(shapes[o, 0])
    if kind == CYLINDER:
        along = x * shapes[o, 5] + y * shapes[o, 6] + z * shapes[o, 7]
        return _point_to_cylinder(along, x * x + y * y + z * z, shapes[o, 8], shapes[o, 9])
    if kind == CONE:
        along = x * shapes[o, 5] + y * shapes[o, 6] + z * shapes[o, 7]
        across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        foot, height, top = shapes[o, 8], shapes[o, 9], shapes[o, 10]
        widening = top - foot
        if 0.0 <= along <= height and across <= foot + widening * along / height:
            return 0.0
        to_foot = max(across - foot, 0.0) ** 2 + along**2
        to_top = max(across - top, 0.0) ** 2 + (along - height) ** 2
        share = ((across - foot) * widening + along * height) / (widening**2 + height**2)
        share = min(max(share, 0.0), 1.0)
        to_side = (across - foot - share * widening) ** 2 + (along - share * height) ** 2
        return math.sqrt(min(to_foot, to_top, to_side))
    total = 0.0
    for axis in range(3):  # the columns of the rotation are the box's axes
        along = x * shapes[o, 5 + axis] + y * shapes[o, 8 + axis] + z * shapes[o, 11 + axis]
        over = max(abs(along) - shapes[o, 14 + axis], 0.0)
        total += over * over
    return math.sqrt(total)


@njit(float64(_matrix, int64, _matrix, _matrix, int64, float64, float64), cache=True)
def line_to_obstacle(shapes, o, vertices, lines, c, least, need):
    """Golden-section search: lower bound of the distance, m, of line segment c to obstacle o.

    It is only as tight as needed to decide which of `least` ≤ `need` the distance exceeds; to 1e-5 m if these are NaN.
    """
    kind = int(shapes[o, 0])
    if kind == HALF_SPACE:
        start = shapes[o, 2] * lines[c, 0] + shapes[o, 3] * lines[c, 1] + shapes[o, 4] * lines[c, 2]
        end = shapes[o, 2] * lines[c, 3] + shapes[o, 3] * lines[c, 4] + shapes[o, 4] * lines[c, 5]
        return min(start, end) - shapes[o, 5]
    if kind == CAPSULE:
        return between_lines(shapes, o, 2, lines, c) - shapes[o, 8]
    if kind == HULL:
        away = between_lines(shapes, o, 2, lines, c) - shapes[o, 8]
        if away >= need:
            return away
        first, count = int(shapes[o, 9]), int(shapes[o, 10])
        return hull_distance(vertices[first : first + count], lines[c, :6].reshape(2, 3), least, need)
    x, y, z = lines[c, 0], lines[c, 1], lines[c, 2]
    dx, dy, dz = lines[c, 3] - x, lines[c, 4] - y, lines[c, 5] - z
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    # First a bound by one evaluation: the distance of the middle minus half the length.
    bound = _point_to_shape(shapes, o, x + 0.5 * dx, y + 0.5 * dy, z + 0.5 * dz) - 0.5 * length
    if bound >= need:
        return bound
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    at_s = _point_to_shape(shapes, o, x + s * dx, y + s * dy, z + s * dz)
    at_t = _point_to_shape(shapes, o, x + t * dx, y + t * dy, z + t * dz)
    for _ in range(_STEPS):
        nearest = min(at_s, at_t)
        bound = nearest - length * (s - low)  # s − low: largest distance to the nearer of s and t
        if bound >= need or nearest < least or (bound >= least and nearest < need):
            break
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - _GOLDEN * (high - low)
            at_s = _point_to_shape(shapes, o, x + s * dx, y + s * dy, z + s * dz)
        else:
            low, s, at_s = s, t, at_t
            t = low + _GOLDEN * (high - low)
            at_t = _point_to_shape(shapes, o, x + t * dx, y + t * dy, z + t * dz)
    return bound


@njit(float64(_matrix, float64, float64, float64, float64, float64, float64, float64), cache=True)
def _point_to_scaled_cylinder(keep_out, share, ax, ay, az, x, y, z):
    x -= ax + share * (keep_out[0, 2] - ax)
    y -= ay + share * (keep_out[0, 3] - ay)
    z -= az + share * (keep_out[0, 4] - az)
    along = x * keep_out[0, 5] + y * keep_out[0, 6] + z * keep_out[0, 7]
    return _point_to_cylinder(along, x * x + y * y + z * z, share * keep_out[0, 8], share * keep_out[0, 9])


@njit(float64(_matrix, float64, float64, float64, float64, float64, float64), cache=True)
def _point_to_cone(keep_out, ax, ay, az, x, y, z):
    """Distance of a point to the convex hull of an apex a and a cylinder (row 0): the union of the cylinder's images
    scaled towards a."""
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    at_s, at_t = (
        _point_to_scaled_cylinder(keep_out, s, ax, ay, az, x, y, z),
        _point_to_scaled_cylinder(keep_out, t, ax, ay, az, x, y, z),
    )
    for _ in range(_STEPS):
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - _GOLDEN * (high - low)
            at_s = _point_to_scaled_cylinder(keep_out, s, ax, ay, az, x, y, z)
        else:
            low, s, at_s = s, t, at_t
            t = low + _GOLDEN * (high - low)
            at_t = _point_to_scaled_cylinder(keep_out, t, ax, ay, az, x, y, z)
    return min(at_s, at_t)


@njit(boolean(_matrix, _matrix, int64, _matrix, int64, float64), cache=True)
def line_clears_cone(keep_out, apexes, n, lines, c, need):
    """Whether line segment c keeps the distance `need`, m, from the convex hull of apex n and a cylinder (row 0)."""
    ax, ay, az = apexes[n, 0], apexes[n, 1], apexes[n, 2]
    radius, height = keep_out[0, 8], keep_out[0, 9]
    axis = np.empty((1, 6))
    for row in range(3):
        axis[0, row] = apexes[n, row]
        axis[0, 3 + row] = keep_out[0, 2 + row] + 0.5 * height * keep_out[0, 5 + row]
    if between_lines(axis, 0, 0, lines, c) >= need + math.sqrt(radius**2 + 0.25 * height**2):
        return True
    x, y, z = lines[c, 0], lines[c, 1], lines[c, 2]
    dx, dy, dz = lines[c, 3] - x, lines[c, 4] - y, lines[c, 5] - z
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    at_s = _point_to_cone(keep_out, ax, ay, az, x + s * dx, y + s * dy, z + s * dz)
    at_t = _point_to_cone(keep_out, ax, ay, az, x + t * dx, y + t * dy, z + t * dz)
    for _ in range(_STEPS):
        nearest = min(at_s, at_t)
        if nearest < need:
            return False
        if nearest - length * (s - low) >= need:
            return True
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - _GOLDEN * (high - low)
            at_s = _point_to_cone(keep_out, ax, ay, az, x + s * dx, y + s * dy, z + s * dz)
        else:
            low, s, at_s = s, t, at_t
            t = low + _GOLDEN * (high - low)
            at_t = _point_to_cone(keep_out, ax, ay, az, x + t * dx, y + t * dy, z + t * dz)
    return False
