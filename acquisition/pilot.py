"""Where the first lights go, before anything is known of the object.

One light near the view axis and the others on a ring at 52.5°: the top light sees into nearly everything the camera
sees and so makes shadows, albedo and depth safe, the ring gives the normals their directions. A ring alone leaves up to
half of the pixels with fewer than three lights. Both stand where planned lights, and two rings that are completed, go
on from them. The top light is 20° off the axis, between two lights of the ring, and still tells something of the
normals there: path-traced, eight images are better by 2 % in direct light and 5 % with bounces than from 8°. The ring
is hardly inside the outer one of two: through the arm, eight images are better by 3 % than from 50°, and from 55° where
light bounces they are worse by 6 %. The pattern turns as a whole to where the arm serves it best. Of three lights none
can stand on top, or all would lie in one plane: they form a ring at 30°, which loses the fewest pixels to shadows.

Before: nothing. After: `waypoints`, `capture`, `normals`.
"""

import numpy as np

from acquisition import geometry, lamp_pose
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.route import Reach

TOP_SLANT_DEG = 20.0
RING_SLANT_DEG = 52.5
SLANT_OF_THREE_DEG = 30.0
AZIMUTH_STEPS = 24
MAX_MISS_DEG = 60.0
"""A light further than this from its ideal place no longer stands on its side of the object."""


def pattern(recipe: Recipe, reach: Reach) -> list[Light]:
    """The pilot's lights, all distinct: one at 20° and the others at 52.5°, or of three all at 30°.

    Raises RigError plan.infeasible when there are too few reachable positions or all lie on one side of the object.
    """
    candidates = reach.candidates
    units = lamp_pose.directions(candidates, reach.center, recipe.pilot_lights)
    top = recipe.pilot_lights > 3
    around = recipe.pilot_lights - top
    step = 2 * np.pi / around
    slant_deg = RING_SLANT_DEG if top else SLANT_OF_THREE_DEG
    slants = np.radians([*[TOP_SLANT_DEG] * top, *[slant_deg] * around])
    azimuths = np.array([*[step / 2] * top, *np.arange(around) * step])
    free = np.ones(len(units), dtype=np.bool_)
    patterns = [
        lamp_pose.nearest_distinct(geometry.direction(slants, turn + azimuths), units, free)
        for turn in np.arange(AZIMUTH_STEPS) * step / AZIMUTH_STEPS
    ]
    chosen, miss = min(patterns, key=lambda one: float(np.sum(one[1] ** 2)))
    worst_deg = float(np.degrees(np.max(miss)))
    if worst_deg > MAX_MISS_DEG:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"the pilot's lights at {slant_deg:g}° cannot be placed: one would stand {worst_deg:.0f}° from "
            "its place; free more of the dome, GET /v1/rig/reach says what refuses positions",
            worst_miss_deg=worst_deg,
        )
    return [lamp_pose.light_at(candidates[index], reach.center) for index in chosen]
