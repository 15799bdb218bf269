"""Rejoined routes end on a certified way home, from whichever light is the last one left."""

import numpy as np
import pytest

from acquisition.waypoints.collision import scene
from acquisition.waypoints.rejoin import rejoin
from acquisition.waypoints.routing import route
from tests.acquisition.waypoints.cells import random_cell
from tests.acquisition.waypoints.test_routing import some_lights


@pytest.mark.parametrize("seed", [2, 5])
def test_way_home_of_a_rejoined_route_is_certified_from_its_last_light(seed: int) -> None:
    """In these cells the straight way from other lights to the corner where the last one's way home leads hits bodies,
    by up to 97 mm."""
    cell, calibration = random_cell(seed)
    whole = route(some_lights(cell, calibration, 8, seed), cell.arm.home, cell, calibration)
    arm, stands = scene(cell, calibration), whole.waypoints[-1].joints
    free = list[bool]()
    for number in whole.light_numbers:
        left = rejoin(whole, (number,), stands, cell, calibration)
        corners = np.array([left.waypoints[-1].joints, *left.home_path])
        assert np.all(arm.edges_free(corners[:-1], corners[1:]))
        assert left.home_path[-1] == cell.arm.home
        assert left.seconds == pytest.approx(sum(one.seconds for one in left.waypoints), abs=60)
        free.append(bool(arm.edges_free(corners[:1], np.array(whole.home_path[:1]))[0]))
    assert not all(free)  # else the route's own way home would do, and this shows nothing
