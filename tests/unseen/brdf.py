"""Reflectance of the path tracer: Lambert or Oren–Nayar plus a GGX lobe, evaluated and sampled.

Values are π f, so that a white Lambertian surface has 1. The code shares nothing with solver or simulator, whose own
formulas would agree with themselves even if wrong. A `Reflectance` serves only to name the numbers.

Sources: M. Oren and S. K. Nayar, SIGGRAPH 1994 (the qualitative model); B. Walter et al., EGSR 2007 (GGX, Smith's
separable masking); C. Schlick, Eurographics 1994; E. Heitz, JCGT 2018 (visible normals).
"""

from dataclasses import dataclass, replace
from math import acos, pi, sqrt

import numba
import numpy as np

from hardware_sim.reflectance import Reflectance

DIELECTRIC_F0, METAL_F0 = 0.04, 0.9
ALBEDO_RAYS = 20_000
"""Number of pairs of directions for the integral of the share of reflected light, once per reflectance."""


@dataclass(frozen=True)
class Brdf:
    """π f = ρ·diffuse·(a + b max(0, cos Δφ) sin α tan β) + tint·π D G F/(4 cosᵢ cosₒ); no lobe if GGX's α is 0.

    F is Schlick's between f0 and f90. The tint is the albedo ρ if `tinted`, else 1. If `layered`, the diffuse part is
    multiplied by the layer's transmission in and out, (1 − F(cosᵢ))(1 − F(cosₒ)).
    """

    diffuse: float = 1.0
    a: float = 1.0
    b: float = 0.0
    alpha: float = 0.0
    f0: float = DIELECTRIC_F0
    f90: float = 1.0
    tinted: bool = False
    layered: bool = False

    @property
    def parameters(self) -> np.ndarray:
        """The parameters as the kernels read them (8,)."""
        flags = float(self.tinted), float(self.layered)
        return np.array([self.diffuse, self.a, self.b, self.alpha, self.f0, self.f90, *flags])

    @property
    def lambertian(self) -> bool:
        return self.b == 0 and self.alpha == 0 and not self.layered

    @property
    def lobe(self) -> "Brdf":
        """The GGX lobe alone."""
        return replace(self, diffuse=0.0)

    @property
    def base(self) -> "Brdf":
        """The diffuse part alone."""
        return replace(self, alpha=0.0)

    def hemispherical_albedo(self) -> float:
        """Bihemispherical reflectance at albedo 1, by Monte Carlo integration."""
        rng = np.random.default_rng(0)
        pairs = [cosine_directions(rng.random((ALBEDO_RAYS, 2))) for _ in range(2)]
        up = np.broadcast_to([0.0, 0.0, 1.0], pairs[0].shape)
        return float(np.mean(values(self.parameters, np.ones(ALBEDO_RAYS), up, *pairs)))


def of(reflectance: Reflectance) -> Brdf:
    """The parameters of a reflectance, without its subsurface scatter."""
    r = reflectance.roughness
    if reflectance.kind == "oren-nayar":
        return Brdf(a=1 - 0.5 * r**2 / (r**2 + 0.33), b=0.45 * r**2 / (r**2 + 0.09))
    if reflectance.kind == "ggx":
        return Brdf(alpha=r, layered=True)
    if reflectance.kind == "metal":
        return Brdf(diffuse=0.0, alpha=r, f0=METAL_F0, tinted=True)
    return Brdf()


@numba.njit(cache=True)
def value(parameters, albedo, nx, ny, nz, ox, oy, oz, ix, iy, iz):
    """π f for unit normal n, direction o to the viewer and i to the light; 0 below the horizon of either."""
    cos_i, cos_o = nx * ix + ny * iy + nz * iz, nx * ox + ny * oy + nz * oz
    if cos_i <= 1e-6 or cos_o <= 1e-6:
        return 0.0
    out = albedo * parameters[0] * parameters[1]
    if parameters[7] > 0:
        f0, f90 = parameters[4], parameters[5]
        out *= 1 - f0 - (f90 - f0) * (1 - cos_i) ** 5
        out *= 1 - f0 - (f90 - f0) * (1 - cos_o) ** 5
    if parameters[2] > 0 and parameters[0] > 0:
        sin_i, sin_o = sqrt(max(0.0, 1 - cos_i**2)), sqrt(max(0.0, 1 - cos_o**2))
        across = ix * ox + iy * oy + iz * oz - cos_i * cos_o  # sin_i sin_o cos Δφ
        if across > 0:
            # sin α tan β = sin_i sin_o / max(cos_i, cos_o)
            out += albedo * parameters[0] * parameters[2] * across / max(cos_i, cos_o) if sin_i * sin_o > 0 else 0.0
    if parameters[3] > 0:
        hx, hy, hz = ix + ox, iy + oy, iz + oz
        length = sqrt(hx * hx + hy * hy + hz * hz)
        n_h = (nx * hx + ny * hy + nz * hz) / length
        i_h = (ix * hx + iy * hy + iz * hz) / length
        a2 = parameters[3] ** 2
        d = a2 / (pi * (n_h * n_h * (a2 - 1) + 1) ** 2)
        g = 4 * cos_i * cos_o
        g /= (cos_i + sqrt(a2 + (1 - a2) * cos_i**2)) * (cos_o + sqrt(a2 + (1 - a2) * cos_o**2))
        f = parameters[4] + (parameters[5] - parameters[4]) * (1 - i_h) ** 5
        out += (albedo if parameters[6] > 0 else 1.0) * pi * d * g * f / (4 * cos_i * cos_o)
    return out


@numba.njit(cache=True)
def values(parameters, albedo, normal, outward, inward):
    """`value` of N points: albedo (N,), unit vectors (N, 3)."""
    out = np.empty(len(albedo))
    for k in range(len(albedo)):
        n, o, i = normal[k], outward[k], inward[k]
        out[k] = value(parameters, albedo[k], n[0], n[1], n[2], o[0], o[1], o[2], i[0], i[1], i[2])
    return out


@numba.njit(cache=True)
def falloff(lobe, cosine):
    """Radiant intensity at an angle off the lamp's axis, 1 on it: 1/(1 + m t² + (1 − m) t⁴), t = θ/h; isotropic if h is
    0. `lobe`: h in rad, m."""
    if lobe[0] <= 0:
        return 1.0
    if cosine <= 0:
        return 0.0
    t2 = (acos(min(1.0, cosine)) / lobe[0]) ** 2
    return 1 / (1 + lobe[1] * t2 + (1 - lobe[1]) * t2 * t2)


@numba.njit(cache=True)
def irradiance(lamp, lobe, reference_m, p):
    """Direction from p to the lamp, and irradiance normal to it, 1 on the axis at reference_m; lamp: position, axis."""
    x, y, z = lamp[0] - p[0], lamp[1] - p[1], lamp[2] - p[2]
    r = sqrt(x * x + y * y + z * z)
    x, y, z = x / r, y / r, z / r
    cosine = -(lamp[3] * x + lamp[4] * y + lamp[5] * z)
    return x, y, z, falloff(lobe, cosine) * (reference_m / r) ** 2


@numba.njit(cache=True)
def lit(parameters, lamp, lobe, reference_m, point, normal, outward, albedo, visible):
    """Radiance (N,) that points send along `outward`, in units of a white Lambertian surface at the reference."""
    out = np.zeros(len(albedo))
    for k in range(len(albedo)):
        if visible[k]:
            x, y, z, e = irradiance(lamp, lobe, reference_m, point[k])
            n, o = normal[k], outward[k]
            cosine = n[0] * x + n[1] * y + n[2] * z
            if cosine > 0:
                f = value(parameters, albedo[k], n[0], n[1], n[2], o[0], o[1], o[2], x, y, z)
                out[k] = f * e * cosine
    return out


@numba.njit(cache=True)
def received(lamp, lobe, reference_m, point, normal, visible):
    """Irradiance (N,) of points."""
    out = np.zeros(len(point))
    for k in range(len(point)):
        if visible[k]:
            x, y, z, e = irradiance(lamp, lobe, reference_m, point[k])
            out[k] = e * max(0.0, normal[k, 0] * x + normal[k, 1] * y + normal[k, 2] * z)
    return out


def cosine_directions(square: np.ndarray) -> np.ndarray:
    """Cosine-distributed directions (N, 3) about z from points (N, 2) of the unit square."""
    r, angle = np.sqrt(square[:, 0]), 2 * np.pi * square[:, 1]
    return np.stack([r * np.cos(angle), r * np.sin(angle), np.sqrt(1 - square[:, 0])], axis=1)


def frames(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two tangents (N, 3) at each unit normal (Duff et al., JCGT 2017)."""
    x, y, z = normal.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return (
        np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1),
        np.stack([b, sign + y * y * a, -y], axis=1),
    )


def scattered(normal: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Cosine-distributed directions (N, 3) about normals (N, 3)."""
    local, (s, t) = cosine_directions(square), frames(normal)
    return local[:, :1] * s + local[:, 1:2] * t + local[:, 2:] * normal


def reflected(
    brdf: Brdf, albedo: np.ndarray, normal: np.ndarray, outward: np.ndarray, square: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Samples directions (N, 3) by the GGX lobe's visible normals, with weights (N,) π f cos / (π density)."""
    s, t = frames(normal)
    local = np.stack([np.sum(outward * axis, axis=1) for axis in (s, t, normal)], axis=1)
    local[:, 2] = np.maximum(local[:, 2], 1e-4)
    alpha = np.array([brdf.alpha, brdf.alpha, 1.0])
    v = local * alpha
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    t1, t2 = frames(v)
    r, angle = np.sqrt(square[:, 0]), 2 * np.pi * square[:, 1]
    # t1 must be level, so that the half of the disc that is seen edge-on is compressed in the right direction.
    level = np.stack([-v[:, 1], v[:, 0], np.zeros(len(v))], axis=1)
    length = np.linalg.norm(level, axis=1, keepdims=True)
    t1 = np.where(length > 1e-6, level / np.maximum(length, 1e-12), t1)
    t2 = np.cross(v, t1)
    p1, p2 = r * np.cos(angle), r * np.sin(angle)
    half = 0.5 * (1 + v[:, 2])
    p2 = (1 - half) * np.sqrt(np.maximum(0, 1 - p1**2)) + half * p2
    h = p1[:, None] * t1 + p2[:, None] * t2 + np.sqrt(np.maximum(0, 1 - p1**2 - p2**2))[:, None] * v
    h *= alpha
    h[:, 2] = np.maximum(h[:, 2], 0)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    o_h = np.sum(local * h, axis=1)
    w = 2 * o_h[:, None] * h - local
    cosine = np.maximum(w[:, 2], 1e-6)
    masking = 2 * cosine / (cosine + np.sqrt(brdf.alpha**2 + (1 - brdf.alpha**2) * cosine**2))
    weight = (brdf.f0 + (brdf.f90 - brdf.f0) * (1 - np.clip(o_h, 0, 1)) ** 5) * masking * (w[:, 2] > 1e-6)
    if brdf.tinted:
        weight = weight * albedo
    return w[:, :1] * s + w[:, 1:2] * t + w[:, 2:] * normal, weight
