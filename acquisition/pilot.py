"""Where the first lights go, before anything is known of the object.

One light near the view axis and the others on a ring at 50°: the top light sees into everything the camera sees and so
makes shadows, albedo and depth safe, the ring gives the normals their directions. A ring alone leaves up to half of the
pixels with fewer than three lights. The ring turns as a whole to where the arm serves it best. Of three lights none can
stand on top, or all would lie in one plane: they form a ring at 30°, which loses the fewest pixels to shadows.

Before: nothing. After: `waypoints`, `capture`, `normals`.
"""

import numpy as np

from acquisition import dome, geometry
from acquisition.errors import ErrorCode, RigError
from acquisition.types import Light, Reach, Recipe

RING_SLANT_DEG = 50.0
SLANT_OF_THREE_DEG = 30.0
TURNS = 24
WORST_MISS_DEG = 60.0
"""A ring light further than this from its ideal place no longer stands on its side of the object."""


def pattern(recipe: Recipe, reach: Reach) -> list[Light]:
    """The pilot's lights, all distinct: one at the smallest reachable slant, the others at 50°; of three all at 30°.

    Raises RigError plan.infeasible when there are too few reachable positions or all lie on one side of the object.
    """
    candidates = reach.candidates
    units = dome.directions(candidates, reach.center, recipe.pilot_lights)
    top = [int(np.argmax(units[:, 2]))] if recipe.pilot_lights > 3 else []
    slant_deg = RING_SLANT_DEG if top else SLANT_OF_THREE_DEG
    free = np.ones(len(units), dtype=np.bool_)
    free[top] = False
    around = recipe.pilot_lights - len(top)
    step = 2 * np.pi / around
    rings = [
        dome.nearest_distinct(geometry.direction(np.radians(slant_deg), turn + np.arange(around) * step), units, free)
        for turn in np.arange(TURNS) * step / TURNS
    ]
    chosen, miss = min(rings, key=lambda ring: float(np.sum(ring[1] ** 2)))
    worst_deg = float(np.degrees(np.max(miss)))
    if worst_deg > WORST_MISS_DEG:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"the pilot's ring at {slant_deg:.0f}° cannot be formed: one light would stand {worst_deg:.0f}° from "
            "its place; free more of the dome, GET /v1/rig/reach says what refuses positions",
            worst_miss_deg=worst_deg,
        )
    return [dome.light(candidates[index], reach.center) for index in (*top, *chosen)]
