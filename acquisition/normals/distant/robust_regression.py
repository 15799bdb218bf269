"""Robust regression per pixel: iteratively reweighted least squares (IRLS) with Cauchy weights.

IRLS from least squares of all measurements starts biased by the outliers that it should reject. With few lights it
starts from the triple of measurements with the least truncated absolute error over the others; with many, from least
squares over the middle ranks, which omits shadows and highlights (position thresholds, Shi et al., TPAMI 2014).
"""

from dataclasses import dataclass
from itertools import combinations

import numba
import numpy as np

from acquisition.models.base import Float32Array, FloatArray
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class RobustRegressionSettings:
    """Tuned numbers of the robust regression."""

    position_thresholds: tuple[float, float] = tuned((0.25, 0.7), "rank")
    """Ranks, as shares of the lights, between which measurements count at the start; asymmetric, because highlights
    reach further down than shadows reach up."""
    min_position_threshold_lights: int = tuned(20, "lights")
    """Lights from which the start is the middle ranks, below which it is the best triple."""
    cauchy_scale: float = tuned(2.0, "σ")
    """Scale of the Cauchy weight, in units of the residuals' robust spread (1.4826 MAD). At 2.385, the scale of 95 %
    efficiency on Gaussian noise, errors are 1.02 times as large on the scenes of `few_light_scenes`: residuals are of
    shadows and gloss more than of noise."""
    min_spread: float = tuned(3e-3, "of the mean")
    """Least spread of the residuals, as a share of the mean or median of the pixel's usable values."""


SETTINGS = RobustRegressionSettings()

MAX_TRIPLES = 40
"""Triples that are tried at most."""

MAX_ITERATIONS = 12
"""IRLS iterations at most."""

MIN_SPREAD = SETTINGS.min_spread


def triples(light: FloatArray) -> tuple[np.ndarray, FloatArray]:
    """Selects at most `max_triples` triples (T, 3) of lights (F, 3) with large volume; and their inverses (T, 3, 3)."""
    every = np.array(list(combinations(range(len(light)), 3)))
    volume = np.abs(np.linalg.det(light[every]))
    kept = every[volume > 0.3 * volume.max()]
    chosen = kept[np.linspace(0, len(kept) - 1, min(MAX_TRIPLES, len(kept))).astype(int)]
    inverses = np.linalg.inv(light[chosen])
    return chosen.astype(np.int64), np.ascontiguousarray(inverses, dtype=np.float64)


@numba.njit("boolean(float64[::1], float64[::1], float64[::1])", cache=True, error_model="numpy")
def _solve3(m: FloatArray, b: FloatArray, g: FloatArray) -> bool:
    """Solves one symmetric 3 × 3 system m g = b (00 01 02 11 12 22) by its adjugate; false where it is singular."""
    c00 = m[3] * m[5] - m[4] * m[4]
    c01 = m[2] * m[4] - m[1] * m[5]
    c02 = m[1] * m[4] - m[2] * m[3]
    determinant = m[0] * c00 + m[1] * c01 + m[2] * c02
    if not determinant > 1e-9 * (m[0] + m[3] + m[5]) ** 3:
        return False
    c11 = m[0] * m[5] - m[2] * m[2]
    c12 = m[1] * m[2] - m[0] * m[4]
    c22 = m[0] * m[3] - m[1] * m[1]
    g[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / determinant
    g[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / determinant
    g[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / determinant
    return True


@numba.njit(
    "void(float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1])", cache=True, error_model="numpy"
)
def _normal_equations(y: FloatArray, w: FloatArray, light: FloatArray, m: FloatArray, b: FloatArray) -> None:
    """Accumulates weighted normal equations: m = SᵀWS (00 01 02 11 12 22), b = SᵀWy."""
    m[:] = 0.0
    b[:] = 0.0
    for f in range(len(y)):
        x, v, z = light[f, 0] * w[f], light[f, 1] * w[f], light[f, 2] * w[f]
        m[0] += x * light[f, 0]
        m[1] += x * light[f, 1]
        m[2] += x * light[f, 2]
        m[3] += v * light[f, 1]
        m[4] += v * light[f, 2]
        m[5] += z * light[f, 2]
        b[0] += x * y[f]
        b[1] += v * y[f]
        b[2] += z * y[f]


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float64[:,::1], int64[:,::1], float64[:,:,::1], float64[::1],"
    " float32[:,::1], float32[:,::1], int64)",
    cache=True, error_model="numpy",
)  # fmt: skip
def _solve_pixel(  # noqa: PLR0912, PLR0915 - one fused kernel is the point
    values: Float32Array,  # (N, F)
    usable: Float32Array,  # (N, F) weights 0–1; 0: clipped or in shadow
    light: FloatArray,  # (F, 3) unit directions
    lit_triples: np.ndarray,  # (T, 3); none: start from the middle ranks
    inverses: FloatArray,  # (T, 3, 3)
    settings: FloatArray,  # low rank, high rank, Cauchy scale (0: no IRLS), iterations
    scaled_normals: Float32Array,  # (N, 3) out: albedo × normal
    statistics: Float32Array,  # (N, 2) out: variance of one measurement; trace of the tangential part of (SᵀWS)⁻¹
    p: int,
) -> None:
    """Robust regression of pixel p, see `solve`."""
    size = values.shape[1]
    low, high, cauchy, rounds = settings[0], settings[1], settings[2], int(settings[3])
    y = np.empty(size)
    w = np.empty(size)
    residual = np.empty(size)
    m = np.empty(6)
    b = np.empty(3)
    g = np.zeros(3)
    trial = np.zeros(3)
    used = 0
    bright = 0.0
    share = 0.0
    for f in range(size):
        y[f] = values[p, f]
        bright += y[f] * usable[p, f]
        share += usable[p, f]
        used += 1 if usable[p, f] > 0 else 0
    bright /= max(share, 1e-12)
    good = False
    if len(lit_triples) > 0:
        best = 1e30
        for t in range(len(lit_triples)):
            i, j, k = lit_triples[t, 0], lit_triples[t, 1], lit_triples[t, 2]
            if min(usable[p, i], usable[p, j], usable[p, k]) < 0.5:
                continue
            for a in range(3):
                trial[a] = inverses[t, a, 0] * y[i] + inverses[t, a, 1] * y[j] + inverses[t, a, 2] * y[k]
            score = 0.0
            for f in range(size):
                r = y[f] - (trial[0] * light[f, 0] + trial[1] * light[f, 1] + trial[2] * light[f, 2])
                score += min(abs(r), 0.2 * bright) * usable[p, f]
            if score < best:
                best = score
                g[:] = trial
                good = True
    else:
        ordered = np.sort(y)
        darkest = ordered[int(low * size)]
        brightest = ordered[int(high * size)] if high < 1.0 else 1e30
        for f in range(size):
            w[f] = usable[p, f] if darkest <= y[f] < brightest else 0.0
        _normal_equations(y, w, light, m, b)
        good = _solve3(m, b, g)
    if not good:
        for f in range(size):
            w[f] = usable[p, f]
        _normal_equations(y, w, light, m, b)
        good = _solve3(m, b, g)
    spread = MIN_SPREAD * bright
    if good and cauchy > 0:
        for iteration in range(rounds):
            count = 0
            for f in range(size):
                residual[f] = y[f] - (g[0] * light[f, 0] + g[1] * light[f, 1] + g[2] * light[f, 2])
            if iteration < 4:
                absolute = np.empty(used)
                for f in range(size):
                    if usable[p, f] > 0:
                        absolute[count] = abs(residual[f])
                        count += 1
                # Three of the residuals' degrees of freedom are gone, which shows with few lights.
                middle = np.sort(absolute)[used // 2] * 1.4826 * np.sqrt(used / max(used - 3.0, 1.0))
                spread = max(middle, MIN_SPREAD * bright)
            for f in range(size):
                w[f] = usable[p, f] / (1.0 + (residual[f] / (cauchy * spread)) ** 2)
            _normal_equations(y, w, light, m, b)
            if not _solve3(m, b, trial):
                break
            change = abs(trial[0] - g[0]) + abs(trial[1] - g[1]) + abs(trial[2] - g[2])
            g[:] = trial
            if iteration >= 4 and change < 1e-5 * bright:
                break
    squared = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
    for a in range(3):
        scaled_normals[p, a] = g[a] if good else 0.0
    leverage = 1e3
    if good and squared > 0:
        # Trace of m⁻¹ less its part along g, from the adjugate
        c00, c11, c22 = m[3] * m[5] - m[4] * m[4], m[0] * m[5] - m[2] * m[2], m[0] * m[3] - m[1] * m[1]
        c01, c02, c12 = m[2] * m[4] - m[1] * m[5], m[1] * m[4] - m[2] * m[3], m[1] * m[2] - m[0] * m[4]
        inner = c00 * g[0] ** 2 + c11 * g[1] ** 2 + c22 * g[2] ** 2
        inner += 2 * (c01 * g[0] * g[1] + c02 * g[0] * g[2] + c12 * g[1] * g[2])
        leverage = (c00 + c11 + c22 - inner / squared) / (m[0] * c00 + m[1] * c01 + m[2] * c02)
    statistics[p, 0] = spread * spread
    statistics[p, 1] = leverage


@numba.njit(
    "void(float32[:,::1], float32[:,::1], float64[:,::1], int64[:,::1], float64[:,:,::1], float64[::1],"
    " float32[:,::1], float32[:,::1])",
    cache=True, parallel=True, error_model="numpy",
)  # fmt: skip
def solve(
    values: Float32Array,  # (N, F)
    usable: Float32Array,  # (N, F) weights 0–1; 0: clipped or in shadow
    light: FloatArray,  # (F, 3) unit directions
    lit_triples: np.ndarray,  # (T, 3); none: start from the middle ranks
    inverses: FloatArray,  # (T, 3, 3)
    settings: FloatArray,  # low rank, high rank, Cauchy scale (0: no IRLS), iterations
    scaled_normals: Float32Array,  # (N, 3) out: albedo × normal
    statistics: Float32Array,  # (N, 2) out: variance of one measurement; trace of the tangential part of (SᵀWS)⁻¹
) -> None:
    """Cauchy-weighted IRLS of all pixels in parallel; zero where usable lights do not span space."""
    for p in numba.prange(values.shape[0]):
        _solve_pixel(values, usable, light, lit_triples, inverses, settings, scaled_normals, statistics, p)


KERNELS = (_solve3, _normal_equations, _solve_pixel, solve)
