"""The outbox: completed sessions are pushed by themselves, again when something was added; nothing goes before that."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.archive import sender
from acquisition.archive.archive import Archive, Pushed
from acquisition.archive.contents import ContentStore
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.recipe import Recipe
from acquisition.session_state import State
from acquisition.store import retention
from acquisition.store.journal import Journal
from api.cli import pruning
from tests.acquisition.archive import session_copies

CELL = (session_copies.ORIGINAL / "cell.json").read_text()


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    """The journal of a data folder whose archive is the folder `archive` beside it."""
    Archive.create(str(tmp_path / "archive")).close()
    (tmp_path / "data").mkdir()
    opened = Journal(tmp_path / "data" / "rig.db")
    opened.set_archive(str(tmp_path / "archive"))
    yield opened
    opened.close()


def completed(tmp_path: Path, journal: Journal, label: str = "vase", state: State = State.COMPLETED) -> str:
    """A session that has ended, with its folder."""
    row, _ = journal.create_session(Recipe(label=label), CELL, "fingerprint")
    with journal._transaction() as connection:
        connection.execute(
            "UPDATE session SET state = ?, started_at = ?, ended_at = ? WHERE id = ?",
            (state, 1.0, 1.0 + row.number, row.id),
        )
        journal._event(connection, row.id, "session.completed", {})
    session_copies.make(tmp_path / "data" / "sessions" / row.id, seed=row.number, label=label)
    return row.id


def send_all(tmp_path: Path, journal: Journal) -> int:
    count = 0
    while sender.send_next(journal, tmp_path / "data", str(tmp_path / "archive"), None):
        count += 1
    return count


def pruned(tmp_path: Path, *, dry_run: bool = False, **more: Any) -> retention.Pruning:
    """Removes all ended sessions that the archive has."""
    options: dict[str, Any] = {"lacking": pruning.asking()} | more
    return retention.prune(tmp_path / "data", older_than_days=0, keep=0, now=time.time(), dry_run=dry_run, **options)


@contextmanager
def unmounted(archive: Path) -> Generator[None]:
    """Takes the archive's disk away, which leaves an empty mount point."""
    archive.rename(archive.with_name("disk"))
    archive.mkdir()
    yield
    shutil.rmtree(archive)
    archive.with_name("disk").rename(archive)


def archive_rows(tmp_path: Path) -> list[tuple[str, str]]:
    archive = Archive(str(tmp_path / "archive"))
    rows = [(row.session_id, row.object) for row in archive.catalogue.sessions()]
    archive.close()
    return rows


def test_completed_session_is_pushed_once(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    completed(tmp_path, journal, state=State.STOPPED)
    assert journal.outbox_status().waiting == 1
    assert (send_all(tmp_path, journal), send_all(tmp_path, journal)) == (1, 0)
    assert archive_rows(tmp_path) == [(session_id, "vase")]
    status = journal.outbox_status()
    assert (status.archived, status.waiting, status.reason) == (1, 0, None)


def test_session_with_a_new_label_is_pushed_again(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    send_all(tmp_path, journal)
    journal.describe_session(session_id, "amphora", None, "a person")
    assert send_all(tmp_path, journal) == 1
    assert archive_rows(tmp_path) == [(session_id, "amphora")]


def test_archive_that_is_away_leaves_the_session_waiting(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    shutil.rmtree(tmp_path / "archive")
    (tmp_path / "archive").write_text("a file: no folder can be made here")
    assert send_all(tmp_path, journal) == 0
    status = journal.outbox_status()
    assert (status.archived, status.waiting) == (0, 1)
    assert status.reason is not None
    due = journal.due(time.time() + 3600)
    assert due is not None
    assert (due.session.id, due.tries) == (session_id, 1)
    assert journal.due(time.time()) is None  # not before its time


def test_damaged_session_does_not_hold_up_the_next(tmp_path: Path, journal: Journal):
    damaged, sound = completed(tmp_path, journal, "damaged"), completed(tmp_path, journal, "sound")
    (tmp_path / "data" / "sessions" / damaged / "passes/0/shots/1.tiff").write_bytes(b"")
    send_all(tmp_path, journal)
    assert archive_rows(tmp_path) == [(sound, "sound")]
    assert "shots/1.tiff" in str(journal.outbox_status().reason)


def test_unexpected_error_does_not_hold_up_the_next(tmp_path: Path, journal: Journal, monkeypatch: pytest.MonkeyPatch):
    odd, sound = completed(tmp_path, journal, "odd"), completed(tmp_path, journal, "sound")
    push = Archive.push

    def failing(archive: Archive, folder: Path, label: str | None = None, notes: str | None = None) -> Pushed:
        if folder.name == odd:
            raise ZeroDivisionError("a fault of the program")
        return push(archive, folder, label, notes)

    monkeypatch.setattr(Archive, "push", failing)
    send_all(tmp_path, journal)
    assert archive_rows(tmp_path) == [(sound, "sound")]
    assert journal.outbox_status().reason == "ZeroDivisionError: a fault of the program"


def test_waits_grow_to_an_hour():
    waits = [sender.wait_s(tries) for tries in (*range(20), 10_000)]  # an archive may be away for a year
    assert waits == sorted(waits)
    assert (waits[0], waits[-1]) == (sender.FIRST_WAIT_S, sender.LONGEST_WAIT_S)


def test_session_is_tried_again_after_the_clock_was_set_back(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    now, due = time.time(), journal.due(time.time())
    assert due is not None
    journal.not_archived(due, "the archive is away", now + sender.LONGEST_WAIT_S)
    assert journal.due(now) is None
    a_year_before = journal.due(now - 365 * 86_400)
    assert a_year_before is not None
    assert a_year_before.session.id == session_id


def test_prune_keeps_what_the_archive_does_not_have(tmp_path: Path, journal: Journal):
    first, second = completed(tmp_path, journal, "first"), completed(tmp_path, journal, "second")

    def prune() -> list[str]:
        return [item.session_id for item in pruned(tmp_path).removed]

    assert pruned(tmp_path).waiting == 2
    assert prune() == []
    assert sender.send_next(journal, tmp_path / "data", str(tmp_path / "archive"), None)
    assert prune() == [first]
    send_all(tmp_path, journal)
    journal.describe_session(second, "renamed", None, "a person")
    assert prune() == []
    send_all(tmp_path, journal)
    assert prune() == [second]
    assert sorted(label for _, label in archive_rows(tmp_path)) == ["first", "renamed"]


def test_another_archive_gets_all_sessions(tmp_path: Path, journal: Journal):
    completed(tmp_path, journal)
    send_all(tmp_path, journal)
    assert journal.set_archive_problem("the disk is away")
    journal.set_archive(str(tmp_path / "archive"))
    assert journal.outbox_status().waiting == 0
    journal.set_archive(str(tmp_path / "other"))
    assert journal.outbox_status().waiting == 1
    assert journal.outbox_status().problem is None


@pytest.mark.parametrize("looked", ["old", "new"])
def test_another_archive_at_the_same_address_gets_all_sessions(tmp_path: Path, journal: Journal, looked: str):
    """As where a broken disk was replaced: the journal said that the archive had them."""
    archive = tmp_path / "archive"
    if looked == "old":  # an archive that was made before there were identities
        (archive / "archive.json").write_text('{"format":1}')
        (archive / "catalogue.db").unlink()
    session_id = completed(tmp_path, journal)
    sender.check(journal, str(archive), None)
    send_all(tmp_path, journal)
    sender.check(journal, str(archive), None)
    with unmounted(archive):
        sender.check(journal, str(archive), None)
    sender.check(journal, str(archive), None)
    assert (journal.outbox_status().archived, journal.outbox_status().waiting) == (1, 0)
    shutil.rmtree(archive)
    Archive.create(str(archive)).close()
    sender.check(journal, str(archive), None)
    assert (journal.outbox_status().archived, journal.outbox_status().waiting) == (0, 1)
    assert send_all(tmp_path, journal) == 1
    assert archive_rows(tmp_path) == [(session_id, "vase")]


def test_sender_writes_nothing_into_a_mount_point(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    with unmounted(tmp_path / "archive"):
        sender.check(journal, str(tmp_path / "archive"), None)
        assert send_all(tmp_path, journal) == 0
        assert not list((tmp_path / "archive").iterdir())
        status = journal.outbox_status()
        assert (status.archived, status.waiting) == (0, 1)
        assert "holds no archive" in str(status.problem)
        assert status.problem_at is not None
        assert pruned(tmp_path).removed == []
    assert send_all(tmp_path, journal) == 0  # not due yet
    sender.check(journal, str(tmp_path / "archive"), None)
    status = journal.outbox_status()
    assert (status.problem, status.problem_at) == (None, None)
    assert send_all(tmp_path, journal) == 1
    assert archive_rows(tmp_path) == [(session_id, "vase")]


def test_sender_begins_no_archive_at_a_mistyped_folder(tmp_path: Path, journal: Journal):
    completed(tmp_path, journal)
    assert not sender.send_next(journal, tmp_path / "data", str(tmp_path / "archvie"), None)
    assert "there is no such folder" in str(journal.outbox_status().reason)
    assert not (tmp_path / "archvie").exists()


def test_disk_that_goes_away_during_a_push_leaves_it_waiting(
    tmp_path: Path, journal: Journal, monkeypatch: pytest.MonkeyPatch
):
    completed(tmp_path, journal)
    put = ContentStore.put

    def going(store: ContentStore, file: Path, digest: str) -> bool:
        if not (tmp_path / "disk").exists():
            (tmp_path / "archive").rename(tmp_path / "disk")
        return put(store, file, digest)

    monkeypatch.setattr(ContentStore, "put", going)
    assert send_all(tmp_path, journal) == 0
    assert journal.outbox_status().waiting == 1


def test_prune_keeps_all_archived_while_the_archive_is_away(tmp_path: Path, journal: Journal):
    one, two = completed(tmp_path, journal), completed(tmp_path, journal)
    stopped = completed(tmp_path, journal, state=State.STOPPED)
    send_all(tmp_path, journal)
    with unmounted(tmp_path / "archive"):
        found = pruned(tmp_path)
    assert sorted(found.unconfirmed) == sorted([one, two])
    assert found.archive_problem is not None
    assert found.archive_problem.code is ErrorCode.ARCHIVE_ADDRESS_INVALID
    assert [item.session_id for item in found.removed] == [stopped]  # it was never to be archived
    assert len(pruned(tmp_path).removed) == 2


@pytest.mark.parametrize("loss", ["all", "entry", "result", "file", "truncated"])
def test_prune_keeps_what_the_archive_has_lost_and_sends_it_again(tmp_path: Path, journal: Journal, loss: str):
    session_id = completed(tmp_path, journal)
    send_all(tmp_path, journal)
    archive = tmp_path / "archive"
    file = max(
        (path for path in (archive / "objects").rglob("*") if path.is_file()), key=lambda path: path.stat().st_size
    )
    match loss:
        case "all":
            shutil.rmtree(archive)
            Archive.create(str(archive)).close()
        case "entry":
            next(archive.rglob("session.json")).unlink()
        case "result":  # nothing else in the archive says that it was there
            next(archive.rglob("results/*.json")).unlink()
        case "file":
            file.unlink()
        case _:
            file.write_bytes(b"rot")
    assert list(pruned(tmp_path, dry_run=True).kept) == [session_id]
    assert journal.outbox_status().waiting == 0
    assert list(pruned(tmp_path).kept) == [session_id]
    assert journal.outbox_status().waiting == 1
    assert send_all(tmp_path, journal) == 1
    assert [item.session_id for item in pruned(tmp_path).removed] == [session_id]
    assert archive_rows(tmp_path) == [(session_id, "vase")]


def test_prune_keeps_a_session_of_which_a_manifest_cannot_be_read(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    send_all(tmp_path, journal)
    next((tmp_path / "data" / "sessions" / session_id).glob("results/*/manifest.json")).write_text("{")
    ((kept, why),) = pruned(tmp_path).kept.items()
    assert (kept, "manifest.json" in why) == (session_id, True)
    send_all(tmp_path, journal)
    assert "manifest.json" in str(journal.outbox_status().reason)


def test_prune_keeps_what_is_added_while_the_archive_is_asked(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    send_all(tmp_path, journal)

    def lacking(address: str, key: str, folder: Path) -> None:
        journal.describe_session(session_id, "renamed", None, "a person")

    assert pruned(tmp_path, lacking=lacking).removed == []
    assert (tmp_path / "data" / "sessions" / session_id).is_dir()


@pytest.mark.long
def test_sender_process_pushes_and_ends_with_its_input(tmp_path: Path, journal: Journal):
    session_id = completed(tmp_path, journal)
    command = [sys.executable, "-m", "acquisition.archive.sender", str(tmp_path / "data"), str(tmp_path / "archive")]
    process = subprocess.Popen(command, stdin=subprocess.PIPE)
    try:
        deadline = time.monotonic() + 120
        while journal.outbox_status().waiting and time.monotonic() < deadline:
            time.sleep(0.1)
    finally:
        process.communicate(timeout=120)
    assert process.returncode == 0
    assert archive_rows(tmp_path) == [(session_id, "vase")]
    types = [event.type for event in journal.events(0, session_id=session_id)]
    assert types[-1] == "session.archived"


class DyingStore:
    """Makes the content store fail at a random one of its next writes, before or after it has written."""

    def __init__(self, patch: pytest.MonkeyPatch, seed: int) -> None:
        self._choose, self._left, self._before = np.random.default_rng(seed), 0, False
        self.deaths = 0
        for name in ("put", "write"):
            patch.setattr(ContentStore, name, self._dying(getattr(ContentStore, name)))

    def draw(self) -> None:
        self._left, self._before = int(self._choose.integers(1, 60)), bool(self._choose.integers(2))

    def _dying(self, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            self._left -= 1
            if self._left == 0 and self._before:
                self._die()
            result = method(*arguments)
            if self._left == 0:
                self._die()
            return result

        return call

    def _die(self) -> None:
        self.deaths += 1
        raise RigError(ErrorCode.ARCHIVE_UNREACHABLE, "the store died")


@pytest.mark.long
def test_store_that_dies_200_times_loses_nothing(tmp_path: Path, journal: Journal, monkeypatch: pytest.MonkeyPatch):
    """What an entry names is there after each death, and nothing local may be removed before the archive has it."""
    store, sessions = DyingStore(monkeypatch, seed=1), list[str]()
    monkeypatch.setattr(sender, "wait_s", lambda tries: 0.0)
    archive = None
    while store.deaths < 200:
        if journal.outbox_status().waiting == 0:
            sessions.append(completed(tmp_path, journal, f"object {len(sessions)}"))
        store.draw()
        sender.send_next(journal, tmp_path / "data", str(tmp_path / "archive"), None)
        waiting = journal.outbox_status().waiting
        removable = pruned(tmp_path, dry_run=True).removed
        assert (sessions[-1] in [item.session_id for item in removable]) == (waiting == 0)
        if (tmp_path / "archive" / "archive.json").is_file():
            archive = archive or Archive(str(tmp_path / "archive"))
            assert archive.verify() == []
    assert archive is not None
    monkeypatch.undo()
    while sender.send_next(journal, tmp_path / "data", str(tmp_path / "archive"), None):
        pass
    print(f"\n{store.deaths} deaths over {len(sessions)} sessions")
    assert journal.outbox_status().waiting == 0
    assert archive.verify() == []
    assert sorted(row.session_id for row in archive.catalogue.sessions()) == sorted(sessions)
    archive.close()
