"""Fixed patterns that planning is compared with: geometry, and errors where the arm cannot reach them."""

import numpy as np
import pytest

from acquisition import geometry, plan
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Method, Recipe
from acquisition.plan import baselines
from tests.acquisition.scenes import Dome

PATTERNS: list[Method] = ["two-rings", "ring", "drbohlav", "max-distance", "paper", "random"]


def units(chosen: LightPlan, reach: Dome) -> FloatArray:
    return (np.array([light.position for light in chosen.lights]) - reach.center) / reach.radius_m


def slants_deg(chosen: LightPlan, reach: Dome) -> FloatArray:
    return np.degrees(geometry.slant_azimuth(units(chosen, reach))[0])


def azimuths_deg(directions: FloatArray) -> FloatArray:
    return np.degrees(geometry.slant_azimuth(directions)[1]) % 360


@pytest.mark.parametrize("method", PATTERNS)
@pytest.mark.parametrize("count", [4, 8, 20])
def test_baseline_all_methods_gives_distinct_candidates_and_reasons(method: Method, count: int) -> None:
    reach = Dome(seed=3)
    chosen = plan.baseline(method, count, Recipe(method=method, seed=5), reach)
    positions = np.array([light.position for light in chosen.lights])
    distance = np.linalg.norm(positions[:, None] - reach.candidates[None], axis=-1)
    assert np.all(distance.min(axis=1) < 1e-12)
    assert len(set(distance.argmin(axis=1))) == count
    assert chosen.method == method
    assert len(chosen.reasons) == count
    assert all(reason.startswith("slant ") for reason in chosen.reasons)
    assert chosen.predicted_sigma_deg is None
    assert chosen.predicted_median_deg is None


@pytest.mark.parametrize("count", [6, 8, 9, 12, 20])
def test_two_rings_many_lights_has_a_third_inside_staggered(count: int) -> None:
    lights = baselines.two_rings(count, turn=0.3)
    slant = np.degrees(geometry.slant_azimuth(lights)[0])
    inner = lights[np.isclose(slant, 25)]
    outer = lights[np.isclose(slant, 55)]
    assert len(inner) == round(count / 3)
    assert len(inner) + len(outer) == count
    for ring in (inner, outer):
        around = np.sort(azimuths_deg(ring))
        np.testing.assert_allclose(np.diff(np.append(around, around[0] + 360)), 360 / len(ring), atol=1e-6)
    first = np.abs((azimuths_deg(inner[:1]) - azimuths_deg(outer) + 180) % 360 - 180)
    assert np.min(first) == pytest.approx(180 / len(outer))


def test_two_rings_three_or_fewer_lights_is_one_ring() -> None:
    for count in (1, 2, 3):
        slant = geometry.slant_azimuth(baselines.two_rings(count))[0]
        np.testing.assert_allclose(np.degrees(slant), 55)


@pytest.mark.parametrize(("method", "slant_deg"), [("ring", 25.0), ("ring", 60.0), ("drbohlav", 54.7356)])
def test_baseline_ring_has_its_slant_and_even_azimuths(method: Method, slant_deg: float) -> None:
    reach = Dome(count=3000, refused=0)
    recipe = Recipe(method=method, slant_deg=slant_deg if method == "ring" else 45.0)
    chosen = plan.baseline(method, 6, recipe, reach)
    np.testing.assert_allclose(slants_deg(chosen, reach), slant_deg, atol=2.0)
    around = np.sort(azimuths_deg(units(chosen, reach)))
    np.testing.assert_allclose(np.diff(np.append(around, around[0] + 360)), 60, atol=5)
    assert not chosen.notes


def test_baseline_drbohlav_three_lights_are_orthogonal() -> None:
    lights = geometry.direction(np.radians(baselines.DRBOHLAV_SLANT_DEG), np.arange(3) * 2 * np.pi / 3)
    np.testing.assert_allclose(lights @ lights.T, np.eye(3), atol=2e-4)


def test_baseline_random_is_reproduced_by_its_seed_only() -> None:
    reach = Dome()
    drawn = [plan.baseline("random", 8, Recipe(method="random", seed=seed), reach).lights for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]


def test_baseline_random_covers_the_full_reach() -> None:
    reach = Dome(refused=0)
    all_units = np.concatenate(
        [units(plan.baseline("random", 20, Recipe(method="random", seed=seed), reach), reach) for seed in range(30)]
    )
    expected = np.mean((reach.candidates - reach.center) / reach.radius_m, axis=0)
    np.testing.assert_allclose(all_units.mean(axis=0), expected, atol=0.1)


@pytest.mark.parametrize("count", [4, 8, 12])
def test_baseline_max_distance_has_greatest_minimum_angle(count: int) -> None:
    reach = Dome(refused=0)

    def least_angle(directions: FloatArray) -> float:
        cosine = directions @ directions.T - 2 * np.eye(count)
        return float(np.arccos(np.max(cosine)))

    ours = least_angle(units(plan.baseline("max-distance", count, Recipe(method="max-distance"), reach), reach))
    all_units = (reach.candidates - reach.center) / reach.radius_m
    rng = np.random.default_rng(0)
    best_random = max(least_angle(all_units[rng.permutation(len(all_units))[:count]]) for _ in range(500))
    assert ours > best_random


@pytest.mark.parametrize("count", [3, 4, 8])
def test_baseline_paper_beats_random_lights_in_its_criterion(count: int) -> None:
    def value(lights: FloatArray) -> float:
        return float(np.trace(np.diag([1.0, 1.0, 0.0]) @ np.linalg.inv(lights.T @ lights)))

    lights = baselines.ring(count, np.radians(75))
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 1, atol=1e-9)
    assert np.all(lights[:, 2] > np.cos(np.radians(75.1)))
    rng = np.random.default_rng(1)
    azimuth = rng.uniform(0, 2 * np.pi, (5000, count))
    slant = np.arccos(rng.uniform(np.cos(np.radians(75)), 1, (5000, count)))
    drawn = geometry.direction(slant, azimuth)
    assert value(lights) < min(value(one) for one in drawn)
    # (tr √M)²/m with M = diag(1, 1, 0) is a lower bound, not attained because of the slant limit.
    assert value(lights) == pytest.approx(4 / count / np.sin(np.radians(75)) ** 2)


def test_baseline_light_far_from_ideal_is_noted() -> None:
    reach = Dome(refused=0)
    around = (reach.candidates - reach.center) / reach.radius_m
    azimuth = np.degrees(np.arctan2(around[:, 1], around[:, 0]))
    reach.candidates = reach.candidates[(np.abs(azimuth) > 50) | (around[:, 2] > np.cos(np.radians(20)))]
    chosen = plan.baseline("ring", 12, Recipe(method="ring", slant_deg=60), reach)
    assert any("more than 10° from their position" in note for note in chosen.notes)


@pytest.mark.parametrize("method", PATTERNS)
def test_baseline_more_lights_than_candidates_is_refused(method: Method) -> None:
    reach = Dome(refused=0)
    reach.candidates = reach.candidates[:7]
    with pytest.raises(RigError) as caught:
        plan.baseline(method, 8, Recipe(method=method), reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_baseline_optimal_method_is_refused() -> None:
    with pytest.raises(RigError) as caught:
        plan.baseline("optimal", 8, Recipe(), Dome())
    assert caught.value.code == ErrorCode.REQUEST_INVALID


def test_baseline_user_lights_are_used_unchanged() -> None:
    reach = Dome()
    given = [tuple(float(x) for x in reach.center + reach.radius_m * geometry.direction(0.5, a)) for a in (0, 2, 4)]
    chosen = baselines.user_lights(Recipe(method="user", user_lights=given), reach)
    assert [light.position for light in chosen.lights] == given
    for light in chosen.lights:
        toward = (reach.center - np.array(light.position)) / reach.radius_m
        np.testing.assert_allclose(light.axis, toward, atol=1e-9)


def test_baseline_unreachable_user_lights_are_named_by_number() -> None:
    reach = Dome()
    slants = (0.5, 1.4, 0.6, 1.5)
    given = [tuple(float(x) for x in reach.center + 0.45 * geometry.direction(slant, slant)) for slant in slants]
    with pytest.raises(RigError, match=r"user light 1: .*; user light 3: ") as caught:
        baselines.user_lights(Recipe(method="user", user_lights=given), reach)
    assert caught.value.code == ErrorCode.WAYPOINTS_UNREACHABLE
    named = caught.value.context["lights"]
    assert [set(light) for light in named] == [{"number", "reason", "detail"}] * 2  # as of a route's lights
    assert [(light["number"], light["reason"]) for light in named] == [(1, "too-far"), (3, "too-far")]
    with pytest.raises(
        RigError, match=r"30 lights are refused: user light 1: .*; and 25 more \(all in `lights`\)$"
    ) as caught:
        baselines.user_lights(Recipe(method="user", user_lights=given * 15), reach)
    assert len(caught.value.context["lights"]) == 30
