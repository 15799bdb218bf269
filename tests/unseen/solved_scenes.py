"""Scenes that are measured by a solve: sessions with a target σ, glossy objects under many distant lights, and metal.

A session runs like the service's, by pilot, solve and plan, until the stopping rule ends it. Solves of the same lights
are shared, because the rule decides only the number of lights.
"""

from collections.abc import Callable

import numpy as np

from acquisition import normals, photometry, pilot, plan
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap, SolveSettings
from acquisition.models.shot import Observations
from acquisition.normals import distant
from tests.acquisition import scenes as height_fields
from tests.acquisition.normals.distant import gloss_scenes
from tests.unseen import grading, height_scenes, patterns, run, scenes
from tests.unseen.captures import capture
from tests.unseen.fresh_process import Errors

PIXELS = 64
MAX_LIGHTS = 20
CANDIDATES = 100
RINGS_LIGHTS, TARGETS = (6, 14), (0.9, 1.1)
"""Ranges of the number of lights by two rings, and of a target's ratio to the mean σ under these."""
MAX_TARGET_DEG = 10.0
"""Greatest target that a recipe may state."""
METAL_PIXELS = 96
METAL = [(family, seed) for seed in (44, 46) for family in ("turned", "blob", "knot", "sheet")]
GLOSSY_PIXELS, BOUNCES = 40, 12


class Session:
    """A session of one height field, with its solves by their lights."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 31])
        self.seed, self.reach = seed, height_fields.Dome(refused=0, count=CANDIDATES)
        known = height_fields.calibration(PIXELS)
        self.true = height_fields.scene(height_scenes.height(rng), known, albedo=float(rng.uniform(0.3, 0.8)))
        self._solved: dict[tuple[Light, ...], tuple[NormalMap, Observations]] = {}
        self.first = tuple(pilot.pattern(Recipe(), self.reach))
        count = int(rng.integers(*RINGS_LIGHTS))
        rings = [*height_fields.ring(count // 2, 25.0), *height_fields.ring(count - count // 2, 50.0, 0.3)]
        reached = photometry.mean_sigma_deg(self.solved(tuple(rings))[0], known)
        self.target_deg = min(reached * float(rng.uniform(*TARGETS)), MAX_TARGET_DEG)

    def solved(self, lights: tuple[Light, ...]) -> tuple[NormalMap, Observations]:
        """Normal map and images of lights; the images of the first lights do not depend on how many follow."""
        if lights not in self._solved:
            observations = height_fields.capture(self.true, lights, self.seed)
            place = normals.ObjectPlace(height_fields.TABLE_DEPTH - 0.03)
            found = normals.solve(observations, self.true.calibration, SolveSettings(), place)
            self._solved[lights] = found, observations
        return self._solved[lights]

    def errors(self) -> Errors:
        """Numbers of images and passes until the rule ends the session, and σ and error of the last result."""
        recipe = Recipe(target_sigma_deg=self.target_deg, max_lights=MAX_LIGHTS)
        lights, passes = self.first, 1
        while True:
            found, observations = self.solved(lights)
            known = self.true.calibration
            achieved_deg = photometry.mean_sigma_deg(found, known)
            problem = plan.DesignProblem.of(found, observations, recipe, self.reach, known)
            more = plan.plan_to_target(problem, achieved_deg).lights
            if not more:
                return {
                    "images": float(len(lights)),
                    "passes": float(passes),
                    "σ over its target": achieved_deg / self.target_deg,
                    "error, deg": float(np.mean(self.true.error_deg(found.normals))),
                }
            lights, passes = (*lights, *more), passes + 1


def session(seed: int) -> Callable[[], Errors]:
    """A session with a target σ."""
    return Session(seed).errors


def glossy(seed: int) -> Callable[[], Errors]:
    """A glossy object under 96 distant lights; a pixel without a normal counts as an error of 90°."""
    shape = ("figure-side", "vase-side")[seed % 2]
    material = list(gloss_scenes.REFLECTANCES)[seed // 2]
    scene = gloss_scenes.scene(shape, material, GLOSSY_PIXELS, 10 + seed, bounces=BOUNCES)

    def measure() -> Errors:
        solved = distant.solve(scene.image_set())
        error = scene.errors_deg(np.where(solved.mask[..., None], solved.normals, 0))
        return {"error, deg": float(error.mean())}

    return measure


def metal(seed: int) -> Callable[[], Errors]:
    """A capture of a metal object."""
    family, number = METAL[seed]
    scene = scenes.scene(family, number, "metal:0.3", METAL_PIXELS)
    captured = capture(scene, patterns.fixed("two-rings", scene, 8, 0, 1))

    def measure() -> Errors:
        found = run.solve(scene, captured)
        graded = grading.errors(found.normals, found.mask, scene.truth)
        return {
            "error within 78°, deg": graded["within_78_deg.mean"],
            "rms e/σ": grading.sigma(found, scene.truth)["rms"],
        }

    return measure
