# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
# ruff: noqa: PLR0912
"""Compiled inner loops of the collision check; `collision.py` is their public interface.

Numba is used because a plan checks about 10⁵ configurations and 10⁴ edges. They take 2–5 µs and 30–100 µs each here,
and about twenty times as long in numpy batches. Signatures are explicit and the machine code is cached on disk, so that
nothing compiles after the first import.

An arm is a set of capsules on its links; an obstacle is one row of numbers (`shape_kernels`).

An edge is certified, not sampled (after Schwarzer, Saha and Latombe, "Exact collision checking of robot paths", 2002).
An interval is free if the distance at its middle exceeds the displacement bound of half the interval; otherwise it is
bisected. An edge that is still open after 2¹² intervals is refused. The displacement bound of a capsule follows from
its position at the middle. Let the joints turn one after the other, the outermost first. Joint j then moves a point by
at most |Δq_j| × (its distance from the axis at the middle + its displacement by the joints before), and by no more than
|Δq_j| × (its largest distance from that axis in any configuration).
"""

import math

import numpy as np
from numba import boolean, float64, int64, njit, void

from acquisition.waypoints.shape_kernels import between_lines, line_clears_cone, line_to_obstacle

FREE, VIEW_BLOCKED, LIGHT_BLOCKED = -1, 1, 2
"""Results of `blocked_cones`."""
DEPTH = 12
"""Maximum depth of bisection of an edge."""

_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]
_index_pairs = int64[:, ::1]
_frames = float64[:, :, ::1]


@njit(void(_vector, _vector, _frames), cache=True)
def link_frames(dh, joints, frames):
    """Forward kinematics: writes the link frames (7, 3, 4), base from link 0 … 6."""
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
def _place_capsules(dh, joints, links, capsules, frames, placed):
    """Writes the capsules' centre lines (C, 6) in the base frame."""
    link_frames(dh, joints, frames)
    for c in range(links.shape[0]):
        link = links[c]
        for row in range(3):
            x, y, z, t = frames[link, row, 0], frames[link, row, 1], frames[link, row, 2], frames[link, row, 3]
            placed[c, row] = x * capsules[c, 0] + y * capsules[c, 1] + z * capsules[c, 2] + t
            placed[c, 3 + row] = x * capsules[c, 3] + y * capsules[c, 4] + z * capsules[c, 5] + t


@njit(_indices(_matrix, _vector, _indices, _matrix, _matrix, _matrix, _index_pairs, float64, float64), cache=True)
def first_violations(joints, dh, links, capsules, obstacles, vertices, pairs, self_margin, slack):
    """Returns for each of N configurations the first obstacle nearer than its clearance + slack; −1 for none, the
    number of obstacles for a self-collision."""
    count = joints.shape[0]
    result = np.full(count, FREE, dtype=np.int64)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place_capsules(dh, joints[n], links, capsules, frames, placed)
        for o in range(obstacles.shape[0]):
            for c in range(links.shape[0]):
                need = capsules[c, 6] + obstacles[o, 1] + slack
                if links[c] > 0 and line_to_obstacle(obstacles, o, vertices, placed, c, need, need) < need:
                    result[n] = o
                    break
            if result[n] != FREE:
                break
        if result[n] != FREE:
            continue
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            if between_lines(placed, a, 0, placed, b) < capsules[a, 6] + capsules[b, 6] + self_margin + slack:
                result[n] = obstacles.shape[0]
                break
    return result


@njit(_matrix(_matrix, _vector, _indices, _matrix, _matrix, _matrix, _index_pairs), cache=True)
def distances(joints, dh, links, capsules, obstacles, vertices, pairs):
    """Returns the minimum distances (N, O + 1) of the arm's surface to each obstacle and to itself."""
    count = joints.shape[0]
    result = np.full((count, obstacles.shape[0] + 1), np.inf)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place_capsules(dh, joints[n], links, capsules, frames, placed)
        for o in range(obstacles.shape[0]):
            for c in range(links.shape[0]):
                if links[c] > 0:
                    distance = line_to_obstacle(obstacles, o, vertices, placed, c, np.nan, np.nan)
                    result[n, o] = min(result[n, o], distance - capsules[c, 6])
        for p in range(pairs.shape[0]):
            a, b = pairs[p, 0], pairs[p, 1]
            distance = between_lines(placed, a, 0, placed, b) - capsules[a, 6] - capsules[b, 6]
            result[n, -1] = min(result[n, -1], distance)
    return result


@njit(void(_vector, _frames, _matrix, int64, int64, _matrix, _matrix), cache=True)
def _travel(turns, frames, placed, c, link, lever_arms, travel):
    """Displacement bound: writes into travel[c, j] how far capsule c can move while joints j … 5 turn by up to `turns`
    (6,), rad."""
    moved = 0.0
    for j in range(link - 1, -1, -1):  # joint j turns about the z axis of frame j
        ax, ay, az = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        away = 0.0
        for end in range(0, 6, 3):  # the distance from an axis is largest at an end of the line
            x = placed[c, end] - frames[j, 0, 3]
            y = placed[c, end + 1] - frames[j, 1, 3]
            z = placed[c, end + 2] - frames[j, 2, 3]
            along = x * ax + y * ay + z * az
            away = max(away, x * x + y * y + z * z - along * along)
        moved += turns[j] * min(math.sqrt(away) + moved, lever_arms[c, j])
        travel[c, j] = moved


@njit(
    boolean(
        _vector, _vector, _vector, _indices, _matrix, _matrix, _matrix, _matrix, _index_pairs, float64, _frames,
        _matrix, _index_pairs, _matrix,
    ),
    cache=True,
)  # fmt: skip
def edge_free(
    start,
    end,
    dh,
    links,
    capsules,
    lever_arms,
    obstacles,
    vertices,
    pairs,
    self_margin,
    frames,
    placed,
    open_items,
    travel,
):
    """Certifies one straight joint edge by adaptive bisection; the last four arguments are work arrays."""
    capsule_count, obstacle_count = links.shape[0], obstacles.shape[0]
    spans = capsule_count * obstacle_count
    # An item is a capsule with an obstacle, or a pair of capsules.
    open_count = np.zeros(DEPTH + 2, dtype=np.int64)
    for c in range(capsule_count):
        if links[c] > 0:
            for o in range(obstacle_count):
                open_items[0, open_count[0]] = c * obstacle_count + o
                open_count[0] += 1
    for p in range(pairs.shape[0]):
        open_items[0, open_count[0]] = spans + p
        open_count[0] += 1
    joints, turns, has_travel = np.empty(6), np.empty(6), np.empty(capsule_count, dtype=np.bool_)
    depth, index = 0, 0
    while True:
        half = 0.5 / (1 << depth)
        share = (2 * index + 1) * half
        for j in range(6):
            joints[j] = start[j] + share * (end[j] - start[j])
            turns[j] = abs(end[j] - start[j]) * half
        _place_capsules(dh, joints, links, capsules, frames, placed)
        has_travel[:] = False
        remaining = 0
        for i in range(open_count[depth]):
            item = open_items[depth, i]
            if item < spans:
                c, o = item // obstacle_count, item % obstacle_count
                least, from_joint = capsules[c, 6] + obstacles[o, 1], 0
            else:
                other, c = pairs[item - spans, 0], pairs[item - spans, 1]
                least, from_joint = capsules[other, 6] + capsules[c, 6] + self_margin, links[other]
            if not has_travel[c]:
                _travel(turns, frames, placed, c, links[c], lever_arms, travel)
                has_travel[c] = True
            need = least + travel[c, from_joint]
            if item < spans:
                distance = line_to_obstacle(obstacles, o, vertices, placed, c, least, need)
            else:
                distance = between_lines(placed, other, 0, placed, c)
            if distance < least:
                return False
            if distance < need:
                open_items[depth + 1, remaining] = item
                remaining += 1
        if remaining > 0:
            if depth == DEPTH:
                return False
            open_count[depth + 1] = remaining
            depth, index = depth + 1, 2 * index
            continue
        while index % 2 == 1:  # both halves of the parent interval are certified
            depth, index = depth - 1, index // 2
        if depth == 0:
            return True
        index += 1


@njit(
    boolean[::1](_matrix, _matrix, _vector, _indices, _matrix, _matrix, _matrix, _matrix, _index_pairs, float64),
    cache=True,
)
def edges_free(starts, ends, dh, links, capsules, lever_arms, obstacles, vertices, pairs, self_margin):
    """Continuous collision check of N straight joint edges: whether each keeps all clearances over its full length."""
    count = starts.shape[0]
    result = np.zeros(count, dtype=np.bool_)
    items = links.shape[0] * obstacles.shape[0] + pairs.shape[0]
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    open_items, travel = np.empty((DEPTH + 2, items), dtype=np.int64), np.empty((links.shape[0], 6))
    for n in range(count):
        result[n] = edge_free(
            starts[n], ends[n], dh, links, capsules, lever_arms, obstacles, vertices, pairs, self_margin, frames,
            placed, open_items, travel,
        )  # fmt: skip
    return result


@njit(_indices(_matrix, _matrix, _vector, _indices, _matrix, int64, _matrix, _matrix, float64), cache=True)
def blocked_cones(joints, emitters, dh, links, capsules, first_tool_capsule, lens, keep_out, margin):
    """Occlusion check of N configurations: 1 if the arm intersects the view cone, 2 if the light cone, else −1.

    Capsules from number `first_tool_capsule` on are the tool. It moves with the emitter and is left out of the check of
    the light cone.
    """
    count = joints.shape[0]
    result = np.full(count, FREE, dtype=np.int64)
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    for n in range(count):
        _place_capsules(dh, joints[n], links, capsules, frames, placed)
        for c in range(links.shape[0]):
            need = capsules[c, 6] + margin
            if not line_clears_cone(keep_out, lens, 0, placed, c, need):
                result[n] = VIEW_BLOCKED
                break
            if c < first_tool_capsule and not line_clears_cone(keep_out, emitters, n, placed, c, need):
                result[n] = LIGHT_BLOCKED
                break
    return result
