"""Journal entries of what stops the cell: a latched fault, a person's stop, and their acknowledgement.

The devices are halted and the latch is closed before anything is written. A journal that cannot be written, because the
disk is full or another program holds it, delays only the entries. The thread that runs sessions writes the session's
new state as soon as the journal can be written again, and then the cause. A recorded latch that nobody has acknowledged
closes again when the next service starts.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol

from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.problem_table import problem
from acquisition.runner.safety_monitor import Latch, SafetyMonitor
from acquisition.session_state import Actor, State, Trigger
from acquisition.store import Store

_log = logging.getLogger(__name__)


class Entries(Protocol):
    """The part of `SessionLoop` that makes entries, and waits while the journal cannot be written."""

    def trigger(
        self, session_id: str, trigger: Trigger, actor: str = ..., reason: dict[str, object] | None = ...
    ) -> bool:
        """Fires a trigger of a session."""
        ...

    def until_written(self, entry: Callable[[], object]) -> None:
        """Makes any other entry."""
        ...


class StopRecord:
    """Writes stops of the cell; `add`, `fault` and `acknowledge` from any thread, the others from the runner's."""

    def __init__(self, store: Store, monitor: SafetyMonitor, entries: Entries) -> None:
        self._store, self._monitor, self._entries = store, monitor, entries
        self._recording = threading.Lock()  # a halt never takes it
        self._outstanding: deque[tuple[str, Latch]] = deque()

    def fault(self, latch: Latch) -> bool:
        """Records and announces a fault at once; returns False if the journal cannot be written."""
        return _tried(lambda: self._store.journal.record_fault(latch.code, latch.detail))

    def interrupt(self, latch: Latch, recorded: bool) -> None:
        """Interrupts the session that holds the rig, then records the fault unless `fault` has done so (`recorded`)."""
        holder = self._store.journal.holder()
        if holder is not None and holder.state is not State.INTERRUPTED:
            self._entries.trigger(holder.id, Trigger.INTERRUPT, Actor.SERVICE, problem(latch.code, latch.detail))
        if not recorded:
            self._entries.until_written(lambda: self._record(latch))

    def add(self, actor: str, latch: Latch) -> None:
        """Notes for `record_outstanding` that `actor` has stopped the cell; uses neither a lock nor the journal."""
        self._outstanding.append((actor, latch))

    def record_outstanding(self) -> None:
        """Records the noted stops, and stops the session that holds the rig."""
        while self._outstanding:
            self._halt(*self._outstanding[0])
            self._outstanding.popleft()

    def _halt(self, actor: str, latch: Latch) -> None:
        holder = self._store.journal.holder()

        def record() -> None:
            self._store.journal.record_action(None if holder is None else holder.id, "halt", actor, "halted")
            if latch.code is ErrorCode.SAFETY_SOFTWARE_STOP:
                self._record(latch)

        recorded = _tried(record)
        if holder is not None:
            self.stop_session(holder.id, actor)
        if not recorded:
            self._entries.until_written(record)

    def stop_session(self, session_id: str, actor: str) -> None:
        """Records that `actor` has stopped a session, whose devices have been halted."""
        self._entries.trigger(session_id, Trigger.STOP, actor)
        self._entries.trigger(session_id, Trigger.AT_REST)

    def acknowledge(self, actor: str) -> None:
        """Records who acknowledges, then opens the latch. A refused acknowledgement changes nothing, and what stops
        the cell after this call stays latched.

        Raises RigError safety.still_faulted, store.disk_full, store.unwritable.
        """
        stops = self._monitor.stops  # before waiting for the lock and the journal
        with self._recording:
            try:
                self._monitor.acknowledge(actor, stops, lambda: self._store.journal.acknowledge(actor))
            finally:
                if (latch := self._monitor.latch) is not None:
                    self._record_closed(latch)

    def _record(self, latch: Latch) -> None:
        with self._recording:
            self._record_closed(latch)

    def _record_closed(self, latch: Latch) -> None:
        """Records a latch if it is still closed. One acknowledged meanwhile would close again with the next service."""
        if self._monitor.latch is latch and not self._store.journal.unacknowledged_faults():
            self._store.journal.record_fault(latch.code, latch.detail)


def _tried(entry: Callable[[], None]) -> bool:
    """Tries an entry; returns whether it was written. The disk may be full, or another program hold the journal."""
    try:
        entry()
    except RigError:
        _log.exception("the cell is halted and the latch closed, but an entry could not be written")
        return False
    return True
