"""The work of `lightpose prune`, which asks the archive before it removes what the archive should have."""

import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from acquisition.archive import answering
from acquisition.models.errors import ErrorCode, RigError
from acquisition.store import retention


def prune(data: Path, older_than_days: float, keep: int, *, dry_run: bool) -> bool:
    """Removes old sessions and prints them; returns False if sessions stay because the archive lacks them."""
    pruned = retention.prune(
        data, older_than_days=older_than_days, keep=keep, now=time.time(), dry_run=dry_run, lacking=_asking()
    )
    for item in pruned.removed:
        since = f"{datetime.fromtimestamp(item.last_used_at, UTC):%Y-%m-%d}"
        what = "ended" if item.started else "never started, since"
        print(f"{item.session_id}\t{what} {since}\t{item.bytes / 1e6:.1f} MB")
    megabytes = sum(item.bytes for item in pruned.removed) / 1e6
    print(f"{'would remove' if dry_run else 'removed'} {len(pruned.removed)} sessions, {megabytes:.1f} MB")
    if pruned.waiting:
        _say(f"kept {pruned.waiting} sessions that the archive does not have yet: `GET /v1/archive` says why")
    for session_id, lacked in pruned.kept.items():
        _say(f"kept {session_id}: the archive does not have all of it, so it is pushed again: {lacked}")
    if pruned.archive_problem is not None:
        _say(f"kept {len(pruned.unconfirmed)} archived sessions: the archive cannot confirm that it has them")
        _say(f"{pruned.archive_problem}")
    return not pruned.kept and not pruned.unconfirmed


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr)


def _asking() -> Callable[[str, str], str | None]:
    """Returns the question what an archive lacks of a session; each archive is opened when it is asked first."""

    @cache
    def question(address: str) -> Callable[[str], str | None]:
        answering.require_store(address)
        try:
            from acquisition.archive.archive import ArchiveFiles  # noqa: PLC0415 - needs the extra `archive`
        except ModuleNotFoundError as error:
            raise RigError(
                ErrorCode.CONFIG_INVALID, f"{error.name} is not installed: pip install 'lightpose[archive]'"
            ) from error
        return ArchiveFiles(address).lacking

    return lambda address, key: question(address)(key)
