"""The solvers for distant light, each as a function from a block of pixels to what was found there.

All share one account of uncertainty: the variance of a measurement comes from the pixel's own residuals, steadied by a
weak prior since few lights leave few residuals, and is carried to the normal by the leverage of the measurements used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.result import ATTACHED, CAST, HIGHLIGHT, LIT, SATURATED
from acquisition.normals.distant import least_squares_kernels, reflectance_fit, robust_regression
from acquisition.normals.distant.pixel_blocks import Block

Solver = Literal["auto", "ls", "weighted", "thresholded", "robust", "glossy"]

SHADOW = 0.05
"""Share of a pixel's largest unclipped value below which a measurement is in shadow."""

EXCESS = 0.1
"""Share of the albedo by which a highlight exceeds a matt surface."""

GLOSSY_LIGHTS = 12
"""Least lights for normal, matt part and lobes of each pixel."""

PRIOR_SPREAD = 0.01
PRIOR_COUNT = 2.0
"""What the residuals are expected to be, as a share of the albedo, and how many residuals that expectation counts."""

FORM_SAMPLE = 400
LEAST_RAD2 = np.float32(np.radians(0.15) ** 2)
"""Variance of a glossy fit's normals, over both directions, that directions and intensities of lights leave."""

UNKNOWN_RAD2 = np.float32(np.radians(60.0) ** 2)


@dataclass(frozen=True)
class Found:
    """Of N pixels of a block."""

    normals: Float32Array  # (3, N)
    albedo: Float32Array  # (N,) brightness of a matt surface facing a light of intensity 1
    variance: Float32Array  # (N,) rad², both tangential directions
    residual: Float32Array  # (N,) rms of the residuals that were used, in units of brightness
    flags: np.ndarray  # (F, N) uint8


Method = Callable[[Block, np.ndarray], Found]
"""Solves the pixels of a block that are given by their numbers."""


def prepare(
    solver: Solver, values: Float32Array, clipped: BoolArray, directions: FloatArray
) -> tuple[Method, dict[str, Any]]:
    """The method and what is to be noted of it; what it needs to know of the whole comes from a sample (K, F).

    Raises RigError normals.infeasible where `glossy` or `thresholded` is asked of too few lights.
    """
    if solver in {"glossy", "thresholded"} and len(directions) < GLOSSY_LIGHTS:
        raise RigError(
            ErrorCode.NORMALS_INFEASIBLE,
            f"{solver} needs {GLOSSY_LIGHTS} lights or more, these are {len(directions)}: ask for robust or add images",
        )
    match solver:
        case "ls":
            return _plain(directions), {"grey": "0.2989 R + 0.5870 G + 0.1140 B"}
        case "weighted":
            return _weighted(directions), {"shadow_share": SHADOW}
        case "glossy":
            step = max(1, len(values) // FORM_SAMPLE)
            form = reflectance_fit.matt_form(values[::step], clipped[::step], directions)
            names = ("kappa", "omega", "gamma")
            return _glossy(directions, form), {"matt_form": dict(zip(names, form.tolist(), strict=True))}
        case _:
            return _robust(directions, rounds=0 if solver == "thresholded" else robust_regression.ROUNDS), {}


def usable(values: Float32Array, clipped: BoolArray) -> BoolArray:
    """Which measurements (N, F) are neither clipped nor in shadow."""
    largest = np.max(np.where(clipped, 0, values), axis=1, keepdims=True)
    return ~clipped & (values > 0) & (values >= np.float32(SHADOW) * largest)


def robust_fit(
    values: Float32Array, lit: BoolArray, directions: FloatArray, ranks: tuple[float, float], rounds: int
) -> tuple[Float32Array, Float32Array]:
    """Albedo × normal (N, 3); variance of one measurement and leverage (N, 2)."""
    found, figures = np.empty((len(values), 3), np.float32), np.empty((len(values), 2), np.float32)
    many = len(directions) >= robust_regression.MANY_LIGHTS or rounds == 0
    chosen, inverses = (
        (np.empty((0, 3), np.int64), np.empty((0, 3, 3))) if many else robust_regression.triples(directions)
    )  # fmt: skip
    settings = np.array([*ranks, robust_regression.CAUCHY_SCALE if rounds else 0.0, rounds])
    light = np.ascontiguousarray(directions, dtype=np.float64)
    robust_regression.solve(values, lit.astype(np.uint8), light, chosen, inverses, settings, found, figures)
    return found, figures


def _plain(directions: FloatArray) -> Method:
    """Least squares of all measurements, nothing left out."""
    inverse = np.linalg.pinv(directions)
    covariance = np.linalg.inv(directions.T @ directions)

    def solve(block: Block, chosen: np.ndarray) -> Found:
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
        return Found(normals, albedo, variance, np.sqrt(spread).astype(np.float32), flags)

    return solve


def _weighted(directions: FloatArray) -> Method:
    """Least squares of what is neither clipped, nor in shadow, nor a highlight."""
    light = np.ascontiguousarray(directions, dtype=np.float32)

    def solve(block: Block, chosen: np.ndarray) -> Found:
        count, size = block.stack.shape
        normals, flags = np.empty((3, size), np.float32), np.empty((count, size), np.uint8)
        albedo, loose, spread = (np.empty(size, np.float32) for _ in range(3))
        limits = np.array([block.clipped_from, SHADOW, EXCESS], np.float32)
        least_squares_kernels.weighted(block.stack, block.scale, light, limits, normals, albedo, loose, spread, flags)
        picked = flags[:, chosen]
        used = np.count_nonzero(picked == LIT, axis=0).astype(np.float32)
        variance = angular_variance(spread[chosen], loose[chosen], albedo[chosen], used)
        residual = np.sqrt(spread[chosen])
        return Found(normals[:, chosen], albedo[chosen], variance, residual, picked)

    return solve


def _robust(directions: FloatArray, rounds: int) -> Method:
    """Cauchy weights, or with no round the middle ranks alone."""

    def solve(block: Block, chosen: np.ndarray) -> Found:
        values, clipped = block.pixels(chosen)
        lit = usable(values, clipped)
        found, figures = robust_fit(values, lit, directions, robust_regression.MIDDLE, rounds)
        albedo = np.linalg.norm(found, axis=1)
        normals = found / np.maximum(albedo, 1e-20)[:, None]
        predicted = found @ directions.T.astype(np.float32)
        rest = values - predicted
        spread = np.sqrt(figures[:, :1])
        near = lit & (np.abs(rest) < 4 * np.maximum(spread, 0.01 * albedo[:, None]))
        highlight = lit & ~near & (rest > EXCESS * albedo[:, None])
        flags = _flags(lit & ~highlight, highlight, clipped, predicted)
        used = np.count_nonzero(near, axis=1).astype(np.float32)
        left = np.sum(near * rest * rest, axis=1) / np.maximum(used - 3, 1)
        variance = angular_variance(np.maximum(left, figures[:, 0]), figures[:, 1], albedo, used)
        return Found(normals.T, albedo, variance, np.sqrt(left), flags)

    return solve


def _glossy(directions: FloatArray, form: FloatArray) -> Method:
    """Matt part and lobes of each pixel, the matt part's form given."""
    table = reflectance_fit.light_table(directions)

    def solve(block: Block, chosen: np.ndarray) -> Found:
        values, clipped = block.pixels(chosen)
        fits = reflectance_fit.fit(values, clipped, table, form, reflectance_fit.start(values, clipped, directions))
        width = block.stack.shape[1] // (block.stop - block.start)
        fits = reflectance_fit.from_neighbours(fits, values, clipped, table, form, chosen, width)
        matt = reflectance_fit.matt(fits.normals, table, form) * fits.strengths[:, :1]
        lit = reflectance_fit.trusted(values, clipped)
        highlight = lit & (values > (1 + EXCESS) * matt + EXCESS * fits.strengths[:, :1])
        flags = _flags(lit & ~highlight, highlight, clipped, fits.normals @ directions.T.astype(np.float32))
        # A pixel that is all gloss has a normal too, though no matt albedo to speak of.
        albedo = np.maximum(fits.strengths[:, 0], np.float32(1e-6) * np.sum(fits.strengths, axis=1))
        residual = fits.spread * np.median(values, axis=1)
        bent = reflectance_fit.form_variance(fits, values, clipped, table, form)
        # What lobes and matt part trade with each other, and shadows half cast, show among neighbours, if anywhere.
        # Noise shows there as well as in the residuals, so that the larger of the two holds both.
        own = np.maximum(fits.variance, np.square(reflectance_fit.roughness(fits.normals, chosen, width)))
        variance = np.minimum(own + bent + LEAST_RAD2, UNKNOWN_RAD2).astype(np.float32)
        return Found(fits.normals.T, albedo, variance, residual.astype(np.float32), flags)

    return solve


def angular_variance(
    spread: Float32Array, leverage: Float32Array, albedo: Float32Array, used: Float32Array | float
) -> Float32Array:
    """Angular variance (N,) in rad² from the variance of a measurement and the leverage; unknown where none lit it."""
    squared = np.maximum(albedo * albedo, np.float32(1e-20))
    freedom = np.maximum(used - 3.0, 0.0)
    steady = (freedom * spread + PRIOR_COUNT * PRIOR_SPREAD**2 * squared) / (freedom + PRIOR_COUNT)
    variance = np.where(np.asarray(used) >= 3, steady * leverage / squared, UNKNOWN_RAD2)
    return np.minimum(variance, UNKNOWN_RAD2).astype(np.float32)


def _flags(lit: BoolArray, highlight: BoolArray, clipped: BoolArray, facing: Float32Array) -> np.ndarray:
    """Bit fields (F, N) from masks (N, F) and from which way the light comes (N, F)."""
    dark = np.where(facing < 0, ATTACHED, CAST)
    flags = np.where(lit, LIT, np.where(highlight, HIGHLIGHT, np.where(clipped, SATURATED, dark)))
    return np.ascontiguousarray(flags.T.astype(np.uint8))
