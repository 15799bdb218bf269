"""Self-calibration: lamp intensities, lamp positions and the object's depth, estimated by all pixels together.

Each pixel with at least four usable lights has redundant measurements. Its own unknowns (albedo × normal and a depth
offset) are eliminated (Schur complement). The rest is linear in the few parameters that all pixels share; Gauss–Newton
steps solve for them with Gaussian priors from the calibration. The depth offset keeps wrong depth at discontinuities
from being explained by wrong intensities. Model errors of neighbouring pixels are correlated, so the information of the
pixels is divided by `effective_sample_divisor` before it is combined with the priors.

Lamp positions are unknowns because a position error of a millimetre rotates all normals and would otherwise be
explained by intensities. With them errors of smooth objects fall by a twentieth, those of unlucky draws by a fifth.

Kernels compile at import, into numba's cache.
"""

from dataclasses import astuple, dataclass, field, fields, replace

import numba
import numpy as np
from scipy.linalg import block_diag

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.indirect_light.shadow_light import ShadowEquations
from acquisition.normals.pixels import pixel_solve, pixel_solve_kernels
from acquisition.normals.pixels.image_terms import LAMBERTIAN, ImageTerms
from acquisition.normals.pixels.pixel_solve import Estimate


@dataclass(frozen=True)
class SelfCalibrationSettings:
    """Tuned number of the self-calibration of lamps."""

    effective_sample_divisor: float = tuned(20.0, "pixels")
    """Number of pixels whose model errors are correlated and which together count as one; errors of lamp positions,
    which all pixels of an image share, are included. Measured: with 10 the object's shift is wrong by up to 8 mm where
    few lights determine it; with 30 objects with discontinuities are calibrated worse."""

    @property
    def independent_sample(self) -> float:
        """Least number of measurements for a statistic, so that `min_sample` of them are independent. Measured: with
        only 50, σ_d of a hollow vessel (design seed 20, six lights, 48 pixels) is 0.05 instead of 0.004 rad, and σ of
        its pixels that no lamp reaches is a sixth too small (`tests/unseen/test_hardly_lit.py`)."""
        return photometry.SETTINGS.min_sample * self.effective_sample_divisor


SETTINGS = SelfCalibrationSettings()

SIGMA_FACTORS = np.geomspace(1, 4, 21)
"""Factors of the stated σ of intensities among which `evidence_maximised_sigma` chooses."""

STRONG_EVIDENCE = 3.0
"""Log Bayes factor from which evidence counts as strong (Kass & Raftery, J. Am. Stat. Assoc. 90, 1995)."""


@dataclass(frozen=True)
class SharedParameters:
    """Parameters that all pixels share, and their covariance.

    They are the log intensity factor of each image (F,), each lamp's offset (F, 3) from its nominal position in m, view
    frame, the object's shift along the rays in m, and the terms beyond Lambert's. The covariance (4F + 7, 4F + 7) has
    the log intensities first, then all x, all y and all z, the shift, and the terms.
    """

    log_intensity: FloatArray
    lamp_offset_m: FloatArray
    shift_m: float
    covariance: FloatArray
    terms: ImageTerms = LAMBERTIAN

    @classmethod
    def nominal(cls, count: int) -> "SharedParameters":
        """Returns the parameters of `count` lamps as calibrated: no offsets, and a covariance of zeros."""
        size = 4 * count + 1 + len(fields(ImageTerms))
        return cls(np.zeros(count), np.zeros((count, 3)), 0.0, np.zeros((size, size)))

    def lamps(self, nominal: Float32Array) -> Float32Array:
        """Moves `nominal` lamps (F, 6 or 9) to their estimated positions."""
        moved = nominal.copy()
        moved[:, :3] += self.lamp_offset_m
        return moved


@dataclass(frozen=True)
class Priors:
    """1 σ of log intensities, lamp positions per axis, m, shift, m, and terms beyond Lambert's; 0 holds a parameter.

    `position_m` is independent from lamp to lamp. Unless positions are held, errors that all lamps share are added:
    `common_position_m` (F, 3, C) is the displacement of each lamp, view frame, by 1 σ of each (`lamp_pose`). `shadows`
    are the equations of ambient and stray light by shadowed measurements.
    """

    intensity: float
    position_m: float
    shift_m: float
    terms: ImageTerms = LAMBERTIAN
    common_position_m: FloatArray | None = None
    shadows: ShadowEquations = field(default_factory=ShadowEquations.none)

    def position_covariance(self, count: int) -> FloatArray:
        """Returns the covariance (3F, 3F), m², of the positions of `count` lamps: all x, all y, all z."""
        covariance = self.position_m**2 * np.eye(3 * count)
        if self.common_position_m is None or self.position_m == 0:
            return covariance
        common = self.common_position_m.transpose(1, 0, 2).reshape(3 * count, -1)
        return covariance + common @ common.T

    def covariance(self, count: int) -> FloatArray:
        """Returns the covariance of the `SharedParameters` of `count` lamps by these priors alone."""
        others = np.square([self.shift_m, *astuple(self.terms)])
        stated = block_diag(self.intensity**2 * np.eye(count), self.position_covariance(count), np.diag(others))
        return np.asarray(stated, np.float64)


@dataclass(frozen=True)
class Equations:
    """Normal equations `matrix` x = `right` of a change of the shared parameters, and the prior's `precision` (M, M).

    `before` (M,) are the present parameters, which the prior pulls towards zero; `held` ones are fixed, and `terms`
    (M,) marks the terms. Log intensities (F) come first, then lamp positions (3F), shift and terms.
    """

    matrix: FloatArray
    right: FloatArray
    precision: FloatArray
    before: FloatArray
    held: BoolArray
    terms: BoolArray

    def posterior(self) -> tuple[FloatArray, FloatArray]:
        """Returns the change (M,) of the parameters to the maximum a posteriori, and their covariance (M, M).

        Where the model holds, the errors of pixels are independent, and the images hold `effective_sample_divisor`
        times the information on lamps and shift that they are weighted with. Given the terms, the covariance is that of
        the errors which then remain (sandwich estimator). The terms' own covariance keeps the divisor, because a term
        only approximates the reflectance and errors are correlated. Errors of a wrong model are part of
        `error_variance`.
        """
        total = self.matrix + self.precision
        covariance = np.asarray(np.linalg.inv(total), np.float64)
        change = covariance @ (self.right - self.precision @ np.where(self.held, 0.0, self.before))
        exact = np.ix_(~self.terms, ~self.terms)
        given = np.asarray(np.linalg.inv(total[exact]), np.float64)
        independent = self.precision[exact] + self.matrix[exact] / SETTINGS.effective_sample_divisor
        covariance[exact] += given @ independent @ given - given
        return np.where(self.held, 0.0, change), covariance


def normal_equations(
    estimate: Estimate, by_depth: Float32Array, values: Float32Array, lamps: Float32Array, present: SharedParameters,
    priors: Priors, offset_sigma_m: float, tested: Float32Array | None = None,
) -> Equations | None:  # fmt: skip
    """Linearises least squares of the shared parameters at estimates of K pixels, each pixel's own unknowns eliminated.

    `by_depth` (F, 3, K) is ∂s/∂Z; `values` (F, K) and `lamps` (F, 6 or 9) are those of the estimate. The `present`
    parameters are already contained in the values (divided out), the lamps and the depth. Priors pull all parameters
    towards zero; that of the intensities is widened by `evidence_maximised_sigma`. `tested` (F, L, K) are derivatives
    by parameters that are held at zero and replace the terms. Returns none if too few pixels have enough lights.
    """
    count = len(values)
    enough = np.count_nonzero(estimate.weights > 0, axis=0) >= photometry.OVERDETERMINED
    if np.count_nonzero(enough) < photometry.SETTINGS.min_sample:
        return None
    terms = estimate.terms
    nothing, none = np.zeros((count, 0, 0), np.float32), np.zeros((count, 0), np.float32)
    by_g, added = (nothing, none) if terms is None else (terms.by_g, terms.from_lamps)
    by_parameter, parameters, parameter_sigma = nothing, np.zeros(0), np.zeros(0)
    if tested is not None:
        by_parameter, parameters, parameter_sigma = tested, np.zeros(tested.shape[1]), np.zeros(tested.shape[1])
    elif terms is not None:
        by_parameter = estimate.by_parameter(present.terms)
        parameters, parameter_sigma = np.array(astuple(present.terms)), np.array(astuple(priors.terms))
    sigma = np.concatenate([[priors.shift_m], parameter_sigma])
    size = 4 * count + len(sigma)
    sums = np.zeros((size + 1, size + 1))
    _normal_equations(
        estimate.light,
        by_depth,
        position_derivative(estimate, lamps),
        np.ascontiguousarray(values if terms is None else values - terms.value, np.float32),
        estimate.g,
        estimate.weights,
        np.ascontiguousarray(by_g, np.float32),
        np.ascontiguousarray(added, np.float32),
        np.ascontiguousarray(by_parameter, np.float32),
        enough,
        np.array([1e-6] * photometry.PIXEL_UNKNOWNS + [offset_sigma_m**-2]),
        sums,
    )
    if len(parameters):  # ambient light and offset are the second and third term
        elsewhere, shadows = slice(4 * count + 2, 4 * count + 4), priors.shadows
        said = np.array([present.terms.ambient, present.terms.offset])
        sums[elsewhere, elsewhere] += shadows.matrix
        sums[elsewhere, -1] += shadows.right - shadows.matrix @ said
    matrix, right = (
        sums[:-1, :-1] / SETTINGS.effective_sample_divisor,
        sums[:-1, -1] / SETTINGS.effective_sample_divisor,
    )
    before = np.concatenate([present.log_intensity, present.lamp_offset_m.T.ravel(), [present.shift_m], parameters])
    others = np.asarray(block_diag(_position_precision(priors, count), np.diag(_precision(sigma))), np.float64)
    intensity_sigma = priors.intensity
    if intensity_sigma > 0:
        intensity_sigma = evidence_maximised_sigma(matrix, right + matrix @ before, others, intensity_sigma)
    precision = np.asarray(block_diag(np.diag(_precision(np.full(count, intensity_sigma))), others), np.float64)
    free = np.concatenate([np.full(count, priors.intensity), np.full(3 * count, priors.position_m), sigma]) > 0
    return Equations(matrix, right, precision, before, ~free, np.arange(len(free)) > 4 * count)


def gauss_newton_step(
    estimate: Estimate, by_depth: Float32Array, values: Float32Array, lamps: Float32Array, present: SharedParameters,
    priors: Priors, offset_sigma_m: float,
) -> SharedParameters:  # fmt: skip
    """Returns a Gauss–Newton step of the shared parameters from estimates at K pixels, as changes of the fields.

    The covariance is that after the step. Arguments are those of `normal_equations`.
    """
    count = len(values)
    nothing = SharedParameters.nominal(count)
    equations = normal_equations(estimate, by_depth, values, lamps, present, priors, offset_sigma_m)
    if equations is None:
        return replace(nothing, covariance=priors.covariance(count))
    change, known = equations.posterior()
    covariance = np.pad(known, (0, len(nothing.covariance) - len(known)))  # terms that are not estimated: 0
    terms = LAMBERTIAN
    if estimate.terms is not None:
        terms = ImageTerms(*(float(one) for one in change[4 * count + 1 :][: len(fields(ImageTerms))]))
    return SharedParameters(
        log_intensity=change[:count],
        lamp_offset_m=change[count : 4 * count].reshape(3, count).T,
        shift_m=float(change[4 * count]),
        covariance=covariance,
        terms=terms,
    )


def position_derivative(estimate: Estimate, lamps: Float32Array) -> Float32Array:
    """Derivatives (F, 3, K) of values by lamp positions, per m; lamps (F, 6 or 9) keep facing the object."""
    away = lamps[:, :3, None] - estimate.point
    square = np.sum(away * away, axis=1, keepdims=True)
    strength = np.sqrt(np.sum(estimate.light**2, axis=1, keepdims=True) / square)
    projection = np.einsum("fck,ck->fk", away, estimate.g)[:, None]
    return np.ascontiguousarray(strength * (estimate.g - 3 * away * projection / square), np.float32)


def evidence_maximised_sigma(matrix: FloatArray, right: FloatArray, others: FloatArray, stated: float) -> float:
    """Estimates the 1 σ of log intensities by evidence maximisation (MacKay 1992, Bayesian interpolation).

    The `stated` value stays unless there is STRONG_EVIDENCE of a larger one. The images' normal equations `matrix` x =
    `right` are in the log intensities (F,), followed by the other shared parameters (M,), whose prior has the precision
    `others` (M, M). Both are marginalised for each σ. Directions that images do not determine, such as the scale of all
    intensities and the tilt of a plane, add no evidence.
    """
    count = len(right) - len(others)
    across, last = matrix[:count, count:], matrix[count:, count:] + others
    schur = matrix[:count, :count] - across @ np.linalg.solve(last, across.T)
    marginal = right[:count] - across @ np.linalg.solve(last, right[count:])
    precision, axes = np.linalg.eigh((schur + schur.T) / 2)
    precision = np.maximum(precision, 0)
    variance = (SIGMA_FACTORS[:, None] * stated) ** 2
    gained = (axes.T @ marginal) ** 2 / (precision + 1 / variance) - np.log1p(precision * variance)
    evidence = np.sum(gained, axis=1) / 2
    best = int(np.argmax(evidence))
    return stated * float(SIGMA_FACTORS[best]) if evidence[best] > evidence[0] + STRONG_EVIDENCE else stated


def _precision(sigma: FloatArray) -> FloatArray:
    """Returns the precision of priors from their σ; zero holds a parameter fixed."""
    return np.where(sigma > 0, 1.0 / np.maximum(sigma, 1e-12) ** 2, 1e18)


def _position_precision(priors: Priors, count: int) -> FloatArray:
    """Returns the precision (3F, 3F) of the prior of the lamps' positions."""
    if priors.position_m == 0:
        return np.diag(_precision(np.zeros(3 * count)))
    return np.asarray(np.linalg.inv(priors.position_covariance(count)), np.float64)


def normal_variance(
    estimate: Estimate, by_depth: Float32Array, lamps: Float32Array, shared: SharedParameters
) -> Float32Array:
    """Propagates errors of the shared parameters to the normals, to first order.

    Returns the variance (N,), rad², over both tangential directions. `by_depth` (F, 3, N) is ∂s/∂Z; lamps (F, 6 or 9)
    as estimated.
    """
    of_each_lamp = [
        estimate.by_lamps,
        *position_derivative(estimate, lamps).transpose(1, 0, 2),
    ]
    of_all = [np.einsum("fcn,cn->fn", by_depth, estimate.g)]
    if estimate.terms is not None:
        of_all += list(estimate.by_parameter(shared.terms).transpose(1, 0, 2))
    rows = estimate.rows
    right = [np.einsum("fn,fan->naf", estimate.weights * kind, rows) for kind in of_each_lamp]
    right += [np.einsum("fn,fan->na", estimate.weights * kind, rows)[..., None] for kind in of_all]
    moved = pixel_solve.normal_perturbation(estimate, np.concatenate(right, axis=2).astype(np.float64))
    covariance = shared.covariance[: moved.shape[2], : moved.shape[2]]
    return np.einsum("naf,fg,nag->n", moved, covariance, moved, optimize=True).astype(np.float32)


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1],"
    " float32[:,::1], float32[:,:,::1], float32[:,::1], float32[:,:,::1], boolean[::1], float64[::1], float64[:,::1])",
    cache=True,
    fastmath=True,
    error_model="numpy",
)
def _normal_equations(  # noqa: PLR0913, PLR0912 - one fused kernel is the point
    light: Float32Array,  # (F, 3, K)
    by_depth: Float32Array,  # (F, 3, K)
    by_position: Float32Array,  # (F, 3, K) of values by the lamps' positions
    values: Float32Array,  # (F, K)
    g: Float32Array,  # (3, K)
    weights: Float32Array,  # (F, K)
    by_g: Float32Array,  # (F, 3, K) of values beside Lambert's, or empty
    added: Float32Array,  # (F, K) values beside Lambert's that scale with the lamp, or empty
    by_term: Float32Array,  # (F, L, K) of values by the parameters of terms
    enough: BoolArray,  # (K,): the pixels that count
    precision: FloatArray,  # (4,) of the prior of a pixel's own unknowns
    sums: FloatArray,  # (M + 1, M + 1), M = 4F + 1 + L: intensities, positions, shift and terms; residuals
) -> None:
    """Sums the normal equations of the shared parameters, each pixel's own unknowns eliminated (Schur complement).

    A pixel has whitened rows O (F, 4) of its own unknowns, and C (F, M + 1) of the shared ones with the residuals as
    last column; it adds CᵀC − CᵀO (OᵀO + prior)⁻¹ OᵀC. The columns of a lamp are non-zero only in that lamp's row, so
    CᵀC is summed lamp by lamp and spread at the end.
    """
    count, terms, size = light.shape[0], by_term.shape[1], len(sums)
    lamp_columns, wide = 4 * count, 6 + terms  # columns of the lamps; columns of one of them, and those of all
    own, inner = np.empty((4, count)), np.empty((4, 4))
    columns, by_lamp = np.empty((wide, count)), np.zeros((wide, wide, count))
    across = np.empty((4, size))
    for p in range(light.shape[2]):
        if not enough[p]:
            continue
        for f in range(count):
            root = np.sqrt(np.float64(weights[f, p]))
            slope, direct = 0.0, 0.0
            for c in range(3):
                slope += by_depth[f, c, p] * np.float64(g[c, p])
                direct += light[f, c, p] * np.float64(g[c, p])
                own[c, f] = root * (light[f, c, p] + by_g[f, c, p] if terms else light[f, c, p])
                columns[1 + c, f] = root * by_position[f, c, p]
            columns[0, f] = root * (direct + added[f, p] if terms else direct)
            own[3, f] = columns[4, f] = root * slope
            for one in range(terms):
                columns[5 + one, f] = root * by_term[f, one, p]
            columns[wide - 1, f] = root * (values[f, p] - direct)
        for a in range(wide):
            for b in range(wide):
                for f in range(count):
                    by_lamp[a, b, f] += columns[a, f] * columns[b, f]
        pixel_solve_kernels.orthonormalise(own, precision, inner)
        for i in range(4):
            for a in range(4):
                for f in range(count):
                    across[i, a * count + f] = own[i, f] * columns[a, f]
            for a in range(4, wide):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * columns[a, f]
                across[i, lamp_columns + a - 4] = total
        for a in range(size):
            first, second, third, fourth = across[0, a], across[1, a], across[2, a], across[3, a]
            for b in range(a + 1):  # most of the time goes here: from zero and without branches, it is vectorised
                sums[a, b] -= (
                    first * across[0, b] + second * across[1, b] + third * across[2, b] + fourth * across[3, b]
                )
    for a in range(size):
        for b in range(a):
            sums[b, a] = sums[a, b]
    for a in range(wide):
        for b in range(wide):
            for f in range(count):
                row = a * count + f if a < 4 else lamp_columns + a - 4
                column = b * count + f if b < 4 else lamp_columns + b - 4
                sums[row, column] += by_lamp[a, b, f]


KERNELS = (_normal_equations,)
