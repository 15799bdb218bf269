"""Terms of image formation beyond Lambert's: rough and glossy surfaces, ambient and stray light.

    y = |s| (ρ (n·l) L + S + b ρ K(n, l, v)) + a ψ ρ + o

- b weighs Oren and Nayar's azimuthal term K (Oren & Nayar 1994, eq. 30) against Lambert's: plaster, paper, clay.
- L and S are layer and lobe of a glossy dielectric of roughness α (`microfacet`), 1 and 0 without gloss: paint,
  plastic, glaze. Other gloss has a lobe of its own strength, beside diffuse light that lacks nothing, L = 1.
- a is the irradiance of ambient light from all directions, as in images without a lamp-off frame; ψ is the sky view
  factor, the share that other surfaces leave of it (`interreflection.sky_view`).
- o is an offset that is the same everywhere: a black level, stray light in the lens.

All are zero unless a test demands them (`term_tests`): estimated on sound captures they cost 20–50 % of accuracy,
because they resemble wrong normals. All but lobe and offset are homogeneous of first degree in g = ρn, so T(g) =
∂T/∂g · g: a solve adds ∂T/∂g to the light vectors and leaves the values as they are. The lobe is of degree zero,
∂S/∂g · g = 0: a solve subtracts it from the values and adds its derivative, too. Of a metal, the lobe times ρ replaces
the diffuse light; it is of first degree.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array
from acquisition.models.tuned import tuned
from acquisition.normals.pixels import microfacet


@dataclass(frozen=True)
class ImageTermSettings:
    """Tuned numbers of the terms of the image."""

    gloss_range: tuple[float, float] = tuned((0.05, 0.7), "α")
    """Range of the roughness α of an estimate of gloss. Below it highlights are smaller than the grid of lights
    resolves: half vectors within 3° of the normal, lamps within 6°. Above it the lobe is as flat as the diffuse base: a
    dielectric's is 0.02 high there, with an exponent of 2 (`microfacet.blinn_phong`)."""


SETTINGS = ImageTermSettings()

FACET_SLOPES_RAD = np.linspace(0, np.pi / 2, 315)
ROUGH_WEIGHTS = (
    0.45 * FACET_SLOPES_RAD**2 / (FACET_SLOPES_RAD**2 + 0.09)
    / (1 - 0.5 * FACET_SLOPES_RAD**2 / (FACET_SLOPES_RAD**2 + 0.33))
)  # fmt: skip
"""Standard deviations of the facets' slopes, rad, up to the largest, and b = B/A of each, with
A = 1 − 0.5 σ²/(σ² + 0.33) and B = 0.45 σ²/(σ² + 0.09) (Oren & Nayar 1994, eq. 30)."""

LEAST_ALBEDO = 1e-3
"""Least albedo by which the highlight's derivative by g is divided."""

NEARLY_DIFFUSE = 0.9
"""Share of the largest α from which a lobe counts as at the end of its range. Measured: α of accepted metals is 0.53 at
most in 148 true ones, 0.68 at least in 15 others (decision 96)."""

MAX_GLOSS_STEP = 0.4
"""Largest relative change of α, or of the lobe's strength, in one step, because the lobe is far from linear in α."""


@dataclass(frozen=True)
class ImageTerms:
    """Terms of image formation; 0 for none. `roughness` is the weight b of the rough diffuse term; irradiance a of
    `ambient` light and `offset` o are in units of y. `gloss` and `metal` are the roughness α of a glossy surface and of
    a metal, which has no diffuse light. `strength` is the glossy lobe's over a dielectric's of the same α, beside
    diffuse light that lacks nothing; 0 for a dielectric."""

    roughness: float = 0.0
    ambient: float = 0.0
    offset: float = 0.0
    gloss: float = 0.0
    metal: float = 0.0
    strength: float = 0.0

    @property
    def lobe_factor(self) -> np.float32:
        """Ratio of the glossy lobe to a dielectric's."""
        return np.float32(self.strength if self.strength > 0 else 1)

    @property
    def specular(self) -> bool:
        """Whether the surface is glossy or a metal."""
        return self.gloss > 0 or self.metal > 0

    @property
    def from_elsewhere(self) -> bool:
        """Whether there is ambient or stray light; of a prior's σ, whether either is estimated."""
        return self.ambient > 0 or self.offset > 0

    @property
    def roughness_rad(self) -> float:
        """Standard deviation of the facets' slopes, rad, by interpolation in `ROUGH_WEIGHTS`."""
        return float(np.interp(self.roughness, ROUGH_WEIGHTS, FACET_SLOPES_RAD))


LAMBERTIAN = ImageTerms()
"""Lambertian reflection without ambient or stray light; as 1 σ of a prior: all terms are held."""


@dataclass(frozen=True)
class TermValues:
    """The terms at N pixels, with their derivatives. `value` (F, N) is the sum of all, `nondiffuse` (F, N) of it what
    is no diffuse reflection, `ambient` (N,) the reflected ambient light, `lobe` (F, N) that of gloss.
    `highlight_variance` (F, N) is the variance of the predicted mirrored light, `by_g` (F, 3, N) are derivatives by
    g."""

    value: Float32Array
    nondiffuse: Float32Array
    ambient: Float32Array
    lobe: Float32Array
    offset: float
    highlight_variance: Float32Array
    by_g: Float32Array

    @property
    def from_lamps(self) -> Float32Array:
        """The part (F, N) that scales with the lamps' intensities: all but ambient light and offset."""
        return self.value - self.ambient - np.float32(self.offset)

    @property
    def constant(self) -> Float32Array:
        """The part (F, N) that does not scale with |g|, lobe and offset, which is not in `by_g` · g."""
        return self.lobe + np.float32(self.offset)


def evaluate(
    terms: ImageTerms, g: Float32Array, light: Float32Array, usable: BoolArray, view: Float32Array,
    response: Float32Array | None = None, sky: Float32Array | None = None,
) -> TermValues:  # fmt: skip
    """Evaluates the terms and their derivatives at g = albedo × normal (3, N) and light vectors (F, 3, N).

    Only `usable` (F, N) measurements have a rough term and gloss. `view` (3, N) are unit directions to the camera.
    `response` (N,) are values of white at a mosaic's sites, which multiply gloss, `sky` (N,) sky view factors; none:
    ones.
    """
    albedo, normal, strength, lamp = _directions(g, light)
    irradiance = np.float32(terms.ambient) * (np.float32(1) if sky is None else sky)
    ambient = irradiance * albedo
    by_g = np.zeros_like(light) + irradiance * normal
    nondiffuse = np.zeros_like(strength) + np.float32(terms.offset)
    value, lobe = nondiffuse + ambient, np.zeros_like(nondiffuse)
    highlight_sigma = lobe
    if terms.roughness > 0:
        rough, rough_by_g = _azimuthal_term(normal, lamp, view, usable)
        value = value + np.float32(terms.roughness) * albedo * strength * rough
        by_g += np.float32(terms.roughness) * strength[:, None] * rough_by_g
    if terms.gloss > 0:
        gloss = microfacet.reflection(normal, lamp, view, usable, terms.gloss)
        diffuse = np.maximum(np.einsum("fcn,cn->fn", light, normal), 0)
        mirrored = terms.lobe_factor * (strength if response is None else strength * response)
        lobe = mirrored * gloss.lobe
        nondiffuse = nondiffuse + lobe
        highlight_sigma = np.float32(photometry.SETTINGS.predicted_light_sigma) * lobe
        value = value + lobe
        if terms.strength == 0:
            value = value + albedo * diffuse * gloss.layer
            by_g += gloss.layer[:, None] * light + diffuse[:, None] * gloss.layer_by_normal
        by_g += (mirrored / np.maximum(albedo, np.float32(LEAST_ALBEDO)))[:, None] * gloss.lobe_by_normal
    if terms.metal > 0:
        metal = microfacet.reflection(normal, lamp, view, usable, terms.metal, microfacet.METAL_F0)
        mirrored = albedo * strength * metal.lobe
        value = value + mirrored - np.einsum("fcn,cn->fn", light, g)
        nondiffuse = nondiffuse + mirrored
        # What a metal mirrors of other surfaces is not predicted.
        highlight_sigma = np.float32(photometry.SETTINGS.predicted_indirect_sigma) * mirrored
        by_g += strength[:, None] * (metal.lobe[:, None] * normal + metal.lobe_by_normal) - light
    return TermValues(
        value=value.astype(np.float32),
        nondiffuse=nondiffuse.astype(np.float32),
        ambient=ambient.astype(np.float32),
        lobe=lobe,
        offset=terms.offset,
        highlight_variance=np.square(highlight_sigma).astype(np.float32),
        by_g=by_g.astype(np.float32),
    )


def by_parameter(
    terms: ImageTerms, g: Float32Array, light: Float32Array, usable: BoolArray, view: Float32Array,
    response: Float32Array | None = None, sky: Float32Array | None = None,
) -> Float32Array:  # fmt: skip
    """Returns derivatives (F, 6, N) of the terms by b, a, o, both α and the strength; arguments as of `evaluate`."""
    albedo, normal, strength, lamp = _directions(g, light)
    rough, _ = _azimuthal_term(normal, lamp, view, usable)
    out = np.zeros((len(light), len(fields(ImageTerms)), light.shape[2]), np.float32)
    out[:, 0], out[:, 1], out[:, 2] = albedo * strength * rough, albedo * (1 if sky is None else sky), 1
    if terms.gloss > 0:
        mirrored = strength if response is None else strength * response
        gloss = microfacet.reflection(normal, lamp, view, usable, terms.gloss)
        out[:, 3] = terms.lobe_factor * mirrored * gloss.lobe_by_log_alpha / np.float32(terms.gloss)
        out[:, 5] = mirrored * gloss.lobe
    if terms.metal > 0:
        metal = microfacet.reflection(normal, lamp, view, usable, terms.metal, microfacet.METAL_F0)
        out[:, 4] = albedo * strength * metal.lobe_by_log_alpha / np.float32(terms.metal)
    return out


def _directions(g: Float32Array, light: Float32Array) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """Returns albedo (N,), unit normal (3, N), |s| (F, N) and unit directions to the lamps (F, 3, N)."""
    albedo = np.sqrt(np.sum(g * g, axis=0))
    strength = photometry.strength(light)
    lamp = np.asarray(light / np.maximum(strength, np.float32(1e-9))[:, None], np.float32)
    return albedo, g / np.maximum(albedo, np.float32(1e-9)), strength, lamp


def nearly_diffuse(terms: ImageTerms) -> bool:
    """Returns whether α has run to the upper end of its range, where a lobe is as flat as diffuse light. Such a lobe
    explains light that is no highlight."""
    return max(terms.gloss, terms.metal) > NEARLY_DIFFUSE * SETTINGS.gloss_range[1]


def stepped(present: ImageTerms, step: ImageTerms) -> ImageTerms:
    """Returns the terms after a Gauss–Newton step, within their ranges. α and strength change by `MAX_GLOSS_STEP` at
    most, relatively, and stay zero if they are zero."""

    def changed(before: float, by: float) -> float:
        return before * (1 + float(np.clip(by / max(before, 1e-6), -MAX_GLOSS_STEP, MAX_GLOSS_STEP)))

    def alpha(before: float, by: float) -> float:
        return float(np.clip(changed(before, by), *SETTINGS.gloss_range)) if before > 0 else 0.0

    return ImageTerms(
        roughness=float(np.clip(present.roughness + step.roughness, 0, ROUGH_WEIGHTS[-1])),
        ambient=max(present.ambient + step.ambient, 0.0),
        offset=present.offset + step.offset,
        gloss=alpha(present.gloss, step.gloss),
        metal=alpha(present.metal, step.metal),
        strength=changed(present.strength, step.strength),
    )


def chosen(where: BoolArray, one: TermValues | None, other: TermValues | None) -> TermValues | None:
    """Returns `one` at some pixels (N,) and the `other` elsewhere; none if either is none."""
    if one is None or other is None:
        return None
    names = ("value", "nondiffuse", "ambient", "lobe", "highlight_variance", "by_g")
    return replace(one, **{name: np.where(where, getattr(one, name), getattr(other, name)) for name in names})


def _azimuthal_term(
    normal: Float32Array, lamp: Float32Array, view: Float32Array, usable: BoolArray
) -> tuple[Float32Array, Float32Array]:
    """K (F, N) = cos θi max(0, cos Δφ) sin α tan β, and ∂(ρK)/∂g (F, 3, N), for unit vectors to the lamp (F, 3, N).

    With c = l·v − cos θi cos θr = sin θi sin θr cos Δφ it is max(c, 0) · min(cos θi / cos θr, 1).
    """
    to_lamp = np.einsum("fcn,cn->fn", lamp, normal)
    to_view = np.maximum(np.sum(view * normal, axis=0), np.float32(photometry.SETTINGS.min_view_cosine))
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
