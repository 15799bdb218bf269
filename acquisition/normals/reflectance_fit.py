"""BRDF fit under many distant lights: GGX lobes per pixel, diffuse falloff shared by the object.

In one pixel, the diffuse falloff with the angle of incidence and a tilt of the normal are not separable, but all pixels
of an object share one falloff at different normals. So its parameters (κ, ω, γ of `reflectance_kernels.basis`) are
those at which a sample of pixels, each with its own best normal and strengths, has the least loss. Lambert's law is
kept unless other parameters explain distinctly more: a wrong law costs several degrees, slightly wrong parameters a few
tenths.
"""

from dataclasses import dataclass, fields

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals import reflectance_kernels


@dataclass(frozen=True)
class ReflectanceFitSettings:
    """Tuned numbers of the fit of a reflectance."""

    shadow_threshold: float = tuned(0.15, "of the 80th percentile")
    """Share of a pixel's 80th percentile below which a measurement is omitted, being lit by other surfaces if at
    all."""
    noise_floor: float = tuned(0.2, "of the median")
    """Weights are 1/(y + noise_floor), y in units of the pixel's median: between constant and proportional noise."""
    start_ring_rad: float = tuned(0.12, "rad")
    """Radius (rad) of the ring of starts round the initial normal."""
    position_thresholds: tuple[float, float] = tuned((0.25, 0.7), "rank")
    """Ranks, as shares of the lights, between which measurements count at the start (Shi et al., TPAMI 2014);
    asymmetric, because highlights reach further down than shadows reach up."""
    min_spread: float = tuned(3e-3, "of the median")
    """Least spread of the residuals, as a share of the median of the pixel's values."""


SETTINGS = ReflectanceFitSettings()

FINAL_STEP = 0.03
"""Step of κ in the pattern search at which it ends."""

LAMBERT_PARAMS = np.array([0.0, 0.0, 1.0])
"""κ, ω, γ at which the diffuse term is Lambert's law."""

DIFFUSE_PARAMS_SIGMA = np.array([0.08, 0.032, 0.028])
"""1 σ of κ, ω, γ: the error left where no parameters fit a material, measured on materials outside of the family."""

DIFFERENCE_STEP = 1e-3
"""Change of normal (rad) and diffuse parameters for difference quotients."""

CHUNK = 2048
"""Pixels whose derivatives are held at once."""

COARSE_PARAMS = tuple((kappa, omega, 1.0) for kappa in (0.0, 0.5, 1.0) for omega in (0.0, 0.25, 0.5))
"""Grid of κ, ω, γ that the search of the diffuse parameters starts from."""

LOWER_BOUNDS = np.array([-0.6, -0.2, 0.6])
UPPER_BOUNDS = np.array([1.2, 0.9, 1.6])
"""Bounds of κ, ω, γ."""

INITIAL_STEP = np.array([0.25, 0.12, 0.12])
NEIGHBOUR_DISTANCES_PX = (1, 2)
"""Distances (px) of the neighbours whose normals are tried as starts."""


@dataclass(frozen=True)
class ReflectanceFits:
    """Normals, strengths and variance of N pixels."""

    normals: Float32Array  # (N, 3)
    strengths: Float32Array  # (N, K) of the diffuse term and each lobe, in units of brightness
    variance: Float32Array  # (N,) rad², both tangential directions
    spread: Float32Array  # (N,) of weighted residuals, in units of the pixel's median
    loss: Float32Array  # (N,)

    def subset(self, chosen: np.ndarray | slice) -> "ReflectanceFits":
        """The fits of the pixels with the numbers `chosen`."""
        return ReflectanceFits(**{one.name: getattr(self, one.name)[chosen] for one in fields(self)})


def light_table(directions: FloatArray) -> FloatArray:
    """Unit light directions (F, 3) with their half vectors to a camera along z, (6, F)."""
    half = directions + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return np.ascontiguousarray(np.concatenate([directions, half], axis=1).T)


def initial_normals(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> Float32Array:
    """Initial normals (N, 3): least squares over the position thresholds (Shi et al., TPAMI 2014)."""
    low, high = (int(rank * len(directions)) for rank in SETTINGS.position_thresholds)
    ordered = np.sort(values, axis=1)
    middle = ((values >= ordered[:, low, None]) & (values < ordered[:, high, None]) & ~clipped).astype(np.float64)
    matrix = np.einsum("nf,fa,fb->nab", middle, directions, directions, optimize=True) + 1e-6 * np.eye(3)
    scaled = np.linalg.solve(matrix, ((middle * values) @ directions)[..., None])[..., 0]
    scaled[:, 2] = np.maximum(scaled[:, 2], 0.03 * np.linalg.norm(scaled, axis=1) + 1e-9)
    return (scaled / np.linalg.norm(scaled, axis=1, keepdims=True)).astype(np.float32)


def fit(
    values: Float32Array,
    clipped: BoolArray,
    table: FloatArray,
    diffuse_params: FloatArray,
    initial: Float32Array,
    *,
    ring_rad: float = SETTINGS.start_ring_rad,
    iterations: int = 12,
) -> ReflectanceFits:
    """Fits normal and strengths of pixels (N, F) from initial normals (N, 3), with given diffuse parameters."""
    typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9)
    y = np.ascontiguousarray(values / typical, dtype=np.float32)
    weights = np.where(usable(y, clipped), 1.0 / (np.maximum(y, 0) + SETTINGS.noise_floor), 0.0).astype(np.float32)
    y[clipped] = 0.0
    count = len(values)
    normals = np.empty((count, 3), np.float32)
    strengths = np.empty((count, reflectance_kernels.BASIS_SIZE), np.float32)
    statistics = np.empty((count, 3), np.float32)
    reflectance_kernels.fit(
        y, weights, table, diffuse_params, reflectance_kernels.GGX_ROUGHNESS,
        np.array([photometry.CAUCHY_SCALE, SETTINGS.min_spread, iterations, ring_rad]),
        np.ascontiguousarray(initial, dtype=np.float32), normals, strengths, statistics,
    )  # fmt: skip
    return ReflectanceFits(
        normals, strengths * typical.astype(np.float32), statistics[:, 2], statistics[:, 1], statistics[:, 0]
    )


def refit_from_neighbours(
    fits: ReflectanceFits, values: Float32Array, clipped: BoolArray, table: FloatArray, diffuse_params: FloatArray,
    pixel_numbers: np.ndarray, width: int,
) -> ReflectanceFits:  # fmt: skip
    """Fits pixels (N, F) again from the normal of a neighbour with less loss; keeps the fit of less loss.

    `pixel_numbers` (N,) are the pixels' numbers in rows of `width`. A pixel in shadow under a third of the lights may
    start tens of degrees off and end in a local minimum, while its neighbour converges.
    """
    for reach in NEIGHBOUR_DISTANCES_PX:
        neighbours = _neighbour_numbers(pixel_numbers, width, reach)
        loss = np.where(neighbours >= 0, fits.loss[neighbours], np.inf)
        best = np.take_along_axis(neighbours, np.argmin(loss, axis=0)[None], axis=0)[0]
        alike = np.einsum("nc,nc->n", fits.normals[best], fits.normals) > np.cos(SETTINGS.start_ring_rad)
        tried = np.flatnonzero((np.min(loss, axis=0) < fits.loss) & ~alike)
        if len(tried) == 0:
            continue
        again = fit(values[tried], clipped[tried], table, diffuse_params, fits.normals[best[tried]], ring_rad=0.0)
        better = again.loss < fits.loss[tried]
        parts = {one.name: getattr(fits, one.name).copy() for one in fields(ReflectanceFits)}
        for name, part in parts.items():
            part[tried[better]] = getattr(again, name)[better]
        fits = ReflectanceFits(**parts)
    return fits


def estimate_diffuse_params(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> FloatArray:
    """Estimates the shared diffuse parameters (3,) at a sample of pixels (N, F), by grid and pattern search.

    The loss is the mean logarithm of the pixels' own losses, each with its own best normal and strengths.
    """
    values, clipped = np.ascontiguousarray(values), np.ascontiguousarray(clipped)
    table, first = light_table(directions), initial_normals(values, clipped, directions)
    known: dict[tuple[float, ...], tuple[float, Float32Array]] = {}

    def loss(params: FloatArray, begin: Float32Array, ring: float) -> tuple[float, Float32Array]:
        key = tuple(np.round(params, 4).tolist())
        if key not in known:
            fits = fit(values, clipped, table, params, begin, ring_rad=ring, iterations=6)
            known[key] = float(np.mean(np.log(fits.loss + 1e-4))), fits.normals
        return known[key]

    least, params, begin = np.inf, LAMBERT_PARAMS, first
    for candidate in COARSE_PARAMS:
        candidate_loss, normals = loss(np.array(candidate), first, 1.25 * SETTINGS.start_ring_rad)
        if candidate_loss < least:
            least, params, begin = candidate_loss, np.array(candidate), normals
    step = INITIAL_STEP
    while step[0] > FINAL_STEP:
        moved = False
        for axis in range(len(params)):
            for sign in (1.0, -1.0):
                trial = params.copy()
                trial[axis] += sign * step[axis]
                trial = np.clip(trial, LOWER_BOUNDS, UPPER_BOUNDS)
                candidate_loss, normals = loss(trial, begin, 0.0)
                if candidate_loss < least - 1e-3:
                    least, params, begin, moved = candidate_loss, trial, normals, True
                    break
        if not moved:
            step = step / 2
    return params


def neighbour_deviation(normals: Float32Array, pixel_numbers: np.ndarray, width: int) -> Float32Array:
    """Deviation (N,) in rad of normals (N, 3) from the mean of the two neighbours on either side, times √(2/3).

    Constant curvature cancels in that mean; noise, edges and wrong local minima do not. The factor takes off the noise
    of the neighbours themselves. Of rows and columns the larger counts, zero where a pixel has no such neighbours;
    `pixel_numbers` and `width` as for `refit_from_neighbours`.
    """
    right, left, below, above = _neighbour_numbers(pixel_numbers, width, 1)
    out = np.zeros(len(normals), np.float32)
    for one, other in ((left, right), (above, below)):
        both = (one >= 0) & (other >= 0)
        apart = np.linalg.norm(normals - (normals[one] + normals[other]) / 2, axis=1)
        out = np.where(both, np.maximum(out, apart), out)
    return (np.sqrt(2 / 3) * out).astype(np.float32)


def _neighbour_numbers(pixel_numbers: np.ndarray, width: int, reach: int) -> np.ndarray:
    """Indices (4, N) of the neighbours to the right, left, below and above at a distance of `reach` px, or −1."""
    row, column = np.divmod(pixel_numbers, width)
    around = np.full((int(row.max(initial=0)) + 1 + 2 * reach, width + 2 * reach), -1)
    around[row + reach, column + reach] = np.arange(len(pixel_numbers))
    steps = ((0, reach), (0, -reach), (reach, 0), (-reach, 0))
    return np.stack([around[row + reach + down, column + reach + right] for down, right in steps])


def diffuse_params_variance(
    fits: ReflectanceFits, values: Float32Array, clipped: BoolArray, table: FloatArray, diffuse_params: FloatArray
) -> Float32Array:
    """Variance (N,) in rad² of the normals, both tangential directions, from DIFFUSE_PARAMS_SIGMA.

    First-order propagation: the normal turns by (JᵀWJ)⁻¹JᵀW ∂m/∂θ, θ the diffuse parameters, J and ∂m/∂θ with the
    strengths projected out. A pixel's residuals do not show this error, as falloff and tilt are not separable there.
    """
    parts = [slice(start, start + CHUNK) for start in range(0, len(values), CHUNK)]
    variances = [
        _diffuse_params_variance(fits.subset(part), values[part], clipped[part], table, diffuse_params)
        for part in parts
    ]
    return np.concatenate(variances) if variances else np.empty(0, np.float32)


def _diffuse_params_variance(
    fits: ReflectanceFits, values: Float32Array, clipped: BoolArray, table: FloatArray, diffuse_params: FloatArray
) -> Float32Array:
    typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9).astype(np.float32)
    y, strengths = values / typical, fits.strengths / typical
    weights = np.where(usable(y, clipped), 1.0 / (np.maximum(y, 0) + SETTINGS.noise_floor), 0.0)
    lobes = strengths[:, :, None] * _basis(fits.normals, table, diffuse_params)  # (N, K, F); zero where not used
    predicted = lobes.sum(axis=1)
    squared = (photometry.CAUCHY_SCALE * np.maximum(fits.spread, SETTINGS.min_spread)[:, None]) ** 2
    weight = weights / (1 + (y - predicted) ** 2 * weights / squared)

    def moved(change: FloatArray) -> FloatArray:
        normals = fits.normals + DIFFERENCE_STEP * change
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return (
            np.einsum("nk,nkf->nf", strengths, _basis(normals, table, diffuse_params)) - predicted
        ) / DIFFERENCE_STEP

    aside = np.where(np.abs(fits.normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(fits.normals, aside)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    rows = [moved(across), moved(np.cross(fits.normals, across))]
    for one in np.eye(reflectance_kernels.DIFFUSE_PARAMS):
        changed = diffuse(fits.normals, table, diffuse_params + DIFFERENCE_STEP * one) * strengths[:, :1]
        rows.append((changed - lobes[:, 0]) / DIFFERENCE_STEP)
    root = np.sqrt(weight)
    columns = (np.stack(rows, axis=1) * root[:, None]).astype(np.float64)  # (N, 2 + FORM, F)
    own = (lobes * root[:, None]).astype(np.float64)
    inner = own @ own.transpose(0, 2, 1)
    inner += (1e-9 + 1e-9 * np.trace(inner, axis1=1, axis2=2))[:, None, None] * np.eye(len(inner[0]))
    columns -= (columns @ own.transpose(0, 2, 1)) @ np.linalg.solve(inner, own)
    tilt, falloff = columns[:, :2], columns[:, 2:]
    matrix = tilt @ tilt.transpose(0, 2, 1) + 1e-9 * np.eye(2)
    turned = np.linalg.solve(matrix, tilt @ falloff.transpose(0, 2, 1)) * DIFFUSE_PARAMS_SIGMA
    return np.sum(turned**2, axis=(1, 2)).astype(np.float32)


def usable(values: Float32Array, clipped: BoolArray) -> BoolArray:
    """Mask (N, F) of the measurements that are used: neither clipped nor below `shadow_threshold`."""
    return (values >= np.quantile(values, 0.8, axis=1, keepdims=True) * SETTINGS.shadow_threshold) & ~clipped


def diffuse(normals: np.ndarray, table: FloatArray, diffuse_params: FloatArray) -> Float32Array:
    """Brightness (N, F) of the diffuse term of strength 1 at normals (N, 3)."""
    return _basis(normals, table, diffuse_params)[:, 0]


def brightness(fits: ReflectanceFits, table: FloatArray, diffuse_params: FloatArray) -> FloatArray:
    """Predicts the brightness (N, F) of fits under lights (6, F)."""
    return np.einsum("nk,nkf->nf", fits.strengths, _basis(fits.normals, table, diffuse_params))


def _basis(normals: np.ndarray, table: FloatArray, diffuse_params: FloatArray) -> Float32Array:
    out = np.empty((len(normals), reflectance_kernels.BASIS_SIZE, table.shape[1]), np.float32)
    reflectance_kernels.basis_of_normals(
        np.ascontiguousarray(normals, dtype=np.float64), table, diffuse_params, reflectance_kernels.GGX_ROUGHNESS, out
    )
    return out
