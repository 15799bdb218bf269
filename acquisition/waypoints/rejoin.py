"""Rejoins an interrupted route: the remaining waypoints in the same order, from the arm's present configuration.

An interrupted session thus captures each light from the configuration that was planned for it, and its images are those
of an uninterrupted one. The legs between the waypoints were certified when the route was made and are kept. So is the
way home if the route still ends at the same light.
"""

from collections.abc import Sequence

from acquisition.models.base import as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.route import JointPath, Route, Waypoint
from acquisition.waypoints.routing import path_between, retreat


def rejoin(
    route: Route, remaining: Sequence[int], start_joints: Sequence[float], cell: CellConfig, calibration: Calibration
) -> Route:
    """Returns the remaining part of a route from the present configuration: the same waypoints in the same order.

    `remaining` are numbers of lights that the route serves; `start_joints` (6) in rad. Raises RigError
    waypoints.collision if no certified path leads to the first of them, or home from the last.
    """
    remaining_legs = [
        (number, waypoint)
        for number, waypoint in zip(route.light_numbers, route.waypoints, strict=True)
        if number in remaining
    ]
    before = start_joints
    waypoints: list[Waypoint] = []
    for place, (_, waypoint) in enumerate(remaining_legs):
        follows = place > 0 and _follows(route, remaining_legs[place - 1][0], remaining_legs[place][0])
        if not follows:
            path = path_between(before, waypoint.joints, cell, calibration)
            waypoint = waypoint.model_copy(update=dict(path))  # noqa: PLW2901
        waypoints.append(waypoint)
        before = waypoint.joints
    home = JointPath(
        path=route.home_path,
        speeds=route.home_speeds,
        seconds=route.seconds - sum(waypoint.seconds for waypoint in route.waypoints),
    )
    if not remaining_legs or remaining_legs[-1][0] != route.light_numbers[-1]:
        home = retreat(before, cell, calibration)
    return route.model_copy(
        update={
            "start": as_joints(start_joints),
            "waypoints": waypoints,
            "light_numbers": [number for number, _ in remaining_legs],
            "home_path": home.path,
            "home_speeds": home.speeds,
            "seconds": sum(waypoint.seconds for waypoint in waypoints) + home.seconds,
            "lower_bound_s": 0.0,
        }
    )


def _follows(route: Route, first: int, second: int) -> bool:
    """Tells whether the two lights are consecutive in the route."""
    return route.light_numbers.index(second) == route.light_numbers.index(first) + 1
