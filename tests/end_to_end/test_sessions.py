"""Complete sessions over HTTP: separate processes, the real ur-rtde, graded against the truth."""

import hashlib
import json
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import pytest

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from api import Client, ProblemError
from hardware_sim import grade, truth
from hardware_sim.cell import Cell, CellOptions
from hardware_sim.controller.control import ControlClient
from tests.end_to_end.processes import (
    Service,
    client_of,
    fastest_joint,
    rests_after,
    resume,
    serving,
    wait_until_moving,
)

CELL_FILE = Path(__file__).parents[2] / "tests" / "data" / "cell.test.toml"
PIXELS = 160


@dataclass(frozen=True)
class Rig:
    """A simulated cell and a service for it."""

    cell: Cell
    service: Service


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[Rig, None, None]:
    folder = tmp_path_factory.mktemp("rig")
    with cell(folder, "127.0.6.1") as running, serving(running, folder / "data") as service:
        yield Rig(running, service)


def cell(folder: Path, address: str) -> Cell:
    return Cell(CellOptions(address, "vase", 1, "direct", 8.0, pixels=PIXELS, cell_file=CELL_FILE), folder / "cell")


def quick_cell(folder: Path, address: str) -> Cell:
    return Cell(CellOptions(address, "sphere", 1, "ideal", 8.0, pixels=96, cell_file=CELL_FILE), folder / "cell")


def grades(running: Cell, data: Path, session_id: str) -> list[grade.Grade]:
    true = truth.load(running.cell_file.parent / "truth.npz")
    calibration = cell_config.load_calibration(running.cell_file.parent / "calibration.json")
    results = data / "sessions" / session_id / "results"
    return [grade.grade_folder(folder, true, calibration) for folder in sorted(results.iterdir())]


def test_session_solves_normals_and_keeps_all_files(rig: Rig, tmp_path: Path) -> None:
    with client_of(rig.service) as client:
        done = client.capture(Recipe(seed=1), progress=False)
        events = client.past_events(done.id)
        normals = client.download(done.id, 1, "normals.png", tmp_path / "normals.png")
    pilot, final = grades(rig.cell, rig.service.data, done.id)
    assert rig.cell.state()["collisions"] == 0
    assert final.mean_deg < 1.2
    assert final.mean_deg < 0.67 * pilot.mean_deg
    assert final.coverage > 0.98
    assert final.found_to_predicted is not None
    assert 1 / 1.5 < final.found_to_predicted < 1.5
    folder = rig.service.data / "sessions" / done.id
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    for name, facts in manifest["files"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == facts["sha256"], name
    wanted = {f"passes/{number}/{name}.json" for number in (0, 1) for name in ("plan", "route")}
    assert wanted <= set(manifest["files"])
    assert len([name for name in manifest["files"] if "/shots/" in name]) == 8
    assert normals.read_bytes() == (folder / "results/1/normals.png").read_bytes()
    assert [event.body["stage"] for event in events if event.type == "session.stage"] == [
        "pilot", "waypoints", "capture", "normals", "plan", "waypoints", "capture", "normals", "finished",
    ]  # fmt: skip
    # A light goes with where the arm was measured to be, which is where the plan wanted it within the arm's accuracy.
    plan = json.loads((folder / "passes/1/plan.json").read_text(encoding="utf-8"))
    for shot in manifest["shots"]:
        if shot["kind"] == "light" and shot["key"]["pass_number"] == 1:
            planned = plan["lights"][shot["light_number"]]["position"]
            assert max(abs(a - b) for a, b in zip(planned, shot["light"]["position"], strict=True)) < 2e-3


@pytest.mark.long
def test_session_fixed_pattern_completes(rig: Rig) -> None:
    with client_of(rig.service) as client:
        done = client.capture(Recipe(method="random", pilot_lights=3, planned_lights=3, seed=2), progress=False)
        assert len(client.results(done.id)) == 1
    (graded,) = grades(rig.cell, rig.service.data, done.id)
    assert graded.coverage > 0.9


def test_stop_during_move_next_session_starts_at_stopped_joints(rig: Rig) -> None:
    with client_of(rig.service) as client, ControlClient(rig.cell.address) as control:
        first = client.create(Recipe())
        client.start(first.id)
        wait_until_moving(control)
        client.halt()
        assert rests_after(control) < 1.0
        until_state(client, first.id, State.STOPPED)
        assert control.state()["digital_outputs"] == 0
        joints = control.state()["joints"]
        time.sleep(0.5)
        assert control.state()["joints"] == pytest.approx(joints, abs=1e-4)
        second = client.create(Recipe(pilot_lights=3, planned_lights=0))
        with pytest.raises(ProblemError) as refused:
            client.start(second.id)
        assert refused.value.code is ErrorCode.SAFETY_NOT_ACKNOWLEDGED
        client.acknowledge()
        client.start(second.id)
        wait_until_moving(control)
        client.stop(second.id)
        until_state(client, second.id, State.STOPPED)
        assert rests_after(control) < 1.0


@pytest.mark.long
def test_killed_service_loses_no_announced_frame(tmp_path: Path) -> None:
    with quick_cell(tmp_path, "127.0.6.5") as running, ControlClient("127.0.6.5") as control:
        data = tmp_path / "data"
        announced: list[tuple[int, int]] = []
        with serving(running, data) as service, client_of(service) as client:
            session_id = client.create(Recipe(pilot_lights=3, planned_lights=2)).id
            client.start(session_id)
            for event in client.events(session_id, after=0):
                assert event.type != "session.state" or "reason" not in event.body, event  # no shot would come any more
                if event.type == "shot.captured":
                    announced.append((event.body["pass"], event.body["number"]))
                if len(announced) == 2:
                    break
            wait_until_moving(control)
            service.kill()
            assert rests_after(control) < 1.5
        assert control.state()["digital_outputs"] == 0
        with serving(running, data) as service, Client(service.url) as client:
            session = client.session(session_id)
            assert session.state is State.INTERRUPTED
            assert session.reason is not None
            assert session.reason.code == "service.restarted"
            for number, shot in announced:
                assert (data / "sessions" / session_id / f"passes/{number}/shots/{shot}.tiff").exists()
            time.sleep(1.0)
            assert fastest_joint(control) < 1e-3  # nothing moves before an operator decides
            resume(client, session_id)
            done = client.wait(session_id)
            assert done.state is State.COMPLETED
            shots = [
                (event.body["pass"], event.body["number"])
                for event in client.past_events(session_id)
                if event.type == "shot.captured"
            ]
            assert len(shots) == len(set(shots))
            assert set(announced) <= set(shots)
            assert grades(running, data, session_id)[-1].coverage > 0.98


def until_state(client: Client, session_id: str, state: State, within_s: float = 60.0) -> None:
    deadline = time.monotonic() + within_s
    while client.session(session_id).state is not state:
        assert time.monotonic() < deadline, client.session(session_id)
        time.sleep(0.05)
