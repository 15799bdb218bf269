"""Variance components of each pixel's normal: the posterior's, and errors of the model that no posterior knows of.

The posterior variance σ₀² falls with every image; errors that images share do not: light from surfaces that were not
predicted, a pixel that mixes two surfaces, a depth step. What tells is how badly the pixel's own images fit, and where
the surface is discontinuous:

    σ² = (A + B χ²) σ₀² + (C (1 − w))² + D² [fewer than four lights] + E² [something is wrong with the capture]

χ² is the mean square of the whitened residuals, pooled over 3 × 3 pixels, and w the continuity weight of the surface.
Smoothing over neighbours takes nothing from σ₀²: it lowers the error less than it claims. With fewer than four lights
no residual is left, so χ² says nothing. Further components (a sandwich estimate, predicted indirect light, gloss,
slant, the turn by the integrability projection) left the rms of e/σ between 1.7 and 1.8 and are left out.

A to D maximise the likelihood of the errors under Rayleigh's law with a heavy tail (bivariate t, 20 degrees of freedom)
over the captures without findings among design seeds 0–6 of all families of `tests/unseen`, own reflectances, two rings
of 6, 8, 12 and 20 lights (166 solves, November 2026, by a fit outside the repository); then all are multiplied so that
P(e < σ) is 0.67 over them. They have not been judged on report seeds. A and B are `photometry`'s, because a plan's
forecast takes them into account as well.
"""

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.normals.regularisation import UNSURE_DEG

DISCONTINUITY_SIGMA_DEG = 3.8
"""C, degrees: 1 σ of the normal at a depth discontinuity."""

FEW_LIGHTS_SIGMA_DEG = 9.5
"""D, degrees: 1 σ of the normal where fewer than MIN_LIGHTS lights are usable."""

MIN_LIGHTS = 4

UNSOUND_SIGMA_DEG = 8.0
"""E, degrees: 1 σ of all normals of a capture of which something is wrong that could not be put right. Over 60 such
captures (metal, subsurface scatter, deep relief; mean error 12°) P(e < σ) is 0.74 and the rms of e/σ 1.3; 0.69 and 1.5
with 6°, 0.79 and 1.0 with 12°."""

MAX_SQUARE = 100.0
"""Largest pooled χ² that counts."""

STRIP_ROWS = 256


def sigma_deg(
    posterior_deg: Float32Array, regularised_deg: Float32Array, residual: Float32Array, lights: np.ndarray,
    discontinuity: Float32Array | None, *, unsound: bool,
) -> Float32Array:  # fmt: skip
    """σ (H, W) in degrees over both tangential directions, from the components of the module's docstring.

    `posterior_deg` (H, W) is σ of the pixel solve, NaN where there is no normal, `regularised_deg` that after smoothing
    and the integrability projection; `residual` the rms of whitened residuals, `lights` how many measurements each
    pixel rests on, `discontinuity` 1 − w, none: the surface is continuous; `unsound`: something remains wrong.
    """
    out = np.full_like(posterior_deg, np.nan)
    height = len(out)
    added = UNSOUND_SIGMA_DEG**2 if unsound else 0.0
    for start in range(0, height, STRIP_ROWS):
        stop = min(start + STRIP_ROWS, height)
        first, last = max(start - 1, 0), min(stop + 1, height)
        own = slice(start - first, stop - first)
        known = np.isfinite(posterior_deg[first:last])
        square = _pooled(np.minimum(residual[first:last] ** 2, MAX_SQUARE), known)[own]
        unsure = posterior_deg[start:stop] > UNSURE_DEG
        base = np.where(unsure, posterior_deg[start:stop], regularised_deg[start:stop]) ** 2
        variance = (photometry.POSTERIOR_FACTOR + photometry.MISFIT_FACTOR * square) * base + added
        variance += np.where(lights[start:stop] < MIN_LIGHTS, FEW_LIGHTS_SIGMA_DEG**2, 0)
        if discontinuity is not None:
            variance += (DISCONTINUITY_SIGMA_DEG * discontinuity[start:stop]) ** 2
        out[start:stop] = np.where(known[own], np.sqrt(variance), np.nan)
    return out


def _pooled(values: Float32Array, known: BoolArray) -> Float32Array:
    """Mean (h, w) over the known pixels among 3 × 3."""
    weight = known.astype(np.float32)
    total = cv2.boxFilter(np.where(known, values, 0).astype(np.float32), -1, (3, 3), normalize=False)
    count = cv2.boxFilter(weight, -1, (3, 3), normalize=False)
    return np.asarray(total / np.maximum(count, 1), np.float32)
