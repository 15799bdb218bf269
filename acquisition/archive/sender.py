"""The sender: a process that pushes ended sessions to the archive, one after another, until the archive has them.

It is a separate process of low priority, so that hashing and network traffic affect neither the service's event loop
nor the arm's thread. An archive that does not answer for days only makes the outbox longer. The sender begins no
archive: an address without one is mistyped, or its disk is not mounted, and sessions wait. The process ends when its
standard input does, and so with the service. No answer of the service depends on it.
"""

import logging
import math
import os
import sys
import threading
import time
from pathlib import Path

from acquisition.archive.archive import Archive
from acquisition.formats.session_files import JOURNAL
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store.journal import Journal
from acquisition.store.outbox_table import LONGEST_WAIT_S

POLL_S = 2.0
"""Period, s, of checking for sessions that have ended."""
FIRST_WAIT_S = 10.0
"""Time, s, after which a failed push is tried again: doubled each time, up to `LONGEST_WAIT_S`, an hour."""
CHECK_S = 30.0
"""Period, s, of checking that the archive can be used, whether a session waits or not."""
NICENESS = 15

_log = logging.getLogger(__name__)


def wait_s(tries: int) -> float:
    """Returns the time, s, until the next try after `tries` failed ones."""
    return FIRST_WAIT_S * 2.0**tries if tries < math.log2(LONGEST_WAIT_S / FIRST_WAIT_S) else LONGEST_WAIT_S


def check(journal: Journal, address: str, catalogue: str | None) -> None:
    """Records whether the archive can be used, and why not; if it is another than before, all sessions are due."""
    problem = None
    try:
        archive = Archive(address, catalogue)
        archive.close()
        if journal.set_archive_identity(archive.identity or ""):
            _log.warning("another archive than before is at %s: all sessions are pushed to it", address)
    except RigError as error:
        problem = str(error)
    if not journal.set_archive_problem(problem):
        return
    if problem is None:
        _log.info("the archive can be used again")
    else:
        _log.warning("the archive cannot be used, and sessions wait until it can: %s", problem)


def send_next(journal: Journal, data: Path, address: str, catalogue: str | None) -> bool:
    """Pushes the session that has waited longest; returns False if none is due or the archive does not answer."""
    due = journal.due(time.time())
    if due is None:
        return False
    folder = data / "sessions" / due.session.id
    try:
        archive = Archive(address, catalogue)
        try:
            pushed = archive.push(folder, due.session.label, due.session.notes)
        finally:
            archive.close()
    except RigError as error:
        journal.not_archived(due, str(error), time.time() + wait_s(due.tries))
        _log.warning("session %s is not archived yet: %s", due.session.id, error)
        return (
            error.code is ErrorCode.FOLDER_INVALID
        )  # the next session may be sound; an archive that does not answer fails for all
    except OSError as error:  # the session was deleted meanwhile, or its disk fails
        journal.not_archived(due, f"{type(error).__name__}: {error}", time.time() + wait_s(due.tries))
        return False
    except Exception as error:  # noqa: BLE001 - the other sessions must not wait for this one
        journal.not_archived(due, f"{type(error).__name__}: {error}", time.time() + wait_s(due.tries))
        _log.exception("session %s cannot be archived", due.session.id)
        return True  # a sender that is started again would meet the same session first
    journal.archived(due, pushed.key)
    _log.info("session %s is archived: %d of %d files were new", due.session.id, pushed.new_files, pushed.files)
    return True


def main(data: str, address: str, catalogue: str | None) -> None:
    """Sends until standard input ends."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s archive %(message)s")
    os.nice(NICENESS)
    ended = threading.Event()

    def await_end() -> None:
        sys.stdin.buffer.read()
        ended.set()

    threading.Thread(target=await_end, daemon=True).start()
    journal = Journal(Path(data) / JOURNAL)
    wait, next_check = 0.0, 0.0
    while not ended.wait(wait):
        if time.monotonic() >= next_check:
            check(journal, address, catalogue)
            next_check = time.monotonic() + CHECK_S
        wait = 0.0 if send_next(journal, Path(data), address, catalogue) else POLL_S
    journal.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3] if len(sys.argv) > 3 else None)
