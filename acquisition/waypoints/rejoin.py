"""Back to a route that the arm has left: the same places in the same order, reached from where the arm stands now.

A session that was cut off so sees each light from the place where it would have seen it anyway, and its images are the
ones that it would have taken. The legs in between were certified when the route was made and are kept.
"""

from collections.abc import Sequence

from acquisition.models.base import as_joints
from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.route import Route, Waypoint
from acquisition.waypoints.route import way


def rejoin(
    route: Route, left: Sequence[int], start_joints: Sequence[float], cell: CellConfig, calibration: Calibration
) -> Route:
    """What is left of a route, from where the arm stands now: the same places in the same order.

    `left` are numbers of lights that the route serves, `start_joints` (6) rad. Raises RigError waypoints.collision when
    no way leads to the first of them.
    """
    legs_left = [
        (number, waypoint)
        for number, waypoint in zip(route.light_numbers, route.waypoints, strict=True)
        if number in left
    ]
    before = start_joints
    waypoints: list[Waypoint] = []
    for place, (_, waypoint) in enumerate(legs_left):
        follows = place > 0 and _follows(route, legs_left[place - 1][0], legs_left[place][0])
        if not follows:
            found = way(before, waypoint.joints, cell, calibration)
            waypoint = waypoint.model_copy(update=dict(found))  # noqa: PLW2901
        waypoints.append(waypoint)
        before = waypoint.joints
    back_seconds = route.seconds - sum(waypoint.seconds for waypoint in route.waypoints)
    return route.model_copy(
        update={
            "start": as_joints(start_joints),
            "waypoints": waypoints,
            "light_numbers": [number for number, _ in legs_left],
            "seconds": sum(waypoint.seconds for waypoint in waypoints) + back_seconds,
            "lower_bound_s": 0.0,
        }
    )


def _follows(route: Route, first: int, second: int) -> bool:
    """Whether the route leads from one light straight on to the other."""
    return route.light_numbers.index(second) == route.light_numbers.index(first) + 1
