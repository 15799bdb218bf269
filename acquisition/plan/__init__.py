"""Light positions by optimum experimental design: the next lights that lower the mean σ of the normals most.

Before: `normals`, whose normal map, albedo, depth, σ and information per pixel are the input. After: `waypoints`, or
nothing when the recipe is fulfilled. From a `DesignProblem`, `choose` plans a number of lights, `plan_to_target` also
chooses how many a target accuracy needs, and `forecast` predicts σ as a function of that number. `prior_forecast` does
so before the first image. `baseline` returns the fixed patterns with which plans are compared.
"""

from acquisition.plan.baselines import baseline
from acquisition.plan.design_problem import DesignProblem
from acquisition.plan.exposure_plan import CaptureTimes
from acquisition.plan.planner import choose, forecast
from acquisition.plan.stopping_rule import plan_to_target

__all__ = ["CaptureTimes", "DesignProblem", "baseline", "choose", "forecast", "plan_to_target"]
