"""Forecast of σ before the first image: the posterior of an assumed surface under the recipe's own lights.

Before the pilot nothing is known of the object, so the design is evaluated on a surface that shows every slant: a matt
sphere of medium albedo, as large as the cell's keep-out admits, without interreflection, whose images fit the model.
Creases, gloss, indirect light and cast shadows of a real object make σ larger; a flat object has a smaller σ. The
planner's search chooses the lights after the pilot, as in the forecast of a plan.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from acquisition import geometry, lamp_pose, photometry
from acquisition.models.base import FloatArray
from acquisition.models.calibration import Calibration
from acquisition.models.light_plan import ForecastPoint, Light, PriorForecast
from acquisition.models.recipe import Recipe
from acquisition.models.route import Reach
from acquisition.plan import baselines, criterion, design_problem, planner
from acquisition.plan.criterion import Samples
from acquisition.plan.design_problem import DesignProblem, positions_of
from acquisition.plan.expected_sigma import ExpectedSigma
from acquisition.plan.planned_images import PlannedImages

SAMPLE_PIXELS = 450
"""Number of sample pixels. With twice as many, σ differs by at most 3 % and an answer takes twice the time."""

SHOWN_LIGHTS = 16
"""Number of images to which a forecast extends at least, so that it shows the effect of more lights."""

POINTS = 9
"""Approximate number of points of a forecast."""

ALBEDO = 0.5
"""Assumed albedo; with automatic exposure σ does not depend on it."""

ASSUMPTION = (
    "Nothing is known of the object before the first image, so a matt sphere of {diameter_mm:.0f} mm is assumed, which "
    "shows every slant and fits the model. Creases, gloss, deep shadows and light between surfaces make σ larger; the "
    "forecast after the pilot replaces this one."
)
"""The assumed object, as text for people."""


def assumed_sphere(center: FloatArray, radius_m: float) -> Samples:
    """Sample pixels of a sphere about `center` (3,), m, view frame, without any information on their normals. They lie
    evenly over its picture as seen by a camera at the origin, out to the graded slant."""
    number, distance = np.arange(SAMPLE_PIXELS), np.linalg.norm(center)
    sine = np.sqrt((number + 0.5) / SAMPLE_PIXELS) * np.sin(np.radians(photometry.GRADED_SLANT_DEG))
    polar = np.arcsin(sine) - np.arcsin(sine * radius_m / distance)  # slant to the ray less the ray's own
    towards_camera, _ = Rotation.align_vectors(-center / distance, [0.0, 0.0, 1.0])
    normal = towards_camera.apply(geometry.direction(polar, number * np.pi * (3 - np.sqrt(5)))).T
    point = center[:, None] + radius_m * normal
    albedo, none = np.full(SAMPLE_PIXELS, ALBEDO, np.float32), np.zeros(SAMPLE_PIXELS, np.float32)
    return Samples(
        row=number,
        column=number,
        point=np.ascontiguousarray(point, np.float32),
        ray_direction=photometry.depth_directions(point),
        normal=np.ascontiguousarray(normal, np.float32),
        albedo=albedo,
        information=criterion.prior_information(albedo),
        light_count=none,
        indirect=none,
        margin=np.zeros(SAMPLE_PIXELS),
    )


def forecast(
    recipe: Recipe, first_lights: Sequence[Light], reach: Reach, calibration: Calibration, radius_m: float
) -> PriorForecast:
    """Bayesian design for an unseen object: expected σ of the assumed sphere against the number of images.

    The numbers run from that of the pilot, or the smallest of a pattern, to `SHOWN_LIGHTS` or the recipe's own.
    `first_lights` are those of the recipe's first pass; `radius_m` is the radius of the assumed sphere. Raises RigError
    plan.infeasible when the arm reaches too few positions for the recipe's lights.
    """
    known = first_lights if recipe.method == "optimal" else []
    images, candidates = PlannedImages(None, calibration, recipe.exposure), design_problem.candidates_of(reach)
    piloted = images.candidates(assumed_sphere(reach.center, radius_m), known)
    row = piloted.row.astype(np.float64)
    sample = replace(
        piloted.sample,
        information=piloted.sample.information + np.einsum("kap,kbp->abp", row, row),
        light_count=np.sum(piloted.visible, axis=0, dtype=np.float32),
    )
    problem = DesignProblem(
        recipe=recipe,
        reach=candidates,
        captured=candidates.directions(positions_of(known)),
        exposures=[],
        images=images,
        expected=ExpectedSigma(
            calibration_rad=lamp_pose.common_direction_sigma_rad(reach.candidates, reach.center, calibration)
        ),
        search_sample=sample,
        holdout_sample=sample,
    )
    counts = _counts(recipe, len(reach.candidates))
    if recipe.method == "optimal":
        sigma_deg = [one.sigma_deg for one in planner.forecast(problem, [count - len(known) for count in counts])]
    else:
        others = [count for count in counts if count != len(first_lights)]
        patterns = {count: baselines.baseline(recipe.method, count, recipe, reach).lights for count in others}
        patterns[len(first_lights)] = list(first_lights)
        sigma_deg = [problem.predict(positions_of(patterns[count])).mean_deg for count in counts]
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
