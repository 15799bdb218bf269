"""Data folders of past releases open in this build, with complete content."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from acquisition import session
from acquisition.formats import export
from acquisition.models import cell_config
from acquisition.models.cell_config import CellConfig
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.runner.results import observations
from acquisition.session_state import State, Trigger
from acquisition.store import Store

RELEASES = sorted((Path(__file__).parents[2] / "data").glob("release_*"))


@pytest.fixture(params=RELEASES, ids=lambda folder: folder.name)
def store(request: pytest.FixtureRequest, tmp_path: Path):
    """A copy, for opening may migrate it."""
    shutil.copytree(request.param, tmp_path / "data")
    opened = Store(tmp_path / "data")
    yield opened
    opened.close()


def test_past_releases_folder_is_not_empty() -> None:
    assert RELEASES


def test_past_release_sessions_and_events_are_read(store: Store) -> None:
    stopped, completed = store.journal.sessions(10)

    assert (completed.state, stopped.state) == (State.COMPLETED, State.STOPPED)
    assert completed.recipe.label == "first release"
    record = store.record(completed.id)
    home = CellConfig.model_validate_json(completed.cell).arm.home
    assert session.next_step(record, home, home) is None
    assert session.progress(record) == 1.0
    assert [len(work.shots) for work in record.passes] == [4, 1]
    events = store.journal.events(0, 10_000, completed.id)
    assert [event.body["state"] for event in events if event.type == "session.state"] == ["running", "completed"]
    assert sum(event.type == "normals.ready" for event in events) == 2


def test_past_release_files_match_manifest_and_solve_again(store: Store) -> None:
    (completed,) = (row for row in store.journal.sessions(10) if row.state is State.COMPLETED)
    folder = store.folder(completed.id)
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))

    for name, facts in manifest["files"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == facts["sha256"], name
    calibration = cell_config.load_calibration(folder / "calibration.json")
    images = observations(store.record(completed.id), folder)
    for shot in (*images.shots, *images.darks.values()):
        assert images.frames.rows(shot.frame, 0, shot.frame.height).shape == (calibration.height, calibration.width)
    stored = export.read(folder / "results" / "1")
    assert np.allclose(np.linalg.norm(stored.normals[stored.mask], axis=-1), 1, atol=1e-3)


def test_past_release_database_accepts_new_sessions(store: Store) -> None:
    (completed,) = (row for row in store.journal.sessions(10) if row.state is State.COMPLETED)
    row, new = store.journal.create_session(Recipe(), completed.cell, completed.fingerprint)
    assert new
    store.journal.trigger(row.id, Trigger.START, "a")
    assert store.journal.holder() == store.journal.session(row.id)


def test_past_release_cell_is_the_same_after_the_upgrade(store: Store) -> None:
    """Else no session that was interrupted could be resumed."""
    for row in store.journal.sessions(10):
        assert CellConfig.model_validate_json(row.cell).fingerprint == row.fingerprint


def test_past_release_plan_with_rings_in_place_still_says_why(store: Store) -> None:
    """Release 0.1 put two rings in the place of some plans, and wrote the reason into `plan.json`."""
    (completed,) = (row for row in store.journal.sessions(10) if row.state is State.COMPLETED)
    written = json.loads((store.folder(completed.id) / "passes/1/plan.json").read_text(encoding="utf-8"))
    why = "1.2% of the measurements that the shape so far predicts as lit are dark"
    assert LightPlan.model_validate_json(json.dumps(written)).fallback is None
    assert LightPlan.model_validate_json(json.dumps(written | {"fallback": why})).fallback == why
