"""Calibration sessions of a running service by the command line: complete, killed in mid-pass and resumed, checked."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from acquisition.models.calibration_recipe import BoardRecipe, LampRecipe
from acquisition.models.errors import ErrorCode
from acquisition.session_state import State
from api import Client
from api.rest.schemas import SessionResource
from hardware_sim import placing
from hardware_sim.cell import Cell, CellOptions
from tests.end_to_end.processes import Service, client_of, serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(3600)]
ADDRESS = "127.0.6.41"
Captured = tuple[str, set[tuple[int, int]]]
"""A session and the images (pass, number) that it has announced."""


def calibrate(service: Service, *arguments: str) -> tuple[int, dict[str, Any], str]:
    """Exit code of `lightpose calibrate`, its JSON (empty: none) and what it says."""
    command = [sys.executable, "-m", "api.cli", "calibrate", *arguments, "--address", service.url, "--json"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = ended.stdout.strip().splitlines()
    return ended.returncode, json.loads(lines[-1]) if lines else {}, ended.stderr


def cell_of(folder: Path, *, perturbed: bool) -> Cell:
    return Cell(CellOptions(ADDRESS, "empty", 3, "realistic", 20.0, pixels=512, perturbed=perturbed), folder / "cell")


def killed_after_three_images(service: Service, client: Client, recipe: BoardRecipe | LampRecipe) -> Captured:
    """Runs a session until three images are announced, and kills the service; the session and those images."""
    session_id = client.create(recipe).id
    client.start(session_id)
    announced: set[tuple[int, int]] = set()
    for event in client.events(session_id, after=0):
        assert event.type != "session.state" or "reason" not in event.body, event
        if event.type == "shot.captured":
            announced.add((event.body["pass"], event.body["number"]))
        if len(announced) == 3:
            break
    service.kill()
    return session_id, announced


def resumed(client: Client, captured: Captured) -> SessionResource:
    """The session at its end or next pause, interrupted before; its images are each announced once."""
    session_id, announced = captured
    assert client.session(session_id).state is State.INTERRUPTED
    client.acknowledge()
    client.resume(session_id)
    done = client.wait(session_id)
    shots = [
        (event.body["pass"], event.body["number"])
        for event in client.past_events(session_id)
        if event.type == "shot.captured" and event.body["kind"] == "light"
    ]
    assert len(shots) == len(set(shots))
    assert announced <= set(shots)
    return done


def test_hand_eye_and_lamp_by_killed_sessions(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with cell_of(tmp_path, perturbed=True) as cell:
        placing.place(ADDRESS, 30100, "charuco@flange")
        with serving(cell, data) as service, client_of(service) as client:
            client.state_tool("board")
            captured = killed_after_three_images(service, client, BoardRecipe(kind="hand-eye", max_images=20))
        with serving(cell, data) as service, Client(service.url) as client:
            assert client.rig().tool == "board"
            done, session_id = resumed(client, captured), captured[0]
            assert done.state is State.COMPLETED, done.reason
            assert done.estimate is not None
            assert done.estimate.position_sigma_mm is not None
            assert done.estimate.position_sigma_mm < 0.5
            assert done.estimate.images == 20
            report = data / "calibrations" / session_id / "report.html"
            assert "Camera against the arm" in report.read_text(encoding="utf-8")
            client.activate_calibration(session_id)
            code, found, said = calibrate(service, "check", "--target", "board")
            assert (code, found["passed"]) == (0, True), said
            assert list(client.rig().calibration.check.checks) == ["board"]
            placing.place(ADDRESS, 30100, "mirror-sphere")
            client.state_tool("lamp")
            captured = killed_after_three_images(service, client, LampRecipe(kind="lamp", max_images=36, placings=1))
        with serving(cell, data) as service, Client(service.url) as client:
            waiting, session_id = resumed(client, captured), captured[0]
            assert waiting.reason is not None
            assert (waiting.state, waiting.reason.code) == (State.PAUSED, ErrorCode.CALIBRATION_PLACE_TARGET)
            placing.place(ADDRESS, 30100, "matt-plane")
            client.resume(session_id)
            done = client.wait(session_id)
            assert done.state is State.COMPLETED, done.reason
            assert done.estimate is not None
            assert done.estimate.position_sigma_mm is not None
            assert done.estimate.position_sigma_mm < 1.0


def test_check_without_calibration_by_sessions_says_so(tmp_path: Path) -> None:
    with cell_of(tmp_path, perturbed=False) as cell, serving(cell, tmp_path / "data") as service:
        with client_of(service) as client:
            client.state_tool("board")
        code, _, said = calibrate(service, "check")
        assert code not in (0, 3)
        assert ErrorCode.CALIBRATION_INFEASIBLE in said or "nothing to check against" in said
        with Client(service.url) as client:
            (session,) = client.sessions()
            assert session.state is State.PAUSED
