"""Gloss: one Blinn–Phong lobe for the whole object, estimated by all pixels together and subtracted from the images.

A pixel has too few images for a highlight of its own, but all pixels of a material share its shape. In
y = g·s + k|s|(n·h)^α, with h the half vector between lamp and camera (Blinn 1977), each pixel's g is projected out
(variable projection); the rest is linear in k, so k is a quotient of two sums for each α of a grid, and the α of least
residual is taken. The lobe also serves for microfacet gloss, of which only width and height matter: a GGX surface of
roughness 0.25 ends with errors like those of a true Blinn–Phong one. Highlights must not be rejected before they are
fitted, so the weights come from a solve with a wide Cauchy scale.

Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import microfacet, pixel_solve, pixel_solve_kernels
from acquisition.normals.pixel_solve import Estimate, Lighting, Pixels, PixelSolveOptions, Scene

EXPONENTS = (12.0, 18.0, 25.0, 35.0, 50.0, 80.0, 120.0)
"""Exponents α of the grid. Between facing flat walls interreflection looks like a lobe wider than the first."""

HIGHLIGHT_SIGMA = photometry.SETTINGS.predicted_highlight_sigma
"""1 σ of the subtracted highlight, as a share of it."""


@dataclass(frozen=True)
class LobeSettings:
    """Tuned numbers of the fit of a specular lobe."""

    wide_cauchy_scale: float = tuned(10.0, "σ")
    """Scale of Cauchy's weights, in σ, while the lobe is fitted: a narrow one rejects the highlights."""
    min_strength: float = tuned(0.02, "of the albedo")
    """Strength of the lobe below which a surface is diffuse."""
    min_explained_share: float = tuned(0.15, "share")
    """Share of the squared residuals that the lobe has to explain. On curved path-traced objects gloss explains a third
    and more, a diffuse surface in direct light a few per cent."""


SETTINGS = LobeSettings()

FIT_ROUNDS = 4
"""Alternations of solve and lobe fit."""


@dataclass(frozen=True)
class HighlightDerivatives:
    """Derivatives of the highlight at K pixels by g (F, 3, K), and by the logarithms of the lobe's strength and
    exponent (F, 2, K); by the logarithm of the strength it is the highlight itself."""

    by_g: Float32Array
    by_lobe: Float32Array

    @property
    def highlight(self) -> Float32Array:
        """The lobe's contribution to y (F, K)."""
        return self.by_lobe[:, 0]


@dataclass(frozen=True)
class Lobe:
    """Blinn–Phong lobe strength · |s| (n·h)^exponent that is added to y; `strength` is in units of albedo."""

    strength: float
    exponent: float

    def highlight(self, estimate: Estimate, ray_direction: Float32Array) -> Float32Array:
        """The lobe's contribution to y (F, N) where a measurement is usable, for ∂x/∂Z (3, N)."""
        if self.strength == 0:
            return np.zeros(estimate.usable.shape, np.float32)
        shape = _unit_highlight(
            estimate.light, pixel_solve.clamp_to_visible(estimate.normals, ray_direction), ray_direction, self.exponent
        )
        return (np.float32(self.strength) * _responding(shape, estimate) * estimate.usable).astype(np.float32)

    def derivatives(self, estimate: Estimate, ray_direction: Float32Array) -> HighlightDerivatives | None:
        """Derivatives of the highlight where a measurement is usable; none without a lobe."""
        if self.strength == 0:
            return None
        normals = pixel_solve.clamp_to_visible(estimate.normals, ray_direction)
        half, strength = _half_vectors(estimate.light, ray_direction)
        cosine = np.einsum("fcn,cn->fn", half, normals)
        visible = estimate.usable & (cosine > 0)
        cosine = np.where(visible, cosine, 1).astype(np.float32)
        exponent = np.float32(self.exponent)
        height = np.float32(self.strength) * _responding(strength, estimate) * cosine**exponent * visible
        steepness = exponent * height / cosine / np.maximum(estimate.albedo, np.float32(1e-6))
        by_g = steepness[:, None] * (half - cosine[:, None] * normals)
        return HighlightDerivatives(by_g, np.stack([height, exponent * height * np.log(cosine)], axis=1))


NO_LOBE = Lobe(0.0, EXPONENTS[-1])


def equivalent(lobe: Lobe, alpha: float) -> Lobe:
    """The lobe, or for a dielectric of roughness α > 0 that of the same height and width where it faces lamp and
    camera: F₀/(4α²), and the exponent 2/α² − 2 (Walter et al. 2007, eq. 25 and 33)."""
    return lobe if alpha == 0 else Lobe(microfacet.F0 / (4 * alpha**2), 2 / alpha**2 - 2)


def _responding(values: Float32Array, estimate: Estimate) -> Float32Array:
    """Values (F, N) of mirrored light as a mosaic's sites see it: gloss has the lamp's colour."""
    return values if estimate.response is None else values * estimate.response


def fit(pixels: Pixels, values: Float32Array, depth_m: Float32Array, scene: Scene, start: Lobe) -> Lobe:
    """Least-squares Blinn–Phong lobe of K pixels from values (F, K) without indirect light; `NO_LOBE` if diffuse.

    Alternates with the pixels' solve at depth (K,) from the lobe `start`. It needs `min_lights` usable lights at
    `min_pixels` pixels, else it is `NO_LOBE`, as where the scene's terms have a lobe of their own.
    """
    if scene.terms is not None and scene.terms.specular:
        return NO_LOBE
    lighting = Lighting.at(pixels, depth_m, scene)
    ray_direction = lighting.ray_direction
    threshold = scene.settings.shadow_threshold
    robust, wide = PixelSolveOptions(threshold), PixelSolveOptions(threshold, cauchy_scale=SETTINGS.wide_cauchy_scale)
    lobe = start
    for _ in range(FIT_ROUNDS):
        added = np.zeros_like(values)
        if lobe.strength > 0:
            guess = pixel_solve.solve_lit(pixels, values, lighting, scene, robust)
            added = lobe.highlight(guess, ray_direction)
        estimate = pixel_solve.solve_lit(
            pixels, values - added, lighting, scene, wide, extra_variance=(np.float32(HIGHLIGHT_SIGMA) * added) ** 2
        )
        diffuse = values if estimate.terms is None else values - estimate.terms.value
        lobe, explained = _fit_strength(diffuse, estimate, ray_direction, scene.lamps)
        if lobe.strength <= SETTINGS.min_strength or explained < SETTINGS.min_explained_share:
            return NO_LOBE
    return lobe


def _fit_strength(
    values: Float32Array, estimate: Estimate, ray_direction: Float32Array, lamp: Float32Array
) -> tuple[Lobe, float]:
    """Grid search of the exponent with closed-form strength: the lobe of least residual, and the share of squared
    residuals that it explains.

    Projected out are g of each pixel and a shift of the whole object: flat surfaces show much the same for either.
    """
    enough = np.count_nonzero(estimate.weights > 0, axis=0) >= photometry.REDUNDANT
    if np.count_nonzero(enough) < photometry.SETTINGS.min_sample:
        return NO_LOBE, 0.0
    change = pixel_solve.depth_derivative(estimate.light, estimate.point, ray_direction, lamp)
    half, length = _half_vectors(estimate.light, ray_direction)
    gram = np.zeros((2 + len(EXPONENTS), 2 + len(EXPONENTS)))
    _projected_products(
        estimate.weights,
        estimate.light,
        np.ascontiguousarray(values, np.float32),
        np.einsum("fck,ck->fk", change, estimate.g),
        np.einsum("fck,ck->fk", half, estimate.normals),
        length,
        np.array(EXPONENTS),
        enough,
        gram,
    )
    gram -= np.outer(gram[:, 1], gram[1]) / max(float(gram[1, 1]), 1e-24)  # the shift projected out
    total = float(gram[0, 0])
    best, least = NO_LOBE, total
    for exponent, product, squared in zip(EXPONENTS, gram[2:, 0], np.diag(gram)[2:], strict=True):
        strength = float(product) / max(float(squared), 1e-12)
        remaining = total - strength**2 * float(squared)
        if strength > 0 and remaining < least:
            best, least = Lobe(strength, exponent), remaining
    return best, 1 - least / max(total, 1e-12)


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
    """Adds to `out` the scalar products of values, shift and lobes over all pixels, each pixel's g projected out."""
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


def _unit_highlight(
    light: Float32Array, normals: Float32Array, ray_direction: Float32Array, exponent: float
) -> Float32Array:
    """|s| (n·h)^α (F, N)."""
    half, strength = _half_vectors(light, ray_direction)
    cosine = np.einsum("fcn,cn->fn", half, normals)
    return strength * np.clip(cosine, 0, 1) ** np.float32(exponent)


def _half_vectors(light: Float32Array, ray_direction: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Half vectors between the directions to lamp and camera, of unit length (F, 3, N), and |s| (F, N)."""
    strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light))
    view = -ray_direction / np.sqrt(np.sum(ray_direction * ray_direction, axis=0))
    half = light / np.maximum(strength, np.float32(1e-9))[:, None] + view
    length = np.sqrt(np.einsum("fcn,fcn->fn", half, half))
    return half / np.maximum(length, np.float32(1e-6))[:, None], strength


KERNELS = (_projected_products,)
