"""The pilot pattern: one light near the axis, a ring at a slant of 52.5°, within the arm's reach."""

import numpy as np
import pytest

from acquisition import geometry, pilot
from acquisition.models.base import FloatArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import Light
from acquisition.models.recipe import Recipe
from tests.acquisition.scenes import Dome


def slants_azimuths(lights: list[Light], reach: Dome) -> tuple[FloatArray, FloatArray]:
    slant, azimuth = geometry.slant_azimuth(np.array([light.position for light in lights]) - reach.center)
    return np.degrees(slant), np.degrees(azimuth)


def gaps(azimuth_deg: FloatArray) -> FloatArray:
    around = np.sort(azimuth_deg)
    return np.diff(np.append(around, around[0] + 360))


def test_pattern_three_lights_are_not_coplanar() -> None:
    reach = Dome(refused=0)
    slant, azimuth = slants_azimuths(pilot.pattern(Recipe(pilot_lights=3), reach), reach)
    assert np.all(np.abs(slant - 30) < 6)
    assert np.all(np.abs(gaps(azimuth) - 120) < 14)


@pytest.mark.parametrize("count", [4, 5, 8, 16])
def test_pattern_has_top_light_and_even_ring_at_52_5_degrees(count: int) -> None:
    reach = Dome(refused=0)
    lights = pilot.pattern(Recipe(pilot_lights=count), reach)
    slant, azimuth = slants_azimuths(lights, reach)
    assert len(lights) == count
    assert slant[0] == pytest.approx(20, abs=6)
    assert np.all(np.abs(slant[1:] - 52.5) < 6)
    assert np.all(np.abs(gaps(azimuth[1:]) - 360 / (count - 1)) < 14)
    away = np.abs((azimuth[1:] - azimuth[0] + 180) % 360 - 180)
    assert np.min(away) > 90 / (count - 1)  # between two lights of the ring, no nearer to one than half of half a step


@pytest.mark.parametrize("seed", range(6))
def test_pattern_reach_with_holes_gives_distinct_candidates(seed: int) -> None:
    reach = Dome(seed=seed, refused=0.5)
    lights = pilot.pattern(Recipe(pilot_lights=4), reach)
    positions = np.array([light.position for light in lights])
    distance = np.linalg.norm(positions[:, None] - reach.candidates[None], axis=-1)
    assert np.all(distance.min(axis=1) < 1e-12)
    assert len(set(distance.argmin(axis=1))) == 4
    slant, azimuth = slants_azimuths(lights, reach)
    assert np.all(np.abs(slant[1:] - 52.5) < 15)
    assert np.all(gaps(azimuth[1:]) > 80)


def test_pattern_ring_turns_to_reachable_azimuths() -> None:
    reach = Dome(refused=0)
    units = (reach.candidates - reach.center) / reach.radius_m
    azimuth = np.degrees(np.arctan2(units[:, 1], units[:, 0]))
    # Three sectors of 30° about 40°, 160° and 280°, and the top: the ring must stand in them.
    sector = np.min([np.abs((azimuth - a + 180) % 360 - 180) for a in (40, 160, 280)], axis=0) < 15
    reach.candidates = reach.candidates[sector | (units[:, 2] > np.cos(np.radians(12)))]
    _, azimuths = slants_azimuths(pilot.pattern(Recipe(), reach), reach)
    np.testing.assert_allclose(np.sort(azimuths[1:] % 360), [40, 160, 280], atol=15.1)


def test_pattern_does_not_depend_on_seed() -> None:
    reach = Dome(seed=2)
    assert pilot.pattern(Recipe(seed=1), reach) == pilot.pattern(Recipe(seed=99), reach)


def test_pattern_too_few_positions_is_refused() -> None:
    reach = Dome(refused=0)
    reach.candidates = reach.candidates[:3]
    with pytest.raises(RigError, match="reaches only 3 positions") as caught:
        pilot.pattern(Recipe(pilot_lights=4), reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_pattern_reach_on_one_side_is_refused() -> None:
    reach = Dome(refused=0)
    reach.candidates = reach.candidates[reach.candidates[:, 0] > 0.0]
    with pytest.raises(RigError, match="one side") as caught:
        pilot.pattern(Recipe(), reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE


def test_pattern_ring_light_far_from_ideal_is_refused() -> None:
    reach = Dome(refused=0, min_slant_deg=2)
    units = (reach.candidates - reach.center) / reach.radius_m
    # A cap of 20° and two spots at 52.5°: some ring light always lands far from its place on a ring of ten.
    spots = geometry.direction(np.radians(50), np.array([0.0, np.pi]))
    reach.candidates = reach.candidates[(units[:, 2] > np.cos(0.2)) | (np.max(units @ spots.T, axis=1) > np.cos(0.12))]
    with pytest.raises(RigError, match=r"(lights at 52.5° cannot be placed|reaches only)") as caught:
        pilot.pattern(Recipe(pilot_lights=16), reach)
    assert caught.value.code == ErrorCode.PLAN_INFEASIBLE
