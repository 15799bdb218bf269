"""Which solver explains an object best, found from its own images: each predicts lights that it was not shown.

A fit's own residuals favour whatever has most parameters; held-out lights do not. What counts of a pixel is the error
that most of its lights stay below: high enough to see the highlights that a matt model misses, low enough for shadows,
which no model predicts, not to decide.
"""

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.normals.distant import reflectance_fit, robust_regression, solvers
from acquisition.normals.distant.solvers import Solver

FOLDS = 4
SAMPLE = 300
MOST = 0.8
"""Share of a pixel's lights whose error counts."""

FEW: tuple[Solver, ...] = ("weighted", "robust")
MANY: tuple[Solver, ...] = ("thresholded", "glossy")
ADVANTAGE = 0.97
"""A solver further down the list must beat the ones above it by this factor: simple ones are steadier and faster."""


def best(values: Float32Array, clipped: BoolArray, directions: FloatArray) -> tuple[Solver, str]:
    """The solver and a sentence that says why, from a sample of pixels (K, F)."""
    step = max(1, len(values) // SAMPLE)
    values, clipped = np.ascontiguousarray(values[::step]), np.ascontiguousarray(clipped[::step])
    many = len(directions) >= solvers.GLOSSY_LIGHTS * FOLDS // (FOLDS - 1)
    candidates = FEW + MANY if many else FEW
    if len(directions) <= FOLDS + 1:
        return "weighted", f"{len(directions)} lights leave none to test other solvers by"
    errors = {solver: held_out_error(solver, values, clipped, directions) for solver in candidates}
    chosen = candidates[0]
    for solver in candidates[1:]:
        if errors[solver] < ADVANTAGE * errors[chosen]:
            chosen = solver
    figures = ", ".join(f"{solver} {100 * error:.2f} %" for solver, error in errors.items())
    return chosen, f"error in predicting most of the lights not shown: {figures}"


def held_out_error(solver: Solver, values: Float32Array, clipped: BoolArray, directions: FloatArray) -> float:
    """Geometric mean over pixels of the relative error that MOST held-out lights stay below, over all folds."""
    count = len(directions)
    # The form's three numbers stand for all pixels: that they have seen every light tells no pixel anything.
    form = (
        reflectance_fit.matt_form(values[::2], clipped[::2], directions)
        if solver == "glossy"
        else reflectance_fit.LAMBERT
    )
    errors = np.full(values.shape, np.nan)
    order = np.random.default_rng(0).permutation(count)
    for fold in range(FOLDS):
        left = np.sort(order[fold::FOLDS])
        shown = np.setdiff1d(np.arange(count), left)
        predicted = _predict(
            solver, np.ascontiguousarray(values[:, shown]), np.ascontiguousarray(clipped[:, shown]),
            directions[shown], directions[left], form,
        )  # fmt: skip
        typical = np.maximum(np.median(values, axis=1, keepdims=True), 1e-9)
        errors[:, left] = np.abs(predicted - values[:, left]) / (values[:, left] + reflectance_fit.SOFTENING * typical)
    errors[~solvers.usable(values, clipped)] = np.nan
    known = np.count_nonzero(np.isfinite(errors), axis=1) >= 3
    if not np.any(known):
        return np.inf
    return float(np.exp(np.mean(np.log(np.nanquantile(errors[known], MOST, axis=1) + 1e-6))))


def _predict(
    solver: Solver,
    values: Float32Array,
    clipped: BoolArray,
    shown: FloatArray,
    left: FloatArray,
    form: FloatArray,
) -> FloatArray:
    """Brightness (N, L) under lights that were left out (L, 3)."""
    if solver == "glossy":
        fits = reflectance_fit.fit(
            values, clipped, reflectance_fit.light_table(shown), form, reflectance_fit.start(values, clipped, shown)
        )
        return reflectance_fit.brightness(fits, reflectance_fit.light_table(left), form)
    ranks = (0.0, 1.0) if solver == "weighted" else robust_regression.MIDDLE
    rounds = robust_regression.ROUNDS if solver == "robust" else 0
    found, _ = solvers.robust_fit(values, solvers.usable(values, clipped), shown, ranks, rounds)
    return np.maximum(found @ left.T, 0)
