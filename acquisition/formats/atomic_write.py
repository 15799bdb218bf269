"""Atomic, durable writing of files and folders: under another name on the same disk, then flushed and renamed.

A killed process leaves its hidden folder behind. `discard_partial` removes it once nobody writes there any more.
"""

import errno
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from acquisition.models.errors import ErrorCode, RigError


def publish(partial: Path, final: Path) -> None:
    """Flushes a finished file, or a folder with all that is in it, to the disk and renames it to its place.

    Renaming alone leaves an empty file there when the power fails. A folder replaces nothing.
    """
    for path in (*partial.rglob("*"), partial):
        _flush(path)
    partial.rename(final)
    _flush(final.parent)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def discard_partial(folder: Path) -> None:
    """Removes the hidden folders that killed processes have left of `atomic_folder(folder)`."""
    for partial in folder.parent.glob(f".{folder.name}.*"):
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def written_by_job(folder: Path) -> Generator[None]:
    """Cleans up around the block in which another process makes `folder`.

    An existing folder is removed first: nothing refers to it yet, a crash left it before its entry in the journal. If
    the block fails, hidden folders are removed, because the process may have been killed while it wrote.
    """
    if folder.exists():
        shutil.rmtree(folder)
    try:
        yield
    except BaseException:
        discard_partial(folder)
        raise


@contextmanager
def atomic_folder(folder: Path) -> Generator[Path]:
    """Yields a hidden folder to write into. It is renamed to `folder` when the block ends, and removed if it fails.

    An existing folder is replaced as a whole.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        yield partial
        partial.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        publish(partial, folder)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


@contextmanager
def refused_if_unwritable(out: Path) -> Generator[None]:
    """Turns errors of the disk, in a block that writes a person's `out`, into RigError store.disk_full or
    folder.invalid."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise RigError(ErrorCode.STORE_DISK_FULL, f"no space left for {out}: nothing was written there") from error
        raise RigError(
            ErrorCode.FOLDER_INVALID, f"{out}: cannot be written: {error}; name another folder", file=str(out)
        ) from error
