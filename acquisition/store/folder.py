"""Session folders: files that are replaced atomically.

A file is written under a temporary name, flushed to the disk and renamed, and only then entered in the journal. A
folder is complete without the database, so it can be copied elsewhere and read there.
"""

import errno
import hashlib
import io
import json
import os
import shutil
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import tifffile
from pydantic import ValidationError

from acquisition.formats.atomic_write import publish
from acquisition.models.base import Value
from acquisition.models.errors import ErrorCode, RigError
from acquisition.models.shot import FrameRef

Stored = TypeVar("Stored", bound=Value)

RESERVED_BYTES = 32 << 20
"""Bytes of the disk that images and results never use: the journal needs them to record that the disk is full."""


def require_space(folder: Path, size: int) -> None:
    """Raises RigError store.disk_full unless `size` bytes fit on the disk of `folder` and RESERVED_BYTES stay free."""
    free = shutil.disk_usage(folder).free
    if free < size + RESERVED_BYTES:
        raise RigError(
            ErrorCode.STORE_DISK_FULL,
            f"{(size + RESERVED_BYTES) / 1e6:.0f} MB are needed in {folder.name}, but only {free / 1e6:.0f} MB are "
            "free",
            needed_bytes=size + RESERVED_BYTES,
            free_bytes=free,
        )


def write_bytes(path: Path, content: bytes) -> str:
    """Writes a file atomically and durably; returns its SHA-256. Raises RigError store.disk_full, OSError with the
    file's name."""
    partial = path.with_name(f".{path.name}.{threading.get_ident()}.part")  # two threads may write the same file
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        require_space(path.parent, len(content))
        with partial.open("wb") as file:
            file.write(content)
        publish(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise RigError(ErrorCode.STORE_DISK_FULL, f"No space left to write {path.name}", file=path.name) from error
        error.filename = error.filename or str(path)  # `fsync` and `write` know only a descriptor
        raise
    return hashlib.sha256(content).hexdigest()


@contextmanager
def refusals(data: Path) -> Generator[None]:
    """Turns an OSError at a file below the data folder `data` into RigError store.unwritable, as the journal does: the
    disk fails or is mounted read-only, or permissions are wrong. A file that is missing is another trouble."""
    try:
        yield
    except OSError as error:
        name = None if error.filename is None else Path(os.fsdecode(error.filename))
        if name is None or not name.is_relative_to(data) or isinstance(error, FileNotFoundError):
            raise
        file = str(name.relative_to(data))
        detail = f"{file} cannot be written: {error.strerror}"
        raise RigError(ErrorCode.STORE_UNWRITABLE, detail, file=file) from error


def write_value(path: Path, value: Value) -> str:
    """Writes a value as indented JSON and returns the file's SHA-256."""
    return write_bytes(path, value.model_dump_json(indent=2).encode())


def read_value(kind: type[Stored], folder: Path, name: str) -> Stored:
    """Reads a value from a file of a session's folder. Raises RigError store.corrupt naming session and file."""
    try:
        return kind.model_validate_json((folder / name).read_bytes())
    except (OSError, ValidationError) as error:
        raise damaged(folder, name, error) from error


def damaged(folder: Path, name: str, error: Exception) -> RigError:
    """Returns RigError store.corrupt for a session's file that cannot be read, or whose content has changed."""
    why = error.strerror if isinstance(error, OSError) else "its content has changed since it was written"
    return RigError(ErrorCode.STORE_CORRUPT, f"sessions/{folder.name}/{name}: {why}", session_id=folder.name, file=name)


def write_frame(folder: Path, name: str, pixels: npt.NDArray[np.uint16]) -> FrameRef:
    """Writes a frame (H, W) as an uncompressed 16-bit TIFF under `folder` and returns its reference.

    Uncompressed, because decoding PNG takes ten times as long as the whole solve.
    """
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, pixels, photometric="minisblack", metadata=None)
    height, width = pixels.shape
    return FrameRef(path=name, width=width, height=height, sha256=write_bytes(folder / name, buffer.getvalue()))


def sha256_of(path: Path) -> str:
    """Returns the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def remove(folder: Path) -> None:
    """Removes the folder of a session that is no longer in the journal, if there is one.

    What a job still writes there meanwhile, such as an export, is removed when that job has ended.
    """
    try:
        shutil.rmtree(folder)
    except OSError as error:
        if error.errno not in (errno.ENOENT, errno.ENOTEMPTY):
            raise


def write_manifest(folder: Path, facts: Mapping[str, object]) -> str:
    """Writes `manifest.json`: the facts, and the SHA-256 and size of each other file in the folder."""
    files = {
        str(path.relative_to(folder)): {"sha256": sha256_of(path), "bytes": path.stat().st_size}
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "manifest.json" and not path.name.endswith(".part")
    }
    return write_bytes(folder / "manifest.json", json.dumps({**facts, "files": files}, indent=2).encode())
