"""Planning time, and how much quicker the route is than the simple ones, in the simulated cell."""

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition.types import Light
from acquisition.waypoints import reach as reach_module
from acquisition.waypoints.motion import legs
from acquisition.waypoints.roadmap import connected_stations, dome_lights, roadmap
from acquisition.waypoints.route import route
from tests.acquisition.waypoints.cells import simulated_cell


@pytest.mark.parametrize("count", [4, 8, 12, 32])
def test_route(benchmark: BenchmarkFixture, count: int) -> None:
    cell, calibration = simulated_cell()
    lights = _lights(count)
    roadmap(cell, calibration)
    planned = benchmark.pedantic(route, args=(lights, cell.arm.home, cell, calibration), rounds=3)
    given, nearest = _simple_seconds(lights)
    benchmark.extra_info["seconds"] = round(planned.seconds, 2)
    benchmark.extra_info["time / lower bound"] = round(planned.seconds / planned.lower_bound_s, 3)
    benchmark.extra_info["given order / ours"] = round(given / planned.seconds, 3)
    benchmark.extra_info["nearest neighbour / ours"] = round(nearest / planned.seconds, 3)
    assert planned.seconds < given


def test_reach(benchmark: BenchmarkFixture) -> None:
    cell, calibration = simulated_cell()
    roadmap(cell, calibration)
    found = benchmark.pedantic(reach_module.reach, args=(cell, calibration), rounds=2)
    benchmark.extra_info["share of the dome"] = len(found.candidates) / len(found.points)
    assert len(found.candidates) > 200


def _lights(count: int) -> list[Light]:
    cell, calibration = simulated_cell()
    lights = dome_lights(cell, calibration, cell.dome.candidates)
    refusals = reach_module.refusals(lights, cell, calibration)
    good = [light for light, refusal in zip(lights, refusals, strict=True) if refusal is None]
    return [good[n] for n in np.random.default_rng(count).permutation(len(good))[:count]]


def _simple_seconds(lights: list[Light]) -> tuple[float, float]:
    """Time in the given order, each light in its configuration nearest to home; and always going on to the nearest
    configuration of any light left. Both as if every straight segment were free: no detours are counted."""
    cell, calibration = simulated_cell()
    stations = [station.joints for station in connected_stations(lights, cell, calibration).stations]
    home = np.array([cell.arm.home])
    stops = np.concatenate([home, *(joints[:1] for joints in stations), home])
    given = float(legs(stops[:-1], stops[1:], cell.arm).seconds.sum())
    here, left, nearest = home, list(range(len(stations))), 0.0
    while left:
        times = [legs(np.repeat(here, len(stations[n]), 0), stations[n], cell.arm).seconds for n in left]
        best = int(np.argmin([time.min() for time in times]))
        nearest += float(times[best].min())
        here = stations[left[best]][[int(np.argmin(times[best]))]]
        del left[best]
    return given, nearest + float(legs(here, home, cell.arm).seconds[0])
