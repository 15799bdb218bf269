"""Gloss: one lobe for the whole object, found by all pixels together and taken out of the images.

A pixel has too few images to know its own highlight, but all pixels of a material share its shape. In
y = g·s + k|s|(n·h)^α, h half way between lamp and camera, each pixel's g is projected out; what is left is linear in k,
so that k is a quotient of two sums for each α of a grid, and the α of least residual is taken (Blinn's lobe; it also
serves for microfacet gloss, since only its width and height matter). Highlights are not outliers here: the weights come
from a solve that hardly rejects.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.calibration import Calibration
from acquisition.normals import pixel_solve, pixel_solve_kernels
from acquisition.normals.pixel_solve import Estimate, Pixels
from acquisition.photometry import Noise

EXPONENTS = (12.0, 18.0, 25.0, 35.0, 50.0, 80.0, 120.0)
HIGHLIGHT_SIGMA = photometry.PREDICTED_HIGHLIGHT_SIGMA

WIDE_CAUCHY_SCALE = 10.0
FIT_ROUNDS = 4
MIN_LIGHTS = 5
MIN_PIXELS = 100
MIN_STRENGTH = 0.02
MIN_EXPLAINED_SHARE = 0.15
"""A surface is taken as matt unless the lobe is stronger than MIN_STRENGTH and explains so large a share of the squared
residuals: on curved path-traced objects gloss explains a third and more, a matt surface in direct light a few per cent.
Facing flat walls are the hard case: bounced light looks like a wide lobe there, which is why EXPONENTS starts at 12."""


@dataclass(frozen=True)
class HighlightDerivatives:
    """How a highlight at K pixels changes with their g (F, 3, K), and with the logarithms of the lobe's strength, which
    is the highlight itself, and of its exponent (F, 2, K)."""

    by_g: Float32Array
    by_lobe: Float32Array

    @property
    def highlight(self) -> Float32Array:
        """What the lobe adds to y (F, K)."""
        return self.by_lobe[:, 0]


@dataclass(frozen=True)
class Lobe:
    """strength · |s| (n·h)^exponent is added to y; `strength` is in units of albedo."""

    strength: float
    exponent: float

    def highlight(self, found: Estimate, along: Float32Array) -> Float32Array:
        """What the lobe adds to y (F, N) where a measurement is lit, for ∂x/∂Z (3, N)."""
        if self.strength == 0:
            return np.zeros(found.usable.shape, np.float32)
        shape = _unit_highlight(found.light, pixel_solve.clamp_to_visible(found.normals, along), along, self.exponent)
        return (np.float32(self.strength) * shape * found.usable).astype(np.float32)

    def derivatives(self, found: Estimate, along: Float32Array) -> HighlightDerivatives | None:
        """The highlight where a measurement is lit, and its derivatives; none without a lobe."""
        if self.strength == 0:
            return None
        normals = pixel_solve.clamp_to_visible(found.normals, along)
        half, strength = _half_vectors(found.light, along)
        cosine = np.einsum("fcn,cn->fn", half, normals)
        seen = found.usable & (cosine > 0)
        cosine = np.where(seen, cosine, 1).astype(np.float32)
        exponent = np.float32(self.exponent)
        height = np.float32(self.strength) * strength * cosine**exponent * seen
        steepness = exponent * height / cosine / np.maximum(found.albedo, np.float32(1e-6))
        by_g = steepness[:, None] * (half - cosine[:, None] * normals)
        return HighlightDerivatives(by_g, np.stack([height, exponent * height * np.log(cosine)], axis=1))


NO_LOBE = Lobe(0.0, EXPONENTS[-1])


def fit(
    pixels: Pixels, values: Float32Array, depth_m: Float32Array, along: Float32Array, lamp: Float32Array,
    calibration: Calibration, noise: Noise, threshold: float, start: Lobe,
) -> Lobe:  # fmt: skip
    """The lobe that K sample pixels agree on, from their values (F, K), indirect light taken out; `NONE` for matt.

    It needs five usable lights at a hundred pixels, else `NONE`.
    """
    lobe = start
    for _ in range(FIT_ROUNDS):
        added = np.zeros_like(values)
        if lobe.strength > 0:
            guess = pixel_solve.solve(pixels, values, depth_m, lamp, calibration, noise, threshold=threshold)
            added = lobe.highlight(guess, along)
        found = pixel_solve.solve(
            pixels, values - added, depth_m, lamp, calibration, noise, threshold=threshold,
            cauchy_scale=WIDE_CAUCHY_SCALE, extra=(np.float32(HIGHLIGHT_SIGMA) * added) ** 2,
        )  # fmt: skip
        lobe, explained = _fit_strength(values, found, along, lamp)
        if lobe.strength <= MIN_STRENGTH or explained < MIN_EXPLAINED_SHARE:
            return NO_LOBE
    return lobe


def _fit_strength(values: Float32Array, found: Estimate, along: Float32Array, lamp: Float32Array) -> tuple[Lobe, float]:
    """The lobe of least residual, and the share of squared residuals that it explains.

    Projected out are g of each pixel and a shift of the whole object: flat surfaces show much the same for either.
    """
    enough = np.count_nonzero(found.weights > 0, axis=0) >= MIN_LIGHTS
    if np.count_nonzero(enough) < MIN_PIXELS:
        return NO_LOBE, 0.0
    change = pixel_solve.depth_derivative(found.light, found.point, along, lamp)
    half, length = _half_vectors(found.light, along)
    gram = np.zeros((2 + len(EXPONENTS), 2 + len(EXPONENTS)))
    _projected_products(
        found.weights,
        found.light,
        np.ascontiguousarray(values, np.float32),
        np.einsum("fck,ck->fk", change, found.g),
        np.einsum("fck,ck->fk", half, found.normals),
        length,
        np.array(EXPONENTS),
        enough,
        gram,
    )
    gram -= np.outer(gram[:, 1], gram[1]) / max(float(gram[1, 1]), 1e-24)  # the shift projected out
    whole = float(gram[0, 0])
    best, least = NO_LOBE, whole
    for exponent, along_lobe, squared in zip(EXPONENTS, gram[2:, 0], np.diag(gram)[2:], strict=True):
        strength = float(along_lobe) / max(float(squared), 1e-12)
        left = whole - strength**2 * float(squared)
        if strength > 0 and left < least:
            best, least = Lobe(strength, exponent), left
    return best, 1 - least / max(whole, 1e-12)


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,::1], float32[:,::1],"
    " float64[::1], boolean[::1], float64[:,::1])",
    cache=True,
    fastmath=True,
    error_model="numpy",
)
def _projected_products(  # noqa: PLR0912 - one fused kernel is the point
    weights: Float32Array,  # (F, K)
    light: Float32Array,  # (F, 3, K)
    values: Float32Array,  # (F, K)
    shift: Float32Array,  # (F, K): how values change when the object is shifted
    cosine: Float32Array,  # (F, K): n·h
    strength: Float32Array,  # (F, K): |s|
    exponents: FloatArray,  # (E,)
    enough: BoolArray,  # (K,): the pixels that count
    out: FloatArray,  # (2 + E, 2 + E)
) -> None:
    """Adds the scalar products of values, shift and lobes over all pixels, each pixel's g projected out of them."""
    count, size = len(weights), len(out)
    own, columns = np.empty((3, count)), np.empty((size, count))
    inner, across = np.empty((3, 3)), np.empty((3, size))
    for p in range(weights.shape[1]):
        if not enough[p]:
            continue
        for f in range(count):
            root = np.sqrt(np.float64(weights[f, p]))
            for c in range(3):
                own[c, f] = root * light[f, c, p]
            columns[0, f], columns[1, f] = root * values[f, p], root * shift[f, p]
            level = np.log(min(max(np.float64(cosine[f, p]), 1e-30), 1.0))
            for e in range(len(exponents)):
                columns[2 + e, f] = root * strength[f, p] * np.exp(exponents[e] * level)
        trace = 0.0
        for i in range(3):
            for j in range(i + 1):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * own[j, f]
                inner[i, j] = total
            trace += inner[i, i]
            for k in range(size):
                total = 0.0
                for f in range(count):
                    total += own[i, f] * columns[k, f]
                across[i, k] = total
        for i in range(3):
            inner[i, i] += 1e-6 * trace
        pixel_solve_kernels.cholesky(inner)
        pixel_solve_kernels.forward_substitution(inner, across)
        for a in range(size):
            for b in range(a, size if a < 2 else a + 1):  # no two lobes are asked for together
                total = 0.0
                for f in range(count):
                    total += columns[a, f] * columns[b, f]
                for i in range(3):
                    total -= across[i, a] * across[i, b]
                out[a, b] += total
                out[b, a] = out[a, b]


def _unit_highlight(light: Float32Array, normals: Float32Array, along: Float32Array, exponent: float) -> Float32Array:
    """|s| (n·h)^α (F, N)."""
    half, strength = _half_vectors(light, along)
    cosine = np.einsum("fcn,cn->fn", half, normals)
    return strength * np.clip(cosine, 0, 1) ** np.float32(exponent)


def _half_vectors(light: Float32Array, along: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Unit vectors half way between lamp and camera (F, 3, N), and |s| (F, N)."""
    strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light))
    view = -along / np.sqrt(np.sum(along * along, axis=0))
    half = light / np.maximum(strength, np.float32(1e-9))[:, None] + view
    length = np.sqrt(np.einsum("fcn,fcn->fn", half, half))
    return half / np.maximum(length, np.float32(1e-6))[:, None], strength


KERNELS = (_projected_products,)
