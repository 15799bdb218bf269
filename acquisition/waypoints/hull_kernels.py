# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
# ruff: noqa: PLR0912
"""Compiled distance of two convex hulls of points (Gilbert, Johnson and Keerthi, "A fast procedure", 1988).

The result is the largest separation along the search directions: a *lower* bound of the distance whatever the rounding,
tight to `_SHARP_M` unless the search ends early. So an obstacle given as points is certified like the others.
"""

import math

import numpy as np
from numba import float64, int64, njit

_SHARP_M = 1e-6
"""Tolerance of the distance, m."""
_STEPS = 40
"""Maximum number of GJK iterations."""
_vector = float64[::1]
_matrix = float64[:, ::1]


@njit(int64(_matrix, int64, _vector), cache=True)
def _reduce(simplex, count, nearest):
    """Distance subalgorithm of GJK: reduces a simplex of 1–4 points to the face nearest to the origin.

    Writes the nearest point to `nearest`. All faces are tried: there are at most 15, and the nearest point is the best
    of those that lie inside their face.
    """
    best, best_mask = np.inf, 0
    edge, product, away, share = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    point = np.empty(3)
    for mask in range(1, 1 << count):
        origin, edges = -1, 0
        for k in range(count):
            if mask >> k & 1:
                if origin < 0:
                    origin = k
                else:
                    for axis in range(3):
                        edge[edges, axis] = simplex[k, axis] - simplex[origin, axis]
                    edges += 1
        for i in range(edges):
            away[i] = -(
                edge[i, 0] * simplex[origin, 0] + edge[i, 1] * simplex[origin, 1] + edge[i, 2] * simplex[origin, 2]
            )
            for j in range(edges):
                product[i, j] = edge[i, 0] * edge[j, 0] + edge[i, 1] * edge[j, 1] + edge[i, 2] * edge[j, 2]
        inside, total = True, 0.0
        for i in range(edges):  # elimination without pivots: the products are positive definite unless flat
            for j in range(i):
                factor = product[i, j] / product[j, j]
                for k in range(j, edges):
                    product[i, k] -= factor * product[j, k]
                away[i] -= factor * away[j]
            if product[i, i] < 1e-18:
                inside = False
                break
        if not inside:
            continue
        for i in range(edges - 1, -1, -1):
            share[i] = away[i]
            for j in range(i + 1, edges):
                share[i] -= product[i, j] * share[j]
            share[i] /= product[i, i]
            total += share[i]
            inside = inside and share[i] >= 0.0
        if not inside or total > 1.0:
            continue
        size = 0.0
        for axis in range(3):
            value = simplex[origin, axis]
            for i in range(edges):
                value += share[i] * edge[i, axis]
            point[axis] = value
            size += value * value
        if size < best:
            best, best_mask = size, mask
            nearest[:] = point
    kept = 0
    for k in range(count):
        if best_mask >> k & 1:
            simplex[kept, :] = simplex[k, :]
            kept += 1
    return kept


@njit(int64(_matrix, float64, float64, float64), cache=True)
def _support(points, x, y, z):
    best, index = -np.inf, 0
    for k in range(points.shape[0]):
        value = points[k, 0] * x + points[k, 1] * y + points[k, 2] * z
        if value > best:
            best, index = value, k
    return index


@njit(float64(_matrix, _matrix, float64, float64), cache=True)
def hull_distance(first, second, least, need):
    """GJK: lower bound of the distance, m, of the convex hulls of points (N, 3) and (M, 3); at most 0 if they touch.

    It is only as tight as needed to decide which of `least` ≤ `need` the distance exceeds; to 1e-6 m if these are NaN.
    """
    simplex, nearest = np.empty((4, 3)), np.empty(3)
    for axis in range(3):
        simplex[0, axis] = first[0, axis] - second[0, axis]
    nearest[:] = simplex[0]
    count, bound = 1, 0.0
    for _ in range(_STEPS):
        length = math.sqrt(nearest[0] ** 2 + nearest[1] ** 2 + nearest[2] ** 2)
        if length < 1e-9:
            return 0.0
        x, y, z = nearest[0] / length, nearest[1] / length, nearest[2] / length
        a, b = _support(first, -x, -y, -z), _support(second, x, y, z)
        separation = (
            (first[a, 0] - second[b, 0]) * x + (first[a, 1] - second[b, 1]) * y + (first[a, 2] - second[b, 2]) * z
        )
        bound = max(bound, separation)
        decided = bound >= need or length < least or (bound >= least and length < need)
        if decided or length - bound < _SHARP_M or count == 4:
            return bound
        for axis in range(3):
            simplex[count, axis] = first[a, axis] - second[b, axis]
        count = _reduce(simplex, count + 1, nearest)
    return bound
