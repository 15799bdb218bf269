"""What all pixels of a capture know together: one intensity factor per image, and how far away the object is.

Each pixel with more than four usable lights has measurements to spare. Its own unknowns (albedo × normal and a depth
offset) are projected out; what is left is linear in the few unknowns that all pixels share. The depth column in the
projection keeps wrong depth at steps from being taken for wrong intensities. Model errors of neighbouring pixels go
together, so the pixels' evidence is divided by `CORRELATED` before it meets the priors.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np

from acquisition.normals import kernels, lambert
from acquisition.normals.lambert import Estimate
from acquisition.normals.lobe import Change
from acquisition.types import BoolArray, Float32Array, FloatArray

CORRELATED = 20.0
"""Pixels whose model errors go together, errors of the lamps' positions included, which all pixels of an image share:
with 10 the object's shift came out wrong by up to 8 mm where few lights tell it, with 30 steps are calibrated worse."""

LOBE_SIGMA = 0.5
"""1 σ of the logarithms of a lobe's strength and exponent."""

LARGEST, DOUBT = 4.0, 0.6
"""What lamps are said to be is believed until the images say that they are worse: LARGEST times at most, with 1 σ of
the logarithm of that factor before the images speak."""

DECISIVE = 3.0
"""Log evidence from which images that speak of worse lamps are believed."""

LEAST_LIGHTS = 4
LEAST_PIXELS = 50


@dataclass(frozen=True)
class Shared:
    """A step of the shared unknowns: log intensity per image (F,) and the object's shift along the rays, m; and the
    covariance (F, F) of the log intensities after it."""

    log_intensity: FloatArray
    shift_m: float
    covariance: FloatArray


def step(
    light: Float32Array,
    derivative: Float32Array,
    values: Float32Array,
    g: Float32Array,
    offset_m: Float32Array,
    weights: Float32Array,
    log_intensity: FloatArray,
    shift_m: float,
    intensity_sigma: float,
    shift_sigma_m: float,
    offset_sigma_m: float,
    gloss: Change | None = None,
) -> Shared:
    """One Gauss–Newton step from estimates at K pixels.

    `light`, `derivative` (∂s/∂Z) (F, 3, K), `values`, `weights` (F, K), `g` (3, K), `offset_m` (K,); the present
    `log_intensity` (already divided out of `values`) and `shift_m` (already in the depth) are pulled towards zero by
    their priors, that of the intensities as wide as the images make likely (`likely`). A σ of zero holds that unknown.
    Of glossy pixels `values` are without the highlight, and `gloss` tells how that changes.
    """
    count = len(values)
    enough = np.count_nonzero(weights > 0, axis=0) >= LEAST_LIGHTS
    if np.count_nonzero(enough) < LEAST_PIXELS:
        return Shared(np.zeros(count), 0.0, intensity_sigma**2 * np.eye(count))
    lobes = 0 if gloss is None else gloss.by_lobe.shape[1]
    matrix, right = np.zeros((count + 1 + lobes, count + 1 + lobes)), np.zeros(count + 1 + lobes)
    nothing = np.zeros((count, 0, 0), np.float32)
    _normal_equations(
        light,
        derivative,
        np.ascontiguousarray(values, np.float32),
        g,
        offset_m,
        weights,
        nothing if gloss is None else np.ascontiguousarray(gloss.by_g, np.float32),
        nothing if gloss is None else np.ascontiguousarray(gloss.by_lobe, np.float32),
        enough,
        offset_sigma_m,
        matrix,
        right,
    )
    matrix, right = matrix / CORRELATED, right / CORRELATED
    present = np.concatenate([log_intensity, [shift_m], np.zeros(lobes)])
    others = np.array([shift_sigma_m] + [LOBE_SIGMA] * lobes)
    if intensity_sigma > 0:
        intensity_sigma = likely(matrix, right + matrix @ present, _precision(others), intensity_sigma)
    held = np.concatenate([np.full(count, intensity_sigma), others])
    prior = _precision(held)
    covariance = np.asarray(np.linalg.inv(matrix + np.diag(prior)), np.float64)
    change = covariance @ (right - prior * np.where(held > 0, present, 0.0))
    return Shared(change[:count], float(change[count]), covariance[:count, :count])


def likely(matrix: FloatArray, right: FloatArray, others: FloatArray, stated: float) -> float:
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
    times = np.geomspace(1, LARGEST, 21)
    variance = (times[:, None] * stated) ** 2
    gained = (axes.T @ told) ** 2 / (precision + 1 / variance) - np.log1p(precision * variance)
    evidence = (np.sum(gained, axis=1) - (np.log(times) / DOUBT) ** 2) / 2
    best = int(np.argmax(evidence))
    return stated * float(times[best]) if evidence[best] > evidence[0] + DECISIVE else stated


def _precision(sigma: FloatArray) -> FloatArray:
    """Of priors; zero holds an unknown."""
    return np.where(sigma > 0, 1.0 / np.maximum(sigma, 1e-12) ** 2, 1e18)


def spread(found: Estimate, covariance: FloatArray) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, from errors of the log intensities that all
    pixels share, with `covariance` (F, F)."""
    shaded = found.weights * np.einsum("fcn,cn->fn", found.light, found.g)
    moved = lambert.turned(found, np.einsum("fn,fan->naf", shaded, found.light).astype(np.float64))
    return np.einsum("naf,fg,nag->n", moved, covariance, moved, optimize=True).astype(np.float32)


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[::1], float32[:,::1],"
    " float32[:,:,::1], float32[:,:,::1], boolean[::1], float64, float64[:,::1], float64[::1])",
    cache=True,
    fastmath=True,
    error_model="numpy",
)
def _normal_equations(  # noqa: PLR0912 - one fused kernel is the point
    light: Float32Array,  # (F, 3, K)
    derivative: Float32Array,  # (F, 3, K)
    values: Float32Array,  # (F, K)
    g: Float32Array,  # (3, K)
    offset_m: Float32Array,  # (K,)
    weights: Float32Array,  # (F, K)
    by_g: Float32Array,  # (F, 3, K), or empty without a lobe
    by_lobe: Float32Array,  # (F, L, K)
    enough: BoolArray,  # (K,): the pixels that count
    offset_sigma_m: float,
    matrix: FloatArray,  # (M, M), M = F + 1 + L
    right: FloatArray,  # (M,)
) -> None:
    """Adds up the normal equations of the shared unknowns, from which each pixel's own are eliminated.

    With a pixel's whitened rows O (F, 4) of its own unknowns, C (F, M) of the shared ones and residuals r, these are
    CᵀC − CᵀO (OᵀO + prior)⁻¹ OᵀC and Cᵀr − CᵀO (OᵀO + prior)⁻¹ (Oᵀr − the offset's pull towards its prior's zero).
    """
    count, lobes = light.shape[0], by_lobe.shape[1]
    size = count + 1 + lobes
    own, inner = np.empty((4, count)), np.empty((4, 4))
    columns, across = np.empty((lobes + 2, count)), np.empty((4, size + 1))  # the last column is r
    shaded = np.empty(count)
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
            direct += slope * offset
            own[3, f] = columns[0, f] = root * slope
            for one in range(lobes):
                columns[1 + one, f] = root * by_lobe[f, one, p]
            columns[lobes + 1, f] = root * (values[f, p] - direct)
            shaded[f] = root * (direct + by_lobe[f, 0, p] if lobes else direct)
        for i in range(4):
            for j in range(i + 1):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * own[j, f]
                inner[i, j] = total
            inner[i, i] += 1e-6 if i < 3 else offset_sigma_m**-2
            for f in range(count):
                across[i, f] = own[i, f] * shaded[f]
            for one in range(lobes + 2):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * columns[one, f]
                across[i, count + one] = total
        across[3, size] -= offset * offset_sigma_m**-2
        kernels.cholesky(inner)
        kernels.forward(inner, across)
        for a in range(size):
            for b in range(a, size + 1):
                if b < count:
                    total = shaded[a] * shaded[a] if a == b else 0.0
                elif a < count:
                    total = shaded[a] * columns[b - count, a]
                else:
                    total = 0.0
                    for f in range(count):
                        total += columns[a - count, f] * columns[b - count, f]
                for i in range(4):
                    total -= across[i, a] * across[i, b]
                if b < size:
                    matrix[a, b] += total
                else:
                    right[a] += total
    for a in range(size):
        for b in range(a):
            matrix[a, b] = matrix[b, a]


KERNELS = (_normal_equations,)
