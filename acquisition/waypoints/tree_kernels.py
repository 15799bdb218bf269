# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
"""Compiled RRT-Connect (Kuffner and LaValle 2000) from configurations without a straight segment to the roadmap.

Two trees of certified segments grow towards each other, one from the configuration, one from all nodes of the roadmap.
The number of samples is fixed, not their time, and they come from a generator with a fixed seed, so the same
configuration always gives the same path.
"""

import numpy as np
from numba import float64, int64, njit

from acquisition.waypoints.collision_kernels import DEPTH, edge_free

_STEP_RAD = 0.6
"""Largest joint difference of one extension step, rad."""
_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]
_index_pairs = int64[:, ::1]


@njit(int64(_matrix, int64, _vector), cache=True)
def _nearest(points, count, sample):
    best, index = np.inf, 0
    for k in range(count):
        square = 0.0
        for j in range(6):
            square += (points[k, j] - sample[j]) ** 2
        if square < best:
            best, index = square, k
    return index


@njit(
    _matrix(
        _vector, _matrix, _vector, _vector, int64, _vector, _indices, _matrix, _matrix, _matrix, _matrix,
        _index_pairs, float64,
    ),
    cache=True,
)  # fmt: skip
def rrt_connect(
    start, goals, low, high, trials, dh, links, capsules, lever_arms, obstacles, vertices, pairs, self_margin
):
    """RRT-Connect (Kuffner and LaValle 2000): corners (K, 6) of certified straight segments from a configuration (6,)
    to one of `goals` (G, 6), within `low` and `high` (6,), rad; none if `trials` samples give no path."""
    items = links.shape[0] * obstacles.shape[0] + pairs.shape[0]
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    open_items, travel = np.empty((DEPTH + 2, items), dtype=np.int64), np.empty((links.shape[0], 6))
    capacity = goals.shape[0] + 8 * trials + 1
    points, parents = np.empty((2, capacity, 6)), np.full((2, capacity), -1, dtype=np.int64)
    count = np.zeros(2, dtype=np.int64)
    points[0, 0] = start
    points[1, : goals.shape[0]] = goals
    count[0], count[1] = 1, goals.shape[0]
    state = np.uint64(88172645463325252)
    sample = np.empty(6)
    for trial in range(trials):
        active, passive = trial % 2, 1 - trial % 2
        for j in range(6):  # xorshift (Marsaglia 2003)
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            sample[j] = low[j] + (high[j] - low[j]) * (float(state >> np.uint64(11)) / 9007199254740992.0)
        near = _nearest(points[active], count[active], sample)
        furthest = np.abs(sample - points[active, near]).max()
        if furthest == 0.0:  # the sample is a node of a branch that was grown with the same random sequence
            continue
        new = points[active, near] + min(1.0, _STEP_RAD / furthest) * (sample - points[active, near])
        if not edge_free(
            points[active, near], new, dh, links, capsules, lever_arms, obstacles, vertices, pairs, self_margin, frames,
            placed, open_items, travel,
        ):  # fmt: skip
            continue
        points[active, count[active]], parents[active, count[active]] = new, near
        count[active] += 1
        other = _nearest(points[passive], count[passive], new)
        for _ in range(6):
            distance = np.abs(new - points[passive, other]).max()
            last = distance <= _STEP_RAD
            step = new if last else points[passive, other] + (_STEP_RAD / distance) * (new - points[passive, other])
            if not edge_free(
                points[passive, other], step, dh, links, capsules, lever_arms, obstacles, vertices, pairs, self_margin,
                frames, placed, open_items, travel,
            ):  # fmt: skip
                break
            if last:
                meeting = np.empty(2, dtype=np.int64)
                meeting[active], meeting[passive] = count[active] - 1, other
                path = np.empty((count[0] + count[1], 6))
                length, node = 0, meeting[0]
                while node >= 0:
                    path[length] = points[0, node]
                    length, node = length + 1, parents[0, node]
                path[:length] = path[:length][::-1].copy()
                node = meeting[1]
                while node >= 0:
                    path[length] = points[1, node]
                    length, node = length + 1, parents[1, node]
                return path[:length].copy()
            points[passive, count[passive]], parents[passive, count[passive]] = step, other
            other = count[passive]
            count[passive] += 1
    return np.empty((0, 6))
