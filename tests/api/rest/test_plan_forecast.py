"""Forecasts for dragged lights over HTTP, at a session in the simulated cell that waits for the review of its plan."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from api import ProblemError
from api.rest import settings
from hardware_sim.cell import Cell, CellOptions
from tests.api.conftest import plan_under_review

CELL = "127.0.4.14"
CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"
RECIPE = Recipe(pilot_lights=3, planned_lights=2, review_plan=True)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, serving: Any) -> Generator[Any]:
    """A service at a simulated cell."""
    folder = tmp_path_factory.mktemp("forecast")
    with (
        Cell(CellOptions(CELL, "sphere", 1, "ideal", 20, pixels=96, cell_file=CELL_FILE), folder / "cell") as cell,
        serving(settings.read(cell=cell.cell_file, data=folder / "data", host="127.0.4.2", port=0)) as service,
    ):
        service.client.wait_ready()
        yield service


@pytest.fixture(scope="module")
def reviewed(live: Any) -> str:
    """A session whose plan waits for review."""
    return plan_under_review(live.client, RECIPE)


def address(session_id: str, number: int = 1) -> str:
    return f"/v1/sessions/{session_id}/passes/{number}/plan/forecast"


def test_forecast_of_own_lights_is_that_of_plan(live: Any, reviewed: str) -> None:
    plan = live.client.one_pass(reviewed, 1).plan
    newest = live.service.store.journal.last_event_id()

    forecast = live.client.forecast_plan(reviewed, 1, [light.position for light in plan.lights])

    assert forecast.sigma_deg == pytest.approx(plan.predicted_sigma_deg, rel=1e-6)
    assert [light.gain for light in forecast.lights] == pytest.approx(plan.gains, abs=1e-6)
    assert [light.refusal for light in forecast.lights] == [None, None]
    assert forecast.sigma_before_deg > forecast.sigma_deg
    assert live.service.store.journal.last_event_id() == newest  # nothing was committed
    assert live.client.one_pass(reviewed, 1).plan == plan


def test_forecast_leaves_out_lights_that_arm_refuses(live: Any, reviewed: str) -> None:
    lights = [light.position for light in live.client.one_pass(reviewed, 1).plan.lights]
    center = np.array(live.client.scene().dome.center_m)
    view_from_base = np.linalg.inv(np.array(live.client.scene().base_from_view))
    inside = tuple((view_from_base @ [*center, 1])[:3].tolist())

    alone = live.client.forecast_plan(reviewed, 1, lights[:1])
    forecast = live.client.forecast_plan(reviewed, 1, [lights[0], (0.0, 0.0, -90.0), (1.5, 0.0, -0.5), inside])

    assert [light.refusal and light.refusal.reason for light in forecast.lights] == [
        None, "too-far", "too-far", "hits-object",
    ]  # fmt: skip
    assert forecast.sigma_deg == pytest.approx(alone.sigma_deg)
    assert [light.gain is None for light in forecast.lights] == [False, True, True, True]
    with pytest.raises(ProblemError) as refused:
        live.client.replace_plan(reviewed, 1, [lights[0], (1.5, 0.0, -0.5)])
    assert refused.value.code is ErrorCode.WAYPOINTS_UNREACHABLE


def test_forecast_picture_is_darker_with_more_lights(live: Any, reviewed: str) -> None:
    lights = [list(light.position) for light in live.client.one_pass(reviewed, 1).plan.lights]

    def picture(chosen: list[list[float]]) -> Any:
        answer = live.http.post(address(reviewed), json={"lights": chosen}, headers={"Accept": "image/png"})
        assert answer.headers["content-type"] == "image/png"
        return cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)

    two, none = picture(lights), picture([[0.0, 0.0, -90.0]])

    assert two.shape == none.shape
    assert none.mean() > two.mean()
    assert np.ptp(none) > 100


def test_forecast_outside_review_is_refused_as_replacement_is(live: Any, reviewed: str) -> None:
    created = live.client.create(RECIPE)
    body = {"lights": [[0.1, 0.1, -0.5]]}
    for session_id, number, status in ((created.id, 1, 409), (reviewed, 0, 409), (reviewed, 2, 409), ("none", 1, 404)):
        answers = [
            live.http.post(address(session_id, number), json=body),
            live.http.put(address(session_id, number).removesuffix("/forecast"), json=body),
        ]
        assert [answer.status_code for answer in answers] == [status, status]
        assert answers[0].json()["code"] == answers[1].json()["code"]
    assert live.http.post(address(reviewed), json={"lights": []}).status_code == 422
    assert live.http.post(address(reviewed), json={"lights": [["a", 0, 0]]}).status_code == 422
