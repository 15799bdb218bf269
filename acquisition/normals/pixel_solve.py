"""One solve of all pixels: which measurements count, how much, and what follows from them.

A measurement is dropped where the pixel is clipped or in shadow: below a share of the pixel's own largest normalised
value. That share is low, because a high one throws away good grazing light; what it is meant to catch, pixels half in
shadow, lies beside shadowed pixels, and those neighbours get a variance of their own instead. The weak prior of a
surface that faces the camera decides where the images do not, and the uncertainty says so.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.normals import pixel_solve_kernels

PENUMBRA_SIGMA = 0.1
"""Extra standard deviation beside shadowed pixels, as a share of the pixel's largest value."""

CAUCHY_SCALE: float | None = 2.5
PRIOR_SCALE = 0.5
"""1 σ of the weak prior on g, as a share of the pixel's albedo."""

IRLS_ITERATIONS = 6
NO_OFFSET_SIGMA_M = 1e-6


@dataclass(frozen=True)
class Pixels:
    """What was measured at N object pixels of an (h, w) window; `index` (N,) is their place in it, row by row."""

    shape: tuple[int, int]
    index: np.ndarray
    ray: Float32Array  # (2, N)
    values: Float32Array  # (F, N)
    clipped: BoolArray  # (F, N)

    def image(self, values: np.ndarray, outside: float = 0.0) -> np.ndarray:
        """Spreads values (..., N) over the window (..., h, w)."""
        out = np.full((*values.shape[:-1], self.shape[0] * self.shape[1]), outside, dtype=values.dtype)
        out[..., self.index] = values
        return out.reshape(*values.shape[:-1], *self.shape)

    def take(self, image: np.ndarray) -> np.ndarray:
        """The values (..., N) of an image (..., h, w) at the object's pixels."""
        return image.reshape(*image.shape[:-2], -1)[..., self.index]

    def subset(self, chosen: np.ndarray) -> "Pixels":
        """Some of the pixels, by their number."""
        return replace(
            self,
            index=self.index[chosen],
            ray=np.ascontiguousarray(self.ray[:, chosen]),
            values=np.ascontiguousarray(self.values[:, chosen]),
            clipped=self.clipped[:, chosen],
        )


@dataclass(frozen=True)
class Estimate:
    """What one solve found at N pixels, and with which measurements."""

    g: Float32Array  # (3, N) albedo × normal, view frame
    offset_m: Float32Array  # (N,)
    variance: Float32Array  # (N,) rad², both tangential directions
    residual: Float32Array  # (N,)
    weights: Float32Array  # (F, N)
    usable: BoolArray  # (F, N)
    light: Float32Array  # (F, 3, N)
    point: Float32Array  # (3, N)

    @property
    def albedo(self) -> Float32Array:
        """Albedo (N,)."""
        return np.sqrt(np.sum(self.g * self.g, axis=0))

    @property
    def normals(self) -> Float32Array:
        """Unit normals (3, N), view frame."""
        return (self.g / np.maximum(self.albedo, 1e-9)).astype(np.float32)


def depth_derivative(light: Float32Array, point: Float32Array, along: Float32Array, lamp: Float32Array) -> Float32Array:
    """∂s/∂Z (F, 3, N): how light vectors `light` (F, 3, N) change with depth; `point`, `along` (3, N), lamps (F, 6)."""
    out = np.empty(light.shape, np.float32)
    pixel_solve_kernels.depth_derivative(
        np.ascontiguousarray(light, np.float32), np.ascontiguousarray(point), np.ascontiguousarray(along), lamp, out
    )
    return out


def classify_measurements(
    pixels: Pixels, values: Float32Array, strength: Float32Array, threshold: float
) -> tuple[BoolArray, BoolArray, Float32Array]:
    """Which measurements are usable (F, N), which of these lie beside a shadow, and each pixel's largest y/|s|."""
    ratio = values / np.maximum(strength, np.float32(1e-9))
    largest = _peak_ratio(ratio, pixels.clipped)
    shadowed = (ratio < threshold * largest) & ~pixels.clipped
    beside = np.empty_like(shadowed)
    kernel = np.ones((3, 3), np.uint8)
    for index, dark in enumerate(shadowed):
        beside[index] = pixels.take(cv2.dilate(pixels.image(dark.astype(np.uint8)), kernel)) > 0
    usable = ~shadowed & ~pixels.clipped & (ratio > 0)
    return usable, beside & usable, largest


def _peak_ratio(ratio: Float32Array | FloatArray, clipped: BoolArray) -> Float32Array:
    """Each pixel's largest y/|s| (N,) that is not clipped."""
    return np.max(np.where(clipped, 0, ratio), axis=0)


def median_albedo(found: Estimate, values: Float32Array, clipped: BoolArray) -> float:
    """The median over solved pixels of their largest y/|s|, from values (F, N) that may be `clipped` (F, N): what a
    pixel's albedo is held to be a fifth of at least before anything is solved."""
    strength = np.sqrt(np.einsum("fcn,fcn->fn", found.light, found.light))
    return float(np.median(_peak_ratio(values / np.maximum(strength, np.float32(1e-9)), clipped)))


def solve(
    pixels: Pixels,
    values: Float32Array,
    depth_m: Float32Array,
    lamp: Float32Array,
    calibration: Calibration,
    noise: photometry.Noise,
    *,
    threshold: float,
    offset_sigma_m: float = NO_OFFSET_SIGMA_M,
    cauchy_scale: float | None = CAUCHY_SCALE,
    extra: Float32Array | None = None,
    rounds: int = IRLS_ITERATIONS,
    typical: float | None = None,
    highlight_by_g: Float32Array | None = None,
) -> Estimate:
    """Solves all pixels at a given depth (N,).

    `values` (F, N) replaces the measured ones where something was divided out or subtracted; `extra` (F, N) is variance
    beside the noise model's; residuals beyond `cauchy_scale` σ count less, none: all count alike. `rounds`
    are those of the kernel; `typical` is the object's albedo where these pixels are but a part of it, see `brightness`.
    Where a highlight was subtracted that depends on g itself, `highlight_by_g` (F, 3, N) is its derivative; turning a
    normal leaves |g| as it is, so the derivative adds to the light vectors and nothing to the values.
    """
    point = photometry.points(pixels.ray, depth_m)
    along = photometry.ray_directions(pixels.ray)
    light = photometry.light_vectors(point, lamp, calibration)
    strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light))
    usable, beside, largest = classify_measurements(pixels, values, strength, threshold)
    added = np.where(beside, (np.float32(PENUMBRA_SIGMA) * largest * strength) ** 2, np.float32(0))
    if extra is not None:
        added = added + extra
    albedo = np.maximum(largest, np.float32(0.2) * np.float32(np.median(largest) if typical is None else typical))
    albedo = np.maximum(albedo, np.float32(1e-6))
    axis = -along / np.sqrt(np.sum(along * along, axis=0))
    count = pixels.values.shape[1]
    out = Estimate(
        g=np.empty((3, count), np.float32),
        offset_m=np.empty(count, np.float32),
        variance=np.empty(count, np.float32),
        residual=np.empty(count, np.float32),
        weights=np.empty(values.shape, np.float32),
        usable=usable,
        light=light,
        point=point,
    )
    pixel_solve_kernels.estimate(
        np.ascontiguousarray(values, dtype=np.float32),
        light if highlight_by_g is None else np.ascontiguousarray(light + highlight_by_g, dtype=np.float32),
        usable.astype(np.uint8),
        np.ascontiguousarray(added, dtype=np.float32),
        np.ascontiguousarray(point),
        np.ascontiguousarray(along),
        lamp,
        noise.shot.astype(np.float32),
        noise.floor.astype(np.float32),
        np.array([noise.intensity, noise.direction, cauchy_scale or 0.0, offset_sigma_m], dtype=np.float32),
        np.ascontiguousarray(axis * albedo, dtype=np.float32),
        (1.0 / (PRIOR_SCALE * albedo) ** 2).astype(np.float32),
        rounds,
        out.g,
        out.offset_m,
        out.variance,
        out.residual,
        out.weights,
    )
    return out


def clamp_to_visible(normals: Float32Array, along: Float32Array) -> Float32Array:
    """Normals (3, N) turned just far enough to face the camera, which sees each of them."""
    axis = -along / np.sqrt(np.sum(along * along, axis=0))
    cosine = np.sum(normals * axis, axis=0)
    least = np.float32(0.02)
    turned = normals + np.maximum(least - cosine, 0) * axis
    return (turned / np.sqrt(np.sum(turned * turned, axis=0))).astype(np.float32)


def normal_perturbation(found: Estimate, right: FloatArray) -> FloatArray:
    """How far normals turn (N, 3, K), rad, when errors δy of the measurements add `right` Σ w s δy (N, 3, K)."""
    s, w, g = (part.astype(np.float64) for part in (found.light, found.weights, found.g))
    matrix = np.einsum("fn,fan,fbn->nab", w, s, s, optimize=True)
    matrix += (1e-6 * np.trace(matrix, axis1=1, axis2=2) + 1e-12)[:, None, None] * np.eye(3)
    albedo = np.sqrt(np.maximum(np.sum(g * g, axis=0), 1e-12))
    normal = g / albedo
    moved = np.linalg.solve(matrix, right) / albedo[:, None, None]
    return moved - normal.T[:, :, None] * np.einsum("an,nak->nk", normal, moved)[:, None, :]


def fisher_information(estimate: Estimate, chosen: np.ndarray, lamp: Float32Array, along: Float32Array) -> FloatArray:
    """Fisher information (K, 4, 4) of (g, Z) at the chosen pixels, from the images alone, with the weights used."""
    light = estimate.light[:, :, chosen]
    change = depth_derivative(light, estimate.point[:, chosen], along[:, chosen], lamp)
    slope = np.einsum("fck,ck->fk", change, estimate.g[:, chosen])
    rows = np.concatenate([light + change * estimate.offset_m[chosen], slope[:, None]], axis=1).astype(np.float64)
    return np.einsum("fk,fak,fbk->kab", estimate.weights[:, chosen].astype(np.float64), rows, rows, optimize=True)
