"""What all pixels of a capture know together: one intensity factor per image, and how far away the object is.

Each pixel with more than four usable lights has measurements to spare. Its own unknowns (albedo × normal and a depth
offset) are projected out; what is left is linear in the few unknowns that all pixels share. The depth column in the
projection keeps wrong depth at steps from being taken for wrong intensities. Model errors of neighbouring pixels go
together, so the pixels' evidence is divided by `CORRELATED` before it meets the priors.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.normals import lambert
from acquisition.normals.lambert import Estimate
from acquisition.normals.lobe import Change
from acquisition.types import Float32Array, FloatArray

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
    s = light[:, :, enough].astype(np.float64)
    d = derivative[:, :, enough].astype(np.float64)
    normal = g[:, enough].astype(np.float64)
    root = np.sqrt(weights[:, enough].astype(np.float64))
    slope = np.einsum("fck,ck->fk", d, normal)
    shaded = np.einsum("fck,ck->fk", s, normal) + slope * offset_m[enough]
    lobe = np.zeros((count, 0, len(slope[0])))
    whole = shaded
    if gloss is not None:
        s = s + gloss.by_g[:, :, enough]
        lobe = gloss.by_lobe[:, :, enough].astype(np.float64)
        whole = shaded + gloss.highlight[:, enough]
    own = np.concatenate([s + d * offset_m[enough], slope[:, None, :]], axis=1) * root[:, None, :]
    own = own.transpose(2, 0, 1)  # (K, F, 4)
    ridge = np.diag([1e-6, 1e-6, 1e-6, offset_sigma_m**-2])
    inner = np.linalg.inv(own.transpose(0, 2, 1) @ own + ridge)
    projector = np.eye(count) - own @ inner @ own.transpose(0, 2, 1)
    columns = np.zeros((own.shape[0], count, count + 1 + lobe.shape[1]))
    columns[:, np.arange(count), np.arange(count)] = (root * whole).T
    columns[:, :, count] = (root * slope).T
    columns[:, :, count + 1 :] = (root[:, None] * lobe).transpose(2, 0, 1)
    left = (root * (values[:, enough] - shaded)).T
    # The offset's prior pulls it to zero: its pseudo-observation enters the residual's projection.
    projected = np.einsum("kfg,kg->kf", projector, left)
    pull = own @ inner[:, :, 3:] * (offset_m[enough] * offset_sigma_m**-2)[:, None, None]
    projected += pull[:, :, 0]
    matrix = np.einsum("kfa,kfg,kgb->ab", columns, projector, columns, optimize=True) / CORRELATED
    right = np.einsum("kfa,kf->a", columns, projected) / CORRELATED
    present = np.concatenate([log_intensity, [shift_m], np.zeros(lobe.shape[1])])
    others = np.array([shift_sigma_m] + [LOBE_SIGMA] * lobe.shape[1])
    if intensity_sigma > 0:
        intensity_sigma = likely(matrix, right + matrix @ present, _precision(others), intensity_sigma)
    held = np.concatenate([np.full(count, intensity_sigma), others])
    prior = _precision(held)
    covariance = np.linalg.inv(matrix + np.diag(prior))
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
