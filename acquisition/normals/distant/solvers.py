"""The solvers for distant light, each as a function from a block of pixels to normals, albedo, variance and flags.

`ls` is Lambertian least squares (Woodham 1980), `weighted` the same without clipped, shadowed and highlight
measurements, `thresholded` the same over position thresholds (Shi et al., TPAMI 2014), `robust` iteratively reweighted
least squares with Cauchy weights, `glossy` a fit of a diffuse term and GGX lobes. All propagate uncertainty alike: the
variance of a measurement comes from the pixel's own residuals with a weak prior, since few lights leave few residuals,
and the leverage of the measurements used carries it to the normal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from acquisition import photometry
from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED
from acquisition.models.tuned import tuned
from acquisition.normals.distant import reflectance_fit, robust_regression
from acquisition.normals.distant.pixel_blocks import Block

Solver = Literal["auto", "ls", "weighted", "thresholded", "robust", "glossy"]


@dataclass(frozen=True)
class DistantSolverSettings:
    """Tuned numbers of the distant solvers."""

    shadow_threshold: float = tuned(0.05, "of the peak")
    """Share of a pixel's largest unclipped value below which a measurement is in shadow."""
    highlight_threshold: float = tuned(0.1, "of the albedo")
    """Share of the albedo by which a highlight exceeds the diffuse prediction."""
    min_glossy_lights: int = tuned(12, "lights")
    """Least number of lights that determines normal, diffuse term and lobes of each pixel."""
    prior_residual: float = tuned(0.01, "of the albedo")
    """Prior 1 σ of a measurement's residual, as a share of the albedo."""
    prior_count: float = tuned(2.0, "degrees of freedom")
    """Degrees of freedom that the prior counts as."""


SETTINGS = DistantSolverSettings()

DIFFUSE_PARAMS_SAMPLE = 400
"""Pixels that the shared diffuse parameters are fitted to."""

MIN_GLOSSY_VARIANCE_RAD2 = np.float32(np.radians(0.15) ** 2)
"""Least variance (rad², both tangential directions) of a glossy fit's normals: the errors of the lights' directions and
intensities, 0.15°."""

UNKNOWN_VARIANCE_RAD2 = np.float32(np.radians(60.0) ** 2)
"""Variance (rad²) of a normal that fewer than three measurements determine, and the upper bound of all: 60°."""


RIDGE = np.array([1e-5, 0, 0, 1e-5, 0, 1e-5], np.float32)[:, None]
"""Keeps the moments of lights in one plane regular."""


@dataclass(frozen=True)
class SolveResult:
    """Normals, albedo, variance and flags of N pixels of a block."""

    normals: Float32Array  # (3, N)
    albedo: Float32Array  # (N,) brightness of a diffuse surface facing a light of intensity 1
    variance: Float32Array  # (N,) rad², both tangential directions
    residual: Float32Array  # (N,) rms of the residuals that were used, in units of brightness
    flags: np.ndarray  # (F, N) uint8


Method = Callable[[Block, np.ndarray], SolveResult]
"""Solves the pixels of a block that are given by their numbers."""


def prepare(
    solver: Solver, values: Float32Array, clipped: BoolArray, directions: FloatArray
) -> tuple[Method, dict[str, Any]]:
    """Prepares a solver for these lights; returns its method and the notes on it for the result.

    Parameters that all pixels share are fitted to a sample of pixels (K, F).

    Raises RigError normals.infeasible where `glossy` or `thresholded` is asked of too few lights.
    """
    if solver in {"glossy", "thresholded"} and len(directions) < SETTINGS.min_glossy_lights:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"{solver} needs {SETTINGS.min_glossy_lights} lights or more, these are {len(directions)}: ask for robust "
            "or add images",
        )
    match solver:
        case "ls":
            return _least_squares(directions), {"grey": "0.2989 R + 0.5870 G + 0.1140 B"}
        case "weighted":
            return _weighted(directions), {"shadow_share": SETTINGS.shadow_threshold}
        case "glossy":
            step = max(1, len(values) // DIFFUSE_PARAMS_SAMPLE)
            diffuse_params = reflectance_fit.estimate_diffuse_params(values[::step], clipped[::step], directions)
            names = ("kappa", "omega", "gamma")
            return _glossy(directions, diffuse_params), {
                "matt_form": dict(zip(names, diffuse_params.tolist(), strict=True))
            }
        case _:
            return _robust(directions, rounds=0 if solver == "thresholded" else robust_regression.MAX_ITERATIONS), {}


def usable(values: Float32Array, clipped: BoolArray) -> BoolArray:
    """Which measurements (N, F) are neither clipped nor in shadow."""
    largest = np.max(np.where(clipped, 0, values), axis=1, keepdims=True)
    return ~clipped & (values > 0) & (values >= np.float32(SETTINGS.shadow_threshold) * largest)


def shadow_weights(values: Float32Array, clipped: BoolArray) -> Float32Array:
    """Weights (N, F) of the measurements: 0 where clipped, from 0 to 1 between half and 1.5 of the shadow's threshold.

    A weight that jumps leaves a seam in the normals where a light falls into shadow.
    """
    threshold = np.float32(SETTINGS.shadow_threshold) * np.max(np.where(clipped, 0, values), axis=1, keepdims=True)
    return np.where(clipped, 0, np.clip(values / np.maximum(threshold, 1e-20) - 0.5, 0, 1)).astype(np.float32)


def robust_fit(
    values: Float32Array, weights: Float32Array, directions: FloatArray, ranks: tuple[float, float], rounds: int
) -> tuple[Float32Array, Float32Array]:
    """Robust regression of pixels (N, F) with weights: albedo × normal (N, 3); variance and leverage (N, 2)."""
    scaled_normals, statistics = np.empty((len(values), 3), np.float32), np.empty((len(values), 2), np.float32)
    many = len(directions) >= robust_regression.SETTINGS.min_position_threshold_lights or rounds == 0
    chosen, inverses = (
        (np.empty((0, 3), np.int64), np.empty((0, 3, 3))) if many else robust_regression.triples(directions)
    )  # fmt: skip
    settings = np.array([*ranks, robust_regression.SETTINGS.cauchy_scale if rounds else 0.0, rounds])
    light = np.ascontiguousarray(directions, dtype=np.float64)
    robust_regression.solve(
        values, np.ascontiguousarray(weights), light, chosen, inverses, settings, scaled_normals, statistics
    )
    return scaled_normals, statistics


def _least_squares(directions: FloatArray) -> Method:
    """Lambertian least squares of all measurements (Woodham 1980)."""

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        values, clipped = block.pixels(chosen)
        normals, albedo, leverage, spread = _lambertian(values, np.ones_like(values), directions)
        flags = np.ascontiguousarray(np.where(clipped, SATURATED, LIT).T.astype(np.uint8))
        variance = angular_variance(spread, leverage, albedo, float(len(directions)))
        return SolveResult(normals, albedo, variance, np.sqrt(spread), flags)

    return solve


def _weighted(directions: FloatArray) -> Method:
    """Lambertian least squares without clipped, shadowed and highlight measurements.

    Highlights exceed the first fit by a share of the albedo; they are left out unless fewer than four measurements
    would remain. All weights fall from one to zero between half and one and a half of their threshold, so that normals
    have no seam where the set of lights changes.
    """

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        values, clipped = block.pixels(chosen)
        lit, weights = usable(values, clipped), shadow_weights(values, clipped)
        normals, albedo, leverage, spread = _lambertian(values, weights, directions)
        facing = ((normals * albedo).T @ directions.T).astype(np.float32)
        spare = np.einsum("nf->n", weights) > photometry.OVERDETERMINED
        excess = np.where(spare, np.float32(SETTINGS.highlight_threshold) * albedo, np.inf)[:, None]
        above = (values - facing) / np.maximum(excess, np.float32(1e-20))
        flags = _flags(lit & (above <= 1), lit & (above > 1), clipped, facing)
        again = np.flatnonzero(np.any((weights > 0) & (above > 0.5), axis=1))
        if len(again):
            kept = weights[again] * (1 - np.clip(above[again] - 0.5, 0, 1)).astype(np.float32)
            normals[:, again], albedo[again], leverage[again], spread[again] = _lambertian(
                values[again], kept, directions
            )
        used = np.count_nonzero(flags == LIT, axis=0).astype(np.float32)
        return SolveResult(normals, albedo, angular_variance(spread, leverage, albedo, used), np.sqrt(spread), flags)

    return solve


def _lambertian(
    values: Float32Array, weights: Float32Array, directions: FloatArray
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """Weighted least squares of pixels (N, F) by normal equations (Woodham 1980).

    Returns normals (3, N), albedo (N,), the trace of the tangential part of (SᵀWS)⁻¹, and the variance of a measurement
    from the residuals.
    """
    light = directions.astype(np.float32)
    x, y, z = light.T
    xx, xy, xz, yy, yz, zz = np.stack([x * x, x * y, x * z, y * y, y * z, z * z]) @ weights.T + RIDGE
    # (SᵀWS)⁻¹ by its adjugate: many times as fast as a call of LAPACK for each pixel.
    inverse = np.stack(
        [
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ]
    )
    inverse /= xx * inverse[0] + xy * inverse[1] + xz * inverse[2]
    a, b, c, d, e, f = inverse
    u, v, w = light.T @ (weights * values).T
    scaled = np.stack([a * u + b * v + c * w, b * u + d * v + e * w, c * u + e * v + f * w])
    albedo = np.sqrt(np.sum(scaled * scaled, axis=0))
    nx, ny, nz = normals = scaled / np.maximum(albedo, np.float32(1e-20))
    along = a * nx * nx + d * ny * ny + f * nz * nz + 2 * (b * nx * ny + c * nx * nz + e * ny * nz)
    residual = values - scaled.T @ light.T
    freedom = np.maximum(np.einsum("nf->n", weights) - photometry.PIXEL_UNKNOWNS, np.float32(1))
    spread = np.einsum("nf,nf->n", weights, residual * residual) / freedom
    return normals, albedo, np.maximum(a + d + f - along, 0), spread


def _robust(directions: FloatArray, rounds: int) -> Method:
    """Cauchy-weighted IRLS; with no iteration, least squares over the position thresholds alone."""

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        values, clipped = block.pixels(chosen)
        lit = usable(values, clipped)
        scaled_normals, statistics = robust_fit(
            values, shadow_weights(values, clipped), directions, robust_regression.SETTINGS.position_thresholds, rounds
        )
        albedo = np.linalg.norm(scaled_normals, axis=1)
        normals = scaled_normals / np.maximum(albedo, 1e-20)[:, None]
        predicted = scaled_normals @ directions.T.astype(np.float32)
        residual = values - predicted
        spread = np.sqrt(statistics[:, :1])
        inlier = lit & (np.abs(residual) < 4 * np.maximum(spread, 0.01 * albedo[:, None]))
        highlight = lit & ~inlier & (residual > SETTINGS.highlight_threshold * albedo[:, None])
        flags = _flags(lit & ~highlight, highlight, clipped, predicted)
        used = np.count_nonzero(inlier, axis=1).astype(np.float32)
        residual_variance = np.sum(inlier * residual * residual, axis=1) / np.maximum(used - 3, 1)
        variance = angular_variance(np.maximum(residual_variance, statistics[:, 0]), statistics[:, 1], albedo, used)
        return SolveResult(normals.T, albedo, variance, np.sqrt(residual_variance), flags)

    return solve


def _glossy(directions: FloatArray, diffuse_params: FloatArray) -> Method:
    """Fit of a diffuse term and GGX lobes to each pixel, with shared diffuse parameters (3,)."""
    table = reflectance_fit.light_table(directions)

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        values, clipped = block.pixels(chosen)
        fits = reflectance_fit.fit(
            values, clipped, table, diffuse_params, reflectance_fit.initial_normals(values, clipped, directions)
        )
        width = block.stack.shape[1] // (block.stop - block.start)
        fits = reflectance_fit.refit_from_neighbours(fits, values, clipped, table, diffuse_params, chosen, width)
        diffuse = reflectance_fit.diffuse(fits.normals, table, diffuse_params) * fits.strengths[:, :1]
        lit = reflectance_fit.usable(values, clipped)
        highlight = lit & (
            values > (1 + SETTINGS.highlight_threshold) * diffuse + SETTINGS.highlight_threshold * fits.strengths[:, :1]
        )
        flags = _flags(lit & ~highlight, highlight, clipped, fits.normals @ directions.T.astype(np.float32))
        # A pixel that is all gloss has a normal too, though next to no diffuse albedo.
        albedo = np.maximum(fits.strengths[:, 0], np.float32(1e-6) * np.sum(fits.strengths, axis=1))
        residual = fits.spread * np.median(values, axis=1)
        shared = reflectance_fit.diffuse_params_variance(fits, values, clipped, table, diffuse_params)
        # Ambiguity between lobes and diffuse term, and penumbrae, show in deviations from the neighbours, if anywhere.
        # Noise shows there as well as in the residuals, so that the larger of the two holds both.
        own = np.maximum(fits.variance, np.square(reflectance_fit.neighbour_deviation(fits.normals, chosen, width)))
        variance = np.minimum(own + shared + MIN_GLOSSY_VARIANCE_RAD2, UNKNOWN_VARIANCE_RAD2).astype(np.float32)
        return SolveResult(fits.normals.T, albedo, variance, residual.astype(np.float32), flags)

    return solve


def angular_variance(
    spread: Float32Array, leverage: Float32Array, albedo: Float32Array, used: Float32Array | float
) -> Float32Array:
    """Angular variance (N,) in rad² from the variance of a measurement and the leverage, at most 60°."""
    squared = np.maximum(albedo * albedo, np.float32(1e-20))
    freedom = np.maximum(used - 3.0, 0.0)
    steady = (freedom * spread + SETTINGS.prior_count * SETTINGS.prior_residual**2 * squared) / (
        freedom + SETTINGS.prior_count
    )
    variance = np.where(np.asarray(used) >= 3, steady * leverage / squared, UNKNOWN_VARIANCE_RAD2)
    return np.minimum(variance, UNKNOWN_VARIANCE_RAD2).astype(np.float32)


def _flags(lit: BoolArray, highlight: BoolArray, clipped: BoolArray, facing: Float32Array) -> np.ndarray:
    """Flags (F, N), as in `models.result`, from masks (N, F) and n·l (N, F), whose sign tells attached from cast."""
    dark = np.where(facing < 0, ATTACHED, CAST)
    flags = np.where(lit, LIT, np.where(highlight, HIGHLIGHT, np.where(clipped, SATURATED, dark)))
    return np.ascontiguousarray(flags.T.astype(np.uint8))
