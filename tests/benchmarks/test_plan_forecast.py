"""Time of a forecast over HTTP while a light is dragged, at the demonstration's resolution in the simulated cell.

Goal on two idle cores: 0.3 s from the request to the figures, and no more with the picture.
"""

from collections.abc import Generator
from itertools import count
from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from acquisition.models.recipe import Recipe
from api.rest import settings
from hardware_sim.cell import Cell, CellOptions
from tests.api.conftest import plan_under_review, serve

CELL, SERVICE = "127.0.52.10", "127.0.52.2"


@pytest.fixture(scope="module")
def reviewed(tmp_path_factory: pytest.TempPathFactory) -> Generator[tuple[Any, str, list[Any]]]:
    """A service, a session whose plan waits for review, and the plan's positions."""
    folder = tmp_path_factory.mktemp("forecast")
    with (
        Cell(CellOptions(CELL, "bumps", 1, "realistic", 20), folder / "cell") as cell,
        serve(settings.read(cell=cell.cell_file, data=folder / "data", host=SERVICE, port=0)) as service,
    ):
        service.client.wait_ready()
        session_id = plan_under_review(service.client, Recipe(review_plan=True))
        yield service, session_id, [light.position for light in service.client.one_pass(session_id, 1).plan.lights]


@pytest.mark.parametrize("kind", ["figures", "figures and picture"])
def test_forecast_of_dragged_light_time(benchmark: BenchmarkFixture, reviewed: Any, kind: str) -> None:
    service, session_id, positions = reviewed
    address = f"/v1/sessions/{session_id}/passes/1/plan/forecast"
    random, numbers = np.random.default_rng(0), count()

    def dragged() -> tuple[tuple[Any], dict[str, Any]]:
        lights = [list(position) for position in positions]
        number = next(numbers) % len(lights)
        lights[number] = (np.array(lights[number]) + random.normal(0, 0.04, 3)).tolist()
        return ({"lights": lights},), {}

    def ask(body: Any) -> None:
        service.http.post(address, json=body).raise_for_status()
        if kind == "figures and picture":
            service.http.post(address, json=body, headers={"Accept": "image/png"}).raise_for_status()

    benchmark.pedantic(ask, setup=dragged, rounds=40, warmup_rounds=2)
