"""Forecast of σ before the first image: the posterior of an assumed surface under the recipe's own lights.

Before the pilot nothing is known of the object, so the design is evaluated on a surface that shows every slant: a matt
sphere of middling albedo, as large as the cell's keep-out admits, without interreflection, whose images fit the model.
What real objects have beside it (creases, gloss, indirect light, cast shadows) makes σ larger, a flat object makes it
smaller. The lights after the pilot are chosen by the planner's search, as in the forecast of a plan.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acquisition import lamp_pose, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import ForecastPoint, Light, PriorForecast
from acquisition.models.recipe import Recipe
from acquisition.models.route import Reach
from acquisition.plan import baselines, criterion, design_problem, planner, visibility
from acquisition.plan.criterion import Samples
from acquisition.plan.design_problem import Problem
from acquisition.plan.expected_sigma import ExpectedSigma
from acquisition.plan.planned_images import PlannedImages
from acquisition.plan.visibility import Surface

SAMPLE_PIXELS = 450
"""Number of sample pixels: with twice as many σ differs by 3 % at most, and an answer takes twice the time."""

SHOWN_LIGHTS = 16
"""Number of images to which a forecast extends at least, so that it shows what more lights would bring."""

POINTS = 9
"""Approximate number of points of a forecast."""

ALBEDO = 0.5
"""Assumed albedo; with automatic exposure σ does not depend on it."""

BEHIND_M = 0.05
"""Depth of the background behind the sphere's far side, m."""

ASSUMPTION = (
    "Nothing is known of the object before the first image, so a matt sphere of {diameter_mm:.0f} mm is assumed, which "
    "shows every slant and fits the model. Creases, gloss, deep shadows and light between surfaces make σ larger, and "
    "the forecast after the pilot takes the place of this one."
)
"""What is assumed, for people."""


def assumed_sphere(center: FloatArray, radius_m: float, seed: int) -> tuple[Samples, Surface]:
    """Sample pixels of a sphere (`center` (3,) m, view frame) seen by a camera at the origin, and its surface.

    The pixels are drawn evenly from its picture out to the graded slant, without any information on their normals.
    """
    half = np.tan(np.arcsin(radius_m / np.linalg.norm(center))) * 1.1
    axis = np.array([center[0], -center[1]]) / -center[2]
    pitch = 2 * half / visibility.MAP_SIZE
    steps = (np.arange(visibility.MAP_SIZE) + 0.5) * pitch - half
    ray = np.stack(np.meshgrid(axis[0] + steps, axis[1] + steps)).astype(np.float32)
    direction = photometry.ray_directions(ray).astype(np.float64)
    along = np.einsum("chw,c->hw", direction, center)
    squared = np.sum(direction**2, axis=0)
    discriminant = along**2 - squared * (center @ center - radius_m**2)
    depth = (along - np.sqrt(np.maximum(discriminant, 0))) / squared
    normal = (direction * depth - center[:, None, None]) / radius_m
    cosine = -np.sum(normal * direction, axis=0) / np.sqrt(squared)
    graded = np.argwhere((discriminant > 0) & (cosine > np.cos(np.radians(photometry.GRADED_SLANT_DEG))))
    chosen = np.random.default_rng(seed).permutation(len(graded))[:SAMPLE_PIXELS]
    row, column = graded[np.sort(chosen)].T
    background = float(-center[2] + radius_m + BEHIND_M)
    surface = Surface(
        depth=np.ascontiguousarray(np.where(discriminant > 0, depth, background), np.float32),
        ray_x=float(ray[0, 0, 0]),
        ray_y=float(ray[1, 0, 0]),
        pitch=float(pitch),
        nearest=float(depth[discriminant > 0].min()),
    )
    albedo = np.full(len(row), ALBEDO, np.float32)
    pixels = Samples(
        row=row,
        column=column,
        point=np.ascontiguousarray((direction * depth)[:, row, column], np.float32),
        ray_direction=np.ascontiguousarray(direction[:, row, column], np.float32),
        normal=np.ascontiguousarray(normal[:, row, column], np.float32),
        albedo=albedo,
        sigma=np.zeros(len(row), np.float32),
        information=criterion.prior_information(albedo),
        lit=np.zeros(len(row), np.float32),
        indirect=np.zeros(len(row), np.float32),
    )
    return pixels, surface


def forecast(
    recipe: Recipe, first_lights: Sequence[Light], reach: Reach, calibration: Calibration, radius_m: float
) -> PriorForecast:
    """Bayesian design for an unseen object: expected σ of the assumed sphere against the number of images.

    From the pilot's number, or a pattern's smallest, to `shown_lights` or the recipe's own. `first_lights` are those of
    the recipe's first pass, `radius_m` is the assumed sphere's. Raises RigError plan.infeasible when the arm reaches
    too few positions for the recipe's lights.
    """
    sample, surface = assumed_sphere(reach.center, radius_m, recipe.seed)
    optimal = recipe.method == "optimal"
    counts, known = _counts(recipe, len(reach.candidates)), first_lights if optimal else []
    images = PlannedImages(surface, calibration, recipe.exposure)
    if optimal:
        piloted = images.candidates(sample, first_lights)
        seen = piloted.visibility > 0.5
        own = piloted.row.astype(np.float64) * seen[:, None]
        sample = replace(
            sample,
            information=sample.information + np.einsum("kap,kbp->abp", own, own),
            lit=np.count_nonzero(seen, axis=0).astype(np.float32),
        )
    positions, units = design_problem.candidates_of(reach)
    problem = Problem(
        recipe=recipe,
        reach=reach,
        positions=positions,
        units=units,
        captured=design_problem.directions(known, reach),
        exposures=[],
        images=images,
        expected=ExpectedSigma(
            calibration_rad=lamp_pose.common_direction_sigma_rad(reach.candidates, reach.center, calibration)
        ),
        search_sample=sample,
        holdout_sample=sample,
    )
    if optimal:
        sigma_deg = [one.sigma_deg for one in planner.forecast(problem, [count - len(known) for count in counts])]
    else:
        patterns = [_pattern(recipe, first_lights, reach, count) for count in counts]
        places = [np.array([light.position for light in pattern]) for pattern in patterns]
        sigma_deg = [float(np.mean(problem.sigma_deg(place))) for place in places]
    points = [ForecastPoint(added=n, lights=n, sigma_deg=one) for n, one in zip(counts, sigma_deg, strict=True)]
    return PriorForecast(points=points, assumption=ASSUMPTION.format(diameter_mm=2e3 * radius_m))


def _counts(recipe: Recipe, reachable: int) -> list[int]:
    """Numbers of images, ascending, the recipe's own among them."""
    total = recipe.lights_total
    if recipe.method == "user":  # as many lights as there are
        return [total]
    fewest = recipe.pilot_lights if recipe.method == "optimal" else criterion.MIN_LIGHTS
    most = max(total, min(SHOWN_LIGHTS, reachable))
    spread = np.geomspace(fewest, most, POINTS).round().astype(int).tolist()
    return sorted({*spread, total})


def _pattern(recipe: Recipe, first_lights: Sequence[Light], reach: Reach, count: int) -> Sequence[Light]:
    """The lights of the recipe's pattern with `count` images."""
    if count == len(first_lights):
        return first_lights
    return baselines.baseline(recipe.method, count, recipe, reach).lights
