"""An archive: push a session's folder to it, fetch it back, and check every file.

An archive is begun only by a person, who creates it. Everything else refuses an address without one: a mistyped folder,
or the empty mount point of a network disk that is away, would take files that nobody finds again.

The order of writing makes a push safe to interrupt at any point: files first, each read back and hashed, then the entry
that names them, then the catalogue's row. An archive never names a file that it does not have, and a repeated push
writes only what is missing.
"""

import itertools
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

import sqlalchemy
from pydantic import ValidationError

from acquisition.archive import catalogue as catalogues
from acquisition.archive.catalogue import Catalogue
from acquisition.archive.contents import ContentStore
from acquisition.archive.entries import SESSIONS, FileEntry, ResultEntry, SessionEntry, result_name, session_name
from acquisition.formats.session_files import refuse_in_session
from acquisition.models.base import Value
from acquisition.models.errors import ErrorCode, RigError

MARK = "archive.json"
EntryT = TypeVar("EntryT", bound=Value)


class _Mark(Value):
    """Content of `archive.json`, which marks an archive and states its format and identity.

    The identity is random, so that another archive at the same address, or the catalogue of another, is known as such.
    A copy has that of its original. None: the archive was made before there were identities.
    """

    format: int = 1
    identity: str | None = None


@dataclass(frozen=True)
class Pushed:
    """What a push did: the session's key, whether it was new, and numbers and size of its files."""

    key: str
    new: bool
    files: int
    new_files: int
    bytes: int


@dataclass(frozen=True)
class Fault:
    """One file that is missing or damaged, and the sessions or results that need it."""

    file: str
    what: str
    needed_by: tuple[str, ...]


class ArchiveFiles:
    """The files of one archive, to be read without its catalogue."""

    def __init__(self, address: str) -> None:
        """Opens the files of an archive. Raises RigError archive.address_invalid if there is none, and as `Archive`."""
        self.address = address
        self.contents = ContentStore(address)
        self.identity = self.require()

    def require(self) -> str | None:
        """Returns the identity that the archive states.

        Raises RigError archive.address_invalid unless the archive is there, archive.unreachable, …
        """
        mark = self.contents.read_first(MARK)
        if mark is None:
            raise RigError(ErrorCode.ARCHIVE_ADDRESS_INVALID, _no_archive(self.contents))
        return _read_mark(self.address, mark).identity

    @staticmethod
    def absent(address: str) -> bool:
        """Returns whether an address holds no archive. Raises RigError archive.address_invalid, archive.unreachable."""
        return ContentStore(address).read_first(MARK) is None

    def session(self, key: str) -> SessionEntry:
        """Returns the entry of a session. Raises RigError archive.not_found, archive.damaged."""
        return self._entry(session_name(key), SessionEntry)

    def result(self, name: str) -> ResultEntry:
        """Returns the entry of a result by its name. Raises RigError archive.not_found, archive.damaged."""
        return self._entry(name, ResultEntry)

    def results(self, key: str) -> list[ResultEntry]:
        """Returns the entries of all results of a session, oldest first."""
        names = self.contents.names(f"{SESSIONS}/{key}/results")
        return sorted((self.result(name) for name in names), key=lambda result: result.age)

    def lacking(self, key: str, results: Iterable[str] = ()) -> str | None:
        """Returns what the archive lacks of a session that was pushed to it; None if it has all.

        The entries of `results` must be there, because nothing in the archive says that one was. Every file of the
        session and of its results must have its size; nothing is hashed. Raises RigError archive.unreachable.
        """
        try:
            for name in results:
                if self.contents.size(name) is None:
                    return f"The archive has no entry {name}"
            for entry in (self.session(key), *self.results(key)):
                for name, file in entry.files.items():
                    found = self.contents.object_size(file.sha256)
                    if found != file.bytes:
                        return f"{name} is missing" if found is None else f"{name} has {found} of {file.bytes} bytes"
        except RigError as error:
            if error.code not in (ErrorCode.ARCHIVE_NOT_FOUND, ErrorCode.ARCHIVE_DAMAGED):
                raise
            return error.detail
        return None

    def _entry(self, name: str, kind: type[EntryT]) -> EntryT:
        content = self.contents.read(name)
        if content is None:
            raise RigError(ErrorCode.ARCHIVE_NOT_FOUND, f"The archive has no entry {name}")
        try:
            return kind.model_validate_json(content)
        except ValidationError as error:
            raise RigError(
                ErrorCode.ARCHIVE_DAMAGED, f"{name} is not readable: {error.error_count()} faults"
            ) from error


class Archive(ArchiveFiles):
    """The files and the catalogue of one archive."""

    def __init__(self, address: str, catalogue: str | None = None, *, patience_s: float = 0) -> None:
        """Opens an archive.

        `catalogue` is the address of its database (None: SQLite in the archive's folder), `patience_s` as of
        `Catalogue`. Raises RigError archive.address_invalid, also for the catalogue of another archive;
        archive.unreachable, archive.catalogue_newer.
        """
        super().__init__(address)
        self.catalogue_address = _catalogue_address(self.contents, catalogue)
        self.catalogue = Catalogue(self.catalogue_address, patience_s)
        try:
            self.catalogue.require_archive(self.identity, address)
        except RigError:
            self.catalogue.close()
            raise

    @classmethod
    def create(cls, address: str, catalogue: str | None = None, *, patience_s: float = 0) -> Self:
        """Begins an archive in an empty or new folder, or below an unused prefix; one that is there is only opened.

        Raises RigError as opening does, and folder.invalid within a session's folder.
        """
        contents = ContentStore(address)
        if contents.read_first(MARK) is None:
            _catalogue_address(contents, catalogue)
            if contents.folder is not None:
                refuse_in_session(contents.folder, "archive")
            if contents.names(""):
                raise RigError(
                    ErrorCode.ARCHIVE_ADDRESS_INVALID, f"{address} holds other files: name an empty folder or prefix"
                )
            contents.write(MARK, _Mark(identity=uuid.uuid4().hex).model_dump_json().encode())
        return cls(address, catalogue, patience_s=patience_s)

    def close(self) -> None:
        """Closes the connections."""
        self.catalogue.close()

    # ------------------------------------------------------------------------------------------------------------ in

    def push(self, folder: Path, label: str | None = None, notes: str | None = None) -> Pushed:
        """Stores an ended session's folder with its results; files are hashed here and read back from the archive.

        `label` and `notes` are a person's present ones (None: the recipe's). Raises RigError folder.invalid naming the
        file that is damaged, and archive.unreachable.
        """
        from acquisition.archive import reading  # noqa: PLC0415 - imports the solver, which takes seconds

        entry, results = reading.read(folder, label, notes)
        new_files = self.put_files(folder, entry.files)
        self.contents.write(session_name(entry.key), entry.model_dump_json(indent=2).encode())
        for result in results:
            new_files += self.put_files(folder, result.files)
            self.put_result(result)
        self.require()  # a disk that went away meanwhile leaves an empty folder, which takes files too
        new = self.catalogue.add(entry, results)
        files = len(entry.files) + sum(len(result.files) for result in results)
        return Pushed(entry.key, new, files, new_files, entry.bytes)

    def put_result(self, result: ResultEntry) -> None:
        """Stores the entry of a result whose files are stored; an earlier entry of the same solve stays."""
        if self.contents.size(result.name) is None:
            self.contents.write(result.name, result.model_dump_json(indent=2).encode())

    def put_files(self, folder: Path, files: dict[str, FileEntry]) -> int:
        """Stores files below a folder; returns how many were new."""
        return sum(self.contents.put(folder / name, file.sha256) for name, file in files.items())

    # ----------------------------------------------------------------------------------------------------------- out

    def find(self, name: str) -> str:
        """Returns the key of the one session whose key or id begins with `name`. Raises RigError archive.not_found."""
        keys = self.catalogue.session_keys(name)
        if len(keys) != 1:
            several = f"Several sessions begin with {name!r}: {', '.join(key[:12] for key in keys)}, …"
            raise RigError(
                ErrorCode.ARCHIVE_NOT_FOUND, several if keys else f"No session's key or id begins with {name!r}"
            )
        return keys[0]

    def fetch(self, files: dict[str, FileEntry], folder: Path) -> None:
        """Writes files into a folder, each checked by its hash. Raises RigError archive.damaged naming the file."""
        for name, file in files.items():
            try:
                self.contents.get(file.sha256, folder / name)
            except RigError as error:
                if error.code is not ErrorCode.ARCHIVE_DAMAGED:
                    raise
                raise RigError(error.code, f"{name} ({error.detail})", **error.context, file=name) from error

    # -------------------------------------------------------------------------------------------------------- checks

    def entries(self) -> Iterator[tuple[str, SessionEntry | ResultEntry | Fault]]:
        """Yields names and entries of all sessions and results in the archive; a Fault if one is not readable."""
        for name in self.contents.names(SESSIONS):
            kind = SessionEntry if name.endswith("/session.json") else ResultEntry
            try:
                yield name, self._entry(name, kind)
            except RigError as error:
                if error.code is not ErrorCode.ARCHIVE_DAMAGED:
                    raise
                yield name, Fault(name, "damaged", (name,))

    def verify(self, progress: Callable[[int, int], None] = lambda done, total: None) -> list[Fault]:
        """Enters in the catalogue what it lacks, then hashes every file that an entry names; returns any faults.

        An entry is missing if the catalogue, or the other entries of its session, need it; a result without one counts
        as failed in the catalogue, so that it is solved again. The catalogue comes first, because hashing an archive
        takes days. The entries of millions of sessions do not fit in memory, so they are read twice, and of a sound
        file only its hash is remembered.
        """
        faults: list[Fault] = []
        seen: set[bytes] = set()
        total = 0
        for entries in self._entries_by_session():
            sessions = [entry for _, entry in entries if isinstance(entry, SessionEntry)]
            results = [entry for _, entry in entries if isinstance(entry, ResultEntry)]
            faults += [entry for _, entry in entries if isinstance(entry, Fault)]
            for session in sessions:
                self.catalogue.add(session, sorted(results, key=lambda result: result.age))
            for entry in (*sessions[:1], *results[:1]):
                key = entry.key if isinstance(entry, SessionEntry) else entry.session
                if bytes.fromhex(key) not in seen:
                    faults += self._lost(key, {name for name, _ in entries})
                    seen.add(bytes.fromhex(key))
            total += 1
        for key in self.catalogue.selected_keys(sqlalchemy.true()):
            if bytes.fromhex(key) not in seen:
                faults += self._lost(key, set())
        sound: set[bytes] = set()
        unsound: dict[str, tuple[str, str, list[str]]] = {}
        for done, entries in enumerate(self._entries_by_session()):
            progress(done, total)
            for name, entry in entries:
                for path, file in {} if isinstance(entry, Fault) else entry.files.items():
                    digest = bytes.fromhex(file.sha256)
                    if digest in sound:
                        continue
                    if file.sha256 not in unsound:
                        what = self.contents.check(file.sha256)
                        if what is None:
                            sound.add(digest)
                            continue
                        unsound[file.sha256] = (path, what, [])
                    unsound[file.sha256][2].append(name)
        return faults + [Fault(path, what, tuple(names)) for _, (path, what, names) in sorted(unsound.items())]

    def _lost(self, key: str, found: set[str]) -> list[Fault]:
        """Returns the entries of a session that are missing, and has lost results solved again; `found` are there.

        What was written after the entries were listed is looked for by its name.
        """
        results = [row for row in self.catalogue.results(key) if row.state == "done"]
        names = {result_name(key, row.solver, row.settings): row for row in results}
        missing = [name for name in (session_name(key), *names) if name not in found]
        missing = [name for name in missing if self.contents.size(name) is None]
        for name in missing:
            if name in names:
                self.catalogue.forget_result(names[name])
        return [Fault(name, "missing", (f"session {key}",)) for name in missing]

    def _entries_by_session(self) -> Iterator[list[tuple[str, SessionEntry | ResultEntry | Fault]]]:
        """Yields entries with their names by session; a Fault if one is not readable or does not match its name."""
        for _, group in itertools.groupby(self.entries(), key=lambda found: found[0].split("/")[1]):
            yield [
                (name, entry if isinstance(entry, Fault) or name == entry.name else Fault(name, "damaged", (name,)))
                for name, entry in group
            ]


def refuse_missing_folder(address: str) -> None:
    """Refuses a folder that holds no archive; other addresses, which may not answer now, are not looked at.

    Raises RigError archive.address_invalid, archive.unreachable.
    """
    if ContentStore(address).folder is not None:
        ArchiveFiles(address)


def _no_archive(contents: ContentStore) -> str:
    """States that an address holds no archive, and what to do."""
    address, folder = contents.address, contents.folder
    found = "holds no archive" if folder is None or folder.is_dir() else "there is no such folder"
    return f"{address}: {found}: correct the address, mount its disk, or begin one with `lightpose archive create`"


def _catalogue_address(contents: ContentStore, catalogue: str | None) -> str:
    """Returns the catalogue's address. Raises RigError archive.address_invalid if none is known."""
    if catalogue is None and contents.folder is None:
        raise RigError(
            ErrorCode.ARCHIVE_ADDRESS_INVALID,
            f"{contents.address} is not a folder, so its catalogue is elsewhere: name it with --catalogue",
        )
    return catalogue or catalogues.in_folder(contents.folder or Path())


def _read_mark(address: str, content: bytes) -> _Mark:
    """Raises RigError archive.damaged, archive.catalogue_newer."""
    try:
        mark = _Mark.model_validate_json(content)
    except ValidationError as error:
        raise RigError(ErrorCode.ARCHIVE_DAMAGED, f"{address}: {MARK} is not readable") from error
    if mark.format > _Mark().format:
        raise RigError(
            ErrorCode.ARCHIVE_CATALOGUE_NEWER,
            f"{address} was made by a newer release (format {mark.format}): use that release",
        )
    return mark
