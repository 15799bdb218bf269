"""Stops of a session whose images are taken on the way, over a rig that answers in milliseconds (`tests.model`)."""

import time
from collections.abc import Generator
from pathlib import Path

import pytest

from acquisition.models.recipe import Capture, Recipe
from acquisition.session_state import State
from api import Client
from tests.model.quick_rig import QuickArm, quick_service

RECIPE = Recipe(pilot_lights=16, planned_lights=0, capture=Capture(while_moving=True))


@pytest.fixture
def rig(tmp_path: Path) -> Generator[tuple[Client, QuickArm], None, None]:
    with quick_service(tmp_path, "127.0.6.55", with_keys=False) as (_, arm, url, _keys), Client(url) as client:
        client.wait_ready(60)
        yield client, arm


def in_mid_scan(client: Client, arm: QuickArm) -> str:
    """A session with three images or more, whose lamp is lit."""
    session_id = client.create(RECIPE).id
    client.start(session_id)
    while captured(client, session_id) < 3:
        assert client.session(session_id).state is State.RUNNING
    return session_id


def captured(client: Client, session_id: str) -> int:
    events = client.past_events(session_id)
    return sum(event.type == "shot.captured" and event.body["kind"] == "light" for event in events)


def test_stop_on_the_way_ends_moves_and_lamp(rig: tuple[Client, QuickArm]) -> None:
    client, arm = rig
    session_id = in_mid_scan(client, arm)
    client.stop(session_id)
    assert client.wait(session_id).state is State.STOPPED
    assert not arm.lamp
    moves = len(arm.moves)
    time.sleep(0.3)
    assert len(arm.moves) == moves
    assert not arm.reading.joint_speeds[0]
    assert captured(client, session_id) < RECIPE.pilot_lights


def test_protective_stop_on_the_way_interrupts_and_resumes(rig: tuple[Client, QuickArm]) -> None:
    client, arm = rig
    session_id = in_mid_scan(client, arm)
    arm.stop_protectively()
    deadline = time.monotonic() + 60
    while client.session(session_id).state is not State.INTERRUPTED:
        assert time.monotonic() < deadline
    assert not arm.lamp
    kept = captured(client, session_id)
    arm.unlock()
    client.acknowledge()
    client.resume(session_id)
    assert client.wait(session_id).state is State.COMPLETED
    assert captured(client, session_id) == RECIPE.pilot_lights
    assert kept >= 3
