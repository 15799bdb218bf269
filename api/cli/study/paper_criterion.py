"""Numerical check of the paper's figures: Gardi, Walter and Garbe's A-optimality criterion for three distant lights.

The criterion is the mean over the object's normals of tr(B (SᵀS)⁻¹ Bᵀ), B = I − n nᵀ. For unit albedo it equals tr(M
(SᵀS)⁻¹) with M the mean of B. For unit lights its minimum has the closed form (tr √M)²/m (the eigenvalues of SᵀS have
the fixed sum m), so that the result of a search can be compared with the optimum. Like the paper, this part omits near
light, shadows and more than three images; the other parts of the study include them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from acquisition import geometry
from acquisition.models.base import FloatArray
from api.cli.study.simulated_scene import Scene

RANDOM_TRIPLES = 1_000_000
BATCH = 100_000
STARTS = 12
DESCENT_STEPS = 400
DESCENT_RATE = 0.5
REPORTED_PHI = {"ours": 0.0211, "heuristic": 1.8657}
"""Values in the paper's figure 9."""


@dataclass(frozen=True)
class Placement:
    """Minima of the criterion for three unit lights and one object, and its distribution over random triples.

    `heuristic_curve` holds slant (deg) and value of equally spaced lights; `percentiles` those of the random triples at
    `PERCENTS`.
    """

    object: str
    bound: float
    ours: float
    best_random: float
    best_heuristic: float
    best_heuristic_slant_deg: float
    drbohlav: float
    heuristic_curve: list[tuple[float, float]]
    percentiles: list[float]
    triples: int


PERCENTS = (0.0, 0.01, 0.1, 1.0, 10.0, 25.0, 50.0, 75.0, 90.0)


@dataclass(frozen=True)
class Errata:
    """Numerical check of the paper's formulas; the names are keys of `study.json`.

    `idempotence`: ‖B² − B‖/‖B‖ at albedo 1, 0.5 and 0.25. `scaled_idempotence`: the same for B² − B/|Ñ|.
    `trace_times_norm`: tr(B)·|Ñ|, which should be 2. `gradient_error`: relative difference between Appendix A with the
    element-wise product and finite differences. `matrix_product_cosine`: median cosine between the gradient with the
    matrix product and the true one. `literal`: value and mean |s| during descent on Eq. 23 without a bound on |s|.
    """

    idempotence: dict[str, float]
    scaled_idempotence: dict[str, float]
    trace_times_norm: dict[str, float]
    gradient_error: float
    matrix_product_cosine: float
    literal: list[tuple[int, float, float]]
    scale_law_error: float
    single_normal_bound: float
    single_normal_random: float


def phi(lights: FloatArray, weight: FloatArray) -> FloatArray:
    """Computes tr(M (SᵀS)⁻¹) of light sets (..., m, 3) with M (3, 3); infinite where the lights lie in one plane."""
    gram = np.einsum("...ki,...kj->...ij", lights, lights)
    a, b, c = gram[..., 0, 0], gram[..., 0, 1], gram[..., 0, 2]
    d, e, f = gram[..., 1, 1], gram[..., 1, 2], gram[..., 2, 2]
    adjugate = np.stack(
        [d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b], axis=-1
    )
    determinant = a * adjugate[..., 0] + b * adjugate[..., 1] + c * adjugate[..., 2]
    upper = np.array([weight[0, 0], 2 * weight[0, 1], 2 * weight[0, 2], weight[1, 1], 2 * weight[1, 2], weight[2, 2]])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(determinant > 1e-12, adjugate @ upper / determinant, np.inf)


def gradient(lights: FloatArray, weight: FloatArray) -> FloatArray:
    """Computes ∂ tr(M (SᵀS)⁻¹)/∂S (m, 3): Appendix A with the element-wise product."""
    inverse = np.linalg.inv(lights.T @ lights)
    return -2 * lights @ inverse @ weight @ inverse


def lower_bound(weight: FloatArray, count: int) -> float:
    """Returns the minimum for `count` unit lights, (tr √M)²/m."""
    return float(np.sum(np.sqrt(np.linalg.eigvalsh(weight))) ** 2 / count)


def mean_projector(scene: Scene) -> FloatArray:
    """Returns M (3, 3), the mean of I − n nᵀ over the graded pixels' true normals, view frame."""
    true = scene.geometry.truth.normals[scene.graded].astype(float)
    return np.eye(3) - true.T @ true / len(true)


def best_unit_lights(weight: FloatArray, count: int, seed: int, starts: int = STARTS) -> FloatArray:
    """Minimises the criterion over unit lights (count, 3), z ≥ 0, by quasi-Newton on the sphere from random starts."""
    rng = np.random.default_rng(seed)

    def descend(flat: FloatArray) -> tuple[float, FloatArray]:
        raw = flat.reshape(count, 3)
        length = np.linalg.norm(raw, axis=1, keepdims=True)
        units = raw / length
        slope = gradient(units, weight)
        slope = (slope - np.sum(slope * units, axis=1, keepdims=True) * units) / length
        return float(phi(units, weight)), slope.ravel()

    solutions = [
        minimize(descend, rng.normal(size=3 * count), jac=True, method="L-BFGS-B", options={"maxiter": 300})
        for _ in range(starts)
    ]
    best = min(solutions, key=lambda result: float(result.fun)).x.reshape(count, 3)
    best /= np.linalg.norm(best, axis=1, keepdims=True)
    return np.where(best[:, 2:] < 0, -best, best)  # the criterion is even in s; lamps are above the object


def placement(scene: Scene, seed: int, triples: int = RANDOM_TRIPLES) -> Placement:
    """Reproduces figure 9 for one object: random triples of the upper half space, the heuristic, ours and the bound."""
    weight = mean_projector(scene)
    rng = np.random.default_rng(seed)
    values: list[FloatArray] = []
    for start in range(0, triples, BATCH):
        drawn = rng.normal(size=(min(BATCH, triples - start), 3, 3))
        drawn /= np.linalg.norm(drawn, axis=-1, keepdims=True)
        values.append(phi(drawn, weight))
    spread = np.concatenate(values)
    slants = np.arange(2.0, 89.5, 0.5)
    even = geometry.direction(np.radians(slants)[:, None], np.arange(3) * 2 * np.pi / 3)
    curve = phi(even, weight)
    least = int(np.argmin(curve))
    diagonal = phi(geometry.direction(np.arccos(1 / np.sqrt(3)), np.arange(3) * 2 * np.pi / 3), weight)
    return Placement(
        object=scene.geometry.shape,
        bound=lower_bound(weight, 3),
        ours=float(phi(best_unit_lights(weight, 3, seed), weight)),
        best_random=float(np.min(spread)),
        best_heuristic=float(curve[least]),
        best_heuristic_slant_deg=float(slants[least]),
        drbohlav=float(diagonal),
        heuristic_curve=[(float(slant), float(value)) for slant, value in zip(slants, curve, strict=True)],
        percentiles=[float(value) for value in np.percentile(spread, PERCENTS, method="lower")],
        triples=triples,
    )


def errata(weight: FloatArray, seed: int, triples: int = RANDOM_TRIPLES) -> Errata:
    """Checks the errata for the object of mean projector `weight` (3, 3)."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    projector = np.eye(3) - np.outer(normal, normal)
    jacobians = {f"{albedo:g}": projector / albedo for albedo in (1.0, 0.5, 0.25)}

    def relative_difference(one: FloatArray, other: FloatArray) -> float:
        return float(np.linalg.norm(one - other) / np.linalg.norm(other))

    cosines, errors = zip(*(_gradients(rng, weight) for _ in range(200)), strict=True)
    lights = rng.normal(size=(3, 3))
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    single = rng.normal(size=(triples, 3, 3))
    single /= np.linalg.norm(single, axis=-1, keepdims=True)
    return Errata(
        idempotence={albedo: relative_difference(b @ b, b) for albedo, b in jacobians.items()},
        scaled_idempotence={albedo: relative_difference(b @ b, b / float(albedo)) for albedo, b in jacobians.items()},
        trace_times_norm={albedo: float(np.trace(b)) * float(albedo) for albedo, b in jacobians.items()},
        gradient_error=float(np.max(errors)),
        matrix_product_cosine=float(np.median(cosines)),
        literal=_unconstrained_descent(lights, weight),
        scale_law_error=float(abs(phi(3 * lights, weight) * 9 / phi(lights, weight) - 1)),
        single_normal_bound=lower_bound(projector, 3),
        single_normal_random=float(np.min(phi(single, projector))),
    )


def _gradients(rng: np.random.Generator, weight: FloatArray) -> tuple[float, float]:
    """For random unit lights and one normal: cosine of the matrix-product gradient, error of the element-wise one.

    Read with a matrix product, Appendix A differentiates the sum of all entries of B (SᵀS)⁻¹ B instead of its trace.
    """
    lights = rng.normal(size=(3, 3))
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    true = gradient(lights, weight)
    step = 1e-6
    numeric = np.zeros((3, 3))
    for entry in np.ndindex(3, 3):
        moved = np.zeros((3, 3))
        moved[entry] = step
        numeric[entry] = (phi(lights + moved, weight) - phi(lights - moved, weight)) / (2 * step)
    normal = rng.normal(size=3)
    normal[2] = abs(normal[2])
    normal /= np.linalg.norm(normal)
    projector = np.eye(3) - np.outer(normal, normal)
    inverse = np.linalg.inv(lights.T @ lights)
    summed = np.sum(projector, axis=0)
    wrong = -2 * lights @ inverse @ np.outer(summed, summed) @ inverse
    right = gradient(lights, projector)
    cosine = float(np.sum(wrong * right) / (np.linalg.norm(wrong) * np.linalg.norm(right) + 1e-300))
    return cosine, float(np.linalg.norm(numeric - true) / np.linalg.norm(true))


def _unconstrained_descent(start: FloatArray, weight: FloatArray) -> list[tuple[int, float, float]]:
    """Returns step, value and mean |s| of plain gradient descent on Eq. 23 without constraints."""
    lights, trace = start.copy(), []
    for step in range(DESCENT_STEPS + 1):
        if step in (0, 1, 3, 10, 30, 100, 200, DESCENT_STEPS):
            trace.append((step, float(phi(lights, weight)), float(np.mean(np.linalg.norm(lights, axis=1)))))
        slope = gradient(lights, weight)
        lights = lights - DESCENT_RATE * slope / max(1.0, float(np.linalg.norm(slope)))
    return trace
