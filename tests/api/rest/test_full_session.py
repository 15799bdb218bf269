"""A session in the simulated cell, over HTTP: what the client sees, fetches and stops."""

import hashlib
import http.client
import json
import signal
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
import tifffile

from acquisition.models.errors import ErrorCode
from acquisition.models.recipe import Recipe
from acquisition.session import Stage
from acquisition.session_state import State
from acquisition.store import Store
from api import ProblemError
from hardware_sim.controller.control import ControlClient
from tests.api.conftest import at_simulated_cell

CELL = "127.0.4.10"
RECIPE = Recipe(pilot_lights=3, planned_lights=1, label="whole")


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Generator[Any]:
    """A service at a simulated cell."""
    with at_simulated_cell(tmp_path_factory.mktemp("whole"), CELL, 128) as service:
        yield service


@pytest.fixture(scope="module")
def done(live: Any) -> tuple[Any, list[Any]]:
    """A session that has completed, and the events it was followed by."""
    created = live.client.create(RECIPE)
    heard: list[Any] = []
    live.client.start(created.id)
    return live.client.wait(created.id, heard.append), heard


def test_rig_with_simulated_cell_is_ready(live: Any) -> None:
    rig = live.client.rig()

    assert rig.may_start
    assert rig.reasons == []
    assert rig.arm is not None
    assert rig.reading is not None
    assert len(rig.reading.joints) == 6
    assert live.http.get("/health/ready").status_code == 200


def test_session_completes_and_each_event_arrives_once(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, heard = done

    assert session.state is State.COMPLETED
    assert session.stage is Stage.FINISHED
    assert session.progress == 1.0
    assert session.reason is None
    assert session.allowed_actions == []
    assert [event.id for event in heard] == [event.id for event in live.client.past_events(session.id)]
    lit = [event for event in heard if event.type == "shot.captured" and event.body["kind"] == "light"]
    assert len(lit) == RECIPE.lights_total
    assert [event.body["number"] for event in heard if event.type == "normals.ready"] == [0, 1]


def test_session_announces_progress_with_time_left(done: tuple[Any, list[Any]]) -> None:
    session, heard = done
    reports = [event.body for event in heard if event.type == "session.progress"]

    assert session.time_left is None
    assert [report["progress"] for report in reports] == sorted({report["progress"] for report in reports})
    assert len(reports) > RECIPE.lights_total
    left = [sum(part["count"] for part in report["time_left"]["parts"]) for report in reports]
    assert left == sorted(left, reverse=True)
    assert left[-1] == 0
    later = reports[-3]["time_left"]["parts"]
    assert {part["rests_on"] for part in later if part["work"] in ("images", "normals")} == {"this-session"}


def test_session_answer_is_last_result(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, _ = done

    results = live.client.results(session.id)

    assert [result.number for result in results] == [0, 1]
    assert session.answer == results[-1] == live.client.result(session.id, 1)
    assert session.answer.passes == [0, 1]
    assert session.answer.summary.images == RECIPE.lights_total
    assert 0 < session.answer.summary.mean_sigma_deg < 20
    assert {"normals.png", "normals.tiff", "depth.tiff", "sigma_deg.tiff", "albedo.tiff", "mask.png"} <= {
        artefact.name for artefact in session.answer.artefacts
    }


def test_result_files_match_manifest(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, _ = done
    manifest = live.http.get(session.answer.links["manifest"]).json()

    for artefact in session.answer.artefacts:
        answer = live.http.get(artefact.href)
        assert (
            hashlib.sha256(answer.content).hexdigest() == artefact.sha256 == manifest["files"][artefact.name]["sha256"]
        )
        assert len(answer.content) == artefact.bytes
        assert answer.headers["etag"].removeprefix("W/") == f'"{artefact.sha256}"'  # weak where it is compressed
    assert live.http.get(f"{session.answer.links['self']}/normals.png").headers["content-type"] == "image/png"


def test_download_is_verified_and_atomic(live: Any, done: tuple[Any, list[Any]], tmp_path: Path) -> None:
    session, _ = done

    normals = tifffile.imread(live.client.download(session.id, 1, "normals.tiff", tmp_path / "normals.tiff"))
    mask = (
        cv2.imread(str(live.client.download(session.id, 1, "mask.png", tmp_path / "m.png")), cv2.IMREAD_UNCHANGED) > 0
    )

    assert normals.shape == (128, 128, 3)
    assert np.allclose(np.linalg.norm(normals[mask], axis=-1), 1, atol=1e-3)
    with pytest.raises(ProblemError) as unknown:
        live.client.download(session.id, 1, "nothing.png", tmp_path / "nothing.png")
    assert unknown.value.code is ErrorCode.REQUEST_NOT_FOUND
    assert "normals.png" in unknown.value.context["artefacts"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.png", "normals.tiff"]


def test_download_damaged_file_is_refused(live: Any, done: tuple[Any, list[Any]], tmp_path: Path) -> None:
    session, _ = done
    stored = live.service.store.folder(session.id) / "results" / "0" / "albedo.tiff"
    kept = stored.read_bytes()
    stored.write_bytes(kept[:-4] + b"oops")
    try:
        with pytest.raises(ProblemError) as damaged:
            live.client.download(session.id, 0, "albedo.tiff", tmp_path / "albedo.tiff")
    finally:
        stored.write_bytes(kept)

    assert damaged.value.code is ErrorCode.STORE_CORRUPT
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name",
    ["../../../recipe.json", "..%2f..%2frecipe.json", "%2e%2e/%2e%2e/cell.json", "normals.png%00", "/etc/passwd"],
)
def test_result_file_name_with_traversal_is_refused(live: Any, done: tuple[Any, list[Any]], name: str) -> None:
    session, _ = done
    host, port = live.url.removeprefix("http://").split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=60)

    connection.request("GET", f"/v1/sessions/{session.id}/results/1/{name}")  # sent as it stands
    answer = connection.getresponse()
    problem = json.loads(answer.read())
    connection.close()

    assert answer.status == 404
    assert problem["code"] == ErrorCode.REQUEST_NOT_FOUND


def test_passes_hold_plan_route_and_shots(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, _ = done

    passes = live.client.passes(session.id)
    first, second = (live.client.one_pass(session.id, item.number) for item in passes)

    assert [item.lights for item in passes] == [3, 1]
    assert [item.shots for item in passes] == [len(first.shots), len(second.shots)]
    assert len(first.plan.lights) == 3
    assert first.route is not None
    assert sorted(first.route.light_numbers) == [0, 1, 2]
    assert passes[1].predicted_sigma_deg == second.plan.predicted_sigma_deg
    assert all(item.shot.light is not None for item in first.shots if item.shot.kind == "light")


def test_shot_image_as_png_and_raw_tiff(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, _ = done
    shots = live.client.one_pass(session.id, 0).shots
    lit = next(item for item in shots if item.shot.kind == "light")
    dark = next(item for item in shots if item.shot.kind == "dark")

    pictures = [
        cv2.imdecode(np.frombuffer(live.http.get(item.links["image"]).content, np.uint8), cv2.IMREAD_UNCHANGED)
        for item in (lit, dark)
    ]
    raw = live.http.get(f"{lit.links['image']}?format=tiff")

    assert all(picture.shape == (128, 128) and picture.dtype == np.uint8 for picture in pictures)
    assert pictures[0].max() > 150
    assert np.median(pictures[1]) < 60
    assert raw.headers["content-type"] == "image/tiff"
    assert hashlib.sha256(raw.content).hexdigest() == lit.shot.frame.sha256
    assert live.http.get(f"{lit.links['image']}?format=bmp").status_code == 422


def test_reach_states_reason_of_each_refusal(live: Any, done: tuple[Any, list[Any]]) -> None:
    reach = live.http.get("/v1/rig/reach", timeout=60)

    assert reach.status_code == 200
    assert reach.json()


def test_stop_during_capture_leaves_arm_and_lamp_at_rest(live: Any, done: tuple[Any, list[Any]]) -> None:
    created = live.client.create(Recipe(method="two-rings", planned_lights=8))
    live.client.start(created.id)
    for event in live.client.events(created.id, after=0):
        if event.type == "shot.captured":
            break

    live.client.halt()
    session = live.client.wait(created.id)

    assert session.state is State.STOPPED
    assert session.answer is None
    reading = live.client.rig().reading
    assert max(map(abs, reading.joint_speeds)) < 0.01
    assert live.service.runner.status().reading.digital_outputs & 1 == 0
    assert not live.client.rig().may_start
    live.client.acknowledge()
    assert live.client.rig().may_start


def test_wait_ready_at_an_arm_that_is_off_says_that_a_person_powers_it_on(
    live: Any, done: tuple[Any, list[Any]]
) -> None:
    """Nothing is wrong with its link, and no stop is latched: the cell is clear, and yet no session may start."""
    created = live.client.create(Recipe())
    with ControlClient(CELL) as control:
        control.fault("power_off")
        while live.client.rig().reading.robot_mode == 7:
            time.sleep(0.05)
        with pytest.raises(ProblemError) as refused:
            live.client.wait_ready(timeout_s=0.5)
        with pytest.raises(ProblemError) as start:
            live.client.start(created.id)
        told = live.client.rig().reasons
        control.fault("clear")
        live.client.wait_ready()

    assert refused.value.code is ErrorCode.RIG_NOT_READY
    assert "The arm is not ready: powered off. If it is off, power it on" in refused.value.detail
    assert refused.value.context["reasons"][0]["code"] == start.value.code == ErrorCode.ARM_NOT_READY
    assert [reason.code for reason in told] == [ErrorCode.ARM_NOT_READY]


def test_park_after_stop_moves_arm_home(live: Any, done: tuple[Any, list[Any]]) -> None:
    last_event = live.service.store.journal.last_event_id()

    live.client.park()

    parked = next(event for event in live.client.events(after=last_event) if event.type == "rig.parked")
    assert parked.body["outcome"] == "at home"
    assert live.client.rig().reading.joints == pytest.approx(live.service.cell.arm.home, abs=0.01)


def test_client_capture_shows_progress_and_raises_reason(
    live: Any, done: tuple[Any, list[Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    far = Recipe(method="user", user_lights=[(0.0, 0.0, 5.0), (0.1, 0.0, 5.0), (0.0, 0.1, 5.0)])

    with pytest.raises(ProblemError) as failed:
        live.client.capture(far)

    assert failed.value.code in (ErrorCode.WAYPOINTS_UNREACHABLE, ErrorCode.PLAN_INFEASIBLE)
    assert failed.value.remedy
    assert "failed" in capsys.readouterr().out
    assert live.client.rig().may_start


def test_dry_run_gives_lights_path_and_time_and_stores_nothing(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, _ = done
    before = [item.id for item in live.client.sessions()]

    answer = live.http.post("/v1/dry-runs", json=RECIPE.model_dump(mode="json"), timeout=60)

    assert answer.status_code == 200
    preview = answer.json()
    wanted = live.client.one_pass(session.id, 0).plan.model_dump(mode="json")
    assert preview["plan"]["lights"] == wanted["lights"]
    assert sorted(preview["route"]["light_numbers"]) == [0, 1, 2]
    assert preview["seconds"] > preview["route"]["seconds"] > 0
    images = [point["lights"] for point in preview["forecast"]["points"]]
    assert images[0] == RECIPE.pilot_lights
    assert RECIPE.lights_total in images
    assert "matt sphere" in preview["forecast"]["assumption"]
    assert [item.id for item in live.client.sessions()] == before
    far = Recipe(method="user", user_lights=[(0.0, 0.0, 5.0), (0.1, 0.0, 5.0), (0.0, 0.1, 5.0)])
    refused = live.http.post("/v1/dry-runs", json=far.model_dump(mode="json"), timeout=60)
    assert refused.status_code == 422
    assert refused.json()["code"] in ("waypoints.unreachable", "plan.infeasible")


def test_plan_under_review_can_be_replaced(live: Any, done: tuple[Any, list[Any]]) -> None:
    created = live.client.create(Recipe(method="random", pilot_lights=3, planned_lights=0, review_plan=True))
    live.client.start(created.id)
    waiting = live.client.wait(created.id)
    assert waiting.state is State.PAUSED
    assert waiting.reason.code is ErrorCode.PLAN_TO_REVIEW
    assert waiting.allowed_actions == ["resume", "stop"]
    address = f"/v1/sessions/{created.id}/passes/0/plan"
    planned = live.client.one_pass(created.id, 0).plan
    moved = [list(light.position) for light in planned.lights[::-1]]

    far = live.http.put(address, json={"lights": [moved[0], [0.0, 0.0, 5.0]]}, timeout=60)
    answer = live.http.put(address, json={"lights": moved}, timeout=60)

    assert far.status_code == 422
    assert far.json()["code"] == ErrorCode.WAYPOINTS_UNREACHABLE
    assert [light["number"] for light in far.json()["lights"]] == [1]
    assert answer.status_code == 200
    assert [light["position"] for light in answer.json()["plan"]["lights"]] == moved
    assert live.client.one_pass(created.id, 0).plan.method == "user"
    listed = live.http.get(f"/v1/sessions/{created.id}/passes").json()["items"]
    assert [(one["number"], one["method"]) for one in listed] == [(0, "user")]
    live.client.stop(created.id)
    assert live.client.wait(created.id).state is State.STOPPED
    late = live.http.put(address, json={"lights": moved})
    assert late.status_code == 409
    assert late.json()["allowed"] == []


def test_recovery_not_allowed_by_cell_file_is_forbidden(shared: Any) -> None:
    refused = shared.http.post("/v1/rig/safety/recovery", json={"step": "unlock"})

    assert refused.status_code == 403
    assert refused.json()["code"] == ErrorCode.SAFETY_RECOVERY_FORBIDDEN
    assert shared.http.post("/v1/rig/safety/recovery", json={"step": "jump"}).status_code == 422


def test_wait_session_interrupted_by_other_service_returns(live: Any, done: tuple[Any, list[Any]]) -> None:
    session, heard = done
    again: list[Any] = []

    assert live.client.wait(session.id, again.append) == session
    assert [event.id for event in again] == [event.id for event in heard]


def test_signal_during_capture_interrupts_session_and_ends_service(live: Any) -> None:
    """The last test of this module: it ends the service that the others share."""
    created = live.client.create(Recipe(method="two-rings", planned_lights=8))
    live.client.start(created.id)
    for event in live.client.events(created.id, after=0):
        if event.type == "shot.captured":
            break

    live.server.handle_exit(signal.SIGTERM, None)
    with pytest.raises(httpx.TransportError):
        for _ in live.client.events(created.id, after=0, reconnect_timeout_s=0.0):
            pass
    while live.thread.is_alive():
        live.thread.join(1)

    store = Store(live.settings.data)
    session = store.journal.session(created.id)
    store.close()
    assert session.state is State.INTERRUPTED
    assert session.reason is not None
    assert session.reason["code"] == ErrorCode.SERVICE_RESTARTED
    with ControlClient(CELL) as control:
        state = control.state()
    assert max(map(abs, state["joint_speeds"])) < 0.01
    assert state["digital_outputs"] == 0
