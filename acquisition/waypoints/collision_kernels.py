# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
# ruff: noqa: PLR0912
"""Compiled inner loops of the collision check; `collision.py` is their public face.

Numba is used because a plan asks for about 10⁵ configurations and 10⁴ edges: 2–5 µs and 30–100 µs each here, some
twenty times that in numpy batches. Signatures are explicit and the machine code is cached on disk, so nothing compiles
after the first import.

An arm is a set of capsules on its links. An obstacle is one row of numbers: kind, least distance, and its shape. All
shapes are convex, so the distance from a capsule's centre line is the minimum of a convex function of one variable;
golden sections find it, and what is returned is a *lower* bound of it (the function's slope is at most the line's
length), so rounding can only refuse, never pass.

An edge is certified, not sampled (Schwarzer, Saha and Latombe, "Exact collision checking of robot paths", 2002): in an
interval of the path no point of a capsule moves further than Σ |Δq_j| × (its largest distance from joint axis j). Where
the distance at the interval's middle exceeds what half the interval can take away, the interval is free; otherwise it
is halved. An edge still open after 2¹² intervals is refused.
"""

import math

import numpy as np
from numba import boolean, float64, int64, njit, void

from acquisition.waypoints.hull_kernels import hull_distance

HALF_SPACE, CAPSULE, CYLINDER, BOX, CONE, HULL = 0, 1, 2, 3, 4, 5
ROW = 17
"""Numbers of an obstacle: kind, least distance, then by kind: normal, offset · start, end, radius · base point, axis,
radius, height · centre, rotation by rows, half extents · base point, axis, radius, height, radius at the top · centre,
radius of the sphere round it, and which rows of `vertices` (first, count) it is the hull of."""
FREE, VIEW_BLOCKED, LIGHT_BLOCKED = -1, 1, 2
DEPTH = 12
_GOLDEN = 0.6180339887498949
_STEPS = 26  # 0.618^26 = 4e-6 of the line's length

_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]
_index_pairs = int64[:, ::1]
_frames = float64[:, :, ::1]


@njit(void(_vector, _vector, _frames), cache=True)
def link_frames(dh, joints, frames):
    """Writes the link frames (7, 3, 4), base from link 0 … 6."""
    for row in range(3):
        for column in range(4):
            frames[0, row, column] = 1.0 if row == column else 0.0
    for j in range(6):
        cosine, sine = math.cos(joints[j]), math.sin(joints[j])
        a = dh[1] if j == 1 else (dh[2] if j == 2 else 0.0)
        d = dh[0] if j == 0 else (dh[j] if j >= 3 else 0.0)
        twist = 1.0 if j in (0, 3) else (-1.0 if j == 4 else 0.0)
        for row in range(3):
            x, y, z = frames[j, row, 0], frames[j, row, 1], frames[j, row, 2]
            along = cosine * x + sine * y
            across = -sine * x + cosine * y
            frames[j + 1, row, 0] = along
            if twist == 0.0:
                frames[j + 1, row, 1] = across
                frames[j + 1, row, 2] = z
            else:
                frames[j + 1, row, 1] = twist * z
                frames[j + 1, row, 2] = -twist * across
            frames[j + 1, row, 3] = frames[j, row, 3] + a * along + d * z


@njit(void(_vector, _vector, _indices, _matrix, _frames, _matrix), cache=True)
def _place(dh, joints, links, capsules, frames, placed):
    """Writes the capsules' centre lines (C, 6) in the base frame."""
    link_frames(dh, joints, frames)
    for c in range(links.shape[0]):
        link = links[c]
        for row in range(3):
            x, y, z, t = frames[link, row, 0], frames[link, row, 1], frames[link, row, 2], frames[link, row, 3]
            placed[c, row] = x * capsules[c, 0] + y * capsules[c, 1] + z * capsules[c, 2] + t
            placed[c, 3 + row] = x * capsules[c, 3] + y * capsules[c, 4] + z * capsules[c, 5] + t


@njit(float64(_vector, _vector), cache=True)
def _between_lines(first, second):
    """Distance of two line pieces (6,) (Ericson, Real-Time Collision Detection, 5.1.9)."""
    ux, uy, uz = first[3] - first[0], first[4] - first[1], first[5] - first[2]
    vx, vy, vz = second[3] - second[0], second[4] - second[1], second[5] - second[2]
    wx, wy, wz = first[0] - second[0], first[1] - second[1], first[2] - second[2]
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


@njit(float64(_vector, float64, float64, float64), cache=True)
def _point_to_shape(shape, x, y, z):
    """Distance of a point to a cylinder, cone or box; zero inside."""
    x, y, z = x - shape[2], y - shape[3], z - shape[4]
    if int(shape[0]) == CONE:
        along = x * shape[5] + y * shape[6] + z * shape[7]
        across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        height, widening = shape[9], shape[10] - shape[8]
        if 0.0 <= along <= height and across <= shape[8] + widening * along / height:
            return 0.0
        bottom = max(across - shape[8], 0.0) ** 2 + along**2
        top = max(across - shape[10], 0.0) ** 2 + (along - height) ** 2
        share = ((across - shape[8]) * widening + along * height) / (widening**2 + height**2)
        share = min(max(share, 0.0), 1.0)
        side = (across - shape[8] - share * widening) ** 2 + (along - share * height) ** 2
        return math.sqrt(min(bottom, top, side))
    if int(shape[0]) == CYLINDER:
        along = x * shape[5] + y * shape[6] + z * shape[7]
        across = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        over = max(-along, along - shape[9], 0.0)
        out = max(across - shape[8], 0.0)
        return math.sqrt(over * over + out * out)
    total = 0.0
    for axis in range(3):  # the columns of the rotation are the box's axes
        along = x * shape[5 + axis] + y * shape[8 + axis] + z * shape[11 + axis]
        over = max(abs(along) - shape[14 + axis], 0.0)
        total += over * over
    return math.sqrt(total)


@njit(float64(_vector, _matrix, _vector, float64), cache=True)
def _line_to_obstacle(shape, vertices, line, need):
    """Lower bound of the distance of a line piece to an obstacle; sharp (to 1e-5) where it is less than `need`."""
    kind = int(shape[0])
    if kind == HALF_SPACE:
        start = shape[2] * line[0] + shape[3] * line[1] + shape[4] * line[2]
        end = shape[2] * line[3] + shape[3] * line[4] + shape[4] * line[5]
        return min(start, end) - shape[5]
    if kind == CAPSULE:
        return _between_lines(shape[2:8], line) - shape[8]
    if kind == HULL:
        ends = line.reshape(2, 3)
        center = np.empty(6)
        center[:3], center[3:] = shape[2:5], shape[2:5]
        away = _between_lines(center, line) - shape[5]
        if away >= need:
            return away
        first = int(shape[6])
        return hull_distance(vertices[first : first + int(shape[7])], ends)
    dx, dy, dz = line[3] - line[0], line[4] - line[1], line[5] - line[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    # First a bound that costs one evaluation: nothing on the line is nearer than its middle less half its length.
    middle = _point_to_shape(shape, line[0] + 0.5 * dx, line[1] + 0.5 * dy, line[2] + 0.5 * dz)
    if middle - 0.5 * length >= need:
        return middle - 0.5 * length
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    at_s = _point_to_shape(shape, line[0] + s * dx, line[1] + s * dy, line[2] + s * dz)
    at_t = _point_to_shape(shape, line[0] + t * dx, line[1] + t * dy, line[2] + t * dz)
    for _ in range(_STEPS):
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - _GOLDEN * (high - low)
            at_s = _point_to_shape(shape, line[0] + s * dx, line[1] + s * dy, line[2] + s * dz)
        else:
            low, s, at_s = s, t, at_t
            t = low + _GOLDEN * (high - low)
            at_t = _point_to_shape(shape, line[0] + t * dx, line[1] + t * dy, line[2] + t * dz)
    return min(at_s, at_t) - length * (high - low)


@njit(float64(_vector, float64, float64, float64, float64, float64, float64), cache=True)
def _point_to_cone(shape, ax, ay, az, x, y, z):
    """Distance of a point to the hull of an apex a and a cylinder: the union of the cylinder shrunk towards a."""
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    scaled = shape.copy()
    at_s, at_t = -1.0, -1.0
    for _ in range(_STEPS + 1):
        for which in range(2):
            if (which == 0 and at_s >= 0.0) or (which == 1 and at_t >= 0.0):
                continue
            share = s if which == 0 else t
            scaled[2] = ax + share * (shape[2] - ax)
            scaled[3] = ay + share * (shape[3] - ay)
            scaled[4] = az + share * (shape[4] - az)
            scaled[8], scaled[9] = share * shape[8], share * shape[9]
            value = _point_to_shape(scaled, x, y, z)
            if which == 0:
                at_s = value
            else:
                at_t = value
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s, at_s = high - _GOLDEN * (high - low), -1.0
        else:
            low, s, at_s = s, t, at_t
            t, at_t = low + _GOLDEN * (high - low), -1.0
    return max(at_s, at_t)  # one of them is still to be evaluated (−1)


@njit(boolean(_vector, _vector, _vector, float64), cache=True)
def _line_clears_cone(shape, apex, line, need):
    """Whether a line piece keeps `need` from the hull of an apex and a cylinder."""
    axis = np.empty(6)
    for row in range(3):
        axis[row] = apex[row]
        axis[3 + row] = shape[2 + row] + 0.5 * shape[9] * shape[5 + row]
    if _between_lines(axis, line) >= need + math.sqrt(shape[8] ** 2 + 0.25 * shape[9] ** 2):
        return True
    dx, dy, dz = line[3] - line[0], line[4] - line[1], line[5] - line[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    low, high = 0.0, 1.0
    s, t = 1.0 - _GOLDEN, _GOLDEN
    at_s = _point_to_cone(shape, apex[0], apex[1], apex[2], line[0] + s * dx, line[1] + s * dy, line[2] + s * dz)
    at_t = _point_to_cone(shape, apex[0], apex[1], apex[2], line[0] + t * dx, line[1] + t * dy, line[2] + t * dz)
    for _ in range(_STEPS):
        best = min(at_s, at_t)
        if best < need:
            return False
        if best - length * (high - low) >= need:
            return True
        if at_s <= at_t:
            high, t, at_t = t, s, at_s
            s = high - _GOLDEN * (high - low)
            at_s = _point_to_cone(
                shape, apex[0], apex[1], apex[2], line[0] + s * dx, line[1] + s * dy, line[2] + s * dz
            )
        else:
            low, s, at_s = s, t, at_t
            t = low + _GOLDEN * (high - low)
            at_t = _point_to_cone(
                shape, apex[0], apex[1], apex[2], line[0] + t * dx, line[1] + t * dy, line[2] + t * dz
            )
    return False


@njit(_indices(_matrix, _vector, _indices, _matrix, _matrix, _matrix, _index_pairs, float64, float64), cache=True)
def first_violations(joints, dh, links, capsules, obstacles, vertices, pairs, self_margin, slack):
    """For each of N configurations the first obstacle nearer than its least distance + slack; the number of obstacles
    for the arm itself, −1 for none."""
    count = joints.shape[0]
    result = np.full(count, FREE, dtype=np.int64)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place(dh, joints[n], links, capsules, frames, placed)
        for o in range(obstacles.shape[0]):
            for c in range(links.shape[0]):
                need = capsules[c, 6] + obstacles[o, 1] + slack
                if links[c] > 0 and _line_to_obstacle(obstacles[o], vertices, placed[c], need) < need:
                    result[n] = o
                    break
            if result[n] != FREE:
                break
        if result[n] != FREE:
            continue
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            if _between_lines(placed[a], placed[b]) < capsules[a, 6] + capsules[b, 6] + self_margin + slack:
                result[n] = obstacles.shape[0]
                break
    return result


@njit(_matrix(_matrix, _vector, _indices, _matrix, _matrix, _matrix, _index_pairs), cache=True)
def distances(joints, dh, links, capsules, obstacles, vertices, pairs):
    """Least distances (N, O + 1) of the arm's surface to each obstacle and to itself."""
    count = joints.shape[0]
    result = np.full((count, obstacles.shape[0] + 1), np.inf)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place(dh, joints[n], links, capsules, frames, placed)
        for o in range(obstacles.shape[0]):
            for c in range(links.shape[0]):
                if links[c] > 0:
                    distance = _line_to_obstacle(obstacles[o], vertices, placed[c], np.inf) - capsules[c, 6]
                    result[n, o] = min(result[n, o], distance)
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            distance = _between_lines(placed[a], placed[b]) - capsules[a, 6] - capsules[b, 6]
            result[n, -1] = min(result[n, -1], distance)
    return result


@njit(
    boolean(
        _vector, _vector, _vector, _indices, _matrix, _matrix, _matrix, _matrix, _index_pairs, float64, _frames,
        _matrix, _index_pairs, _vector,
    ),
    cache=True,
)  # fmt: skip
def edge_free(
    start, end, dh, links, capsules, levers, obstacles, vertices, pairs, self_margin, frames, placed, still_open, travel
):
    """Whether one straight joint edge is certified; the last four arguments are work space, see `edges_free`."""
    capsule_count, obstacle_count = links.shape[0], obstacles.shape[0]
    spans = capsule_count * obstacle_count
    # An item is a capsule with an obstacle, or a pair of capsules. travel: how far it can close up over all.
    open_count = np.zeros(DEPTH + 2, dtype=np.int64)
    for c in range(capsule_count):
        whole = 0.0
        for j in range(6):
            whole += abs(end[j] - start[j]) * levers[c, j]
        for o in range(obstacle_count):
            travel[c * obstacle_count + o] = whole
            if links[c] > 0:
                still_open[0, open_count[0]] = c * obstacle_count + o
                open_count[0] += 1
    for p in range(pairs.shape[0]):
        whole = 0.0
        for j in range(links[pairs[p, 0]], 6):
            whole += abs(end[j] - start[j]) * levers[pairs[p, 1], j]
        travel[spans + p] = whole
        still_open[0, open_count[0]] = spans + p
        open_count[0] += 1
    joints = np.empty(6)
    depth, index = 0, 0
    while True:
        half = 0.5 / (1 << depth)
        share = (2 * index + 1) * half
        for j in range(6):
            joints[j] = start[j] + share * (end[j] - start[j])
        _place(dh, joints, links, capsules, frames, placed)
        left = 0
        for i in range(open_count[depth]):
            item = still_open[depth, i]
            if item < spans:
                c, o = item // obstacle_count, item % obstacle_count
                least = capsules[c, 6] + obstacles[o, 1]
                distance = _line_to_obstacle(obstacles[o], vertices, placed[c], least + travel[item] * half)
            else:
                a, b = pairs[item - spans, 0], pairs[item - spans, 1]
                least = capsules[a, 6] + capsules[b, 6] + self_margin
                distance = _between_lines(placed[a], placed[b])
            if distance < least:
                return False
            if distance < least + travel[item] * half:
                still_open[depth + 1, left] = item
                left += 1
        if left > 0:
            if depth == DEPTH:
                return False
            open_count[depth + 1] = left
            depth, index = depth + 1, 2 * index
            continue
        while index % 2 == 1:  # this half is done, and so is the one before it
            depth, index = depth - 1, index // 2
        if depth == 0:
            return True
        index += 1


@njit(
    boolean[::1](_matrix, _matrix, _vector, _indices, _matrix, _matrix, _matrix, _matrix, _index_pairs, float64),
    cache=True,
)
def edges_free(starts, ends, dh, links, capsules, levers, obstacles, vertices, pairs, self_margin):
    """Whether each of N straight joint edges keeps all least distances over its whole length; certified."""
    count = starts.shape[0]
    result = np.zeros(count, dtype=np.bool_)
    items = links.shape[0] * obstacles.shape[0] + pairs.shape[0]
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    still_open, travel = np.empty((DEPTH + 2, items), dtype=np.int64), np.empty(items)
    for n in range(count):
        result[n] = edge_free(
            starts[n], ends[n], dh, links, capsules, levers, obstacles, vertices, pairs, self_margin, frames, placed,
            still_open, travel,
        )  # fmt: skip
    return result


@njit(_indices(_matrix, _matrix, _vector, _indices, _matrix, int64, _vector, _vector, float64), cache=True)
def blocked_cones(joints, emitters, dh, links, capsules, tool_from, lens, keep_out, margin):
    """Whether each of N configurations keeps the cone lens–object (1) and the cone emitter–object (2) clear (−1: both).

    Capsules from number `tool_from` on are the tool, which moves with the emitter and is no part of the second check.
    """
    count = joints.shape[0]
    result = np.full(count, FREE, dtype=np.int64)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place(dh, joints[n], links, capsules, frames, placed)
        for c in range(links.shape[0]):
            need = capsules[c, 6] + margin
            if not _line_clears_cone(keep_out, lens, placed[c], need):
                result[n] = VIEW_BLOCKED
                break
            if c < tool_from and not _line_clears_cone(keep_out, emitters[n], placed[c], need):
                result[n] = LIGHT_BLOCKED
                break
    return result
