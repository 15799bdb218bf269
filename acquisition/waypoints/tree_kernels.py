# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
"""Compiled search for a way between configurations that no straight segment leads from to the roadmap.

Two trees of certified segments grow towards each other, one from the configuration, one from all nodes of the roadmap
(RRT-Connect: Kuffner and LaValle 2000). The trials are counted, not timed, and drawn from a generator of our own: the
same configuration always gives the same way.
"""

import numpy as np
from numba import float64, int64, njit

from acquisition.waypoints.collision_kernels import DEPTH, edge_free

_STEP_RAD = 0.6
_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]
_index_pairs = int64[:, ::1]


@njit(int64(_matrix, int64, _vector), cache=True)
def _nearest(points, count, wanted):
    best, place = np.inf, 0
    for k in range(count):
        apart = 0.0
        for j in range(6):
            apart += (points[k, j] - wanted[j]) ** 2
        if apart < best:
            best, place = apart, k
    return place


@njit(
    _matrix(
        _vector, _matrix, _vector, _vector, int64, _vector, _indices, _matrix, _matrix, _matrix, _matrix,
        _index_pairs, float64,
    ),
    cache=True,
)  # fmt: skip
def way_to_any(start, goals, low, high, trials, dh, links, capsules, levers, obstacles, vertices, pairs, self_margin):
    """Corners (K, 6) of certified straight segments from a configuration (6,) to one of `goals` (G, 6), within `low`
    and `high` (6,); no corner when `trials` trials do not find any."""
    items = links.shape[0] * obstacles.shape[0] + pairs.shape[0]
    frames, placed = np.empty((7, 3, 4)), np.empty((links.shape[0], 6))
    still_open, travel = np.empty((DEPTH + 2, items), dtype=np.int64), np.empty((links.shape[0], 6))
    room = goals.shape[0] + 8 * trials + 1
    points, before = np.empty((2, room, 6)), np.full((2, room), -1, dtype=np.int64)
    count = np.zeros(2, dtype=np.int64)
    points[0, 0] = start
    points[1, : goals.shape[0]] = goals
    count[0], count[1] = 1, goals.shape[0]
    state = np.uint64(88172645463325252)
    wanted = np.empty(6)
    for trial in range(trials):
        here, there = trial % 2, 1 - trial % 2
        for j in range(6):  # xorshift (Marsaglia 2003)
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            wanted[j] = low[j] + (high[j] - low[j]) * (float(state >> np.uint64(11)) / 9007199254740992.0)
        near = _nearest(points[here], count[here], wanted)
        furthest = np.abs(wanted - points[here, near]).max()
        if furthest == 0.0:  # drawn before, when the branch grew that the point belongs to
            continue
        new = points[here, near] + min(1.0, _STEP_RAD / furthest) * (wanted - points[here, near])
        if not edge_free(
            points[here, near], new, dh, links, capsules, levers, obstacles, vertices, pairs, self_margin, frames,
            placed, still_open, travel,
        ):  # fmt: skip
            continue
        points[here, count[here]], before[here, count[here]] = new, near
        count[here] += 1
        other = _nearest(points[there], count[there], new)
        for _ in range(6):
            away = np.abs(new - points[there, other]).max()
            last = away <= _STEP_RAD
            step = new if last else points[there, other] + (_STEP_RAD / away) * (new - points[there, other])
            if not edge_free(
                points[there, other], step, dh, links, capsules, levers, obstacles, vertices, pairs, self_margin,
                frames, placed, still_open, travel,
            ):  # fmt: skip
                break
            if last:
                meeting = np.empty(2, dtype=np.int64)
                meeting[here], meeting[there] = count[here] - 1, other
                way = np.empty((count[0] + count[1], 6))
                length, node = 0, meeting[0]
                while node >= 0:
                    way[length] = points[0, node]
                    length, node = length + 1, before[0, node]
                way[:length] = way[:length][::-1].copy()
                node = meeting[1]
                while node >= 0:
                    way[length] = points[1, node]
                    length, node = length + 1, before[1, node]
                return way[:length].copy()
            points[there, count[there]], before[there, count[there]] = step, other
            other = count[there]
            count[there] += 1
    return np.empty((0, 6))
