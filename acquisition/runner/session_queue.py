"""The queue: sessions that run one after another, each as a person would start it, and never without a person's word.

A thread follows the journal. When an entry's session has completed, it begins the next one through the runner, with all
the checks of a start. The queue stops at the first trouble and states which. It also stops before an entry of another
object than the one before, unless the entry is marked `unattended`: somebody will reach into the cell to change the
object, and nothing may move until that person says that it is in place. After a restart of the service the queue is
stopped in any case (decision 50).
"""

import logging
import threading
from contextlib import suppress
from typing import Any

from acquisition import session_state
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import problem
from acquisition.models.recipe import Recipe
from acquisition.runner.runner import Runner
from acquisition.session_state import Actor, State, Trigger
from acquisition.store import SessionRow, Store
from acquisition.store.queue_table import EntryState, QueueEntry, QueueState

_log = logging.getLogger(__name__)

ENDED_SHOWN = 20
"""Number of ended entries that are still listed."""

_POLL_S = 0.5
"""Period, s, of checking the queue when the journal is quiet."""


class SessionQueue:
    """Runs the queue of one store; every public method may be called from any thread."""

    def __init__(self, store: Store, runner: Runner) -> None:
        self._store, self._runner = store, runner
        self._lock = threading.RLock()  # one decision at a time; a stop of the arm never takes it
        self._closing = threading.Event()
        self._confirmed: int | None = None  # the entry whose object a person has said to be in place
        self._halts = 0  # the runner's count of halts when a person resumed
        self._resumed_by = ""
        self._last_object: str | None = None  # of the session that this queue completed last
        self._thread = threading.Thread(target=self._follow, name="queue", daemon=True)

    def open(self) -> None:
        """Stops a queue that the last service left running, then begins to follow the journal."""
        if self._store.journal.queue_status().state is QueueState.RUNNING:
            reason = problem(ErrorCode.SERVICE_RESTARTED, "The service was restarted while the queue was running")
            self._store.journal.set_queue_status(QueueState.STOPPED, Actor.SERVICE, reason)
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; no further session begins."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(10)

    # --------------------------------------------------------------------------------------------------------- requests

    def entries(self) -> list[QueueEntry]:
        """Returns the entries: the last ones that have ended, the running one, and the waiting ones."""
        return self._store.journal.queue_entries(ENDED_SHOWN)

    def resume(self, actor: str, entry_id: int | None = None) -> None:
        """Lets the queue go on, on a person's word that the next entry's object is in place and the cell is clear.

        `entry_id` is the entry that the person means, if known. Raises RigError queue.object_to_place when the next
        entry is another one, rig.busy while the present entry's own session waits for a person, request.invalid when
        the queue is empty, and safety.not_acknowledged.
        """
        with self._lock:
            self._settle()
            entry = self._present()
            if entry is None:
                raise RigError(ErrorCode.REQUEST_INVALID, "The queue is empty: add an entry first")
            if entry_id is not None and entry_id != entry.id:
                raise _to_place(entry)
            row = self._session(entry)
            trouble = None if row is None else _trouble(row)
            if row is not None and row.state in session_state.RIG_HOLDING and trouble is not None:
                raise RigError(
                    ErrorCode.RIG_BUSY,
                    f"Session {row.id} ({entry.object_name}) is {row.state}: resume or stop it first",
                    holder=row.id,
                )
            self._runner.require_clear()
            self._confirmed, self._halts, self._resumed_by = entry.id, self._runner.halts, actor
            self._store.journal.set_queue_status(QueueState.RUNNING, actor)

    def pause(self, actor: str) -> None:
        """Begins no further session; the present one goes on."""
        with self._lock:
            if self._store.journal.queue_status().state is QueueState.RUNNING:
                self._store.journal.set_queue_status(QueueState.STOPPED, actor)

    # ----------------------------------------------------------------------------------------------------- the thread

    def _follow(self) -> None:
        while not self._closing.is_set():
            try:
                newest = self._store.journal.last_event_id()
                with self._lock:
                    self._advance()
                self._store.journal.wait_for_event(newest, _POLL_S)
            except RigError:  # the disk is full, say: nothing begins before its entry is written
                _log.exception("the queue cannot go on yet")
                self._closing.wait(_POLL_S)
            except Exception:  # noqa: BLE001 - the thread must live on, and say that it has failed
                _log.exception("the queue has failed")
                with suppress(RigError):  # a full disk: it fails, and stops, again
                    self._stop(problem(ErrorCode.SERVICE_FAULT, "The queue has failed: see the service's log"))
                self._closing.wait(_POLL_S)

    def _advance(self) -> None:
        """Records the outcome of the present entry, and begins the next one if that is allowed."""
        self._settle()
        journal = self._store.journal
        if journal.queue_status().state is not QueueState.RUNNING:
            return
        if self._runner.halts != self._halts:
            self._stop(problem(ErrorCode.QUEUE_HALTED, "Somebody has halted the cell"))
            return
        entry = self._present()
        if entry is None:
            journal.set_queue_status(QueueState.STOPPED, Actor.SERVICE)
            return
        row = self._session(entry)
        if row is not None and row.state is not State.CREATED:
            trouble = _trouble(row)
            if trouble is not None:
                self._stop(trouble)
            return
        if not (entry.unattended or self._confirmed == entry.id or entry.object_name == self._last_object):
            error = _to_place(entry)
            self._stop(problem(error.code, error.detail, **error.context))
            return
        try:
            self._begin(entry, row)
        except RigError as error:
            self._stop(problem(error.code, error.detail, **error.context))

    def _begin(self, entry: QueueEntry, row: SessionRow | None) -> None:
        """Creates and starts the entry's session. It is written before the start, so that a crash repeats nothing."""
        if row is None:
            row, _ = self._runner.create(_labelled(entry), f"lightpose-queue-{entry.id}")
        self._store.journal.set_queue_entry(entry, EntryState.RUNNING, row.id)
        actor = f"queue for {self._resumed_by}"
        try:
            self._runner.act(row.id, Trigger.START, actor, unless_halted_since=self._halts)
        except RigError:
            self._store.journal.set_queue_entry(entry, EntryState.WAITING, row.id)
            raise
        self._confirmed = None

    def _settle(self) -> None:
        """Records the end of the present entry's session; a session that failed stops the queue."""
        entry = self._present()
        if entry is None or (entry.session_id is None and entry.state is EntryState.WAITING):
            return
        row = self._session(entry)
        journal = self._store.journal
        if row is None or row.state in (State.STOPPED, State.FAILED):
            journal.set_queue_entry(entry, EntryState.FAILED, entry.session_id)
            self._last_object = None
            if journal.queue_status().state is QueueState.RUNNING:
                self._stop(self._why_ended(entry, row))
        elif row.state is State.COMPLETED:
            journal.set_queue_entry(entry, EntryState.DONE, entry.session_id)
            self._last_object = entry.object_name

    def _why_ended(self, entry: QueueEntry, row: SessionRow | None) -> dict[str, Any]:
        if row is not None and row.reason is not None:
            return row.reason
        what = "was deleted" if row is None else f"is {row.state}"
        detail = f"Session {entry.session_id} ({entry.object_name}) {what}"
        return problem(ErrorCode.QUEUE_SESSION_ENDED, detail, entry=entry.id, session_id=entry.session_id)

    def _stop(self, reason: dict[str, Any]) -> None:
        _log.warning("the queue stops: %s", reason["detail"])
        self._last_object = None  # a person comes, who then has to say what stands in the cell
        self._store.journal.set_queue_status(QueueState.STOPPED, Actor.SERVICE, reason)

    def _present(self) -> QueueEntry | None:
        """Returns the entry that runs, else the first that waits."""
        live = [entry for entry in self.entries() if entry.state in (EntryState.RUNNING, EntryState.WAITING)]
        running = [entry for entry in live if entry.state is EntryState.RUNNING]
        return next(iter([*running, *live]), None)

    def _session(self, entry: QueueEntry) -> SessionRow | None:
        if entry.session_id is None:
            return None
        try:
            return self._store.journal.session(entry.session_id)
        except RigError as error:
            if error.code is not ErrorCode.SESSION_NOT_FOUND:
                raise
            return None


def _to_place(entry: QueueEntry) -> RigError:
    return RigError(
        ErrorCode.QUEUE_OBJECT_TO_PLACE,
        f"The next object is {entry.object_name!r} (entry {entry.id})",
        entry=entry.id,
        object_name=entry.object_name,
    )


def _labelled(entry: QueueEntry) -> Recipe:
    """Returns the entry's recipe, with the object's name as label unless it has one."""
    return entry.recipe if entry.recipe.label else entry.recipe.model_copy(update={"label": entry.object_name[:200]})


def _trouble(row: SessionRow) -> dict[str, Any] | None:
    """Returns why a session cannot go on without a person, None while it can; the review of a plan is no trouble."""
    if row.state is State.INTERRUPTED or (row.state is State.PAUSED and row.reason is not None):
        reason = row.reason or problem(ErrorCode.QUEUE_SESSION_ENDED, f"Session {row.id} is {row.state}")
        return None if reason["code"] == ErrorCode.PLAN_TO_REVIEW else reason
    return None
