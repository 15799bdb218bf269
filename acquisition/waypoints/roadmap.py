"""Deterministic roadmap (after PRM, Kavraki et al. 1996) of certified paths between home and all parts of the dome.

Its nodes are home and a few well-spread configurations for each of some sixty lights all over the dome. Its edges are
the certified straight joint segments between nearest neighbours; components not connected to home are removed. A
configuration is *connected* if a certified segment joins it to one of these nodes; a path between any two connected
ones then exists. For a light without a connected configuration, RRT-Connect searches a path to the roadmap, which
becomes a branch of it. The roadmap depends only on cell and calibration, and a branch also on its light, so that
`routing` has a path to every light that `reach` reports as reachable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from acquisition import geometry, lamp_pose
from acquisition.models.base import BoolArray, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.route import Refusal
from acquisition.waypoints import board_poses
from acquisition.waypoints.collision import Scene, scene
from acquisition.waypoints.ik_solutions import FINE_ROLLS, IkSolutions, solve_lights
from acquisition.waypoints.kinematics import ELBOW_LIMIT, JOINT_LIMIT
from acquisition.waypoints.motion import legs
from acquisition.waypoints.tree_kernels import rrt_connect

CONFIGURATIONS = 24
"""Well-spread configurations of each light that are checked for connection to home and offered to the route."""
_DOME_LIGHTS = 64
"""Lights on a Fibonacci lattice over the dome whose configurations become nodes."""
_BOARD_PLACES = 600
"""Random places of the board; those that the arm reaches become nodes."""
_REFUSED = {"too-far": "out of reach", "hits-something": "would collide", "blocks-view": "hidden by the arm"}
"""Reasons of `board_poses.solve`, in the words of messages."""
_PER_LIGHT = 4
"""Largest number of nodes for each of these lights."""
_NEIGHBOURS = 10
"""Nearest nodes (by the largest joint difference) to which each node's edges are certified."""
_ATTACHMENTS = 8
"""Nearest nodes that are tried to connect a configuration, besides home."""
_TREES, _TRIALS = 3, 4000
"""For a light not connected to home: configurations from which RRT-Connect starts, and samples of each search."""
_MAX_TREE_FAILURES = 12
"""Lights without a path after which RRT-Connect is not tried again: one side of the cell is then cut off."""
GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)
"""Azimuth step of the Fibonacci lattice, rad."""

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Roadmap:
    """Nodes (H, 6), home first, all connected; times (H, H), s, and predecessors (H, H) of all shortest paths."""

    nodes: FloatArray
    seconds: FloatArray
    predecessors: Indices
    edges: Indices  # (E, 2) the certified segments

    def connected(self, joints: FloatArray, scene: Scene) -> BoolArray:
        """Tells whether each of (N, 6) reaches home or one of the nearest nodes by a certified segment."""
        result = np.zeros(len(joints), dtype=bool)
        for near in self._candidates(joints).T:  # nearest first: it is free most often, and one success suffices
            waiting = np.flatnonzero(~result)
            result[waiting] = scene.edges_free(joints[waiting], self.nodes[near[waiting]])
        return result

    def attachments(self, joints: FloatArray, scene: Scene) -> Indices:
        """Nodes that a certified segment joins to a configuration (6,): of those that `connected` tries or, if none of
        these is free, of all others."""
        near = self._candidates(joints[None])[0]
        for nodes in (near, np.setdiff1d(np.arange(len(self.nodes)), near)):
            attached = nodes[scene.edges_free(np.repeat(joints[None], len(nodes), axis=0), self.nodes[nodes])]
            if len(attached):
                return attached
        return near[:0]

    def _candidates(self, joints: FloatArray) -> Indices:
        """Returns the nodes to try from each of (N, 6): the nearest neighbours, then home; (N, ≤ 9)."""
        turn = np.abs(joints[:, None] - self.nodes[None, 1:]).max(axis=2)
        nearest = 1 + np.argsort(turn, axis=1, kind="stable")[:, :_ATTACHMENTS]
        return np.hstack([nearest, np.zeros((len(joints), 1), dtype=np.int64)])

    def grow_branch(self, joints: FloatArray, scene: Scene, home: FloatArray) -> FloatArray:
        """RRT-Connect from a configuration (6,) to any node: corners (K, 6) of certified segments, none if it fails."""
        lower, upper = np.maximum(home - np.pi, -JOINT_LIMIT), np.minimum(home + np.pi, JOINT_LIMIT)
        lower[2], upper[2] = -ELBOW_LIMIT, ELBOW_LIMIT
        return rrt_connect(
            joints, self.nodes, lower, upper, _TRIALS, scene.model.dh, scene.links, scene.capsules, scene.lever_arms,
            scene.obstacles, scene.vertices, scene.pairs, scene.self_margin,
        )  # fmt: skip

    def with_branches(self, branches: Sequence[FloatArray], cell: CellConfig) -> "Roadmap":
        """Returns the roadmap extended by branches (K, 6), each of which ends at a node."""
        nodes, edges = [self.nodes], [self.edges]
        count = len(self.nodes)
        for branch in branches:
            root = int(np.argmin(np.abs(self.nodes - branch[-1]).max(axis=1)))
            own = [*range(count, count + len(branch) - 1), root]
            nodes.append(branch[:-1])
            edges.append(np.stack([own[:-1], own[1:]], axis=1).astype(np.int64))
            count += len(branch) - 1
        return _shortest_paths(np.concatenate(nodes), np.concatenate(edges), cell)

    def path(self, start: int, end: int) -> list[int]:
        """Returns the shortest path between two nodes, both ends included."""
        nodes = [end]
        while nodes[-1] != start:
            nodes.append(int(self.predecessors[start, nodes[-1]]))
        return nodes[::-1]


def dome_center(cell: CellConfig, calibration: Calibration) -> FloatArray:
    """Returns the dome's centre (3,) in the view frame."""
    base_from_object = cell.object.keep_out.base_from_object.matrix
    view_from_base = geometry.inverse(lamp_pose.base_from_view(calibration))
    return geometry.transform(view_from_base @ base_from_object, cell.dome.center_m)


def dome_lights(cell: CellConfig, calibration: Calibration, count: int) -> list[Light]:
    """Returns lights evenly over the dome's cap (a Fibonacci lattice), facing its centre; view frame."""
    center = dome_center(cell, calibration)
    top, rim = np.cos(np.radians([cell.dome.min_slant_deg, cell.dome.max_slant_deg]))
    number = np.arange(count)
    slants = np.arccos(top - (top - rim) * (number + 0.5) / count)
    return [
        lamp_pose.light_at(center + cell.dome.radius_m * direction, center)
        for direction in geometry.direction(slants, number * GOLDEN_ANGLE)
    ]


def spread(joints: FloatArray, count: int, home: FloatArray) -> FloatArray:
    """Selects at most `count` of (M, 6) by farthest-point selection, starting with the nearest to home."""
    if not len(joints):
        return joints
    chosen = [int(np.argmin(np.abs(joints - home).max(axis=1)))]
    distance = np.abs(joints - joints[chosen[0]]).max(axis=1)
    while len(chosen) < min(count, len(joints)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.abs(joints - joints[chosen[-1]]).max(axis=1))
    return joints[chosen]


@dataclass(frozen=True)
class ConnectedSolutions:
    """Configurations of each light that are connected to home; the roadmap with the branches that they need."""

    solutions: list[IkSolutions]
    roadmap: Roadmap


def connected_solutions(
    lights: Sequence[Light], cell: CellConfig, calibration: Calibration, first: int = CONFIGURATIONS
) -> ConnectedSolutions:
    """Returns for each light (view frame) well-spread configurations connected to home, or the refusal.

    The `first` configurations of each light are checked. The others follow in growing batches, and finer rolls and
    RRT-Connect only for lights not connected so far, so that whether a light is connected does not depend on `first`.
    Raises RigError waypoints.collision if home is not free.
    """
    arm = scene(cell, calibration)
    solutions = solve_lights(lights, cell, calibration, arm)
    coarse = _connected(solutions, cell, arm, roadmap(cell, calibration), first)
    refusals = [station.refusal for station in coarse.solutions]
    unconnected = [n for n, refusal in enumerate(refusals) if refusal is not None and refusal.reason != "too-far"]
    if not unconnected:
        return coarse
    finer = solve_lights([lights[n] for n in unconnected], cell, calibration, arm, FINE_ROLLS)
    fine = _connected(finer, cell, arm, coarse.roadmap, first)
    result = list(coarse.solutions)
    for n, station in zip(unconnected, fine.solutions, strict=True):
        result[n] = station
    return ConnectedSolutions(result, fine.roadmap)


def _connected(
    solutions: Sequence[IkSolutions], cell: CellConfig, arm: Scene, hubs: Roadmap, first: int
) -> ConnectedSolutions:
    result, home = list(solutions), np.array(cell.arm.home)
    free = [station.joints for station in result]
    for n, joints in enumerate(free):
        if len(joints):
            result[n] = IkSolutions(joints[:0], _unconnected(joints))
    low, high = 0, first
    while waiting := [n for n, joints in enumerate(free) if len(joints) > low and not len(result[n].joints)]:
        tried = [spread(free[n], high, home)[low:] for n in waiting]
        connected = hubs.connected(np.concatenate(tried), arm)
        ends = np.cumsum([len(joints) for joints in tried])[:-1]
        for n, joints, own in zip(waiting, tried, np.split(connected, ends), strict=True):
            if own.any():
                result[n] = IkSolutions(joints[own], None)
        low, high = high, 4 * high
    branches: list[FloatArray] = []
    failures = 0
    for n in [n for n, joints in enumerate(free) if len(joints) and not len(result[n].joints)]:
        grown = _branches(spread(free[n], _TREES, home), hubs, arm, home)
        if grown:
            branches += grown
            result[n] = IkSolutions(np.array([branch[0] for branch in grown]), None)
        failures += not grown
        if failures == _MAX_TREE_FAILURES:
            break
    return ConnectedSolutions(result, hubs.with_branches(branches, cell) if branches else hubs)


def _branches(joints: FloatArray, hubs: Roadmap, arm: Scene, home: FloatArray) -> list[FloatArray]:
    branches = (hubs.grow_branch(configuration, arm, home) for configuration in joints)
    return [branch for branch in branches if len(branch)]


def _unconnected(joints: FloatArray) -> Refusal:
    return Refusal(
        reason="not-connected",
        detail=f"{len(joints)} configurations are free, but no certified path connects them to home",
    )


def roadmap(cell: CellConfig, calibration: Calibration) -> Roadmap:
    """Constructs the probabilistic roadmap of a cell; cached for each cell and calibration.

    Raises RigError waypoints.collision if home itself is not free.
    """
    return _roadmap(cell.model_dump_json(), calibration.model_dump_json())


@lru_cache(maxsize=8)
def _roadmap(cell_json: str, calibration_json: str) -> Roadmap:
    cell, calibration = CellConfig.model_validate_json(cell_json), Calibration.model_validate_json(calibration_json)
    arm = scene(cell, calibration)
    home = np.array(cell.arm.home)
    violation = int(arm.violations(home[None])[0])
    if violation >= 0:
        reason, name = arm.describe_violation(violation)
        raise RigError(
            ErrorCode.WAYPOINTS_COLLISION,
            f"the home position violates the clearance to {name}: change `home` in the cell file",
            lights=[],
            reason=reason,
        )
    solutions = _node_solutions(cell, calibration, arm)
    nodes = np.vstack([home, *(spread(station.joints, _PER_LIGHT, home) for station in solutions)])
    distance = np.abs(nodes[:, None] - nodes[None]).max(axis=2)
    distance[:, 0] = distance[0, :] = 0.0
    near = np.argsort(distance, axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 2]
    rows = np.repeat(np.arange(len(nodes)), near.shape[1])
    pairs = np.unique(np.sort(np.stack([rows, near.ravel()], axis=1), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    pairs = pairs[arm.edges_free(nodes[pairs[:, 0]], nodes[pairs[:, 1]])]
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
    _, labels = connected_components(graph, directed=False)
    renumbered = np.cumsum(labels == labels[0]) - 1
    pairs = renumbered[pairs[labels[pairs[:, 0]] == labels[0]]]
    hubs = _shortest_paths(nodes[labels == labels[0]], pairs, cell)
    return _connected(solutions, cell, arm, hubs, first=2).roadmap


def _node_solutions(cell: CellConfig, calibration: Calibration, arm: Scene) -> list[IkSolutions]:
    """Returns configurations over the tool's whole range: lights of the dome, or views of the board."""
    if cell.arm.tool == "board":
        flanges = board_poses.sample(cell, calibration, _BOARD_PLACES, seed=0)
        return board_poses.solve(flanges, cell, calibration, arm).solutions[:_DOME_LIGHTS]
    return solve_lights(dome_lights(cell, calibration, _DOME_LIGHTS), cell, calibration, arm)


def connected_lights(lights: Sequence[Light], cell: CellConfig, calibration: Calibration) -> FloatArray:
    """Returns one configuration (N, 6) connected to home for each light (view frame) that has any.

    The choice among a light's configurations varies with its number, which spreads the rolls about the lamp's axis
    evenly. Raises RigError waypoints.collision as `roadmap`.
    """
    arm, hubs, home = scene(cell, calibration), roadmap(cell, calibration), np.array(cell.arm.home)
    kept: list[FloatArray] = []
    for number, station in enumerate(solve_lights(lights, cell, calibration, arm)):
        joints = spread(station.joints, _PER_LIGHT, home)
        connected = joints[hubs.connected(joints, arm)] if len(joints) else joints
        if len(connected):
            kept.append(connected[number % len(connected)])
    return np.array(kept).reshape(-1, 6)


def connected_views(cell: CellConfig, calibration: Calibration, count: int, seed: int) -> FloatArray:
    """Returns joints (N, 6), at most `count`, that show the board and are connected to home; `cell` has the board on.

    Only the configuration nearest to home represents a board place: other branches add little information about camera
    and joints, and moves between branches take half as long again. Measured with greedy designs of 16–32 of 160 views:
    3 % less loss and 26 % less time. Raises RigError waypoints.unreachable with the reasons if there are none,
    waypoints.collision as `roadmap`.
    """
    arm = scene(cell, calibration)
    hubs = roadmap(cell, calibration)
    found = board_poses.solve(board_poses.sample(cell, calibration, 4 * count, seed), cell, calibration, arm)
    home = np.array(cell.arm.home)
    nearest = [spread(place.joints, 1, home) for place in found.solutions]
    joints = np.concatenate([np.zeros((0, 6)), *nearest])
    kept = joints[hubs.connected(joints, arm)] if len(joints) else joints
    if not len(kept):
        reasons = ", ".join(f"{number} {_REFUSED[reason]}" for reason, number in found.refused.items() if number)
        raise RigError(
            ErrorCode.WAYPOINTS_UNREACHABLE,
            f"No arm pose shows the board to the camera (of {4 * count} sampled places: {reasons}). Mount the board "
            "differently and correct `board.flange_from_board`",
            lights=[],
        )
    return kept[:count]


def _shortest_paths(nodes: FloatArray, edges: Indices, cell: CellConfig) -> Roadmap:
    seconds = legs(nodes[edges[:, 0]], nodes[edges[:, 1]], cell).seconds
    graph = coo_matrix((seconds, (edges[:, 0], edges[:, 1])), shape=(len(nodes), len(nodes))).tocsr()
    times, predecessors = dijkstra(graph, directed=False, return_predecessors=True)
    return Roadmap(nodes, times, predecessors.astype(np.int64), edges)
