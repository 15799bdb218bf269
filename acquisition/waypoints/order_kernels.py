# Types stand in numba's signatures, which also ask for many plain arguments.
# pyright: basic
# ruff: noqa: PLR0912
"""Compiled search for the order of lights and the configuration of each, chosen together.

The problem is a travelling salesman's with a set of cities for each stop (generalised, from start to home). A dozen
stops are solved exactly by dynamic programming over subsets (Held and Karp); more, by an iterated local search in
which a stop is taken out and put back at its best place, all configurations of the others being chosen anew for each
trial (two sweeps of dynamic programming make that exact). Perturbations are counted, not timed, and drawn from a
generator of our own: the same lights always give the same route.
"""

import numpy as np
from numba import float64, int64, njit
from numba.types import Tuple  # pyright: ignore[reportAttributeAccessIssue]

_UNREACHED_S = 1e9
_vector = float64[::1]
_matrix = float64[:, ::1]
_indices = int64[::1]


@njit(_indices(_matrix, _indices, int64, int64), cache=True, fastmath={"nnan", "ninf", "nsz"})
def exact_tour(seconds, first, start, home):
    """The quickest tour's nodes: one of nodes first[i] … first[i + 1] − 1 of each stop, between start and home."""
    stops = first.shape[0] - 1
    nodes = first[stops]
    subsets = 1 << stops
    # The least time through a subset of the stops, ending at a node of it; in single precision, twice as fast.
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
                        for other in range(first[before], first[before + 1]):  # compiled to several at a time
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
    """A lower bound of the shortest path through all stops that ends at the last two (Held and Karp 1970).

    Such a path is a spanning tree with two legs at each stop and one at each end; a price on each stop that the least
    tree visits too often, a bonus on each that it leaves out, make trees of the same worth for paths but dearer others.
    """
    count = times.shape[0]
    price, best = np.zeros(count), 0.0
    step = np.median(times) / 4
    for _ in range(steps):
        degree, distance, parent = np.zeros(count), np.full(count, np.inf), np.zeros(count, dtype=np.int64)
        joined = np.zeros(count, dtype=np.bool_)
        total, node = 0.0, 0
        for _ in range(count - 1):  # the least tree, stop by stop (Prim 1957)
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
    """Fills the least times from start to, and to home from, each configuration of the stops; the tour's time."""
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
    """Time and place of the best insertion of a stop into a swept order."""
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
    """Takes each stop out and puts it back at its best place until nothing improves; changes `order`."""
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
    """A quick tour's nodes, as exact_tour; begins with `order` (empty: anew) and perturbs it `rounds` times."""
    stops = first.shape[0] - 1
    widest = 1
    for i in range(stops):
        widest = max(widest, first[i + 1] - first[i])
    forward, backward = np.empty((stops, widest)), np.empty((stops, widest))
    best_order = np.empty(stops, dtype=np.int64)
    if order.shape[0] == stops:
        best_order[:] = order
    else:
        for count in range(stops):  # cheapest place for one stop after the other
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
