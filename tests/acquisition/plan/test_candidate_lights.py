"""Candidate lights without an arm: free domes and lists."""

import numpy as np
import pytest

from acquisition import geometry, lamp_pose, pilot, plan
from acquisition.models.cell_config import MIN_SLANT_DEG
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.models.result import NormalMap
from acquisition.plan.candidate_lights import CandidateLights
from tests.acquisition import scenes
from tests.acquisition.plan import cases

CENTER = np.array([0.01, -0.02, -0.87])


@pytest.fixture(scope="module")
def cushion() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(96))


@pytest.fixture(scope="module")
def piloted(cushion: scenes.Scene) -> NormalMap:
    return cases.known_map(cushion, pilot.pattern(Recipe(), scenes.Dome(refused=0)))


def listed(count: int, *, below: float = 2.0) -> CandidateLights:
    """Lamps of a dome, in random order, those with y above `below` m left out."""
    free = CandidateLights.dome(scenes.Dome(refused=0).center, 0.45, np.radians(70)).candidates
    some = free[np.random.default_rng(3).permutation(len(free))]
    return CandidateLights(some[some[:, 1] < below][:count], scenes.Dome(refused=0).center)


@pytest.mark.parametrize("max_slant_deg", [30.0, 70.0, 85.0])
def test_free_dome_candidates_fill_it(max_slant_deg: float) -> None:
    dome = CandidateLights.dome(CENTER, 0.4, np.radians(max_slant_deg))
    offsets = dome.candidates - CENTER
    slant_deg = np.degrees(geometry.slant_azimuth(offsets)[0])
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.4)
    assert slant_deg.min() == pytest.approx(MIN_SLANT_DEG)
    assert slant_deg.max() == pytest.approx(max_slant_deg)
    assert np.linalg.norm(np.mean(offsets[:, :2], axis=0)) < 0.01


def test_listed_numbers_of_doubled_positions_are_distinct() -> None:
    lamps = listed(6)
    doubled = CandidateLights(np.concatenate([lamps.candidates, lamps.candidates[[2, 2]]]), lamps.center)
    lights = [lamp_pose.light_at(lamps.candidates[place], lamps.center) for place in (2, 5, 2, 2)]
    numbers = doubled.numbers(lights)
    assert numbers[1] == 5
    assert sorted(numbers) == [2, 5, 6, 7]


@pytest.mark.parametrize("below", [2.0, 0.0])
def test_choose_listed_stays_on_list_wherever_it_lies(below: float, piloted: NormalMap, cushion: scenes.Scene) -> None:
    """Also where all lamps stand on one side: the images so far may surround the object."""
    lamps = listed(40, below=below)
    chosen = plan.choose(
        plan.DesignProblem.of(piloted, cases.NO_OBSERVATIONS, Recipe(), lamps, cushion.calibration, surround=False), 5
    )
    assert len(set(lamps.numbers(chosen.lights))) == 5
    assert all(np.any(np.all(np.isclose(lamps.candidates, light.position), axis=1)) for light in chosen.lights)
    assert 0 < (chosen.efficiency or 0) <= 1


def test_choose_as_many_as_listed_takes_all(piloted: NormalMap, cushion: scenes.Scene) -> None:
    arguments = (piloted, cases.NO_OBSERVATIONS, Recipe())
    for count in (1, 2, 5):
        lamps = listed(count)
        chosen = plan.choose(plan.DesignProblem.of(*arguments, lamps, cushion.calibration, surround=False), count)
        assert sorted(lamps.numbers(chosen.lights)) == list(range(count))
        assert chosen.efficiency == pytest.approx(1, abs=1e-3)
        with pytest.raises(RigError) as caught:
            plan.choose(plan.DesignProblem.of(*arguments, lamps, cushion.calibration, surround=False), count + 1)
        assert caught.value.code is ErrorCode.PLAN_INFEASIBLE


def test_choose_one_of_nine_listed_is_among_the_best(piloted: NormalMap, cushion: scenes.Scene) -> None:
    """As lists of each of the same lamps alone state it; the search sees other pixels, wrong depth, and a cap."""
    lamps = listed(9)
    arguments = (piloted, cases.NO_OBSERVATIONS, Recipe())
    chosen = plan.choose(
        plan.DesignProblem.of(*arguments, lamps, cushion.calibration, surround=False), 1, certify=False
    )
    alone = [
        plan.choose(
            plan.DesignProblem.of(
                *arguments, CandidateLights(lamps.candidates[[one]], lamps.center), cushion.calibration, surround=False
            ),
            1,
            certify=False,
        )
        for one in range(9)
    ]
    sigma = [one.predicted_sigma_deg or np.inf for one in alone]
    assert (chosen.predicted_sigma_deg or np.inf) <= sorted(sigma)[1]
