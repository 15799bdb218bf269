"""Gauss–Newton solve of pixels with terms beyond Lambert's; gloss and metal from several starts, the best counts.

Each round solves with the terms' values and derivatives at the normals of the round before. Roughness and ambient light
change slowly with the normal, so these rounds converge from anywhere. A highlight does not: beside it the image does
not show where it would be, and a pixel whose highlight was taken for diffuse light stays wrong. So a glossy pixel is
solved from its Lambertian solution, and from the half vectors of the camera and the lamps of its brightest images, the
normals that would mirror these. The solution of least robust cost is taken.

Each solve of the alternation needs all starts, although metal takes half a minute by them. If self-calibration starts
from the solution before, seven of 13 captures of metal (α = 0.15, design seeds 555 and 556, eight lights in two rings)
are no longer recognised.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.result import SolveSettings
from acquisition.normals.pixels import image_terms, microfacet
from acquisition.normals.pixels.estimate import Estimate
from acquisition.normals.pixels.image_terms import ImageTerms, TermValues

ROUNDS = 3
"""Solves of a pixel, each with the terms' derivatives at the one before. Gloss ends alike after three, four and six."""

METAL_ROUNDS = 6
"""The same for metal, whose Lambertian solution is of little use. Without noise (α = 0.35, eight lights, slants to 34°)
the error is 3.8° by three rounds from three images, 0.6° by six rounds, and 0.1° from five images."""

HIGHLIGHT_STARTS = 2
"""Images, the brightest first, whose half vectors are further starts of a glossy pixel's normal. On a knot and a turned
profile (design seed 2, α = 0.16, eight lights, known depth) the mean error is 5.1° and 5.8° without any, 3.1° and 3.2°
with two; a third changes nothing."""

METAL_STARTS = 4
"""Images that give starts on metal."""


@dataclass(frozen=True)
class TermProblem:
    """Pixels to solve with terms. `values` and `clipped` are (F, N), light vectors `light` (F, 3, N), unit directions
    `view` to the camera (3, N). `once` solves with given values of the terms. `response` (N,) are values of white at a
    mosaic's sites, `sky` (N,) sky view factors; none: ones."""

    values: Float32Array
    clipped: BoolArray
    light: Float32Array
    view: Float32Array
    noise: Noise
    terms: ImageTerms
    once: Callable[[TermValues], Estimate]
    response: Float32Array | None = None
    sky: Float32Array | None = None


def rounds(terms: ImageTerms) -> int:
    """Returns the number of successive solves of a pixel with these terms from one start."""
    return METAL_ROUNDS if terms.metal > 0 else ROUNDS


def solve(problem: TermProblem) -> Estimate:
    """Solves the pixels with their terms, from normals that face the camera; gloss and metal also from others."""
    light = problem.light
    strength = np.maximum(photometry.strength(light), np.float32(1e-9))
    ratio = np.where(problem.clipped, 0, photometry.value_per_strength(problem.values, strength))
    peak = np.max(ratio, axis=0)
    facing = (problem.view * peak).astype(np.float32)
    out = _from_start(problem, replace(problem.terms, gloss=0.0, metal=0.0), facing)
    if not problem.terms.specular:
        return out
    least = _robust_cost(problem, out)
    level = np.maximum(np.median(ratio, axis=0), np.float32(SolveSettings().shadow_threshold) * peak)
    if problem.terms.metal > 0:  # at the half vector the brightest value is all lobe, F₀/(4α²) high
        level = np.float32(4 * problem.terms.metal**2 / microfacet.METAL_F0) * peak
    for image in np.argsort(-ratio, axis=0)[: METAL_STARTS if problem.terms.metal > 0 else HIGHLIGHT_STARTS]:
        toward = np.take_along_axis(light, image[None, None], axis=0)[0]
        half = toward / np.take_along_axis(strength, image[None], axis=0) + problem.view
        half *= level / np.maximum(np.sqrt(np.sum(half * half, axis=0)), np.float32(1e-6))
        one = _from_start(problem, problem.terms, half.astype(np.float32))
        cost = _robust_cost(problem, one)
        out, least = _chosen(cost < least, one, out), np.minimum(cost, least)
    return out


def _from_start(problem: TermProblem, first: ImageTerms, start: Float32Array) -> Estimate:
    """Runs all rounds of solves, the first one with the terms `first` at g = `start` (3, N)."""

    def values(terms: ImageTerms, g: Float32Array, usable: BoolArray) -> TermValues:
        return image_terms.evaluate(terms, g, problem.light, usable, problem.view, problem.response, problem.sky)

    estimate = problem.once(values(first, start, np.ones_like(problem.clipped)))
    for _ in range(rounds(problem.terms) - 1):
        estimate = problem.once(values(problem.terms, estimate.g, estimate.usable))
    return replace(estimate, terms=values(problem.terms, estimate.g, estimate.usable))


def _robust_cost(problem: TermProblem, estimate: Estimate) -> Float32Array:
    """Returns the sum (N,) over images of Cauchy's loss of residuals; what counts as shadow costs as an outlier."""
    strength = photometry.strength(estimate.light) * estimate.albedo
    residual = problem.values - estimate.lambertian() - estimate.term_value
    variance = problem.noise.variance(np.maximum(problem.values, 0), strength) + estimate.highlight_variance
    square = np.where(estimate.usable, residual**2 / variance, photometry.SETTINGS.outlying_deviations**2)
    return np.sum(np.where(problem.clipped, 0, np.log1p(square / photometry.CAUCHY_SCALE**2)), axis=0).astype(
        np.float32
    )


def _chosen(where: BoolArray, one: Estimate, other: Estimate) -> Estimate:
    """Returns `one` at some pixels (N,) and the `other` elsewhere; their light vectors and points are the same."""
    names = ("g", "variance", "residual", "weights", "usable")
    parts = {name: np.where(where, getattr(one, name), getattr(other, name)) for name in names}
    return replace(one, **parts, terms=image_terms.chosen(where, one.terms, other.terms))
