"""The journal and the session folders, on real files."""

import errno
import json
import os
import sqlite3
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.light_plan import LightPlan
from acquisition.models.recipe import Recipe
from acquisition.models.shot import FrameQuality, Shot, ShotKey
from acquisition.session_state import State, Trigger
from acquisition.store import FolderFrames, Journal, Store
from acquisition.store.database import MIGRATIONS
from acquisition.store.folder import remove, sha256_of, write_bytes, write_frame, write_manifest


@pytest.fixture
def store(tmp_path: Path):
    opened = Store(tmp_path / "data")
    yield opened
    opened.close()


def new(store: Store) -> str:
    return store.journal.create_session(Recipe(), "{}", "fingerprint")[0].id


def light_shot(store: Store, session_id: str, number: int) -> Shot:
    frame = write_frame(store.folder(session_id), f"passes/0/shots/{number}.tiff", np.full((4, 6), number, np.uint16))
    return Shot(
        key=ShotKey(pass_number=0, number=number), kind="light", frame=frame, exposure_s=0.05, light_number=number,
        taken_at=1.0, quality=FrameQuality(saturated=0.0, bright_level=0.8, accepted=True),
    )  # fmt: skip


def test_store_second_service_raises_store_locked(store: Store) -> None:
    script = "import sys; from pathlib import Path; from acquisition.store import Store; Store(Path(sys.argv[1]))"
    second = subprocess.run(
        [sys.executable, "-c", script, str(store.data)], capture_output=True, text=True, check=False
    )
    assert second.returncode != 0
    assert "store.locked" in second.stderr


def test_trigger_second_holder_is_refused_naming_the_first(store: Store) -> None:
    first, second = new(store), new(store)
    store.journal.trigger(first, Trigger.START, "a")
    with pytest.raises(RigError) as refused:
        store.journal.trigger(second, Trigger.START, "b")
    assert refused.value.code is ErrorCode.RIG_BUSY
    assert refused.value.context["holder"] == first
    assert store.journal.session(second).state is State.CREATED
    store.journal.trigger(first, Trigger.FAIL, "runner")
    assert store.journal.trigger(second, Trigger.START, "b") == (State.CREATED, State.RUNNING)


def test_trigger_refused_action_is_recorded_with_alternatives(store: Store) -> None:
    session_id = new(store)
    with pytest.raises(RigError) as refused:
        store.journal.trigger(session_id, Trigger.PAUSE, "a")
    assert refused.value.code is ErrorCode.SESSION_ACTION_NOT_ALLOWED
    assert refused.value.context["allowed"] == ["start", "stop"]
    assert [(action.action, action.outcome) for action in store.journal.actions(session_id)] == [("pause", "refused")]


def test_journal_change_and_event_are_one_transaction(store: Store) -> None:
    session_id = new(store)
    before = store.journal.last_event_id()
    shot = light_shot(store, session_id, 0)
    store.journal.add_shot(session_id, shot)
    with pytest.raises(sqlite3.IntegrityError):
        store.journal.add_shot(session_id, shot)  # the same key twice: neither a row nor an event
    events = store.journal.events(before)
    assert [event.type for event in events] == ["shot.captured"]
    assert store.journal.shots(session_id) == [shot]


def test_create_session_same_idempotency_key_is_idempotent(store: Store) -> None:
    first, new_one = store.journal.create_session(Recipe(), "{}", "f", "key")
    again, new_two = store.journal.create_session(Recipe(), "{}", "f", "key")
    assert (first.id, new_one, new_two) == (again.id, True, False)
    with pytest.raises(RigError, match="another recipe"):
        store.journal.create_session(Recipe(seed=3), "{}", "f", "key")


def test_store_after_restart_holds_everything(tmp_path: Path) -> None:
    store = Store(tmp_path)
    session_id = new(store)
    store.journal.trigger(session_id, Trigger.START, "a")
    plan = LightPlan(lights=[], method="pilot", reasons=[])
    digest = write_bytes(store.folder(session_id) / "passes/0/plan.json", plan.model_dump_json().encode())
    store.journal.add_artifact(session_id, "plan", 0, "passes/0/plan.json", digest, {}, "plan.ready")
    store.journal.add_shot(session_id, light_shot(store, session_id, 2))
    before = store.record(session_id)
    events = store.journal.events(0)
    store.close()
    store = Store(tmp_path)
    assert store.record(session_id) == before
    assert store.journal.events(0) == events
    assert before.passes[0].plan == plan
    assert list(before.passes[0].shots) == [2]
    store.close()


def test_wait_for_event_wakes_and_replays_by_session_and_type(store: Store) -> None:
    session_id, last = new(store), store.journal.last_event_id()
    assert not store.journal.wait_for_event(last, 0.01)
    timer = threading.Timer(0.05, lambda: store.journal.announce(session_id, "log.warning", {"text": "x"}))
    timer.start()
    assert store.journal.wait_for_event(last, 60.0)
    timer.join()
    store.journal.announce(None, "device.changed", {})
    assert [event.type for event in store.journal.events(last)] == ["log.warning", "device.changed"]
    assert [event.type for event in store.journal.events(0, types=("log.warning",))] == ["log.warning"]
    assert {event.session_id for event in store.journal.events(0, session_id=session_id)} == {session_id}


def test_events_many_writers_each_event_is_read_once(store: Store) -> None:
    session_id = new(store)
    first = store.journal.last_event_id()

    def write(name: int) -> None:
        for number in range(25):
            store.journal.announce(session_id, "log.warning", {"by": name, "number": number})

    threads = [threading.Thread(target=write, args=(name,)) for name in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    events = store.journal.events(first, limit=1000)
    assert [event.id for event in events] == list(range(first + 1, first + 151))
    for name in range(6):
        assert [event.body["number"] for event in events if event.body["by"] == name] == list(range(25))


def test_delete_session_running_is_refused(store: Store) -> None:
    session_id = new(store)
    store.journal.trigger(session_id, Trigger.START, "a")
    with pytest.raises(RigError, match="stop it first"):
        store.journal.delete_session(session_id)
    store.journal.trigger(session_id, Trigger.FAIL, "runner")
    store.journal.delete_session(session_id)
    with pytest.raises(RigError) as gone:
        store.journal.session(session_id)
    assert gone.value.code is ErrorCode.SESSION_NOT_FOUND


def test_database_of_newer_schema_is_refused(tmp_path: Path) -> None:
    Store(tmp_path).close()
    connection = sqlite3.connect(tmp_path / "rig.db")
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(RigError, match="newer release"):
        Store(tmp_path)


@pytest.mark.parametrize("schema", range(1, len(MIGRATIONS)))
def test_journal_opened_by_several_at_once_is_migrated_once(tmp_path: Path, schema: int) -> None:
    database, openers = tmp_path / "rig.db", 4
    connection = sqlite3.connect(database)
    for name in MIGRATIONS[:schema]:
        connection.executescript((resources.files("acquisition.store") / name).read_text(encoding="utf-8"))
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA user_version = {schema}")
    connection.close()
    together = threading.Barrier(openers)

    def opened(_: int) -> None:
        together.wait()
        Journal(database).close()

    with ThreadPoolExecutor(openers) as pool:
        list(pool.map(opened, range(openers)))

    with sqlite3.connect(database) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (len(MIGRATIONS),)
    Journal(database).close()


def test_store_unusable_folder_or_database_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for name in ("noise", "pages"):
        Store(tmp_path / name).close()
    (tmp_path / "noise" / "rig.db").write_bytes(np.random.default_rng(1).bytes(20_000))
    database = tmp_path / "pages" / "rig.db"
    content = bytearray(database.read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    database.write_bytes(content)

    for data, code in {
        tmp_path / "file" / "data": ErrorCode.STORE_UNWRITABLE,
        tmp_path / "noise": ErrorCode.STORE_CORRUPT,
        tmp_path / "pages": ErrorCode.STORE_CORRUPT,
    }.items():
        for _ in range(2):  # the folder is free again afterwards
            with pytest.raises(RigError) as refused:
                Store(data)
            assert refused.value.code is code, data


def test_store_full_or_forbidden_disk_is_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, code in ((errno.ENOSPC, ErrorCode.STORE_DISK_FULL), (errno.EROFS, ErrorCode.STORE_UNWRITABLE)):

        def refuse(*_: object, number: int = number, **__: object) -> None:
            raise OSError(number, os.strerror(number))

        with monkeypatch.context() as disk:
            disk.setattr(Path, "mkdir", refuse)
            with pytest.raises(RigError) as refused:
                Store(tmp_path / "data")
        assert refused.value.code is code


def test_delete_session_is_told_to_whoever_follows_it(store: Store) -> None:
    session_id, other = new(store), new(store)
    store.journal.delete_session(session_id)

    told = store.journal.events(0, session_id=session_id)[-1]
    assert (told.type, told.body) == ("session.deleted", {"session_id": session_id})
    assert store.journal.events(0, session_id=other)[-1].type == "session.created"


def test_store_removes_what_a_killed_service_has_half_written(tmp_path: Path) -> None:
    half, whole = list[Path](), list[Path]()
    for place in ("sessions/x/results", "sessions/x/results/0/exports", "sessions/x/estimates", "calibrations"):
        half.append(tmp_path / place / ".0.abcd1234" / "calibration.json")
        whole.append(tmp_path / place / "0" / "calibration.json")
    for file in (*half, *whole):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("{}")
    Store(tmp_path).close()
    assert [file for file in half if file.parent.exists()] == []
    assert [file for file in whole if not file.exists()] == []


def test_write_bytes_full_disk_leaves_no_partial_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RigError) as error:
        write_bytes(tmp_path / "frame.tiff", b"x" * 100)
    assert error.value.code is ErrorCode.STORE_DISK_FULL
    assert list(tmp_path.iterdir()) == []


def test_folder_frames_rows_round_trip_and_damage_is_named(tmp_path: Path) -> None:
    pixels = np.arange(60, dtype=np.uint16).reshape(6, 10)
    frame = write_frame(tmp_path, "passes/0/shots/0.tiff", pixels)
    frames = FolderFrames(tmp_path)
    assert np.array_equal(frames.rows(frame, 2, 5), pixels[2:5])
    assert sha256_of(tmp_path / frame.path) == frame.sha256
    (tmp_path / frame.path).write_bytes((tmp_path / frame.path).read_bytes()[:60])
    with pytest.raises(RigError, match=r"shots/0\.tiff"):
        frames.rows(frame, 0, 6)


def test_write_manifest_lists_every_file_with_checksum(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    digest = write_bytes(tmp_path / "a" / "one.bin", b"1")
    write_manifest(tmp_path, {"session_id": "s"})
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["files"] == {"a/one.bin": {"sha256": digest, "bytes": 1}}


def test_folder_removed_while_a_file_is_written_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "session" / "exports").mkdir(parents=True)
    rmdir = os.rmdir

    def writes_meanwhile(path: Any, *, dir_fd: int | None = None) -> None:
        monkeypatch.undo()  # once, when the folder's list has been read
        (tmp_path / "session" / "exports" / "normals.png").touch()
        rmdir(path, dir_fd=dir_fd)

    monkeypatch.setattr(os, "rmdir", writes_meanwhile)
    remove(tmp_path / "session")  # what is left goes with the job that wrote it
    remove(tmp_path / "session")
    assert not (tmp_path / "session").exists()
    remove(tmp_path / "session")
