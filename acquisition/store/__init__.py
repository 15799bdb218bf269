"""The journal of one data folder: SQLite for what happened, session folders for what was made.

A file is flushed and renamed first, then its row and event are written in one transaction; the event is the
announcement. So whatever was announced is on the disk, and a crash between the two leaves at most a file without an
entry.
"""

import errno
import fcntl
import os
import shutil
import stat
from pathlib import Path

from acquisition.formats.frames import FolderFrames
from acquisition.formats.session_files import JOURNAL
from acquisition.models.calibration import Calibration
from acquisition.models.errors import ErrorCode, RigError
from acquisition.session import SessionRecord
from acquisition.store.calibration_sets import CalibrationSets
from acquisition.store.folder import read_value
from acquisition.store.journal import Journal
from acquisition.store.rows import Action, Artifact, Event, SessionFilter, SessionRow

__all__ = ["Action", "Artifact", "Event", "FolderFrames", "Journal", "SessionFilter", "SessionRow", "Store"]


FOLDER_MODE = 0o700
"""Permissions of a data folder that the service makes: other users cannot see the images of people's objects."""


class Store:
    """One data folder: `rig.lock`, `rig.db`, `sessions/<id>/`, `calibrations/<id>/`, `cache/`; used by one service."""

    def __init__(self, data: Path) -> None:
        """Opens or makes the folder. Raises RigError store.locked when another service has it; store.unwritable,
        store.disk_full, store.corrupt when it cannot be used."""
        self.data = data.resolve()
        try:
            self._lock_file = self._make_folders()
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            code = ErrorCode.STORE_DISK_FULL if full else ErrorCode.STORE_UNWRITABLE
            raise RigError(code, f"The data folder {self.data} cannot be used: {error}") from error
        try:
            fcntl.flock(self._lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(self._lock_file)
            raise RigError(ErrorCode.STORE_LOCKED, f"{self.data} is in use by another service") from error
        try:
            self.journal = Journal(self.data / JOURNAL)
            self._discard_partial()
        except BaseException:
            os.close(self._lock_file)
            raise
        self.calibrations = CalibrationSets(self.data / "calibrations")

    def _make_folders(self) -> int:
        """Makes the folders that are missing; returns the descriptor of the lock's file. Raises OSError."""
        self.data.mkdir(parents=True, exist_ok=True, mode=FOLDER_MODE)
        _keep_others_out(self.data)
        (self.data / "sessions").mkdir(exist_ok=True)
        (self.data / "cache").mkdir(exist_ok=True)
        return os.open(self.data / "rig.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def folder(self, session_id: str) -> Path:
        """Returns the folder of a session that the journal knows."""
        return self.session_path(self.journal.session(session_id).id)

    def session_path(self, session_id: str) -> Path:
        """Returns the path of a session's folder, whether or not it exists and the journal knows the session."""
        return self.data / "sessions" / session_id

    def cache(self, name: str) -> Path:
        """Returns the path of a cached file, which can be computed again."""
        return self.data / "cache" / name

    def calibration_of(self, session_id: str) -> str | None:
        """Returns the SHA-256 of the calibration's values of a session; None if their file is missing.

        Raises RigError session.not_found, store.corrupt.
        """
        folder, name = self.folder(session_id), "calibration.json"
        return read_value(Calibration, folder, name).fingerprint if (folder / name).is_file() else None

    @property
    def free(self) -> int:
        """Free bytes on the data folder's file system."""
        return shutil.disk_usage(self.data).free

    def record(self, session_id: str) -> SessionRecord:
        """Returns a session as `session.next_step` reads it."""
        return self.journal.record(session_id, self.folder(session_id))

    def _discard_partial(self) -> None:
        """Removes the half-written results, exports, estimates, calibrations and session files that a killed service
        has left."""
        sessions = self.data / "sessions"
        results = (f"sessions/*/{name}" for name in ("results/.*", "results/*/exports/.*", "estimates/.*"))
        for pattern in (*results, "calibrations/.*"):
            for folder in self.data.glob(pattern):
                shutil.rmtree(folder, ignore_errors=True)
        holder = self.journal.holder()
        if holder is not None:
            for file in (sessions / holder.id).rglob(".*.part"):
                file.unlink(missing_ok=True)

    def close(self) -> None:
        """Closes the database and frees the folder."""
        self.journal.close()
        os.close(self._lock_file)


def _keep_others_out(folder: Path) -> None:
    """Removes the permissions of others from a folder that this user owns, such as one that was made by hand. A group's
    permissions stay, because a unit or an administrator gives them on purpose."""
    status = folder.stat()
    others = stat.S_IMODE(status.st_mode) & stat.S_IRWXO
    if others and status.st_uid == os.geteuid():
        folder.chmod(stat.S_IMODE(status.st_mode) & ~stat.S_IRWXO)
