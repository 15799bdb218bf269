"""Diffusion over the visible surface: the blur of light that spreads below it, and its regularised inverse.

Light that enters a translucent surface at one point leaves it around that point. The albedo therefore multiplies the
irradiance averaged over points of entry. With the exponentially attenuated profile exp(−r/ℓ)/(2πrℓ) of diffusion theory
(Jensen et al., SIGGRAPH 2001, to first order) this average is the filter (1 + ℓ²k²)^(−½). On an image it is the same
function of the Laplacian L of the graph that joins neighbouring pixels of the object:

    K = (1 + ℓ²L)^(−½),        regularised inverse: (1 + d) h / (1 + d h²),  h = (1 + ℓ²L)^½.

The weight of an edge is the squared ratio of a pixel's width to the distance of the two points in space, which includes
foreshortening, depth steps and the silhouette. L is symmetric and maps constants to zero, so both filters keep
constants and means exactly. They are evaluated as Chebyshev polynomials of L.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned


@dataclass(frozen=True)
class DiffusionSettings:
    """Tuned number of diffusion on the surface."""

    damping: float = tuned(0.15, "share")
    """d of the regularised inverse, the ratio of noise to signal where nothing is blurred. The inverse amplifies at
    most 1.5 times; a smaller d sharpens more, and amplifies more noise. Measured with the true ℓ (design seed 5 of
    blob, knot, sheet and turned, 8 and 20 lights, scratch script): mean errors fall by 17 %, with 0.05 by 11 %, with
    0.4 by 12 %; with 0.05 they rise if 8 images are noisy."""


SETTINGS = DiffusionSettings()

MAX_EIGENVALUE = 8.0
"""Upper bound of the eigenvalues of L with weights up to 1."""

NODES, MIN_COEFFICIENT = 256, 2e-3
"""Chebyshev nodes at which a filter is sampled, and least coefficient that its polynomial keeps."""


@dataclass(frozen=True)
class SurfaceGraph:
    """Weights between neighbouring pixels of an (h, w) window, 0–1: across (h, w − 1) and down (h − 1, w)."""

    across: Float32Array
    down: Float32Array

    def rows(self, first: int, last: int) -> "SurfaceGraph":
        """Returns the graph of the rows [first, last)."""
        return SurfaceGraph(self.across[first:last], self.down[first : last - 1])


def graph(mask: BoolArray, ray: Float32Array, depth_m: Float32Array) -> SurfaceGraph:
    """Builds the graph of the object's pixels (h, w) at depth (h, w) along rays (2, h, w), X/Z and Y/Z."""
    point = np.stack([ray[0] * depth_m, ray[1] * depth_m, depth_m])
    weights: list[Float32Array] = []
    for axis in (2, 1):
        first, second = (slice(None), slice(None), slice(-1)), (slice(None), slice(None), slice(1, None))
        if axis == 1:
            first, second = (slice(None), slice(-1)), (slice(None), slice(1, None))
        spacing = np.sum((ray[first] - ray[second]) ** 2, axis=0) * depth_m[first[1:]] * depth_m[second[1:]]
        distance = np.sum((point[first] - point[second]) ** 2, axis=0)
        joined = mask[first[1:]] & mask[second[1:]]
        share = np.divide(spacing, distance, out=np.zeros_like(distance), where=joined & (distance > 0))
        weights.append(np.minimum(share, 1).astype(np.float32))
    return SurfaceGraph(*weights)


def blurred(image: Float32Array, over: SurfaceGraph, length_px: float) -> Float32Array:
    """Applies K to an image (h, w): light spreads by the mean free path `length_px` along the surface."""
    return _applied(_polynomial(lambda t: (1 + length_px**2 * t) ** -0.5), image, over)


def sharpened(image: Float32Array, over: SurfaceGraph, length_px: float) -> Float32Array:
    """Applies the regularised inverse of `blurred` to an image (h, w)."""
    return _applied(_polynomial(_inverse(length_px)), image, over)


def noise_gain(length_px: float) -> float:
    """Returns the factor by which `sharpened` changes the variance of independent noise, facing the camera."""
    k = 2 - 2 * np.cos(np.pi * (np.arange(32) + 0.5) / 32)
    return float(np.mean(_inverse(length_px)(k[:, None] + k) ** 2))


def reach(length_px: float) -> int:
    """Returns the distance in pixels over which `sharpened` carries values."""
    return len(_polynomial(_inverse(length_px))) - 1


def _inverse(length_px: float) -> Callable[[FloatArray], FloatArray]:
    def response(t: FloatArray) -> FloatArray:
        squared = 1 + length_px**2 * t
        return (1 + SETTINGS.damping) * np.sqrt(squared) / (1 + SETTINGS.damping * squared)

    return response


def _polynomial(response: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Returns Chebyshev coefficients over [0, MAX_EIGENVALUE] of a response that is 1 at 0; they are exact there."""
    angle = np.pi * (np.arange(NODES) + 0.5) / NODES
    values = response(MAX_EIGENVALUE / 2 * (np.cos(angle) + 1))
    degrees = np.arange(NODES // 2)
    out = 2 / NODES * np.cos(np.outer(degrees, angle)) @ values
    out[0] /= 2
    out = out[: int(np.flatnonzero(np.abs(out) > MIN_COEFFICIENT)[-1]) + 1]
    out[0] += 1 - np.sum(out * (-1.0) ** np.arange(len(out)))
    return out


def _applied(polynomial: FloatArray, image: Float32Array, over: SurfaceGraph) -> Float32Array:
    """Applies the polynomial of L to an image (h, w), by Clenshaw's recurrence in its forward form."""
    before, present = image, _centred(image, over)
    out = np.float32(polynomial[0]) * before
    for number, coefficient in enumerate(polynomial[1:]):
        if number > 0:
            before, present = present, 2 * _centred(present, over) - before
        out += np.float32(coefficient) * present
    return out


def _centred(image: Float32Array, over: SurfaceGraph) -> Float32Array:
    """Applies 2 L / MAX_EIGENVALUE − 1 to an image (h, w)."""
    out = -image
    flow = np.float32(2 / MAX_EIGENVALUE) * over.across * (image[:, 1:] - image[:, :-1])
    out[:, :-1] -= flow
    out[:, 1:] += flow
    flow = np.float32(2 / MAX_EIGENVALUE) * over.down * (image[1:] - image[:-1])
    out[:-1] -= flow
    out[1:] += flow
    return out
