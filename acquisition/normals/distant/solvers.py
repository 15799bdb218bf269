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

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED
from acquisition.models.tuned import tuned
from acquisition.normals.distant import least_squares_kernels, reflectance_fit, robust_regression
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
    inverse = np.linalg.pinv(directions)
    covariance = np.linalg.inv(directions.T @ directions)

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        size = block.stack.shape[1]
        normals, albedo = np.empty((3, size), np.float32), np.empty(size, np.float32)
        least_squares_kernels.least_squares(
            block.stack, np.ascontiguousarray(inverse * block.scale, dtype=np.float32), normals, albedo
        )
        normals, albedo = normals[:, chosen], albedo[chosen]
        predicted = directions.astype(np.float32) @ (normals * albedo)
        picked = block.stack[:, chosen]
        squared = np.mean((picked * block.scale[:, None] - predicted) ** 2, axis=0) * len(directions)
        loose = np.trace(covariance) - np.einsum("in,ij,jn->n", normals, covariance.astype(np.float32), normals)
        spread = squared / max(len(directions) - 3, 1)
        flags = np.full(picked.shape, LIT, np.uint8)
        flags[picked >= block.clipped_from] = SATURATED
        variance = angular_variance(spread, loose.astype(np.float32), albedo, float(len(directions)))
        return SolveResult(normals, albedo, variance, np.sqrt(spread).astype(np.float32), flags)

    return solve


def _weighted(directions: FloatArray) -> Method:
    """Lambertian least squares without clipped, shadowed and highlight measurements."""
    light = np.ascontiguousarray(directions, dtype=np.float32)

    def solve(block: Block, chosen: np.ndarray) -> SolveResult:
        count, size = block.stack.shape
        normals, flags = np.empty((3, size), np.float32), np.empty((count, size), np.uint8)
        albedo, loose, spread = (np.empty(size, np.float32) for _ in range(3))
        limits = np.array([block.clipped_from, SETTINGS.shadow_threshold, SETTINGS.highlight_threshold], np.float32)
        least_squares_kernels.weighted(block.stack, block.scale, light, limits, normals, albedo, loose, spread, flags)
        picked = flags[:, chosen]
        used = np.count_nonzero(picked == LIT, axis=0).astype(np.float32)
        variance = angular_variance(spread[chosen], loose[chosen], albedo[chosen], used)
        residual = np.sqrt(spread[chosen])
        return SolveResult(normals[:, chosen], albedo[chosen], variance, residual, picked)

    return solve


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
