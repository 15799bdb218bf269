"""Compiled inner loops of the planner: covariances and rank-one scan.

Symmetric 4 × 4 matrices are held as their ten upper entries, pixels last, in the order 00 01 02 03 11 12 13 22 23 33.
Kernels compile at import, into numba's cache.
"""

from typing import Any

import numba
import numpy as np

from acquisition.models.base import Float32Array, FloatArray

OPTIONS: dict[str, Any] = {"cache": True, "parallel": True, "fastmath": True, "error_model": "numpy"}

BLOCK = 256
"""Pixels of a block of work of one thread."""


@numba.njit(inline="always")
def _invert(m: FloatArray, p: int) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Inverse of the p-th positive definite matrix of (10, P): Schur complement of the depth, then 3 × 3 adjugate."""
    d = 1.0 / m[9, p]
    e0, e1, e2 = m[3, p] * d, m[6, p] * d, m[8, p] * d
    a00 = m[0, p] - e0 * m[3, p]
    a01 = m[1, p] - e0 * m[6, p]
    a02 = m[2, p] - e0 * m[8, p]
    a11 = m[4, p] - e1 * m[6, p]
    a12 = m[5, p] - e1 * m[8, p]
    a22 = m[7, p] - e2 * m[8, p]
    k00 = a11 * a22 - a12 * a12
    k01 = a02 * a12 - a01 * a22
    k02 = a01 * a12 - a02 * a11
    inverse = 1.0 / (a00 * k00 + a01 * k01 + a02 * k02)
    c00, c01, c02 = k00 * inverse, k01 * inverse, k02 * inverse
    c11 = (a00 * a22 - a02 * a02) * inverse
    c12 = (a01 * a02 - a00 * a12) * inverse
    c22 = (a00 * a11 - a01 * a01) * inverse
    c03 = -(c00 * e0 + c01 * e1 + c02 * e2)
    c13 = -(c01 * e0 + c11 * e1 + c12 * e2)
    c23 = -(c02 * e0 + c12 * e1 + c22 * e2)
    return c00, c01, c02, c03, c11, c12, c13, c22, c23, d - (c03 * e0 + c13 * e1 + c23 * e2)


@numba.njit(
    "void(float64[:,::1], float32[:,:,::1], float32[:,::1], float64[::1], float32[::1], float32[:,::1], float32[::1],"
    " float32[:,:,::1], float64[:,::1], float32[:,::1])",
    **OPTIONS,
)
def posterior(
    prior: FloatArray,  # (10, P) information of (g, ζ) before
    row: Float32Array,  # (K, 4, P)
    visibility: Float32Array,  # (K, P)
    weight: FloatArray,  # (K,) how often each light is added; mostly 1
    level: Float32Array,  # (S,)
    normal: Float32Array,  # (3, P)
    inverse_albedo2: Float32Array,  # (P,)
    covariance: Float32Array,  # out (S, 10, P)
    variance: FloatArray,  # out (S, P) rad²
    lit: Float32Array,  # out (S, P) weight of the lights that are seen
) -> None:
    """Posterior covariance and angular variance after adding weighted lights, in all visibility scenarios."""
    scenarios, pixels = len(level), prior.shape[1]
    blocks = (pixels + BLOCK - 1) // BLOCK
    for task in numba.prange(scenarios * blocks):
        s = task // blocks
        start = (task % blocks) * BLOCK
        size = min(BLOCK, pixels - start)
        m, count = np.empty((10, size)), np.zeros(size)
        for i in range(10):
            for p in range(size):
                m[i, p] = prior[i, start + p]
        for k in range(row.shape[0]):
            for p in range(size):
                n = start + p
                w = weight[k] if visibility[k, n] > level[s] else 0.0
                count[p] += w
                a0, a1, a2, a3 = row[k, 0, n], row[k, 1, n], row[k, 2, n], row[k, 3, n]
                m[0, p] += w * a0 * a0
                m[1, p] += w * a0 * a1
                m[2, p] += w * a0 * a2
                m[3, p] += w * a0 * a3
                m[4, p] += w * a1 * a1
                m[5, p] += w * a1 * a2
                m[6, p] += w * a1 * a3
                m[7, p] += w * a2 * a2
                m[8, p] += w * a2 * a3
                m[9, p] += w * a3 * a3
        for p in range(size):
            n = start + p
            c00, c01, c02, c03, c11, c12, c13, c22, c23, c33 = _invert(m, p)
            x, y, z = normal[0, n], normal[1, n], normal[2, n]
            inner = c00 * x * x + c11 * y * y + c22 * z * z + 2.0 * (c01 * x * y + c02 * x * z + c12 * y * z)
            variance[s, n] = max(c00 + c11 + c22 - inner, 1e-12) * inverse_albedo2[n]
            lit[s, n] = count[p]
            for i, entry in enumerate((c00, c01, c02, c03, c11, c12, c13, c22, c23, c33)):
                covariance[s, i, n] = entry


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[::1],"
    " float32[::1], boolean, float64[::1])",
    **OPTIONS,
)
def scan(
    covariance: Float32Array,  # (S, 10, P)
    variance: Float32Array,  # (S, P) rad²
    row: Float32Array,  # (K, 4, P)
    visibility: Float32Array,  # (K, P)
    normal: Float32Array,  # (3, P)
    inverse_albedo2: Float32Array,  # (P,)
    level: Float32Array,  # (S,)
    slope: bool,
    out: FloatArray,  # (K,)
) -> None:
    """Rank-one (Sherman–Morrison) update: the mean σ with each candidate added in turn; or, for `slope`, its gradient
    in each one's design weight, −mean |P C a|²/(2 ρ² σ)."""
    scenarios, pixels = variance.shape
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    for k in numba.prange(row.shape[0]):
        total = 0.0
        for s in range(scenarios):
            c, part = covariance[s], zero
            for p in range(pixels):
                a0, a1, a2, a3 = row[k, 0, p], row[k, 1, p], row[k, 2, p], row[k, 3, p]
                u0 = c[0, p] * a0 + c[1, p] * a1 + c[2, p] * a2 + c[3, p] * a3
                u1 = c[1, p] * a0 + c[4, p] * a1 + c[5, p] * a2 + c[6, p] * a3
                u2 = c[2, p] * a0 + c[5, p] * a1 + c[7, p] * a2 + c[8, p] * a3
                u3 = c[3, p] * a0 + c[6, p] * a1 + c[8, p] * a2 + c[9, p] * a3
                along = normal[0, p] * u0 + normal[1, p] * u1 + normal[2, p] * u2
                seen = one if visibility[k, p] > level[s] else zero
                gain = (u0 * u0 + u1 * u1 + u2 * u2 - along * along) * inverse_albedo2[p] * seen
                if slope:
                    part -= half * gain / np.sqrt(variance[s, p])
                else:
                    part += np.sqrt(max(variance[s, p] - gain / (one + a0 * u0 + a1 * u1 + a2 * u2 + a3 * u3), zero))
            total += part
        out[k] = total / (scenarios * pixels)


KERNELS = (posterior, scan)
