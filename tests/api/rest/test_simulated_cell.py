"""The simulated cell over HTTP: joint readings in the event stream, and forecasts for dragged lights.

The readings are transient, opt-in, newest first, and do no harm to what is journalled; the forecasts are those of a
session that waits for the review of its plan.
"""

import asyncio
import json
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import httpx
import numpy as np
import pytest

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import ENDED, State
from api import ProblemError
from api.rest.joint_readings import EVENT_TYPE, JointReadingResource
from hardware_sim.controller.control import ControlClient
from tests.api.conftest import at_simulated_cell, plan_under_review
from tests.api.rest.test_scene import link_poses, scene_of

CELL = "127.0.4.14"
RECIPE = Recipe(pilot_lights=3, planned_lights=2, review_plan=True)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Generator[Any]:
    """A service at a simulated cell."""
    with at_simulated_cell(tmp_path_factory.mktemp("cell"), CELL, 96) as service:
        yield service


@pytest.fixture(scope="module")
def reviewed(live: Any) -> str:
    """A session whose plan waits for review; it holds the rig, so that what moves the arm comes before it."""
    return plan_under_review(live.client, RECIPE)


@contextmanager
def slow_arm() -> Generator[None]:
    """Slows the arm down, so that several readings fall into one move."""
    with ControlClient(CELL) as control:
        control.fault("speed_slider", fraction=0.2)
        try:
            yield
        finally:
            control.fault("speed_slider", fraction=1.0)


def messages(answer: httpx.Response) -> Iterator[dict[str, str]]:
    """The events of a stream as their fields."""
    message: dict[str, str] = {}
    for line in answer.iter_lines():
        if not line and "data" in message:
            yield message
        if not line:
            message = {}
        name, _, value = line.partition(": ")
        message[name] = value


def reading_of(message: dict[str, str]) -> JointReadingResource:
    return JointReadingResource.model_validate_json(message["data"])


def test_joints_are_sent_only_on_request_and_without_id(live: Any) -> None:
    with live.http.stream("GET", "/v1/events?joints=true") as answer:
        message = next(messages(answer))
    plain = live.http.get("/v1/events?after=0&follow=false").text

    assert message["event"] == EVENT_TYPE
    assert "id" not in message
    reading = reading_of(message)
    assert reading.connected
    assert reading.moving is False
    assert reading.age_s is not None
    assert reading.age_s < 1
    assert EVENT_TYPE not in plain


def test_joints_with_scene_give_tool_pose_of_controller(live: Any) -> None:
    """What a page draws from angles and geometry is where the controller says that the tool is."""
    with live.http.stream("GET", "/v1/events?joints=true") as answer:
        reading = reading_of(next(messages(answer)))
    scene = scene_of(live)

    drawn = link_poses(scene, reading.joints)[6] @ np.array(scene.tool.flange_from_tool)

    assert np.allclose(drawn, live.client.rig().reading.base_from_tool, atol=1e-3)


def test_joints_follow_move_and_lose_no_journaled_event(live: Any) -> None:
    session = live.client.create(Recipe(pilot_lights=3, planned_lights=1))
    seen: list[tuple[float, ...]] = []
    moved, ids = False, []
    with (
        slow_arm(),
        live.http.stream("GET", f"/v1/events?joints=true&session_id={session.id}&after=0") as answer,
    ):
        live.client.start(session.id)
        for message in messages(answer):
            if message["event"] != EVENT_TYPE:
                ids.append(int(message["id"]))
                state = json.loads(message["data"])["body"].get("state")
                if state in ENDED:
                    break
                if state == State.INTERRUPTED:  # the controller's watchdog, on a busy machine
                    live.client.resume(session.id)
                continue
            reading = reading_of(message)
            if reading.moving and len(seen) < 3:
                seen.append(reading.joints or ())
            if len(seen) == 3 and not moved:
                moved = True
                live.client.halt()

    live.client.acknowledge()
    assert len(set(seen)) == 3
    assert ids == [event.id for event in live.client.past_events(session.id)]


def test_joints_slow_reader_receives_newest_only(live: Any) -> None:
    async def read() -> tuple[list[JointReadingResource], str]:
        stream = live.server._feed.stream(None, "no session", joints=True)
        head = await anext(stream)
        first = await anext(stream)
        await asyncio.sleep(0.6)  # several periods, in which nothing is kept for this reader
        late = [await anext(stream) for _ in range(2)]
        await stream.aclose()
        assert all(text.startswith(f"event: {EVENT_TYPE}") for text in (first, *late))
        texts = [text.partition("data: ")[2] for text in (first, *late)]
        return [JointReadingResource.model_validate_json(text) for text in texts], head

    (first, late, after), head = asyncio.run_coroutine_threadsafe(read(), _loop_of(live)).result(60)

    assert head.startswith("retry: ")
    assert (late.at - first.at).total_seconds() >= 0.5
    assert after.at >= late.at


def test_joints_without_arm_are_unconnected(shared: Any) -> None:
    with shared.http.stream("GET", "/v1/events?joints=true") as answer:
        reading = reading_of(next(messages(answer)))

    assert not reading.connected
    assert (reading.joints, reading.moving, reading.age_s) == (None, None, None)


def _loop_of(live: Any) -> asyncio.AbstractEventLoop:
    """The event loop that serves."""
    return live.server.loop


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
