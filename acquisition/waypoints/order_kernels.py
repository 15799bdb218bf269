# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
# ruff: noqa: PLR0912
"""Compiled solvers of the generalised travelling-salesman path: order of lights and configuration of each, jointly.

Each stop is a set of nodes, of which one is visited; the path leads from start to home. Up to a dozen stops are solved
exactly by dynamic programming over subsets (Held and Karp). More are solved by iterated local search: a stop is removed
and reinserted at its best position (or-opt with one stop). For each trial, forward and backward sweeps of dynamic
programming optimise the configurations of all other stops exactly. The number of perturbations is fixed, not their
time, and they come from a generator with a fixed seed, so the same lights always give the same route.
"""

import numpy as np
from numba import float64, int64, njit
from numba.types import Tuple  # pyright: ignore[reportAttributeAccessIssue]

_UNREACHED_S = 1e9
"""Time, s, of states that are not reached: longer than any tour."""
_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]


@njit(_indices(_matrix, _indices, int64, int64), cache=True, fastmath={"nnan", "ninf", "nsz"})
def exact_tour(seconds, first, start, home):
    """Held–Karp dynamic programming: nodes of the optimal tour from start to home, one of first[i] … first[i + 1] − 1
    of each stop i."""
    stops = first.shape[0] - 1
    nodes = first[stops]
    subsets = 1 << stops
    # Shortest time through a subset of stops that ends at one of its nodes; single precision is twice as fast.
    best, single = np.full((subsets, nodes), _UNREACHED_S, dtype=np.float32), seconds.astype(np.float32)
    for stop in range(stops):
        for node in range(first[stop], first[stop + 1]):
            best[1 << stop, node] = single[start, node]
    for subset in range(1, subsets):
        for stop in range(stops):
            rest = subset ^ (1 << stop)
            if not subset & (1 << stop) or rest == 0:
                continue
            for node in range(first[stop], first[stop + 1]):
                least = np.float32(_UNREACHED_S)
                for before in range(stops):
                    if rest & (1 << before):
                        for other in range(first[before], first[before + 1]):  # vectorised by the compiler
                            least = min(least, best[rest, other] + single[node, other])
                best[subset, node] = least
    tour = np.empty(stops, dtype=np.int64)
    subset, last = subsets - 1, home
    for position in range(stops - 1, -1, -1):
        least, stop = _UNREACHED_S, 0
        for node in range(nodes):
            if best[subset, node] + seconds[last, node] < least:
                least, tour[position] = best[subset, node] + seconds[last, node], node
        last = tour[position]
        while first[stop + 1] <= last:
            stop += 1
        subset ^= 1 << stop
    return tour


@njit(float64(_matrix, int64), cache=True)
def path_bound(times, steps):
    """Held–Karp lower bound (1970) of the shortest Hamiltonian path whose ends are the last two stops.

    Such a path is a spanning tree with degree two at each stop and one at each end. Lagrange multipliers on the degrees
    are raised by subgradient steps where the minimum spanning tree's degree is too large and lowered where it is too
    small. They leave the relative cost of paths unchanged and raise that of other trees.
    """
    count = times.shape[0]
    price, best = np.zeros(count), 0.0
    step = np.median(times) / 4
    for _ in range(steps):
        degree, distance, parent = np.zeros(count), np.full(count, np.inf), np.zeros(count, dtype=np.int64)
        joined = np.zeros(count, dtype=np.bool_)
        total, node = 0.0, 0
        for _ in range(count - 1):  # minimum spanning tree (Prim 1957)
            joined[node] = True
            nearest = -1
            for other in range(count):
                if joined[other]:
                    continue
                value = times[node, other] + price[node] + price[other]
                if value < distance[other]:
                    distance[other], parent[other] = value, node
                if nearest < 0 or distance[other] < distance[nearest]:
                    nearest = other
            total += distance[nearest]
            degree[nearest] += 1
            degree[parent[nearest]] += 1
            node = nearest
        for k in range(count):
            total -= price[k] * (2.0 if k < count - 2 else 1.0)
        best = max(best, total)
        for k in range(count):
            price[k] += step * (degree[k] - (2.0 if k < count - 2 else 1.0))
        step *= 0.96
    return best


@njit(float64(_matrix, _indices, int64, int64, _indices, int64, _matrix, _matrix), cache=True)
def _sweep(seconds, first, start, home, order, count, forward, backward):
    """Forward and backward dynamic programming over configurations for a fixed order; returns the tour's time, s.

    Fills `forward` and `backward` (stops, configurations): the shortest times from start and to home.
    """
    widest = forward.shape[1]
    for k in range(count):
        for c in range(widest):
            forward[k, c], backward[k, c] = np.inf, np.inf
    for k in range(count):
        low, high = first[order[k]], first[order[k] + 1]
        for node in range(low, high):
            if k == 0:
                forward[k, node - low] = seconds[start, node]
                continue
            previous = first[order[k - 1]]
            for other in range(previous, first[order[k - 1] + 1]):
                value = forward[k - 1, other - previous] + seconds[other, node]
                forward[k, node - low] = min(forward[k, node - low], value)
    for k in range(count - 1, -1, -1):
        low, high = first[order[k]], first[order[k] + 1]
        for node in range(low, high):
            if k == count - 1:
                backward[k, node - low] = seconds[node, home]
                continue
            following = first[order[k + 1]]
            for other in range(following, first[order[k + 1] + 1]):
                value = seconds[node, other] + backward[k + 1, other - following]
                backward[k, node - low] = min(backward[k, node - low], value)
    total = seconds[start, home]
    if count > 0:
        total = np.inf
        for c in range(first[order[0] + 1] - first[order[0]]):
            total = min(total, forward[0, c] + backward[0, c])
    return total


@njit(Tuple((float64, int64))(_matrix, _indices, int64, int64, _indices, int64, int64, _matrix, _matrix), cache=True)
def _best_insertion(seconds, first, start, home, order, count, stop, forward, backward):
    """Cheapest insertion of a stop into an order with filled sweeps: the tour's time, s, and the position."""
    best, best_position = np.inf, 0
    low, high = first[stop], first[stop + 1]
    for position in range(count + 1):
        for node in range(low, high):
            arrival = seconds[start, node]
            if position > 0:
                arrival = np.inf
                previous = first[order[position - 1]]
                for other in range(previous, first[order[position - 1] + 1]):
                    arrival = min(arrival, forward[position - 1, other - previous] + seconds[other, node])
            if arrival >= best:
                continue
            departure = seconds[node, home]
            if position < count:
                departure = np.inf
                following = first[order[position]]
                for other in range(following, first[order[position] + 1]):
                    departure = min(departure, seconds[node, other] + backward[position, other - following])
            if arrival + departure < best:
                best, best_position = arrival + departure, position
    return best, best_position


@njit(float64(_matrix, _indices, int64, int64, _indices, _matrix, _matrix), cache=True)
def _reinsert(seconds, first, start, home, order, forward, backward):
    """Or-opt local search with single stops: reinserts each at its best position while it improves; changes `order`."""
    stops = order.shape[0]
    total = _sweep(seconds, first, start, home, order, stops, forward, backward)
    improved = True
    while improved:
        improved = False
        for stop in range(stops):
            rest = np.empty(stops, dtype=np.int64)
            count = 0
            for k in range(stops):
                if order[k] != stop:
                    rest[count] = order[k]
                    count += 1
            _sweep(seconds, first, start, home, rest, count, forward, backward)
            value, position = _best_insertion(seconds, first, start, home, rest, count, stop, forward, backward)
            if value < total - 1e-9:
                total, improved = value, True
                for k in range(position):
                    order[k] = rest[k]
                order[position] = stop
                for k in range(position, count):
                    order[k + 1] = rest[k]
    return total


@njit(_indices(_matrix, _indices, int64, int64, _indices, int64), cache=True)
def searched_tour(seconds, first, start, home, order, rounds):
    """Iterated local search: nodes of a short tour, as `exact_tour`; starts from `order` (empty: cheapest insertion)
    and perturbs it `rounds` times by exchanging two adjacent segments (double bridge)."""
    stops = first.shape[0] - 1
    widest = 1
    for i in range(stops):
        widest = max(widest, first[i + 1] - first[i])
    forward, backward = np.empty((stops, widest)), np.empty((stops, widest))
    best_order = np.empty(stops, dtype=np.int64)
    if order.shape[0] == stops:
        best_order[:] = order
    else:
        for count in range(stops):  # cheapest insertion
            _sweep(seconds, first, start, home, best_order, count, forward, backward)
            _, position = _best_insertion(seconds, first, start, home, best_order, count, count, forward, backward)
            for k in range(count, position, -1):
                best_order[k] = best_order[k - 1]
            best_order[position] = count
    best = _reinsert(seconds, first, start, home, best_order, forward, backward)
    state = np.uint64(88172645463325252)
    for _ in range(rounds if stops > 3 else 0):
        cuts = np.empty(3, dtype=np.int64)
        for i in range(3):  # xorshift (Marsaglia 2003)
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            cuts[i] = 1 + int(state >> np.uint64(33)) % (stops - 1)
        cuts.sort()
        trial = np.concatenate(
            (best_order[: cuts[0]], best_order[cuts[1] : cuts[2]], best_order[cuts[0] : cuts[1]], best_order[cuts[2] :])
        )
        value = _reinsert(seconds, first, start, home, trial, forward, backward)
        if value < best - 1e-9:
            best, best_order = value, trial
    _sweep(seconds, first, start, home, best_order, stops, forward, backward)
    tour = np.empty(stops, dtype=np.int64)
    last = start
    for k in range(stops):
        low = first[best_order[k]]
        least = np.inf
        for node in range(low, first[best_order[k] + 1]):
            value = seconds[last, node] + backward[k, node - low]
            if value < least:
                least, tour[k] = value, node
        last = tour[k]
    return tour
