"""Which lights to add, from what the images so far say of the object.

Before: `normals`, whose normal map, albedo, depth, σ and information per pixel are all that is read. After:
`waypoints`, or nothing when the recipe is fulfilled. `approach` also chooses how many lights an ordered accuracy takes.
`baseline` gives the patterns that planning is compared with.
"""

from acquisition.plan.baselines import baseline
from acquisition.plan.planner import choose, forecast
from acquisition.plan.stopping_rule import approach

__all__ = ["approach", "baseline", "choose", "forecast"]
