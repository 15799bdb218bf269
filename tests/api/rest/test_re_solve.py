"""Re-solving over HTTP without any device: no hardware is needed.

The session's images are those of a small scene of known truth; they were entered as a capture enters them.
"""

import hashlib
import io
import json
import re
import time
import zipfile
from collections.abc import Callable, Generator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from acquisition.models import cell_config
from acquisition.models.errors import ErrorCode
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.models.shot import Observations, Shot
from acquisition.runner.re_solve import EXPORTS
from acquisition.runner.solve_requests import ACCEPTED, FAILED, READY
from acquisition.session_state import State
from acquisition.store.folder import write_frame, write_value
from api import ProblemError
from api.rest import keys, settings
from tests.acquisition import scenes

REPOSITORY = Path(__file__).parents[3]
SIZE = 64
ASKED = {"shadow_threshold": 0.09}
LIGHTS = [*scenes.ring(3, 20.0), *scenes.ring(3, 50.0, 0.5)]


@pytest.fixture(scope="module")
def service_settings(tmp_path_factory: pytest.TempPathFactory) -> settings.Settings:
    """A cell file with a camera of few pixels and an arm that is not there."""
    folder = tmp_path_factory.mktemp("resolve")
    text = (REPOSITORY / "hardware_sim" / "cells" / "cell.sim.toml").read_text(encoding="utf-8")
    text = re.sub(r'^address = ".*"', 'address = "127.0.45.1"', text, flags=re.MULTILINE)
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    x, y, z = cell_config.load(folder / "cell.toml").object.keep_out.base_from_object.position_m
    above = ((1.0, 0.0, 0.0, x), (0.0, -1.0, 0.0, y), (0.0, 0.0, -1.0, z + scenes.TABLE_DEPTH), (0.0, 0.0, 0.0, 1.0))
    known = scenes.calibration(SIZE, valid_days=36500.0, base_from_camera=above)
    (folder / "calibration.sim.json").write_text(known.model_dump_json(), encoding="utf-8")
    return settings.read(cell=folder / "cell.toml", data=folder / "data", host="127.0.45.2", port=0)


@pytest.fixture(scope="module")
def service(service_settings: settings.Settings, serving: Any) -> Generator[Any]:
    secret = keys.add(keys.path_in(service_settings.data), "an-admin", keys.Role.ADMIN)
    with serving(service_settings, secret) as running:
        yield running


@cache
def scene() -> scenes.Scene:
    return scenes.scene(scenes.bumps, scenes.calibration(SIZE))


@cache
def photographed() -> Observations:
    return scenes.capture(scene(), LIGHTS, exposure_s=0.05)


def capture(service: Any) -> str:
    """A session with three lights in each of two passes, not ended."""
    store = service.service.store
    identity = service.client.create(Recipe(pilot_lights=3, planned_lights=3)).id
    folder = store.folder(identity)
    observations = photographed()
    dark = next(iter(observations.darks.values()))
    frames: Any = observations.frames

    def enter(shot: Shot, pass_number: int, number: int) -> None:
        file = f"passes/{pass_number}/shots/{number}.tiff"
        key = shot.key.model_copy(update={"pass_number": pass_number, "number": number})
        frame = write_frame(folder, file, frames.stored[shot.frame.path])
        light_number = number if shot.kind == "light" else None
        store.journal.add_shot(
            identity, shot.model_copy(update={"key": key, "frame": frame, "light_number": light_number})
        )

    for pass_number, part in enumerate((observations.shots[:3], observations.shots[3:])):
        plan = LightPlan(lights=[shot.light for shot in part if shot.light], method="user", reasons=[""] * len(part))
        digest = write_value(folder / f"passes/{pass_number}/plan.json", plan)
        body = {"lights": len(part), "method": "user", "predicted_sigma_deg": 1.0, "predicted_median_deg": None}
        name = f"passes/{pass_number}/plan.json"
        store.journal.add_artifact(identity, "plan", pass_number, name, digest, body, "plan.ready")
        for number, shot in enumerate(part):
            enter(shot, pass_number, number)
        enter(dark, pass_number, len(part))
    return identity


@pytest.fixture(scope="module")
def ended(service: Any) -> str:
    identity = capture(service)
    assert service.client.stop(identity) is State.STOPPED
    return identity


def outcome(service: Any, identity: str, number: int, within_s: float = 100.0) -> Any:
    """The event that ends a solve."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        for event in service.client.past_events(identity):
            if event.type in (READY, FAILED) and event.body["number"] == number:
                return event
        time.sleep(0.1)
    raise AssertionError("nothing came of it")


@pytest.fixture(scope="module")
def solved(service: Any, ended: str) -> int:
    """The number of a result that was asked for and is there."""
    number = service.client.resolve(ended)
    assert outcome(service, ended, number).type == READY
    return number


def normals(service: Any, identity: str, number: int) -> np.ndarray:
    content = service.http.get(f"/v1/sessions/{identity}/results/{number}/normals.tiff").content
    return tifffile.imread(io.BytesIO(content))


def test_re_solve_is_accepted_solved_and_has_its_own_origin(service: Any, ended: str) -> None:
    answer = service.http.post(f"/v1/sessions/{ended}/results", json={"settings": ASKED})

    assert answer.status_code == 202
    accepted = answer.json()
    assert answer.headers["location"] == accepted["links"]["result"]
    assert outcome(service, ended, accepted["number"]).type == READY
    result = service.client.result(ended, accepted["number"])
    assert result.origin == "resolve"
    assert result.passes == [0, 1]
    assert result.settings == SolveSettings.model_validate(ASKED)
    assert result.summary.images == len(LIGHTS)
    assert 0 < result.summary.mean_sigma_deg < 5
    assert service.client.results(ended)[-1].number == accepted["number"]
    session = service.client.session(ended)
    assert session.answer is None  # it was stopped before its own solve
    assert session.state is State.STOPPED
    assert not service.client.rig().connected
    assert np.mean(scene().error_deg(normals(service, ended, accepted["number"]))) < 2


def test_re_solve_uses_requested_settings_and_passes(service: Any, ended: str, solved: int) -> None:
    asked = SolveSettings(shadow_threshold=0.3, depth_rounds=0)

    other = service.client.resolve(ended, asked)
    fewer = service.client.resolve(ended, last_pass=0)

    assert outcome(service, ended, other).type == outcome(service, ended, fewer).type == READY
    assert service.client.result(ended, other).settings == asked
    assert service.client.result(ended, fewer).passes == [0]
    assert service.client.result(ended, fewer).summary.images == 3
    assert len({solved, other, fewer}) == 3
    one, two = normals(service, ended, solved), normals(service, ended, other)
    assert np.abs(one - two).max() > 1e-3


def test_result_report_is_one_of_its_files(service: Any, ended: str, solved: int) -> None:
    known = {item.name: item for item in service.client.result(ended, solved).artefacts}

    page = service.http.get(known["report.html"].href)

    assert page.headers["content-type"].startswith("text/html")
    policy = page.headers["content-security-policy"]  # its scripts run, but not as the service's own
    assert "sandbox allow-scripts" in policy
    assert "allow-same-origin" not in policy
    assert hashlib.sha256(page.content).hexdigest() == known["report.html"].sha256
    assert f"Session {ended}, result {solved}" in page.text
    assert service.http.get(known["report.png"].href).content.startswith(b"\x89PNG")


@pytest.mark.parametrize("name", EXPORTS)
def test_result_exports_are_made_on_first_request(service: Any, ended: str, solved: int, name: str) -> None:
    address = service.client.result(ended, solved).exports[name]

    first, second = service.http.get(address), service.http.get(address)

    assert first.status_code == 200, first.text
    assert first.content == second.content
    assert first.headers["etag"] == second.headers["etag"]
    match name.rsplit(".", maxsplit=1)[-1]:
        case "zip":
            with zipfile.ZipFile(io.BytesIO(first.content)) as packed:
                assert packed.testzip() is None
                assert "mask.png" in packed.namelist()
        case "dome":
            assert len(json.loads(first.content)["positions3d"]) == len(LIGHTS)
        case "lp":
            assert first.text.splitlines()[0] == str(len(LIGHTS))
        case suffix:
            assert first.content.startswith({"png": b"\x89PNG", "exr": b"v/1\x01", "ply": b"ply\n"}[suffix])


def test_result_unknown_file_is_404(service: Any, ended: str, solved: int) -> None:
    for name in ("mesh.stl", "diligent", "exports"):
        answer = service.http.get(f"/v1/sessions/{ended}/results/{solved}/{name}")
        assert (answer.status_code, answer.json()["code"]) == (404, ErrorCode.REQUEST_NOT_FOUND)
        if "." in name:
            assert {"report.html", "mesh.ply"} <= set(answer.json()["artefacts"])


def test_result_pending_is_not_ready_unrequested_is_not_found(service: Any, ended: str) -> None:
    number = service.client.resolve(ended, SolveSettings(shadow_threshold=0.11))
    answer = service.http.get(f"/v1/sessions/{ended}/results/{number}")

    assert answer.status_code == 409
    assert answer.json()["code"] == ErrorCode.RESULT_NOT_READY
    assert service.http.get(f"/v1/sessions/{ended}/results/{number + 1}").status_code == 404
    outcome(service, ended, number)
    assert service.http.get(f"/v1/sessions/{ended}/results/{number}").status_code == 200


def test_re_solve_equal_request_makes_no_second_job(service: Any, ended: str, solved: int) -> None:
    address = f"/v1/sessions/{ended}/results"
    before = len(service.client.past_events(ended))
    waiting = [service.http.post(address, json={"settings": {"shadow_threshold": 0.12}}) for _ in range(40)]
    finished = service.http.post(address, json={})
    keyed = [
        service.http.post(address, json={"settings": asked}, headers={"Idempotency-Key": "k"})
        for asked in ({"shadow_threshold": 0.13}, {"shadow_threshold": 0.14})
    ]

    assert [answer.status_code for answer in waiting] == [202] + [200] * 39
    assert len({answer.json()["number"] for answer in waiting}) == 1
    assert (finished.status_code, finished.json()["number"]) == (200, solved)
    assert [answer.status_code for answer in keyed] == [202, 200]
    assert keyed[0].json()["number"] == keyed[1].json()["number"]
    for answer in (waiting[0], keyed[0]):
        assert outcome(service, ended, answer.json()["number"]).type == READY
    made = [event for event in service.client.past_events(ended)[before:] if event.type == ACCEPTED]
    assert len(made) == 2


def test_re_solve_cancelled_ends_and_says_so(service: Any, ended: str, solved: int) -> None:
    compute = service.service.resolving._compute
    with compute._busy:  # so that the first one surely runs, and the second waits, when they are cancelled
        running = service.client.resolve(ended, SolveSettings(shadow_threshold=0.15, depth_rounds=10))
        waiting = service.client.resolve(ended, SolveSettings(shadow_threshold=0.16))
        until(lambda: service.service.resolving._running is not None)
        service.client.cancel_resolve(ended, waiting)
        assert outcome(service, ended, waiting).body["problem"]["code"] == ErrorCode.RESULT_CANCELLED
        service.client.cancel_resolve(ended, running)
        service.client.cancel_resolve(ended, running)  # again is no error
    failed = outcome(service, ended, running)

    assert (failed.type, failed.body["problem"]["code"]) == (FAILED, ErrorCode.RESULT_CANCELLED)
    gone = service.http.get(f"/v1/sessions/{ended}/results/{running}")
    assert (gone.status_code, gone.json()["code"]) == (410, ErrorCode.RESULT_CANCELLED)
    assert not (service.service.store.folder(ended) / "results" / str(running)).exists()
    finished = service.http.post(f"/v1/sessions/{ended}/results/{solved}/cancellation")
    assert (finished.status_code, finished.json()["code"]) == (409, ErrorCode.SESSION_ACTION_NOT_ALLOWED)
    assert service.http.post(f"/v1/sessions/{ended}/results/9000/cancellation").status_code == 404
    again = service.client.resolve(ended, SolveSettings(shadow_threshold=0.16))
    assert again > waiting
    assert outcome(service, ended, again).type == READY


def until(true: Callable[[], bool], within_s: float = 60.0) -> None:
    deadline = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_re_solve_unfinished_session_is_refused(service: Any) -> None:
    identity = capture(service)

    with pytest.raises(ProblemError) as refused:
        service.client.resolve(identity)

    assert refused.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED
    assert refused.value.problem.status == 409
    assert refused.value.context["state"] == "created"


@pytest.mark.parametrize(
    "body",
    [
        {"settings": {"robust": "yes"}},
        {"settings": {"magic": 1}},
        {"last_pass": -1},
        {"passes": [0]},
        {"settings": None},
    ],
)
def test_re_solve_invalid_request_is_refused(service: Any, ended: str, body: dict[str, Any]) -> None:
    answer = service.http.post(f"/v1/sessions/{ended}/results", json=body)

    assert answer.status_code == 422
    assert answer.json()["code"] == ErrorCode.REQUEST_INVALID


def test_re_solve_session_without_images_is_refused(service: Any, ended: str) -> None:
    empty = service.client.create().id
    service.client.stop(empty)
    for identity, last_pass in ((empty, None), (ended, 7)):
        with pytest.raises(ProblemError) as refused:
            service.client.resolve(identity, last_pass=last_pass)
        assert refused.value.code is ErrorCode.NORMALS_INFEASIBLE
    with pytest.raises(ProblemError) as unknown:
        service.client.resolve("nobody")
    assert unknown.value.code is ErrorCode.SESSION_NOT_FOUND


def test_re_solve_failure_is_announced_and_kept(service: Any) -> None:
    identity = capture(service)
    service.client.stop(identity)
    frame = service.service.store.folder(identity) / "passes/1/shots/1.tiff"
    frame.write_bytes(frame.read_bytes()[:1000])

    number = service.client.resolve(identity)

    event = outcome(service, identity, number)
    assert event.type == FAILED
    assert event.body["problem"]["code"] == ErrorCode.STORE_CORRUPT
    assert "shots/1.tiff" in event.body["problem"]["detail"]
    answer = service.http.get(f"/v1/sessions/{identity}/results/{number}")
    assert answer.json()["code"] == ErrorCode.STORE_CORRUPT
    assert service.client.results(identity) == []
    assert not (service.service.store.folder(identity) / "results" / str(number)).exists()
    assert service.client.resolve(identity) == number + 1


def test_sessions_one_with_damaged_files_is_listed_and_named(service: Any) -> None:
    identity = capture(service)
    service.client.stop(identity)
    number = service.client.resolve(identity)
    assert outcome(service, identity, number).type == READY
    assert service.http.patch(f"/v1/sessions/{identity}", json={"answer": number}).status_code == 200
    folder = service.service.store.folder(identity)

    def damage_of(path: Path, change: Callable[[Path], object]) -> tuple[Any, Any]:
        kept = path.rename(path.with_name("kept"))
        change(path)
        try:
            return listed(), service.http.get(f"/v1/sessions/{identity}")
        finally:
            path.unlink(missing_ok=True)
            kept.rename(path)

    def listed() -> Any:
        return next(one for one in service.client.sessions() if one.id == identity)

    whole = listed()
    assert whole.damage is None
    for name in ("passes/0/plan.json", f"results/{number}/manifest.json", "calibration.json"):
        for change in (Path.touch, lambda path: path.write_text("{}"), lambda path: None):
            if name == "calibration.json" and change is not Path.touch:
                continue
            one, answer = damage_of(folder / name, change)
            assert one.damage.code is ErrorCode.STORE_CORRUPT
            assert (one.stage, one.label, one.answer) == ("pilot", whole.label, None)
            assert (answer.status_code, answer.json()["code"]) == (500, ErrorCode.STORE_CORRUPT)
            assert f"sessions/{identity}/{name}" in answer.json()["detail"]
    one, _ = damage_of(folder, lambda path: None)  # moved away, as the manual says when the disk is full
    assert "plan.json" in one.damage.detail
    assert listed() == whole
    service.client.delete(identity)


@pytest.mark.long
def test_re_solve_requested_before_restart_is_done_after_it(
    serving: Any, service_settings: Any, tmp_path: Path
) -> None:
    chosen = service_settings.model_copy(update={"data": tmp_path / "data"})
    with serving(chosen) as before:
        identity = capture(before)
        before.client.stop(identity)
        # The service ends between accepting and solving: the journal has the first only.
        body = {"number": 2, "last_pass": 1, "settings": SolveSettings().model_dump(mode="json"), "by": "operator"}
        before.service.store.journal.announce(identity, ACCEPTED, body)
    with serving(chosen) as after:
        assert outcome(after, identity, 2).type == READY
        assert after.client.result(identity, 2).origin == "resolve"


def test_delete_during_a_solve_ends_it_and_its_folder_for_good(service: Any) -> None:
    identity = capture(service)
    service.client.stop(identity)
    resolving, folder = service.service.resolving, service.service.store.folder(identity)
    service.client.resolve(identity, SolveSettings(depth_rounds=10))
    until(lambda: resolving._running is not None and (folder / "results").exists())

    service.client.delete(identity)

    assert resolving._running is None
    assert not folder.exists()
    time.sleep(1)
    assert not folder.exists()
    again = capture(service)
    service.client.stop(again)
    assert outcome(service, again, service.client.resolve(again)).type == READY


def test_export_of_session_deleted_meanwhile_is_not_found(service: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    identity = capture(service)
    service.client.stop(identity)
    number = service.client.resolve(identity)
    assert outcome(service, identity, number).type == READY
    address = service.client.result(identity, number).exports["normals_directx.png"]
    resolving = service.service.resolving
    run = resolving._compute.run

    def deletes_first(*arguments: Any, **options: Any) -> Any:
        service.client.delete(identity)
        return run(*arguments, **options)

    monkeypatch.setattr(resolving._compute, "run", deletes_first)
    answer = service.http.get(address)

    assert (answer.status_code, answer.json()["code"]) == (404, ErrorCode.SESSION_NOT_FOUND)
    assert not service.service.store.session_path(identity).exists()


def test_solve_of_session_pruned_meanwhile_leaves_no_folder(service: Any) -> None:
    identity = capture(service)
    service.client.stop(identity)
    store, resolving = service.service.store, service.service.resolving
    folder = store.folder(identity)
    service.client.resolve(identity)
    until(lambda: resolving._running is not None and (folder / "results").exists())

    store.journal.delete_session(identity)  # as `lightpose prune` does in a process of its own
    until(lambda: resolving._running is None)

    until(lambda: not folder.exists())


@pytest.mark.long
def test_re_solve_of_deleted_session_is_dropped(service: Any) -> None:
    identity = capture(service)
    service.client.stop(identity)
    service.client.resolve(identity)
    service.client.delete(identity)
    again = capture(service)
    service.client.stop(again)
    assert outcome(service, again, service.client.resolve(again)).type == READY
