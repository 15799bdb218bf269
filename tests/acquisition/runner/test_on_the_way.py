"""Sessions whose images are taken on the way: what is recorded, and every way in which such a session is stopped."""

import functools
from collections.abc import Generator
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from acquisition.capture import moving
from acquisition.devices.ur.arm import UrArm
from acquisition.models.recipe import Capture, Recipe
from acquisition.models.shot import Shot
from acquisition.session_state import ENDED, State, Trigger
from acquisition.store import Journal
from api import Client
from api.rest import wiring
from hardware_sim import nominal
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.acquisition.runner.simulated_rig import (
    CELL_FILE,
    Rig,
    acknowledge,
    after_first_image,
    simulated_rig,
    wait_for,
)
from tests.acquisition.runner.test_halt_paths import PATHS, RESTS_WITHIN_S
from tests.end_to_end.processes import client_of, rests_after, resume, serving, wait_until_moving

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

LIFE_SPEED = 1.0
"""As a real arm's: what is taken on the way depends on times."""
RECIPE = Recipe(method="two-rings", pilot_lights=4, planned_lights=4, capture=Capture(while_moving=True))
SIGMA_M = nominal.calibration(64).lamp_position_sigma_m


def shots_of(rig: Rig, session_id: str) -> list[Shot]:
    return [shot for shot in rig.store.journal.shots(session_id) if shot.kind == "light"]


def in_mid_scan(rig: Rig) -> str:
    """A session that has taken three images, whose arm moves on."""
    session_id = after_first_image(rig, RECIPE, within_s=300)
    while len(shots_of(rig, session_id)) < 3:
        row = rig.store.journal.session(session_id)
        assert row.state is State.RUNNING, row.reason
    wait_until_moving(rig.control)
    return session_id


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    with simulated_rig(tmp_path_factory.mktemp("way"), "127.0.6.50", speed=LIFE_SPEED, pixels=64) as made:
        yield made


def test_session_on_the_way_records_where_the_lamp_was(rig: Rig) -> None:
    session_id = after_first_image(rig, RECIPE, within_s=300)
    assert wait_for(rig, session_id, *ENDED, State.INTERRUPTED, within_s=600) is State.COMPLETED
    shots = shots_of(rig, session_id)
    (passed,) = rig.store.record(session_id).passes
    assert passed.plan is not None
    assert len(shots) == len(passed.plan.lights) == 8
    on_the_way = [shot for shot in shots if shot.motion is not None]
    assert on_the_way  # what a busy machine spoils is taken at rest
    for shot in on_the_way:
        assert shot.motion is not None
        assert 0 <= shot.motion.moved_m <= moving.MAX_SHARE * SIGMA_M
        assert shot.light is not None
        # The nominal arm stands where its joints say, the lamp at the tool's origin.
        planned = passed.plan.lights[shot.key.number]
        assert np.linalg.norm(np.subtract(shot.light.position, planned.position)) < 2e-3
        assert np.array(shot.base_from_tool)[:3, :3] @ np.array(shot.base_from_tool)[:3, :3].T == pytest.approx(
            np.eye(3), abs=1e-9
        )
    assert rig.control.state()["digital_outputs"] == 0
    assert rig.control.state()["collisions"] == 0


def test_pause_on_the_way_rests_at_the_next_light_and_goes_on(rig: Rig) -> None:
    session_id = in_mid_scan(rig)
    rig.runner.act(session_id, Trigger.PAUSE, "a")
    assert wait_for(rig, session_id, State.PAUSED, within_s=60) is State.PAUSED
    kept = shots_of(rig, session_id)
    assert 3 <= len(kept) < 8
    assert rig.control.state()["digital_outputs"] == 0
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=600) is State.COMPLETED
    assert shots_of(rig, session_id)[: len(kept)] == kept


def test_protective_stop_on_the_way_keeps_images_and_resumes(rig: Rig) -> None:
    session_id = in_mid_scan(rig)
    rig.control.fault("protective_stop")
    wait_for(rig, session_id, State.INTERRUPTED, within_s=60)
    kept = shots_of(rig, session_id)
    assert rig.control.state()["digital_outputs"] == 0
    acknowledge(rig)
    rig.runner.act(session_id, Trigger.RESUME, "a")
    assert wait_for(rig, session_id, *ENDED, within_s=600) is State.COMPLETED
    after = {shot.key.number: shot for shot in shots_of(rig, session_id)}
    assert len(after) == 8
    assert all(after[shot.key.number] == shot for shot in kept)


def test_lost_frame_on_the_way_is_taken_at_rest(rig: Rig) -> None:
    session_id = in_mid_scan(rig)
    rig.control.fault("saturated_frame", count=1)
    assert wait_for(rig, session_id, *ENDED, State.INTERRUPTED, State.PAUSED, within_s=600) is State.COMPLETED
    retaken = [event for event in rig.store.journal.events(0, 1000, session_id) if event.type == "shot.retaken"]
    assert any("saturated" in event.body["reason"] for event in retaken)
    assert len(shots_of(rig, session_id)) == 8
    assert any(shot.motion is None for shot in shots_of(rig, session_id)[1:])


@pytest.mark.parametrize("path", PATHS)
def test_halt_on_the_way_by_one_path_alone(tmp_path: Path, path: str) -> None:
    with (
        mock.patch.object(wiring, "UrArm", functools.partial(UrArm, **PATHS[path])),
        simulated_rig(tmp_path, "127.0.6.51", "5", CELL_FILE, LIFE_SPEED, pixels=64) as rig,
    ):
        session_id = in_mid_scan(rig)
        rig.runner.halt("a")
        assert rests_after(rig.control) < RESTS_WITHIN_S
        assert wait_for(rig, session_id, *ENDED) is State.STOPPED
        assert rig.control.state()["digital_outputs"] == 0
        moves = rig.control.state()["moves_started"]
        assert rests_after(rig.control) == 0
        assert rig.control.state()["moves_started"] == moves


def test_killed_service_on_the_way_keeps_images_and_resumes(tmp_path: Path) -> None:
    options = CellOptions("127.0.6.52", "sphere", 1, "ideal", LIFE_SPEED, pixels=64, cell_file=CELL_FILE)
    with Cell(options, tmp_path / "cell") as cell, ControlClient(cell.address) as control:
        with serving(cell, tmp_path / "data") as service, client_of(service) as client:
            session_id = client.create(RECIPE).id
            client.start(session_id)
            while len(lit(tmp_path / "data", session_id)) < 3:
                assert client.session(session_id).state is State.RUNNING
            wait_until_moving(control)
            service.kill()
        assert rests_after(control) < RESTS_WITHIN_S
        assert control.state()["digital_outputs"] == 0
        moves = control.state()["moves_started"]
        with serving(cell, tmp_path / "data") as service, Client(service.url) as client:
            assert client.session(session_id).state is State.INTERRUPTED
            kept = lit(tmp_path / "data", session_id)
            assert len(kept) >= 3
            assert control.state()["moves_started"] == moves
            resume(client, session_id)
            assert client.wait(session_id).state is State.COMPLETED
            after = lit(tmp_path / "data", session_id)
            assert len(after) == 8
            assert {key: after[key] for key in kept} == kept


def lit(data: Path, session_id: str) -> dict[int, str]:
    """The checksum of each lit image's file by the number of its light, as the journal has it."""
    journal = Journal(data / "rig.db")
    try:
        shots = journal.shots(session_id)
        return {shot.key.number: shot.frame.sha256 for shot in shots if shot.kind == "light"}
    finally:
        journal.close()
