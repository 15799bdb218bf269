"""Three images and plain inversion (Woodham 1980): which conditions reproduce the paper's errors, and which do not.

A mean error near the median, both near nine degrees, is typical of a near lamp modelled as a distant one. A mean far
above the median is typical of shadows. The paper's best figures are those of a ring at 25–35° with a distant lamp and
model. Its criterion with unit lights, which moves the lights to grazing slants, does not give them.

Conditions: 0.5 % noise and 8 bits, each image exposed by its 99.5th percentile, errors over the graded pixels including
shadowed ones unless stated otherwise.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from acquisition import geometry, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.cell_config import MAX_SLANT_DEG
from acquisition.models.light_plan import Light
from acquisition.plan import baselines
from api.cli.study import paper_criterion
from api.cli.study.simulated_scene import Scene
from hardware_sim import grade, render
from hardware_sim.render import Lamp

REPORTED = {
    "ours": (2.010, 0.593),
    "Drbohlav–Chantler": (6.078, 3.313),
    "greatest distance": (9.712, 8.733),
}
"""Mean and median error that the paper reports for three images, degrees."""

NOISE = 0.005
LEVELS = 255
NEAR_M, FARTHER_M, DISTANT_M = 0.45, 3.0, 50.0
BRIGHT_PERCENTILE, BRIGHT_LEVEL = 99.5, 0.8


@dataclass(frozen=True)
class Condition:
    """How the three images are captured and inverted; errors are medians over the draws of lights."""

    name: str
    distance_m: float
    model: Literal["distant", "near"]
    directions: Callable[[Scene, np.random.Generator], FloatArray]
    draws: int = 1
    lit_by_all: bool = False


@dataclass(frozen=True)
class Row:
    """Errors of one condition and object: mean and median in degrees, and the share of pixels counted."""

    condition: str
    object: str
    mean_deg: float
    median_deg: float
    share: float


def ring(slant_deg: float) -> Callable[[Scene, np.random.Generator], FloatArray]:
    """Returns three lights evenly spaced round the view axis."""
    return lambda scene, rng: geometry.direction(np.radians(slant_deg), np.arange(3) * 2 * np.pi / 3)


def equation_23(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """Returns three unit lights that minimise the criterion for the object's normals, none below the horizon."""
    best = paper_criterion.best_unit_lights(paper_criterion.mean_projector(scene), 3, int(rng.integers(2**31)))
    slant, azimuth = geometry.slant_azimuth(best)
    return geometry.direction(np.minimum(slant, np.radians(MAX_SLANT_DEG)), azimuth)


def random_directions(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """Draws three directions uniformly from the dome's cap."""
    cosine = rng.uniform(np.cos(np.radians(75)), np.cos(np.radians(8)), 3)
    return geometry.direction(np.arccos(cosine), rng.uniform(0, 2 * np.pi, 3))


def conditions(draws: int) -> list[Condition]:
    """Returns the conditions of the table; `draws` applies to the random ones."""
    diagonal = ring(baselines.DRBOHLAV_SLANT_DEG)
    few = max(1, draws // 6)
    return [
        Condition("lamp at 0.45 m, distant model, ring 30°", NEAR_M, "distant", ring(30)),
        Condition("lamp at 0.45 m, near model, ring 30°", NEAR_M, "near", ring(30)),
        Condition("lamp at 3 m, distant model, ring 25°", FARTHER_M, "distant", ring(25)),
        Condition("distant lamp and model, ring 35°", DISTANT_M, "distant", ring(35)),
        Condition("distant lamp and model, ring 25°", DISTANT_M, "distant", ring(25)),
        Condition("distant lamp and model, Drbohlav–Chantler 54.74°", DISTANT_M, "distant", diagonal),
        Condition("distant lamp and model, Eq. 23 with unit lights", DISTANT_M, "distant", equation_23, few),
        Condition("distant lamp and model, random", DISTANT_M, "distant", random_directions, draws),
        Condition("lit by all three only: ring 35°", DISTANT_M, "distant", ring(35), lit_by_all=True),
        Condition("lit by all three only: Drbohlav–Chantler", DISTANT_M, "distant", diagonal, lit_by_all=True),
        Condition("lit by all three only: Eq. 23", DISTANT_M, "distant", equation_23, few, lit_by_all=True),
    ]


def table(scene: Scene, draws: int) -> list[Row]:
    """Evaluates all conditions for one object."""
    return [_row(scene, condition) for condition in conditions(draws)]


def _row(scene: Scene, condition: Condition) -> Row:
    errors: list[tuple[float, float, float]] = []
    for draw in range(condition.draws):
        rng = np.random.default_rng([scene.geometry.seed, draw])
        errors.append(_errors(scene, condition, condition.directions(scene, rng), rng))
    mean_deg, median_deg, share = np.median(np.array(errors), axis=0)
    return Row(condition.name, scene.geometry.shape, float(mean_deg), float(median_deg), float(share))


def _errors(
    scene: Scene, condition: Condition, directions: FloatArray, rng: np.random.Generator
) -> tuple[float, float, float]:
    shared = scene.geometry
    positions = scene.dome.center + condition.distance_m * directions
    images = [_image(scene, position, condition.distance_m, rng) for position in positions]
    counted = scene.graded
    if condition.lit_by_all:
        counted = counted & np.all([_lit(scene, position) for position in positions], axis=0)
    values = np.stack([image[counted] for image in images])
    if condition.model == "distant":
        vectors = np.broadcast_to(directions[:, :, None], (3, 3, values.shape[1]))
    else:
        lights = [_light(position, scene.dome.center) for position in positions]
        ray = photometry.rays(scene.calibration, slice(0, shared.lens.height), slice(0, shared.lens.width))
        points = photometry.points(ray, shared.truth.depth)[:, counted]
        scale = (condition.distance_m / scene.calibration.reference_m) ** 2
        vectors = photometry.light_vectors(points, photometry.lamps(lights), scene.calibration) * scale
    solved = np.linalg.solve(vectors.transpose(2, 0, 1).astype(float), values.T[..., None].astype(float))[..., 0]
    length = np.linalg.norm(solved, axis=1, keepdims=True)
    axis = np.array([0.0, 0.0, 1.0])
    normals = np.zeros((*counted.shape, 3), np.float32)
    normals[counted] = np.where(length > 0, solved / np.maximum(length, 1e-12), axis)
    error = grade.error_deg(normals, shared.truth)[counted]
    return float(np.mean(error)), float(np.median(error)), float(np.mean(counted[scene.graded]))


def _image(scene: Scene, position: FloatArray, distance_m: float, rng: np.random.Generator) -> Float32Array:
    """Simulates an image of an 8-bit camera, in units of a white surface that faces the lamp at this distance."""
    lamp = Lamp(
        geometry.transform(scene.geometry.object_from_view, position),
        geometry.rotate(scene.geometry.object_from_view, _unit(scene.dome.center - position)),
        1.0,
        distance_m,
        scene.calibration.lobe_exponent,
    )
    picture = render.direct_image(scene.geometry.views[0], scene.surface, scene.geometry.tracer, lamp)
    gain = BRIGHT_LEVEL / float(np.percentile(picture[scene.graded], BRIGHT_PERCENTILE))
    noisy = gain * picture + NOISE * rng.standard_normal(picture.shape, dtype=np.float32)
    return (np.clip(np.rint(noisy * LEVELS), 0, LEVELS) / LEVELS / gain).astype(np.float32)


def _lit(scene: Scene, position: FloatArray) -> BoolArray:
    """Returns where (H, W) the pixel centres see the lamp."""
    shared = scene.geometry
    centres = shared.centres
    lamp_position = geometry.transform(shared.object_from_view, position)
    lit = np.zeros(shared.lens.height * shared.lens.width, dtype=bool)
    lit[centres.pixels] = render.lit_mask(centres.points, centres.normals, lamp_position, shared.tracer, scene.surface)
    return lit.reshape(shared.lens.height, shared.lens.width)


def _light(position: FloatArray, center: FloatArray) -> Light:
    x, y, z = (float(value) for value in position)
    u, v, w = (float(value) for value in _unit(center - position))
    return Light(position=(x, y, z), axis=(u, v, w))


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
