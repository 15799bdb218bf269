"""Initial light pattern of a session, chosen without knowledge of the object: one light near the view axis and a ring.

The light near the view axis illuminates nearly everything that the camera sees, so it determines shadows, albedo and
depth; the ring at 52.5° determines the directions of the normals. A ring alone leaves up to half of the pixels with
fewer than three lights. Planned lights and two-ring completions extend both. The top light is 20° off the axis, between
two lights of the ring, so that it still adds information on the normals: the errors of eight path-traced images are 2 %
lower than with 8° in direct light and 5 % lower with interreflection. The ring is slightly inside the outer one of the
two-ring pattern: through the simulated arm, the errors of eight images are 3 % lower than with 50°, and with 55° and
interreflection they are 6 % higher. The azimuth of the pattern is the one that the arm's reach matches best. With three
lights, none can be at the top, or all would lie in one plane: they form a ring at 30°, which loses the fewest pixels to
shadows. See docs/decisions/0025-pilot-pattern.md.

Before: nothing. After: `waypoints`, `capture`, `normals`.
"""

import numpy as np

from acquisition import geometry, lamp_pose
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.route import Reach

TOP_SLANT_DEG = 20.0
"""Slant of the top light from the view axis; decision 0025."""
RING_SLANT_DEG = 52.5
"""Slant of the ring; decision 0025."""
SLANT_OF_THREE_DEG = 30.0
"""Slant of the ring of a pilot with three lights; decision 0025."""
AZIMUTH_STEPS = 24
"""Number of azimuths of the pattern that are tried."""
MAX_MISS_DEG = 60.0
"""Largest angle between a light and its ideal position. Beyond it, the light is on another side of the object."""


def pattern(recipe: Recipe, reach: Reach) -> list[Light]:
    """Pilot pattern (decision 0025): distinct lights, one at 20°, the others on a ring at 52.5°; of three all at 30°.

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
    turns = np.arange(AZIMUTH_STEPS) * step / AZIMUTH_STEPS
    patterns = (geometry.direction(slants, turn + azimuths) for turn in turns)
    chosen, miss = lamp_pose.nearest_pattern(patterns, units)
    worst_deg = float(np.degrees(np.max(miss)))
    if worst_deg > MAX_MISS_DEG:
        raise RigError(
            ErrorCode.PLAN_INFEASIBLE,
            f"the pilot's lights at {slant_deg:g}° cannot be placed: one would be {worst_deg:.0f}° from "
            "its ideal position; clear more of the dome (GET /v1/rig/reach says why positions are refused)",
            worst_miss_deg=worst_deg,
        )
    return [lamp_pose.light_at(candidates[index], reach.center) for index in chosen]
