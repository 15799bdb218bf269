"""Generalised travelling salesman with lazy collision checking: order, IK branch and roll for the shortest time.

Every leg is a straight joint segment that is certified collision-free, because that is what the controller's `moveJ`
drives. If the straight segment is blocked, the leg is a path over nodes of the roadmap, with a stop at each. Certifying
all pairs of configurations would cost a thousand times what is needed, so edges are evaluated lazily. The shortest tour
is computed as if all legs were free, and the legs it uses are checked. Blocked legs get the time of their detour; the
legs to the alternative configurations are checked, too, because an obstacle that blocks one leg usually blocks similar
ones. This is repeated until all legs of a tour are certified, or for a fixed number of rounds, and the shortest
certified tour is returned. The time of the first tour, with all legs straight, is a lower bound for up to
`_MAX_EXACT_STOPS` lights; for more, the Held–Karp bound is.

Before: `plan` or `pilot` (lights in the view frame), and the arm's present joints. After: `capture` follows the path.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from acquisition.models.base import FloatArray, Joints
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.listing import refused_lights
from acquisition.models.route import JointPath, Route, Waypoint
from acquisition.waypoints import order_kernels
from acquisition.waypoints.collision import Scene, scene
from acquisition.waypoints.ik_solutions import IkSolutions
from acquisition.waypoints.motion import legs
from acquisition.waypoints.roadmap import (
    CONFIGURATIONS,
    ConnectedSolutions,
    Roadmap,
    connected_solutions,
    roadmap,
)  # fmt: skip

_MAX_EXACT_STOPS = 12
"""Largest number of lights for dynamic programming, which finds the optimal tour; above it: iterated local search."""
_MAX_TOURS = 12
"""Maximum rounds of lazy certification; each computes one tour."""
_BLOCKED_FACTOR = 1.2
"""Assumed ratio of detour time to straight time for a blocked leg whose detour has not been computed."""
NODES = 400
"""Approximate number of configurations over all lights: 24 per light for few lights, fewer for many."""
DENSE_NODES = 1600
"""The same if travel is most of the session's time: for 32 lights, 3 s more of processor time shorten it by 15 %."""
_MIN_PER_LIGHT = 6
"""Minimum number of configurations per light."""
_ROUNDS, _WARM_ROUNDS = 40, 2
"""Perturbations of the iterated local search: for the first tour, and for those that start from the previous one."""
_BOUND_STEPS = 100
"""Subgradient steps of the Held–Karp bound."""
_SAMPLES = 5
"""Samples along a leg for the speed limits during the search of the tour; the driven legs get 33."""


def route(
    lights: Sequence[Light], start_joints: Sequence[float], cell: CellConfig, calibration: Calibration,
    nodes: int = NODES,
) -> Route:  # fmt: skip
    """Generalised travelling-salesman tour from `start_joints` (6, rad) through all lights (view frame) and home.

    `nodes` is the approximate number of configurations considered over all lights. Raises RigError
    waypoints.unreachable if lights have no valid configuration, and waypoints.collision if no collision-free path
    exists to them or from the start; `lights` in the context lists {number, reason, detail} of each. Nothing moves.
    """
    first = max(CONFIGURATIONS, nodes // max(len(lights), 1))
    connected = connected_solutions(lights, cell, calibration, first)
    _require_solutions(connected.solutions)
    return _tour(lights, connected, start_joints, cell, calibration, nodes)


def route_of_views(
    lights: Sequence[Light], joints: Sequence[Joints], start_joints: Sequence[float], cell: CellConfig,
    calibration: Calibration,
) -> Route:  # fmt: skip
    """Returns the tour through given configurations, one for each of `lights`, which give the lamp's place there.

    They are those of `roadmap.connected_views`. Raises RigError waypoints.collision for one that is not connected.
    """
    arm, hubs = scene(cell, calibration), roadmap(cell, calibration)
    for number, configuration in enumerate(joints):
        if not hubs.connected(np.array([configuration]), arm)[0]:
            raise RigError(ErrorCode.WAYPOINTS_COLLISION, f"no certified path leads to view {number}", lights=[])
    solutions = [IkSolutions(np.array([configuration]), None) for configuration in joints]
    return _tour(lights, ConnectedSolutions(solutions, hubs), start_joints, cell, calibration)


def _tour(
    lights: Sequence[Light], connected: ConnectedSolutions, start_joints: Sequence[float], cell: CellConfig,
    calibration: Calibration, nodes: int = NODES,
) -> Route:  # fmt: skip
    arm = scene(cell, calibration)
    start, hubs = _start(start_joints, cell, arm, connected.roadmap)
    network = _Network(connected.solutions, start, cell, arm, hubs, nodes)
    tour, lower_bound_s = network.tour()
    waypoints: list[Waypoint] = []
    for before, node in pairwise([network.start, *tour]):
        leg = network.path(before, node)
        light = lights[network.owner[node]]
        waypoints.append(Waypoint(light=light, path=leg.path, speeds=leg.speeds, seconds=leg.seconds))
    home_leg = network.path(tour[-1] if tour else network.start, network.home)
    return Route(
        start=_joints(network.nodes[network.start]),
        waypoints=waypoints,
        light_numbers=[int(network.owner[node]) for node in tour],
        home_path=home_leg.path,
        home_speeds=home_leg.speeds,
        seconds=sum(waypoint.seconds for waypoint in waypoints) + home_leg.seconds,
        lower_bound_s=lower_bound_s,
    )


def retreat(start_joints: Sequence[float], cell: CellConfig, calibration: Calibration) -> JointPath:
    """Certified path home from `start_joints` (6, rad). Raises RigError waypoints.collision if there is none."""
    arm = scene(cell, calibration)
    start, hubs = _start(start_joints, cell, arm, roadmap(cell, calibration))
    network = _Network([], start, cell, arm, hubs)
    return network.path(network.start, network.home)


def path_between(
    start_joints: Sequence[float], end_joints: Sequence[float], cell: CellConfig, calibration: Calibration
) -> JointPath:
    """Returns a certified path from `start_joints` to a configuration (6, rad) where the arm has stood before.

    Raises RigError waypoints.collision if there is none.
    """
    arm = scene(cell, calibration)
    start, hubs = _start(start_joints, cell, arm, roadmap(cell, calibration))
    end, hubs = _start(end_joints, cell, arm, hubs)
    network = _Network([IkSolutions(end[None], None)], start, cell, arm, hubs)
    return network.path(network.start, 0)


def _require_solutions(solutions: Sequence[IkSolutions]) -> None:
    refused = [(number, station.refusal) for number, station in enumerate(solutions) if station.refusal]
    if not refused:
        return
    unreachable = any(refusal.reason != "not-connected" for _, refusal in refused)
    raise RigError(
        ErrorCode.WAYPOINTS_UNREACHABLE if unreachable else ErrorCode.WAYPOINTS_COLLISION,
        refused_lights([f"light {number}: {refusal.reason}: {refusal.detail}" for number, refusal in refused]),
        lights=[refusal.of_light(number) for number, refusal in refused],
    )


def _start(
    start_joints: Sequence[float], cell: CellConfig, arm: Scene, hubs: Roadmap
) -> tuple[FloatArray, Roadmap]:  # fmt: skip
    """Returns the start configuration (6,) as an array, and the roadmap, with the branch that leads there if it needs
    one: at such a light a session may have ended. It must be finite, collision-free and connected to home."""
    joints = np.array(start_joints, dtype=float).reshape(6)
    if not np.isfinite(joints).all():
        raise RigError(ErrorCode.WAYPOINTS_COLLISION, "the arm's joint angles are unknown", lights=[])
    if not len(hubs.attachments(joints, arm)):
        stands_clear = arm.edges_free(joints[None], joints[None])[0]
        branch = hubs.grow_branch(joints, arm, np.array(cell.arm.home)) if stands_clear else joints[:0]
        if len(branch):
            return joints, hubs.with_branches([branch], cell)
        violation = int(arm.violations(joints[None])[0])
        reason, why = "not-connected", "no certified path leads home from the arm's present configuration"
        if violation >= 0:
            reason, name = arm.describe_violation(violation)
            why = f"the arm's clearance to {name} is violated"
        raise RigError(
            ErrorCode.WAYPOINTS_COLLISION, f"{why}; move it clear by hand at the pendant", lights=[], reason=reason
        )
    return joints, hubs


class _Network:
    """Graph of the configurations of all lights, then start, then home; legs are certified on demand and kept."""

    def __init__(
        self, solutions: Sequence[IkSolutions], start: FloatArray, cell: CellConfig, arm: Scene, hubs: Roadmap,
        nodes: int = NODES,
    ) -> None:  # fmt: skip
        each = max(_MIN_PER_LIGHT, nodes // max(len(solutions), 1))
        kept = [station.joints[:each] for station in solutions]
        counts = np.array([len(joints) for joints in kept], dtype=np.int64)
        self.first: npt.NDArray[np.int64] = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.owner: npt.NDArray[np.int64] = np.repeat(np.arange(len(kept)), counts)
        self.start, self.home = int(self.first[-1]), int(self.first[-1]) + 1
        self.nodes: FloatArray = np.concatenate([*kept, start[None], hubs.nodes[:1]])
        self._arm, self._hubs, self._cell = arm, hubs, cell
        self._legs: dict[tuple[int, int], JointPath] = {}
        self._checked: set[tuple[int, int]] = set()

    def tour(self) -> tuple[list[int], float]:
        """Shortest tour by lazy edge evaluation: nodes in the order of travel, and a lower bound of the time, s.

        All legs of the tour are certified. The bound is valid for the configurations considered and for speed limits
        evaluated at `_SAMPLES` samples per leg.
        """
        seconds = self._straight_seconds()
        stops = (seconds, self.first, self.start, self.home)
        if len(self.first) - 1 <= _MAX_EXACT_STOPS:
            tour = order_kernels.exact_tour(*stops)
            lower_bound_s = float(sum(seconds[a, b] for a, b in pairwise([self.start, *tour, self.home])))
        else:
            tour = order_kernels.searched_tour(*stops, np.empty(0, dtype=np.int64), _ROUNDS)
            lower_bound_s = self._lower_bound(seconds)
        best, best_s = tour, np.inf
        for _ in range(_MAX_TOURS):
            tour_legs = list(pairwise([self.start, *tour.tolist(), self.home]))
            unknown = [leg for leg in tour_legs if leg not in self._legs]
            self._certify(unknown, seconds)
            total_s = sum(self._legs[leg].seconds for leg in tour_legs)
            if total_s < best_s:
                best, best_s = tour, total_s
            if not unknown:
                break
            tour = order_kernels.searched_tour(*stops, self.owner[tour], _WARM_ROUNDS)
        # A detour can be faster than the straight leg, because the lamp's path along it may be shorter.
        return best.tolist(), min(lower_bound_s, best_s)

    def path(self, start: int, end: int) -> JointPath:
        """Returns the certified path from one node to another, certified on first use."""
        if (start, end) not in self._legs:
            free = self._arm.edges_free(self.nodes[[start]], self.nodes[[end]])[0]
            self._add_leg(start, end, straight=bool(free))
        return self._legs[start, end]

    def _straight_seconds(self) -> FloatArray:
        rows, columns = np.triu_indices(len(self.nodes), 1)
        owner = np.concatenate([self.owner, [-1, -2]])
        other = owner[rows] != owner[columns]
        rows, columns = rows[other], columns[other]
        seconds = np.zeros((len(self.nodes), len(self.nodes)))
        seconds[rows, columns] = legs(self.nodes[rows], self.nodes[columns], self._cell, _SAMPLES).seconds
        return seconds + seconds.T

    def _lower_bound(self, seconds: FloatArray) -> float:
        """Held–Karp lower bound, s, from the shortest times between any configurations of two stops."""
        edges = np.concatenate([self.first, [self.start + 1]])
        shortest = np.minimum.reduceat(np.minimum.reduceat(seconds, edges, axis=0), edges, axis=1)
        return order_kernels.path_bound(np.ascontiguousarray(shortest), _BOUND_STEPS)

    def _certify(self, unknown: Sequence[tuple[int, int]], seconds: FloatArray) -> None:
        """Certifies legs, plans detours for blocked ones, and updates their times in `seconds`."""
        if not unknown:
            return
        starts, ends = np.array(unknown).T
        free = self._arm.edges_free(self.nodes[starts], self.nodes[ends])
        for (a, b), straight in zip(unknown, free.tolist(), strict=True):
            self._add_leg(a, b, straight=straight)
            if not straight:
                self._penalise_alternatives(a, b, seconds)
            seconds[a, b] = seconds[b, a] = self._legs[a, b].seconds

    def _penalise_alternatives(self, a: int, b: int, seconds: FloatArray) -> None:
        """Checks legs from each end of a blocked leg to the other's alternatives; raises the blocked ones' times."""
        pairs = [(a, other) for other in self._alternatives(b)] + [(other, b) for other in self._alternatives(a)]
        pairs = [pair for pair in pairs if pair not in self._checked and pair not in self._legs]
        if not pairs:
            return
        starts, ends = np.array(pairs).T
        blocked = ~self._arm.edges_free(self.nodes[starts], self.nodes[ends])
        self._checked.update(pairs)
        self._checked.update((end, start) for start, end in pairs)
        starts, ends = starts[blocked], ends[blocked]
        seconds[starts, ends] *= _BLOCKED_FACTOR
        seconds[ends, starts] *= _BLOCKED_FACTOR

    def _alternatives(self, node: int) -> range:
        """Returns all configurations of the node's light; none for start and home."""
        if node >= self.start:
            return range(0)
        return range(int(self.first[self.owner[node]]), int(self.first[self.owner[node] + 1]))

    def _add_leg(self, a: int, b: int, *, straight: bool) -> None:
        corners = self.nodes[[a, b]] if straight else self._detour(a, b)
        self._legs[a, b] = _drive(corners, self._cell)
        self._legs[b, a] = _drive(corners[::-1], self._cell)

    def _detour(self, start: int, end: int) -> FloatArray:
        """Shortest path over the roadmap as corners (K, 6), shortcut where a direct segment is free and faster."""
        leave, arrive = (self._hubs.attachments(self.nodes[node], self._arm) for node in (start, end))
        hubs = self._hubs.nodes
        to_hub = legs(np.repeat(self.nodes[[start]], len(leave), 0), hubs[leave], self._cell).seconds
        from_hub = legs(hubs[arrive], np.repeat(self.nodes[[end]], len(arrive), 0), self._cell).seconds
        total = to_hub[:, None] + self._hubs.seconds[np.ix_(leave, arrive)] + from_hub[None]
        i, j = np.unravel_index(int(np.argmin(total)), total.shape)
        middle = hubs[self._hubs.path(int(leave[i]), int(arrive[j]))]
        corners = np.concatenate([self.nodes[[start]], middle, self.nodes[[end]]])
        return _shortened(corners, self._arm, self._cell)


def _shortened(corners: FloatArray, arm: Scene, cell: CellConfig) -> FloatArray:
    """Path shortcutting: fastest subsequence of corners (K, 6), whose consecutive ones are known to be connected."""
    rows, columns = np.triu_indices(len(corners), 1)
    seconds = legs(corners[rows], corners[columns], cell).seconds
    free = (columns == rows + 1) | arm.edges_free(corners[rows], corners[columns])
    best, predecessors = np.full(len(corners), np.inf), np.zeros(len(corners), dtype=np.int64)
    best[0] = 0.0
    for a, b, time in zip(rows[free], columns[free], seconds[free], strict=True):
        if best[a] + time < best[b]:  # rows come in order, so best[a] is final
            best[b], predecessors[b] = best[a] + time, a
    kept = [len(corners) - 1]
    while kept[-1] != 0:
        kept.append(int(predecessors[kept[-1]]))
    return corners[kept[::-1]]


def _drive(corners: FloatArray, cell: CellConfig) -> JointPath:
    driven = legs(corners[:-1], corners[1:], cell)
    return JointPath(
        path=[_joints(corner) for corner in corners[1:]],
        speeds=driven.speeds.tolist(),
        seconds=float(driven.seconds.sum()),
    )


def _joints(values: FloatArray) -> Joints:
    q1, q2, q3, q4, q5, q6 = (float(value) for value in values)
    return (q1, q2, q3, q4, q5, q6)
