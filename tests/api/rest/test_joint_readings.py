"""Joint readings in the event stream: transient, opt-in, newest first, and no harm to what is journalled."""

import asyncio
import json
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from acquisition.models.recipe import Recipe
from acquisition.session import ENDED, State
from api.rest import settings
from api.rest.joint_readings import EVENT_TYPE, JointReadingResource
from hardware_sim.cell import Cell, CellOptions
from tests.api.rest.test_scene import link_poses, scene_of

CELL = "127.0.4.13"
CELL_FILE = Path(__file__).parents[3] / "tests" / "data" / "cell.test.toml"


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, serving: Any) -> Generator[Any]:
    """A service at a simulated cell."""
    folder = tmp_path_factory.mktemp("joints")
    with (
        Cell(CellOptions(CELL, "sphere", 1, "ideal", 4, pixels=64, cell_file=CELL_FILE), folder / "cell") as cell,
        serving(settings.read(cell=cell.cell_file, data=folder / "data", host="127.0.4.2", port=0)) as service,
    ):
        service.client.wait_ready()
        yield service


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
    with live.http.stream("GET", f"/v1/events?joints=true&session_id={session.id}&after=0") as answer:
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
