"""Reflectance of simulated surfaces: Lambert, Oren–Nayar, and GGX microfacets over a diffuse base or as bare metal.

Real plaster, paper, paint and metal follow none of the lobes that the solver fits, so the simulator takes its lobes
from the rendering literature. All values are y per unit of |s| (`docs/explanation/image-formation.md`): π · BRDF ·
cosine to the lamp, so that a white Lambertian surface that faces the lamp has 1. Subsurface scatter is not a function
of one point; the renderers apply `scatter_m` themselves.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from acquisition.models.base import FloatArray

Kind = Literal["lambert", "oren-nayar", "ggx", "metal"]

DIELECTRIC_F0 = 0.04
"""Fresnel reflectance of a dielectric of refractive index 1.5 at normal incidence."""

METAL_F0 = 0.9
"""Fresnel reflectance of a bright metal (aluminium .91) at normal incidence; the albedo scales it."""

LEAST_ALPHA = 0.02
"""Least roughness α of GGX: a sharper lobe would be a mirror image of the lamp, which a point light does not have."""

MOST_SIGMA_RAD = 1.0
"""Greatest roughness σ of Oren–Nayar, rad; the paper fits its qualitative model up to about 0.7–1."""

FORMS = "lambert, oren-nayar:SIGMA (0–1 rad), ggx:ALPHA (0.02–1) or metal:ALPHA (0.02–1)"


@dataclass(frozen=True)
class Reflectance:
    """Reflectance model of a surface; immutable, hashable, written as `parse` reads it.

    `roughness` is σ in rad for oren-nayar and α for ggx and metal. `scatter_m` is the mean free path of subsurface
    scatter, 0 for none. Raises ValueError for an unknown kind or a value out of its range.
    """

    kind: Kind = "lambert"
    roughness: float = 0.0
    scatter_m: float = 0.0

    def __post_init__(self) -> None:
        """Refuses values out of range, NaN included."""
        low, high = {"lambert": (0.0, 0.0), "oren-nayar": (0.0, MOST_SIGMA_RAD)}.get(self.kind, (LEAST_ALPHA, 1.0))
        if self.kind not in get_args(Kind) or not low <= self.roughness <= high:
            raise ValueError(f"there is no reflectance {str(self)!r}: choose {FORMS}")
        if not 0 <= self.scatter_m < np.inf:
            raise ValueError(f"the mean free path of subsurface scatter is {self.scatter_m} m: it must be 0 or more")

    def __str__(self) -> str:
        """As `parse` reads it; subsurface scatter is left out."""
        return self.kind if self.kind == "lambert" else f"{self.kind}:{self.roughness:g}"

    @staticmethod
    def parse(text: str) -> "Reflectance":
        """Reads `lambert`, `oren-nayar:0.35`, `ggx:0.2` or `metal:0.3`. Raises ValueError with the allowed forms."""
        name, colon, number = text.strip().partition(":")
        kind = next((kind for kind in get_args(Kind) if kind == name), None)
        if kind is None or bool(colon) != (kind != "lambert"):
            raise ValueError(f"there is no reflectance {text!r}: choose {FORMS}")
        try:
            roughness = float(number) if colon else 0.0
        except ValueError:
            raise ValueError(f"{number!r} in {text!r} is not a number: choose {FORMS}") from None
        return Reflectance(kind, roughness)

    def diffuse(
        self, normal: FloatArray, to_light: FloatArray, to_camera: FloatArray, albedo: FloatArray | float
    ) -> FloatArray:
        """Diffuse part (...) of y per unit of |s| for unit vectors (..., 3) and albedo (...); 0 below either horizon.

        Oren–Nayar is the qualitative model of Oren and Nayar (SIGGRAPH 1994), ρ (A + B max(0, cos Δφ) sin α tan β). It
        leaves out light between facets. At albedo 1 it reflects up to 1.4 % too much of grazing light (σ = .2 rad); up
        to albedo .98 it never reflects too much. The base under a dielectric GGX layer is Lambertian times the layer's
        transmission in and out, (1 − F(n·l))(1 − F(n·v)), which keeps reciprocity and conserves energy.
        """
        lit, seen = _cosines(normal, to_light, to_camera)
        if self.kind == "metal":
            return np.zeros_like(lit)
        factor = np.ones_like(lit)
        if self.kind == "ggx":
            factor = (1 - schlick(DIELECTRIC_F0, lit)) * (1 - schlick(DIELECTRIC_F0, seen))
        elif self.kind == "oren-nayar":
            variance = self.roughness**2
            a, b = 1 - 0.5 * variance / (variance + 0.33), 0.45 * variance / (variance + 0.09)
            # sin θ_l sin θ_v cos Δφ = l·v − (n·l)(n·v), and sin α tan β of the paper is that product of sines over the
            # larger cosine.
            between = np.maximum(np.einsum("...i,...i->...", to_light, to_camera) - lit * seen, 0.0)
            factor = a + b * between / np.maximum(np.maximum(lit, seen), 1e-9)
        return np.where(seen > 0, albedo * lit * factor, 0.0)

    def specular(
        self, normal: FloatArray, to_light: FloatArray, to_camera: FloatArray, albedo: FloatArray | float
    ) -> FloatArray:
        """Specular part (...) of y per unit of |s| for unit vectors (..., 3) and albedo (...); 0 below either horizon.

        GGX of Walter et al. (EGSR 2007): their distribution D, Smith's shadowing and masking in separable form
        G₁(l) G₁(v), and Schlick's Fresnel term. The albedo tints a metal's Fresnel term, but not a dielectric's.
        """
        lit, seen = _cosines(normal, to_light, to_camera)
        if self.kind in ("lambert", "oren-nayar"):
            return np.zeros_like(lit)
        half = to_light + to_camera
        half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
        square = self.roughness**2
        tilt = np.maximum(np.einsum("...i,...i->...", normal, half), 0.0)
        distribution = square / (np.pi * (1 - (1 - square) * tilt**2) ** 2)
        # G₁(x) / (n·x) = 2 / (n·x + √(α² + (1 − α²)(n·x)²)), so that nothing is divided by n·l or n·v.
        masking = (lit + np.sqrt(square + (1 - square) * lit**2)) * (seen + np.sqrt(square + (1 - square) * seen**2))
        turn = np.maximum(np.einsum("...i,...i->...", to_camera, half), 0.0)
        fresnel = albedo * schlick(METAL_F0, turn) if self.kind == "metal" else schlick(DIELECTRIC_F0, turn)
        return np.where(seen > 0, np.pi * distribution * fresnel * lit / masking, 0.0)

    def value(
        self, normal: FloatArray, to_light: FloatArray, to_camera: FloatArray, albedo: FloatArray | float
    ) -> FloatArray:
        """Diffuse and specular part together (...)."""
        return self.diffuse(normal, to_light, to_camera, albedo) + self.specular(normal, to_light, to_camera, albedo)


def schlick(f0: float, cosine: FloatArray) -> FloatArray:
    """Fresnel reflectance by Schlick's approximation (1994), f0 at normal incidence."""
    return f0 + (1 - f0) * (1 - cosine) ** 5


def _cosines(normal: FloatArray, to_light: FloatArray, to_camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    """n·l and n·v (...), clipped to 0–1, which rounding could exceed."""
    lit = np.einsum("...i,...i->...", normal, to_light)
    seen = np.einsum("...i,...i->...", normal, to_camera)
    return np.clip(lit, 0.0, 1.0), np.clip(seen, 0.0, 1.0)
