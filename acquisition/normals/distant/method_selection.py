"""Which solver explains an object best, found from its own images: each predicts lights that it was not shown.

A fit's own residuals favour whatever has most parameters; held-out lights do not. What counts of a pixel is the error
that most of its lights stay below: high enough to see the highlights that a matt model misses, low enough for shadows,
which no model predicts, not to decide.
"""

import numpy as np

from acquisition.models.base import BoolArray, Float32Array, FloatArray
from acquisition.normals.distant import glossy, methods, robust
from acquisition.normals.distant.methods import Solver

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
    many = len(directions) >= methods.GLOSSY_LIGHTS * FOLDS // (FOLDS - 1)
    solvers = FEW + MANY if many else FEW
    if len(directions) <= FOLDS + 1:
        return "weighted", f"{len(directions)} lights leave none to test other solvers by"
    errors = {solver: held_out_error(solver, values, clipped, directions) for solver in solvers}
    chosen = solvers[0]
    for solver in solvers[1:]:
        if errors[solver] < ADVANTAGE * errors[chosen]:
            chosen = solver
    figures = ", ".join(f"{solver} {100 * error:.2f} %" for solver, error in errors.items())
    return chosen, f"error in predicting most of the lights not shown: {figures}"


def held_out_error(solver: Solver, values: Float32Array, clipped: BoolArray, directions: FloatArray) -> float:
    """Geometric mean over pixels of the relative error that MOST held-out lights stay below, over all folds."""
    count = len(directions)
    # The form's three numbers stand for all pixels: that they have seen every light tells no pixel anything.
    form = glossy.matt_form(values[::2], clipped[::2], directions) if solver == "glossy" else glossy.LAMBERT
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
        errors[:, left] = np.abs(predicted - values[:, left]) / (values[:, left] + glossy.SOFTENING * typical)
    errors[~methods.usable(values, clipped)] = np.nan
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
        fits = glossy.fit(values, clipped, glossy.light_table(shown), form, glossy.start(values, clipped, shown))
        return glossy.brightness(fits, glossy.light_table(left), form)
    ranks = (0.0, 1.0) if solver == "weighted" else robust.MIDDLE
    rounds = robust.ROUNDS if solver == "robust" else 0
    found, _ = methods.robust_fit(values, methods.usable(values, clipped), shown, ranks, rounds)
    return np.maximum(found @ left.T, 0)
