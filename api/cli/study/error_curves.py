"""Mean error against the number of images for every method, diffuse and glossy, with the same solver for all.

A work item is one draw of one object, diffuse and glossy. Its geometry is traced once, images are shared by all methods
and numbers of lights, and items run in two processes. The two main methods (optimal and two rings) are drawn more often
where they are compared, and so are the others that are compared with them at eight images.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
from scipy import stats

from acquisition.models.base import FloatArray
from acquisition.models.result import MEAN_ERROR_PER_SIGMA
from api.cli.study import scene_geometry, simulated_scene
from api.cli.study.simulated_scene import METHODS, OBJECTS, Run, Scene

RIVALS = ("optimal", "two-rings")
COMPARED = ("ring", "drbohlav", "random")
FAR_OFF_DEG = 10.0


@dataclass(frozen=True)
class Draws:
    """Numbers of draws by number of images: for the rivals, for the methods compared with them, and for the others."""

    rivals: dict[int, int]
    compared: dict[int, int]
    others: dict[int, int]

    def of(self, method: str) -> dict[int, int]:
        """Returns the draws of a method by number of images."""
        if method in RIVALS:
            return self.rivals
        return self.compared if method in COMPARED else self.others

    @property
    def most(self) -> int:
        """Largest number of draws."""
        return max(*self.rivals.values(), *self.compared.values(), *self.others.values())


@dataclass(frozen=True)
class Scale:
    """Size of a study: pixels, objects and draws of the error curves; objects and draws of the three-image table."""

    pixels: int
    objects: tuple[str, ...]
    glossy_objects: tuple[str, ...]
    diffuse: Draws
    glossy: Draws
    table_objects: tuple[str, ...]
    table_draws: int


@dataclass(frozen=True)
class WorkItem:
    """One draw of one object; `diffuse` and `glossy` are the draws of that finish, None to leave it out."""

    shape: str
    draw: int
    seed: int
    pixels: int
    diffuse: Draws | None
    glossy: Draws | None


@dataclass(frozen=True)
class Sample:
    """One session: its errors, and the planner's prediction; degrees.

    Errors are averaged over the graded pixels. `straddling` is the share of mixed pixels, which show two surfaces and
    are not graded; the figures `of_all` include them. The names are keys of `study.json`.
    """

    shape: str
    draw: int
    glossy: bool
    method: str
    lights: int
    mean_deg: float
    median_deg: float
    over_10: float
    straddling: float
    mean_of_all_deg: float
    over_10_of_all: float
    sigma_deg: float
    predicted_sigma_deg: float | None


@dataclass(frozen=True)
class Curve:
    """Mean error over objects by number of images, half its 95 % confidence interval; `of_all` with mixed pixels."""

    method: str
    error_deg: dict[int, float]
    half_width_deg: dict[int, float]
    over_10: dict[int, float]
    error_of_all_deg: dict[int, float]
    over_10_of_all: dict[int, float]
    draws: dict[int, int]
    by_object: dict[int, dict[str, float]] = field(default_factory=dict[int, dict[str, float]])


def work_items(seed: int, scale: Scale) -> list[WorkItem]:
    """Returns all work items, longest first."""
    return [
        WorkItem(
            shape,
            draw,
            1000 * seed + draw,
            scale.pixels,
            scale.diffuse if shape in scale.objects and draw < scale.diffuse.most else None,
            scale.glossy if shape in scale.glossy_objects and draw < scale.glossy.most else None,
        )
        for draw in range(max(scale.diffuse.most, scale.glossy.most))
        for shape in OBJECTS
        if shape in (*scale.objects, *scale.glossy_objects)
    ]


def run_item(item: WorkItem) -> list[Sample]:
    """Runs all sessions of one work item."""
    shared = scene_geometry.cached_geometry(item.shape, item.seed, item.pixels)
    return [
        _sample(item, scene, method, lights)
        for scene, draws in ((Scene(shared), item.diffuse), (Scene(shared, glossy=True), item.glossy))
        if draws is not None
        for method in METHODS
        for lights, times in sorted(draws.of(method).items())
        if item.draw < times
    ]


def _sample(item: WorkItem, scene: Scene, method: str, lights: int) -> Sample:
    run: Run = scene.run(simulated_scene.recipe(method, lights, item.seed))
    error = run.result.error_deg
    sigma = run.result.normal_map.sigma_deg[scene.graded]
    return Sample(
        shape=item.shape,
        draw=item.draw,
        glossy=scene.glossy,
        method=method,
        lights=lights,
        mean_deg=float(np.mean(error)),
        median_deg=float(np.median(error)),
        over_10=float(np.mean(error > FAR_OFF_DEG)),
        straddling=len(run.result.mixed_error_deg) / len(run.result.all_error_deg),
        mean_of_all_deg=float(np.mean(run.result.all_error_deg)),
        over_10_of_all=float(np.mean(run.result.all_error_deg > FAR_OFF_DEG)),
        sigma_deg=float(np.nanmean(sigma)),
        predicted_sigma_deg=run.plan.predicted_sigma_deg,
    )


def curves(samples: Sequence[Sample], *, glossy: bool) -> list[Curve]:
    """Returns one curve for each method, in the order of `METHODS`."""
    return [
        _curve(method, [sample for sample in samples if sample.method == method and sample.glossy is glossy])
        for method in METHODS
    ]


def _curve(method: str, samples: Sequence[Sample]) -> Curve:
    curve = Curve(method, {}, {}, {}, {}, {}, {})
    for lights, group in groupby(sorted(samples, key=lambda item: item.lights), key=lambda item: item.lights):
        chosen = list(group)
        shapes = [shape for shape in OBJECTS if any(item.shape == shape for item in chosen)]
        errors = [np.array([item.mean_deg for item in chosen if item.shape == shape]) for shape in shapes]
        curve.error_deg[lights] = float(np.mean([np.mean(values) for values in errors]))
        curve.half_width_deg[lights] = half_width(errors)
        curve.over_10[lights] = _over_objects(chosen, "over_10")
        curve.error_of_all_deg[lights] = _over_objects(chosen, "mean_of_all_deg")
        curve.over_10_of_all[lights] = _over_objects(chosen, "over_10_of_all")
        curve.draws[lights] = max(len(values) for values in errors)
        curve.by_object[lights] = {shape: float(np.mean(values)) for shape, values in zip(shapes, errors, strict=True)}
    return curve


def _over_objects(samples: Sequence[Sample], name: str) -> float:
    """Averages a figure over the draws of each object, then over objects."""
    groups = [[getattr(item, name) for item in samples if item.shape == shape] for shape in OBJECTS]
    return float(np.mean([np.mean(group) for group in groups if group]))


def mixed_share(samples: Sequence[Sample]) -> dict[str, float]:
    """Returns for each object the share of mixed pixels, which are not graded because they show two surfaces."""
    return {
        shape: float(np.mean([item.straddling for item in samples if item.shape == shape]))
        for shape in OBJECTS
        if any(item.shape == shape for item in samples)
    }


def over_10(samples: Sequence[Sample], method: str, lights: int) -> dict[str, tuple[float, float]]:
    """Returns for each diffuse object a method's shares of pixels with errors above 10°: graded, and all pixels."""
    chosen = [item for item in samples if (item.method, item.lights, item.glossy) == (method, lights, False)]
    return {
        shape: (
            float(np.mean([item.over_10 for item in chosen if item.shape == shape])),
            float(np.mean([item.over_10_of_all for item in chosen if item.shape == shape])),
        )
        for shape in OBJECTS
        if any(item.shape == shape for item in chosen)
    }


def half_width(groups: Sequence[FloatArray]) -> float:
    """Returns half the 95 % confidence interval of the mean of the groups' means, from the scatter within groups.

    The objects are fixed; only the draws are random. Zero if nothing was drawn twice.
    """
    freedom = sum(len(values) - 1 for values in groups)
    if freedom == 0:
        return 0.0
    variance = sum(float(np.var(values, ddof=1)) / len(values) for values in groups if len(values) > 1)
    return float(stats.t.ppf(0.975, freedom) * np.sqrt(variance) / len(groups))


def ratio(samples: Sequence[Sample], method: str, rival: str, lights: int, *, glossy: bool) -> tuple[float, float]:
    """Returns a method's mean error over its rival's on the same draws, and half its 95 % confidence interval."""
    ours, theirs = (
        {
            (item.shape, item.draw): item.mean_deg
            for item in samples
            if (item.method, item.lights, item.glossy) == (name, lights, glossy)
        }
        for name in (method, rival)
    )
    both = sorted(set(ours) & set(theirs))
    if not both:
        return float("nan"), float("nan")
    quotient = float(np.mean([ours[key] for key in both]) / np.mean([theirs[key] for key in both]))
    scale = float(np.mean([theirs[key] for key in both]))
    rest = [
        np.array([(ours[key] - quotient * theirs[key]) / scale for key in both if key[0] == shape]) for shape in OBJECTS
    ]
    return quotient, half_width([values for values in rest if len(values)])


def predicted_over_observed(samples: Sequence[Sample]) -> dict[str, list[float]]:
    """Returns for each diffuse object the ratios of predicted to observed mean error of the planned sessions."""
    ratios: dict[str, list[float]] = {}
    for item in samples:
        if item.method == "optimal" and not item.glossy and item.predicted_sigma_deg is not None:
            ratios.setdefault(item.shape, []).append(MEAN_ERROR_PER_SIGMA * item.predicted_sigma_deg / item.mean_deg)
    return ratios
