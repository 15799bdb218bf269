"""A disk that refuses a file: the session pauses, and goes on from there; nothing is half made."""

import errno
import hashlib
import os
import shutil
import threading
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import httpx
import numpy as np
import pytest

from acquisition.devices import Finding
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.models.result import SolveSettings
from acquisition.session_state import ENDED, State, Trigger
from acquisition.store.queue_table import EntryState
from tests.acquisition.runner.test_stop_while_planning import wait_for
from tests.model.quick_rig import PIXELS, quick_service

ADDRESS = "127.0.6.46"


@pytest.mark.parametrize("number", [errno.EIO, errno.EROFS, errno.EACCES])
def test_image_that_cannot_be_written_pauses_its_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    fsync, refusals = os.fsync, [OSError(number, os.strerror(number))]

    def refuses_once(descriptor: int) -> None:
        if refusals and "/shots/" in os.readlink(f"/proc/self/fd/{descriptor}"):
            raise refusals.pop()
        fsync(descriptor)

    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, _, _):
        store, runner = server.service.store, server.service.runner
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1))[0].id
        monkeypatch.setattr(os, "fsync", refuses_once)
        runner.act(session_id, Trigger.START, "a")
        wait_for(lambda: store.journal.session(session_id).state in {State.PAUSED, *ENDED})
        row = store.journal.session(session_id)
        assert row.state is State.PAUSED
        assert row.reason is not None
        assert row.reason["code"] == ErrorCode.STORE_UNWRITABLE
        assert "/shots/" in row.reason["detail"]
        runner.act(session_id, Trigger.RESUME, "a")
        wait_for(lambda: store.journal.session(session_id).state in ENDED)
        assert store.journal.session(session_id).state is State.COMPLETED
        assert list(store.session_path(session_id).rglob("*.part")) == []


def test_session_that_cannot_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, url, _):
        mkdir = Path.mkdir

        def refuse(path: Path, *arguments: int, **options: bool) -> None:
            if path.parent.name == "sessions":
                raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
            mkdir(path, *arguments, **options)

        monkeypatch.setattr(Path, "mkdir", refuse)
        answer = httpx.post(f"{url}/v1/sessions", json={}, timeout=60)
        assert answer.status_code == 503
        assert answer.json()["code"] == ErrorCode.STORE_UNWRITABLE
        assert server.service.store.journal.sessions(10) == []


def test_journal_that_cannot_be_read_for_a_while_ends_no_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Streams, the queue and further solves go on afterwards."""
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, url, _):
        service = server.service
        journal, runner = service.store.journal, service.runner
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1))[0].id
        runner.act(session_id, Trigger.START, "a")
        wait_for(lambda: journal.session(session_id).state is State.COMPLETED)
        request, _ = service.resolving.submit(session_id, SolveSettings(), None, "a")
        wait_for(lambda: len(journal.artifacts(session_id, "result")) == 3)
        refused = Counter[str]()

        def refuse(*_: object) -> None:
            refused[threading.current_thread().name] += 1
            raise RigError(ErrorCode.STORE_UNWRITABLE, "The journal cannot be written: disk I/O error")

        with monkeypatch.context() as disk:
            disk.setattr(journal, "_one", refuse)
            disk.setattr(journal, "_all", refuse)
            service.resolving._queue.put(request)
            wait_for(lambda: {"event-feed", "queue", "resolving"} <= set(refused))
        alive = {thread.name for thread in threading.enumerate()}
        assert {"event-feed", "queue", "resolving", "runner", "safety-monitor"} <= alive

        with httpx.stream("GET", f"{url}/v1/events", timeout=60) as events:
            parts = events.iter_text()
            next(parts)
            service.resolving.submit(session_id, SolveSettings(), 0, "a")
            assert "resolve.accepted" in next(part for part in parts if "event:" in part)
        wait_for(lambda: len(journal.artifacts(session_id, "result")) == 4)
        entry, _ = journal.add_queue_entry("vase", Recipe(pilot_lights=3), "a", unattended=True, idempotency_key=None)
        service.queue.resume("a")
        wait_for(lambda: journal.queue_entry(entry.id).state is EntryState.DONE)


def test_regions_drawn_at_once_have_a_file_each(tmp_path: Path) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, _, _, _):
        store, runner = server.service.store, server.service.runner
        session_id = runner.create(Recipe(pilot_lights=3, planned_lights=1))[0].id
        masks = list[bytes]()
        for rows in range(4, 12):
            mask = np.zeros((PIXELS, PIXELS), np.uint8)
            mask[PIXELS // 2 - rows : PIXELS // 2 + rows, 8:-8] = 255
            masks.append(cv2.imencode(".png", mask)[1].tobytes())
        drawing = [threading.Thread(target=runner.set_region, args=(session_id, mask, "a")) for mask in masks]
        for thread in drawing:
            thread.start()
        for thread in drawing:
            thread.join(60)

        drawn = store.journal.artifacts(session_id, "region")
        digests = [hashlib.sha256((store.folder(session_id) / one.path).read_bytes()).hexdigest() for one in drawn]
        assert len({one.path for one in drawn}) == len(masks)
        assert digests == [one.sha256 for one in drawn]


def test_session_deleted_while_it_starts_gets_no_folder_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with quick_service(tmp_path, ADDRESS, with_keys=False) as (server, arm, _, _):
        store, runner = server.service.store, server.service.runner
        session_id = runner.create(Recipe())[0].id
        preflight, folder = arm.preflight, store.session_path(session_id)

        def deleted_meanwhile() -> Sequence[Finding]:
            if folder.exists():
                store.journal.delete_session(session_id)
                shutil.rmtree(folder)
            return preflight()

        monkeypatch.setattr(arm, "preflight", deleted_meanwhile)
        with pytest.raises(RigError) as refused:
            runner.act(session_id, Trigger.START, "a")
        assert refused.value.code is ErrorCode.SESSION_NOT_FOUND
        assert not folder.exists()
