"""Content-addressed files at an fsspec address: a file's name is the SHA-256 of its bytes.

Calibrations, cell files and repeated frames are stored once, however many sessions have them. A file is never changed,
so nothing has to be locked, an interrupted push is repeated without harm, and hashing finds damage. A file appears as a
whole: object stores ensure this by themselves; elsewhere it is written under another name and renamed.
"""

import fcntl
import hashlib
import shutil
import uuid
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, cast

import fsspec
from fsspec.asyn import AsyncFileSystem, sync
from fsspec.exceptions import FSTimeoutError
from fsspec.implementations.local import LocalFileSystem

from acquisition.formats.atomic_write import publish
from acquisition.models.errors import ErrorCode, RigError

OBJECTS = "objects"
PARTIALS = ".partial"
"""Folder, in archives that are folders, of the files that are being written."""
BLOCK_BYTES = 4 << 20
ATOMIC_PROTOCOLS = frozenset({"s3", "gcs", "abfs", "memory"})
"""File systems of fsspec in which a file that is being written cannot be read yet."""
FIRST_ANSWER_S = 2.5
"""Time limit, s, for an object store's answer to the first request. Without it, s3fs and botocore would ask a silent
store ten times, for `READ_TIMEOUT_S` each, if `answering` does not know its address from the environment."""
CONNECT_TIMEOUT_S, READ_TIMEOUT_S, ATTEMPTS = 1.5, 60, 2
"""Time-outs, s, of a connection to an object store and of each block that it sends, and how often botocore tries."""


class ContentStore:
    """The files of one archive. Every method raises RigError archive.unreachable when the store fails or refuses."""

    def __init__(self, address: str) -> None:
        """Raises RigError archive.address_invalid for an address that fsspec does not know."""
        self.address = address
        options: dict[str, Any] = {}
        if address.startswith(("s3://", "s3a://")):
            timeouts = {"connect_timeout": CONNECT_TIMEOUT_S, "read_timeout": READ_TIMEOUT_S}
            # Other processes add and remove files, so listings are not cached.
            options = {
                "config_kwargs": timeouts | {"retries": {"total_max_attempts": ATTEMPTS}},
                "use_listings_cache": False,
            }
        try:
            self._files, self._root = fsspec.url_to_fs(address, **options)
        except (ValueError, ImportError, OSError) as error:
            raise RigError(
                ErrorCode.ARCHIVE_ADDRESS_INVALID,
                f"{address}: {error}; give a folder or an address such as s3://bucket",
            ) from error

    @property
    def folder(self) -> Path | None:
        """The archive as a folder of this machine; None if it is elsewhere."""
        return Path(self._root) if isinstance(self._files, LocalFileSystem) else None

    def put(self, file: Path, digest: str) -> bool:
        """Stores a file of this SHA-256 and reads it back; returns whether it was new.

        A stored file that is damaged is replaced. Raises RigError archive.damaged when `file` itself has another hash.
        """
        name = _object(digest)
        if self.size(name) == file.stat().st_size and self.hash_of(name) == digest:
            return False
        with _explained(self.address, writing=True):
            if isinstance(self._files, LocalFileSystem):
                with _renamed(Path(self._root), name) as partial:
                    shutil.copyfile(file, partial)
            else:
                self._put_remote(file, name)
        if self.hash_of(name) != digest:
            self.remove(name)
            raise RigError(
                ErrorCode.ARCHIVE_DAMAGED, f"{file} has changed since its manifest was written", file=str(file)
            )
        return True

    def get(self, digest: str, file: Path) -> None:
        """Writes the stored file to `file`. Raises RigError archive.damaged when it is missing or has another hash."""
        file.parent.mkdir(parents=True, exist_ok=True)
        found = hashlib.sha256()
        try:
            with file.open("wb") as target:
                for block in self._blocks(_object(digest)):
                    found.update(block)
                    target.write(block)
            if found.hexdigest() != digest:
                raise _damaged(digest, "is damaged")
        except FileNotFoundError as error:
            file.unlink()
            raise _damaged(digest, "is missing") from error
        except BaseException:
            file.unlink()
            raise

    def check(self, digest: str) -> str | None:
        """Returns what is wrong with the stored file: `missing`, `damaged`, or None."""
        found = self.hash_of(_object(digest))
        return "missing" if found is None else None if found == digest else "damaged"

    def object_size(self, digest: str) -> int | None:
        """Returns the size of the stored file of this SHA-256, bytes, or None if there is none."""
        return self.size(_object(digest))

    # -------------------------------------------------------------------------------------------------- named files

    def read(self, name: str) -> bytes | None:
        """Returns the content of a small named file, or None if there is none."""
        with _explained(self.address):
            try:
                return bytes(self._files.cat_file(self._path(name)))
            except FileNotFoundError:
                return None

    def read_first(self, name: str) -> bytes | None:
        """As `read`, for the first request to a store that may not exist: it has to answer within `FIRST_ANSWER_S`."""
        files = self._files
        if not isinstance(files, AsyncFileSystem):
            return self.read(name)
        with _explained(self.address):
            try:
                # fsspec's coroutines have underscores, and `sync` no types
                read = files._cat_file  # pyright: ignore[reportPrivateUsage]
                return cast(bytes, sync(files.loop, read, self._path(name), timeout=FIRST_ANSWER_S))
            except FileNotFoundError:
                return None
            except FSTimeoutError as error:
                raise RigError(
                    ErrorCode.ARCHIVE_UNREACHABLE,
                    f"{self.address}: no answer within {FIRST_ANSWER_S:g} s",
                    address=self.address,
                ) from error

    def write(self, name: str, content: bytes) -> None:
        """Writes a small named file as a whole; an existing one is replaced."""
        with _explained(self.address, writing=True):
            if not isinstance(self._files, LocalFileSystem):
                self._files.pipe_file(self._path(name), content)
                return
            with _renamed(Path(self._root), name) as partial:
                partial.write_bytes(content)

    def names(self, folder: str) -> list[str]:
        """Returns the sorted names, relative to the archive, of the files below a folder; hidden files are left out."""
        with _explained(self.address):
            try:
                found = self._files.find(self._path(folder))
            except FileNotFoundError:
                return []
        start = len(self._root.rstrip("/")) + 1
        return sorted(name[start:] for name in found if not name.rpartition("/")[2].startswith("."))

    def size(self, name: str) -> int | None:
        """Returns the size of a named file, bytes, or None if there is none."""
        with _explained(self.address):
            try:
                return int(self._files.info(self._path(name))["size"])
            except FileNotFoundError:
                return None

    def hash_of(self, name: str) -> str | None:
        """Returns the SHA-256 of a named file as stored, or None if there is none."""
        found = hashlib.sha256()
        try:
            for block in self._blocks(name):
                found.update(block)
        except FileNotFoundError:
            return None
        return found.hexdigest()

    def remove(self, name: str) -> None:
        """Removes a named file, if there is one."""
        with _explained(self.address):
            if self._files.exists(self._path(name)):
                self._files.rm_file(self._path(name))

    # --------------------------------------------------------------------------------------------------- internals

    def _path(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}"

    def _blocks(self, name: str) -> Iterator[bytes]:
        with _explained(self.address), self._files.open(self._path(name), "rb", block_size=BLOCK_BYTES) as file:
            while block := file.read(BLOCK_BYTES):
                yield block

    def _put_remote(self, file: Path, name: str) -> None:
        protocols = {self._files.protocol} if isinstance(self._files.protocol, str) else set(self._files.protocol)
        if protocols & ATOMIC_PROTOCOLS:
            self._files.put_file(str(file), self._path(name))
            return
        partial = self._path(f"{name}.{uuid.uuid4().hex}.part")
        self._files.makedirs(partial.rpartition("/")[0], exist_ok=True)
        self._files.put_file(str(file), partial)
        self._files.mv(partial, self._path(name))


@contextmanager
def _renamed(root: Path, name: str) -> Generator[Path]:
    """Yields a hidden file in the archive, which is flushed and renamed to `name` when the block ends.

    It is locked meanwhile. A lock ends with its process, so files without one were left by killed processes, here or on
    another machine, and are removed first. Where the disk knows no locks, they stay.
    """
    partials, target = root / PARTIALS, root / name
    for folder in (partials, target.parent):
        folder.mkdir(parents=True, exist_ok=True)
    for left in partials.iterdir():
        with suppress(OSError), left.open("r+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            left.unlink()
    partial, file = _locked(partials)
    try:
        with file:
            yield partial
            publish(partial, target)
    finally:
        partial.unlink(missing_ok=True)


def _locked(partials: Path) -> tuple[Path, BinaryIO]:
    """Creates a hidden file and locks it; another one if a process removed it as left behind before it was locked."""
    while True:
        partial = partials / f".{uuid.uuid4().hex}.part"
        file = partial.open("wb")
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        if partial.exists():
            return partial, file
        file.close()


@contextmanager
def _explained(address: str, *, writing: bool = False) -> Generator[None]:
    """Turns a store's own errors into archive.unreachable; a missing file that is read stays FileNotFoundError."""
    try:
        yield
    except RigError:
        raise
    except Exception as error:
        if isinstance(error, FileNotFoundError) and not writing:
            raise
        if not isinstance(error, OSError) and not type(error).__module__.startswith(("botocore", "aiohttp")):
            raise
        sentence = str(error).partition("\n")[0] or type(error).__name__
        raise RigError(ErrorCode.ARCHIVE_UNREACHABLE, f"{address}: {sentence}", address=address) from error


def _object(digest: str) -> str:
    return f"{OBJECTS}/{digest[:2]}/{digest}"


def _damaged(digest: str, what: str) -> RigError:
    return RigError(ErrorCode.ARCHIVE_DAMAGED, f"{_object(digest)} {what}", digest=digest)
