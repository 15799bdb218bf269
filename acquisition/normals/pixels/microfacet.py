"""GGX microfacet reflection of a smooth dielectric: its lobe, and what its surface lets into the diffuse base and out.

Per unit of |s| a dielectric with a diffuse base of albedo ρ gives

    y/|s| = ρ (n·l) L + S,   L = (1 − F(n·l)) (1 − F(n·v)),   S = α² F(v·h) (n·l) / (q² m(n·l) m(n·v))

with the half vector h of lamp l and camera v, and

- q = 1 − (1 − α²)(n·h)² of the distribution of facets (Walter et al. 2007, eq. 33);
- m(c) = c + √(α² + (1 − α²) c²) of Smith's separable masking (eq. 34; the microfacet equation's cosines cancel);
- F(c) = F₀ + (1 − F₀)(1 − c)⁵ (Schlick 1994).

Plastics, paints, glazes and skin have refractive indices of 1.4–1.6, so F₀ = 0.04 is fixed, and the roughness α is the
only parameter. A metal has S alone, of F₀ = 0.9, times the albedo. Kernels compile at import, into numba's cache.
"""

from dataclasses import dataclass

import numba
import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array

F0 = 0.04
"""Reflectance of a dielectric of refractive index 1.5 at normal incidence; 0.028–0.053 for 1.4–1.6."""

METAL_F0 = 0.9
"""Reflectance of a bright metal at normal incidence (aluminium 0.91); the albedo scales it."""

LEAST_COSINE = photometry.SETTINGS.min_view_cosine


@dataclass(frozen=True)
class Reflection:
    """Lobe S and layer factor L − 1 (F, N) of N pixels, with derivatives; zero where the lamp is below the horizon.
    Gradients (F, 3, N) are by the unit normal, tangential to it; `lobe_by_log_alpha` (F, N) is ∂S/∂ log α."""

    lobe: Float32Array
    lobe_by_normal: Float32Array
    lobe_by_log_alpha: Float32Array
    layer: Float32Array
    layer_by_normal: Float32Array


def reflection(
    normal: Float32Array, lamp: Float32Array, view: Float32Array, usable: BoolArray, alpha: float, f0: float = F0
) -> Reflection:
    """Evaluates the reflection at unit normals (3, N), with unit directions to lamps (F, 3, N) and camera (3, N). Zero
    where a measurement is not `usable` (F, N). `f0` is the reflectance at normal incidence."""
    count, pixels = usable.shape
    out = Reflection(
        *(np.empty(shape, np.float32) for shape in (
            (count, pixels), (count, 3, pixels), (count, pixels), (count, pixels), (count, 3, pixels)
        ))
    )  # fmt: skip
    _reflection(
        np.ascontiguousarray(normal, np.float32), np.ascontiguousarray(lamp, np.float32),
        np.ascontiguousarray(view, np.float32), np.ascontiguousarray(usable, np.uint8), alpha, f0,
        out.lobe, out.lobe_by_normal, out.lobe_by_log_alpha, out.layer, out.layer_by_normal,
    )  # fmt: skip
    return out


def blinn_phong(alpha: float) -> tuple[float, float]:
    """Returns strength, in units of albedo, and exponent of the Blinn–Phong lobe of a dielectric's height and width.
    They are F₀/(4α²) and 2/α² − 2, where the surface faces lamp and camera (Walter et al. 2007, eq. 25 and 33)."""
    return F0 / (4 * alpha**2), 2 / alpha**2 - 2


@numba.njit(
    "void(float32[:,::1], float32[:,:,::1], float32[:,::1], uint8[:,::1], float64, float64, float32[:,::1],"
    " float32[:,:,::1], float32[:,::1], float32[:,::1], float32[:,:,::1])",
    cache=True,
    parallel=True,
    fastmath=True,
    error_model="numpy",
)
def _reflection(  # noqa: PLR0913 - a numba kernel
    normal: Float32Array,  # (3, N)
    lamp: Float32Array,  # (F, 3, N)
    view: Float32Array,  # (3, N)
    usable: np.ndarray,  # (F, N) uint8
    alpha: float,
    f0: float,
    lobe: Float32Array,  # (F, N)
    lobe_by_normal: Float32Array,  # (F, 3, N)
    lobe_by_log_alpha: Float32Array,  # (F, N)
    layer: Float32Array,  # (F, N)
    layer_by_normal: Float32Array,  # (F, 3, N)
) -> None:
    """Fills the last five arrays with the fields of `Reflection`."""
    square = alpha * alpha
    rest = 1 - square
    through = (1 - f0) ** 2
    for p in numba.prange(normal.shape[1]):
        nx, ny, nz = normal[0, p], normal[1, p], normal[2, p]
        vx, vy, vz = view[0, p], view[1, p], view[2, p]
        to_view = max(nx * vx + ny * vy + nz * vz, LEAST_COSINE)
        root_view = np.sqrt(square + rest * to_view**2)
        mask_view = to_view + root_view
        slope_view = (1 + rest * to_view / root_view) / mask_view
        grow_view = (1 - to_view**2) / (2 * root_view * mask_view)
        fifth_view = (1 - to_view) ** 4
        let_out = 1 - fifth_view * (1 - to_view)
        for f in range(lamp.shape[0]):
            lx, ly, lz = lamp[f, 0, p], lamp[f, 1, p], lamp[f, 2, p]
            to_lamp = nx * lx + ny * ly + nz * lz
            if usable[f, p] == 0 or to_lamp <= 0:
                lobe[f, p] = lobe_by_log_alpha[f, p] = layer[f, p] = 0
                for c in range(3):
                    lobe_by_normal[f, c, p] = layer_by_normal[f, c, p] = 0
                continue
            hx, hy, hz = lx + vx, ly + vy, lz + vz
            inverse = 1 / max(np.sqrt(hx * hx + hy * hy + hz * hz), 1e-6)
            hx, hy, hz = hx * inverse, hy * inverse, hz * inverse
            to_half = max(nx * hx + ny * hy + nz * hz, 0.0)
            turn = 1 - (vx * hx + vy * hy + vz * hz)
            fresnel = f0 + (1 - f0) * turn**5
            q = 1 - rest * to_half**2
            root = np.sqrt(square + rest * to_lamp**2)
            mask = to_lamp + root
            height = square * fresnel / (q * q * mask * mask_view)  # S / (n·l)
            by_half = height * to_lamp * 4 * rest * to_half / q
            by_lamp = height * (1 - to_lamp * (1 + rest * to_lamp / root) / mask)
            by_view = -height * to_lamp * slope_view
            lobe[f, p] = height * to_lamp
            grow = (1 - to_lamp**2) / (2 * root * mask)
            lobe_by_log_alpha[f, p] = (
                2 * square * height * to_lamp * (1 / square - 2 * to_half**2 / q - grow - grow_view)
            )
            fifth = (1 - to_lamp) ** 4
            let_in = 1 - fifth * (1 - to_lamp)
            layer[f, p] = through * let_in * let_out - 1
            layer_lamp, layer_view = through * 5 * fifth * let_out, through * 5 * fifth_view * let_in
            along = by_half * to_half + by_lamp * to_lamp + by_view * to_view
            layer_along = layer_lamp * to_lamp + layer_view * to_view
            lobe_by_normal[f, 0, p] = by_half * hx + by_lamp * lx + by_view * vx - along * nx
            lobe_by_normal[f, 1, p] = by_half * hy + by_lamp * ly + by_view * vy - along * ny
            lobe_by_normal[f, 2, p] = by_half * hz + by_lamp * lz + by_view * vz - along * nz
            layer_by_normal[f, 0, p] = layer_lamp * lx + layer_view * vx - layer_along * nx
            layer_by_normal[f, 1, p] = layer_lamp * ly + layer_view * vy - layer_along * ny
            layer_by_normal[f, 2, p] = layer_lamp * lz + layer_view * vz - layer_along * nz


KERNELS = (_reflection,)
