"""Terms of image formation beyond Lambertian reflection and gloss: a rough diffuse surface, ambient and stray light.

    y = ρ|s| (n·l + b K(n, l, v)) + a ρ + o

b is the weight of Oren and Nayar's azimuthal term K (Oren & Nayar 1994, eq. 30) relative to Lambert's, a the irradiance
of light that does not come from the lamp, o an offset that is the same everywhere: a black level, stray light in the
lens. Plaster, paper and clay are rough surfaces; ambient light stays in images without a lamp-off frame. All are zero
unless a test demands them (`term_tests`): estimated on sound captures they cost 20–50 % of accuracy, because they
resemble wrong normals.

The first two are homogeneous of first degree in g = ρn, so T(g) = ∂T/∂g · g: a solve takes them into account by adding
∂T/∂g to the light vectors, and nothing to the values.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import BoolArray, Float32Array

MAX_ROUGH_WEIGHT = 0.53
"""Largest b that an estimate may reach, that of a roughness of 0.68 rad: rougher surfaces than plaster and clay, 0.6
rad, are rare, and the formula was made for slopes like these."""

LEAST_VIEW_COSINE = 0.1
"""Cosine between normal and viewing ray below which K is evaluated as at that cosine; it divides."""


@dataclass(frozen=True)
class ImageTerms:
    """Weight b of the rough diffuse term, irradiance a of ambient light and offset o, the last two in units of y."""

    roughness: float = 0.0
    ambient: float = 0.0
    offset: float = 0.0

    @property
    def roughness_rad(self) -> float:
        """Standard deviation of the facets' slopes, rad, from b = B/A with A = 1 − 0.5 σ²/(σ² + 0.33) and
        B = 0.45 σ²/(σ² + 0.09) (Oren & Nayar 1994, eq. 30), by interpolation."""
        sigma = np.linspace(0, 1.2, 241)
        squared = sigma**2
        weight = 0.45 * squared / (squared + 0.09) / (1 - 0.5 * squared / (squared + 0.33))
        return float(np.interp(self.roughness, weight, sigma))


LAMBERTIAN = ImageTerms()
"""Lambertian reflection, neither ambient nor stray light; as 1 σ of a prior: all are held."""


@dataclass(frozen=True)
class TermValues:
    """The terms at N pixels: ambient and stray light (N,), the sum of all terms (F, N), the offset in it, and its
    derivatives by g (F, 3, N) and by b, a and o (F, 3, N)."""

    ambient: Float32Array
    value: Float32Array
    offset: float
    by_g: Float32Array
    by_parameter: Float32Array


def evaluate(
    terms: ImageTerms, g: Float32Array, light: Float32Array, usable: BoolArray, view: Float32Array
) -> TermValues:
    """Values and derivatives of the terms at g = albedo × normal (3, N) and light vectors (F, 3, N).

    `usable` (F, N) measurements have a rough term; `view` (3, N) are unit directions to the camera.
    """
    albedo = np.sqrt(np.sum(g * g, axis=0))
    normal = g / np.maximum(albedo, np.float32(1e-9))
    strength = np.sqrt(np.einsum("fcn,fcn->fn", light, light))
    rough, rough_by_g = _azimuthal_term(normal, light / np.maximum(strength, np.float32(1e-9))[:, None], view, usable)
    by_parameter = np.stack(
        [albedo * strength * rough, np.broadcast_to(albedo, rough.shape), np.ones_like(rough)], axis=1
    )
    weights = np.array([terms.roughness, terms.ambient, terms.offset], np.float32)
    by_g = weights[0] * strength[:, None] * rough_by_g + weights[1] * normal
    value = np.einsum("k,fkn->fn", weights, by_parameter)
    ambient = (weights[1] * albedo + weights[2]).astype(np.float32)
    return TermValues(
        ambient, value.astype(np.float32), terms.offset, by_g.astype(np.float32), by_parameter.astype(np.float32)
    )


def _azimuthal_term(
    normal: Float32Array, lamp: Float32Array, view: Float32Array, usable: BoolArray
) -> tuple[Float32Array, Float32Array]:
    """K (F, N) = cos θi max(0, cos Δφ) sin α tan β, and ∂(ρK)/∂g (F, 3, N), for unit vectors to the lamp (F, 3, N).

    With c = l·v − cos θi cos θr = sin θi sin θr cos Δφ it is max(c, 0) · min(cos θi / cos θr, 1).
    """
    to_lamp = np.einsum("fcn,cn->fn", lamp, normal)
    to_view = np.maximum(np.sum(view * normal, axis=0), np.float32(LEAST_VIEW_COSINE))
    azimuthal = np.einsum("fcn,cn->fn", lamp, view) - to_lamp * to_view
    present = usable & (azimuthal > 0) & (to_lamp > 0)
    azimuthal = np.where(present, azimuthal, 0)
    share = np.minimum(to_lamp / to_view, 1)
    slope = -share[:, None] * (to_view * lamp + to_lamp[:, None] * view)
    oblique = (azimuthal / to_view)[:, None] * (lamp - share[:, None] * view)
    slope += np.where((to_lamp < to_view)[:, None], oblique, 0)
    slope -= np.einsum("fcn,cn->fn", slope, normal)[:, None] * normal
    term = azimuthal * share
    return term.astype(np.float32), (present[:, None] * (term[:, None] * normal + slope)).astype(np.float32)
