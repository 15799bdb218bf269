"""The reachability map."""

import pickle

import numpy as np
import pytest

from acquisition import geometry
from acquisition.models.cell_config import Capsule
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.route import Reach
from acquisition.waypoints.reach import ReachMap, reach
from tests.acquisition.waypoints.cells import random_cell, simulated_cell


@pytest.fixture(scope="module")
def reach_map() -> ReachMap:
    return reach(*simulated_cell())


def test_reach_simulated_cell_is_well_covered(reach_map: ReachMap) -> None:
    promised: Reach = reach_map
    assert len(promised.candidates) >= 0.8 * len(reach_map.points)
    offsets = promised.candidates - promised.center
    assert np.allclose(np.linalg.norm(offsets, axis=1), promised.radius_m)
    slants = np.degrees(geometry.slant_azimuth(offsets)[0])
    assert 8 <= slants.min() <= 15
    assert slants.max() > 70


def test_reach_refused_points_have_reasons(reach_map: ReachMap) -> None:
    assert len(reach_map.refusals) == len(reach_map.points)
    refused = [refusal for refusal in reach_map.refusals if refusal is not None]
    assert len(refused) == len(reach_map.points) - len(reach_map.candidates)
    assert refused
    assert all(len(refusal.detail) > 20 for refusal in refused)


def test_allows_single_position_agrees_with_map(reach_map: ReachMap) -> None:
    for point, refusal in list(zip(reach_map.points, reach_map.refusals, strict=True))[::5]:
        alone = reach_map.allows(np.array(point))
        assert (alone is None) == (refusal is None)


def test_allows_refusal_names_its_reason(reach_map: ReachMap) -> None:
    above, aside = np.array([0.0, 0.0, 0.45]), np.array([2.0, 0.0, 0.0])
    far = reach_map.allows(reach_map.center + aside)
    assert far is not None
    assert far.reason == "too-far"
    in_view = reach_map.allows(reach_map.center + above)
    assert in_view is not None
    assert in_view.reason == "blocks-view"
    under = reach_map.allows(reach_map.center + np.array([0.3, 0.0, -0.03]))
    assert under is not None
    assert under.reason == "hits-table"


def test_reach_map_survives_json_and_pickle(reach_map: ReachMap) -> None:
    again = ReachMap.model_validate_json(reach_map.model_dump_json())
    assert again == reach_map
    assert np.array_equal(again.candidates, reach_map.candidates)
    assert pickle.loads(pickle.dumps(reach_map)) == reach_map  # noqa: S301


def test_reach_same_cell_gives_same_map() -> None:
    cell, calibration = random_cell(7)
    assert reach(cell, calibration).model_dump_json() == reach(cell, calibration).model_dump_json()


def test_reach_colliding_home_is_refused() -> None:
    cell, calibration = simulated_cell()
    wall = Capsule(name="wall", start_m=(-0.1, 0.0, 0.5), end_m=(0.3, 0.0, 0.5), radius_m=0.1)
    with pytest.raises(RigError) as caught:
        reach(cell.model_copy(update={"obstacles": [wall]}), calibration)
    assert caught.value.code == ErrorCode.WAYPOINTS_COLLISION
    assert "wall" in caught.value.detail
