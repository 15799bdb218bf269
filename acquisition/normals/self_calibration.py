"""What all pixels of a capture know together: each lamp's intensity and place, and how far away the object is.

Each pixel with more than four usable lights has measurements to spare. Its own unknowns (albedo × normal and a depth
offset) are projected out; what is left is linear in the few unknowns that all pixels share. The depth column in the
projection keeps wrong depth at steps from being taken for wrong intensities. Model errors of neighbouring pixels go
together, so the pixels' evidence is divided by `EFFECTIVE_SAMPLE_DIVISOR` before it meets the priors.

A lamp that stands a millimetre aside turns all normals, and without an unknown of its own what it does is put down to
intensities. Errors of smooth objects fall by a twentieth with one, and those of unlucky draws by a fifth.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.normals import pixel_solve, pixel_solve_kernels
from acquisition.normals.pixel_solve import Estimate
from acquisition.normals.specular import HighlightDerivatives

EFFECTIVE_SAMPLE_DIVISOR = 20.0
"""Pixels whose model errors go together, errors of the lamps' positions included, which all pixels of an image share:
with 10 the object's shift came out wrong by up to 8 mm where few lights tell it, with 30 steps are calibrated worse."""

LOBE_LOG_SIGMA = 0.5
"""1 σ of the logarithms of a lobe's strength and exponent."""

MAX_SIGMA_SCALE, LOG_SCALE_SIGMA = 4.0, 0.6
"""The prior of the intensity σ in `evidence_maximised_sigma`: at most MAX_SIGMA_SCALE times the stated one, with 1 σ
of the logarithm of that factor."""

MIN_LOG_BAYES_FACTOR = 3.0
"""Log evidence from which images that speak of worse lamps are believed."""

MIN_LIGHTS = 4
MIN_PIXELS = 50


@dataclass(frozen=True)
class SharedParameters:
    """What all pixels share: log intensity per image (F,), how far each lamp is from where it is said to be (F, 3) in
    m, view frame, and the object's shift along the rays in m; and the covariance (4F, 4F) of the lamps' unknowns,
    log intensities first, then all x, all y and all z."""

    log_intensity: FloatArray
    lamp_offset_m: FloatArray
    shift_m: float
    covariance: FloatArray

    @classmethod
    def nominal(cls, count: int) -> "SharedParameters":
        """Nothing is known but what the calibration says of `count` lamps."""
        return cls(np.zeros(count), np.zeros((count, 3)), 0.0, np.zeros((4 * count, 4 * count)))

    def lamps(self, nominal: Float32Array) -> Float32Array:
        """Lamps (F, 6) that are said to be `told`, where they are."""
        moved = nominal.copy()
        moved[:, :3] += self.lamp_offset_m
        return moved


@dataclass(frozen=True)
class Priors:
    """1 σ of log intensities, of lamps' positions along each axis in m, of the shift in m; zero holds an unknown."""

    intensity: float
    position_m: float
    shift_m: float


def gauss_newton_step(
    found: Estimate, derivative: Float32Array, values: Float32Array, lamp: Float32Array, present: SharedParameters,
    priors: Priors, offset_sigma_m: float, gloss: HighlightDerivatives | None = None,
) -> SharedParameters:  # fmt: skip
    """One Gauss–Newton step of the shared unknowns from estimates at K pixels: their changes, and the covariance after.

    `derivative` (∂s/∂Z) (F, 3, K), `values` (F, K), `lamp` (F, 6) as estimated with; what is `present` is already
    divided out of `values`, and in lamps and depth. Priors pull all towards zero; that of the intensities is widened by
    `evidence_maximised_sigma`. Of glossy pixels `values` are without highlights, and `gloss` has their derivatives.
    """
    count = len(values)
    enough = np.count_nonzero(found.weights > 0, axis=0) >= MIN_LIGHTS
    lobes = 0 if gloss is None else gloss.by_lobe.shape[1]
    others = np.concatenate([np.full(3 * count, priors.position_m), [priors.shift_m], [LOBE_LOG_SIGMA] * lobes])
    if np.count_nonzero(enough) < MIN_PIXELS:
        held = np.concatenate([np.full(count, priors.intensity), others[: 3 * count]])
        return replace(SharedParameters.nominal(count), covariance=np.diag(held**2))
    size = count + len(others)
    sums = np.zeros((size + 1, size + 1))
    nothing = np.zeros((count, 0, 0), np.float32)
    _normal_equations(
        found.light,
        derivative,
        position_derivative(found, lamp),
        np.ascontiguousarray(values, np.float32),
        found.g,
        found.offset_m,
        found.weights,
        nothing if gloss is None else np.ascontiguousarray(gloss.by_g, np.float32),
        nothing if gloss is None else np.ascontiguousarray(gloss.by_lobe, np.float32),
        enough,
        offset_sigma_m,
        sums,
    )
    matrix, right = sums[:-1, :-1] / EFFECTIVE_SAMPLE_DIVISOR, sums[:-1, -1] / EFFECTIVE_SAMPLE_DIVISOR
    before = np.concatenate(
        [present.log_intensity, present.lamp_offset_m.T.ravel(), [present.shift_m], np.zeros(lobes)]
    )
    intensity_sigma = priors.intensity
    if intensity_sigma > 0:
        intensity_sigma = evidence_maximised_sigma(matrix, right + matrix @ before, _precision(others), intensity_sigma)
    held = np.concatenate([np.full(count, intensity_sigma), others])
    prior = _precision(held)
    covariance = np.asarray(np.linalg.inv(matrix + np.diag(prior)), np.float64)
    change = covariance @ (right - prior * np.where(held > 0, before, 0.0))
    return SharedParameters(
        log_intensity=change[:count],
        lamp_offset_m=change[count : 4 * count].reshape(3, count).T,
        shift_m=float(change[4 * count]),
        covariance=covariance[: 4 * count, : 4 * count],
    )


def position_derivative(found: Estimate, lamp: Float32Array) -> Float32Array:
    """How values (F, 3, K) change with their lamps' positions, per m; lamps (F, 6) go on looking at the object."""
    away = lamp[:, :3, None] - found.point
    square = np.sum(away * away, axis=1, keepdims=True)
    strength = np.sqrt(np.sum(found.light**2, axis=1, keepdims=True) / square)
    along = np.einsum("fck,ck->fk", away, found.g)[:, None]
    return np.ascontiguousarray(strength * (found.g - 3 * away * along / square), np.float32)


def evidence_maximised_sigma(matrix: FloatArray, right: FloatArray, others: FloatArray, stated: float) -> float:
    """1 σ of the intensities: `stated`, unless the images make a larger one much likelier.

    The images' normal equations `matrix` x = `right` are in the log intensities (F,) and then the other shared unknowns
    (M,), of which the prior has precision `others` (M,). These are integrated out, and so are the intensities, for each
    σ (MacKay 1992, Bayesian interpolation: the evidence). What images cannot tell, the scale of all intensities and the
    tilt of a plane, so tells nothing of σ either.
    """
    count = len(right) - len(others)
    across, last = matrix[:count, count:], matrix[count:, count:] + np.diag(others)
    own = matrix[:count, :count] - across @ np.linalg.solve(last, across.T)
    told = right[:count] - across @ np.linalg.solve(last, right[count:])
    precision, axes = np.linalg.eigh((own + own.T) / 2)
    precision = np.maximum(precision, 0)
    times = np.geomspace(1, MAX_SIGMA_SCALE, 21)
    variance = (times[:, None] * stated) ** 2
    gained = (axes.T @ told) ** 2 / (precision + 1 / variance) - np.log1p(precision * variance)
    evidence = (np.sum(gained, axis=1) - (np.log(times) / LOG_SCALE_SIGMA) ** 2) / 2
    best = int(np.argmax(evidence))
    return stated * float(times[best]) if evidence[best] > evidence[0] + MIN_LOG_BAYES_FACTOR else stated


def _precision(sigma: FloatArray) -> FloatArray:
    """Of priors; zero holds an unknown."""
    return np.where(sigma > 0, 1.0 / np.maximum(sigma, 1e-12) ** 2, 1e18)


def normal_variance(found: Estimate, lamp: Float32Array, covariance: FloatArray) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, from errors of the lamps (F, 6) that all pixels
    share, with `covariance` (4F, 4F) as in `SharedParameters`."""
    kinds = [np.einsum("fcn,cn->fn", found.light, found.g), *position_derivative(found, lamp).transpose(1, 0, 2)]
    right = [np.einsum("fn,fan->naf", found.weights * kind, found.light) for kind in kinds]
    moved = pixel_solve.normal_perturbation(found, np.concatenate(right, axis=2).astype(np.float64))
    return np.einsum("naf,fg,nag->n", moved, covariance, moved, optimize=True).astype(np.float32)


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[::1],"
    " float32[:,::1], float32[:,:,::1], float32[:,:,::1], boolean[::1], float64, float64[:,::1])",
    cache=True,
    fastmath=True,
    error_model="numpy",
)
def _normal_equations(  # noqa: PLR0912 - one fused kernel is the point
    light: Float32Array,  # (F, 3, K)
    derivative: Float32Array,  # (F, 3, K)
    aside: Float32Array,  # (F, 3, K) of values by the lamps' positions
    values: Float32Array,  # (F, K)
    g: Float32Array,  # (3, K)
    offset_m: Float32Array,  # (K,)
    weights: Float32Array,  # (F, K)
    by_g: Float32Array,  # (F, 3, K), or empty without a lobe
    by_lobe: Float32Array,  # (F, L, K)
    enough: BoolArray,  # (K,): the pixels that count
    offset_sigma_m: float,
    sums: FloatArray,  # (M + 1, M + 1), M = 4F + 1 + L: intensities, positions along x, y, z, shift, lobe; residuals
) -> None:
    """Adds up the normal equations of the shared unknowns, from which each pixel's own are eliminated.

    With a pixel's whitened rows O (F, 4) of its own unknowns and C (F, M + 1) of the shared ones and, last, of the
    residuals, these are CᵀC − CᵀO (OᵀO + prior)⁻¹ OᵀC, where the offset's pull towards its prior's zero is taken from
    the residuals' OᵀC. Only its own row has anything in a lamp's columns, so that CᵀC is kept lamp by lamp until the
    end.
    """
    count, lobes, size = light.shape[0], by_lobe.shape[1], len(sums)
    lamps, wide = 4 * count, 6 + lobes  # columns of the lamps; columns of one of them, and those of all
    own, inner = np.empty((4, count)), np.empty((4, 4))
    columns, by_lamp = np.empty((wide, count)), np.zeros((wide, wide, count))
    across = np.empty((4, size))
    for p in range(light.shape[2]):
        if not enough[p]:
            continue
        offset = np.float64(offset_m[p])
        for f in range(count):
            root = np.sqrt(np.float64(weights[f, p]))
            slope, direct = 0.0, 0.0
            for c in range(3):
                slope += derivative[f, c, p] * np.float64(g[c, p])
                direct += light[f, c, p] * np.float64(g[c, p])
                bent = light[f, c, p] + derivative[f, c, p] * offset
                own[c, f] = root * (bent + by_g[f, c, p] if lobes else bent)
                columns[1 + c, f] = root * aside[f, c, p]
            direct += slope * offset
            columns[0, f] = root * (direct + by_lobe[f, 0, p] if lobes else direct)
            own[3, f] = columns[4, f] = root * slope
            for one in range(lobes):
                columns[5 + one, f] = root * by_lobe[f, one, p]
            columns[wide - 1, f] = root * (values[f, p] - direct)
        for a in range(wide):
            for b in range(wide):
                for f in range(count):
                    by_lamp[a, b, f] += columns[a, f] * columns[b, f]
        for i in range(4):
            for j in range(i + 1):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * own[j, f]
                inner[i, j] = total
            inner[i, i] += 1e-6 if i < 3 else offset_sigma_m**-2
        pixel_solve_kernels.cholesky(inner)
        pixel_solve_kernels.forward_substitution(inner, own)
        for i in range(4):
            for a in range(4):
                for f in range(count):
                    across[i, a * count + f] = own[i, f] * columns[a, f]
            for a in range(4, wide):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * columns[a, f]
                across[i, lamps + a - 4] = total
        across[3, size - 1] -= offset * offset_sigma_m**-2 / inner[3, 3]
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
                row = a * count + f if a < 4 else lamps + a - 4
                column = b * count + f if b < 4 else lamps + b - 4
                sums[row, column] += by_lamp[a, b, f]


KERNELS = (_normal_equations,)
