"""Classification of measurements for the result: lit, attached or cast shadow, saturated, highlight.

Kernels compile at import, into numba's cache.
"""

import numba
import numpy as np

from acquisition import photometry
from acquisition.image_values import Noise
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED, SolveSettings
from acquisition.normals.pixels.pixel_solve import Estimate

ATTACHED_COSINE = SolveSettings().shadow_threshold
"""Predicted cosine to the light below which a dark measurement is in attached shadow, or as dark as in one. It is the
share of the peak below which the solver uses no measurement."""


def classify(
    estimate: Estimate, measured: Float32Array, indirect: Float32Array, clipped: BoolArray, noise: Noise
) -> np.ndarray:
    """Classifies each measurement by thresholds on the solution's prediction: bit fields (F, N). `measured` (F, N) are
    values under nominal lamps. Neither predicted `indirect` light (F, N) nor its uncertainty counts as highlight."""
    flags, shared = np.empty(measured.shape, np.uint8), photometry.SETTINGS
    _classify(
        estimate.light,
        estimate.g,
        np.zeros((0, 0), np.float32) if estimate.terms is None else np.ascontiguousarray(estimate.terms.value),
        np.ascontiguousarray(measured),
        np.ascontiguousarray(indirect),
        estimate.usable,
        np.ascontiguousarray(clipped),
        np.sqrt(noise.shot).astype(np.float32),
        np.sqrt(noise.floor).astype(np.float32),
        np.array([noise.intensity, noise.direction, shared.predicted_indirect_sigma], np.float32),
        shared.significant_deviations,
        flags,
    )
    return flags


@numba.njit(
    "void(float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1], boolean[:,::1],"
    " boolean[:,::1], float32[::1], float32[::1], float32[::1], float64, uint8[:,::1])",
    cache=True,
    parallel=True,
    error_model="numpy",
)
def _classify(  # noqa: PLR0913 - a numba kernel
    light: Float32Array,  # (F, 3, N)
    g: Float32Array,  # (3, N)
    terms: Float32Array,  # (F, N) values beside Lambert's, or empty
    measured: Float32Array,  # (F, N)
    indirect: Float32Array,  # (F, N)
    usable: BoolArray,  # (F, N)
    clipped: BoolArray,  # (F, N)
    shot_sigma: Float32Array,  # (F,) 1 σ of y = 1
    floor_sigma: Float32Array,  # (F,)
    shares: Float32Array,  # noise c of y, σ_d of ρ|s|, and of indirect light
    highlight_deviations: float,  # σ above the prediction
    flags: np.ndarray,  # (F, N) uint8
) -> None:
    """Writes the bit fields of all measurements into `flags`."""
    for n in numba.prange(measured.shape[1]):
        gx, gy, gz = g[0, n], g[1, n], g[2, n]
        albedo = np.sqrt(gx * gx + gy * gy + gz * gz)
        for f in range(len(measured)):
            sx, sy, sz = light[f, 0, n], light[f, 1, n], light[f, 2, n]
            predicted = sx * gx + sy * gy + sz * gz + (terms[f, n] if len(terms) else np.float32(0))
            strength = np.sqrt(sx * sx + sy * sy + sz * sz) * albedo
            if clipped[f, n]:
                flags[f, n] = SATURATED
            elif not usable[f, n]:
                flags[f, n] = ATTACHED if predicted < np.float32(ATTACHED_COSINE) * strength else CAST
            else:
                spread = (
                    shot_sigma[f] * np.sqrt(max(predicted, np.float32(0)))
                    + floor_sigma[f]
                    + shares[0] * abs(predicted)
                    + shares[1] * strength
                    + shares[2] * indirect[f, n]
                )
                excess = measured[f, n] - indirect[f, n] - predicted
                flags[f, n] = LIT + HIGHLIGHT if excess > np.float32(highlight_deviations) * spread else LIT


KERNELS = (_classify,)
