"""Score tests of terms that the model of the images leaves out (Rao 1948): what a parameter gains, without a fit of it.

At the solution without a parameter, its column is added to the normal equations of what all pixels share, and all other
parameters are eliminated under their priors. With the remaining score g and information H, the log-likelihood would
rise by g²/2H, at the value g/H: by less than 1 on most sound captures, by 5–400 on a rough surface or in ambient light.
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import self_calibration
from acquisition.normals.alternatives import light_tests
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels import pixel_solve
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate, Scene
from acquisition.normals.self_calibration import Equations, Priors, SharedParameters


@dataclass(frozen=True)
class TermTestSettings:
    """Tuned numbers of the score tests."""

    gloss_tested: float = tuned(0.3, "α")
    """Roughness α at which gloss is tested, in the middle of what is common. Sharper gloss leaves highlights, which
    robust weights reject, and wrong normals, which make the fit poor. With 0.19, the geometric middle of
    `image_terms.SETTINGS.gloss_range`, amounts are half as large, a Gaussian lobe under 96 lights gains 1 instead of 7
    (`distant/test_solve`), and three of eight glossy objects of α 0.12 (design seed 102) are below the least step."""


SETTINGS = TermTestSettings()

OFFSET = 2
"""Index of the offset among the tested terms."""

LEAST_SIGNAL = 1e-6
"""Least signal, relative to a white surface's, of which the logarithm is taken."""

TURN_DIFFERENCE_DEG = 0.5
"""Half of the turn of the lamps, degrees, over which light vectors are differentiated."""

LEAST_INFORMATION = 1e-6
"""Share of a parameter's information that has to be left once all others are eliminated; less is rounding error. Of a
turn of distant lamps nothing is left, because all normals turn with the lamps."""


@dataclass(frozen=True)
class TermScore:
    """Gain of the log-likelihood by a parameter, and its value after one Newton step from zero."""

    gain: float
    step: float


@dataclass(frozen=True)
class TermScores:
    """Scores of parameters that the model leaves out.

    - `roughness`, `ambient`, `offset`: the terms of `ImageTerms`.
    - `gloss`: a dielectric's gloss of `gloss_tested` as a whole, whose value would be 1.
    - `exponent`: ε of values that are coded as the signal to the power of 1 + ε; 0 where they are linear.
    - `turn`: the angle, rad, by which the lamps have to be turned about the viewing axis, from x towards y. Near light
      determines it. Measured: 5.8–11.2° for 16 Lambertian objects under lamps turned by 10°, 2.9° at most with gains up
      to 1 for 32 others, Lambertian and rough, under the right ones (design seeds 62, 63, 101 and 105).
    - `excess`: the offset by values above black alone, where darker ones are stored as black.
    """

    roughness: TermScore
    ambient: TermScore
    offset: TermScore
    gloss: TermScore
    exponent: TermScore
    turn: TermScore
    excess: TermScore

    def gains_most(self, one: TermScore) -> bool:
        """Returns whether no term of `ImageTerms` that would be above zero gains more than this score."""
        terms = (self.roughness, self.ambient, self.offset, self.gloss)
        return all(one.gain >= term.gain for term in terms if term.step > 0)


def scores(
    estimate: Estimate, values: Float32Array, scene: Scene, shared: SharedParameters, priors: Priors
) -> TermScores | None:
    """Returns score tests at K pixels' `estimate` from `values` (F, K) without indirect light. `scene` has the lamps as
    estimated, `shared` is divided out. None where too few pixels have enough lights."""
    terms = scene.terms or LAMBERTIAN
    present, glossy = estimate.evaluated(terms), estimate.evaluated(ImageTerms(gloss=SETTINGS.gloss_tested))
    direct = np.maximum(estimate.lambertian(), 0)
    signal = direct * (np.min(scene.noise.shot) / scene.noise.shot)[:, None]  # up to a factor, which albedo absorbs
    coded = np.where(estimate.usable, direct * np.log(np.maximum(signal, LEAST_SIGNAL)), 0)
    usual = estimate.by_parameter(terms)
    turned = np.where(estimate.usable, np.einsum("fck,ck->fk", _light_by_turn(estimate.point, scene), estimate.g), 0)
    columns = np.stack([*np.moveaxis(usual[:, :3], 1, 0), glossy.value, coded, turned], axis=1, dtype=np.float32)
    ray_direction = photometry.depth_directions(estimate.point)
    by_depth = pixel_solve.depth_derivative(estimate.light, estimate.point, ray_direction, scene.lamps)

    def by_term(weights: Float32Array, priors: Priors) -> list[TermScore]:
        equations = self_calibration.normal_equations(
            replace(estimate, terms=present, weights=weights), by_depth, values, scene.lamps, shared, priors,
            photometry.SETTINGS.depth_sigma_m, columns,
        )  # fmt: skip
        first = 4 * len(values) + 1
        return [] if equations is None else [_score(equations, first + number) for number in range(columns.shape[1])]

    found = by_term(estimate.weights, priors)
    if not found:
        return None
    lit = found
    if scene.stores_black_as_zero:
        # Values are left-censored at black. Pixels that no light reaches are black whatever is subtracted.
        reached = estimate.albedo > pixel_solve.least_prior_albedo(float(np.median(estimate.albedo)))
        weights = np.where((values > 0) & reached, estimate.weights, 0).astype(np.float32)
        lit = by_term(weights, replace(priors, shadows=ShadowEquations.none()))
    return TermScores(*found, excess=lit[OFFSET] if lit else TermScore(0.0, 0.0))


def _light_by_turn(point: Float32Array, scene: Scene) -> Float32Array:
    """Returns the derivative of the light vectors (F, 3, K) at points (3, K) by the turn of the lamps, per rad."""
    ahead, behind = (
        photometry.light_vectors(
            point, light_tests.transformed(scene.lamps, light_tests.turned_by(turn)), scene.calibration
        )
        for turn in (TURN_DIFFERENCE_DEG, -TURN_DIFFERENCE_DEG)
    )
    return (ahead - behind) / np.float32(2 * np.radians(TURN_DIFFERENCE_DEG))


def _score(equations: Equations, tested: int) -> TermScore:
    """Returns gain and step of one parameter; all others that are not held are eliminated under their priors. The
    elimination is the Schur complement of the normal equations."""
    others = ~equations.held
    others[tested] = False
    precision = equations.precision[np.ix_(others, others)]
    inner = equations.matrix[np.ix_(others, others)] + precision
    across: FloatArray = equations.matrix[tested, others]
    right = equations.right[others] - precision @ equations.before[others]
    information = float(equations.matrix[tested, tested] - across @ np.linalg.solve(inner, across))
    score = float(equations.right[tested] - across @ np.linalg.solve(inner, right))
    if information <= LEAST_INFORMATION * float(equations.matrix[tested, tested]):
        return TermScore(0.0, 0.0)
    return TermScore(score**2 / (2 * information), score / information)
