"""Archive, log, metrics and retention of sessions over HTTP."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from acquisition.models.errors import RigError
from acquisition.models.recipe import Recipe
from acquisition.session_state import Actor, Trigger
from acquisition.store import Journal, retention
from acquisition.store.queue_table import EntryState
from api.cli.commands import app
from api.client.responses import ProblemError
from api.rest import settings

DAY_S = 86_400.0


def test_archive_holds_folder_and_journal(own: Any) -> None:
    session = own.client.create(Recipe(label="to take home"))
    folder: Path = own.service.store.folder(session.id)
    (folder / "passes" / "0").mkdir(parents=True)
    (folder / "passes" / "0" / "plan.json").write_text("{}")
    (folder / ".shot.tiff.part").write_text("half")
    (folder / "out").symlink_to("/etc/hostname")
    (folder / "frame.tiff").write_bytes(bytes(range(256)) * 2000)

    answer = own.http.get(f"/v1/sessions/{session.id}/archive")

    assert answer.status_code == 200
    assert int(answer.headers["content-length"]) == len(answer.content)
    with zipfile.ZipFile(io.BytesIO(answer.content)) as packed:
        assert packed.testzip() is None
        names = {name.removeprefix(f"{session.id}/") for name in packed.namelist()}
        assert names == {
            "journal.jsonl", "recipe.json", "cell.json", "calibration.json", "passes/0/plan.json", "frame.tiff",
        }  # fmt: skip
        assert packed.read(f"{session.id}/frame.tiff") == bytes(range(256)) * 2000
        lines = packed.read(f"{session.id}/journal.jsonl").decode().splitlines()
    assert json.loads(lines[0])["what"] == "session.created"


def test_log_lists_events_and_actions_in_order(own: Any) -> None:
    session = own.client.create(Recipe())
    own.http.post(f"/v1/sessions/{session.id}/actions", json={"action": "pause"})
    own.http.post(f"/v1/sessions/{session.id}/actions", json={"action": "stop"})

    text = own.http.get(f"/v1/sessions/{session.id}/log").text

    places = [text.index(word) for word in ("session.created", "outcome=refused", "outcome=stopped")]
    assert places == sorted(places)
    assert "operator@" in text


@pytest.mark.parametrize("what", ["archive", "log"])
def test_archive_and_log_unknown_session_are_not_found(shared: Any, what: str) -> None:
    for name in ("nobody", "..%2F..%2Fetc", "%2e%2e"):
        answer = shared.http.get(f"/v1/sessions/{name}/{what}")
        assert answer.status_code == 404
        assert answer.headers["content-type"] == "application/problem+json"


def test_metrics_report_sessions_and_devices(own: Any) -> None:
    own.client.create(Recipe())
    text = own.http.get("/metrics").text
    assert 'lightpose_sessions{state="created"} 1.0' in text
    assert 'lightpose_sessions{state="running"} 0.0' in text
    assert "lightpose_arm_connected 0.0" in text
    assert "lightpose_events_total 1.0" in text


def _ended(journal: Journal, data: Path) -> str:
    row, _ = journal.create_session(Recipe(), "{}", "x")
    journal.trigger(row.id, Trigger.STOP, "test")
    (data / "sessions" / row.id).mkdir(parents=True)
    (data / "sessions" / row.id / "frame.tiff").write_bytes(bytes(1000))
    return row.id


def no_archive(address: str, key: str, folder: Path) -> str | None:
    """What an archive lacks, where there is none."""
    raise AssertionError


def test_prune_removes_only_old_ended_sessions(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "rig.db")
    old, newer = _ended(journal, tmp_path), _ended(journal, tmp_path)
    queued, _ = journal.create_session(Recipe(), "{}", "x")
    entry, _ = journal.add_queue_entry("coin", Recipe(), "test", unattended=False, idempotency_key=None)
    journal.set_queue_entry(entry, EntryState.WAITING, queued.id)
    holding, _ = journal.create_session(Recipe(), "{}", "x")
    journal.trigger(holding.id, Trigger.START, "test")
    now = (journal.session(old).ended_at or 0.0) + 31 * DAY_S

    def prune(days: float, keep: int, pretend: bool = False) -> list[str]:
        found = retention.prune(tmp_path, older_than_days=days, keep=keep, now=now, dry_run=pretend, lacking=no_archive)
        removed = found.removed
        assert all(item.bytes == 1000 for item in removed)
        return [item.session_id for item in removed]

    assert prune(32, keep=0) == []
    assert prune(30, keep=2) == []
    assert prune(30, keep=1, pretend=True) == [old]
    assert journal.session(old).id == old
    assert prune(30, keep=1) == [old]
    assert not (tmp_path / "sessions" / old).exists()
    assert (tmp_path / "sessions" / newer).exists()
    assert prune(30, keep=0) == [newer]
    assert {row.id for row in journal.sessions(10)} == {queued.id, holding.id}
    journal.close()


def test_prune_removes_sessions_that_were_never_started(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "rig.db")
    created, _ = journal.create_session(Recipe(), "{}", "x")
    (tmp_path / "sessions" / created.id).mkdir(parents=True)

    def prune(days: float) -> list[retention.PrunedSession]:
        now = created.created_at + days * DAY_S
        return retention.prune(
            tmp_path, older_than_days=30, keep=10, now=now, dry_run=False, lacking=no_archive
        ).removed

    assert prune(29) == []
    assert prune(31) == [retention.PrunedSession(created.id, False, created.created_at, 0)]
    assert journal.sessions(10) == []
    assert not (tmp_path / "sessions" / created.id).exists()
    journal.close()


def test_prune_command_removes_old_sessions(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "rig.db")
    old = _ended(journal, tmp_path)
    journal.close()
    arguments = ["prune", "--data", str(tmp_path), "--older-than-days", "0", "--keep", "0"]
    assert "would remove 1 sessions" in CliRunner().invoke(app, [*arguments, "--dry-run"]).stdout
    assert old in CliRunner().invoke(app, arguments).stdout
    assert CliRunner().invoke(app, ["prune", "--data", str(tmp_path / "nowhere")]).exit_code == 2


def test_prune_command_names_a_folder_that_the_journal_does_not_know(tmp_path: Path) -> None:
    """Its entry was lost with the journal, or the deletion was broken off after the entry: nobody would look there."""
    journal = Journal(tmp_path / "rig.db")
    known, lost = _ended(journal, tmp_path), _ended(journal, tmp_path)
    journal.delete_session(lost)
    journal.close()
    (tmp_path / "sessions" / "lost+found").mkdir()
    arguments = ["prune", "--data", str(tmp_path), "--keep", "0", "--older-than-days"]
    young = CliRunner().invoke(app, [*arguments, "1"])
    assert (young.exit_code, young.stderr) == (0, "")
    said = CliRunner().invoke(app, [*arguments, "0"])
    assert said.exit_code == 1
    assert said.stderr == (
        f"kept {tmp_path}/sessions/{lost}: the journal has no such session; push it to an archive or move it "
        "elsewhere, or delete it\n"
    )
    assert known in said.stdout
    assert sorted(path.name for path in (tmp_path / "sessions").iterdir()) == [lost, "lost+found"]


def test_prune_command_names_an_archive_that_is_away(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "rig.db")
    journal.set_archive(str(tmp_path / "mount_point"))
    old = _ended(journal, tmp_path)
    with journal._transaction() as connection:
        connection.execute("UPDATE session SET state = 'completed' WHERE id = ?", (old,))
    due = journal.due(0.0)
    assert due is not None
    arguments = ["prune", "--data", str(tmp_path), "--older-than", "0", "--keep", "0"]
    said = CliRunner().invoke(app, arguments)
    assert (said.exit_code, "kept 1 sessions that the archive does not have yet" in said.stderr) == (0, True)
    journal.archived(due, "0" * 64)
    journal.close()
    (tmp_path / "mount_point").mkdir()
    said = CliRunner().invoke(app, arguments)
    assert said.exit_code == 1
    assert "kept 1 archived sessions" in said.stderr
    assert f"archive.address_invalid: {tmp_path}/mount_point: holds no archive" in said.stderr
    assert (tmp_path / "sessions" / old).is_dir()


def test_prune_folder_without_journal_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="not a data folder"):
        retention.prune(tmp_path, older_than_days=0, keep=0, now=0, dry_run=False, lacking=no_archive)
    assert not (tmp_path / "rig.db").exists()


def test_client_archive_downloads_session(own: Any, tmp_path: Path) -> None:
    session = own.client.create(Recipe(label="to take home"))

    path = own.client.archive(session.id, tmp_path / "home.zip")

    with zipfile.ZipFile(path) as packed:
        assert f"{session.id}/recipe.json" in packed.namelist()
    assert "session.created" in own.client.log(session.id)
    with pytest.raises(ProblemError):
        own.client.archive("nope", tmp_path / "nothing.zip")
    assert [item.name for item in tmp_path.glob("*.zip")] == ["home.zip"]


def test_archive_status_without_an_archive_is_empty(own: Any) -> None:
    answer = own.http.get("/v1/archive").json()
    assert (answer["address"], answer["archived"], answer["waiting"], answer["reason"]) == (None, 0, 0, None)


def test_relative_archive_folder_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`lightpose prune` asks the archive at the journal's address from another folder."""
    monkeypatch.chdir(tmp_path)
    assert settings.read(cell=tmp_path, archive="archive").archive == str(tmp_path / "archive")
    assert settings.read(cell=tmp_path, archive="s3://objects/archive").archive == "s3://objects/archive"


def test_archive_status_counts_what_waits_and_why(own: Any) -> None:
    journal = own.service.store.journal
    journal.set_archive("/nowhere/archive")
    session = own.client.create(Recipe())
    journal.trigger(session.id, Trigger.START, "operator@test")
    journal.trigger(session.id, Trigger.FINISH, Actor.RUNNER)
    due = journal.due(0.0)
    assert due is not None
    journal.not_archived(due, "the disk is away", 60.0)

    answer = own.http.get("/v1/archive").json()

    assert (answer["address"], answer["archived"], answer["waiting"]) == ("/nowhere/archive", 0, 1)
    assert answer["reason"] == "the disk is away"
    assert (answer["problem"], answer["problem_at"]) == (None, None)
    journal.set_archive_problem("the disk is not mounted")
    assert own.http.get("/v1/archive").json()["problem"] == "the disk is not mounted"
