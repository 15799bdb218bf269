"""The archive as the routes read it: opened when it is first asked for, in few threads, so that it holds nobody up.

An archive may be away, and an object store answers late: a request waits for it in a thread of its kind's few, what
comes beyond a short queue is refused (`turns`), and nothing of it concerns the event loop or the arm. Content is
checked by its hash before any of it is sent. Entries of results never change, so those that were read are kept.
"""

import tempfile
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO, TypeVar, TypeVarTuple

from anyio import CapacityLimiter

from acquisition.archive.archive import MARK, Archive
from acquisition.archive.catalogue import ResultRow, SessionRow
from acquisition.archive.entries import FileEntry, ResultEntry, SessionEntry, result_name, session_name
from acquisition.archive.where import COLUMNS
from acquisition.models.errors import ErrorCode, RigError
from acquisition.runner.memo import Memo
from api.rest.turns import in_turn

SCRATCH = "lightpose-archive-"
"""Beginning of the names of folders in the system's own for temporary ones."""
READERS, PAINTERS = 4, 2
"""Threads that read the archive, and that make pictures of it, at once."""
KEPT_ENTRIES, KEPT_PICTURES = 256, 512
"""Entries (some 20 kB each) and pictures (some 10 kB each) kept in memory."""

Answer = TypeVar("Answer")
Arguments = TypeVarTuple("Arguments")


class ReadArchive:
    """One archive, and what is kept of it."""

    def __init__(self, address: str, catalogue: str | None) -> None:
        """Opens nothing yet, so that a service starts although its archive is away."""
        self.address, self.catalogue_address = address, catalogue
        self.exporting = CapacityLimiter(1)
        self._readers, self._painters = CapacityLimiter(READERS), CapacityLimiter(PAINTERS)
        self.pictures = Memo[bytes](KEPT_PICTURES)
        self._sessions, self._results = Memo[SessionEntry](KEPT_ENTRIES), Memo[ResultEntry](KEPT_ENTRIES)
        self._opening = threading.Lock()
        self._opened: Archive | None = None

    def close(self) -> None:
        """Closes the connections."""
        if self._opened is not None:
            self._opened.close()

    async def read(self, work: Callable[[*Arguments], Answer], *arguments: *Arguments) -> Answer:
        """Runs work that reads the archive in its turn. Raises RigError service.overloaded."""
        return await in_turn(self._readers, work, *arguments)

    async def paint(self, work: Callable[[*Arguments], Answer], *arguments: *Arguments) -> Answer:
        """Runs work that makes a picture in its turn. Raises RigError service.overloaded."""
        return await in_turn(self._painters, work, *arguments)

    def archive(self) -> Archive:
        """The archive, opened now unless it is. Raises RigError archive.unreachable, archive.address_invalid, …"""
        with self._opening:
            if self._opened is None:
                self._opened = Archive(self.address, self.catalogue_address)
            return self._opened

    def probe(self) -> None:
        """Asks files and catalogue for something. Raises RigError as `archive`, archive.unreachable."""
        archive = self.archive()
        archive.contents.size(MARK)
        archive.catalogue.session_keys("", limit=1)

    def row(self, key: str) -> SessionRow:
        """A session as the catalogue has it. Raises RigError archive.not_found."""
        rows = self.archive().catalogue.sessions(COLUMNS["key"] == key)
        if not rows:
            raise RigError(ErrorCode.ARCHIVE_NOT_FOUND, f"{key!r}: there is no session of this key")
        return rows[0]

    def session(self, key: str) -> SessionEntry:
        """A session's entry. Raises RigError archive.not_found, archive.damaged."""
        return self._sessions.of(session_name(key), partial(self.archive().session, key))

    def finished(self, key: str) -> list[ResultRow]:
        """The results of a session that are there, the newest first."""
        return [row for row in reversed(self.archive().catalogue.results(key)) if row.state == "done"]

    def result(self, key: str, solver: str, settings: str) -> ResultEntry:
        """A result's entry. Raises RigError archive.not_found, archive.damaged."""
        name = result_name(key, solver, settings)
        return self._results.of(name, partial(self.archive().result, name))

    def opened(self, file: FileEntry) -> BinaryIO:
        """A file's content, checked, as a file without a name: it is gone when it is closed, whoever does that.

        Raises RigError archive.damaged.
        """
        with tempfile.TemporaryDirectory(prefix=SCRATCH) as folder:
            path = Path(folder) / file.sha256
            self.archive().contents.get(file.sha256, path)
            return path.open("rb")

    def content(self, file: FileEntry) -> bytes:
        """The content of a file, checked. Raises RigError archive.damaged."""
        with self.opened(file) as content:
            return content.read()
