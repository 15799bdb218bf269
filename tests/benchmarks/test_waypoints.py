"""Planning time of routes, and their duration against simple routes, in the simulated cell."""

import os

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition.models.calibration import Calibration
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import Light
from acquisition.models.route import Route
from acquisition.waypoints import reach as reach_module
from acquisition.waypoints.motion import legs
from acquisition.waypoints.roadmap import connected_solutions, dome_lights, roadmap
from acquisition.waypoints.routing import route
from tests.acquisition.waypoints.cells import random_cell, simulated_cell
from tests.acquisition.waypoints.test_quality import good_lights

CASES = int(os.environ.get("LIGHTPOSE_CASES", "40"))


@pytest.mark.parametrize("count", [4, 8, 12, 32])
def test_route_simulated_cell_time(benchmark: BenchmarkFixture, count: int) -> None:
    cell, calibration = simulated_cell()
    lights = _lights(count)
    roadmap(cell, calibration)
    planned = benchmark.pedantic(route, args=(lights, cell.arm.home, cell, calibration), rounds=3)
    given, nearest = _simple_seconds(lights, cell, calibration)
    benchmark.extra_info["seconds"] = round(planned.seconds, 2)
    benchmark.extra_info["time / lower bound"] = round(planned.seconds / planned.lower_bound_s, 3)
    benchmark.extra_info["given order / ours"] = round(given / planned.seconds, 3)
    benchmark.extra_info["nearest neighbour / ours"] = round(nearest / planned.seconds, 3)
    assert planned.seconds < given


@pytest.mark.parametrize("count", [12, 32])
def test_route_random_cells_time(benchmark: BenchmarkFixture, count: int) -> None:
    """Planning time over forty random cells whose roadmaps are made, and the median ratios."""
    cases = []
    seed = 0
    while len(cases) < CASES:
        cell, calibration = random_cell(seed)
        lights = good_lights(cell, calibration, count, seed)
        if len(lights) == count:
            cases.append((lights, cell.arm.home, cell, calibration))
        seed += 1
    left = iter(cases)
    planned: list[Route] = []

    def next_case() -> tuple[tuple[object, ...], dict[str, object]]:
        case = next(left)
        roadmap(case[2], case[3])  # of the last few cells only it is kept
        return case, {}

    benchmark.pedantic(lambda *case: planned.append(route(*case)), setup=next_case, rounds=CASES)
    simple = [_simple_seconds(case[0], case[2], case[3]) for case in cases]
    benchmark.extra_info["p95 ms"] = round(1e3 * float(np.percentile(benchmark.stats.stats.data, 95)), 1)
    for name, ratios in (
        ("time / lower bound", [one.seconds / one.lower_bound_s for one in planned]),
        ("given order / ours", [given / one.seconds for (given, _), one in zip(simple, planned, strict=True)]),
        ("nearest neighbour / ours", [near / one.seconds for (_, near), one in zip(simple, planned, strict=True)]),
    ):
        benchmark.extra_info[f"{name}, median"] = round(float(np.median(ratios)), 3)


def test_reach_simulated_cell_time(benchmark: BenchmarkFixture) -> None:
    cell, calibration = simulated_cell()
    roadmap(cell, calibration)
    reached = benchmark.pedantic(reach_module.reach, args=(cell, calibration), rounds=2)
    benchmark.extra_info["share of the dome"] = len(reached.candidates) / len(reached.points)
    assert len(reached.candidates) > 200


def _lights(count: int) -> list[Light]:
    cell, calibration = simulated_cell()
    lights = dome_lights(cell, calibration, cell.dome.candidates)
    refusals = reach_module.refusals(lights, cell, calibration)
    good = [light for light, refusal in zip(lights, refusals, strict=True) if refusal is None]
    return [good[n] for n in np.random.default_rng(count).permutation(len(good))[:count]]


def _simple_seconds(lights: list[Light], cell: CellConfig, calibration: Calibration) -> tuple[float, float]:
    """Time in the given order, each light in its configuration nearest to home; and always going on to the nearest
    configuration of any light left. Both as if every straight segment were free: no detours are counted."""
    stations = [station.joints for station in connected_solutions(lights, cell, calibration).solutions]
    home = np.array([cell.arm.home])
    stops = np.concatenate([home, *(joints[:1] for joints in stations), home])
    given = float(legs(stops[:-1], stops[1:], cell).seconds.sum())
    present, left, nearest = home, list(range(len(stations))), 0.0
    while left:
        times = [legs(np.repeat(present, len(stations[n]), 0), stations[n], cell).seconds for n in left]
        best = int(np.argmin([time.min() for time in times]))
        nearest += float(times[best].min())
        present = stations[left[best]][[int(np.argmin(times[best]))]]
        del left[best]
    return given, nearest + float(legs(present, home, cell).seconds[0])
