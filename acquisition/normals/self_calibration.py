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
from acquisition.types import Float32Array, FloatArray

CORRELATED = 20.0
"""Pixels whose model errors go together, errors of the lamps' positions included, which all pixels of an image share:
with 10 the object's shift came out wrong by up to 8 mm where few lights tell it, with 30 steps are calibrated worse."""

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
) -> Shared:
    """One Gauss–Newton step from estimates at K pixels.

    `light`, `derivative` (∂s/∂Z) (F, 3, K), `values`, `weights` (F, K), `g` (3, K), `offset_m` (K,); the present
    `log_intensity` (already divided out of `values`) and `shift_m` (already in the depth) are pulled towards zero by
    their priors. An `intensity_sigma` or `shift_sigma_m` of zero holds that unknown.
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
    own = np.concatenate([s + d * offset_m[enough], slope[:, None, :]], axis=1) * root[:, None, :]
    own = own.transpose(2, 0, 1)  # (K, F, 4)
    ridge = np.diag([1e-6, 1e-6, 1e-6, offset_sigma_m**-2])
    inner = np.linalg.inv(own.transpose(0, 2, 1) @ own + ridge)
    projector = np.eye(count) - own @ inner @ own.transpose(0, 2, 1)
    columns = np.zeros((own.shape[0], count, count + 1))
    columns[:, np.arange(count), np.arange(count)] = (root * shaded).T
    columns[:, :, count] = (root * slope).T
    left = (root * (values[:, enough] - shaded)).T
    # The offset's prior pulls it to zero: its pseudo-observation enters the residual's projection.
    projected = np.einsum("kfg,kg->kf", projector, left)
    pull = own @ inner[:, :, 3:] * (offset_m[enough] * offset_sigma_m**-2)[:, None, None]
    projected += pull[:, :, 0]
    matrix = np.einsum("kfa,kfg,kgb->ab", columns, projector, columns, optimize=True) / CORRELATED
    right = np.einsum("kfa,kf->a", columns, projected) / CORRELATED
    held = np.array([intensity_sigma] * count + [shift_sigma_m])
    prior = np.where(held > 0, 1.0 / np.maximum(held, 1e-12) ** 2, 1e18)
    present = np.append(log_intensity, shift_m)
    covariance = np.linalg.inv(matrix + np.diag(prior))
    change = covariance @ (right - prior * np.where(held > 0, present, 0.0))
    return Shared(change[:count], float(change[count]), covariance[:count, :count])


def shown(log_intensity: FloatArray, covariance: FloatArray, sigma: float) -> float:
    """1 σ of the intensities as a step shows it that found `log_intensity` (F,) and `covariance` (F, F) from `sigma`.

    Images of a plane tell nothing of some combinations of intensities, which its tilt would explain as well: these stay
    at zero and do not count (MacKay 1992, Bayesian interpolation, the number of well determined parameters).
    """
    if sigma <= 0:
        return 0.0
    told = len(log_intensity) - float(np.trace(covariance)) / sigma**2
    return float(np.sqrt(np.sum(log_intensity**2) / max(told, 1.0)))


def spread(found: Estimate, covariance: FloatArray) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, from errors of the log intensities that all
    pixels share, with `covariance` (F, F)."""
    shaded = found.weights * np.einsum("fcn,cn->fn", found.light, found.g)
    moved = lambert.turned(found, np.einsum("fn,fan->naf", shaded, found.light).astype(np.float64))
    return np.einsum("naf,fg,nag->n", moved, covariance, moved, optimize=True).astype(np.float32)
