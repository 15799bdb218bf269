"""BRDF fit under many distant lights: GGX lobes of each pixel, and a form of the diffuse term that all pixels share.

In one pixel the diffuse fall-off with the angle of incidence cannot be separated from a tilt of the normal, but all
pixels of an object share one fall-off at different normals. Lambert's law, a smooth dielectric's form and a rough
relief's are compared: that with the least loss on a sample of pixels, each with its own best normal and strengths, is
taken (decision 35).
"""

from dataclasses import dataclass

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.brdf import reflectance_kernels


@dataclass(frozen=True)
class ReflectanceFitSettings:
    """Tuned numbers of the fit of a reflectance."""

    dark_share: float = tuned(0.2, "of the pixel's brightness")
    """Share of a pixel's brightness below which a measurement is omitted, because it may be light from other surfaces.
    Brightness is the 80th percentile, since the largest value may be a highlight. The share also bounds the weights
    1/(y + share), y over the median, which lie between those of constant noise and of noise in proportion to y."""


SETTINGS = ReflectanceFitSettings()

DIFFUSE_FORMS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.4]])
"""κ and ω of `reflectance_kernels.basis`: Lambert's law, the diffuse light that leaves a smooth dielectric, and the
flattening by a relief of 0.5 rad."""


@dataclass(frozen=True)
class ReflectanceFits:
    """Normals, strengths and variance of N pixels."""

    normals: Float32Array  # (N, 3)
    strengths: Float32Array  # (N, K) of the diffuse term and each lobe, in units of brightness
    variance: Float32Array  # (N,) rad², both tangential directions
    spread: Float32Array  # (N,) of weighted residuals, in units of the pixel's median
    loss: Float32Array  # (N,)


def light_table(directions: FloatArray) -> FloatArray:
    """Unit light directions (F, 3) with their half vectors to a camera along z, (6, F)."""
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return np.ascontiguousarray(np.concatenate([directions, half], axis=1).T)


def fit(
    values: Float32Array, clipped: BoolArray, table: FloatArray, diffuse_form: FloatArray, initial: Float32Array,
    iterations: int = 12,
) -> ReflectanceFits:  # fmt: skip
    """Fits normal and strengths of pixels (N, F) from initial normals (N, 3), with κ and ω of the diffuse term (2,)."""
    typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9)
    y = np.ascontiguousarray(values / typical, dtype=np.float32)
    weights = np.where(usable(y, clipped), 1.0 / (np.maximum(y, 0) + SETTINGS.dark_share), 0.0).astype(np.float32)
    y[clipped] = 0.0
    count = len(values)
    normals = np.empty((count, 3), np.float32)
    strengths = np.empty((count, reflectance_kernels.BASIS_SIZE), np.float32)
    statistics = np.empty((count, 3), np.float32)
    reflectance_kernels.fit(
        y, weights, table, diffuse_form, reflectance_kernels.GGX_ROUGHNESS,
        np.array([
            photometry.CAUCHY_SCALE, photometry.SETTINGS.flat_field_sigma, iterations,
            np.radians(photometry.SETTINGS.unchecked_sigma_deg),
        ]),
        np.ascontiguousarray(initial, dtype=np.float32), normals, strengths, statistics,
    )  # fmt: skip
    return ReflectanceFits(
        normals, strengths * typical.astype(np.float32), statistics[:, 2], statistics[:, 1], statistics[:, 0]
    )


def best_diffuse_form(values: Float32Array, clipped: BoolArray, table: FloatArray, initial: Float32Array) -> FloatArray:
    """Returns the one of `DIFFUSE_FORMS` (2,) with the least loss on a sample of pixels (N, F), from initial normals
    (N, 3). The loss is the mean logarithm of the pixels' own losses, each with its own best normal and strengths."""

    def loss(form: FloatArray) -> float:
        return float(np.mean(np.log(fit(values, clipped, table, form, initial, iterations=6).loss + 1e-4)))

    return min(DIFFUSE_FORMS, key=loss)


def neighbour_deviation(normals: Float32Array, pixel_numbers: np.ndarray, width: int) -> Float32Array:
    """Returns √(2/3) of the deviation (N,), rad, of normals (N, 3) from the mean of two neighbours on either side.

    Constant curvature cancels in that mean; noise, edges and wrong local minima do not. The factor takes off the noise
    of the neighbours themselves. The larger value of row and column counts, zero where a pixel has no such neighbours;
    `pixel_numbers` (N,) are the pixels' numbers in rows of `width`.
    """
    row, column = np.divmod(pixel_numbers, width)
    number = np.full((int(row.max(initial=0)) + 3, width + 2), -1)
    number[row + 1, column + 1] = np.arange(len(pixel_numbers))
    left, right = number[row + 1, column], number[row + 1, column + 2]
    above, below = number[row, column + 1], number[row + 2, column + 1]
    out = np.zeros(len(normals), np.float32)
    for one, other in ((left, right), (above, below)):
        both = (one >= 0) & (other >= 0)
        apart = np.linalg.norm(normals - (normals[one] + normals[other]) / 2, axis=1)
        out = np.where(both, np.maximum(out, apart), out)
    return (np.sqrt(2 / 3) * out).astype(np.float32)


def usable(values: Float32Array, clipped: BoolArray) -> BoolArray:
    """Returns the mask (N, F) of the measurements that are used: neither clipped nor dark."""
    return (values >= np.quantile(values, 0.8, axis=1, keepdims=True) * SETTINGS.dark_share) & ~clipped


def diffuse(normals: np.ndarray, table: FloatArray, diffuse_form: FloatArray) -> Float32Array:
    """Returns the brightness (N, F) of the diffuse term of strength 1 at normals (N, 3)."""
    return _basis(normals, table, diffuse_form)[:, 0]


def _basis(normals: np.ndarray, table: FloatArray, diffuse_form: FloatArray) -> Float32Array:
    out = np.empty((len(normals), reflectance_kernels.BASIS_SIZE, table.shape[1]), np.float32)
    reflectance_kernels.basis_of_normals(
        np.ascontiguousarray(normals, dtype=np.float64), table, diffuse_form, reflectance_kernels.GGX_ROUGHNESS, out
    )
    return out
