"""Robust solve of single pixels from several starts: the lowest minimum of Cauchy's loss (Black and Rangarajan 1996).

Cauchy's loss is not convex, and iterative reweighting ends in the minimum that is nearest to its start. The first start
is least squares that weighs bright measurements most, so that shadows and indirect light, which are dark, do not
disturb it. A highlight on a dark surface does: it is ten times as bright as the diffuse light, draws normal and albedo
to itself, and the other images are then taken for shadow.

So a pixel is solved a second time without its brightest measurement if residuals stay large, or if images count then
that were in shadow beside the brightest. The solution of less loss is kept, and the measurement gets the weight of its
own residual. On 24 unseen shapes of GGX 0.1 the second start lowers the mean error to 0.76 ± 0.09, on the same with
their own reflectances to 0.96 ± 0.02 (`python -m tests.unseen run --families all --seeds 2:5 --lights 8 --patterns
two-rings`, with `--reflectance ggx:0.1` and without).

Under many lights a highlight is in more than one image, so a third solve leaves out the brightest quarter. Without it
six glossy scenes of 96 lights are solved as well, in two thirds of the time, but a Gaussian lobe of twice the diffuse
light is not noticed (8° off instead of 1°; `distant/test_solve`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from acquisition import image_values, photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.pixels import pixel_solve_kernels
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.image_terms import TermValues


class Classified(NamedTuple):
    """Usable measurements (F, N), variance (F, N) of those beside shadow, and each pixel's largest y/|s| (N,)."""

    usable: BoolArray
    variance: Float32Array
    peak: Float32Array


@dataclass(frozen=True)
class RobustSettings:
    """Tuned numbers of the second start."""

    highlight_ratio: float = tuned(1.5, "ratio")
    """Ratio of the brightest y/|s| to the next from which it may be a highlight; also that of the brightest measurement
    to the prediction by the others from which the second solution may be kept. Measured on three matt and three glossy
    design scenes: without it a scene with steps has 6 % more error, at 2.5 the glossy ones lose half of the gain."""


SETTINGS = RobustSettings()

IRLS_ITERATIONS = 6
"""Reweightings of a solve. A solve of fewer is preliminary and has one start: its errors are 0.989 ± 0.008 of those
with two, in 42 captures of design seeds 205–225 (eight lights in two rings; scratch evaluation, November 2026)."""


@dataclass(frozen=True)
class PixelProblem:
    """Measurements of N pixels and what explains them, as arrays of the kernels.

    `values` are y (F, N), `by_g` their derivatives by g and `light` light vectors (F, 3, N), `point` and `view`, the
    direction to the camera, (3, N), `extra` is variance beside the noise model's (F, N). `least_albedo` is the prior's
    least albedo. Without a `cauchy_scale` the solve is least squares.
    """

    values: Float32Array
    by_g: Float32Array
    light: Float32Array
    point: Float32Array
    view: Float32Array
    extra: Float32Array | None
    terms: TermValues | None
    response: Float32Array | None
    sky: Float32Array | None
    noise: image_values.Noise
    least_albedo: float
    cauchy_scale: float | None
    iterations: int

    def at(self, chosen: np.ndarray) -> "PixelProblem":
        """Returns the pixels with the numbers `chosen` (K,); their terms are in values and derivatives already."""
        return replace(
            self,
            **{
                name: np.ascontiguousarray(getattr(self, name)[..., chosen])
                for name in ("values", "by_g", "light", "point", "view")
            },
            extra=None if self.extra is None else self.extra[:, chosen],
            terms=None,
            response=None,
            sky=None,
        )

    def solve(self, classified: Classified) -> Estimate:
        """Solves by Gauss–Newton steps with Cauchy's weights, from a start that weighs bright measurements most."""
        usable, added, peak = classified
        if self.extra is not None:
            added = added + self.extra
        albedo = np.maximum(peak, np.float32(self.least_albedo))
        count = self.values.shape[1]
        out = Estimate(
            g=np.empty((3, count), np.float32),
            variance=np.empty(count, np.float32),
            residual=np.empty(count, np.float32),
            weights=np.empty(self.values.shape, np.float32),
            usable=usable,
            light=self.light,
            point=self.point,
            terms=self.terms,
            response=self.response,
            sky=self.sky,
        )
        noise = self.noise
        scalars = [noise.intensity, noise.direction, self.cauchy_scale or 0.0]
        pixel_solve_kernels.estimate(
            np.ascontiguousarray(self.values, dtype=np.float32),
            np.ascontiguousarray(self.by_g, dtype=np.float32),
            usable.view(np.uint8),
            added,
            noise.shot.astype(np.float32),
            noise.floor.astype(np.float32),
            np.array(scalars, dtype=np.float32),
            np.ascontiguousarray(self.view * albedo, dtype=np.float32),
            (1.0 / (photometry.SETTINGS.prior_scale * albedo) ** 2).astype(np.float32),
            self.iterations,
            out.g,
            out.variance,
            out.residual,
            out.weights,
        )
        return out

    def loss_and_weights(self, g: Float32Array, scale: float) -> tuple[FloatArray, Float32Array]:
        """Returns Cauchy's loss c² ln(1 + r²/(c² v)) and weight 1/(v + r²/c²) of each measurement (F, N), for scale c.
        A prediction below zero, of a surface that turns away from the lamp, counts as zero."""
        predicted = np.maximum(np.einsum("fck,ck->fk", self.by_g, g), 0)
        squared = (self.values - predicted) ** 2 / np.float32(scale**2)
        strength = np.sqrt(np.sum(g * g, axis=0) * np.sum(self.light * self.light, axis=1))
        variance = self.noise.variance(self.values.astype(np.float64), strength.astype(np.float64))
        variance += 0 if self.extra is None else self.extra
        return scale**2 * np.log1p(squared / variance), (1 / (variance + squared)).astype(np.float32)


def solve(
    problem: PixelProblem, clipped: BoolArray, classified: Classified, classify: Callable[[BoolArray], Classified]
) -> Estimate:
    """Returns the solution of each pixel with the least Cauchy loss, from one start, two, or three under many lights.

    `clipped` (F, N) measurements do not count; `classified` are the others; `classify` finds the usable ones without
    more.
    """
    first, scale = problem.solve(classified), problem.cauchy_scale
    if scale is None or problem.iterations < IRLS_ITERATIONS:
        return first
    first = replace(first, usable=first.usable.copy())  # `classified` stays as it is
    strength = np.maximum(np.sqrt(np.sum(problem.light * problem.light, axis=1)), np.float32(1e-9))
    ratio = np.where(classified.usable, problem.values / strength, -np.inf)
    count = np.count_nonzero(classified.usable, axis=0)
    left_out_from = [np.max(ratio, axis=0)]
    if len(ratio) >= photometry.SETTINGS.many_lights:
        rank = np.maximum(1, count // 4)
        left_out_from.append(np.take_along_axis(np.sort(ratio, axis=0), len(ratio) - rank[None], axis=0)[0])
    for least in left_out_from:
        removed = classified.usable & (ratio >= least)
        others = classify(clipped | removed)
        left = np.count_nonzero(others.usable, axis=0)
        lost_to_shadow = left + np.count_nonzero(removed, axis=0) > count
        doubtful = np.flatnonzero(
            (left >= photometry.OVERDETERMINED)
            & (lost_to_shadow | (first.residual > photometry.SETTINGS.outlying_deviations))
            & (classified.peak > SETTINGS.highlight_ratio * others.peak)
        )
        if len(doubtful):
            _keep_better(first, problem, scale, others, removed, doubtful)
    return first


def _keep_better(
    first: Estimate, problem: PixelProblem, scale: float, others: Classified, removed: BoolArray, doubtful: np.ndarray
) -> None:
    """Solves the `doubtful` pixels (K,) without the `removed` measurements (F, N), and writes better solutions into
    `first`. Better is less loss, if at least a quarter of the removed measurements are highlights by it. `others` are
    the measurements usable then, `scale` is Cauchy's."""
    part, removed = problem.at(doubtful), removed[:, doubtful]
    usable, variance = np.ascontiguousarray(others.usable[:, doubtful]), others.variance[:, doubtful]
    second = part.solve(Classified(usable, np.ascontiguousarray(variance), others.peak[doubtful]))
    usable |= removed
    loss, _ = part.loss_and_weights(first.g[:, doubtful], scale)
    second_loss, weights = part.loss_and_weights(second.g, scale)
    second.weights[removed] = weights[removed]
    predicted = np.maximum(np.einsum("fck,ck->fk", part.by_g, second.g), 0)
    brighter = removed & (part.values > SETTINGS.highlight_ratio * predicted)
    is_highlight = 4 * np.count_nonzero(brighter, axis=0) >= np.count_nonzero(removed, axis=0)
    less = np.sum((second_loss - loss) * (usable | first.usable[:, doubtful]), axis=0) < 0
    better = np.flatnonzero(is_highlight & less)
    chosen = doubtful[better]
    for name in ("g", "variance", "residual", "weights"):
        getattr(first, name)[..., chosen] = getattr(second, name)[..., better]
    first.usable[:, chosen] = usable[:, better]
