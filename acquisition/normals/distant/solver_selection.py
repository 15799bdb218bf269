"""Selection of the solver by k-fold cross-validation over lights: each solver predicts held-out images.

A fit's own residuals favour the model with most parameters; held-out lights do not. A pixel counts by a high quantile
of its errors over the lights: high enough to include the highlights that a diffuse model misses, low enough to exclude
cast shadows, which no model predicts.
"""

from dataclasses import dataclass

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.models.tuned import tuned
from acquisition.normals.distant import reflectance_fit, robust_regression, solvers
from acquisition.normals.distant.solvers import Solver


@dataclass(frozen=True)
class SolverSelectionSettings:
    """Tuned numbers of the choice of a solver."""

    error_quantile: float = tuned(0.8, "quantile")
    """Quantile of a pixel's relative errors over its lights that stands for the pixel."""
    max_error_ratio: float = tuned(0.97, "1")
    """Greatest ratio of errors at which a solver further down the list replaces one above it, which is simpler and
    faster."""


SETTINGS = SolverSelectionSettings()

FOLDS = 4
"""Parts of the lights, each held out once."""

FOLDS_OF_FEW = 6
"""The same where four parts would leave fewer lights than `glossy` needs: parts of two of twelve lights."""

SAMPLE_PIXELS = 300
"""Pixels that the solvers are compared at."""

FEW_LIGHTS_SOLVERS: tuple[Solver, ...] = ("weighted", "robust")
MANY_LIGHTS_SOLVERS: tuple[Solver, ...] = ("thresholded", "glossy")


def select(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> tuple[Solver, str]:
    """Selects the solver of least held-out error at a sample of pixels (K, F); returns it with the reason in words."""
    step = max(1, len(values) // SAMPLE_PIXELS)
    values, clipped = np.ascontiguousarray(values[::step]), np.ascontiguousarray(clipped[::step])
    enough = len(directions) >= solvers.SETTINGS.min_glossy_lights
    candidates = FEW_LIGHTS_SOLVERS + MANY_LIGHTS_SOLVERS if enough else FEW_LIGHTS_SOLVERS
    if len(directions) <= FOLDS + 1:
        return "weighted", f"{len(directions)} lights leave none to test other solvers by"
    errors = {solver: held_out_error(solver, values, clipped, directions) for solver in candidates}
    chosen = candidates[0]
    for solver in candidates[1:]:
        if errors[solver] < SETTINGS.max_error_ratio * errors[chosen]:
            chosen = solver
    figures = ", ".join(f"{solver} {100 * error:.2f} %" for solver, error in errors.items())
    return chosen, f"error in predicting most of the lights not shown: {figures}"


def held_out_error(solver: Solver, values: Float32Array, clipped: BoolArray, directions: FloatArray) -> float:
    """Cross-validation error: geometric mean over pixels of the `error_quantile` of their relative errors."""
    count = len(directions)
    folds = FOLDS if count * (FOLDS - 1) // FOLDS >= solvers.SETTINGS.min_glossy_lights else FOLDS_OF_FEW
    # The three diffuse parameters are shared by all pixels, so that fitting them to all lights gives none away to a
    # pixel.
    diffuse_params = (
        reflectance_fit.estimate_diffuse_params(values[::2], clipped[::2], directions)
        if solver == "glossy"
        else reflectance_fit.LAMBERT_PARAMS
    )
    errors = np.full(values.shape, np.nan)
    order = np.random.default_rng(0).permutation(count)
    for fold in range(folds):
        held_out = np.sort(order[fold::folds])
        shown = np.setdiff1d(np.arange(count), held_out)
        predicted = _predict(
            solver, np.ascontiguousarray(values[:, shown]), np.ascontiguousarray(clipped[:, shown]),
            directions[shown], directions[held_out], diffuse_params,
        )  # fmt: skip
        typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9)
        errors[:, held_out] = np.abs(predicted - values[:, held_out]) / (
            values[:, held_out] + reflectance_fit.SETTINGS.noise_floor * typical
        )
    errors[~solvers.usable(values, clipped)] = np.nan
    known = np.count_nonzero(np.isfinite(errors), axis=1) >= 3
    if not np.any(known):
        return np.inf
    return float(np.exp(np.mean(np.log(np.nanquantile(errors[known], SETTINGS.error_quantile, axis=1) + 1e-6))))


def _predict(
    solver: Solver,
    values: Float32Array,
    clipped: BoolArray,
    shown: FloatArray,
    held_out: FloatArray,
    diffuse_params: FloatArray,
) -> FloatArray:
    """Predicts the brightness (N, L) under held-out lights (L, 3) from the fit to the lights `shown` (F, 3)."""
    if solver == "glossy":
        fits = reflectance_fit.fit(
            values,
            clipped,
            reflectance_fit.light_table(shown),
            diffuse_params,
            reflectance_fit.initial_normals(values, clipped, shown),
        )
        return reflectance_fit.brightness(fits, reflectance_fit.light_table(held_out), diffuse_params)
    ranks = (0.0, 1.0) if solver == "weighted" else robust_regression.SETTINGS.position_thresholds
    rounds = robust_regression.MAX_ITERATIONS if solver == "robust" else 0
    scaled_normals, _ = solvers.robust_fit(values, solvers.shadow_weights(values, clipped), shown, ranks, rounds)
    return np.maximum(scaled_normals @ held_out.T, 0)
