"""The archive as the routes read it: opened on first use, in few threads, so that it delays nothing else.

An archive may be unreachable, and an object store answers late. A request waits for it in one of a few threads of its
kind, further ones are refused beyond a short queue (`turns`), and neither the event loop nor the arm is involved. All
content is checked by its hash before any of it is sent. Entries never change, so those that were read are kept.
"""

import tempfile
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO, TypeVar, TypeVarTuple

from anyio import CapacityLimiter

from acquisition.archive.archive import Archive
from acquisition.archive.catalogue import ResultRow, SessionRow
from acquisition.archive.entries import FileEntry, ResultEntry, SessionEntry, result_name, session_name
from acquisition.archive.where import COLUMNS
from acquisition.models.errors import ErrorCode, RigError
from acquisition.runner.memo import Memo
from api.rest.turns import in_turn

SCRATCH = "lightpose-archive-"
"""Prefix of the names of temporary folders."""
READERS, PAINTERS = 4, 2
"""Numbers of threads that read the archive, and that make pictures of it, at the same time."""
KEPT_ENTRIES, KEPT_PICTURES = 256, 512
"""Numbers of entries (about 20 kB each) and pictures (about 10 kB each) kept in memory."""

Answer = TypeVar("Answer")
Arguments = TypeVarTuple("Arguments")


class ReadArchive:
    """One archive, with a cache of its entries and pictures."""

    def __init__(self, address: str, catalogue: str | None) -> None:
        """Opens nothing yet, so that a service starts although its archive is unreachable."""
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
        """Runs `work`, which reads the archive, in its turn. Raises RigError service.overloaded."""
        return await in_turn(self._readers, work, *arguments)

    async def paint(self, work: Callable[[*Arguments], Answer], *arguments: *Arguments) -> Answer:
        """Runs `work`, which makes a picture, in its turn. Raises RigError service.overloaded."""
        return await in_turn(self._painters, work, *arguments)

    def archive(self) -> Archive:
        """Returns the archive, opened on first use. Raises RigError archive.unreachable, archive.address_invalid, …"""
        with self._opening:
            if self._opened is None:
                self._opened = Archive(self.address, self.catalogue_address)
            return self._opened

    def probe(self) -> None:
        """Checks that files and catalogue answer, and that the archive is still there. Raises RigError as `archive`."""
        archive = self.archive()
        archive.require()
        archive.catalogue.session_keys("", limit=1)

    def row(self, key: str) -> SessionRow:
        """Returns a session's row of the catalogue. Raises RigError archive.not_found."""
        rows = self.archive().catalogue.sessions(COLUMNS["key"] == key)
        if not rows:
            raise RigError(ErrorCode.ARCHIVE_NOT_FOUND, f"{key!r}: there is no session with this key")
        return rows[0]

    def session(self, key: str) -> SessionEntry:
        """Returns a session's entry. Raises RigError archive.not_found, archive.damaged."""
        return self._sessions.of(session_name(key), partial(self.archive().session, key))

    def finished(self, key: str) -> list[ResultRow]:
        """Returns the finished results of a session, newest first."""
        return [row for row in reversed(self.archive().catalogue.results(key)) if row.state == "done"]

    def result(self, key: str, solver: str, settings: str) -> ResultEntry:
        """Returns a result's entry. Raises RigError archive.not_found, archive.damaged."""
        name = result_name(key, solver, settings)
        return self._results.of(name, partial(self.archive().result, name))

    def opened(self, file: FileEntry) -> BinaryIO:
        """Returns a file's checked content as a file without a name, which disappears when it is closed.

        Raises RigError archive.damaged.
        """
        with tempfile.TemporaryDirectory(prefix=SCRATCH) as folder:
            path = Path(folder) / file.sha256
            self.archive().contents.get(file.sha256, path)
            return path.open("rb")

    def content(self, file: FileEntry) -> bytes:
        """Returns the checked content of a file. Raises RigError archive.damaged."""
        with self.opened(file) as content:
            return content.read()
