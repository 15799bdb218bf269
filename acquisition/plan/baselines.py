"""Fixed light patterns for comparison: two rings, one ring, Drbohlav–Chantler, Gardi–Walter–Garbe, maximin, random.

Ring patterns are ideal directions, assigned to the nearest reachable positions; the others are drawn from the reachable
positions. `two-rings` is the strongest pattern from eight lights on. Completed round the captured lights, it is a start
of the planner's search and its reference.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from acquisition import geometry, lamp_pose
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.listing import refused_lights
from acquisition.models.recipe import Method, Recipe
from acquisition.models.route import ArmReach, Reach

INNER_SLANT_DEG, OUTER_SLANT_DEG = 25.0, 55.0
"""Slants of the two rings; decision 0029."""
DRBOHLAV_SLANT_DEG = 54.74
"""arccos(1/√3): orthogonal lights when there are three (Drbohlav and Chantler 2005)."""

AZIMUTH_STEPS = 12
"""Number of azimuths of a ring pattern that are tried, at equal fractions of its step."""
FAR_DEG = 10.0
"""Angle between a light and its position in the pattern above which the plan has a note."""


def baseline(method: Method, count: int, recipe: Recipe, reach: Reach) -> LightPlan:
    """Returns the fixed light pattern of a method, without a prediction of σ.

    Raises RigError plan.infeasible when the reach does not allow so many lights, and request.invalid for a method that
    is not a pattern.
    """
    if method in ("optimal", "user"):
        raise RigError(ErrorCode.REQUEST_INVALID, f"method `{method}` is not a fixed pattern")
    units, notes = lamp_pose.directions(reach.candidates, reach.center, count), list[str]()
    if method == "random":
        chosen = np.random.default_rng(recipe.seed).permutation(len(units))[:count].tolist()
        reasons = ["drawn at random"] * count
    elif method == "max-distance":
        chosen, reasons = _maximin(units, count), ["maximin distance to the other lights"] * count
    else:
        chosen, miss_deg = _nearest_pattern(method, count, recipe, units)
        least = "least trace of the inverse Gram matrix, unit lights"
        why = least if method == "paper" else f"position in the pattern {method}"
        reasons = [f"{why}, {one:.0f}° off" for one in miss_deg]
        if np.max(miss_deg) > FAR_DEG:
            notes.append(
                f"{np.count_nonzero(miss_deg > FAR_DEG)} of {count} lights are more than {FAR_DEG:g}° from their "
                "position in the pattern: the arm cannot reach closer"
            )
    return LightPlan(
        lights=[lamp_pose.light_at(position, reach.center) for position in reach.candidates[chosen]],
        method=method,
        reasons=[f"{describe_direction(unit)}: {reason}" for unit, reason in zip(units[chosen], reasons, strict=True)],
        notes=notes,
    )


def _nearest_pattern(method: Method, count: int, recipe: Recipe, units: FloatArray) -> tuple[list[int], FloatArray]:
    """Assigns candidates to a ring pattern, at the azimuth where they are nearest to it. Returns their numbers, and the
    angles (count,), degrees, between them and their positions in the pattern."""
    slants = {
        "ring": np.radians(recipe.slant_deg),
        "drbohlav": np.radians(DRBOHLAV_SLANT_DEG),
        "paper": np.max(geometry.slant_azimuth(units)[0]),
    }
    ideals = (
        two_rings(count, turn) if method == "two-rings" else ring(count, slants[method], turn)
        for turn in np.arange(AZIMUTH_STEPS) / AZIMUTH_STEPS
    )
    chosen, miss = lamp_pose.nearest_pattern(ideals, units)
    return chosen, np.degrees(miss)


def two_rings(count: int, turn: float = 0.0) -> FloatArray:
    """Two-ring pattern: unit directions (count, 3), a third at 25°, the rest at 55°. The inner ring is turned by half a
    step of the outer one, and both by `turn` of that step."""
    inner = round(count / 3) if count > 3 else 0
    outer = count - inner
    step = 2 * np.pi / outer
    around = (turn + 0.5) * step + np.arange(inner) * 2 * np.pi / max(inner, 1)
    outside = geometry.direction(np.radians(OUTER_SLANT_DEG), (turn + np.arange(outer)) * step)
    return np.concatenate([geometry.direction(np.radians(INNER_SLANT_DEG), around), outside])


def ring(count: int, slant_rad: float, turn: float = 0.0) -> FloatArray:
    """One ring: unit directions (count, 3) at equal steps of azimuth, the first at `turn` of a step.

    At the greatest allowed slant θ, a ring of m ≥ 3 lights minimises the criterion of Gardi, Walter and Garbe for a
    surface that faces the camera: of m unit lights S, tr(B(SᵀS)⁻¹Bᵀ) with B = I − n nᵀ is at least 4/(m sin²θ).
    """
    return geometry.direction(slant_rad, (turn + np.arange(count)) * 2 * np.pi / count)


def two_ring_completions(captured: FloatArray, units: FloatArray, count: int) -> list[list[int]]:
    """Completes the unit lights `captured` (T, 3) to two rings with `count` of the candidates `units` (K, 3).

    Each captured light fills one position of the pattern (linear assignment by least squared angle), candidates fill
    the others. Returns a set of distinct numbers for each turn of the rings, that with the best fit first.
    """
    scored: list[tuple[float, list[int]]] = []
    for turn in np.arange(AZIMUTH_STEPS) / AZIMUTH_STEPS:
        ideal = two_rings(len(captured) + count, float(turn))
        squared = np.arccos(np.clip(captured @ ideal.T, -1, 1)) ** 2
        rows, filled = linear_sum_assignment(squared)
        chosen, _ = lamp_pose.nearest_distinct(np.delete(ideal, filled, axis=0), units)
        scored.append((float(np.sum(squared[rows, filled])), chosen))
    return [chosen for _, chosen in sorted(scored)]


def _maximin(units: FloatArray, count: int) -> list[int]:
    """Maximin design: chooses candidates with the largest minimum angle by farthest-point selection, then exchange."""
    cosines = np.clip(units @ units.T, -1, 1)
    chosen = [int(np.argmax(units[:, 2]))]
    while len(chosen) < count:
        chosen.append(int(np.argmin(np.max(cosines[:, chosen], axis=1))))
    improved = True
    while improved:
        improved = False
        for slot in range(count):
            others = [index for number, index in enumerate(chosen) if number != slot]
            closest = np.max(cosines[:, others], axis=1)
            closest[others] = np.inf
            best = int(np.argmin(closest))
            if closest[best] < closest[chosen[slot]] - 1e-12:
                chosen[slot] = best
                improved = True
    return chosen


def describe_direction(unit: FloatArray) -> str:
    """Slant and azimuth of a unit direction as text."""
    slant, azimuth = geometry.slant_azimuth(unit)
    return f"slant {np.degrees(slant):.0f}°, azimuth {np.degrees(azimuth) % 360:.0f}°"


def user_lights(recipe: Recipe, reach: ArmReach) -> LightPlan:
    """Returns the user's own lights. Raises RigError waypoints.unreachable naming those that the arm cannot reach."""
    positions = np.array(recipe.user_lights, dtype=float).reshape(-1, 3)
    refusals = {
        number: refusal for number, position in enumerate(positions) if (refusal := reach.allows(position)) is not None
    }
    if refusals:
        raise RigError(
            ErrorCode.WAYPOINTS_UNREACHABLE,
            refused_lights([f"user light {number}: {refusal.detail}" for number, refusal in refusals.items()]),
            lights=[refusal.of_light(number) for number, refusal in refusals.items()],
        )
    return LightPlan(
        lights=[lamp_pose.light_at(position, reach.center) for position in positions],
        method="user",
        reasons=["given by the user"] * len(positions),
    )
