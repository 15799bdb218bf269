"""Sensitivity of plans to halving and doubling each of the planner's numbers, judged on the true shape without images.

A scene's pilot is captured and solved once. A plan with one number changed is evaluated with unchanged numbers on the
oracle's design problem: `error` is the mean σ there of the planned lights, weighted with their time if exposures are
planned. `forecast` is the mean σ that the plan itself states.
"""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from datetime import UTC, datetime
from typing import Any

import numpy as np

from acquisition import plan
from acquisition.models.recipe import Exposure, Recipe
from acquisition.plan import exposure_plan
from acquisition.plan.design_problem import DesignProblem
from tests.tuned_numbers import Number
from tests.unseen import patterns, reports, run, stages
from tests.unseen.captures import capture
from tests.unseen.scenes import Scene
from tests.unseen.sensitivity import FACTORS, changed
from tests.unseen.stages import Stage

TIMES = plan.CaptureTimes(shortest_s=1e-4, longest_s=2.0, move_s=2.0, frame_s=0.1)


class Planned:
    """Plans of one scene from its solved pilot, and their values on the true shape."""

    def __init__(self, scene: Scene, count: int) -> None:
        self.scene, self.count = scene, count
        self.first = capture(scene, patterns.pilot_lights(scene, 0, 1), 0)
        self.solved = run.solve(scene, self.first)
        self.oracle = patterns.oracle(scene, self.solved, self.first)

    def problem(self, recipe: Recipe, *, oracle: bool = False) -> DesignProblem:
        """The design problem after the pilot, of the true or of the solved shape."""
        normal_map, observations = self.oracle if oracle else self.solved, patterns.observations(self.first)
        return plan.DesignProblem.of(
            normal_map, observations, recipe, patterns.Dome(self.scene), self.first.calibration
        )

    def figures(self, exposure: Exposure, stage: Stage | None = None) -> dict[str, float]:
        """Error and forecast of the plan with a number changed."""
        recipe = Recipe(exposure=exposure)
        with nullcontext() if stage is None else stages.off(stage):
            chosen = plan.choose(self.problem(recipe), self.count - patterns.PILOT_LIGHTS, certify=False, times=TIMES)
        true = self.problem(recipe, oracle=True)
        frames = None if chosen.exposures is None else [one.frames for one in chosen.exposures]
        rows = true.rows(true.holdout_sample, patterns.places(chosen.lights), frames)
        seconds = 1.0 if frames is None else TIMES.of_pass(true.exposures) + TIMES.of_pass(frames)
        error = rows.posterior().loss * seconds**exposure_plan.SETTINGS.time_exponent
        return {"error": error, "forecast": chosen.predicted_sigma_deg or math.nan}


def measured(captures: Sequence[tuple[str, int]], lights: int, numbers: Sequence[Number]) -> dict[str, Any]:
    """The figures of the planner's numbers on the page of tuned numbers, by `module.name`: geometric means over the
    captures of each figure's ratio to the unchanged one, and their standard errors."""
    drawn = [Planned(run.scenes.scene(family, seed), lights) for family, seed in captures]
    exposures = {name: Exposure(plan=name) for name in ("fixed", "planned")}
    usual = {name: [one.figures(exposure) for one in drawn] for name, exposure in exposures.items()}
    shown: dict[str, Any] = {}
    for number in numbers:
        name = "planned" if number.module == "exposure_plan" else "fixed"
        shown[number.key] = {"captures": len(drawn)}
        for change, factor in FACTORS.items():
            stage = Stage(number.key, change, (changed(number, factor),))
            after = [one.figures(exposures[name], stage) for one in drawn]
            shown[number.key][change] = {key: _ratio(after, usual[name], key) for key in ("error", "forecast")}
            print(number.key, change, shown[number.key][change], flush=True)
    return shown


def page(captures: Sequence[tuple[str, int]], lights: int, numbers: Sequence[Number]) -> dict[str, Any]:
    """The figures with date, commit and captures."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commits": [reports.commit()],
        "captures": [f"{family} {seed}" for family, seed in captures],
        "numbers": measured(captures, lights, numbers),
    }


def _ratio(after: Sequence[dict[str, float]], usual: Sequence[dict[str, float]], key: str) -> list[float]:
    logs = [math.log(one[key] / other[key]) for one, other in zip(after, usual, strict=True)]
    return [round(math.exp(np.mean(logs)), 4), round(float(np.std(logs, ddof=1) / math.sqrt(len(logs))), 4)]
