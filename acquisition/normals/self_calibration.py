"""What all pixels of a capture know together: each lamp's intensity and place, and how far away the object is.

Each pixel with more than four usable lights has measurements to spare. Its own unknowns (albedo × normal and a depth
offset) are projected out; what is left is linear in the few unknowns that all pixels share. The depth column in the
projection keeps wrong depth at steps from being taken for wrong intensities. Model errors of neighbouring pixels go
together, so the pixels' evidence is divided by `CORRELATED` before it meets the priors.

A lamp that stands a millimetre aside turns all normals, and without an unknown of its own what it does is put down to
intensities. Errors of smooth objects fall by a twentieth with one, and those of unlucky draws by a fifth.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass, replace

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
    """What all pixels share: log intensity per image (F,), how far each lamp is from where it is said to be (F, 3) in
    m, view frame, and the object's shift along the rays in m; and the covariance (4F, 4F) of the lamps' unknowns,
    log intensities first, then all x, all y and all z."""

    log_intensity: FloatArray
    aside_m: FloatArray
    shift_m: float
    covariance: FloatArray

    @classmethod
    def as_told(cls, count: int) -> "Shared":
        """Nothing is known but what the calibration says of `count` lamps."""
        return cls(np.zeros(count), np.zeros((count, 3)), 0.0, np.zeros((4 * count, 4 * count)))

    def lamps(self, told: Float32Array) -> Float32Array:
        """Lamps (F, 6) that are said to be `told`, where they are."""
        moved = told.copy()
        moved[:, :3] += self.aside_m
        return moved


@dataclass(frozen=True)
class Priors:
    """1 σ of log intensities, of lamps' positions along each axis in m, of the shift in m; zero holds an unknown."""

    intensity: float
    position_m: float
    shift_m: float


def step(
    found: Estimate, derivative: Float32Array, values: Float32Array, lamp: Float32Array, present: Shared,
    priors: Priors, offset_sigma_m: float, gloss: Change | None = None,
) -> Shared:  # fmt: skip
    """One Gauss–Newton step of the shared unknowns from estimates at K pixels: their changes, and the covariance after.

    `derivative` (∂s/∂Z) (F, 3, K), `values` (F, K), `lamp` (F, 6) as estimated with; what is `present` is already
    divided out of `values`, and in lamps and depth. Priors pull all towards zero, that of intensities as wide as the
    images make likely (`likely`). Of glossy pixels `values` are without highlights, and `gloss` tells how these change.
    """
    count = len(values)
    enough = np.count_nonzero(found.weights > 0, axis=0) >= LEAST_LIGHTS
    lobes = 0 if gloss is None else gloss.by_lobe.shape[1]
    others = np.concatenate([np.full(3 * count, priors.position_m), [priors.shift_m], [LOBE_SIGMA] * lobes])
    if np.count_nonzero(enough) < LEAST_PIXELS:
        held = np.concatenate([np.full(count, priors.intensity), others[: 3 * count]])
        return replace(Shared.as_told(count), covariance=np.diag(held**2))
    size = count + len(others)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    nothing = np.zeros((count, 0, 0), np.float32)
    _normal_equations(
        found.light,
        derivative,
        by_position(found, lamp),
        np.ascontiguousarray(values, np.float32),
        found.g,
        found.offset_m,
        found.weights,
        nothing if gloss is None else np.ascontiguousarray(gloss.by_g, np.float32),
        nothing if gloss is None else np.ascontiguousarray(gloss.by_lobe, np.float32),
        enough,
        offset_sigma_m,
        matrix,
        right,
    )
    matrix, right = matrix / CORRELATED, right / CORRELATED
    before = np.concatenate([present.log_intensity, present.aside_m.T.ravel(), [present.shift_m], np.zeros(lobes)])
    intensity_sigma = priors.intensity
    if intensity_sigma > 0:
        intensity_sigma = likely(matrix, right + matrix @ before, _precision(others), intensity_sigma)
    held = np.concatenate([np.full(count, intensity_sigma), others])
    prior = _precision(held)
    covariance = np.asarray(np.linalg.inv(matrix + np.diag(prior)), np.float64)
    change = covariance @ (right - prior * np.where(held > 0, before, 0.0))
    return Shared(
        log_intensity=change[:count],
        aside_m=change[count : 4 * count].reshape(3, count).T,
        shift_m=float(change[4 * count]),
        covariance=covariance[: 4 * count, : 4 * count],
    )


def by_position(found: Estimate, lamp: Float32Array) -> Float32Array:
    """How values (F, 3, K) change with their lamps' positions, per m; lamps (F, 6) go on looking at the object."""
    away = lamp[:, :3, None] - found.point
    square = np.sum(away * away, axis=1, keepdims=True)
    strength = np.sqrt(np.sum(found.light**2, axis=1, keepdims=True) / square)
    along = np.einsum("fck,ck->fk", away, found.g)[:, None]
    return np.ascontiguousarray(strength * (found.g - 3 * away * along / square), np.float32)


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


def spread(found: Estimate, lamp: Float32Array, covariance: FloatArray) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, from errors of the lamps (F, 6) that all pixels
    share, with `covariance` (4F, 4F) as in `Shared`."""
    kinds = [np.einsum("fcn,cn->fn", found.light, found.g), *by_position(found, lamp).transpose(1, 0, 2)]
    right = [np.einsum("fn,fan->naf", found.weights * kind, found.light) for kind in kinds]
    moved = lambert.turned(found, np.concatenate(right, axis=2).astype(np.float64))
    return np.einsum("naf,fg,nag->n", moved, covariance, moved, optimize=True).astype(np.float32)


@numba.njit(
    "void(float32[:,:,::1], float32[:,:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[::1],"
    " float32[:,::1], float32[:,:,::1], float32[:,:,::1], boolean[::1], float64, float64[:,::1], float64[::1])",
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
    matrix: FloatArray,  # (M, M), M = 4F + 1 + L: intensities, positions along x, y, z, shift, lobe
    right: FloatArray,  # (M,)
) -> None:
    """Adds up the normal equations of the shared unknowns, from which each pixel's own are eliminated.

    With a pixel's whitened rows O (F, 4) of its own unknowns, C (F, M) of the shared ones and residuals r, these are
    CᵀC − CᵀO (OᵀO + prior)⁻¹ OᵀC and Cᵀr − CᵀO (OᵀO + prior)⁻¹ (Oᵀr − the offset's pull towards its prior's zero).
    Only its own row has anything in a lamp's column.
    """
    count, lobes = light.shape[0], by_lobe.shape[1]
    lamps = 4 * count
    size = lamps + 1 + lobes
    own, inner = np.empty((4, count)), np.empty((4, 4))
    columns, across = np.empty((lobes + 2, count)), np.empty((4, size + 1))  # the last column is r
    single = np.empty(lamps)
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
            single[f] = root * (direct + by_lobe[f, 0, p] if lobes else direct)
            for c in range(3):
                single[(c + 1) * count + f] = root * aside[f, c, p]
        for i in range(4):
            for j in range(i + 1):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * own[j, f]
                inner[i, j] = total
            inner[i, i] += 1e-6 if i < 3 else offset_sigma_m**-2
            for a in range(lamps):
                across[i, a] = own[i, a % count] * single[a]
            for one in range(lobes + 2):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * columns[one, f]
                across[i, lamps + one] = total
        across[3, size] -= offset * offset_sigma_m**-2
        kernels.cholesky(inner)
        kernels.forward(inner, across)
        for a in range(size):
            for b in range(a, size + 1):
                if b < lamps:
                    total = single[a] * single[b] if a % count == b % count else 0.0
                elif a < lamps:
                    total = single[a] * columns[b - lamps, a % count]
                else:
                    total = 0.0
                    for f in range(count):
                        total += columns[a - lamps, f] * columns[b - lamps, f]
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
