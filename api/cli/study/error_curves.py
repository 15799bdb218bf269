"""Errors against the number of images, for every method, matt and glossy: the same solver and as many images for all.

A piece of the work is one draw of one object, matt and glossy: what the camera sees is traced once, pictures are shared
by all methods and numbers, and pieces run in two processes. The rivals that matter (ours and two rings) are drawn more
often where they are compared, and so are those with which eight images are compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
from scipy import stats

from acquisition.models.base import FloatArray
from api.cli.study import simulated_scene
from api.cli.study.simulated_scene import METHODS, OBJECTS, Run, Scene

RIVALS = ("optimal", "two-rings")
COMPARED = ("ring", "drbohlav", "random")
FAR_OFF_DEG = 10.0
RAYLEIGH_MEAN = 0.886
"""Mean angular error in σ."""


@dataclass(frozen=True)
class Draws:
    """How often each number of images is drawn, for the rivals, those compared with and the other methods."""

    rivals: dict[int, int]
    compared: dict[int, int]
    others: dict[int, int]

    def of(self, method: str) -> dict[int, int]:
        """Draws by number of images."""
        if method in RIVALS:
            return self.rivals
        return self.compared if method in COMPARED else self.others

    @property
    def most(self) -> int:
        """The most often that any number is drawn."""
        return max(*self.rivals.values(), *self.compared.values(), *self.others.values())


@dataclass(frozen=True)
class Scale:
    """How much is drawn: pixels, objects and draws of the error curves; objects and draws of the table of three."""

    pixels: int
    objects: tuple[str, ...]
    glossy_objects: tuple[str, ...]
    matt: Draws
    glossy: Draws
    table_objects: tuple[str, ...]
    table_draws: int


@dataclass(frozen=True)
class Piece:
    """One draw of one object; `matt` and `glossy`: how often each number of images is drawn, none: not this finish."""

    shape: str
    draw: int
    seed: int
    pixels: int
    matt: Draws | None
    glossy: Draws | None


@dataclass(frozen=True)
class Sample:
    """One session: what was found, and what the planner had predicted; degrees.

    Errors are of the graded pixels; `straddling` is the share left out because they show two surfaces, and the figures
    `of_all` count these too.
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
    fallback: str | None


@dataclass(frozen=True)
class Curve:
    """Mean error over objects by number of images, with half widths of 95 % confidence intervals; the figures `of_all`
    count the pixels that straddle two surfaces too."""

    method: str
    error_deg: dict[int, float]
    half_width_deg: dict[int, float]
    over_10: dict[int, float]
    error_of_all_deg: dict[int, float]
    over_10_of_all: dict[int, float]
    draws: dict[int, int]
    by_object: dict[int, dict[str, float]] = field(default_factory=dict[int, dict[str, float]])


def pieces(seed: int, scale: Scale) -> list[Piece]:
    """All pieces, those with most to do first."""
    return [
        Piece(
            shape,
            draw,
            1000 * seed + draw,
            scale.pixels,
            scale.matt if shape in scale.objects and draw < scale.matt.most else None,
            scale.glossy if shape in scale.glossy_objects and draw < scale.glossy.most else None,
        )
        for draw in range(max(scale.matt.most, scale.glossy.most))
        for shape in OBJECTS
        if shape in (*scale.objects, *scale.glossy_objects)
    ]


def work(piece: Piece) -> list[Sample]:
    """All sessions of one piece."""
    shared = simulated_scene.traced(piece.shape, piece.seed, piece.pixels)
    return [
        _sample(piece, scene, method, lights)
        for scene, draws in ((Scene(shared), piece.matt), (Scene(shared, glossy=True), piece.glossy))
        if draws is not None
        for method in METHODS
        for lights, times in sorted(draws.of(method).items())
        if piece.draw < times
    ]


def _sample(piece: Piece, scene: Scene, method: str, lights: int) -> Sample:
    run: Run = scene.run(simulated_scene.recipe(method, lights, piece.seed))
    error = run.found.error_deg
    sigma = run.found.normal_map.sigma_deg[scene.graded]
    return Sample(
        shape=piece.shape,
        draw=piece.draw,
        glossy=scene.glossy,
        method=method,
        lights=lights,
        mean_deg=float(np.mean(error)),
        median_deg=float(np.median(error)),
        over_10=float(np.mean(error > FAR_OFF_DEG)),
        straddling=len(run.found.straddling_deg) / len(run.found.all_deg),
        mean_of_all_deg=float(np.mean(run.found.all_deg)),
        over_10_of_all=float(np.mean(run.found.all_deg > FAR_OFF_DEG)),
        sigma_deg=float(np.nanmean(sigma)),
        predicted_sigma_deg=run.plan.predicted_sigma_deg,
        fallback=run.plan.fallback,
    )


def curves(samples: Sequence[Sample], *, glossy: bool) -> list[Curve]:
    """One curve for each method, in the order of `METHODS`."""
    return [
        _curve(method, [sample for sample in samples if sample.method == method and sample.glossy is glossy])
        for method in METHODS
    ]


def _curve(method: str, samples: Sequence[Sample]) -> Curve:
    curve = Curve(method, {}, {}, {}, {}, {}, {})
    for lights, group in groupby(sorted(samples, key=lambda item: item.lights), key=lambda item: item.lights):
        found = list(group)
        shapes = [shape for shape in OBJECTS if any(item.shape == shape for item in found)]
        errors = [np.array([item.mean_deg for item in found if item.shape == shape]) for shape in shapes]
        curve.error_deg[lights] = float(np.mean([np.mean(values) for values in errors]))
        curve.half_width_deg[lights] = half_width(errors)
        curve.over_10[lights] = _over_objects(found, "over_10")
        curve.error_of_all_deg[lights] = _over_objects(found, "mean_of_all_deg")
        curve.over_10_of_all[lights] = _over_objects(found, "over_10_of_all")
        curve.draws[lights] = max(len(values) for values in errors)
        curve.by_object[lights] = {shape: float(np.mean(values)) for shape, values in zip(shapes, errors, strict=True)}
    return curve


def _over_objects(samples: Sequence[Sample], name: str) -> float:
    """The mean over objects of a figure's mean over draws."""
    groups = [[getattr(item, name) for item in samples if item.shape == shape] for shape in OBJECTS]
    return float(np.mean([np.mean(group) for group in groups if group]))


def straddling(samples: Sequence[Sample]) -> dict[str, float]:
    """For each object the share of its pixels that are not graded because they show two surfaces."""
    return {
        shape: float(np.mean([item.straddling for item in samples if item.shape == shape]))
        for shape in OBJECTS
        if any(item.shape == shape for item in samples)
    }


def over_10(samples: Sequence[Sample], method: str, lights: int) -> dict[str, tuple[float, float]]:
    """For each matt object a method's share of pixels more than 10° off: of the graded ones, and of all."""
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
    """Half the 95 % confidence interval of the mean of the groups' means, from the scatter within groups.

    Objects are the ones that are there; only the draws are chance. Zero where nothing was drawn twice.
    """
    freedom = sum(len(values) - 1 for values in groups)
    if freedom == 0:
        return 0.0
    variance = sum(float(np.var(values, ddof=1)) / len(values) for values in groups if len(values) > 1)
    return float(stats.t.ppf(0.975, freedom) * np.sqrt(variance) / len(groups))


def ratio(samples: Sequence[Sample], method: str, rival: str, lights: int, *, glossy: bool) -> tuple[float, float]:
    """Mean error of a method over its rival's on the same draws, and half the 95 % confidence interval."""
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


def predicted_over_found(samples: Sequence[Sample]) -> dict[str, list[float]]:
    """For each matt object the planned runs' predicted mean error over the found one."""
    told: dict[str, list[float]] = {}
    for item in samples:
        if item.method == "optimal" and not item.glossy and item.predicted_sigma_deg is not None:
            told.setdefault(item.shape, []).append(RAYLEIGH_MEAN * item.predicted_sigma_deg / item.mean_deg)
    return told
